//! Configuration after all checks: domains hold, names resolve, nothing is missing. RT: read only.

pub use super::drives::{Cia402, Claim, DriveProtocol, Mit, MitDialect, Moteus, Odrive, OdriveFirmware, Traffic};
pub use super::lidar::{Lidar, LidarLink, LidarMount};
pub use super::mocap::{Mocap, MocapSource};
pub use super::operator::{Heartbeat, Operator, OperatorDevice, OperatorRemote, OperatorSpeed, Stick};

use super::fault::Injection;
use crate::base::can_time::BitRates;
use crate::base::time::Span;
use crate::msg::{BUSES, DRIVES, TOES};

/// The whole configuration.
#[derive(Clone, Debug, PartialEq)]
pub struct Config {
    /// The machine: model, drives, sensors, limits.
    pub robot: Robot,
    /// Threads and timing.
    pub real_time: RealTime,
    /// Controller, observer and their weights.
    pub control: Control,
    /// The simulated robot and its imperfections.
    pub simulation: Simulation,
}

/// A number that may be identified: value, bounds, unit, where it is from, whether identification may change it.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Value in `unit`.
    pub value: f64,
    /// Lowest plausible value.
    pub min: f64,
    /// Highest plausible value.
    pub max: f64,
    /// Unit as written, such as `kg` or `1`.
    pub unit: String,
    /// Where the value is from.
    pub source: String,
    /// Identification may change it.
    pub free: bool,
}

/// The machine.
#[derive(Clone, Debug, PartialEq)]
pub struct Robot {
    /// Equations' parameters.
    pub model: Model,
    /// Hip drive train.
    pub hip: Hip,
    /// Toe actuators (all four alike).
    pub toe: Toe,
    /// The five drives in the order of [`crate::msg::Drive`].
    pub drives: [DriveConfig; DRIVES],
    /// The two buses.
    pub buses: [BusConfig; BUSES],
    /// The IMU on the inner leg.
    pub imu: Imu,
    /// Limits that safety holds.
    pub limits: Limits,
    /// Where the dead-man switch is.
    pub operator: Operator,
    /// The stick beside it that asks for the walking speed, if there is one.
    pub operator_speed: Option<OperatorSpeed>,
    /// The laser scanner that sees the floor, if there is one.
    pub lidar: Option<Lidar>,
    /// Ground truth for recordings, if there is motion capture.
    pub mocap: Option<Mocap>,
}

impl Robot {
    /// True if no bus is real: then no motor can move.
    #[must_use]
    pub fn is_simulated(&self) -> bool {
        self.buses.iter().all(|bus| bus.backend == BusBackend::Mock)
    }

    /// True if motors are real, and the hand on the dead-man switch or the attitude is not.
    #[must_use]
    pub fn has_made_up_senses(&self) -> bool {
        let made_up_lidar = self.lidar.as_ref().is_some_and(|lidar| lidar.link == LidarLink::Mock);
        let made_up = self.operator == Operator::Simulated || self.imu.backend == SerialBackend::Mock || made_up_lidar;
        !self.is_simulated() && made_up
    }
}

/// Parameters of the compass gait (model notes, section 2). Leg 1 = inner.
#[derive(Clone, Debug, PartialEq)]
pub struct Model {
    /// Leg length l, m.
    pub leg_length_m: Parameter,
    /// Total mass m_t, kg.
    pub total_mass_kg: Parameter,
    /// Gravity, m/s^2.
    pub gravity_m_s2: Parameter,
    /// c1 to c6 for inner stance, without unit.
    pub c: [Parameter; 6],
    /// Viscous friction of the hip at the joint, Nm s/rad.
    pub viscous_nm_s_rad: Parameter,
    /// Coulomb friction of the hip at the joint, Nm.
    pub coulomb_nm: Parameter,
    /// Hip compliance, if the model of controller and observer knows it.
    pub hip_elasticity: Option<HipElasticity>,
}

