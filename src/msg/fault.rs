//! Numbered faults. Numbers are public and stable: 1.. faults (latched, torque zero), 96.. limits that are active
//! (told, not latched). RT: yes.

use super::reflect::{message, wire_enum};
use super::sensor::{BusHealth, DriveState};
use super::{Drive, Leg};
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;
use std::fmt;

wire_enum! {
    /// What went wrong.
    pub enum FaultCode {
        /// Nothing.
        None = 0,
        /// The operator let the dead-man switch go.
        DeadManReleased = 1,
        /// The operator's device is silent; value: age in ms.
        OperatorStale = 2,
        /// The IMU is silent; value: age in ms.
        ImuStale = 3,
        /// A drive's position is old; value: age in ms, index: drive.
        DriveStale = 4,
        /// A drive reported a fault or an emergency; value: error code, index: drive.
        DriveFault = 5,
        /// A drive left operation enabled, rebooted or does not get there; value: state, index: drive.
        DriveNotEnabled = 6,
        /// A bus went off, stalled or down; value: [`super::BusHealth`], index: bus.
        BusUnhealthy = 7,
        /// A number that is not finite; index: 0 sensor, 1 estimate, 2 controller.
        NotFinite = 8,
        /// A leg is tilted beyond the limit; value: angle in rad.
        TiltLimit = 9,
        /// A rate is beyond the limit; value: rad/s.
        RateLimit = 10,
        /// The estimator lost the robot; value: innovation in rad.
        EstimateLost = 11,
        /// Ticks came late too often; value: periods skipped.
        Overrun = 12,
        /// The controller asked for far more torque than allowed; value: Nm.
        TorqueDemand = 13,
        /// Real time is not granted, so the robot may not be armed; value: bit set of what is missing.
        NotRealTime = 14,
        /// A panic or an exit on the way; torque was zeroed.
        Stopping = 15,
        /// A sensor reads beyond its possible range; index: which, value: reading.
        OutOfRange = 16,
        /// It is not known where a drive's zero is, so the robot may not be armed; index: drive, value: `ZeroState`.
        ZeroUnknown = 17,
        /// A toe did not find its stop within its stroke; index: drive.
        HomingFailed = 18,
        /// Fell forwards out of a walk: the stance leg leans beyond the limit; value: angle in rad.
        FellForward = 19,
        /// Fell backwards out of a walk: a step too slow to pass the vertical; value: angle in rad.
        FellBackward = 20,
        /// Fell while it was in doubt which leg stands; value: share of the weight on the other foot.
        StanceLost = 21,
        /// Both spring sensors of a leg are stuck, so its landing would not be noticed; index: 0 inner, 1 outer.
        ToesBlind = 22,
        /// A limit at work: torque is saturated; value: Nm asked.
        TorqueLimited = 96,
        /// A limit at work: torque rate is limited; value: Nm/s asked.
        TorqueRateLimited = 97,
        /// Ticks are late; phase-sensitive terms are off until 32 clean ticks.
        Late = 98,
        /// A toe that bears nothing does not go where it is sent; value: m off its place, index: drive.
        ToeAstray = 99,
    }
}

impl FaultCode {
    /// A run ends so when all is well: somebody let the switch go, or asked the program to stop.
    #[must_use]
    pub const fn is_ordinary_end(self) -> bool {
        matches!(self, Self::Stopping | Self::DeadManReleased)
    }
}

message! {
    /// A fault with its values.
    pub struct Fault {
        /// What.
        pub code: FaultCode,
        /// Which drive, bus or source, see [`FaultCode`].
        pub index: u8,
        /// When.
        pub stamp: Stamp,
        /// The offending value, unit by code.
        pub value: f64,
    }
}

impl fmt::Display for Fault {
    /// The code's name, and in words what its index and value mean. Not for the real-time threads.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { code, index, value, .. } = *self;
        let number = usize::from(index);
        let drive = Drive::ALL.get(number).map_or("?", |drive| drive.words());
        let whole = value as u32;
        f.write_str(code.name())?;
        match code {
            FaultCode::OperatorStale | FaultCode::ImuStale => write!(f, ": silent for {value:.1} ms"),
            FaultCode::DriveStale => write!(f, ": drive {drive} silent for {value:.1} ms"),
            FaultCode::DriveFault => write!(f, ": drive {drive} reports error {whole:#06x}"),
            FaultCode::DriveNotEnabled => {
                let state = DriveState::ALL.iter().find(|state| **state as u32 == whole);
                write!(f, ": drive {drive} is in state {}", state.map_or("?", |state| state.name()))
            }
            FaultCode::BusUnhealthy => {
                let health = BusHealth::ALL.iter().find(|health| **health as u32 == whole);
                write!(f, ": bus {index} is {}", health.map_or("?", |health| health.name()))
            }
            FaultCode::NotFinite => {
                let source = ["sensor", "estimate", "controller"].get(number).unwrap_or(&"?");
                write!(f, ": a number of the {source}")
            }
            FaultCode::TiltLimit | FaultCode::FellForward | FaultCode::FellBackward => {
                write!(f, ": {:.1} deg", value.to_degrees())
            }
            FaultCode::RateLimit => write!(f, ": {value:.2} rad/s"),
            FaultCode::EstimateLost => write!(f, ": innovation {value:.4} rad"),
            FaultCode::Overrun | FaultCode::Late => write!(f, ": {value} periods skipped"),
            FaultCode::TorqueDemand | FaultCode::TorqueLimited => write!(f, ": {value:.1} Nm asked"),
            FaultCode::TorqueRateLimited => write!(f, ": {value:.0} Nm/s asked"),
            FaultCode::NotRealTime => write!(f, ": missing, by bit: {whole:#b}"),
            FaultCode::OutOfRange => {
                let sensor = ["leg angle", "hip angle"].get(number).unwrap_or(&"?");
                write!(f, ": {sensor} {value:.3} rad")
            }
            FaultCode::ZeroUnknown | FaultCode::HomingFailed => write!(f, ": drive {drive}"),
            FaultCode::StanceLost => write!(f, ": {:.0} % of the weight on the other foot", 100.0 * value),
            FaultCode::ToesBlind => {
                let leg = Leg::ALL.get(number).map_or("?", |leg| leg.name());
                write!(f, ": both toes of leg {leg}")
            }
            FaultCode::ToeAstray => write!(f, ": drive {drive} is {:.1} mm off its place", 1e3 * value),
            FaultCode::None | FaultCode::DeadManReleased | FaultCode::Stopping => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_says_in_words_what_its_numbers_mean() {
        let told = |code, index, value| Fault { code, index, value, ..Fault::default() }.to_string();
        assert_eq!(told(FaultCode::DriveFault, 3, f64::from(0x8130)), "DriveFault: drive outer A reports error 0x8130");
        assert_eq!(
            told(FaultCode::DriveNotEnabled, 0, 3.0),
            format!("DriveNotEnabled: drive hip is in state {}", DriveState::ALL[3].name())
        );
        assert_eq!(told(FaultCode::ImuStale, 0, 12.34), "ImuStale: silent for 12.3 ms");
        assert_eq!(told(FaultCode::TiltLimit, 0, -0.5), "TiltLimit: -28.6 deg");
        assert_eq!(told(FaultCode::DriveStale, 9, f64::NAN), "DriveStale: drive ? silent for NaN ms");
        assert_eq!(told(FaultCode::DeadManReleased, 0, 0.0), "DeadManReleased");
    }
}
