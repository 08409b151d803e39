//! What must hold in every tick, whatever happens to wires, devices, operator and host. RT: no.
//!
//! 1. No torque unless armed: neither let through, nor commanded, nor in a frame to the hip's drive; no goal `Enabled`, and no
//!    frame that gives power, but while armed, arming, or (toes only) homing.
//! 2. Torque is finite and within its limit; toe lengths are finite and within their stroke.
//! 3. What goes out was decided in this tick. When a drive that has power takes it from the wire, a command to the hip is not
//!    older than one period, one to a toe not older than one round. On a bus that a fault of the bus was drawn for, a frame may
//!    wait: there the bound is the drive's watchdog, by which a drive that hears nothing lets go. A drive that is commanded frame
//!    by frame may keep its power then (most MIT motors), or get it by the old frame itself: it may follow that until the power
//!    off that is queued behind it.
//! 4. When torque is over, so it is at the motor: without torque, or made by less than its watchdog and what a current takes.
//! 5. A fault stays latched, the same one, until the switch was seen open and is pressed again.

use super::reaction::NO_TORQUE_NM;
use crate::base::time::{Span, Stamp};
use crate::bus::budget::Plan;
use crate::config::checked::{Config, DriveConfig, DriveProtocol};
use crate::config::fault::{Device, Injection};
use crate::msg::{BUSES, CanFrame, DRIVES, Drive, DriveCommand, DriveGoal, Fault, Mode, TOES, TickRecord};
use crate::sim::drive::{Asked, Motion, SimDrive};
use crate::sim::plant::Waited;

/// A torque or count that differs by less is the same: the protocols carry 32 bit floats.
const ROUNDING: f64 = 0.01;
/// Steps of an MIT motor's codes of torque and of position.
const MIT_STEPS: f64 = 4095.0;
const MIT_POSITIONS: f64 = 65_535.0;
/// The first commands to a drive that has just got power carry where it stands.
const FIRST_PLACES: u32 = 2;
/// An old command is followed for no longer than a few frames take.
const FOLLOWS_OLD: Span = Span::from_ms(1);
/// After its watchdog's time a drive lets go at its next look at its timers.
const WATCHDOG_LOOK: Span = Span::from_ms(1);