/// Compliance of the harmonic drive (model notes, section 6), at the joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HipElasticity {
    /// Spring between rotor and legs, Nm/rad.
    pub stiffness_nm_rad: f64,
    /// Damper beside the spring, Nm s/rad.
    pub damping_nm_s_rad: f64,
    /// Rotor inertia reflected to the joint, kg m^2.
    pub rotor_inertia_kg_m2: f64,
}

/// Hip motor, gear and encoder.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Hip {
    /// Gear ratio (30 for the harmonic drive).
    pub gear_ratio: f64,
    /// Share of the motor's torque that reaches the joint.
    pub gear_efficiency: f64,
    /// +1 or -1: sense of positive motor torque seen from + on inner.
    pub motor_sign: f64,
    /// Quadrature counts of the joint-side encoder per turn of the joint.
    pub encoder_counts_per_turn: f64,
    /// Hip angle at encoder count zero, rad.
    pub encoder_offset_rad: f64,
}

/// Toe actuator: lead screw with a one-sided preloaded series spring (thesis 2.2.1).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Toe {
    /// Stroke, m: 0 retracted, `stroke_m` fully out.
    pub stroke_m: f64,
    /// Fastest travel, m/s.
    pub rate_limit_m_s: f64,
    /// Largest acceleration of the screw, m/s².
    pub acceleration_limit_m_s2: f64,
    /// What both screws of a leg push with at most, N.
    pub force_limit_n: f64,
    /// Encoder counts per m of travel.
    pub counts_per_m: f64,
    /// Series spring, N/m.
    pub spring_n_m: f64,
    /// Its preload against the stop, N.
    pub preload_n: f64,
    /// Counts of the drive's analogue input per m of the spring's potentiometer.
    pub pot_counts_per_m: f64,
    /// Noise of the spring's potentiometer, m.
    pub pot_noise_m: f64,
    /// Length commanded to a stance toe, m.
    pub extended_m: f64,
    /// Length commanded to a swing toe, m.
    pub retracted_m: f64,
    /// Speed at which a toe looks for its retracted stop, m/s.
    pub homing_rate_m_s: f64,
    /// Torque that its drive may use then, 1/1000 of rated.
    pub homing_torque_permille: u16,
}

/// Protocol mode of a drive.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DriveMode {
    /// Torque: CiA 402 cyclic synchronous (10) or profile torque (4), or the like.
    CyclicTorque,
    /// Position: CiA 402 cyclic synchronous (8), or the like.
    CyclicPosition,
}

/// One drive.
#[derive(Clone, Debug, PartialEq)]
pub struct DriveConfig {
    /// What it speaks.
    pub protocol: DriveProtocol,
    /// Index of its bus.
    pub bus: usize,
    /// Its number on the bus: CANopen node 1 to 126, MIT motor id, ODrive node 0 to 62, moteus id.
    pub node: u8,
    /// What it follows.
    pub mode: DriveMode,
    /// Rated torque, Nm, at the shaft that the drive's torque is of (CiA 402: object 0x6076).
    pub rated_torque_nm: f64,
    /// Torque limit, 1/1000 of rated (0x6072).
    pub max_torque_permille: u16,
    /// Served every n-th cycle (1 = each): PDOs at every n-th SYNC, or commands to others.
    pub sync_divisor: u8,
    /// The drive says something at least so often: its heartbeat, or its answers to our commands. Silent for three
    /// times that, it is lost.
    pub heartbeat: Span,
    /// The drive stops its motor when it has not heard us for so long. Written into CiA 402 and moteus drives; of MIT
    /// and ODrive drives what is set in the drive.
    pub watchdog: Span,
}

/// What carries the frames.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BusBackend {
    /// The simulated robot in this process.
    Mock,
    /// A SocketCAN interface.
    SocketCan(String),
}

