//! Impulses at the joints: a push from outside, a rotor that meets its stop. What stands takes part. RT: yes, no allocation.

use super::hold::product;
use super::motion::FlowOf;
use super::{Machine, Play};
use crate::base::scalar::Scalar;
use crate::model::effect::friction::Grip;
use crate::model::mechanism::{Body, MAX};

/// A rate below this, rad/s, is rest after an impulse.
const AT_REST: f64 = 1e-12;

impl<S: Scalar> Machine<S> {
    /// An impulse on a coordinate.
    pub(super) fn push(&mut self, index: usize) {
        self.pushes[index].done = true;
        let mut row = [S::zero(); MAX];
        self.pushes[index].row.push(S::one(), &mut row);
        self.kick_along(&row, self.pushes[index].impulse);
    }

    /// A horizontal impulse at the hip, N s, + forwards. Nothing without legs.
    ///
    /// A foot that stands is held whatever impulse that takes: a real push lasts some 50 ms, in which the friction of a
    /// standing robot takes up several N s.
    pub fn push_hip(&mut self, impulse_ns: S) {
        let Body::Legs(legs) = &self.plant.body else { return };
        let (s, mut row) = (legs.stance(), [S::zero(); MAX]);
        // Hip = toe + l (-sin θs, cos θs); the toe's coordinates lie along and normal to the ground.
        row[s] = -(legs.length() * self.y.q[s].cos());
        if self.plant.walks {
            let (sin, cos) = legs.slope().sin_cos();
            (row[2], row[3]) = (cos, sin);
        }
        self.kick_along(&row, impulse_ns);
        self.flow_of = FlowOf::Nothing;
        self.settle_modes();
    }

    fn kick_along(&mut self, row: &[S; MAX], impulse: S) {
        self.flow_at_start();
        let response = self.response(row);
        for k in 0..self.plant.n {
            self.y.v[k] += response[k] * impulse;
        }
        self.follow_stops();
        self.regrip();
        self.before_now();
    }

    /// A rotor has crossed its play.
    pub(super) fn meet(&mut self, i: usize) {
        let side = self.plant.rotors[i].twist(&self.y.q).sign();
        self.flow_at_start();
        self.stop_twist(i);
        self.plant.plays[i] = Play::Closed(side);
        self.regrip();
        self.before_now();
    }

    /// A rotor that leans on its stop goes on with its link after an impact, or is left behind.
    ///
    /// Taken after the impact it is the same as at once: rest of the foot first, then of foot and rotor together.
    pub(super) fn follow_stops(&mut self) {
        for i in 0..self.plant.rotors.len() {
            let rate = self.plant.rotors[i].twist_value(&self.y.v);
            match self.plant.plays[i] {
                Play::Closed(side) if rate * side < -AT_REST => self.plant.plays[i] = Play::Free,
                Play::Closed(_) | Play::Rigid if rate.abs() > AT_REST => {
                    self.flow_of = FlowOf::Nothing;
                    self.flow_at_start();
                    self.stop_twist(i);
                }
                _ => {}
            }
        }
    }

    /// After an impulse every axis slides along its rate, or is at rest.
    pub(super) fn regrip(&mut self) {
        for (axis, grip) in self.plant.axes.iter().zip(&mut self.plant.grips) {
            let rate = axis.row.value_of(&self.y.v);
            if axis.dry.is_some() {
                *grip = if rate.abs() > AT_REST { Grip::along(rate) } else { Grip::Stuck };
            }
        }
    }

    /// Inelastic meeting of rotor and link, the flow being that at the start.
    fn stop_twist(&mut self, i: usize) {
        let row = self.plant.rotors[i].contact_row();
        let response = self.response(&row);
        let impulse = -(product(&row, &self.y.v, self.plant.n) / product(&row, &response, self.plant.n));
        for k in 0..self.plant.n {
            self.y.v[k] += response[k] * impulse;
        }
    }

    /// Change of rates by an impulse of one along `row`, a foot that stands held by the ground.
    fn response(&mut self, row: &[S; MAX]) -> [S; MAX] {
        let n = self.plant.n;
        let mut out = self.work.kick(row, n);
        let mut held: [Option<([S; MAX], [S; MAX])>; 2] = [None, None];
        for (slot, row) in held.iter_mut().zip(self.plant.foot_holds(&self.y)) {
            // Each hold made free of those before it: what one takes up the next leaves as it is.
            let Some(row) = row else { continue };
            *slot = Some((row, self.work.kick(&row, n)));
        }
        if let [Some((first, of_first)), Some((second, of_second))] = &mut held {
            let part = product(first, of_second, n) / product(first, of_first, n);
            for k in 0..n {
                second[k] -= first[k] * part;
                of_second[k] -= of_first[k] * part;
            }
        }
        for (row, response) in held.iter().flatten() {
            let part = product(row, &out, n) / product(row, response, n);
            for k in 0..n {
                out[k] -= response[k] * part;
            }
        }
        out
    }
}
