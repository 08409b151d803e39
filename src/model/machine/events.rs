//! Where a step must end early, exactly, and what happens there. RT: yes, no allocation.

use super::hold::Holder;
use super::motion::FlowOf;
use super::{Machine, MachineError, Play};
use crate::base::scalar::Scalar;
use crate::model::effect::friction::Grip;

/// What may end a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Guard {
    /// A sliding axis comes to rest.
    Stop(usize),
    /// A stuck axis is pulled beyond its friction.
    Release(usize),
    /// A rotor meets its stop.
    Meet(usize),
    /// A rotor is pulled off its stop.
    Part(usize),
    /// The swing foot reaches the ground.
    Touchdown,
    /// A stance foot in flight comes back.
    Land,
    /// A held foot is pulled out of its friction cone.
    SlideStart,
    /// A sliding foot comes to rest.
    SlideStop,
    /// The stance foot is drawn off the ground.
    LiftOff,
}

/// Events in one substep; beyond that (chatter at a point of rest) the step is taken as it is.
const MOST_EVENTS: usize = 24;
/// Iterations of the search for an event; some ten are usual, bisection alone would need 40.
const MOST_ITERATIONS: usize = 60;
/// An event is located to this, s: far below what any sample sees, above the rounding of a step.
const TIME_TOLERANCE_S: f64 = 1e-13;
/// Changes of mode at one instant: each axis and rotor a few times.
const MOST_CHANGES: usize = 8;

impl<S: Scalar> Machine<S> {
    /// One step of length `h` with all events in it.
    pub(super) fn substep(&mut self, h: S) -> Result<(), MachineError> {
        let mut left = h;
        for _ in 0..MOST_EVENTS {
            self.step(left);
            if self.first_violated(left).is_none() {
                return self.finish(left);
            }
            let (fraction, guard) = self.locate(left);
            left -= self.go_to_event(left * fraction, guard);
            self.happen(guard);
            if left.value() <= 0.0 {
                self.shift(left);
                return Ok(());
            }
        }
        self.step(left);
        self.finish(left)
    }

    fn finish(&mut self, h: S) -> Result<(), MachineError> {
        if !self.end.is_bounded(self.plant.n) {
            return Err(MachineError::Diverged(self.now.value()));
        }
        self.accept(h);
        Ok(())
    }

    /// The guard that the state in `end` breaks most, if any.
    fn first_violated(&mut self, h: S) -> Option<Guard> {
        let mut worst: Option<(Guard, f64)> = None;
        let mut consider = |guard: Guard, value: f64| {
            if value < 0.0 && worst.is_none_or(|(_, w)| value < w) {
                worst = Some((guard, value));
            }
        };
        let mut needs_forces = false;
        for (i, axis) in self.plant.axes.iter().enumerate() {
            match (&axis.dry, self.plant.grips[i]) {
                (Some(dry), grip) if dry.sticks() => match grip {
                    Grip::Stuck => needs_forces = true,
                    grip => consider(Guard::Stop(i), grip.direction() * axis.row.value_of(&self.end.v)),
                },
                _ => {}
            }
        }
        for (i, rotor) in self.plant.rotors.iter().enumerate() {
            match self.plant.plays[i] {
                Play::Free if rotor.spring.is_none() => {
                    consider(Guard::Meet(i), rotor.gap.value() * 0.5 - rotor.twist_value(&self.end.q).abs());
                }
                Play::Closed(_) => needs_forces = true,
                _ => {}
            }
        }
        for (guard, value) in self.foot_guards() {
            if let Some(value) = value {
                consider(guard, value);
            }
        }
        needs_forces |= self.plant.walks && (self.plant.ground.friction.is_some() || self.plant.ground.lift_off);
        if needs_forces {
            self.flow_at_end(h);
            for (guard, value) in self.force_guards() {
                consider(guard, value);
            }
        }
        worst.map(|(guard, _)| guard)
    }

