//! Where a run starts: the numbers of an initial state, and the step that suits it. RT: before arming only.

use super::motion::{FlowOf, Work};
use super::{LONGEST_STEP_S, Machine, Play};
use crate::base::scalar::Scalar;
use crate::model::effect::friction::{Axis, Load};
use crate::model::mechanism::{Body, MAX, Mechanism};

/// One number of an initial state.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Inner {
    /// Generalised coordinate of the mechanism.
    Coordinate(usize),
    /// Its rate.
    Rate(usize),
    /// Twist of a rotor against its link.
    Twist(usize),
    /// Rate of that twist (elastic joints only; play starts at rest against the link).
    TwistRate(usize),
    /// Deflection of a structural mode.
    Deflection(usize),
    /// Its rate.
    DeflectionRate(usize),
    /// A bristle.
    Bristle(usize),
    /// What the lag of a sensor is behind its quasi-steady value, per second of time constant.
    Lag(usize),
}

/// Whether an axis has a bristle.
pub(super) trait Bristled {
    fn is_bristled(&self) -> bool;
}

impl<S: Scalar> Bristled for Axis<S> {
    fn is_bristled(&self) -> bool {
        self.dry.as_ref().is_some_and(|d| d.bristle.is_some())
    }
}

impl<S: Scalar> Machine<S> {
    /// What the numbers of [`Self::reset`] are, in order.
    #[must_use]
    pub fn initial_layout(&self) -> Vec<Inner> {
        let moving = self.plant.n_body.min(2);
        let mut layout: Vec<Inner> = (0..moving).map(Inner::Coordinate).collect();
        layout.extend((0..moving).map(Inner::Rate));
        for (i, rotor) in self.plant.rotors.iter().enumerate() {
            if self.plant.plays[i] != Play::Rigid {
                layout.push(Inner::Twist(i));
            }
            if rotor.spring.is_some() {
                layout.push(Inner::TwistRate(i));
            }
        }
        for i in 0..self.plant.structures.len() {
            layout.extend([Inner::Deflection(i), Inner::DeflectionRate(i)]);
        }
        layout.extend((0..self.plant.bristles).map(Inner::Bristle));
        let lags = self.pickups.iter().enumerate().filter(|(_, p)| p.lag.is_some());
        layout.extend(lags.map(|(i, _)| Inner::Lag(i)));
        layout
    }

    /// Starts at `t_s` from `initial` (see [`Self::initial_layout`]); numbers left out are zero.
    pub fn reset(&mut self, t_s: f64, initial: &[S]) {
        self.now = S::constant(t_s);
        self.flow_of = FlowOf::Nothing;
        self.y = Default::default();
        let mut lags = vec![S::zero(); self.pickups.len()];
        let layout = self.initial_layout();
        let (mut twists, mut twist_rates) = ([S::zero(); MAX], [S::zero(); MAX]);
        for (what, x) in layout.iter().zip(initial.iter().copied()) {
            match *what {
                Inner::Coordinate(i) => self.y.q[i] = x,
                Inner::Rate(i) => self.y.v[i] = x,
                Inner::Twist(i) => twists[i] = x,
                Inner::TwistRate(i) => twist_rates[i] = x,
                Inner::Deflection(i) => self.y.q[self.plant.structures[i].index] = x,
                Inner::DeflectionRate(i) => self.y.v[self.plant.structures[i].index] = x,
                Inner::Bristle(i) => self.y.z[i] = x,
                Inner::Lag(i) => lags[i] = x,
            }
        }
        for i in 0..self.plant.rotors.len() {
            self.start_rotor(i, twists[i], twist_rates[i]);
        }
        self.start_feet();
        self.regrip();
        self.start_pickups(&lags);
        for push in &mut self.pushes {
            push.done = push.time.value() < t_s;
        }
        self.history.clear();
        self.remember();
        self.step_s = self.suitable_step();
    }

    /// Where the machine is, as the numbers that [`Self::reset`] would start it from.
    #[must_use]
    pub fn state(&self) -> Vec<S> {
        let of = |what: &Inner| match *what {
            Inner::Coordinate(i) => self.y.q[i],
            Inner::Rate(i) => self.y.v[i],
            Inner::Twist(i) => {
                let rotor = &self.plant.rotors[i];
                self.y.q[rotor.index] - rotor.link.of(&self.y.q)
            }
            Inner::TwistRate(i) => {
                let rotor = &self.plant.rotors[i];
                self.y.v[rotor.index] - rotor.link.of(&self.y.v)
            }
            Inner::Deflection(i) => self.y.q[self.plant.structures[i].index],
            Inner::DeflectionRate(i) => self.y.v[self.plant.structures[i].index],
            Inner::Bristle(i) => self.y.z[i],
            Inner::Lag(i) => self.lag_behind(i),
        };
        self.initial_layout().iter().map(of).collect()
    }