/// One bus.
#[derive(Clone, Debug, PartialEq)]
pub struct BusConfig {
    /// Backend.
    pub backend: BusBackend,
    /// Bit rate, bit/s: for the time model and to check the link.
    pub bitrate: u32,
    /// Bit rate of the data of CAN-FD frames, bit/s; `None` on a classic bus.
    pub data_bitrate: Option<u32>,
    /// A bus on which none of our frames comes back is noticed to be stalled within this time.
    pub echo_timeout: Span,
}

impl BusConfig {
    /// Both bit rates.
    #[must_use]
    pub const fn rates(&self) -> BitRates {
        BitRates { nominal: self.bitrate, data: self.data_bitrate }
    }
}

/// Which message the IMU streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuMessage {
    /// 0xC2: acceleration and rate, up to 1000 Hz; attitude is then our own filter's.
    AccelRate,
    /// 0xCF: Euler angles and rate, up to 500 Hz (limit of the device for orientation).
    EulerRate,
}

/// What the IMU speaks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ImuProtocol {
    /// The single-byte protocol of the 3DM-GX3-25.
    Gx3,
    /// MicroStrain MIP: what followed it.
    Mip,
}

/// What carries the IMU's bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum SerialBackend {
    /// The simulated IMU in this process.
    Mock,
    /// A device path.
    Device(String),
}

/// The IMU.
#[derive(Clone, Debug, PartialEq)]
pub struct Imu {
    /// Backend.
    pub backend: SerialBackend,
    /// What it speaks.
    pub protocol: ImuProtocol,
    /// Baud rate.
    pub baud: u32,
    /// Streamed message.
    pub message: ImuMessage,
    /// Samples per second.
    pub rate_hz: u32,
    /// +1 or -1: sense of the device's pitch seen from the leg angle.
    pub sign: f64,
    /// Leg angle at pitch zero, rad.
    pub offset_rad: f64,
    /// From the measurement to its stamp: what the device takes before it sends.
    pub latency: Span,
}

/// Limits that safety holds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Limits {
    /// Hip torque at the joint, Nm.
    pub hip_torque_nm: f64,
    /// Change of the hip torque, Nm/s.
    pub hip_torque_rate_nm_s: f64,
    /// A controller that asks for more than so many times the torque limit is broken.
    pub demand_factor: f64,
    /// Stance leg tilt, rad.
    pub tilt_rad: f64,
    /// Swing leg angle, rad.
    pub swing_rad: f64,
    /// Any leg rate, rad/s.
    pub rate_rad_s: f64,
    /// Innovation of the observer, rad.
    pub innovation_rad: f64,
    /// IMU age.
    pub imu_age: Span,
    /// Drive feedback age; one PDO period of the hip is added, two of a toe.
    pub drive_age: Span,
    /// Operator age.
    pub operator_age: Span,
    /// Time in which drives must get enabled.
    pub enable_timeout: Span,
    /// Torque ramps from zero over this time after arming.
    pub ramp: Span,
    /// Skipped periods within one second that latch a fault.
    pub overruns_per_s: u32,
    /// Above this tilt at the start arming is refused, rad.
    pub arm_tilt_rad: f64,
}

/// Scheduling of one thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thread {
    /// SCHED_FIFO priority 1 to 98, 0 = ordinary scheduling.
    pub priority: u8,
    /// Core, if pinned.
    pub core: Option<usize>,
    /// Stack to reserve and touch, bytes.
    pub stack_bytes: usize,
}

/// What starts a tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Trigger {
    /// The absolute timer alone: snapshot of what is there, one period of delay by construction.
    Timer,
    /// The timer sends SYNC; the step runs as soon as the last expected frame is in, at the latest at the deadline.
    Input,
}

/// Who takes the input from the wires.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// A thread per device, which hands over to the control thread.
    Threads,
    /// The control thread sleeps on the devices itself: one wake-up from frame to command.
    Inline,
    /// The control thread spins on the devices: none, at the price of a core. Wants a core of its own.
    Busy,
}

