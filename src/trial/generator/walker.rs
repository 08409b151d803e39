//! Walking: the two legs on a foot that stands, rolls, slides, springs or flies, and the impacts between.
//!
//! Different on purpose from `model`: axes along and normal to the ground with gravity turned (there: angles from the
//! vertical, rows turned), bodies on arms with the toe as two more coordinates, hip friction by implicit time-stepping,
//! a quarter of a millisecond per step. The impact is that of rigid bodies: the foot's velocity after it is given
//! (Newton's restitution), what the cone does not hold slides. A sprung toe lets the leg sink along itself.
//! RT: no.

use nalgebra::{Matrix2, Matrix4, Vector2, Vector4};

use super::chain::{Body, Pair, floating};
use super::machine::{Joint, State};

/// Steps and instants of events are this fine, s.
pub(super) const WALK_STEP_S: f64 = 2.5e-4;
/// Slower rebounds are none, m/s.
const SLOWEST_REBOUND: f64 = 5e-3;
/// Feet closer than this, m, pass each other.
const APART_M: f64 = 0.08;

/// What stands on the ground, and how.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) enum Contact {
    /// Stands, rolls or springs.
    #[default]
    Held,
    /// Slides in this direction.
    Sliding(f64),
    /// In the air.
    Flight,
}

/// The ground and the feet. Zero switches each of them off.
#[derive(Debug, Clone, Default)]
pub(super) struct Ground {
    /// Bodies with the outer leg standing (those of the machine: inner leg).
    pub outer: Vec<Body>,
    /// Leg length, m.
    pub length_m: f64,
    /// Coefficient of friction; 0: never slides.
    pub friction: f64,
    /// Normal speed after an impact over that before.
    pub restitution: f64,
    /// Along the leg at the toe: stiffness, damping.
    pub spring: Pair,
    /// Radius of the foot, m.
    pub radius_m: f64,
    /// Falls towards +x, rad.
    pub slope: f64,
    /// Upward at the hip, N.
    pub lifted_n: f64,
}

/// The feet in a state of the machine.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Feet {
    /// Toe of the standing leg, along and normal to the ground, and its velocity. Of a leg that is not bent or sunk.
    pub toe: [f64; 4],
    /// 0 inner, 1 outer.
    pub stance: usize,
    /// How it stands.
    pub contact: Contact,
    /// Where a sprung toe touches.
    pub tip_m: f64,
    /// A recording tells which leg is next.
    pub told: bool,
    /// That leg, when it is due.
    pub due: Option<usize>,
    /// On this side the swing foot started: not armed there.
    pub side: f64,
}

/// A walking machine during a step.
pub(super) struct Walker<'m> {
    pub(super) inner: &'m [Body],
    pub(super) ground: &'m Ground,
    pub(super) hip: &'m Joint,
    pub(super) gravity_m_s2: f64,
}

/// Angles from the ground's normal, toe; and their rates.
#[derive(Clone, Copy)]
struct Pose {
    q: Vector4<f64>,
    v: Vector4<f64>,
}

/// A foot's velocity is `tangent · v`, `normal · v`; `bias` is what the rates add to its acceleration.
struct Rows {
    tangent: Vector4<f64>,
    normal: Vector4<f64>,
    bias: Pair,
}

/// What pushes, apart from gravity: torque of the motor after its lag, hip friction, time.
#[derive(Clone, Copy)]
struct Drive {
    motor: f64,
    dry: f64,
    time_s: f64,
}

/// What a step may end at.
#[derive(Clone, Copy, PartialEq)]
enum Event {
    Touchdown,
    Landing,
    Stop,
}

const HIP: [f64; 4] = [1.0, -1.0, 0.0, 0.0];