/// An invariant that does not hold.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Breach {
    /// See 1.
    #[error("torque without being armed, in mode {0:?}: {1}")]
    TorqueUnarmed(Mode, &'static str),
    /// See 2.
    #[error("out of its limits: {0} = {1}")]
    OutOfLimits(&'static str, f64),
    /// See 3.
    #[error("an old command: {0}")]
    Old(&'static str),
    /// See 3.
    #[error("{0:?} followed a command that had waited {1:?}, for {2:?}")]
    Waited(Drive, Span, Span),
    /// See 4.
    #[error("the hip still makes {0:.2} Nm {1:?} after the mode left armed")]
    TorqueStays(f64, Span),
    /// See 5.
    #[error("the latched fault {0:?} was left for {1:?} without a fresh press")]
    Unlatched(Fault, Mode),
}

/// A current is gone after this.
const CURRENT_DECAYS: Span = Span::from_ms(10);

/// Looks at each tick.
#[derive(Clone, Debug)]
pub struct Invariants {
    torque_limit_nm: f64,
    stroke_m: f64,
    max_permille: i32,
    readers: Vec<Reader>,
    most_wait: [Wait; DRIVES],
    mode: Mode,
    first_fault: Fault,
    held: bool,
    /// Longest that the hip's motor may make torque unless armed, and since when it does.
    most_torque: Span,
    torque_since: Option<Stamp>,
}

impl Invariants {
    /// For this robot with these faults, from before its first tick.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let robot = &config.robot;
        Self {
            torque_limit_nm: robot.limits.hip_torque_nm,
            stroke_m: robot.toe.stroke_m,
            max_permille: i32::from(robot.drives[Drive::Hip as usize].max_torque_permille),
            readers: Drive::ALL.iter().zip(&robot.drives).map(|(drive, config)| Reader::new(*drive, config)).collect(),
            most_wait: std::array::from_fn(|drive| most_wait(config, drive)),
            mode: Mode::Starting,
            first_fault: Fault::default(),
            held: false,
            most_torque: Span(robot.drives[Drive::Hip as usize].watchdog.0 + CURRENT_DECAYS.0),
            torque_since: None,
        }
    }

    /// Looks at the next tick.
    ///
    /// # Errors
    /// The first invariant that does not hold.
    pub fn look(&mut self, record: &TickRecord) -> Result<(), Breach> {
        let (mode, first_fault) = (record.status.mode, record.status.first_fault);
        let held = record.input.operator.dead_man;
        let result = unarmed(record)
            .and_then(|()| self.limits(record))
            .and_then(|()| self.wire(record))
            .and_then(|()| self.latch(mode, &first_fault, held));
        (self.mode, self.first_fault, self.held) = (mode, first_fault, held);
        result
    }

    fn limits(&self, record: &TickRecord) -> Result<(), Breach> {
        let torque_nm = record.allowed.hip_torque_nm;
        if !torque_nm.is_finite() || torque_nm.abs() > self.torque_limit_nm {
            return Err(Breach::OutOfLimits("hip torque, Nm", torque_nm));
        }
        let permille = record.drives.drives[Drive::Hip as usize].torque_permille;
        if i32::from(permille).abs() > self.max_permille {
            return Err(Breach::OutOfLimits("hip torque, 1/1000 of rated", f64::from(permille)));
        }
        let toes: [f64; TOES] = record.allowed.toe_position_m;
        match toes.into_iter().find(|length| !(0.0..=self.stroke_m).contains(length)) {
            Some(length) => Err(Breach::OutOfLimits("toe length, m", length)),
            None => Ok(()),
        }
    }

    /// What is in the frames is what was decided now.
    fn wire(&mut self, record: &TickRecord) -> Result<(), Breach> {
        if record.allowed.stamp != record.input.now || record.drives.stamp != record.input.now {
            return Err(Breach::Old("decided in another tick"));
        }
        for reader in &mut self.readers {
            for frame in &record.output.send[reader.bus] {
                reader.read(record, &frame.frame)?;
            }
        }
        Ok(())
    }

    /// What waited longest of all that each drive took from the wire while it was enabled.
    ///
    /// # Errors
    /// The drive that followed an old command.
    pub fn look_at_ages(&self, waited: &[Waited; DRIVES]) -> Result<(), Breach> {
        for (drive, (waited, rule)) in Drive::ALL.iter().zip(waited.iter().zip(&self.most_wait)) {
            let excused = rule.by_frames && waited.followed_old <= FOLLOWS_OLD;
            if waited.longest > rule.most && !excused {
                return Err(Breach::Waited(*drive, waited.longest, waited.followed_old));
            }
        }
        Ok(())
    }

    /// What the hip's motor makes at the joint in the tick that was looked at.
    ///
    /// # Errors
    /// Torque that goes on without being armed.
    pub fn look_at_torque(&mut self, now: Stamp, torque_nm: f64) -> Result<(), Breach> {
        if self.mode == Mode::Armed || torque_nm.abs() <= NO_TORQUE_NM {
            self.torque_since = None;
            return Ok(());
        }
        let lasts = now.since(*self.torque_since.get_or_insert(now));
        if lasts > self.most_torque { Err(Breach::TorqueStays(torque_nm, lasts)) } else { Ok(()) }
    }

    fn latch(&self, mode: Mode, first_fault: &Fault, held: bool) -> Result<(), Breach> {
        let pressed = held && !self.held;
        let same = same_fault(first_fault, &self.first_fault);
        let left = self.mode == Mode::Faulted && (mode != Mode::Faulted || !same);
        if left && !(pressed && matches!(mode, Mode::Arming | Mode::Homing)) {
            return Err(Breach::Unlatched(self.first_fault, mode));
        }
        Ok(())
    }
}

/// Reads the frames to one drive as the simulated drive does.
#[derive(Clone, Debug)]
struct Reader {
    drive: Drive,
    bus: usize,
    reader: SimDrive,
    max_permille: f64,
    /// A step of the code: as near to zero, or to what was decided, as the protocol comes. An MIT setpoint is cut off downwards.
    step_permille: f64,
    /// An MIT motor, which knows no torque limit, is led in steps; none is for the others.
    leading: Option<Leading>,
    /// So many commands of this arming may still say where it stands.
    first_places: u32,
    /// From the place decided to the one in the frame: where the drive began to count.
    zero_counts: Option<f64>,
}

impl Reader {
    fn new(drive: Drive, config: &DriveConfig) -> Self {
        let step_permille = match config.protocol {
            DriveProtocol::Mit(mit) => 2e3 * mit.torque_range_nm / MIT_STEPS / config.rated_torque_nm,
            _ => 0.0,
        };
        Self {
            drive,
            bus: config.bus.min(BUSES - 1),
            reader: SimDrive::reader(config),
            max_permille: f64::from(config.max_torque_permille),
            step_permille: step_permille + ROUNDING,
            leading: Leading::of(config),
            first_places: FIRST_PLACES,
            zero_counts: None,
        }
    }

    fn read(&mut self, record: &TickRecord, frame: &CanFrame) -> Result<(), Breach> {
        let Some(Asked { powers, motion }) = self.reader.asked(frame) else { return Ok(()) };
        let mode = record.status.mode;
        let may_have_power = match self.drive {
            Drive::Hip => matches!(mode, Mode::Armed | Mode::Arming),
            _ => matches!(mode, Mode::Armed | Mode::Arming | Mode::Homing),
        };
        if powers && !may_have_power {
            return Err(Breach::TorqueUnarmed(mode, "a frame gives power"));
        }
        let decided = &record.drives.drives[self.drive as usize];
        match (self.drive, motion) {
            (_, Motion::Off) => Ok(()),
            (Drive::Hip, Motion::Torque(permille)) => self.hip_torque(mode, permille, decided),
            (Drive::Hip, Motion::Position { counts, .. }) => {
                Err(Breach::OutOfLimits("the hip is sent to a place", counts))
            }
            // As an MIT motor is off: no stiffness.
            (_, Motion::Torque(permille)) if permille.abs() <= self.step_permille => Ok(()),
            (_, Motion::Torque(permille)) => Err(Breach::OutOfLimits("a toe is asked for torque, 1/1000", permille)),
            (_, Motion::Position { .. }) if !may_have_power => Err(Breach::TorqueUnarmed(mode, "a toe in a frame")),
            (_, Motion::Position { counts, most_permille }) => {
                let most = most_permille.unwrap_or(0.0);
                if !(0.0..=self.max_permille + ROUNDING).contains(&most) {
                    return Err(Breach::OutOfLimits("torque of a toe, 1/1000", most));
                }
                let at_counts = record.feedback.drives[self.drive as usize].position_counts;
                self.toe_place(mode, counts, decided, at_counts)
            }
        }
    }

    fn hip_torque(&self, mode: Mode, permille: f64, decided: &DriveCommand) -> Result<(), Breach> {
        if !permille.is_finite() || permille.abs() > self.max_permille + self.step_permille {
            return Err(Breach::OutOfLimits("hip torque in a frame, 1/1000", permille));
        }
        let is_none = permille.abs() <= self.step_permille;
        let is_decided = (permille - f64::from(decided.torque_permille)).abs() <= self.step_permille;
        match mode {
            _ if is_none => Ok(()),
            Mode::Armed if is_decided => Ok(()),
            Mode::Armed => Err(Breach::Old("torque in a frame is not the one decided")),
            _ => Err(Breach::TorqueUnarmed(mode, "in a frame")),
        }
    }

    /// Places decided and sent differ by where the drive began to count, which stays while it is armed.
    fn toe_place(&mut self, mode: Mode, counts: f64, decided: &DriveCommand, at_counts: i32) -> Result<(), Breach> {
        if !counts.is_finite() {
            return Err(Breach::OutOfLimits("toe in a frame, counts", counts));
        }
        if mode != Mode::Armed {
            (self.first_places, self.zero_counts) = (FIRST_PLACES, None);
        } else if self.first_places > 0 {
            self.first_places -= 1;
        } else if !decided.hold {
            let leading = self.leading.unwrap_or_default();
            let zero_counts = counts - leading.place(decided, at_counts);
            // A 32 bit float has 24 bits for the place.
            let rounding = 1.0 + 1e-7 * counts.abs() + leading.step_counts;
            let moved = leading.unwrapped(zero_counts - *self.zero_counts.get_or_insert(zero_counts));
            if moved.abs() > rounding {
                return Err(Breach::Old("a toe's place in a frame is not the one decided"));
            }
        }
        Ok(())
    }
}

/// How an MIT motor is sent to a place: no farther ahead of where it stands than its stiffness makes the torque that it may use.
#[derive(Clone, Copy, Debug, Default)]
struct Leading {
    /// Ahead of it at the rated torque, counts.
    rated_counts: f64,
    max_permille: f64,
    /// Steps of the code, and rounding of where it stands.
    step_counts: f64,
    /// After so many counts the code begins anew.
    turn_counts: f64,
}

impl Leading {
    fn of(config: &DriveConfig) -> Option<Self> {
        let DriveProtocol::Mit(mit) = config.protocol else { return None };
        let [stiffness_nm_rad, _] = mit.gains;
        let counts_per_rad = mit.counts_per_turn / std::f64::consts::TAU;
        let turn_counts = 2.0 * mit.position_range_rad * counts_per_rad;
        (stiffness_nm_rad > 0.0).then_some(Self {
            rated_counts: config.rated_torque_nm / stiffness_nm_rad * counts_per_rad,
            max_permille: f64::from(config.max_torque_permille),
            step_counts: 1.0 + 2.0 * turn_counts / MIT_POSITIONS,
            turn_counts,
        })
    }

    fn place(&self, decided: &DriveCommand, at_counts: i32) -> f64 {
        let (place, at) = (f64::from(decided.position_counts), f64::from(at_counts));
        if self.turn_counts == 0.0 {
            return place;
        }
        let reach = 1e-3 * f64::from(decided.torque_limit_permille).clamp(0.0, self.max_permille) * self.rated_counts;
        place.clamp(at - reach, at + reach)
    }

    fn unwrapped(&self, counts: f64) -> f64 {
        if self.turn_counts == 0.0 {
            counts
        } else {
            counts - self.turn_counts * libm::round(counts / self.turn_counts)
        }
    }
}

/// Longest that a command to a drive may wait for its wire.
#[derive(Clone, Copy, Debug, Default)]
struct Wait {
    most: Span,
    /// A drive that is commanded frame by frame, on a bus that suffers.
    by_frames: bool,
}

fn most_wait(config: &Config, drive: usize) -> Wait {
    let Some(of) = config.robot.drives.get(drive) else { return Wait::default() };
    let suffers = |fault: &Injection| fault.entry.device == Device::Bus && fault.bus == of.bus;
    if config.simulation.faults.iter().any(suffers) {
        return Wait { most: Span(of.watchdog.0 + WATCHDOG_LOOK.0), by_frames: !of.is_canopen() };
    }
    let turns = match drive {
        0 => 1,
        _ => Plan::new(&config.robot, of.bus).map_or(1, |plan| plan.round),
    };
    Wait { most: Span(config.real_time.period.0 * i64::from(turns)), by_frames: false }
}

fn unarmed(record: &TickRecord) -> Result<(), Breach> {
    let mode = record.status.mode;
    if mode == Mode::Armed {
        return Ok(());
    }
    let breach = |what| Err(Breach::TorqueUnarmed(mode, what));
    if record.allowed.hip_torque_nm != 0.0 {
        return breach("let through");
    }
    let [hip, toes @ ..] = &record.drives.drives;
    if hip.torque_permille != 0 {
        return breach("commanded");
    }
    let hip_may = mode == Mode::Arming;
    if hip.goal == DriveGoal::Enabled && !hip_may {
        return breach("the hip is enabled");
    }
    let toes_may = matches!(mode, Mode::Arming | Mode::Homing);
    if toes.iter().any(|toe| toe.goal == DriveGoal::Enabled) && !toes_may {
        return breach("a toe is enabled");
    }
    Ok(())
}

/// The same by its bits: a value may be no number.
fn same_fault(a: &Fault, b: &Fault) -> bool {
    (a.code, a.index, a.stamp, a.value.to_bits()) == (b.code, b.index, b.stamp, b.value.to_bits())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::canopen::{Message, Node};
    use crate::bus::{mit, moteus, odrive, pdo};
    use crate::config;
    use crate::msg::BusFrame;
    use crate::sim::trouble::table::robot_for;

    use crate::sim::trouble::soak::MIT_TOES;

    fn robot(name: &str) -> Config {
        let mixed = ("mixed.toml", include_str!("../../../config/examples/mixed.toml"));
        let others = [Device::Bus, Device::Mit, Device::Odrive, Device::Moteus].map(robot_for);
        let (name, text) = others.into_iter().chain([mixed]).find(|(known, _)| *known == name).unwrap();
        config::load_text(name, text, &[]).unwrap().config
    }

    /// What is said of a tick in which this torque was decided and this frame goes out.
    fn look(config: &Config, mode: Mode, decided_permille: i16, bus: usize, frame: CanFrame) -> Result<(), Breach> {
        let mut record = TickRecord::default();
        record.status.mode = mode;
        record.drives.drives[Drive::Hip as usize].torque_permille = decided_permille;
        record.output.send[bus].push(BusFrame::ours(record.input.now, frame));
        Invariants::new(config).look(&record)
    }

    /// A frame of this protocol that asks the hip for so much torque, 1/1000 of rated.
    fn hip_frame(config: &Config, permille: f64) -> CanFrame {
        let hip = &config.robot.drives[Drive::Hip as usize];
        let torque_nm = 1e-3 * permille * hip.rated_torque_nm;
        match hip.protocol {
            DriveProtocol::Cia402(_) => {
                let pdo = pdo::torque_command(0, permille as i16);
                Message::Rpdo(1, Node::new(hip.node).unwrap(), pdo).emit()
            }
            DriveProtocol::Mit(mit) => {
                let setpoint = mit::Setpoint { torque_nm, ..mit::Setpoint::default() };
                CanFrame::classic(mit.command_id(hip.node), &setpoint.emit(&mit))
            }
            DriveProtocol::Odrive(_) => {
                odrive::frame(hip.node, odrive::INPUT_TORQUE, &(torque_nm as f32).to_le_bytes())
            }
            DriveProtocol::Moteus(_) => moteus::command(hip.node, &moteus_command(f32::NAN, torque_nm as f32, 0.0)),
        }
    }

    fn moteus_command(position: f32, torque_nm: f32, gain: f32) -> moteus::Command {
        moteus::Command { position, torque_nm, gain, max_torque_nm: 1e6, watchdog_s: 0.05 }
    }

    #[test]
    fn torque_in_a_frame_is_judged_in_every_protocol() {
        for name in ["default", "mit.toml", "odrive.toml", "moteus.toml"] {
            let config = robot(name);
            let most = f64::from(config.robot.drives[0].max_torque_permille);
            let look = |mode, decided, permille| look(&config, mode, decided, 0, hip_frame(&config, permille));
            assert_eq!(look(Mode::Armed, 100, 100.0), Ok(()), "{name}");
            assert!(matches!(look(Mode::Armed, 100, 110.0), Err(Breach::Old(_))), "{name}");
            assert!(matches!(look(Mode::Armed, 100, -100.0), Err(Breach::Old(_))), "{name}");
            assert!(matches!(look(Mode::Armed, 0, most + 10.0), Err(Breach::OutOfLimits(..))), "{name}");
            for mode in [Mode::Starting, Mode::Homing, Mode::Arming, Mode::Faulted] {
                let breach = look(mode, 0, 100.0);
                assert!(matches!(breach, Err(Breach::TorqueUnarmed(..))), "{name}, {mode:?}: {breach:?}");
            }
        }
        for name in ["odrive.toml", "moteus.toml"] {
            let config = robot(name);
            let breach = look(&config, Mode::Armed, 0, 0, hip_frame(&config, f64::NAN));
            assert!(matches!(breach, Err(Breach::OutOfLimits(..))), "{name}: {breach:?}");
        }
    }

    #[test]
    fn a_frame_that_gives_power_is_judged_in_every_protocol() {
        let special = |config: &Config| match config.robot.drives[0].protocol {
            DriveProtocol::Mit(mit) => CanFrame::classic(mit.command_id(1), &mit::Special::Enter.emit()),
            _ => unreachable!("an MIT robot"),
        };
        let enable = Message::Rpdo(1, Node::new(1).unwrap(), pdo::torque_command(0x0F, 0)).emit();
        let closed_loop = |node| odrive::frame(node, odrive::SET_STATE, &u32::from(odrive::CLOSED_LOOP).to_le_bytes());
        let torque = moteus_command(f32::NAN, 0.0, 0.0);
        for (name, frame) in [
            ("default", enable),
            ("mit.toml", special(&robot("mit.toml"))),
            ("odrive.toml", closed_loop(robot("odrive.toml").robot.drives[0].node)),
            ("moteus.toml", moteus::command(robot("moteus.toml").robot.drives[0].node, &torque)),
        ] {
            assert_eq!(look(&robot(name), Mode::Arming, 0, 0, frame), Ok(()), "{name}");
            let breach = look(&robot(name), Mode::Homing, 0, 0, frame);
            assert_eq!(breach, Err(Breach::TorqueUnarmed(Mode::Homing, "a frame gives power")), "{name}");
        }
    }

    #[test]
    fn toes_are_judged_by_their_frames() {
        let config = robot("mixed.toml");
        let toe = &config.robot.drives[Drive::OuterToeA as usize];
        let most_nm = 1e-3 * f64::from(toe.max_torque_permille) * toe.rated_torque_nm;
        let go = |max_torque_nm: f64| {
            let command = moteus::Command { max_torque_nm: max_torque_nm as f32, ..moteus_command(1.0, 0.0, 1.0) };
            moteus::command(toe.node, &command)
        };
        assert_eq!(look(&config, Mode::Homing, 0, 1, go(most_nm)), Ok(()));
        assert!(matches!(look(&config, Mode::Homing, 0, 1, go(1.1 * most_nm)), Err(Breach::OutOfLimits(..))));
        assert!(matches!(look(&config, Mode::Faulted, 0, 1, go(most_nm)), Err(Breach::TorqueUnarmed(..))));
        let pushes = moteus::command(toe.node, &moteus_command(f32::NAN, 0.1, 0.0));
        assert!(matches!(look(&config, Mode::Armed, 0, 1, pushes), Err(Breach::OutOfLimits(..))));
    }

    #[test]
    fn a_toe_that_is_sent_elsewhere_than_decided_is_noticed() {
        let config = robot("default");
        let toe = Drive::InnerToeA as usize;
        let (node, bus) = (Node::new(config.robot.drives[toe].node).unwrap(), config.robot.drives[toe].bus);
        let mut invariants = Invariants::new(&config);
        let mut send = |decided: i32, counts: i32| {
            let mut record = TickRecord::default();
            record.status.mode = Mode::Armed;
            record.drives.drives[toe].position_counts = decided;
            let frame = Message::Rpdo(1, node, pdo::position_command(0x0F, counts)).emit();
            record.output.send[bus].push(BusFrame::ours(record.input.now, frame));
            invariants.look(&record)
        };
        // The first two say where it stands; then its zero is at -500.
        for (decided, counts) in [(9000, 7777), (9000, 7777), (9000, 8500), (9200, 8700)] {
            assert_eq!(send(decided, counts), Ok(()));
        }
        assert!(matches!(send(9400, 8700), Err(Breach::Old(_))), "the place of the command before");
    }

    #[test]
    fn an_mit_toe_is_led_no_farther_than_its_torque_allows_and_towards_what_was_decided() {
        let config = config::load_text("mit_toes", MIT_TOES, &[]).unwrap().config;
        let toe = Drive::OuterToeA as usize;
        let drive = &config.robot.drives[toe];
        let DriveProtocol::Mit(mit) = drive.protocol else { panic!("an MIT toe") };
        let mut invariants = Invariants::new(&config);
        let mut send = |decided: i32, at: i32, counts: f64| {
            let mut record = TickRecord::default();
            record.status.mode = Mode::Armed;
            let command = &mut record.drives.drives[toe];
            (command.position_counts, command.torque_limit_permille) = (decided, 1000);
            record.feedback.drives[toe].position_counts = at;
            let position_rad = counts / mit.counts_per_turn * std::f64::consts::TAU;
            let setpoint = mit::Setpoint { position_rad, stiffness_nm_rad: mit.gains[0], ..mit::Setpoint::default() };
            let frame = CanFrame::classic(mit.command_id(drive.node), &setpoint.emit(&mit));
            record.output.send[drive.bus].push(BusFrame::ours(record.input.now, frame));
            invariants.look(&record)
        };
        // Rated .1 Nm at .2 Nm/rad are half a rad: 159 counts. Its zero is at -500.
        for (decided, at, counts) in [(900, 700, 0.0), (900, 700, 0.0), (900, 700, 359.0), (705, 700, 205.0)] {
            assert_eq!(send(decided, at, counts), Ok(()), "{decided} from {at}");
        }
        assert!(
            matches!(send(900, 700, 400.0), Err(Breach::Old(_))),
            "all the way at once: more torque than it may use"
        );
        assert!(matches!(send(500, 700, 359.0), Err(Breach::Old(_))), "the other way");
    }

    #[test]
    fn torque_that_goes_on_unless_armed_is_noticed() {
        let mut invariants = Invariants::new(&robot("default"));
        let mut look = |mode: Mode, ms: i64, torque_nm: f64| {
            invariants.mode = mode;
            invariants.look_at_torque(Stamp(ms * 1_000_000), torque_nm).is_ok()
        };
        assert!((0..200).all(|ms| look(Mode::Armed, ms, 20.0)));
        assert!((200..=260).all(|ms| look(Mode::Faulted, ms, 20.0)), "its watchdog is 50 ms");
        assert!(!look(Mode::Faulted, 261, -20.0));
        assert!(look(Mode::Faulted, 262, 0.01) && look(Mode::Faulted, 263, 20.0), "it had let go");
    }

    #[test]
    fn a_command_may_wait_a_period_or_a_round_and_on_a_bus_that_suffers_as_long_as_the_watchdog() {
        let mut config = robot("default");
        let looks = |config: &Config, drive: Drive, ms: i64| {
            let mut waited = [Waited::default(); DRIVES];
            waited[drive as usize].longest = Span::from_ms(ms);
            Invariants::new(config).look_at_ages(&waited).is_ok()
        };
        assert!(looks(&config, Drive::Hip, 1) && !looks(&config, Drive::Hip, 2));
        assert!(looks(&config, Drive::OuterToeB, 4) && !looks(&config, Drive::OuterToeB, 5));
        config.simulation.faults = vec![Injection::parse("no_acknowledge@3:bus=0").unwrap()];
        assert!(looks(&config, Drive::Hip, 51) && !looks(&config, Drive::Hip, 52));
        assert!(!looks(&config, Drive::OuterToeB, 5), "on the other bus");
        let mut config = robot("mit.toml");
        let follows = |config: &Config, us: i64| {
            let mut waited = [Waited::default(); DRIVES];
            (waited[0].longest, waited[0].followed_old) = (Span::from_ms(1000), Span::from_us(us));
            Invariants::new(config).look_at_ages(&waited).is_ok()
        };
        assert!(!follows(&config, 200), "no fault of the bus");
        config.simulation.faults = vec![Injection::parse("no_acknowledge@3:bus=0").unwrap()];
        assert!(follows(&config, 200) && !follows(&config, 1001));
    }
}