    /// What the lag of pickup `i` is behind its quasi-steady value, per second of time constant.
    fn lag_behind(&self, i: usize) -> S {
        let pickup = &self.pickups[i];
        let slope = if pickup.is_rate { S::zero() } else { pickup.row.of(&self.y.v) };
        let behind = |lag: S| slope - (pickup.truth(&self.y.q, &self.y.v) - self.lagged[i]) / lag;
        pickup.lag.filter(|lag| lag.value() > 0.0).map_or(S::zero(), behind)
    }

    fn start_rotor(&mut self, i: usize, twist: S, twist_rate: S) {
        let rotor = &self.plant.rotors[i];
        let half = rotor.gap * 0.5;
        let (mut twist, mut play) = (twist, self.plant.plays[i]);
        if rotor.spring.is_none() && play != Play::Rigid {
            play = Play::Free;
            if twist.value().abs() >= half.value() {
                play = Play::Closed(if twist.value() < 0.0 { -1.0 } else { 1.0 });
                twist = half * if twist.value() < 0.0 { -1.0 } else { 1.0 };
            }
        }
        let index = rotor.index;
        self.y.q[index] = rotor.link.of(&self.y.q) + twist;
        self.y.v[index] = rotor.link.of(&self.y.v) + twist_rate;
        self.plant.plays[i] = play;
    }

    /// Lags start as if the present rate had lasted for ever, plus what the start says.
    fn start_pickups(&mut self, lags: &[S]) {
        for (i, pickup) in self.pickups.iter().enumerate() {
            let truth = pickup.truth(&self.y.q, &self.y.v);
            self.before[i] = truth;
            let slope = if pickup.is_rate { S::zero() } else { pickup.row.of(&self.y.v) };
            self.lagged[i] = pickup.lag.map_or(truth, |lag| truth - lag * (slope - lags[i]));
        }
    }

    /// The step for RK4: [`LONGEST_STEP_S`], or a fraction of the fastest rates of the machine linearised here.
    fn suitable_step(&mut self) -> f64 {
        let n = self.plant.n;
        // However fast a bristle yields, it asks for no shorter steps.
        self.plant.fastest_yield_1_s = STABLE_DECAY / LONGEST_STEP_S;
        let mut work = Work::default();
        let mut y = self.y.clone();
        self.plant.flow(&y, self.now, &mut work);
        let base = work.a;
        // Row sums bound the largest eigenvalue of M⁻¹K and M⁻¹D.
        let (mut stiff, mut damped) = ([0.0_f64; MAX], [0.0_f64; MAX]);
        for j in 0..n {
            for (of_rates, sums) in [(false, &mut stiff), (true, &mut damped)] {
                let x = if of_rates { &mut y.v[j] } else { &mut y.q[j] };
                *x += S::constant(NUDGE);
                self.plant.flow(&y, self.now, &mut work);
                let x = if of_rates { &mut y.v[j] } else { &mut y.q[j] };
                *x -= S::constant(NUDGE);
                for i in 0..n {
                    sums[i] += (work.a[i] - base[i]).value().abs() / NUDGE;
                }
            }
        }
        let top = |sums: &[f64; MAX]| sums.iter().copied().fold(0.0, f64::max);
        let frequency = libm::sqrt(top(&stiff)).max(self.bristle_frequency());
        let decay = top(&damped) + self.smooth_sign_decay();
        // Coarse steps are meant to be coarse; they need but be stable.
        let (phase, part, longest) = match self.euler_step_s {
            Some(step_s) => (STABLE_PHASE, STABLE_DECAY, step_s),
            None => (PHASE_PER_STEP, DECAY_PER_STEP, LONGEST_STEP_S),
        };
        let resolved = |rate: f64, exact: f64, stable: f64| (exact / rate).max((stable / rate).min(FINE_STEP_S));
        let step = resolved(frequency, phase, STABLE_PHASE).min(resolved(decay, part, STABLE_DECAY));
        step.max(SHORTEST_STEP_S).min(longest)
    }

    /// Near zero a smooth sign of friction is a damper, and so is a soft constraint, wherever the motion starts: the fastest decay, 1/s.
    fn smooth_sign_decay(&self) -> f64 {
        let of_axis = |axis: &Axis<S>| {
            let dry = axis.dry.as_ref()?;
            let level = dry.level(S::zero(), self.now, Load::default()).value();
            let smooth = |rate: f64| level / (rate * self.plant.body.link_inertia(axis.joint).value());
            dry.smooth_rate.map(smooth).or(dry.soft_1_s)
        };
        self.plant.axes.iter().filter_map(of_axis).fold(0.0, f64::max)
    }

