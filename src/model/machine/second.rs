//! The second foot on the ground: double support, a trailing foot that brushes, a robot at rest on both feet. RT: yes.
//!
//! One foot stands rigidly ([`super::contact`]). The other one, while it touches, is on a stiff damped spring with dry
//! friction, so that no force is indeterminate and none is missed. It becomes the foot that stands when it lands so that
//! the old one leaves (the rigid impact says so), or when the old one is unloaded.
//! The spring acts normal to the floor as it lies there, so an edge pushes back and up, and no energy comes out of it.

use super::Machine;
use super::contact::Contact;
use super::foot::{FootRows, on_slope};
use super::hold::product;
use super::motion::{FlowOf, Phase, Plant, Work};
use crate::base::scalar::Scalar;
use crate::model::mechanism::MAX;

/// Stiffness of the second contact, N/m: half the weight presses it in by .4 mm.
const STIFFNESS_N_M: f64 = 2e5;
/// Damping, N s/m: half of critical for the 2.2 kg that a leg weighs at its foot.
const DAMPING_N_S_M: f64 = 650.0;
/// Friction where the ground has no limit.
const NO_SLIP: f64 = 10.0;
/// A swing foot this deep has touched where no touchdown is expected, m: legs side by side, or an edge of the floor.
const DEEP_M: f64 = 2e-4;
/// An old foot that leaves slower, m/s, does not leave.
const LEAVES_M_S: f64 = 1e-3;

/// Where the second foot is held along the ground, m.
#[derive(Clone, Copy, Debug)]
pub(super) struct Second<S> {
    anchor: S,
}

/// The second foot's contact: rows and force along and normal to the floor under it, which rises by `rise`.
struct Press<S> {
    tangent: [S; MAX],
    normal: [S; MAX],
    rise: f64,
    force: [S; 2],
}

impl<S: Scalar> Plant<S> {
    /// Force of the ground on the second foot, N.
    fn press(&self, y: &Phase<S>) -> Option<Press<S>> {
        let second = self.feet.second.as_ref()?;
        let swing = 1 - self.legs()?.stance();
        let depth = -self.swing_height(y)?;
        if depth.value() <= 0.0 {
            return None;
        }
        let place = self.foot_place(y, swing)?;
        let rise = self.rise_under(y, swing);
        let long = libm::sqrt(1.0 + rise * rise);
        let FootRows { tangent, normal, .. } = self.level_foot_rows(y, true)?.on_slope(self.n, rise);
        let speed = [product(&tangent, &y.v, self.n), product(&normal, &y.v, self.n)];
        let press = (depth * (STIFFNESS_N_M / long) - speed[1] * DAMPING_N_S_M).clamp_to(0.0, f64::INFINITY);
        let most = self.most_friction() * press.value();
        let hold = -((place - second.anchor) * (STIFFNESS_N_M * long)) - speed[0] * DAMPING_N_S_M;
        Some(Press { tangent, normal, rise, force: [hold.clamp_to(-most, most), press] })
    }

    fn most_friction(&self) -> f64 {
        self.ground.friction.map_or(NO_SLIP, Scalar::value)
    }

    /// Adds the second foot's force.
    #[inline]
    pub(super) fn add_second_foot(&self, y: &Phase<S>, work: &mut Work<S>) {
        if self.feet.second.is_none() {
            return;
        }
        let Some(press) = self.press(y) else { return };
        for i in 0..self.n {
            work.eq.force[i] += press.tangent[i] * press.force[0] + press.normal[i] * press.force[1];
        }
    }
}

impl<S: Scalar> Machine<S> {
    /// Both feet may be on the ground at once.
    pub fn let_stand_on_both(&mut self) {
        self.plant.ground.both = true;
    }

    /// Force of the ground on the foot that does not stand, N: along the ground and normal to it; `None` in the air.
    #[must_use]
    pub fn second_foot_force(&self) -> Option<[S; 2]> {
        let Press { rise, force, .. } = self.plant.press(&self.y)?;
        Some(on_slope(force, -rise))
    }

    /// True if the swing foot that has just touched presses the old foot down instead of relieving it: it then becomes
    /// the second foot.
    pub(super) fn lands_beside(&mut self) -> bool {
        if !self.plant.ground.both || self.plant.feet.contact == Contact::Flight {
            return false;
        }
        let Some(rows) = self.plant.foot_rows(&self.y, true) else { return false };
        let (velocity, contact, strike) = (self.y.v, self.plant.feet.contact, self.plant.feet.last_strike);
        self.flow_at_start();
        self.strike(&rows);
        let old = self.plant.foot_rows(&self.y, false);
        let leaves = old.map_or(0.0, |old| product(&old.normal, &self.y.v, self.plant.n).value());
        self.y.v = velocity;
        self.plant.feet.contact = contact;
        self.plant.feet.last_strike = strike;
        if leaves <= LEAVES_M_S {
            self.put_second_foot();
        }
        leaves <= LEAVES_M_S
    }

    fn put_second_foot(&mut self) {
        let swing = 1 - self.stance();
        self.plant.feet.second = self.plant.foot_place(&self.y, swing).map(|anchor| Second { anchor });
        self.flow_of = FlowOf::Nothing;
    }

    /// After a step: the second foot leaves, slips along, or turns out to have touched.
    pub(super) fn follow_second_foot(&mut self) {
        if !self.plant.ground.both {
            return;
        }
        let depth = self.plant.swing_height(&self.y).map_or(0.0, |h| -h.value());
        let Some(second) = self.plant.feet.second else {
            if depth > DEEP_M {
                self.put_second_foot();
            }
            return;
        };
        if depth <= 0.0 {
            self.plant.feet.second = None;
            self.flow_of = FlowOf::Nothing;
            return;
        }
        let (Some(press), Some(place)) = (self.plant.press(&self.y), self.plant.foot_place(&self.y, 1 - self.stance()))
        else {
            return;
        };
        let stiffness_n_m = STIFFNESS_N_M * libm::sqrt(1.0 + press.rise * press.rise);
        let reach = self.plant.most_friction() * press.force[1].value() / stiffness_n_m;
        let stretch = (place - second.anchor).clamp_to(-reach, reach);
        self.plant.feet.second = Some(Second { anchor: place - stretch });
    }
}
