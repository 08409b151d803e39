//! The simulated robot as the outside sees it: two CAN wires and a serial line, in its own time.
//!
//! Time moves from event to event: the end of a frame, a measurement of the IMU, the time asked for. The world is
//! brought up to each event that looks at it or changes what the motors do. RT: no.

use super::drive::{Electrics, SimDrive};
use super::imu::SimImu;
use super::lidar::SimLidar;
use super::mocap::SimMocap;
use super::noise::Noise;
use super::pushes::Pushes;
use super::trouble::Schedule;
use super::trouble::wires::{HostEnd, Stranger};
use super::wire::{Delivered, Wire};
use super::{Reading, World};
use crate::base::time::{Span, Stamp};
use crate::bus::canopen::Object;
use crate::bus::cia402::State;
use crate::config::checked::{Config, DriveConfig, Hip, Robot, Simulation, Toe};
use crate::msg::{BUSES, BusFrame, BusHealth, CanFrame, DRIVES, Drive, FrameBatch, TOES};

/// The controller's place among the senders of a wire; drive k is sender k + 1.
pub(super) const HOST: usize = 0;
/// The place of somebody who does not belong there.
pub(super) const STRANGER: usize = DRIVES + 1;
/// Drives look after their timers so often.
const DRIVE_TICK: Span = Span::from_ms(1);
/// The world is not moved for less: at 10 rad/s a leg moves a fifth of an encoder count in it.
const GRAIN: Span = Span::from_us(5);
/// The world is moved at least so often.
const LONGEST_STEP: Span = Span::from_ms(1);

/// Makes the potentiometers' noise another stream than the IMU's.
const POT_STREAM: u64 = 0x706F_7400;

/// How long commands of the controller had waited when a drive that had power took them from the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Waited {
    /// The longest of all.
    pub longest: Span,
    /// Longest time that one was followed which had waited for longer than the drive's watchdog.
    pub followed_old: Span,
    old_since: Option<Stamp>,
}

impl Waited {
    /// A command has come, or the drive has no power any more.
    fn end_old(&mut self, at: Stamp) {
        if let Some(since) = self.old_since.take() {
            self.followed_old = self.followed_old.max(at.since(since));
        }
    }

    fn note(&mut self, at: Stamp, waited: Span, watchdog: Span) {
        self.longest = self.longest.max(waited);
        self.old_since = (waited > watchdog).then_some(at);
    }
}

/// The simulated robot.
pub struct Plant {
    pub(super) now: Stamp,
    world: Box<dyn World>,
    world_time: Stamp,
    /// What the world shows at `world_time`.
    reading: Reading,
    units: Units,
    pub(super) bus_of: [usize; DRIVES],
    nodes: [u8; DRIVES],
    pub(super) drives: Vec<SimDrive>,
    pub(super) wires: Vec<Wire>,
    next_drive_tick: Stamp,
    release_after: Span,
    hip_powered_since: Option<Stamp>,
    pushes: Pushes,
    pub(super) imu: SimImu,
    pub(super) lidar: Option<SimLidar>,
    pub(super) mocap: Option<SimMocap>,
    pot_noise: Noise,
    echo: bool,
    pub(super) hosts: Vec<HostEnd>,
    pub(super) strangers: [Option<Stranger>; BUSES],
    troubles: Schedule,
    waited: [Waited; DRIVES],
    watchdogs: [Span; DRIVES],
    answers: Vec<CanFrame>,
}

/// Factors between the drives' units and the world's.
#[derive(Clone, Copy, Debug)]
struct Units {
    hip: Hip,
    toe: Toe,
    joint_nm_per_permille: f64,
}

impl Units {
    fn new(robot: &Robot) -> Self {
        let joint_nm_at_rated = robot.drives[Drive::Hip as usize].rated_torque_nm
            * robot.hip.gear_ratio
            * robot.hip.gear_efficiency
            * robot.hip.motor_sign;
        Self { hip: robot.hip, toe: robot.toe, joint_nm_per_permille: joint_nm_at_rated / 1000.0 }
    }

    /// Quadrature counts of the encoder at the hip joint.
    #[expect(clippy::cast_possible_truncation, reason = "some turns of a joint")]
    fn hip_counts(&self, angle_rad: f64) -> i32 {
        let turns = (angle_rad - self.hip.encoder_offset_rad) / std::f64::consts::TAU;
        libm::floor(turns * self.hip.encoder_counts_per_turn) as i32
    }

