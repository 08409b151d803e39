//! Toes that lengthen and shorten the legs: two massless coordinates that move as their screws do. RT: yes, no allocation.
//!
//! A screw does not back-drive, so a toe's motion is prescribed: position, rate and acceleration of what the leg is
//! *shorter* than its length. The rate is part of the foot's velocity (a toe that extends lands faster and pushes off), the
//! acceleration loads the ground.

use super::contact::Contact;
use super::hold::product;
use super::motion::{FlowOf, Plant, Work};
use super::{Machine, MachineError};
use crate::base::scalar::Scalar;
use crate::model::mechanism::MAX;

/// How a toe moves from now on: what its leg is shorter than its length.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ToeMotion<S> {
    /// m.
    pub short_m: S,
    /// m/s.
    pub rate_m_s: S,
    /// m/s², constant until told anew.
    pub acceleration_m_s2: S,
}

impl<S: Scalar> Plant<S> {
    /// Toes move whatever the forces are.
    pub(super) fn add_toes(&self, work: &mut Work<S>) {
        let Some(toes) = self.feet.toes else { return };
        work.driven = toes..toes + 2;
        for leg in 0..2 {
            work.held.drive(toes + leg, self.feet.toe_acceleration[leg]);
        }
    }
}

impl<S: Scalar> Machine<S> {
    /// Gives both legs toes, as far in as they are in `short_m`. Before [`Self::reset`].
    ///
    /// # Errors
    /// No room for two more coordinates, or a machine that does not walk.
    pub fn give_toes(&mut self, short_m: [S; 2]) -> Result<(), MachineError> {
        let (toes, n) = (self.plant.n, self.plant.n + 2);
        if !self.plant.walks || n > MAX || self.plant.ground.compliance.is_some() {
            return Err(MachineError::Unsupported("toes on this machine are not modelled".to_owned()));
        }
        self.plant.n = n;
        self.plant.feet.toes = Some(toes);
        self.plant.feet.short_at_start = short_m;
        Ok(())
    }

    /// Moves the toes like this from now on, inner and outer. A motion that continues the present one only sets the
    /// acceleration; one that does not is a jump in which the stance foot stays where it is.
    pub fn set_toes(&mut self, motion: [ToeMotion<S>; 2]) {
        let Some(toes) = self.plant.feet.toes else { return };
        self.flow_of = FlowOf::Nothing;
        let before = self.stance_foot_velocity();
        let leg = self.stance();
        let change = motion[leg].short_m - self.y.q[toes + leg];
        for (k, m) in motion.iter().enumerate() {
            self.y.q[toes + k] = m.short_m;
            self.y.v[toes + k] = m.rate_m_s;
            self.plant.feet.toe_acceleration[k] = m.acceleration_m_s2;
        }
        if self.plant.feet.contact != Contact::Flight {
            let slope = self.plant.legs().map_or(S::zero(), |legs| legs.slope());
            let (sin, cos) = (self.y.q[leg] + slope).sin_cos();
            self.y.q[2] += change * sin;
            self.y.q[3] -= change * cos;
            let after = self.stance_foot_velocity();
            for k in 0..2 {
                self.y.v[2 + k] += before[k] - after[k];
            }
        }
        self.arm_clear_foot();
    }

    /// What each leg is shorter than its length and the rate of that, m and m/s.
    #[must_use]
    pub fn toes(&self) -> [[S; 2]; 2] {
        let Some(toes) = self.plant.feet.toes else { return [[S::zero(); 2]; 2] };
        [0, 1].map(|leg| [self.y.q[toes + leg], self.y.v[toes + leg]])
    }

    /// Velocity of the stance foot along the ground and normal to it.
    fn stance_foot_velocity(&self) -> [S; 2] {
        let Some(rows) = self.plant.foot_rows(&self.y, false) else { return [S::zero(); 2] };
        [product(&rows.tangent, &self.y.v, self.plant.n), product(&rows.normal, &self.y.v, self.plant.n)]
    }

    /// The stance foot at the start: on the ground at the origin, the toe of a leg of full length below it.
    pub(super) fn start_toes(&mut self) {
        let Some(toes) = self.plant.feet.toes else { return };
        let leg = self.stance();
        let short = self.plant.feet.short_at_start;
        (self.y.q[toes], self.y.q[toes + 1]) = (short[0], short[1]);
        let slope = self.plant.legs().map_or(S::zero(), |legs| legs.slope());
        let (sin, cos) = (self.y.q[leg] + slope).sin_cos();
        self.y.q[2] += short[leg] * sin;
        self.y.q[3] -= short[leg] * cos;
        let moving = self.stance_foot_velocity();
        self.y.v[2] -= moving[0];
        self.y.v[3] -= moving[1];
    }
}