/// Threads and timing.
#[derive(Clone, Debug, PartialEq)]
pub struct RealTime {
    /// Period of the control thread.
    pub period: Span,
    /// What starts a tick.
    pub trigger: Trigger,
    /// Who takes the input from the wires.
    pub input: Input,
    /// With [`Trigger::Input`]: step at the latest so long after the period's start.
    pub input_deadline: Span,
    /// Control thread.
    pub control: Thread,
    /// I/O thread of each bus.
    pub bus: [Thread; BUSES],
    /// I/O thread of the IMU.
    pub imu: Thread,
    /// Lock and prefault memory.
    pub lock_memory: bool,
    /// Hold /dev/cpu_dma_latency at 0.
    pub hold_cpu_awake: bool,
    /// Ticks that the flight recorder keeps.
    pub flight_recorder_ticks: usize,
}

impl RealTime {
    /// The thread of a simulated robot: as urgent as the most urgent bus, because the hardware that it stands for would
    /// not wait for other work of this machine either.
    #[must_use]
    pub fn simulated_robot(&self) -> Thread {
        let priority = self.bus.iter().map(|bus| bus.priority).max().unwrap_or(0);
        Thread { priority, core: None, stack_bytes: 512 * 1024 }
    }
}

/// Which controller runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ControllerKind {
    /// Zero torque.
    Idle,
    /// Holds the hip angle it found with a spring and a damper.
    Hold,
    /// LQR balance on the stance leg.
    Balance,
    /// Stands, steps in, walks at a commanded speed, stops.
    Walk,
    /// The same, walking by virtual constraints (thesis 4.1).
    VirtualConstraint,
    /// The same, walking by transverse stabilisation of a plan (thesis 4.7).
    Transverse,
    /// Balances, makes one planned step by TVLQR (thesis 4.5), balances.
    Tvlqr,
    /// Recovers balance along a hybrid LQR-tree (thesis 4.6).
    LqrTree,
}

impl ControllerKind {
    /// It follows a plan.
    #[must_use]
    pub const fn follows_plan(self) -> bool {
        matches!(self, Self::Transverse | Self::Tvlqr)
    }

    /// It makes steps that are asked for, and so needs the ground.
    #[must_use]
    pub const fn walks(self) -> bool {
        matches!(self, Self::Walk | Self::VirtualConstraint | Self::Transverse | Self::Tvlqr)
    }
}

/// A plan that a controller follows, as text: a recording holds it.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Plan {
    /// What errors call it.
    pub name: String,
    /// Text of the plan file; empty if the controller follows none.
    pub text: String,
}

/// Controller and observer.
#[derive(Clone, Debug, PartialEq)]
pub struct Control {
    /// Which one.
    pub controller: ControllerKind,
    /// The leg that stands at the start.
    pub stance: crate::msg::Leg,
    /// Observer's epsilon, s (thesis 4.17, corrected).
    pub observer_epsilon_s: f64,
    /// Time constant with which the attitude's bias is learnt, s; 0 = not at all.
    pub bias_time_s: f64,
    /// A momentum that no believable bias explains (a push, a hand that lets go) is not learnt as one.
    pub bias_rejects_pushes: bool,
    /// Leg angle: gyro for motion faster than this, the device's attitude or the accelerometer below, s.
    pub attitude_time_s: f64,
    /// LQR state weights on [theta_s, theta_w, rates].
    pub lqr_q: [f64; 4],
    /// LQR weight of the normalised torque.
    pub lqr_r: f64,
    /// A swing toe's spring that gives way by so much has met the ground, m; 0 = never.
    pub touchdown_spring_m: f64,
    /// Share of the modelled friction that is compensated, 0 to 1.
    pub friction_compensation: f64,
    /// Spring of `hold`, Nm/rad.
    pub hold_stiffness_nm_rad: f64,
    /// Damper of `hold`, Nm s/rad.
    pub hold_damping_nm_s_rad: f64,
    /// When and how fast to walk.
    pub walk: Walk,
    /// Numbers of the hand-made walking law.
    pub foot_placement: FootPlacement,
    /// Numbers of the virtual constraints.
    pub virtual_constraint: VirtualConstraint,
    /// Numbers of transverse stabilisation.
    pub transverse: Transverse,
    /// Numbers of the rebalance by TVLQR.
    pub tvlqr: Tvlqr,
    /// What recovers out of the basin of balance.
    pub recovery: Recovery,
    /// The plan that the controller follows.
    pub plan: Plan,
    /// The tree that it recovers along.
    pub tree: Plan,
}