impl Walker<'_> {
    fn pose(&self, state: &State) -> Pose {
        let (q, v, toe) = (state.q(), state.v(), state.feet.toe);
        let slope = self.ground.slope;
        Pose {
            q: Vector4::new(q[0] + slope, q[1] + slope, toe[0], toe[1]),
            v: Vector4::new(v[0], v[1], toe[2], toe[3]),
        }
    }

    fn put(&self, pose: &Pose, state: &mut State) {
        let slope = self.ground.slope;
        state.y[..4].copy_from_slice(&[pose.q[0] - slope, pose.q[1] - slope, pose.v[0], pose.v[1]]);
        state.feet.toe = [pose.q[2], pose.q[3], pose.v[2], pose.v[3]];
    }

    /// Mass matrix, and all forces but those of the hip and of the ground's contact.
    fn free(&self, pose: &Pose, stance: usize) -> (Matrix4<f64>, Vector4<f64>) {
        let (bodies, g) = (if stance == 0 { self.inner } else { &self.ground.outer }, self.gravity_m_s2);
        let (sin, cos) = (libm::sin(self.ground.slope), libm::cos(self.ground.slope));
        let (mass, bias) = floating(bodies, [pose.q[0], pose.q[1]], [pose.v[0], pose.v[1]], [g * sin, -g * cos]);
        let mut force = -Vector4::from(bias);
        let (lift, angle) = (self.ground.lifted_n, pose.q[stance]);
        force[stance] -= lift * self.ground.length_m * libm::sin(angle - self.ground.slope);
        force[2] -= lift * sin;
        force[3] += lift * cos;
        (Matrix4::from(mass), force)
    }

    fn rows(&self, pose: &Pose, stance: usize, swing: bool) -> Rows {
        let (l, r, w) = (self.ground.length_m, self.ground.radius_m, 1 - stance);
        let (mut tangent, mut normal) = (Vector4::new(0.0, 0.0, 1.0, 0.0), Vector4::new(0.0, 0.0, 0.0, 1.0));
        if swing {
            let (a, b) = (pose.q[stance], pose.q[w]);
            (tangent[stance], tangent[w]) = (-l * libm::cos(a), l * libm::cos(b));
            (normal[stance], normal[w]) = (-l * libm::sin(a), l * libm::sin(b));
        }
        let leg = if swing { w } else { stance };
        let (sin, cos, rate) = (libm::sin(pose.q[leg]), libm::cos(pose.q[leg]), pose.v[leg]);
        tangent[leg] += r - r * cos;
        normal[leg] -= r * sin;
        // Of the standing foot only: the other one is not held.
        Rows { tangent, normal, bias: [r * sin * rate * rate, -r * cos * rate * rate] }
    }

    /// Acceleration under given drives, and the contact's force along and normal to the ground.
    fn accelerate(&self, pose: &Pose, feet: &Feet, drive: Drive) -> (Vector4<f64>, Pair) {
        let (mass, mut force) = self.free(pose, feet.stance);
        let (angle, rate) = (pose.q[0] - pose.q[1], pose.v[0] - pose.v[1]);
        let slow = self.hip.viscous * rate + self.hip.quadratic * rate * rate.abs();
        force += Vector4::from(HIP) * (drive.motor + self.hip.landscape(angle, drive.time_s) - slow - drive.dry);
        if self.ground.spring[0] > 0.0 {
            return (self.sprung(pose, feet, &mass, force), [0.0; 2]);
        }
        let Some(inverse) = mass.try_inverse() else { return (Vector4::zeros(), [0.0; 2]) };
        let (free, rows) = (inverse * force, self.rows(pose, feet.stance, false));
        match feet.contact {
            Contact::Flight => (free, [0.0; 2]),
            Contact::Sliding(direction) => {
                let push = rows.normal - rows.tangent * (self.ground.friction * direction);
                let normal = -(rows.normal.dot(&free) + rows.bias[1]) / rows.normal.dot(&(inverse * push));
                (free + inverse * push * normal, [-self.ground.friction * direction * normal, normal])
            }
            Contact::Held => {
                let (wt, wn) = (inverse * rows.tangent, inverse * rows.normal);
                let gives = Matrix2::new(
                    rows.tangent.dot(&wt),
                    rows.tangent.dot(&wn),
                    rows.normal.dot(&wt),
                    rows.normal.dot(&wn),
                );
                let wanted =
                    -Vector2::new(rows.tangent.dot(&free) + rows.bias[0], rows.normal.dot(&free) + rows.bias[1]);
                let hold = gives.try_inverse().map_or_else(Vector2::zeros, |inverse| inverse * wanted);
                (free + wt * hold[0] + wn * hold[1], [hold[0], hold[1]])
            }
        }
    }

    /// The toe sinks along the leg against its spring; across the leg the tip holds it.
    fn sprung(&self, pose: &Pose, feet: &Feet, mass: &Matrix4<f64>, mut force: Vector4<f64>) -> Vector4<f64> {
        let (sin, cos) = (libm::sin(pose.q[feet.stance]), libm::cos(pose.q[feet.stance]));
        let (rx, ry) = (pose.q[2] - feet.tip_m, pose.q[3]);
        let (along, speed) = (ry * cos - rx * sin, pose.v[3] * cos - pose.v[2] * sin);
        let push = -self.ground.spring[0] * along - self.ground.spring[1] * speed;
        force[2] -= push * sin;
        force[3] += push * cos;
        let Some(inverse) = mass.try_inverse() else { return Vector4::zeros() };
        // e = (cos, sin) across the leg: e · r = 0, twice differentiated.
        let mut across = Vector4::new(0.0, 0.0, cos, sin);
        across[feet.stance] = along;
        let free = inverse * force;
        let w = inverse * across;
        free - w * ((across.dot(&free) + 2.0 * pose.v[feet.stance] * speed) / across.dot(&w))
    }

    /// Hip friction over one step: what stops the hip at the end of it, or its level.
    fn dry(&self, pose: &Pose, feet: &Feet, motor: f64, time_s: f64, h: f64) -> f64 {
        if !self.hip.sticks() {
            return 0.0;
        }
        let hip = Vector4::from(HIP);
        let at = |dry| self.accelerate(pose, feet, Drive { motor, dry, time_s }).0;
        let free = at(0.0);
        let rate = hip.dot(&pose.v);
        let ahead = rate + h * hip.dot(&free);
        let gives = hip.dot(&(free - at(1.0)));
        let level = self.hip.level(if rate == 0.0 { ahead } else { rate }, 0.5 * motor, time_s);
        (ahead / (h * gives)).clamp(-level, level)
    }

    /// One step of at most `h`, events inside it included.
    pub(super) fn step(&self, state: &mut State, motor: f64, time_s: f64, h: f64) {
        let (mut t, mut left) = (time_s, h);
        // A bounce, a landing and a slide's end within a quarter of a millisecond; a fourth event waits.
        for _ in 0..4 {
            if left <= 1e-9 {
                return;
            }
            let before = *state;
            let took = self.smooth(state, motor, t, left);
            let Some((event, part)) = self.event(&before, state) else { break };
            *state = before;
            let part = (part * took).clamp(1e-12, took);
            self.smooth(state, motor, t, part);
            self.happen(event, state);
            (t, left) = (t + part, left - part);
        }
        self.hold_or_slide(state, motor, t);
    }

    /// A Runge-Kutta step without events; gives its length.
    fn smooth(&self, state: &mut State, motor: f64, time_s: f64, h: f64) -> f64 {
        let (start, feet) = (self.pose(state), state.feet);
        let dry = self.dry(&start, &feet, motor, time_s, h);
        let slope = |pose: &Pose, time_s: f64| Pose {
            q: pose.v,
            v: self.accelerate(pose, &feet, Drive { motor, dry, time_s }).0,
        };
        let ahead = |k: &Pose, by: f64| Pose { q: start.q + k.q * by, v: start.v + k.v * by };
        let k1 = slope(&start, time_s);
        let k2 = slope(&ahead(&k1, h / 2.0), time_s + h / 2.0);
        let k3 = slope(&ahead(&k2, h / 2.0), time_s + h / 2.0);
        let k4 = slope(&ahead(&k3, h), time_s + h);
        let sum = Pose { q: k1.q + (k2.q + k3.q) * 2.0 + k4.q, v: k1.v + (k2.v + k3.v) * 2.0 + k4.v };
        self.put(&ahead(&sum, h / 6.0), state);
        h
    }

    /// The first event between two states, and the part of the step until then (heights are nearly straight lines).
    fn event(&self, before: &State, after: &State) -> Option<(Event, f64)> {
        let crossing = |a: f64, b: f64| (a > 0.0 && b <= 0.0).then(|| a / (a - b));
        let (from, to) = (self.pose(before), self.pose(after));
        let feet = &before.feet;
        if self.is_armed(&to, feet)
            && let Some(part) = crossing(self.height(&from, feet.stance, true), self.height(&to, feet.stance, true))
        {
            return Some((Event::Touchdown, part));
        }
        match feet.contact {
            Contact::Flight => crossing(self.height(&from, feet.stance, false), self.height(&to, feet.stance, false))
                .map(|part| (Event::Landing, part)),
            Contact::Sliding(direction) => {
                let speed = |pose: &Pose| direction * self.rows(pose, feet.stance, false).tangent.dot(&pose.v);
                crossing(speed(&from), speed(&to)).map(|part| (Event::Stop, part))
            }
            Contact::Held => None,
        }
    }

    fn happen(&self, event: Event, state: &mut State) {
        match event {
            Event::Touchdown => self.touch_down(state),
            Event::Landing => self.strike(state, false),
            Event::Stop => state.feet.contact = Contact::Held,
        }
    }

    fn height(&self, pose: &Pose, stance: usize, swing: bool) -> f64 {
        let (l, r) = (self.ground.length_m, self.ground.radius_m);
        let (a, b) = (libm::cos(pose.q[stance]), libm::cos(pose.q[1 - stance]));
        pose.q[3] + if swing { l * (a - b) + r * (b - 1.0) } else { r * (a - 1.0) }
    }

    fn stride(&self, pose: &Pose, stance: usize) -> f64 {
        self.ground.length_m * (libm::sin(pose.q[1 - stance]) - libm::sin(pose.q[stance]))
    }

    /// Late in the swing, descending; or when the recording says so.
    fn is_armed(&self, pose: &Pose, feet: &Feet) -> bool {
        if feet.told {
            return feet.due.is_some_and(|leg| leg != feet.stance);
        }
        let stride = self.stride(pose, feet.stance);
        let falls = self.rows(pose, feet.stance, true).normal.dot(&pose.v) < 0.0;
        falls && stride.abs() > APART_M && stride * feet.side <= 0.0
    }

    /// Impact of the swing foot, which stands from then on.
    pub(super) fn touch_down(&self, state: &mut State) {
        self.strike(state, true);
        let pose = self.pose(state);
        let (s, l) = (state.feet.stance, self.ground.length_m);
        let stride = self.stride(&pose, s);
        let (a, b) = (pose.q[s], pose.q[1 - s]);
        let (va, vb) = (pose.v[s], pose.v[1 - s]);
        let toe = &mut state.feet.toe;
        toe[0] += stride;
        toe[1] += l * (libm::cos(a) - libm::cos(b));
        toe[2] += l * (libm::cos(b) * vb - libm::cos(a) * va);
        toe[3] += l * (libm::sin(b) * vb - libm::sin(a) * va);
        state.feet.tip_m = state.feet.toe[0];
        state.feet.stance = 1 - s;
        state.feet.side = -stride.signum();
        state.feet.due = None;
    }

    /// The impulse at a foot.
    fn strike(&self, state: &mut State, swing: bool) {
        let (mut pose, s) = (self.pose(state), state.feet.stance);
        let Some(inverse) = self.free(&pose, s).0.try_inverse() else { return };
        let rows = self.rows(&pose, s, swing);
        let (vt, vn) = (rows.tangent.dot(&pose.v), rows.normal.dot(&pose.v));
        if self.ground.spring[0] > 0.0 {
            let angle = pose.q[if swing { 1 - s } else { s }];
            let across = rows.tangent * libm::cos(angle) + rows.normal * libm::sin(angle);
            let w = inverse * across;
            pose.v -= w * (across.dot(&pose.v) / across.dot(&w));
            self.put(&pose, state);
            return;
        }
        let rebound = if vn < 0.0 { -self.ground.restitution * vn } else { 0.0 };
        let bounces = rebound > SLOWEST_REBOUND;
        let wanted = Vector2::new(-vt, if bounces { rebound } else { 0.0 } - vn);
        let (wt, wn) = (inverse * rows.tangent, inverse * rows.normal);
        let gives =
            Matrix2::new(rows.tangent.dot(&wt), rows.tangent.dot(&wn), rows.normal.dot(&wt), rows.normal.dot(&wn));
        let mut impulse = gives.try_inverse().map_or_else(Vector2::zeros, |inverse| inverse * wanted);
        let mut contact = Contact::Held;
        let mu = self.ground.friction;
        if mu > 0.0 && impulse[0].abs() > mu * impulse[1] {
            let side = impulse[0].signum();
            impulse[1] = wanted[1] / (gives[(1, 1)] + mu * side * gives[(1, 0)]);
            impulse[0] = mu * side * impulse[1];
            contact = Contact::Sliding(-side);
        }
        pose.v += wt * impulse[0] + wn * impulse[1];
        state.feet.contact = if bounces { Contact::Flight } else { contact };
        self.put(&pose, state);
    }

    /// Does the cone still hold the foot?
    fn hold_or_slide(&self, state: &mut State, motor: f64, time_s: f64) {
        if state.feet.contact != Contact::Held || self.ground.friction <= 0.0 {
            return;
        }
        let pose = self.pose(state);
        let dry = self.dry(&pose, &state.feet, motor, time_s, WALK_STEP_S);
        let [along, normal] = self.accelerate(&pose, &state.feet, Drive { motor, dry, time_s }).1;
        if along.abs() > self.ground.friction * normal {
            state.feet.contact = Contact::Sliding(-along.signum());
        }
    }

    /// The standing foot as the legs turn: on the ground, rolling, or sunk in by the weight.
    pub(super) fn stand(&self, state: &mut State) {
        let mut pose = self.pose(state);
        let s = state.feet.stance;
        let (sin, cos, rate) = (libm::sin(pose.q[s]), libm::cos(pose.q[s]), pose.v[s]);
        let r = self.ground.radius_m;
        let weight = self.inner.iter().map(|b| b.mass).sum::<f64>() * self.gravity_m_s2 - self.ground.lifted_n;
        let sunk = if self.ground.spring[0] > 0.0 { weight * cos / self.ground.spring[0] } else { 0.0 };
        pose.q[2] = sunk * sin;
        pose.q[3] = r * (1.0 - cos) - sunk * cos;
        pose.v[2] = (r * (cos - 1.0) + sunk * cos) * rate;
        pose.v[3] = (r + sunk) * sin * rate;
        let apart = self.stride(&pose, s);
        let near = self.height(&pose, s, true) < 0.01 && apart.abs() > APART_M;
        state.feet =
            Feet { stance: s, told: state.feet.told, side: if near { apart.signum() } else { 0.0 }, ..Feet::default() };
        self.put(&pose, state);
    }
}

