//! Which leg stands: touchdown by the toes' springs, affirmed by the balance of momentum. Thesis 2.1.4. RT: yes.
//!
//! ```text
//!                 blow on the swing toes, or the weight is found on the swing foot
//!   stance S ───────────────────────────────────────────────────────────────────────> stance O, to be affirmed
//!      ^                                                                                │
//!      └──────────────── the weight is found on the old foot after all ─────────────────┘
//! ```
//! The robot's weight alone does not move the preloaded springs, but a blow does. So a swing toe whose spring gives way has
//! met the ground. Springs see blows only, so the second sign of contact is [`super::weight`]: which foot carries the robot.
//! A touchdown too soft for the springs is noticed by the weight; a blow after which the weight stays where it was (a toe
//! that knocked something) is taken back. In between there is doubt, and the torque fades with it.
//! A foot that stands unnoticed is found by both balances: the one about the foot that is taken to stand, and now swings,
//! breaks; the one about the foot that stands holds.
//!
//! A potentiometer that shows a blow all the time, or none where its twin does, is no longer asked. With one toe of a leg
//! left the robot walks on; with none it does not know when that leg lands by its springs and says so.

use crate::base::time::{Span, Stamp};
use crate::msg::{Leg, Snapshot, TOES};

/// So long after a touchdown there is no other: the springs ring, and a leg takes longer to come down.
const QUIET: Span = Span::from_ms(50);
/// Older readings say nothing about now.
const OLDEST: Span = Span::from_ms(20);
/// A foot this far above the ground by the angles and toe lengths does not touch it, m: tiles of 30 mm, angles wrong by
/// .5 degrees at steps of .4 m.
const IN_THE_AIR_M: f64 = 0.045;
/// The other foot carries the robot: more than half of the weight, summed up over time (Page 1954), comes to this, s. The
/// whole weight for 16 ms, or a blow of 1.5 weights for 8 ms. A foot that begins or ends to slip looks like it for less.
const HALF: f64 = 0.5;
const CARRIED_S: f64 = 0.008;
/// For each such height of the foot above the ground, by the angles and toe lengths, as much again, m: a push along a leg
/// looks like weight on a foot that is in the air.
const UNLIKELY_M: f64 = 0.0033;
/// Longest time that one look stands for, s: ticks may be missing.
const LONGEST_LOOK_S: f64 = 0.005;
/// A new stance leg is affirmed or taken back within this time after the touchdown.
const ON_TRIAL: Span = Span::from_ms(90);
/// Not before this: the momentum observer needs its time.
const NOT_BEFORE: Span = Span::from_ms(45);
/// No doubt below the first share of weight elsewhere, full doubt above the second.
const DOUBTED: [f64; 2] = [0.5, 0.9];
/// A blow is shorter: a potentiometer that shows one for so long is stuck.
const LONGEST_BLOW: Span = Span::from_ms(250);
/// Blows of the other toe of the pair that a potentiometer may miss in a row.
const MISSES: u8 = 4;

/// What to do about the stance leg.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// It stands.
    Stays,
    /// The other leg stands from now on.
    Changes,
    /// It does, and the weight alone says so: it has stood for a while.
    ChangedBefore,
    /// The last change was wrong.
    TakenBack,
}

/// What is looked at in a tick.
#[derive(Clone, Copy, Debug)]
pub(super) struct Signs<'a> {
    pub(super) now: Stamp,
    pub(super) seen: &'a Snapshot,
    /// The leg that is taken to stand.
    pub(super) stance: Leg,
    /// Share of the weight on the other foot, by the balance about this one.
    pub(super) elsewhere: f64,
    /// Share of the weight on this foot, by the balance about the other one: 0 = that one stands alone.
    pub(super) here: f64,
    /// Height of the other foot over the level of this one, m.
    pub(super) height_m: f64,
}

/// A toe's potentiometer.
#[derive(Clone, Copy, Debug, Default)]
struct Pot {
    /// Since when it shows a blow.
    high_since: Option<Stamp>,
    /// Blows of its twin that it missed.
    missed: u8,
    stuck: bool,
}

/// Looks at the toes' springs and at the weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct Detector {
    /// 0 = sees nothing.
    threshold_m: f64,
    last: Stamp,
    on_trial: bool,
    /// Since when the robot steps off from both feet, and the other one may not have left yet.
    leaves: Option<Stamp>,
    /// What the weight says for the other foot so far, s.
    carried_s: f64,
    looked: Stamp,
    pots: [Pot; TOES],
}

impl Detector {
    pub(super) fn new(threshold_m: f64) -> Self {
        Self {
            threshold_m,
            last: Stamp::NEVER,
            on_trial: false,
            leaves: None,
            carried_s: 0.0,
            looked: Stamp::NEVER,
            pots: [Pot::default(); TOES],
        }
    }