/// What `walk` is asked for.
#[derive(Clone, Debug, PartialEq)]
pub struct Walk {
    /// Speed, m/s.
    pub speed_m_s: f64,
    /// `[time since arming, speed]`, s and m/s, in rising order: this speed from then on.
    pub speeds: Vec<[f64; 2]>,
    /// It begins so long after arming, s.
    pub start_s: f64,
    /// It stops so long after arming, s.
    pub stop_s: Option<f64>,
    /// Out of the basin of balance it recovers along the tree of the configuration.
    pub recover: bool,
}

impl Walk {
    /// Speed asked for at a time since arming, m/s.
    #[must_use]
    pub fn speed_at_m_s(&self, armed_s: f64) -> f64 {
        let walks = armed_s >= self.start_s && self.stop_s.is_none_or(|stop| armed_s < stop);
        let of_schedule = self.speeds.iter().rev().find(|[from_s, _]| armed_s >= *from_s);
        if walks { of_schedule.map_or(self.speed_m_s, |[_, speed_m_s]| *speed_m_s) } else { 0.0 }
    }
}

/// Numbers of the hand-made walking law.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FootPlacement {
    /// Speed that the other numbers hold for, m/s.
    pub speed_m_s: f64,
    /// To walk so fast this speed is aimed at, m/s.
    pub aimed_m_s: f64,
    /// And so much more for each m/s more.
    pub aimed_per_speed: f64,
    /// Swing angle at touchdown in steady walking, rad.
    pub angle_rad: f64,
    /// What it grows by with the speed that is aimed at, rad per m/s.
    pub angle_per_speed_s_m: f64,
    /// What is aimed at beyond grows by so much for each m of the way that a step lacks, m/s per m.
    pub faster_per_way_1_s: f64,
    /// Smallest swing angle, rad.
    pub least_angle_rad: f64,
    /// Largest swing angle, rad.
    pub most_angle_rad: f64,
    /// Share of the way from the steady foothold to the one that makes up for all the speed error in a step.
    pub placement_share: f64,
    /// Share of an unexpected gain that is learnt in a step.
    pub learning: f64,
    /// Gain of the squared passing rate in a step that is expected at first, rad²/s².
    pub first_gain: f64,
    /// Before the first step the swing leg is held so far behind, rad: from there it swings forward.
    pub first_back_rad: f64,
    /// Time of the first step's swing, s: the weight that goes forward makes the robot fall forward.
    pub first_swing_s: f64,
    /// Swing angle of the first step, rad.
    pub first_angle_rad: f64,
    /// The swing leg arrives so long before the touchdown, s.
    pub lead_s: f64,
    /// Longest swing, s.
    pub longest_swing_s: f64,
    /// With less than this share of the squared passing rate of the walk that is asked for the swing leg reaches farther ahead
    /// until the vertical is passed.
    pub slow_share: f64,
    /// By so much, rad per rad²/s².
    pub reach_per_energy: f64,
    /// At most by so much, rad.
    pub reach_most_rad: f64,
    /// Shortest swing, s.
    pub shortest_swing_s: f64,
    /// The foothold no longer changes so long before the touchdown, s.
    pub frozen_s: f64,
    /// Rate with which the swing leg goes back at the end, rad/s.
    pub retraction_rad_s: f64,
    /// Bandwidth of the swing leg's tracking, rad/s.
    pub bandwidth_rad_s: f64,
    /// Its damping ratio.
    pub damping_ratio: f64,
    /// How far the swing toe reaches for the ground, m.
    pub toe_reach_m: f64,
    /// Shortest stance toe, m.
    pub toe_least_m: f64,
    /// Length of the stance toe on the mean floor, m.
    pub toe_nominal_m: f64,
    /// Bandwidth of the stance toe's motion, rad/s.
    pub toe_bandwidth_rad_s: f64,
    /// Share of the difference at landing that the stance toe keeps.
    pub toe_kept: f64,
    /// The swing toe reaches from so long before the touchdown on, s,
    pub toe_out_s: f64,
    /// and not before the stance leg leans so far beyond the vertical, rad.
    pub toe_out_rad: f64,
    /// And not before the swing leg has come so far of its way from the vertical to the foothold.
    pub toe_out_share: f64,
    /// Share of a foothold's height that the stance toe takes up.
    pub floor_share: f64,
    /// With each step the footholds before count for so much of what they did, where the floor is and how steep.
    pub floor_memory: f64,
    /// Swing angle at touchdown that is added in steady walking for each rad that the floor goes down, rad/rad.
    pub angle_per_slope: f64,
    /// Push-off of the stance toe, m.
    pub push_m: f64,
    /// Push that is longer for a speed above `speed_m_s`, m per m/s.
    pub push_per_speed_s: f64,
    /// Smallest push-off, m; below zero the toe gives way.
    pub push_least_m: f64,
    /// Largest push-off, m.
    pub push_most_m: f64,
    /// Swing angle of a step backwards, which catches a robot that falls back, rad; 0 = none.
    pub back_rad: f64,
    /// Push-off of the first step, m.
    pub first_push_m: f64,
    /// Lean of the stance leg beyond the vertical from which on it pushes, rad.
    pub push_rad: f64,
}

