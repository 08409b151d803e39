//! Does a toe go where it is sent? RT: yes.
//!
//! A drive that shows "enabled" may drive nothing: a shaft that slips, a motor without current behind a stuck statusword. A
//! toe that is off its place, and has not come nearer in the time in which one within its limits would have come twice, is
//! astray. Told, and no fault: without torque the robot would fall for certain. Of a leg that bears weight nothing is said,
//! as its toes may stall at the limit of their force.

use crate::base::time::{Span, Stamp};
use crate::config::checked::Toe;
use crate::msg::{Estimate, Leg, TOES};

/// Off by less than this is where it was sent, m: twice the step that a toe makes between two answers.
const MARGIN_M: f64 = 0.002;
/// Nearer by this much is on its way, m.
const NEARER_M: f64 = 0.001;
/// More of the weight on the swing foot than this is a load on its toes.
const LOADED: f64 = 0.05;
/// Toes of a leg.
const PAIR: usize = TOES / 2;

/// Off its place, and not yet nearer.
#[derive(Clone, Copy, Debug)]
struct Watch {
    since: Stamp,
    from_m: f64,
    /// Which way it was sent.
    way: f64,
}

/// The toes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Astray {
    patience: Span,
    watches: [Option<Watch>; TOES],
}

impl Astray {
    /// For toes with these limits.
    pub(super) fn new(toe: &Toe) -> Self {
        // To full speed, and the margin at it: twice.
        let patience_s = 2.0 * (toe.rate_limit_m_s / toe.acceleration_limit_m_s2 + MARGIN_M / toe.rate_limit_m_s);
        Self { patience: Span::from_s(patience_s), watches: [None; TOES] }
    }

    /// Where they were sent and where they are, m: the first that is astray, and by how much.
    pub(super) fn observe(
        &mut self,
        now: Stamp,
        sent_m: &[f64; TOES],
        measured_m: &[f64; TOES],
        estimate: &Estimate,
    ) -> Option<(usize, f64)> {
        let mut first = None;
        for (toe, (watch, (sent, measured))) in self.watches.iter_mut().zip(sent_m.iter().zip(measured_m)).enumerate() {
            let off_m = sent - measured;
            let of_stance = (toe / PAIR == 0) == (estimate.stance == Leg::Inner);
            let loaded = of_stance || estimate.stance_doubt > LOADED || estimate.weight_elsewhere > LOADED;
            // What is not a number is not off either: other rules look at that.
            if loaded || off_m.is_nan() || off_m.abs() <= MARGIN_M {
                *watch = None;
                continue;
            }
            let fresh = Watch { since: now, from_m: *measured, way: off_m.signum() };
            let begun = *watch.get_or_insert(fresh);
            let nearer = (measured - begun.from_m) * begun.way >= NEARER_M;
            if nearer || begun.way * off_m < 0.0 {
                *watch = Some(fresh);
            } else if now.since(begun.since) >= self.patience {
                first = first.or(Some((toe, off_m)));
            }
        }
        first
    }

    /// The toes are not sent anywhere.
    pub(super) fn rest(&mut self) {
        self.watches = [None; TOES];
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    /// The leg of the first toe swings.
    fn swing() -> Estimate {
        Estimate { stance: Leg::Outer, ..Estimate::default() }
    }

    /// The first toe goes so while it is sent from 10 to 30 mm at its full speed: when it was told, ms.
    fn told(estimate: &Estimate, at_m: impl Fn(f64) -> f64) -> Option<i64> {
        let toe = config::load(None, &[]).unwrap().config.robot.toe;
        let mut astray = Astray::new(&toe);
        (0..500).find(|ms| {
            let t_s = 1e-3 * *ms as f64;
            let sent = (0.010 + toe.rate_limit_m_s * t_s).min(0.030);
            let (sent_m, measured_m) = ([sent, 0.01, 0.01, 0.01], [at_m(t_s), 0.01, 0.01, 0.01]);
            let found = astray.observe(Stamp(ms * 1_000_000), &sent_m, &measured_m, estimate);
            found.is_some_and(|(toe, off_m)| toe == 0 && off_m > MARGIN_M)
        })
    }

    #[test]
    fn a_toe_that_stays_or_goes_the_other_way_is_told_and_one_that_lags_is_not() {
        let patience_ms = 2 * (50 + 8);
        for stuck in [|_: f64| 0.010, |t_s: f64| 0.010 - 0.05 * t_s] {
            let at = told(&swing(), stuck).unwrap();
            assert!((patience_ms..patience_ms + 15).contains(&at), "{at} ms");
        }
        let accelerates =
            |t_s: f64| (0.010 + 0.5 * 5.0 * t_s.min(0.05).powi(2) + 0.25 * (t_s - 0.05).max(0.0)).min(0.030);
        assert_eq!(told(&swing(), |t_s| accelerates((t_s - 0.02).max(0.0))), None, "20 ms late, at its limits");
        assert_eq!(told(&swing(), |_| f64::NAN), None);
    }

    #[test]
    fn a_toe_that_bears_weight_may_stall() {
        let stuck = |_: f64| 0.010;
        assert_eq!(told(&Estimate { stance: Leg::Inner, ..swing() }, stuck), None);
        assert_eq!(told(&Estimate { weight_elsewhere: 0.3, ..swing() }, stuck), None);
        assert_eq!(told(&Estimate { stance_doubt: 0.3, ..swing() }, stuck), None);
        assert!(told(&swing(), stuck).is_some());
    }
}
