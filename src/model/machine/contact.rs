//! The foot on the ground. RT: yes.

use super::Machine;
use crate::base::scalar::Scalar;
use crate::model::mechanism::Body;

impl<S: Scalar> Machine<S> {
    /// Standing leg: 0 inner, 1 outer; 0 for a machine without legs.
    #[must_use]
    pub fn stance(&self) -> usize {
        match &self.body {
            Body::Legs(legs) => legs.stance(),
            _ => 0,
        }
    }
}