    #[expect(clippy::cast_possible_truncation, reason = "a stroke of some centimetres")]
    fn toe_counts(&self, length_m: f64) -> i32 {
        libm::floor(length_m * self.toe.counts_per_m + 0.5) as i32
    }

    #[expect(clippy::cast_possible_truncation, reason = "the input saturates, as a converter does")]
    fn pot_counts(&self, compression_m: f64) -> i16 {
        libm::floor(compression_m * self.toe.pot_counts_per_m + 0.5) as i16
    }
}

/// What the drive can do, from the joint's limit.
fn electrics(config: &DriveConfig, index: usize, units: &Units, simulation: &Simulation) -> Electrics {
    let limit_permille = if index == Drive::Hip as usize {
        simulation.torque_limit_nm.map_or(f64::INFINITY, |nm| nm / units.joint_nm_per_permille.abs())
    } else {
        f64::from(config.max_torque_permille)
    };
    Electrics { lag_s: simulation.actuator_lag_s, delay: simulation.actuator_delay, limit_permille }
}

impl Plant {
    /// The robot with this world, switched on at time zero.
    #[must_use]
    pub fn with_world(config: &Config, world: Box<dyn World>) -> Self {
        let robot = &config.robot;
        let units = Units::new(robot);
        let drives = robot
            .drives
            .iter()
            .enumerate()
            .map(|(index, drive)| SimDrive::new(drive, electrics(drive, index, &units, &config.simulation)));
        let timed = config.simulation.bus_timing;
        let reading = world.reading();
        let mut plant = Self {
            now: Stamp::default(),
            world,
            world_time: Stamp::default(),
            reading,
            units,
            bus_of: std::array::from_fn(|k| robot.drives[k].bus),
            nodes: std::array::from_fn(|k| robot.drives[k].node),
            drives: drives.collect(),
            wires: robot.buses.iter().map(|b| Wire::new(b.rates(), timed, STRANGER + 1)).collect(),
            next_drive_tick: Stamp::default(),
            release_after: config.simulation.release_after,
            hip_powered_since: None,
            pushes: Pushes::new(&config.simulation),
            imu: SimImu::new(&robot.imu, &config.simulation.imu, config.simulation.seed),
            lidar: robot
                .lidar
                .as_ref()
                .map(|lidar| SimLidar::new(lidar, config.simulation.lidar.as_ref(), config.simulation.seed)),
            mocap: robot
                .mocap
                .as_ref()
                .map(|mocap| SimMocap::new(mocap, config.simulation.mocap.as_ref(), config.simulation.seed)),
            pot_noise: Noise::new(config.simulation.seed ^ POT_STREAM),
            echo: true,
            hosts: (0..BUSES).map(|bus| HostEnd::new(config.simulation.seed, bus)).collect(),
            strangers: [const { None }; BUSES],
            troubles: Schedule::of(&config.simulation.faults, false),
            waited: [Waited::default(); DRIVES],
            watchdogs: std::array::from_fn(|k| robot.drives[k].watchdog),
            answers: Vec::new(),
        };
        plant.imu.prepare(&config.simulation.faults);
        if let Some(lidar) = &mut plant.lidar {
            lidar.prepare(&config.simulation.faults);
        }
        plant.boot_drives(Stamp::default());
        plant
    }

    /// Starts at another time than zero: a clock that has been running.
    pub fn start_at(&mut self, now: Stamp) {
        self.now = now;
        self.world_time = now;
        self.next_drive_tick = now;
        self.troubles.start_at(now);
        self.lidar.iter_mut().for_each(|lidar| lidar.start_at(now));
        self.mocap.iter_mut().for_each(|mocap| mocap.start_at(now));
        self.pushes.start_at(now);
        self.boot_drives(now);
    }

    /// All drives get their power: each counts from where its shaft stands.
    fn boot_drives(&mut self, now: Stamp) {
        for index in 0..DRIVES {
            let counts = self.shaft_counts(index);
            self.drives[index].set_position(counts);
            self.drives[index].reboot(now);
        }
    }

    /// Whether the controller's own frames come back to it. On a real socket the kernel does that.
    pub fn set_echo(&mut self, echo: bool) {
        self.echo = echo;
    }

    /// Present time of the robot.
    #[must_use]
    pub const fn now(&self) -> Stamp {
        self.now
    }