    /// Guards of the feet that look at the state alone.
    fn foot_guards(&self) -> [(Guard, Option<f64>); 3] {
        [
            (Guard::Touchdown, self.plant.touchdown_guard(&self.end)),
            (Guard::Land, self.plant.landing_guard(&self.end)),
            (Guard::SlideStop, self.plant.slide_guard(&self.end)),
        ]
    }

    /// Guards that look at the forces of the last `Plant::flow`; below zero = broken.
    fn force_guards(&self) -> impl Iterator<Item = (Guard, f64)> {
        let work = &self.work;
        work.held.forces().filter_map(move |(holder, force)| {
            let force = force.value();
            match holder {
                Holder::Axis(i) => {
                    let level = work.level[i].value();
                    Some((Guard::Release(i), level * (1.0 + ROUNDING) + f64::MIN_POSITIVE - force.abs()))
                }
                Holder::Rotor(i) => match self.plant.plays[i] {
                    // The contact pushes the rotor back: against the side it leans to.
                    Play::Closed(side) => Some((Guard::Part(i), ROUNDING - force * side)),
                    _ => None,
                },
                Holder::Tangent => self.plant.cone_guard(work).map(|value| (Guard::SlideStart, value)),
                Holder::Normal => self.plant.ground.lift_off.then_some((Guard::LiftOff, force + ROUNDING)),
                Holder::Toe => None,
            }
        })
    }

    /// Fraction of `h` after which the first guard breaks, and which. `end` holds a broken state.
    fn locate(&mut self, h: S) -> (f64, Guard) {
        let mut guard = self.first_violated(h);
        let mut bracket = Bracket::new(self.guard_value(guard), TIME_TOLERANCE_S / h.value());
        for _ in 0..MOST_ITERATIONS {
            let Some(trial) = bracket.next() else { break };
            self.step(h * trial);
            let broken = self.first_violated(h * trial);
            if broken.is_some() && broken != guard {
                guard = broken;
                bracket.forget();
            }
            bracket.narrow(trial, broken.is_some(), self.guard_value(guard));
        }
        (bracket.high, guard.unwrap_or(Guard::Stop(0)))
    }

    /// Value of a guard at `end`, after [`Self::first_violated`] there.
    fn guard_value(&self, guard: Option<Guard>) -> Option<f64> {
        match guard? {
            Guard::Stop(i) => Some(self.plant.grips[i].direction() * self.plant.axes[i].row.value_of(&self.end.v)),
            Guard::Meet(i) => {
                let rotor = &self.plant.rotors[i];
                Some(rotor.gap.value() * 0.5 - rotor.twist_value(&self.end.q).abs())
            }
            Guard::Touchdown => self.plant.touchdown_guard(&self.end),
            Guard::Land => self.plant.landing_guard(&self.end),
            Guard::SlideStop => self.plant.slide_guard(&self.end),
            of_forces => self.force_guards().find(|(g, _)| *g == of_forces).map(|(_, value)| value),
        }
    }

    /// Steps to the event and corrects its instant by one Newton step in dual numbers. Returns the time taken.
    fn go_to_event(&mut self, h: S, guard: Guard) -> S {
        let h = S::constant(h.value());
        self.step(h);
        let correction = self.correction(h, guard);
        if correction.is_varied() {
            self.flow_at_end(h);
            self.end.drift(&self.work, correction, self.plant.n, self.plant.bristles);
        }
        self.flow_of = FlowOf::Nothing;
        let reached = h + correction;
        self.accept(reached);
        reached
    }