    /// Forgets the last touchdown, not which potentiometers are stuck.
    pub(super) const fn reset(&mut self) {
        self.last = Stamp::NEVER;
        self.on_trial = false;
        self.leaves = None;
        self.carried_s = 0.0;
    }

    /// Both feet stand until now; the foot that pushes off bears weight for a while. That is no touchdown of it.
    pub(super) const fn stand_on_both(&mut self, now: Stamp) {
        self.reset();
        self.last = now;
        self.leaves = Some(now);
    }

    /// Potentiometers that are no longer asked, by bit.
    pub(super) fn stuck(&self) -> u8 {
        self.pots.iter().rev().fold(0, |bits, pot| bits << 1 | u8::from(pot.stuck))
    }

    /// The weight begins to say that the other foot stands.
    pub(super) const fn suspects(&self) -> bool {
        self.carried_s > 0.0
    }

    /// Judges the stance leg.
    pub(super) fn judge(&mut self, signs: &Signs<'_>) -> Verdict {
        let blow = self.blow(signs);
        if self.threshold_m <= 0.0 {
            return Verdict::Stays;
        }
        let carried = self.is_carried(signs);
        if self.is_leaving(signs, blow) {
            return Verdict::Stays;
        }
        let since = if self.last == Stamp::NEVER { None } else { Some(signs.now.since(self.last)) };
        if self.on_trial && since.is_some_and(|s| s >= NOT_BEFORE) {
            if carried {
                self.end_trial(signs.now);
                return Verdict::TakenBack;
            }
            self.on_trial = since.is_some_and(|s| s < ON_TRIAL);
        }
        let quiet = since.is_some_and(|s| s < QUIET);
        let low = signs.height_m < IN_THE_AIR_M;
        if quiet || !low || !(blow || carried) {
            return Verdict::Stays;
        }
        self.on_trial = true;
        self.last = signs.now;
        self.carried_s = 0.0;
        if blow { Verdict::Changes } else { Verdict::ChangedBefore }
    }

    /// The other foot has not been without weight for long enough yet, after both stood.
    fn is_leaving(&mut self, signs: &Signs<'_>, blow: bool) -> bool {
        let Some(since) = self.leaves else { return false };
        if blow || signs.elsewhere > HALF {
            self.last = signs.now;
        }
        self.carried_s = 0.0;
        let is_leaving = signs.now.since(self.last) < QUIET && signs.now.since(since) < LONGEST_BLOW;
        self.leaves = self.leaves.filter(|_| is_leaving);
        is_leaving
    }

    fn end_trial(&mut self, now: Stamp) {
        self.on_trial = false;
        self.last = now;
        self.carried_s = 0.0;
    }

    /// The weight has said for a while that the other foot carries the robot. A blow may throw the weight off again, so its
    /// sum counts, not its length.
    fn is_carried(&mut self, signs: &Signs<'_>) -> bool {
        let dt_s = if self.looked == Stamp::NEVER { 0.0 } else { signs.now.since(self.looked).as_s() };
        self.looked = signs.now;
        let unlikely = 1.0 + signs.height_m.max(0.0) / UNLIKELY_M;
        let here = signs.here.abs();
        // Less than none on the other foot: this one moves, and the balance about it says nothing of the weight any more. If the
        // balance about the other foot holds, that one stands, however high it seems. After a push neither holds.
        let moves = if here < HALF { (-signs.elsewhere - HALF) * unlikely } else { f64::NEG_INFINITY };
        // To take a change back the balance about the old foot must hold: a foot that lands on an edge slides on it first.
        let carries = signs.elsewhere - if self.on_trial { here.max(HALF) } else { HALF };
        let more_s = carries.max(moves) * dt_s.clamp(0.0, LONGEST_LOOK_S);
        // NaN says nothing: `max` leaves it out.
        self.carried_s = (self.carried_s + more_s).max(0.0);
        self.carried_s > CARRIED_S * unlikely
    }

