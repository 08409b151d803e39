//! What stands in the way of arming, in words. RT: no.

use super::checked::Limits;
use crate::msg::{Fault, FaultCode};

impl Limits {
    /// What stands in the way, with the limit that it is measured by. `blocker` is that of `safety`.
    #[must_use]
    pub fn told_at_arming(&self, blocker: &Fault) -> String {
        if blocker.code == FaultCode::None {
            return "nothing stands in the way, the switch was not pressed".to_owned();
        }
        self.at_arming(blocker).map_or_else(
            || blocker.to_string(),
            |(key, limit)| {
                let angle =
                    if key.ends_with("_rad") { format!(" ({:.1} deg)", limit.to_degrees()) } else { String::new() };
                format!("{blocker}, limit robot.limits.{key} = {limit}{angle}")
            },
        )
    }

    /// Key and limit in the key's unit, where there is one. Before arming the stance leg has its own (`safety::health`).
    fn at_arming(&self, blocker: &Fault) -> Option<(&'static str, f64)> {
        Some(match (blocker.code, blocker.index) {
            (FaultCode::TiltLimit | FaultCode::FellForward | FaultCode::FellBackward, 0) => {
                ("arm_tilt_rad", self.arm_tilt_rad)
            }
            (FaultCode::TiltLimit, _) => ("swing_rad", self.swing_rad),
            (FaultCode::RateLimit, _) => ("rate_rad_s", self.rate_rad_s),
            (FaultCode::EstimateLost, _) => ("innovation_rad", self.innovation_rad),
            (FaultCode::ImuStale, _) => ("imu_age_ms", self.imu_age.as_s() * 1e3),
            (FaultCode::OperatorStale, _) => ("operator_age_ms", self.operator_age.as_s() * 1e3),
            (FaultCode::Overrun, _) => ("overruns_per_s", f64::from(self.overruns_per_s)),
            _ => return None,
        })
    }
}