    /// `-g' / ġ`: how the instant of the event moves with the directions (value zero).
    fn correction(&mut self, h: S, guard: Guard) -> S {
        let (g, rate) = match guard {
            Guard::Stop(i) => {
                self.flow_at_end(h);
                let rate = self.plant.axes[i].row.of(&self.work.a);
                (self.plant.axes[i].row.of(&self.end.v), rate)
            }
            Guard::Meet(i) => {
                let rotor = &self.plant.rotors[i];
                let (twist, rate) = (rotor.twist(&self.end.q), rotor.twist(&self.end.v));
                (twist - rotor.gap * (0.5 * twist.sign()), rate)
            }
            Guard::Touchdown | Guard::Land | Guard::SlideStop => {
                self.flow_at_end(h);
                let Some(event) = self.foot_event(guard) else { return S::zero() };
                event
            }
            // The flow does not jump here, so the instant does not matter to first order.
            Guard::Release(_) | Guard::Part(_) | Guard::SlideStart | Guard::LiftOff => return S::zero(),
        };
        // A foot that is armed below the ground does not cross it: no instant to move.
        let crosses = g.value().abs() < OFF_GUARD && rate.value().abs() > f64::MIN_POSITIVE;
        if !crosses { S::zero() } else { -((g - g.value()) / rate.value()) }
    }

    /// Changes the mode at an event; `y` is the state there.
    fn happen(&mut self, guard: Guard) {
        match guard {
            Guard::Stop(i) => {
                self.plant.grips[i] = Grip::Stuck;
                if let &[(index, _)] = self.plant.axes[i].row.terms() {
                    // Exactly at rest: what is left is rounding.
                    self.y.v[index] = S::zero();
                }
            }
            Guard::Release(i) => self.release(i),
            Guard::Meet(i) => self.meet(i),
            Guard::Part(i) => self.plant.plays[i] = Play::Free,
            Guard::Touchdown => self.touch_down(),
            Guard::Land => self.land(),
            Guard::SlideStart => self.start_sliding(),
            Guard::SlideStop => self.stop_sliding(),
            Guard::LiftOff => self.lift_off(),
        }
        self.flow_of = FlowOf::Nothing;
        self.settle_modes();
    }

    /// A stuck axis slides where it is pulled: against the force that held it.
    fn release(&mut self, i: usize) {
        self.flow_at_start();
        let force = self.work.held.force_of(Holder::Axis(i)).map_or(0.0, Scalar::value);
        self.plant.grips[i] = Grip::along(-force);
    }

    /// The truth just after a jump, so that lags start from it.
    pub(super) fn before_now(&mut self) {
        for (i, pickup) in self.pickups.iter().enumerate() {
            self.before[i] = pickup.truth(&self.y.q, &self.y.v);
            if pickup.lag.is_none() {
                self.lagged[i] = self.before[i];
            }
        }
        self.remember();
    }

    /// Releases whatever is held beyond its strength under the present commands.
    pub(super) fn settle_modes(&mut self) {
        for _ in 0..MOST_CHANGES {
            let stuck = self.plant.axes.iter().zip(&self.plant.grips).any(|(a, g)| !a.slides(*g));
            let closed = self.plant.plays.iter().any(|p| matches!(p, Play::Closed(_)));
            let may_slip = self.plant.walks && (self.plant.ground.friction.is_some() || self.plant.ground.lift_off);
            if !stuck && !closed && !may_slip {
                return;
            }
            self.flow_at_start();
            let broken = self.force_guards().filter(|(_, value)| *value < 0.0);
            let Some((guard, _)) = broken.min_by(|a, b| a.1.total_cmp(&b.1)) else { return };
            match guard {
                Guard::Release(i) => self.release(i),
                Guard::Part(i) => self.plant.plays[i] = Play::Free,
                Guard::SlideStart => self.start_sliding(),
                Guard::LiftOff => self.lift_off(),
                _ => return,
            }
            self.flow_of = FlowOf::Nothing;
        }
    }

    /// Kinetic energy now, J.
    pub fn kinetic_energy(&mut self) -> S {
        self.flow_at_start();
        let mut sum = S::zero();
        for i in 0..self.plant.n {
            for j in 0..self.plant.n {
                sum += self.work.eq.mass[i][j] * self.y.v[i] * self.y.v[j] * 0.5;
            }
        }
        sum
    }
}

/// Farther from zero than this a guard was not crossed but switched on.
const OFF_GUARD: f64 = 1e-6;
/// Relative slack of a force against its limit.
const ROUNDING: f64 = 1e-10;

