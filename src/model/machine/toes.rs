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

/// A motion that differs by less in m, m/s and m/s² continues the present one: rounding.
const CONTINUES: f64 = 1e-12;

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
        let stance = self.stance();
        for (leg, m) in motion.iter().enumerate() {
            let before = (self.y.q[toes + leg], self.y.v[toes + leg], self.plant.feet.toe_acceleration[leg]);
            let changes = [m.short_m - before.0, m.rate_m_s - before.1, m.acceleration_m_s2 - before.2];
            if changes.iter().all(|change| change.value().abs() < CONTINUES && !change.is_varied()) {
                continue;
            }
            self.y.q[toes + leg] = m.short_m;
            self.y.v[toes + leg] = m.rate_m_s;
            self.plant.feet.toe_acceleration[leg] = m.acceleration_m_s2;
            if leg == stance {
                self.keep_stance_foot(m.short_m - before.0, m.rate_m_s - before.1);
            }
            if leg != stance && self.plant.stands_on_a_point() {
                // A massless toe in the air: nothing else feels it.
                self.work.a[toes + leg] = m.acceleration_m_s2;
            } else {
                self.flow_of = FlowOf::Nothing;
            }
        }
        self.arm_clear_foot();
    }

    /// The stance leg has become shorter by so much, and does so by so much faster: its foot stays where and as fast as
    /// it was, so the point at the end of the full leg moves.
    fn keep_stance_foot(&mut self, change_m: S, change_m_s: S) {
        if self.plant.feet.contact == Contact::Flight {
            return;
        }
        let leg = self.stance();
        let slope = self.plant.legs().map_or(S::zero(), |legs| legs.slope());
        let (sin, cos) = (self.y.q[leg] + slope).sin_cos();
        self.y.q[2] += change_m * sin;
        self.y.q[3] -= change_m * cos;
        let turn = change_m * self.y.v[leg];
        self.y.v[2] += turn * cos + change_m_s * sin;
        self.y.v[3] += turn * sin - change_m_s * cos;
    }

    /// What each leg is shorter than its length and the rate of that, m and m/s.
    #[must_use]
    pub fn toes(&self) -> [[S; 2]; 2] {
        let Some(toes) = self.plant.feet.toes else { return [[S::zero(); 2]; 2] };
        [0, 1].map(|leg| [self.y.q[toes + leg], self.y.v[toes + leg]])
    }

    /// Velocity of the stance foot along the mean ground and normal to it.
    fn stance_foot_velocity(&self) -> [S; 2] {
        let Some(rows) = self.plant.level_foot_rows(&self.y, false) else { return [S::zero(); 2] };
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