    /// A toe of the swing leg that can be believed shows a blow.
    fn blow(&mut self, signs: &Signs<'_>) -> bool {
        if signs.seen.toe_age > OLDEST {
            return false;
        }
        let [inner_a, inner_b, outer_a, outer_b] = signs.seen.toe_spring_m.map(|x| x > self.threshold_m);
        let [a, b, c, d] = &mut self.pots;
        let inner = pair([a, b], [inner_a, inner_b], signs.now);
        let outer = pair([c, d], [outer_a, outer_b], signs.now);
        match signs.stance.other() {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }
}

/// Follows both potentiometers of a leg; true if one that is not stuck shows a blow.
fn pair(pots: [&mut Pot; 2], high: [bool; 2], now: Stamp) -> bool {
    let [a, b] = pots;
    let [high_a, high_b] = high;
    let (began_a, began_b) = (a.follow(high_a, now), b.follow(high_b, now));
    a.compare(began_a, high_b, began_b);
    b.compare(began_b, high_a, began_a);
    (high_a && !a.stuck) || (high_b && !b.stuck)
}

impl Pot {
    /// True when a blow has just ended that this one showed.
    fn follow(&mut self, high: bool, now: Stamp) -> bool {
        let showed = self.high_since.is_some();
        match (high, self.high_since) {
            (true, Some(since)) if now.since(since) > LONGEST_BLOW => self.stuck = true,
            (true, None) => self.high_since = Some(now),
            (false, _) => self.high_since = None,
            _ => {}
        }
        showed && !high
    }

