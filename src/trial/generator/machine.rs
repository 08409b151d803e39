//! The machine whose physics is hidden: bodies, joints with dry friction and real drives, integrated finely.
//!
//! Different on purpose from `model`: dry friction by implicit time-stepping (Moreau 1988) instead of stick and slip modes
//! with located events, pre-sliding as LuGre bristles (Canudas de Wit 1995), backlash as a stiff spring beyond a free gap,
//! pushes with a width; 10 kHz, 20 kHz where a drive has a spring. LuGre for all friction was tried and dropped: bristles
//! stiff enough to be unseen ring, and either creep under load or, damped, kick at every reversal (0.4 to 2 noise
//! deviations against the model on healthy machines). RT: no.

use super::chain::{Body, Equations, Pair, equations, solve};
use super::walker::{Feet, Ground, WALK_STEP_S, Walker};

/// Step of a machine without springs in its drives, s.
const STEP_S: f64 = 1e-4;
/// Step with them.
const FINE_STEP_S: f64 = 5e-5;
/// Bristles are damped only while they creep, rad/s or m/s: damped at every rate they would kick at reversals.
const CREEP: f64 = 0.2;
/// Sweeps over two joints that hold each other; the third changes nothing beyond 1e-3 of a torque.
const SWEEPS: usize = 3;

/// How the motor turns the joint.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Drive {
    /// Rotor inertia at the joint; 0: part of the bodies.
    pub rotor: f64,
    /// Spring between rotor and joint; 0: rigid.
    pub stiffness: f64,
    /// Damping of that spring.
    pub damping: f64,
    /// Free play, all of it.
    pub gap: f64,
}

/// One driven joint.
#[derive(Debug, Clone, Default)]
pub(super) struct Joint {
    /// Its rate is `along · v`.
    pub along: Pair,
    /// Torque per unit of the column.
    pub gain: f64,
    /// Applied torque stays within; 0: no limit.
    pub limit: f64,
    /// First-order lag, s.
    pub lag_s: f64,
    /// Pure delay of the command, s.
    pub delay_s: f64,
    /// Motor and gear.
    pub drive: Drive,
    /// Per rate.
    pub viscous: f64,
    /// Level of sliding friction.
    pub coulomb: f64,
    /// Part of it by direction.
    pub difference: f64,
    /// Its change, fraction per second.
    pub drift: f64,
    /// More at rest.
    pub extra: f64,
    /// Over this rate the extra fades.
    pub fade: f64,
    /// More per carried torque.
    pub load: f64,
    /// Per rate squared.
    pub quadratic: f64,
    /// Bristle stiffness; 0: sticks without giving.
    pub bristle: f64,
    /// Constant torque.
    pub offset: f64,
    /// Amplitude, order, phase.
    pub ripple: [f64; 3],
    /// Spring to the ground: stiffness, rest.
    pub spring: Pair,
    /// Impulse, start, width.
    pub push: [f64; 3],
    /// A dent in the landscape: depth, centre, width (a magnet; no effect of the library).
    pub detent: [f64; 3],
}

/// A part of a link on a spring of its own.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Mode {
    /// The link's rate is `along · v`.
    pub along: Pair,
    /// What hangs on the spring; 0: nothing.
    pub inertia: f64,
    /// That spring.
    pub stiffness: f64,
    /// Its damping.
    pub damping: f64,
}

/// Everything that acts.
#[derive(Debug, Clone, Default)]
pub(super) struct Machine {
    /// Bodies.
    pub bodies: Vec<Body>,
    /// Number of coordinates.
    pub size: usize,
    /// Coordinates that are held at 0.
    pub held: [bool; 2],
    /// Gravity.
    pub gravity_m_s2: f64,
    /// Joints, as many as actuators.
    pub joints: Vec<Joint>,
    /// Springs of the set-up: coordinate, stiffness, rest.
    pub setup_springs: Vec<(usize, f64, f64)>,
    /// Flexible part of a link.
    pub mode: Mode,
    /// Upward force at the end of coordinate 0's or 1's leg: coordinate, force times lever, Nm.
    pub lifted: Option<(usize, f64)>,
    /// The machine walks.
    pub ground: Option<Ground>,
    /// Steps are longer by this factor where only an estimate is wanted; 0 as 1.
    pub coarse: f64,
    /// Shaken ground: acceleration amplitude, frequency in Hz, phase (no effect of the library).
    pub shaken: [f64; 3],
    /// More of everything from a time on: fraction, time (a payload; no effect of the library).
    pub payload: Pair,
}

