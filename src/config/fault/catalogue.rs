//! The 64 faults of `docs/protocols.md`, section 17: name, where each can be injected, arguments. RT: no.

/// What a fault is a fault of.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Device {
    /// A CAN bus.
    Bus,
    /// A CANopen drive.
    Canopen,
    /// A drive in MIT mode.
    Mit,
    /// An ODrive.
    Odrive,
    /// A moteus.
    Moteus,
    /// The IMU.
    Imu,
    /// The lidar.
    Lidar,
    /// Motion capture.
    Mocap,
    /// The dead-man switch.
    Joystick,
    /// The computer that the controller runs on.
    Host,
}

/// Where a fault can be injected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Place {
    /// `compass sim`: robot and controller in lockstep.
    Sim,
    /// `compass plant`: the simulated robot on real interfaces.
    Plant,
    /// The same robot inside `compass run`, where nobody serves motion capture. No entry of the catalogue names it.
    Run,
    /// The virtual machine of `tests/vm`: kernel, disk, threads, queues.
    Guest,
}

impl Place {
    /// As `--fault list` prints it.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Sim => "sim",
            Self::Plant => "plant",
            Self::Run => "run",
            Self::Guest => "guest",
        }
    }
}

/// One entry of the catalogue.
#[derive(Debug)]
pub struct Entry {
    /// Which.
    pub fault: FaultName,
    /// As typed.
    pub name: &'static str,
    /// Of what.
    pub device: Device,
    /// Where it can be injected.
    pub places: &'static [Place],
    /// The arguments that it takes, with their defaults: `bus=0,for=200ms`.
    pub defaults: &'static str,
    /// Words for `kind`; the first is the default.
    pub kinds: &'static [&'static str],
    /// What happens.
    pub what: &'static str,
}

impl PartialEq for Entry {
    fn eq(&self, other: &Self) -> bool {
        self.fault == other.fault
    }
}

impl Entry {
    /// True if it can be injected there.
    #[must_use]
    pub fn is_for(&self, place: Place) -> bool {
        match place {
            Place::Run => self.places.contains(&Place::Plant) && self.device != Device::Mocap,
            _ => self.places.contains(&place),
        }
    }
}

macro_rules! catalogue {
    ($($fault:ident $name:literal $device:ident [$($place:ident)+] $defaults:literal [$($kind:literal)*] $what:literal)+) => {
        /// Which fault.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum FaultName {
            $(#[doc = $what] $fault,)+
        }

        /// All of them, in the order of the section.
        pub const CATALOGUE: &[Entry] = &[
            $(Entry {
                fault: FaultName::$fault,
                name: $name,
                device: Device::$device,
                places: &[$(Place::$place),+],
                defaults: $defaults,
                kinds: &[$($kind),*],
                what: $what,
            },)+
        ];
    };
}