/// Numbers of the virtual constraints; footholds, stance toe and push-off are [`FootPlacement`]'s.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct VirtualConstraint {
    /// Speed that the angle holds for, m/s.
    pub speed_m_s: f64,
    /// Swing angle at touchdown in steady walking, rad.
    pub angle_rad: f64,
    /// What it grows by with the speed, rad per m/s.
    pub angle_per_speed_s_m: f64,
    /// The curve ends when the stance leg leans forward by this share of the steady swing angle.
    pub arrive_share: f64,
    /// The foothold no longer changes from this phase on.
    pub frozen_phase: f64,
    /// What the third and the fourth point of the curve are moved by, in shares of the way.
    pub bends: [f64; 2],
    /// How the swing angle goes back with the stance angle beyond the curve's end, rad/rad.
    pub retraction: f64,
    /// Bandwidth of the swing leg's tracking, rad/s.
    pub bandwidth_rad_s: f64,
    /// Its damping ratio.
    pub damping_ratio: f64,
    /// Stance angle at which the swing toe is in, rad.
    pub toe_in_rad: f64,
    /// How it goes in with the stance angle before that, m/rad.
    pub toe_in_m_rad: f64,
    /// It goes out when the stance leg leans forward by this share of the aimed swing angle.
    pub toe_out_share: f64,
    /// How it goes out with the stance angle after that, m/rad.
    pub toe_out_m_rad: f64,
    /// Half sine at the start of the swing, m.
    pub nudge_m: f64,
    /// It ends at this phase.
    pub nudge_phase: f64,
    /// What the stance toe is shorter by with the angle from the vertical, m/rad.
    pub arch_m_rad: f64,
}