/// Where the machine is.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct State {
    /// Coordinates, their rates, rotors, their rates: four pairs; angle and rate of a flexible part.
    pub y: [f64; 10],
    /// Bristle deflections.
    pub z: Pair,
    /// Torques behind the lag.
    pub torque: Pair,
    /// Of a walking machine.
    pub feet: Feet,
}

/// What stays as it is during one step.
struct Frozen {
    z: Pair,
    torque: Pair,
    dry: Pair,
}

impl State {
    /// Coordinates.
    pub(super) fn q(&self) -> Pair {
        [self.y[0], self.y[1]]
    }

    /// Rates.
    pub(super) fn v(&self) -> Pair {
        [self.y[2], self.y[3]]
    }
}

fn dot(a: Pair, b: Pair) -> f64 {
    a[0] * b[0] + a[1] * b[1]
}

impl Joint {
    /// Sliding friction at a rate, under a carried torque, at a time.
    pub(super) fn level(&self, rate: f64, carried: f64, time_s: f64) -> f64 {
        let fading = if self.fade > 0.0 { libm::exp(-(rate / self.fade) * (rate / self.fade)) } else { 0.0 };
        let sided = self.coulomb * (1.0 + self.drift * time_s) + self.difference * rate.signum();
        (sided + self.extra * fading + self.load * carried.abs()).max(1e-12)
    }

    /// Has dry friction that does not give.
    pub(super) fn sticks(&self) -> bool {
        self.bristle <= 0.0 && self.coulomb + self.extra + self.load + self.difference.abs() > 0.0
    }

    /// Torque through the drive onto the joint.
    fn through(&self, rotor: Pair, angle: f64, rate: f64, motor: f64) -> f64 {
        if self.drive.stiffness <= 0.0 {
            return motor;
        }
        let twist = rotor[0] - angle;
        let beyond = twist - twist.clamp(-self.drive.gap / 2.0, self.drive.gap / 2.0);
        let engaged = self.drive.gap <= 0.0 || beyond != 0.0;
        let damping = if engaged { self.drive.damping * (rotor[1] - rate) } else { 0.0 };
        self.drive.stiffness * beyond + damping
    }

    /// Everything that depends on angle and time only.
    pub(super) fn landscape(&self, angle: f64, time_s: f64) -> f64 {
        let [amplitude, order, phase] = self.ripple;
        let [depth, centre, width] = self.detent;
        let [impulse, when, long] = self.push;
        let inside = if width > 0.0 { (angle - centre) / width } else { 0.0 };
        let pushing = impulse != 0.0 && (when..when + long).contains(&time_s);
        let half_sine = std::f64::consts::FRAC_PI_2 / long.max(1e-9)
            * libm::sin(std::f64::consts::PI * (time_s - when) / long.max(1e-9));
        self.offset + amplitude * libm::sin(order * angle + phase)
            - self.spring[0] * (angle - self.spring[1])
            - depth * inside * libm::exp(-inside * inside)
            + if pushing { impulse * half_sine } else { 0.0 }
    }
}

impl Machine {
    /// Step that resolves this machine, s.
    pub(super) fn step_s(&self) -> f64 {
        let finest = if self.ground.is_some() {
            WALK_STEP_S
        } else if self.mode.inertia > 0.0 || self.joints.iter().any(|j| j.drive.stiffness > 0.0) {
            FINE_STEP_S
        } else {
            STEP_S
        };
        finest * self.coarse.max(1.0)
    }

    /// At rest or moving, rotors with their joints.
    pub(super) fn start(&self, q: Pair, v: Pair) -> State {
        let mut state = State::default();
        state.y[..4].copy_from_slice(&[q[0], q[1], v[0], v[1]]);
        (state.y[8], state.y[9]) = (dot(self.mode.along, q), dot(self.mode.along, v));
        for (i, joint) in self.joints.iter().enumerate() {
            state.y[4 + i] = dot(joint.along, q);
            state.y[6 + i] = dot(joint.along, v);
        }
        state
    }

