//! The walking speed that is asked for: by the schedule of the configuration, or by the stick in the operator's hand. RT: yes.
//!
//! The stick counts from when it was seen at rest since arming: one that leans on something when the robot is armed, or whose
//! rest is another than configured, does not make it walk. At rest it asks for 0 at once; any other change is as fast as
//! `robot.operator.speed.rate_m_s2`.

use super::ramp::{Ticks, toward};
use crate::base::time::Stamp;
use crate::config::checked::{Config, Walk as Schedule};
use crate::msg::Snapshot;

/// See the module.
#[derive(Clone, Debug)]
pub(super) struct AskedSpeed {
    schedule: Schedule,
    /// Of the stick, m/s²; none: the schedule asks.
    rate_m_s2: Option<f64>,
    armed: Stamp,
    ticks: Ticks,
    /// The stick was at rest since arming.
    has_rested: bool,
    speed_m_s: f64,
}

impl AskedSpeed {
    /// As configured. Before arming only.
    pub(super) fn new(config: &Config) -> Self {
        Self {
            schedule: config.control.walk.clone(),
            rate_m_s2: config.robot.operator_speed.map(|speed| speed.rate_m_s2),
            armed: Stamp::NEVER,
            ticks: Ticks::new(config),
            has_rested: false,
            speed_m_s: 0.0,
        }
    }

    /// On arming.
    pub(super) const fn reset(&mut self, now: Stamp) {
        self.armed = now;
        self.ticks.reset(now);
        (self.has_rested, self.speed_m_s) = (false, 0.0);
    }

    /// Of this tick, m/s.
    pub(super) fn m_s(&mut self, now: Stamp, seen: &Snapshot) -> f64 {
        let Some(rate_m_s2) = self.rate_m_s2 else { return self.schedule.speed_at_m_s(now.since(self.armed).as_s()) };
        let most_m_s = rate_m_s2 * self.ticks.since_last_s(now);
        let is_pushed = seen.asked_m_s > 0.0;
        self.has_rested |= !is_pushed;
        if !is_pushed || !self.has_rested {
            self.speed_m_s = 0.0;
        } else {
            self.speed_m_s = toward(self.speed_m_s, seen.asked_m_s, most_m_s);
        }
        self.speed_m_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::time::Span;
    use crate::config::load;

    const STICK: &str = "robot.operator.speed={ highest_m_s = 0.5, rate_m_s2 = 0.2 }";

    /// Ticks of 1 ms under what the stick says; what is asked for after each.
    fn asked(keys: &[&str], stick_m_s: impl Fn(i64) -> f64, ms: i64) -> Vec<f64> {
        let keys: Vec<String> = keys.iter().map(ToString::to_string).collect();
        let mut asked = AskedSpeed::new(&load(None, &keys).unwrap().config);
        let at = |ms| Stamp(5_000_000_000) + Span::from_ms(ms);
        asked.reset(at(0));
        (0..ms).map(|k| asked.m_s(at(k), &Snapshot { asked_m_s: stick_m_s(k), ..Snapshot::default() })).collect()
    }

    #[test]
    fn without_a_stick_the_schedule_asks() {
        let keys = ["control.walk.start_s=1.0", "control.walk.speeds=[[2.0, 0.5]]", "control.walk.stop_s=2.5"];
        let said = asked(&keys, |_| 0.25, 3_000);
        assert!(said[..1000].iter().all(|v| *v <= 0.0) && said[2500..].iter().all(|v| *v <= 0.0));
        assert!((said[2200] - 0.5).abs() < 1e-12 && said[1500] > 0.0 && (said[1500] - 0.25).abs() > 1e-3);
    }

    #[test]
    fn the_stick_asks_no_faster_than_its_rate_and_stops_at_once() {
        let said = asked(&[STICK], |k| if (100..3_000).contains(&k) { 0.4 } else { 0.0 }, 4_000);
        assert!(said[..100].iter().all(|v| *v <= 0.0), "the schedule has no say");
        assert!((said[1099] - 0.2).abs() < 1e-9 && (said[2_200] - 0.4).abs() < 1e-9, "{} {}", said[1099], said[2_200]);
        assert!(said[3_000] <= 0.0, "at rest: at once");
        let slower = asked(
            &[STICK],
            |k| {
                if k < 1 {
                    0.0
                } else if k < 3_000 {
                    0.4
                } else {
                    0.1
                }
            },
            4_000,
        );
        assert!((slower[3_499] - 0.3).abs() < 1e-9, "{}", slower[3_499]);
    }

    #[test]
    fn a_stick_that_is_pushed_while_the_robot_is_armed_must_rest_first() {
        assert!(asked(&[STICK], |_| 0.4, 5_000).iter().all(|v| *v <= 0.0));
        let said = asked(&[STICK], |k| if k == 1_000 { 0.0 } else { 0.4 }, 5_000);
        assert!(said[..=1_000].iter().all(|v| *v <= 0.0) && (said[4_000] - 0.4).abs() < 1e-9);
    }
}