catalogue! {
    BusOff "bus_off" Bus [Sim Guest] "bus=0,for=200ms" [] "the controller takes itself off the bus"
    NoAcknowledge "no_acknowledge" Bus [Sim] "bus=0,for=200ms" [] "nobody acknowledges: error passive, frames stay in the queue"
    QueueFull "queue_full" Bus [Sim Guest] "bus=0,for=200ms" [] "the queue before the wire takes nothing (ENOBUFS)"
    LinkDown "link_down" Bus [Sim Guest] "bus=0,for=200ms" [] "the interface goes down and comes up"
    FrameErrors "frame_errors" Bus [Sim Plant] "kind=lost,bus=0,share=0.02,late=4ms,for=1s" ["lost" "doubled" "late" "reordered" "flipped"] "received frames are lost, doubled, late, reordered or flipped"
    ForeignTraffic "foreign_traffic" Bus [Sim Plant] "kind=unknown,bus=0,every=2ms,for=1s" ["unknown" "master"] "somebody else sends: unknown identifiers, or a master's SYNC"
    BusLoad "bus_load" Bus [Sim Plant] "kind=low,bus=0,for=1s" ["low" "high"] "the bus is at 100 % load, with low or high priority"
    WrongLength "wrong_length" Bus [Sim Plant] "drive=hip,for=200ms" [] "a drive's process data are a byte short"
    StaleQueue "stale_queue" Bus [Sim Guest] "bus=0,for=500ms" [] "drives without power; the queue is played to them when it comes back"

    BootUp "boot_up" Canopen [Sim Plant] "drive=hip" [] "a drive restarts in operation"
    Emergency "emergency" Canopen [Sim Plant] "drive=hip,code=0x2310" [] "a drive shouts an emergency, then is in fault"
    HeartbeatStops "heartbeat_stops" Canopen [Sim Plant] "drive=hip,for=500ms" [] "a drive sends no heartbeat and answers on"
    ObjectServer "object_server" Canopen [Sim Plant] "kind=silent,drive=hip,for=1s" ["silent" "abort" "wrong_index"] "a restarted drive's object server aborts, is silent, or answers another index"
    RefusesTorqueMode "refuses_torque_mode" Canopen [Sim Plant] "drive=hip,for=1s" [] "a restarted drive does not know its mode"
    StatuswordStuck "statusword_stuck" Canopen [Sim Plant] "kind=no_power,drive=hip,for=2s" ["no_power" "stuck"] "a drive shows the last statusword, without power or with it"
    MappingLost "mapping_lost" Canopen [Sim Plant] "kind=answer,drive=hip,for=2s" ["answer" "command"] "a drive falls back to its default mapping of process data"
    TwoNodes "two_nodes" Canopen [Sim Plant] "drive=hip,for=500ms" [] "two drives answer to one number"

    MitWrongId "mit_wrong_id" Mit [Sim Plant] "drive=hip,for=500ms" [] "byte 0 of the answers is another motor's number"
    MitReplyLength "mit_reply_length" Mit [Sim Plant] "drive=hip,for=500ms" [] "answers have another length than the dialect's"
    MitPositionWrap "mit_position_wrap" Mit [Sim Plant] "drive=hip,for=500ms" [] "the position wraps round at the end of its range"
    MitWrongRanges "mit_wrong_ranges" Mit [Sim Plant] "kind=torque,drive=hip,for=500ms" ["torque" "motor"] "a restarted motor works with other ranges: of torque alone, or another motor's"
    MitEnterKick "mit_enter_kick" Mit [Sim Plant] "drive=hip" [] "a motor without power holds an old command of full torque when it is entered"
    MitNoZero "mit_no_zero" Mit [Sim Plant] "drive=hip" [] "a restarted motor has forgotten its zero"

    OdriveError "odrive_error" Odrive [Sim Plant] "drive=hip,code=8" [] "an error in the heartbeat"
    OdriveWatchdog "odrive_watchdog" Odrive [Sim Plant] "drive=hip" [] "the watchdog puts it into state 1"
    OdriveDialect "odrive_dialect" Odrive [Sim Plant] "drive=hip,for=500ms" [] "a restarted drive speaks the other firmware's dialect"
    OdriveNoEncoder "odrive_no_encoder" Odrive [Sim Plant] "drive=hip,for=500ms" [] "the encoder message stops while the heartbeat goes on"

    MoteusTimedOut "moteus_timed_out" Moteus [Sim Plant] "drive=hip" [] "mode 11 latched"
    MoteusFault "moteus_fault" Moteus [Sim Plant] "drive=hip,code=33" [] "a fault code"
    MoteusNotSet "moteus_not_set" Moteus [Sim Plant] "drive=hip,for=500ms" [] "the position is not set (NaN)"
    MoteusNoReply "moteus_no_reply" Moteus [Sim Plant] "drive=hip,for=500ms" [] "it acts but does not reply"
    MoteusReadError "moteus_read_error" Moteus [Sim Plant] "drive=hip,for=500ms" [] "it answers reads with an error sub-frame"

    ImuBytes "imu_bytes" Imu [Sim Plant] "kind=lost,share=0.0005,for=1s" ["lost" "inserted" "flipped"] "bytes of the serial line are lost, inserted or flipped"
    ImuBursts "imu_bursts" Imu [Sim Plant] "for=1s" [] "the adapter delivers every 16 ms"
    ImuStall "imu_stall" Imu [Sim Plant] "for=200ms" [] "the stream stops"
    ImuTimerWrap "imu_timer_wrap" Imu [Sim Plant] "" [] "the device's timer wraps round"
    ImuWrongBaud "imu_wrong_baud" Imu [Sim Plant] "for=500ms" [] "the line's rate is another: garbage"
    ImuNan "imu_nan" Imu [Sim Plant] "for=100ms" [] "messages with sound checksums carry NaN"
    ImuReplug "imu_replug" Imu [Sim Plant] "for=500ms" [] "the USB adapter goes and comes back under another name"

    LidarCheck "lidar_check" Lidar [Sim Plant] "share=0.1,for=1s" [] "check sums are wrong"
    LidarSplit "lidar_split" Lidar [Sim Plant] "for=1s" [] "lines are split across segments"
    LidarNotReady "lidar_not_ready" Lidar [Sim Plant] "for=1s" [] "status 0E instead of a scan"
    LidarLaserOff "lidar_laser_off" Lidar [Sim Plant] "for=1s" [] "status 10: the laser is off"
    LidarHardware "lidar_hardware" Lidar [Sim Plant] "for=1s" [] "status 50: hardware failure"
    LidarHalfOpen "lidar_half_open" Lidar [Sim Plant] "for=1s" [] "the connection is half open: nothing comes, nothing ends"
    LidarTimeWrap "lidar_time_wrap" Lidar [Sim Plant] "" [] "the 24-bit time stamp wraps round"

    MocapUntracked "mocap_untracked" Mocap [Sim Plant] "for=1s" [] "the tracking flag is 0"
    MocapFrozen "mocap_frozen" Mocap [Sim Plant] "for=1s" [] "the pose is frozen though the flag is 1"
    MocapGaps "mocap_gaps" Mocap [Sim Plant] "share=0.2,for=1s" [] "frames are missing"
    MocapReordered "mocap_reordered" Mocap [Sim Plant] "share=0.2,for=1s" [] "frames come out of order"
    MocapSection "mocap_section" Mocap [Sim Plant] "for=1s" [] "a section that nobody knows"
    MocapVersion "mocap_version" Mocap [Sim Plant] "for=1s" [] "the server speaks the other version"
    MocapClockJump "mocap_clock_jump" Mocap [Sim Plant] "" [] "the server's clock jumps"

    JoystickUnplugged "joystick_unplugged" Joystick [Sim] "for=500ms" [] "the device is gone, then back"
    JoystickDropped "joystick_dropped" Joystick [Sim] "for=500ms" [] "SYN_DROPPED: events were lost, the release among them"
    JoystickHeldAtStart "joystick_held_at_start" Joystick [Sim] "" [] "the key is held when the program starts"
    JoystickAxisStuck "joystick_axis_stuck" Joystick [Sim] "for=1s" [] "an axis is stuck at its end"
    JoystickWirelessHold "joystick_wireless_hold" Joystick [Sim] "for=1s" [] "the receiver repeats the last state of a dead link"

    StepOverrun "step_overrun" Host [Sim Guest] "kind=many,late=20ms,for=1s" ["many" "once"] "control steps come late: once, or ten times a second"
    DiskFull "disk_full" Host [Guest] "" [] "no room on the recording's disk"
    LogStalled "log_stalled" Host [Guest] "" [] "the recorder's thread stands still"
    ClockStep "clock_step" Host [Guest] "" [] "the wall clock steps"
    MemoryPressure "memory_pressure" Host [Guest] "" [] "the machine runs out of memory"
    ThreadKilled "thread_killed" Host [Guest] "" [] "a thread of the controller panics"
}