/// Numbers of transverse stabilisation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Transverse {
    /// It begins at a touchdown whose state has less cost-to-go than this.
    pub join_cost: f64,
    /// It gives up at a touchdown whose state has more.
    pub leave_cost: f64,
    /// A touchdown with less squared passing rate than this is left to foot placement, rad²/s².
    pub least_energy: f64,
    /// Share of the squared passing rate missing at a touchdown that is learnt.
    pub learning: f64,
    /// Feedback comes in over this time after a touchdown, s.
    pub fade_s: f64,
    /// Length of the stance toe, m.
    pub toe_nominal_m: f64,
    /// How far the swing toe reaches for the ground, m.
    pub toe_reach_m: f64,
    /// It reaches from so long before the planned touchdown on, s,
    pub toe_out_s: f64,
    /// and not before the stance leg leans so far beyond the vertical, rad.
    pub toe_out_rad: f64,
    /// Share of the difference at landing that the stance toe keeps.
    pub toe_kept: f64,
    /// Push-off, m.
    pub push_m: f64,
    /// What it grows by with the lack of squared passing rate, m s²/rad².
    pub push_per_energy_m_s2_rad2: f64,
    /// Least push-off, m: below zero it brakes.
    pub push_least_m: f64,
    /// Largest push-off, m.
    pub push_most_m: f64,
    /// Lean of the stance leg beyond the vertical from which on it pushes, rad.
    pub push_rad: f64,
}

/// Numbers of the rebalance by TVLQR.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Tvlqr {
    /// Feedback is faded within this time of the expected touchdown, s.
    pub fade_s: f64,
    /// Length of the stance toe, m.
    pub toe_nominal_m: f64,
    /// How far the swing toe reaches for the ground, m.
    pub toe_reach_m: f64,
    /// It reaches from so long before the planned touchdown on, s.
    pub toe_out_s: f64,
}

/// What recovers out of the basin of balance: the tree, the step that catches, or both.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Recovery {
    /// The tree is taken where a tube holds the state at this share of its level or less; 0 = never.
    pub tube_share: f64,
    /// Where no tube holds, a step catches the robot; false: the nearest branch is followed from however far.
    pub catch: bool,
}

/// The simulated robot. Each imperfection is off when `None` or 0.
#[derive(Clone, Debug, PartialEq)]
pub struct Simulation {
    /// Seed of all noise.
    pub seed: u64,
    /// Initial state: leg angles inner, outer, rad.
    pub initial_angle_rad: [f64; 2],
    /// Initial leg rates, rad/s.
    pub initial_rate_rad_s: [f64; 2],
    /// A hand holds both legs until the hip has pushed with so much, Nm; 0 = nobody holds.
    pub release_torque_nm: f64,
    /// The hand lets go at the latest so long after the hip's drive got its power; zero = it waits for the push.
    pub release_after: Span,
    /// The hand carries the legs, so that they have their initial rates when it lets go, so long after switching on, s. Then
    /// neither torque nor power makes it let go.
    pub carried_until_s: Option<f64>,
    /// Initial stance leg.
    pub stance: crate::msg::Leg,
    /// The world. True: stands on blocks, the swing toe meets no ground (thesis 4.5). False: on the ground.
    pub on_blocks: bool,
    /// The real machine, where it is not what the controller's model (`robot.model`) says.
    pub body: Option<Model>,
    /// The real machine differs from that by up to so much, by the seed; `body` and `friction_scale` are already with it.
    pub model_error: Option<ModelError>,
    /// Compliance of the real hip.
    pub hip_elasticity: Option<HipElasticity>,
    /// Real friction as multiples of the model's: viscous, Coulomb.
    pub friction_scale: [f64; 2],
    /// Blows from outside at the hip, in the order of their times.
    pub pushes: Vec<Push>,
    /// Further ones at random times.
    pub random_pushes: Option<RandomPushes>,
    /// Faults of wires, devices and operator, each with its time.
    pub faults: Vec<Injection>,
    /// First-order lag of the motor's torque, s.
    pub actuator_lag_s: f64,
    /// The hip motor's torque comes so much after its command.
    pub actuator_delay: Span,
    /// Saturation of the motor's torque at the joint, Nm.
    pub torque_limit_nm: Option<f64>,
    /// Friction of the ground; a foot never slips without.
    pub ground_friction: Option<f64>,
    /// Restitution at touchdown.
    pub restitution: f64,
    /// The ground does not pull: a foot that is drawn up leaves it.
    pub lift_off: bool,
    /// The toes' series springs give way.
    pub toe_springs: bool,
    /// Slope of the ground, rad.
    pub ground_slope_rad: f64,
    /// Heights of the floor; level without.
    pub floor: Option<Floor>,
    /// Toe lengths at the start, m.
    pub initial_toe_m: [f64; TOES],
    /// IMU errors.
    pub imu: ImuErrors,
    /// The lidar's errors; it has none without.
    pub lidar: Option<LidarErrors>,
    /// The server of motion capture; a plain one without.
    pub mocap: Option<MocapServer>,
    /// Bus frames take their time on the wire.
    pub bus_timing: bool,
    /// When the simulated operator presses the dead-man switch, s; releases at the second time if given.
    pub operator_press_s: f64,
    /// See `operator_press_s`.
    pub operator_release_s: Option<f64>,
}

