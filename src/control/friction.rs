//! Friction compensation: the modelled hip friction, added to the torque. Thesis 4.2.2. RT: yes.

use crate::config::checked::Model;
use crate::model::compass_gait::dynamics::friction;
use crate::model::compass_gait::params::Normalised;

/// Friction law and the share of it that is compensated.
#[derive(Clone, Copy, Debug)]
pub(super) struct Compensation {
    law: Normalised<f64>,
    share: f64,
}

impl Compensation {
    pub(super) fn new(model: &Model, share: f64) -> Self {
        Self { law: model.params().normalised(), share }
    }

    /// Normalised torque on the stance row that cancels friction at the hip rate `r = θ̇s - θ̇w`.
    pub(super) fn torque(&self, r: f64) -> f64 {
        -self.share * friction(&self.law, r)
    }
}