    /// The walking part, if it walks.
    pub(super) fn walker(&self) -> Option<Walker<'_>> {
        let (ground, hip) = (self.ground.as_ref()?, self.joints.first()?);
        Some(Walker { inner: &self.bodies, ground, hip, gravity_m_s2: self.gravity_m_s2 })
    }

    fn equations_at(&self, y: &[f64; 10], time_s: f64) -> Equations {
        let [accel, hz, phase] = self.shaken;
        let base = if accel == 0.0 { 0.0 } else { accel * libm::sin(std::f64::consts::TAU * hz * time_s + phase) };
        let mut sum = equations(&self.bodies, [y[0], y[1]], [y[2], y[3]], self.gravity_m_s2, base);
        let more = if time_s >= self.payload[1] { 1.0 + self.payload[0] } else { 1.0 };
        sum.mass = sum.mass.map(|row| row.map(|m| m * more));
        sum.bias = sum.bias.map(|b| b * more);
        let rigid = self.joints.iter().filter(|j| j.drive.stiffness <= 0.0).map(|j| (j.drive.rotor, j.along));
        for (inertia, along) in rigid.chain([(-self.mode.inertia, self.mode.along)]) {
            for i in 0..2 {
                for k in 0..2 {
                    sum.mass[i][k] += inertia * along[i] * along[k];
                }
            }
        }
        if let Some((i, moment)) = self.lifted {
            sum.bias[i] += moment * libm::sin(y[i]);
        }
        sum
    }

    /// One step under motor torques that stay constant: half a step of the bristles, a Runge-Kutta step of the rest with
    /// bristles and dry friction frozen, half a step of the bristles.
    pub(super) fn step(&self, state: &mut State, motor: Pair, time_s: f64, h: f64) {
        if self.walker().is_none() {
            self.relax(state, time_s, h / 2.0);
        }
        let torque = self.behind_lag(state, motor, h);
        if let Some(walker) = self.walker() {
            return walker.step(state, torque[0], time_s, h);
        }
        let frozen = Frozen { z: state.z, torque, dry: self.dry(state, torque, time_s, h) };
        state.y = runge_kutta(state.y, time_s, h, |y, t| self.slope(y, &frozen, t));
        self.relax(state, time_s + h, h / 2.0);
    }

    /// The mean over one step of what leaves the lags, which go on to its end.
    fn behind_lag(&self, state: &mut State, motor: Pair, h: f64) -> Pair {
        let mut mean = motor;
        for (i, joint) in self.joints.iter().enumerate() {
            let keep = if joint.lag_s > 0.0 { libm::exp(-h / joint.lag_s) } else { 0.0 };
            let behind = state.torque[i] - motor[i];
            mean[i] += behind * (1.0 - keep) * joint.lag_s / h;
            state.torque[i] = motor[i] + keep * behind;
        }
        mean
    }

    /// Dry friction over one step: what brings the joint to rest at the end of it, if the level allows; else the level.
    fn dry(&self, state: &State, torque: Pair, time_s: f64, h: f64) -> Pair {
        let mut dry = [0.0; 2];
        if !self.joints.iter().any(Joint::sticks) {
            return dry;
        }
        let free = self.slope(&state.y, &Frozen { z: state.z, torque, dry }, time_s);
        let sum = self.equations_at(&state.y, time_s);
        let gives = |joint: &Joint| solve(sum.mass, joint.along, self.all_held());
        for _ in 0..SWEEPS {
            for (i, joint) in self.joints.iter().enumerate().filter(|(_, joint)| joint.sticks()) {
                let mut acceleration = [free[2], free[3]];
                for (k, other) in self.joints.iter().enumerate().filter(|(k, _)| *k != i) {
                    let moved = gives(other);
                    acceleration = [acceleration[0] - moved[0] * dry[k], acceleration[1] - moved[1] * dry[k]];
                }
                let rate = dot(joint.along, state.v());
                let ahead = rate + h * dot(joint.along, acceleration);
                let stopping = ahead / (h * dot(joint.along, gives(joint)));
                let carried = 0.5 * (torque[i] + sum.bias[i]);
                let level = joint.level(if rate == 0.0 { ahead } else { rate }, carried, time_s);
                dry[i] = stopping.clamp(-level, level);
            }
        }
        dry
    }

    fn all_held(&self) -> [bool; 2] {
        if self.size == 1 { [self.held[0], true] } else { self.held }
    }

    /// `ż = v - σ0 |v| z / g(v)` for constant v: exact.
    fn relax(&self, state: &mut State, time_s: f64, h: f64) {
        let carries = self.joints.iter().any(|j| j.load > 0.0 && j.bristle > 0.0);
        let held_up = if carries { self.equations_at(&state.y, time_s).bias } else { [0.0; 2] };
        for (i, joint) in self.joints.iter().enumerate().filter(|(_, j)| j.bristle > 0.0) {
            let rate = dot(joint.along, state.v());
            let level = joint.level(rate, 0.5 * (state.torque[i] + held_up[i]), time_s);
            let stiffness = joint.bristle;
            let settled = level / stiffness * rate.signum();
            let keep = libm::exp(-stiffness * rate.abs() / level * h);
            state.z[i] = settled + keep * (state.z[i] - settled);
        }
    }

    fn friction(&self, i: usize, rate: f64, frozen: &Frozen, (mass, time_s): (f64, f64)) -> f64 {
        let joint = &self.joints[i];
        let sliding = joint.viscous * rate + joint.quadratic * rate * rate.abs() + frozen.dry[i];
        if joint.bristle <= 0.0 {
            return sliding;
        }
        let (stiffness, z) = (joint.bristle, frozen.z[i]);
        let level = joint.level(rate, 0.0, time_s).max(stiffness * z.abs());
        let bending = rate - stiffness * rate.abs() * z / level;
        let damping = 0.6 * libm::sqrt(stiffness * mass) * libm::exp(-(rate / CREEP) * (rate / CREEP));
        sliding + stiffness * z + damping * bending
    }

    fn slope(&self, y: &[f64; 10], frozen: &Frozen, time_s: f64) -> [f64; 10] {
        let sum = self.equations_at(y, time_s);
        let (q, v) = ([y[0], y[1]], [y[2], y[3]]);
        let mut force = [-sum.bias[0], -sum.bias[1]];
        let mut rotor_rate = [0.0; 2];
        for (i, joint) in self.joints.iter().enumerate() {
            let (angle, rate) = (dot(joint.along, q), dot(joint.along, v));
            let passed = joint.through([y[4 + i], y[6 + i]], angle, rate, frozen.torque[i]);
            let onto = passed + joint.landscape(angle, time_s)
                - self.friction(i, rate, frozen, (turned_mass(joint.along, &sum), time_s));
            force[0] += joint.along[0] * onto;
            force[1] += joint.along[1] * onto;
            if joint.drive.stiffness > 0.0 {
                rotor_rate[i] = (frozen.torque[i] - passed) / joint.drive.rotor;
            }
        }
        for (i, stiffness, rest) in &self.setup_springs {
            force[*i] -= stiffness * (q[*i] - rest);
        }
        let mut bent = 0.0;
        if self.mode.inertia > 0.0 {
            let Mode { along, inertia, stiffness, damping } = self.mode;
            let pull = stiffness * (y[8] - dot(along, q)) + damping * (y[9] - dot(along, v));
            force = [force[0] + along[0] * pull, force[1] + along[1] * pull];
            bent = -pull / inertia;
        }
        let a = solve(sum.mass, force, self.all_held());
        [v[0], v[1], a[0], a[1], y[6], y[7], rotor_rate[0], rotor_rate[1], y[9], bent]
    }
}

