//! The toe of the leg that stands: moved gently. RT: yes.

use crate::base::time::Stamp;
use crate::msg::{Leg, TOES};

/// Length that is asked of the stance toe.
///
/// A toe under load moves gently: what it accelerates is the robot, and friction holds by what is left of the weight.
#[derive(Clone, Copy, Debug)]
pub(super) struct StanceToe {
    /// Length at its touchdown, m.
    pub(super) landed_m: f64,
    length_m: f64,
    rate_m_s: f64,
    last: Stamp,
}

impl StanceToe {
    /// From the length and rate at its touchdown.
    pub(super) const fn new(now: Stamp, landed_m: f64, rate_m_s: f64) -> Self {
        Self { landed_m, length_m: landed_m, rate_m_s, last: now }
    }

    /// Length for now on the way to a target, critically damped.
    pub(super) fn toward(&mut self, now: Stamp, target_m: f64, bandwidth_rad_s: f64) -> f64 {
        let (w, dt_s) = (bandwidth_rad_s, now.since(self.last).as_s());
        self.rate_m_s += dt_s * (w * w * (target_m - self.length_m) - 2.0 * w * self.rate_m_s);
        self.length_m += dt_s * self.rate_m_s;
        self.last = now;
        self.length_m
    }
}

/// Share of the way to a target that [`StanceToe::toward`] makes from rest in `time_s`.
pub(super) fn toward_share(bandwidth_rad_s: f64, time_s: f64) -> f64 {
    let turned = bandwidth_rad_s * time_s;
    1.0 - (1.0 + turned) * libm::exp(-turned)
}

/// Toe lengths in the order of the drives.
pub(super) const fn in_order(stance: Leg, stance_m: f64, swing_m: f64) -> [f64; TOES] {
    match stance {
        Leg::Inner => [stance_m, stance_m, swing_m, swing_m],
        Leg::Outer => [swing_m, swing_m, stance_m, stance_m],
    }
}

/// Toe length of the leg that stands and of the other, m.
pub(super) const fn by_stance(toes_m: &[f64; TOES], stance: Leg) -> (f64, f64) {
    let [inner_a, inner_b, outer_a, outer_b] = *toes_m;
    let (inner, outer) = (inner_a.max(inner_b), outer_a.max(outer_b));
    match stance {
        Leg::Inner => (inner, outer),
        Leg::Outer => (outer, inner),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;

    #[test]
    fn the_share_of_the_way_is_what_the_toe_makes_of_it() {
        let (w, start) = (9.6, Stamp(0));
        let mut toe = StanceToe::new(start, 0.02, 0.0);
        for ms in 1..=400 {
            let length_m = toe.toward(start + Span::from_ms(ms), 0.01, w);
            let share = (0.02 - length_m) / 0.01;
            assert!((share - toward_share(w, 1e-3 * ms as f64)).abs() < 0.01, "{ms} ms: {share}");
        }
    }
}