/// The floor that the simulated robot walks on: a profile of slopes, tiles of random height and terraces on top.
#[derive(Clone, Debug, PartialEq)]
pub struct Floor {
    /// Length of a tile, m.
    pub tile_m: f64,
    /// Tiles are uniformly within ± this, drawn by the simulation's seed, m.
    pub half_width_m: f64,
    /// The tiles begin so far from the start, m.
    pub level_until_m: f64,
    /// Place and height of each terrace, m, in rising order: this high from there on.
    pub steps: Vec<[f64; 2]>,
    /// Radius of the toes' tips, m.
    pub tip_radius_m: f64,
    /// Place and height, m, in rising order, straight in between; empty: level.
    pub profile: Vec<[f64; 2]>,
}

/// Shares by which the real machine may differ from the model, drawn uniformly by the seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ModelError {
    /// Inertia of either leg about the hip, and of the body.
    pub inertia: f64,
    /// Viscous and Coulomb friction of the hip.
    pub friction: f64,
}

/// A horizontal blow at the hip.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Push {
    /// When, s after switching on.
    pub time_s: f64,
    /// Impulse, N s, + forwards.
    pub impulse_ns: f64,
}

/// Blows at random times, as often in one interval as in any other (Poisson), by the seed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RandomPushes {
    /// Before this there is none, s after switching on.
    pub from_s: f64,
    /// Mean time between two, s.
    pub interval_s: f64,
    /// Impulse of each, N s, + forwards.
    pub impulse_ns: f64,
}

/// Figures of the 3DM-GX3 (thesis 2.1.2).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ImuErrors {
    /// Static error of the attitude, rad (one sigma, drawn once).
    pub static_error_rad: f64,
    /// Error of the attitude in motion, rad (bound, grows with rate).
    pub dynamic_error_rad: f64,
    /// Drift, rad/sqrt(s) random walk.
    pub drift_rad_sqrt_s: f64,
    /// Lag of the attitude, s.
    pub lag_s: f64,
    /// Noise of the rate, rad/s.
    pub rate_noise_rad_s: f64,
    /// Noise of the attitude, rad.
    pub attitude_noise_rad: f64,
    /// Noise of the accelerometer, g.
    pub accel_noise_g: f64,
    /// Delay from measurement to the last byte, s.
    pub latency_s: f64,
}

/// Errors of the simulated lidar.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LidarErrors {
    /// Noise of a distance, m.
    pub noise_m: f64,
    /// All distances are too long by this, m.
    pub offset_m: f64,
    /// Share of beams without a return.
    pub lost_share: f64,
    /// Share of beams that something stands in, at a random part of the distance.
    pub clutter_share: f64,
}

/// The simulated server of motion capture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MocapServer {
    /// Frames per second.
    pub rate_hz: u32,
    /// From the exposure to the datagram.
    pub latency: Span,
    /// Noise of a position, m.
    pub noise_m: f64,
}