    /// Blows that only the twin has shown are counted at their end.
    fn compare(&mut self, ended: bool, twin_high: bool, twin_ended: bool) {
        if ended || self.high_since.is_some() {
            self.missed = 0;
        } else if twin_ended && !twin_high {
            self.missed = self.missed.saturating_add(1);
            self.stuck |= self.missed >= MISSES;
        }
    }
}

/// Doubt about the stance leg: 0 = none, 1 = full.
pub(super) fn doubt(elsewhere: f64) -> f64 {
    let [none, full] = DOUBTED;
    ((elsewhere - none) / (full - none)).clamp(0.0, 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Walk {
        detector: Detector,
        now: Stamp,
        stance: Leg,
    }

    impl Walk {
        fn new() -> Self {
            Self { detector: Detector::new(5e-4), now: Stamp(1_000_000_000), stance: Leg::Inner }
        }

        /// So many ms with these springs and this share of the weight elsewhere; says what changed.
        fn on(&mut self, ms: i64, toe_spring_m: [f64; 4], elsewhere: f64) -> Vec<Verdict> {
            self.on_at(ms, toe_spring_m, elsewhere, 0.0)
        }

        fn on_at(&mut self, ms: i64, toe_spring_m: [f64; 4], elsewhere: f64, height_m: f64) -> Vec<Verdict> {
            self.on_both(ms, toe_spring_m, [elsewhere, 1.0 - elsewhere], height_m)
        }

        /// `shares`: of the weight beside this foot, by the balance about it, and beside the other one.
        fn on_both(&mut self, ms: i64, toe_spring_m: [f64; 4], shares: [f64; 2], height_m: f64) -> Vec<Verdict> {
            let [elsewhere, here] = shares;
            let seen = Snapshot { toe_spring_m, toe_age: Span::from_ms(2), ..Snapshot::default() };
            let mut verdicts = Vec::new();
            for _ in 0..ms {
                self.now += Span::from_ms(1);
                let signs = Signs { now: self.now, seen: &seen, stance: self.stance, elsewhere, here, height_m };
                let verdict = self.detector.judge(&signs);
                if verdict != Verdict::Stays {
                    verdicts.push(verdict);
                    self.stance = self.stance.other();
                }
            }
            verdicts
        }
    }

    const AIR: [f64; 4] = [0.0; 4];
    const OUTER: [f64; 4] = [0.0, 0.0, 2e-3, 2e-3];
    const INNER: [f64; 4] = [2e-3, 2e-3, 0.0, 0.0];

    #[test]
    fn only_the_swing_toe_lands_and_once() {
        let mut walk = Walk::new();
        assert!(walk.on(10, INNER, 0.0).is_empty(), "the leg that stands");
        assert_eq!(walk.on(15, OUTER, 0.0), [Verdict::Changes]);
        assert!(walk.on(300, AIR, 0.0).is_empty());
        assert_eq!(walk.on(15, INNER, 0.0), [Verdict::Changes]);
    }

    #[test]
    fn a_landing_too_soft_for_the_springs_is_noticed_by_the_weight() {
        let mut walk = Walk::new();
        walk.on(200, AIR, 0.1);
        assert_eq!(walk.on(25, AIR, 0.9), [Verdict::ChangedBefore]);
        assert_eq!(walk.stance, Leg::Outer);
    }

    #[test]
    fn a_landing_that_the_springs_missed_is_noticed_though_the_blow_throws_the_weight_off_again() {
        let mut walk = Walk::new();
        walk.on(200, AIR, 0.1);
        assert_eq!(walk.on(10, AIR, 1.5), [Verdict::ChangedBefore]);
        // Less than that is a foot that slips.
        let mut walk = Walk::new();
        assert!(walk.on(6, AIR, 1.5).is_empty() && walk.on(200, AIR, 0.45).is_empty());
    }

    #[test]
    fn the_higher_the_foot_is_the_longer_must_the_weight_say_that_it_stands() {
        let noticed_after_ms = |height_m: f64| {
            let mut walk = Walk::new();
            walk.on(200, AIR, 0.1);
            (1..=200).find(|_| !walk.on_at(1, AIR, 1.0, height_m).is_empty()).expect("noticed")
        };
        assert_eq!(noticed_after_ms(-0.01), noticed_after_ms(0.0));
        assert!((10..20).contains(&noticed_after_ms(0.0)));
        assert!(noticed_after_ms(0.02) > 100);
    }

    #[test]
    fn a_foot_that_stands_is_noticed_while_the_other_one_swings_however_high_it_seems() {
        for here in [0.0, 0.3, -0.3] {
            let mut walk = Walk::new();
            walk.on(200, AIR, 0.0);
            assert_eq!(walk.on_both(20, AIR, [-1.2, here], 0.028), [Verdict::ChangedBefore], "{here}");
        }
        // Neither balance holds: a push, or a foot that slides.
        let mut walk = Walk::new();
        assert!(
            walk.on_both(300, AIR, [-1.2, 1.2], 0.0).is_empty() && walk.on_both(300, AIR, [-1.2, -1.2], 0.0).is_empty()
        );
        // Both hold: the feet are side by side.
        assert!(walk.on_both(300, AIR, [0.0, 0.0], 0.0).is_empty());
    }

    #[test]
    fn a_knock_after_which_the_weight_stays_is_taken_back() {
        let mut walk = Walk::new();
        assert_eq!(walk.on(6, OUTER, 0.0), [Verdict::Changes]);
        // The weight is still on the inner foot: all of it elsewhere than on the outer one.
        assert_eq!(walk.on(40, AIR, 1.0), [Verdict::TakenBack]);
        assert_eq!(walk.stance, Leg::Inner);
    }

    #[test]
    fn a_landing_on_an_edge_is_not_taken_back_while_neither_balance_holds() {
        let mut walk = Walk::new();
        assert_eq!(walk.on(6, OUTER, 0.0), [Verdict::Changes]);
        assert!(walk.on_both(80, AIR, [1.5, 1.5], 0.0).is_empty());
    }

    #[test]
    fn noise_old_readings_a_foot_in_the_air_and_a_detector_switched_off_see_nothing() {
        let mut walk = Walk::new();
        assert!(walk.on(50, [4e-4; 4], 0.3).is_empty());
        assert!(walk.on(50, [f64::NAN; 4], f64::NAN).is_empty());
        let mut off = Walk { detector: Detector::new(0.0), ..Walk::new() };
        assert!(off.on(50, OUTER, 1.0).is_empty());
        let seen = Snapshot { toe_spring_m: OUTER, toe_age: Span::from_ms(30), ..Snapshot::default() };
        let signs = Signs { now: walk.now, seen: &seen, stance: Leg::Inner, elsewhere: 0.0, here: 1.0, height_m: 0.0 };
        assert_eq!(walk.detector.judge(&signs), Verdict::Stays, "old");
        let fresh = Snapshot { toe_age: Span::from_ms(2), ..seen };
        let high = Signs { seen: &fresh, height_m: 0.1, ..signs };
        assert_eq!(walk.detector.judge(&high), Verdict::Stays, "in the air");
    }

    #[test]
    fn one_stuck_potentiometer_is_no_longer_asked_and_its_twin_still_is() {
        let mut walk = Walk::new();
        let stuck = [0.0, 0.0, 2e-3, 0.0];
        // Its first false touchdown is taken back by the weight.
        assert_eq!(walk.on(80, stuck, 0.0).first(), Some(&Verdict::Changes));
        let mut walk = Walk { stance: Leg::Inner, ..walk };
        walk.on(300, stuck, 0.0);
        assert_eq!(walk.detector.stuck(), 0b0100);
        walk.stance = Leg::Inner;
        assert!(walk.on(200, stuck, 0.0).is_empty());
        assert_eq!(walk.on(15, [0.0, 0.0, 2e-3, 2e-3], 0.0), [Verdict::Changes]);
    }

    #[test]
    fn a_potentiometer_that_misses_its_twins_blows_is_stuck() {
        let mut walk = Walk::new();
        for _ in 0..4 {
            walk.stance = Leg::Inner;
            walk.on(10, [0.0, 0.0, 2e-3, 0.0], 0.0);
            walk.on(100, AIR, 0.0);
        }
        assert_eq!(walk.detector.stuck(), 0b1000);
    }

    #[test]
    fn doubt_grows_with_the_weight_elsewhere() {
        assert!(doubt(0.0).abs() < 1e-15 && (doubt(1.0) - 1.0).abs() < 1e-15 && doubt(0.8) > 0.5);
        assert!(doubt(-3.0).abs() < 1e-15);
    }
}