/// Inertia that a joint turns against, about: the lighter side.
fn turned_mass(along: Pair, sum: &Equations) -> f64 {
    (0..2).filter(|i| along[*i] != 0.0).map(|i| sum.mass[i][i]).fold(f64::INFINITY, f64::min)
}

fn runge_kutta(y: [f64; 10], t: f64, h: f64, slope: impl Fn(&[f64; 10], f64) -> [f64; 10]) -> [f64; 10] {
    let ahead = |k: &[f64; 10], by: f64| -> [f64; 10] { std::array::from_fn(|i| y[i] + by * k[i]) };
    let k1 = slope(&y, t);
    let k2 = slope(&ahead(&k1, h / 2.0), t + h / 2.0);
    let k3 = slope(&ahead(&k2, h / 2.0), t + h / 2.0);
    let k4 = slope(&ahead(&k3, h), t + h);
    std::array::from_fn(|i| y[i] + h / 6.0 * (k1[i] + 2.0 * k2[i] + 2.0 * k3[i] + k4[i]))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pendulum() -> Machine {
        let body = Body { mass: 1.0, inertia: 0.002, arms: vec![(-0.1, [1.0, 0.0])], turn: [1.0, 0.0], slides: false };
        let joint = Joint { along: [1.0, 0.0], gain: 1.0, ..Joint::default() };
        Machine { bodies: vec![body], size: 1, gravity_m_s2: 9.81, joints: vec![joint], ..Machine::default() }
    }

    fn run(machine: &Machine, mut state: State, motor: f64, seconds: f64) -> State {
        let h = machine.step_s();
        let mut t = 0.0;
        while t < seconds {
            machine.step(&mut state, [motor, 0.0], t, h);
            t += h;
        }
        state
    }

    #[test]
    fn frictionless_pendulum_keeps_its_energy() {
        let machine = pendulum();
        // J = m lc² + I = 0.012, m g lc = 0.981.
        let energy = |s: &State| 0.006 * s.y[2] * s.y[2] - 0.981 * libm::cos(s.y[0]);
        let start = machine.start([1.0, 0.0], [0.0, 0.0]);
        let end = run(&machine, start, 0.0, 3.0);
        assert!((energy(&end) - energy(&start)).abs() < 1e-8);
    }

    #[test]
    fn stuck_joint_stays() {
        let mut machine = pendulum();
        machine.joints[0].coulomb = 0.2;
        let end = run(&machine, machine.start([0.0, 0.0], [0.0, 0.0]), 0.15, 2.0);
        assert!(end.y[0].abs() < 1e-7, "{}", end.y[0]);
    }

    #[test]
    fn sliding_friction_takes_its_level_times_the_way() {
        let mut machine = pendulum();
        machine.gravity_m_s2 = 0.0;
        machine.joints[0].coulomb = 0.012;
        // 0.012 Nm on 0.012 kg m²: 1 rad/s² down from 2 rad/s.
        let end = run(&machine, machine.start([0.0, 0.0], [2.0, 0.0]), 0.0, 1.0);
        assert!((end.y[2] - 1.0).abs() < 1e-3, "{}", end.y[2]);
    }

    #[test]
    fn dry_friction_takes_the_same_step_off_every_half_swing() {
        let mut machine = pendulum();
        machine.gravity_m_s2 = 0.0;
        machine.joints[0].spring = [0.5, 0.0];
        machine.joints[0].coulomb = 0.02;
        // J = 0.012: half a period lasts pi sqrt(J / k) = 0.4867 s and takes 2 F / k = 0.08 rad off.
        let half_s = std::f64::consts::PI * libm::sqrt(0.012 / 0.5);
        for (halves, expected) in [(1.0, -0.92), (2.0, 0.84), (4.0, 0.68)] {
            let end = run(&machine, machine.start([1.0, 0.0], [0.0, 0.0]), 0.0, halves * half_s);
            // 2e-4 rad: a fifth of the noise of a recording.
            assert!((end.y[0] - expected).abs() < 2e-4, "{halves} {}", end.y[0]);
        }
    }

    #[test]
    fn joint_with_play_moves_freely_within_it() {
        let mut machine = pendulum();
        machine.gravity_m_s2 = 0.0;
        machine.joints[0].drive = Drive { rotor: 0.001, stiffness: 500.0, damping: 0.05, gap: 0.2 };
        let mut state = machine.start([0.0, 0.0], [0.0, 0.0]);
        state.y[2] = 0.05;
        let end = run(&machine, state, 0.0, 1.0);
        assert!((end.y[0] - 0.05).abs() < 1e-5, "{}", end.y[0]);
    }

    #[test]
    fn impulse_of_a_push_becomes_momentum() {
        let mut machine = pendulum();
        machine.gravity_m_s2 = 0.0;
        machine.joints[0].push = [0.012, 0.2, 0.03];
        let end = run(&machine, machine.start([0.0, 0.0], [0.0, 0.0]), 0.0, 0.5);
        assert!((end.y[2] - 1.0).abs() < 1e-3, "{}", end.y[2]);
    }
}
