//! Touchdown, from the potentiometer on the swing toe's spring. Thesis 2.1.4. RT: yes.
//!
//! The robot's weight alone does not move the preloaded springs, but a blow does, even a small one. So a swing toe whose
//! spring gives way has met the ground, and from then on it stands. The toes report every few ms and a blow lasts some
//! ten, so the change comes some ms late; the observer bridges that.

use crate::base::time::{Span, Stamp};
use crate::msg::{Leg, Snapshot};

/// So long after a touchdown there is no other: the springs ring, and a leg takes longer to come down.
const QUIET: Span = Span::from_ms(50);
/// Older readings say nothing about now.
const OLDEST: Span = Span::from_ms(20);

/// Looks at the swing toe's springs.
#[derive(Clone, Copy, Debug)]
pub(super) struct Detector {
    /// 0 = sees nothing.
    threshold_m: f64,
    last: Stamp,
}

impl Detector {
    pub(super) const fn new(threshold_m: f64) -> Self {
        Self { threshold_m, last: Stamp::NEVER }
    }

    /// Forgets the last touchdown.
    pub(super) const fn reset(&mut self) {
        self.last = Stamp::NEVER;
    }

    /// True once per touchdown of the leg that swings.
    pub(super) fn has_landed(&mut self, now: Stamp, seen: &Snapshot, swing: Leg) -> bool {
        let [inner_a, inner_b, outer_a, outer_b] = seen.toe_spring_m;
        let compression_m = match swing {
            Leg::Inner => inner_a.max(inner_b),
            Leg::Outer => outer_a.max(outer_b),
        };
        let quiet = self.last != Stamp::NEVER && now.since(self.last) < QUIET;
        let blow = self.threshold_m > 0.0 && compression_m > self.threshold_m && seen.toe_age <= OLDEST;
        if quiet || !blow {
            return false;
        }
        self.last = now;
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn seen(toe_spring_m: [f64; 4]) -> Snapshot {
        Snapshot { toe_spring_m, toe_age: Span::from_ms(4), ..Snapshot::default() }
    }

    #[test]
    fn only_the_swing_toe_lands_and_once() {
        let mut detector = Detector::new(5e-4);
        let (inner, outer) = (seen([2e-3, 0.0, 0.0, 0.0]), seen([0.0, 0.0, 1e-4, 2e-3]));
        assert!(!detector.has_landed(Stamp(0), &inner, Leg::Outer), "the leg that stands");
        assert!(detector.has_landed(Stamp(1_000_000), &outer, Leg::Outer));
        assert!(!detector.has_landed(Stamp(5_000_000), &inner, Leg::Inner), "rings");
        assert!(detector.has_landed(Stamp(60_000_000), &inner, Leg::Inner));
    }

    #[test]
    fn noise_old_readings_and_a_detector_switched_off_see_nothing() {
        let mut detector = Detector::new(5e-4);
        assert!(!detector.has_landed(Stamp(0), &seen([4e-4; 4]), Leg::Outer));
        let old = Snapshot { toe_age: Span::from_ms(30), ..seen([2e-3; 4]) };
        assert!(!detector.has_landed(Stamp(0), &old, Leg::Outer));
        assert!(!Detector::new(0.0).has_landed(Stamp(0), &seen([2e-3; 4]), Leg::Outer));
        assert!(!detector.has_landed(Stamp(0), &seen([f64::NAN; 4]), Leg::Outer));
    }
}