    /// What the world shows.
    #[must_use]
    pub fn reading(&self) -> Reading {
        self.world.reading()
    }

    /// The world itself, for disturbances.
    pub fn world_mut(&mut self) -> &mut dyn World {
        &mut *self.world
    }

    /// What has pushed the robot so far.
    #[must_use]
    pub const fn pushes(&self) -> &Pushes {
        &self.pushes
    }

    /// A drive, to look at or to break.
    pub fn drive_mut(&mut self, drive: Drive) -> &mut SimDrive {
        &mut self.drives[drive as usize]
    }

    /// Torque of the hip motor at the joint, Nm.
    #[must_use]
    pub fn hip_torque_nm(&self) -> f64 {
        self.drives[Drive::Hip as usize].torque_permille() * self.units.joint_nm_per_permille
    }

    /// A drive restarts by itself, as after a loss of its power.
    pub fn reboot_drive(&mut self, drive: Drive) {
        let now = self.now;
        self.wires[self.bus_of[drive as usize]].flush(drive as usize + 1);
        self.drives[drive as usize].reboot(now);
    }

    /// A drive finds a fault of its own.
    pub fn fail_drive(&mut self, drive: Drive, code: u16) {
        let index = drive as usize;
        self.drives[index].fail(code, &mut self.answers);
        self.put_answers(index, self.now);
    }

    /// Node of the hip's drive, if it is on this bus; else of the first drive there.
    pub(super) fn first_node(&self, bus: usize) -> u8 {
        (0..DRIVES).find(|k| self.bus_of[*k] == bus).map_or(1, |k| self.nodes[k])
    }

    /// Nobody on this bus acknowledges, or all is well again.
    pub fn set_bus_silent(&mut self, bus: usize, silent: bool) {
        self.wires[bus].set_silent(self.now, silent);
    }

    /// The wire of a bus, for its load.
    #[must_use]
    pub fn wire(&self, bus: usize) -> &Wire {
        &self.wires[bus]
    }

    /// Empties what the controller has queued for this bus (link down and up). In-process buses have no kernel to do it.
    pub fn flush_host(&mut self, bus: usize) {
        self.wires[bus].flush(HOST);
    }

    /// A frame from the controller, sent now. False if the queue before the wire is full, or the link dead.
    pub fn deliver(&mut self, bus: usize, frame: &CanFrame) -> bool {
        let host = &self.hosts[bus];
        !host.is_full && !host.is_deaf() && self.wires[bus].put(self.now, HOST, *frame)
    }

    /// Frames that have reached the controller, as many as fit.
    pub fn take_frames(&mut self, bus: usize, batch: &mut FrameBatch) {
        self.hosts[bus].take(self.now, batch);
    }

    /// How the controller's end of each bus is.
    #[must_use]
    pub fn bus_health(&self) -> [BusHealth; BUSES] {
        std::array::from_fn(|bus| self.hosts[bus].health())
    }

    /// Bytes from the controller to the IMU.
    pub fn deliver_imu_bytes(&mut self, bytes: &[u8]) {
        self.imu.hear(self.now, bytes, &self.reading);
    }

    /// The IMU's adapter is plugged in.
    #[must_use]
    pub const fn imu_is_plugged(&self) -> bool {
        self.imu.is_plugged()
    }

    /// Bytes of the IMU that have reached the controller.
    pub fn take_imu_bytes(&mut self, out: &mut Vec<u8>) {
        self.imu.take(self.now, out);
    }

    /// The lidar, if there is one.
    pub const fn lidar(&mut self) -> Option<&mut SimLidar> {
        self.lidar.as_mut()
    }

    /// The server of motion capture, if there is one.
    pub const fn mocap(&mut self) -> Option<&mut SimMocap> {
        self.mocap.as_mut()
    }

