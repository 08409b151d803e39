//! Numbered faults. Numbers are public and stable: 1.. faults (latched, torque zero), 96.. limits that are active
//! (told, not latched). RT: yes.

use super::reflect::{message, wire_enum};
use crate::base::time::Stamp;
use iceoryx2::prelude::ZeroCopySend;

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
