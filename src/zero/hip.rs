//! The hip's zero: a person aligns the legs and says so. RT: yes.

use super::{has_forgotten, show};
use crate::base::time::{Span, Stamp};
use crate::config::checked::Hip;
use crate::msg::{DriveFeedback, DriveState, Mode, OperatorSample, ZeroState};
use std::f64::consts::TAU;

/// The legs have been at rest for so long when they are taken as aligned.
const AT_REST: Span = Span::from_ms(100);
/// A hand that holds them moves them by less: a quarter of a degree.
const TREMOR_RAD: f64 = 0.0044;

/// The hip's zero.
#[derive(Clone, Copy, Debug)]
pub(super) struct HipZero {
    counts_per_rad: f64,
    angle_at_zero_rad: f64,
    tremor_counts: f64,
    offset_counts: Option<i32>,
    /// Confirmations seen.
    seen: u32,
    rest: Option<(Stamp, i32)>,
}

impl HipZero {
    pub(super) fn new(hip: &Hip) -> Self {
        let counts_per_rad = hip.encoder_counts_per_turn / TAU;
        Self {
            counts_per_rad,
            angle_at_zero_rad: hip.encoder_offset_rad,
            tremor_counts: TREMOR_RAD * counts_per_rad,
            offset_counts: None,
            seen: 0,
            rest: None,
        }
    }

    pub(super) fn receive(&mut self, now: Stamp, operator: &OperatorSample, mode: Mode, hip: &mut DriveFeedback) {
        let confirmed = operator.zeroings != self.seen;
        self.seen = operator.zeroings;
        if has_forgotten(hip) || hip.stamp == Stamp::NEVER {
            self.offset_counts = None;
            self.rest = None;
        } else {
            let at_rest = self.is_at_rest(now, hip.position_counts);
            if confirmed && at_rest && is_without_torque(mode, hip) {
                self.offset_counts =
                    self.offset_at(operator.zero_angle_rad, hip.position_counts).or(self.offset_counts);
            }
        }
        let zero = if self.offset_counts.is_some() { ZeroState::Known } else { ZeroState::Unknown };
        show(hip, self.offset_counts, zero);
    }

    /// The drive's count at our count zero, if it stands at `angle_rad` now.
    #[expect(clippy::cast_possible_truncation, reason = "saturates; a turn has few counts")]
    fn offset_at(&self, angle_rad: f64, counts: i32) -> Option<i32> {
        // Down to a whole count, as the encoder itself does.
        let ours = libm::floor((angle_rad - self.angle_at_zero_rad) * self.counts_per_rad);
        ours.is_finite().then(|| counts.saturating_sub(ours as i32))
    }

    fn is_at_rest(&mut self, now: Stamp, counts: i32) -> bool {
        let (since, at) = *self.rest.get_or_insert((now, counts));
        if (f64::from(counts) - f64::from(at)).abs() > self.tremor_counts {
            self.rest = Some((now, counts));
            return false;
        }
        now.since(since) >= AT_REST
    }
}

fn is_without_torque(mode: Mode, hip: &DriveFeedback) -> bool {
    let idle = matches!(mode, Mode::Starting | Mode::Disarmed | Mode::Faulted);
    idle && !matches!(hip.state, DriveState::Enabled | DriveState::QuickStop)
}