    /// Into how many parts a step of `h` s falls so that each bristle that bends over is followed. `work` holds the present
    /// accelerations and friction levels.
    pub(super) fn parts_for_bristles(&self, h: f64) -> f64 {
        let mut most = 1.0_f64;
        let bristled = self.plant.axes.iter().enumerate().filter(|(_, a)| a.is_bristled());
        for ((i, axis), z) in bristled.zip(&self.y.z) {
            let Some(stiffness) = axis.dry.as_ref().and_then(|d| d.bristle) else { continue };
            let (rate, change) = (axis.row.of(&self.y.v).value(), axis.row.of(&self.work.a).value() * h);
            let bent = self.work.level[i].value() / stiffness.value();
            let turns = rate * (rate + change) <= 0.0;
            if bent <= 0.0 {
                continue;
            }
            if turns || (bent * rate.signum() - z.value()).abs() > SETTLED * bent {
                let travel = rate.abs().max((rate + change).abs()) * h;
                most = most.max(travel * f64::from(self.refine) / (bent * PART_OF_BEND));
            }
        }
        most.ceil().clamp(1.0, MOST_PARTS)
    }

    /// Fastest bristle against the inertia it holds, rad/s.
    fn bristle_frequency(&self) -> f64 {
        let bristled = self.plant.axes.iter().filter_map(|a| a.dry.as_ref()?.bristle.map(|k| (a.joint, k.value())));
        bristled.map(|(j, k)| libm::sqrt(k / self.plant.body.link_inertia(j).value())).fold(0.0, f64::max)
    }
}

/// Difference for the linearisation, rad.
const NUDGE: f64 = 1e-6;
/// rad of the fastest oscillation per step: it errs by 1.3e-5 a rad (0.2⁴/120), while the readings, which see little of it,
/// err by less than 1e-3 of the noise in all recordings of other simulators (`identify::rollout::tests`).
const PHASE_PER_STEP: f64 = 0.2;
/// A bristle nearer to its end than this part of it is bent over.
const SETTLED: f64 = 0.01;
/// Distance per step in parts of a bristle's bend, and the most parts of a step that this asks for.
const PART_OF_BEND: f64 = 0.25;
const MOST_PARTS: f64 = 8.0;
/// Decay per step of the fastest damping; RK4 is stable up to 2.7.
const DECAY_PER_STEP: f64 = 0.4;
/// Rates that this step, s, does not resolve are beyond what recordings show (200 Hz and more); there it is enough that
/// RK4 damps them as it should. A joint stiff as a rod otherwise costs fifty times a rigid one.
const FINE_STEP_S: f64 = 4e-4;
/// Phase and decay per step at which RK4 is safely stable (its limits are 2.8).
const STABLE_PHASE: f64 = 1.0;
pub(super) const STABLE_DECAY: f64 = 1.5;
/// A stiffer machine is not followed below this step, s: it diverges and says so.
const SHORTEST_STEP_S: f64 = 1e-5;

impl<S: Scalar> Machine<S> {
    /// What sensor `index` measures, as factors of the first `n` generalised coordinates (motor and link taken as one).
    #[must_use]
    pub fn sensor_row(&self, index: usize, n: usize) -> Vec<f64> {
        let mut row = vec![0.0; n];
        for &(i, factor) in self.pickups[index].row.terms() {
            let rotor = self.plant.rotors.iter().find(|r| r.index == i);
            let terms = rotor.map_or_else(|| vec![(i, 1.0)], |r| r.link.terms().to_vec());
            for (k, f) in terms.into_iter().filter(|(k, _)| *k < n) {
                row[k] += factor * f;
            }
        }
        row
    }

    /// The truth behind a reading of sensor `index`, as far as scale and bias go.
    #[must_use]
    pub fn undo_offsets(&self, index: usize, reading: f64) -> f64 {
        let pickup = &self.pickups[index];
        let scale = pickup.scale.value();
        (reading - pickup.bias.value()) / if scale.abs() > 1e-6 { scale } else { 1.0 }
    }

    /// Puts the robot on leg `leg` (0 inner, 1 outer) before a run; set-ups with a fixed stance keep theirs.
    pub fn set_stance(&mut self, leg: usize) {
        self.flow_of = FlowOf::Nothing;
        if let (Body::Legs(legs), true) = (&mut self.plant.body, self.plant.walks) {
            legs.set_stance(leg);
        }
    }
}