#[cfg(test)]
mod tests {
    use super::super::dice::Dice;
    use super::super::machine::Machine;
    use super::super::rig::{self, Kind};
    use super::*;

    /// The robot of the notes.
    fn machine() -> Machine {
        let mut rig = rig::draw(&mut Dice::new(1, 1), Kind::Walker);
        let set = [("c1", 0.1007), ("c2", 0.1434), ("c3", 0.000_596), ("c4", 0.1151), ("c5", 0.1264), ("c6", 0.0026)];
        rig.values.extend(set.map(|(name, value)| (name.to_owned(), value)));
        rig.machine(0.0)
    }

    /// Rates after the impact of model notes, section 10: inner stance before, labels before the swap.
    fn after(restitution: f64, friction: f64) -> Pair {
        let mut machine = machine();
        if let Some(ground) = machine.ground.as_mut() {
            (ground.restitution, ground.friction) = (restitution, friction);
        }
        let mut state = machine.start([-0.2, 0.2], [-1.0, -0.5]);
        machine.walker().expect("a walking machine").touch_down(&mut state);
        assert_eq!(state.feet.stance, 1);
        state.v()
    }

    #[test]
    fn impacts_are_those_of_the_notes() {
        let cases = [
            ((0.0, 0.0), [-0.795_653_429, -0.888_420_832]),
            ((0.2, 0.0), [-0.767_562_3, -0.873_808_9]),
            ((0.0, 0.1), [-0.875_650_2, -0.310_609_1]),
        ];
        for ((restitution, friction), expected) in cases {
            let found = after(restitution, friction);
            // The notes print seven digits of the last two.
            assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-7), "{restitution} {friction} {found:?}");
        }
    }
}