    /// Lets everything happen up to `t`.
    pub fn advance_to(&mut self, t: Stamp) {
        while let Some((at, event)) = self.next_event().filter(|(at, _)| *at <= t) {
            self.now = self.now.max(at);
            match event {
                Event::Frame(bus) => self.finish_frame(bus, at),
                Event::Measure => {
                    self.move_world_to(at);
                    self.imu.measure(at, &self.reading);
                }
                Event::Scan => {
                    self.move_world_to(at);
                    if let Some(lidar) = &mut self.lidar {
                        lidar.measure(at, &self.reading, &*self.world);
                    }
                }
                Event::Pose => {
                    self.move_world_to(at);
                    if let Some(mocap) = &mut self.mocap {
                        mocap.measure(at, &self.reading, &self.world.place());
                    }
                }
                Event::DriveTick => self.tick_drives(at),
                Event::Torque => {
                    self.move_world_to(at);
                    self.drives[Drive::Hip as usize].take_torque(at);
                }
                Event::Push => self.push(at),
                Event::Trouble => self.take_trouble(at),
                Event::Stranger(bus) => self.hear_stranger(bus, at),
            }
        }
        self.now = self.now.max(t);
        self.move_world_to(t);
    }

    fn next_event(&mut self) -> Option<(Stamp, Event)> {
        let mut next = (self.next_drive_tick, Event::DriveTick);
        for (bus, wire) in self.wires.iter_mut().enumerate() {
            if let Some(at) = wire.next_end().filter(|at| *at < next.0) {
                next = (at, Event::Frame(bus));
            }
        }
        if let Some(at) = self.imu.next_measurement().filter(|at| *at < next.0) {
            next = (at, Event::Measure);
        }
        let scan = self.lidar.as_ref().and_then(SimLidar::next_measurement);
        if let Some(at) = scan.filter(|at| *at < next.0) {
            next = (at, Event::Scan);
        }
        if let Some(at) = self.mocap.as_ref().map(SimMocap::next_measurement).filter(|at| *at < next.0) {
            next = (at, Event::Pose);
        }
        if let Some(at) = self.drives[Drive::Hip as usize].next_torque().filter(|at| *at < next.0) {
            next = (at, Event::Torque);
        }
        if let Some(at) = self.pushes.next_time().filter(|at| *at < next.0) {
            next = (at, Event::Push);
        }
        if let Some(at) = self.troubles.next_time().filter(|at| *at < next.0) {
            next = (at, Event::Trouble);
        }
        for (bus, stranger) in self.strangers.iter().enumerate() {
            if let Some(at) = stranger.as_ref().map(Stranger::next_time).filter(|at| *at < next.0) {
                next = (at, Event::Stranger(bus));
            }
        }
        Some(next)
    }

    /// What shall break, or be whole again.
    fn take_trouble(&mut self, at: Stamp) {
        self.move_world_to(at);
        if let Some(edge) = self.troubles.take(at) {
            self.suffer(at, &edge);
        }
    }

    fn hear_stranger(&mut self, bus: usize, at: Stamp) {
        let Some(stranger) = &mut self.strangers[bus] else { return };
        stranger.rest();
        for _ in self.wires[bus].waiting_of(STRANGER)..stranger.at_once() {
            let frame = stranger.frame();
            self.wires[bus].put(at, STRANGER, frame);
        }
    }

    fn push(&mut self, at: Stamp) {
        self.move_world_to(at);
        if let Some(impulse_ns) = self.pushes.take() {
            self.world.push(impulse_ns);
            self.reading = self.world.reading();
        }
    }

    fn finish_frame(&mut self, bus: usize, at: Stamp) {
        let Some(delivered) = self.wires[bus].take(at) else { return };
        self.tell_host(bus, &delivered);
        if delivered.frame.id == u32::from(Object::Sync.id()) {
            self.move_world_to(at);
            self.show_positions(bus);
        }
        for index in 0..DRIVES {
            if self.bus_of[index] == bus && delivered.sender != index + 1 {
                let of_host = delivered.sender == HOST;
                if of_host {
                    self.show_position(index, at);
                }
                let is_command = self.drives[index].hear(at, &delivered.frame, &mut self.answers);
                if of_host && is_command {
                    self.note_age(index, &delivered);
                }
                self.note_torque(index, at);
                self.put_answers(index, at);
            }
        }
    }

    /// How long commands had waited that each drive took from the wire while it was enabled.
    #[must_use]
    pub fn waited(&self) -> [Waited; DRIVES] {
        self.waited.map(|mut waited| {
            waited.end_old(self.now);
            waited
        })
    }

    /// A torque command may be late; places are not.
    fn note_torque(&mut self, index: usize, at: Stamp) {
        if index == Drive::Hip as usize {
            self.drives[index].note_command(at);
        }
    }

    fn note_age(&mut self, index: usize, delivered: &Delivered) {
        self.waited[index].end_old(delivered.at);
        // Also if it was this command that gave the power.
        if self.drives[index].state() == State::Enabled {
            self.waited[index].note(delivered.at, delivered.at.since(delivered.queued), self.watchdogs[index]);
        }
    }