/// Where a guard breaks, as fractions of a step: whole below, broken above.
///
/// The chord between both ends; an end that stays twice counts half (the Illinois rule: some eight evaluations to the
/// last digit, where the plain chord creeps from one side); halving where a value is missing or the chord is slow.
struct Bracket {
    low: f64,
    high: f64,
    value_low: Option<f64>,
    value_high: Option<f64>,
    /// Which end moved last: true for the high one.
    moved_high: Option<bool>,
    least: f64,
    /// Trials since the bracket was last halved, and its width then.
    slow: u32,
    width: f64,
    /// How often that took too long: the guard is no chord's matter then.
    failed: u32,
}

/// Trials within which a bracket must have halved; and how often it may not.
const PATIENCE: u32 = 3;

impl Bracket {
    const fn new(value_high: Option<f64>, least: f64) -> Self {
        Self {
            low: 0.0,
            high: 1.0,
            value_low: None,
            value_high,
            moved_high: None,
            least,
            slow: 0,
            width: 1.0,
            failed: 0,
        }
    }

    /// The next fraction to look at; none if the bracket is narrow enough.
    fn next(&self) -> Option<f64> {
        let width = self.high - self.low;
        if width <= self.least {
            return None;
        }
        let middle = 0.5 * (self.low + self.high);
        Some(match (self.value_low, self.value_high) {
            (Some(a), Some(b)) if a >= 0.0 && b < 0.0 && self.slow < PATIENCE && self.failed < PATIENCE => {
                let margin = 0.5 * self.least;
                (self.low + width * a / (a - b)).max(self.low + margin).min(self.high - margin)
            }
            _ => middle,
        })
    }

    /// Another guard broke first: the values were of the old one.
    fn forget(&mut self) {
        (self.value_low, self.value_high, self.moved_high) = (None, None, None);
    }

    fn narrow(&mut self, at: f64, broken: bool, value: Option<f64>) {
        let again = self.moved_high == Some(broken);
        let (moved, kept) = if broken {
            self.high = at;
            (&mut self.value_high, &mut self.value_low)
        } else {
            self.low = at;
            (&mut self.value_low, &mut self.value_high)
        };
        *moved = value;
        if again {
            *kept = kept.map(|x| 0.5 * x);
        }
        self.moved_high = Some(broken);
        self.slow += 1;
        if self.slow > PATIENCE {
            self.failed += 1;
        }
        if self.high - self.low <= 0.5 * self.width {
            (self.slow, self.width) = (0, self.high - self.low);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Evaluations until the zero of `guard` is bracketed to 1e-11 of the step, and where it is.
    fn found(guard: impl Fn(f64) -> f64) -> (u32, f64) {
        let mut bracket = Bracket::new(Some(guard(1.0)), 1e-11);
        let mut evaluations = 0;
        while let Some(at) = bracket.next() {
            evaluations += 1;
            bracket.narrow(at, guard(at) < 0.0, Some(guard(at)));
        }
        assert!(guard(bracket.high) < 0.0 && guard(bracket.low) >= 0.0 && bracket.high - bracket.low <= 1e-11);
        (evaluations, bracket.high)
    }

    #[test]
    fn a_smooth_guard_is_found_in_a_dozen_evaluations() {
        for zero in [0.03, 0.5, 0.97, 1.0 - 1e-9] {
            let (count, at) = found(|x| (zero - x) * (1.0 + 0.3 * x));
            assert!((at - zero).abs() < 1e-10 && count <= 12, "{zero}: {count}");
        }
    }

    #[test]
    fn a_kinked_or_flat_guard_is_found_as_well() {
        let (count, at) = found(|x| if x < 0.7 { 1e6 } else { 1e-3 * (0.7 - x) - 1e-12 });
        assert!((at - 0.7).abs() < 1e-10 && count < 60, "{count}");
        let (count, at) = found(|x| (0.4 - x).powi(5));
        assert!((at - 0.4).abs() < 1e-2 && count < 60, "{count}");
    }
}