    fn tell_host(&mut self, bus: usize, delivered: &Delivered) {
        if delivered.sender == HOST && !self.echo {
            return;
        }
        let own = delivered.sender == HOST;
        self.hosts[bus].hear(BusFrame { stamp: delivered.at, own, frame: delivered.frame });
    }

    fn tick_drives(&mut self, at: Stamp) {
        self.next_drive_tick = at + DRIVE_TICK;
        for index in 0..DRIVES {
            self.show_position(index, at);
            self.drives[index].tick(at, &mut self.answers);
            if self.drives[index].state() != State::Enabled {
                self.waited[index].end_old(at);
            }
            self.note_torque(index, at);
            self.put_answers(index, at);
        }
        self.release(at);
    }

    /// The hand that holds the robot lets go some time after the hip got its power, also of a controller that never
    /// pushes.
    fn release(&mut self, at: Stamp) {
        let powered = self.drives[Drive::Hip as usize].state() == State::Enabled;
        self.hip_powered_since = powered.then(|| self.hip_powered_since.unwrap_or(at));
        let due = self.hip_powered_since.is_some_and(|since| at.since(since) >= self.release_after);
        if due && self.release_after > Span::ZERO {
            self.world.let_go();
        }
    }

    fn put_answers(&mut self, index: usize, at: Stamp) {
        for frame in self.answers.drain(..) {
            self.wires[self.bus_of[index]].put(at, index + 1, frame);
        }
    }

    /// Where the shaft of a drive stands, counts from the world's origin.
    fn shaft_counts(&self, index: usize) -> i32 {
        match index.checked_sub(1) {
            None => self.units.hip_counts(self.reading.hip_encoder_rad),
            Some(toe) => self.units.toe_counts(self.reading.toe_position_m[toe]),
        }
    }

    /// A drive without SYNC reads its encoder now.
    fn show_position(&mut self, index: usize, at: Stamp) {
        if self.drives[index].samples_by_itself() {
            self.move_world_to(at);
            let counts = self.shaft_counts(index);
            self.drives[index].set_position(counts);
        }
    }

    /// Encoders and potentiometers of the drives on a bus read what the world shows.
    fn show_positions(&mut self, bus: usize) {
        for index in (0..DRIVES).filter(|k| self.bus_of[*k] == bus) {
            if self.drives[index].samples_by_itself() {
                continue;
            }
            let counts = self.shaft_counts(index);
            self.drives[index].set_position(counts);
            if let Some(toe) = index.checked_sub(1) {
                let noise_m = self.units.toe.pot_noise_m * self.pot_noise.normal();
                let pot_counts = self.units.pot_counts(self.reading.toe_spring_m[toe] + noise_m);
                self.drives[index].set_analog(pot_counts);
            }
        }
    }

    /// Moves the bodies under what the motors do, in steps that are not too long.
    fn move_world_to(&mut self, t: Stamp) {
        while t.since(self.world_time) > GRAIN {
            let dt = t.since(self.world_time).min(LONGEST_STEP);
            let torque_permille = self.drives[Drive::Hip as usize].run_current_loop(dt);
            let toes = self.toe_targets();
            self.world.step(torque_permille * self.units.joint_nm_per_permille, toes, dt);
            self.world_time += dt;
            self.reading = self.world.reading();
        }
    }

    /// Where the toes' position loops drive to; a toe without power stays.
    fn toe_targets(&self) -> [f64; TOES] {
        std::array::from_fn(|k| match self.drives[k + 1].target_counts() {
            Some(counts) => f64::from(counts) / self.units.toe.counts_per_m,
            None => self.reading.toe_position_m[k],
        })
    }
}

/// What happens next.
enum Event {
    /// A frame has left the wire of this bus.
    Frame(usize),
    /// The IMU measures.
    Measure,
    /// The lidar scans.
    Scan,
    /// The cameras look.
    Pose,
    /// The drives look after their timers.
    DriveTick,
    /// A delayed torque command takes effect.
    Torque,
    /// Somebody pushes the robot.
    Push,
    /// A fault begins or ends.
    Trouble,
    /// Somebody else sends on this bus.
    Stranger(usize),
}

#[cfg(test)]
#[path = "plant_tests.rs"]
mod tests;
