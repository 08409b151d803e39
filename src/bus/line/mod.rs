//! The master of one bus: sets its drives up, keeps them in step, and never leaves an old command behind.
//!
//! Each cycle: [`Line::receive`] what came, then [`Line::transmit`] what shall go: at most one set-up frame, our
//! heartbeat, the commands whose turn it is, and SYNC, which makes them act and takes the next sample. Heartbeat, SYNC
//! and network management are for CANopen drives ([`mod@drive`]); others act on each command ([`direct`]).
//!
//! **Nothing stale on the wire.** A command goes out only when the one before is known to have left: by its echo, by
//! the echo of a SYNC sent after it, or by an answer that only it can have caused; one that takes goal or torque away
//! may follow it, one that lowers the torque once. So what sits in a kernel or adapter whose peer is gone is at most one
//! command with torque per drive and one with less behind it. If
//! nothing proves departure for the echo timeout the bus is *stalled*: no more commands; a probe (NMT reset of all
//! nodes, or power off: harmless whenever delivered), with the power off of each drive that knows no reset, until one is
//! echoed; then the whole start-up from reset. Emptying the kernel's queue is the I/O thread's part.
//!
//! RT: yes; `new` allocates.

mod agreement;
mod direct;
mod drive;
mod in_flight;
mod member;
mod pace;
mod setup;
mod speak_mit;
mod speak_moteus;
mod speak_odrive;

use super::budget;
use super::canopen::{Message, NmtCommand, NmtState, Node};
use super::pdo::Answer;
use crate::base::listening::Listening;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{RealTime, Robot, Trigger};
use crate::msg::{BusFrame, BusHealth, CanFrame, DRIVES, DriveCommand, DriveCommands, DriveFeedbacks, FrameBatch};
use direct::{Direct, Heard};
use drive::DriveLine;
pub(super) use drive::Slot;
use member::Member;
pub use setup::SetupFault;

/// The frame that is the clock of the bus.
pub const SYNC_FRAME: CanFrame = CanFrame::empty(0x080);
/// A probe that is not echoed is repeated after this.
const PROBE_EVERY: Span = Span::from_ms(100);
/// After a frame of another master the bus counts as contested for so long.
const CONTESTED_FOR: Span = Span::from_ms(1000);
/// Shortest time from sending a command and SYNC to the answer: 79 + 47 + 95 bits without stuffing at 1 Mbit/s.
const FASTEST_ANSWER: Span = Span::from_us(221);

/// Why a bus cannot be run as configured.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum LineError {
    /// A node number outside 1 to 126 (127 is ours).
    #[error("drive {drive}: node {node} is not in 1..=126")]
    Node {
        /// Index of the drive.
        drive: usize,
        /// Its node.
        node: u8,
    },
    /// Two drives of a bus with one node number.
    #[error("bus {bus}: node {node} is used twice")]
    Twice {
        /// The bus.
        bus: usize,
        /// The node.
        node: u8,
    },
    /// A SYNC divisor that is not 1 and not the bus's largest.
    #[error("drive {drive}: sync divisor {divisor} must be 1 or the largest of its bus, {largest}")]
    Divisor {
        /// Index of the drive.
        drive: usize,
        /// Its divisor.
        divisor: u8,
        /// The largest of the bus.
        largest: u8,
    },
}

/// What happened on the bus since the start.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct LineCounters {
    /// Frames that are no CANopen, or of nodes that are not ours.
    pub foreign: u32,
    /// Emergencies with a code.
    pub emergencies: u32,
    /// Boot-ups in operation.
    pub reboots: u32,
    /// Commands withheld because the one before was not yet proved to have left.
    pub withheld: u32,
    /// Times that the bus stalled.
    pub stalls: u32,
    /// Frames that only a master sends, and that we did not send.
    pub masters: u32,
}

/// The bus gives no sign that frames leave.
#[derive(Clone, Copy, Debug)]
struct Stall {
    /// When the probe went out.
    probe: Option<Stamp>,
    /// The controller itself says that nothing can be sent: no use probing.
    link_dead: bool,
    /// The power off of the drives that are commanded frame by frame went out.
    powers_off: bool,
}

/// The master of one bus.
#[derive(Debug)]
pub struct Line {
    bus: usize,
    plan: budget::Plan,
    cycle: u32,
    /// Some drive is CANopen.
    canopen: bool,
    sync_by_us: bool,
    echo_timeout: Span,
    /// A wire that works proves within this that a frame has left.
    moves_within: Span,
    heartbeat_every: Span,
    heartbeat_sent: Stamp,
    listening: Listening,
    /// How long we have listened for a frame in flight since one was last proved to have left.
    waited: Span,
    /// Shortest watchdog of the drives: by then a frame must have left, however little we could listen.
    watchdog: Span,
    /// When frames were chosen last.
    transmitted: Stamp,
    sync_in_flight: Option<Stamp>,
    /// When another one followed it, because its echo did not come.
    sync_again: Option<Stamp>,
    sync_seen: Stamp,
    stall: Option<Stall>,
    other_master: Option<Stamp>,
    next_setup: usize,
    drives: [Option<Member>; DRIVES],
    counters: LineCounters,
}

impl Line {
    /// The master of bus number `bus`, with all its drives still unknown. Allocates; nothing else does.
    ///
    /// # Errors
    /// [`LineError`] if nodes or divisors do not go together.
    pub fn new(robot: &Robot, bus: usize, real_time: &RealTime) -> Result<Self, LineError> {
        let plan = budget::Plan::new(robot, bus)?;
        let mut drives = [const { None }; DRIVES];
        let mut watchdog = Span(i64::MAX);
        for (index, (slot, config)) in drives.iter_mut().zip(&robot.drives).enumerate() {
            let Some(at) = plan.slot(index) else { continue };
            let canopen = || {
                let node = Node::new(config.node)?;
                Some(Member::Canopen(DriveLine::new(index, node, config, at, real_time)))
            };
            *slot = Direct::new(index, config, at).map(Member::Direct).or_else(canopen);
            watchdog = watchdog.min(config.watchdog);
        }
        let noticed_by = robot.buses.get(bus).map_or(Span::from_ms(20), |b| b.echo_timeout);
        Ok(Self {
            bus,
            canopen: drives.iter().flatten().any(|drive| matches!(drive, Member::Canopen(_))),
            plan,
            cycle: 0,
            sync_by_us: real_time.trigger == Trigger::Timer,
            // A bus that dies just after a command shows one period later, at the next; we look once a period.
            echo_timeout: Span(noticed_by.0 - 2 * real_time.period.0).max(real_time.period),
            moves_within: Span(2 * real_time.period.0),
            heartbeat_every: Span(watchdog.0 / 4),
            heartbeat_sent: Stamp::NEVER,
            listening: Listening::new(real_time.period),
            waited: Span::ZERO,
            watchdog,
            transmitted: Stamp::NEVER,
            sync_in_flight: None,
            sync_again: None,
            sync_seen: Stamp::NEVER,
            stall: None,
            other_master: None,
            next_setup: 0,
            drives,
            counters: LineCounters::default(),
        })
    }

    /// Reads what came since the last cycle, complete up to `heard_until`, and tells what the drives of this bus say.
    pub fn receive(
        &mut self,
        now: Stamp,
        heard_until: Stamp,
        frames: &FrameBatch,
        health: BusHealth,
        feedbacks: &mut DriveFeedbacks,
    ) {
        let listened = self.listening.advance(heard_until);
        self.waited = if self.is_waiting() { Span(self.waited.0.saturating_add(listened.0)) } else { Span::ZERO };
        for frame in frames {
            self.take(now, &frame);
        }
        self.supervise(now, health, listened);
        for drive in self.drives.iter().flatten() {
            if let Some(feedback) = feedbacks.drives.get_mut(drive.index()) {
                *feedback = *drive.feedback();
            }
        }
        if let Some(slot) = feedbacks.health.get_mut(self.bus) {
            *slot = self.health(now, health);
        }
    }

    /// Chooses the frames of this cycle.
    pub fn transmit(&mut self, now: Stamp, commands: &DriveCommands, out: &mut FrameBatch) {
        self.transmitted = now;
        if self.stall.is_some() {
            self.probe(now, out);
            return;
        }
        let phase = self.cycle % self.plan.round;
        self.put_setup(now, phase, out);
        self.put_heartbeat(now, phase, out);
        self.put_commands(now, phase, commands, out);
        self.put_sync(now, out);
    }

    /// The frames of the last [`Self::transmit`] were not sent: none of them is in flight, and the drives counted no SYNC.
    pub fn take_back(&mut self) {
        let at = self.transmitted;
        for drive in self.drives.iter_mut().flatten() {
            drive.take_back(at);
        }
        for sync in [&mut self.sync_in_flight, &mut self.sync_again] {
            if *sync == Some(at) {
                *sync = None;
                self.cycle = self.cycle.wrapping_sub(1);
            }
        }
        if self.heartbeat_sent == at {
            self.heartbeat_sent = Stamp::NEVER;
        }
        if let Some(stall) = &mut self.stall {
            stall.powers_off &= stall.probe != Some(at);
            stall.probe = stall.probe.filter(|sent| *sent != at);
        }
    }

    /// Zero torque and voltage off for every node, and the SYNC that makes it act. The frames never change, so they
    /// can be taken once and kept for a panic hook.
    pub fn stop_frames(&self, out: &mut FrameBatch) {
        for drive in self.drives.iter().flatten() {
            drive.stop_frames(out);
        }
        if self.canopen {
            out.push(BusFrame::ours(Stamp::default(), SYNC_FRAME));
        }
    }

    /// What happened since the start.
    #[must_use]
    pub const fn counters(&self) -> &LineCounters {
        &self.counters
    }

    fn health(&self, now: Stamp, reported: BusHealth) -> BusHealth {
        match reported {
            BusHealth::Active | BusHealth::Passive if self.is_contested(now) => BusHealth::Contested,
            BusHealth::Active | BusHealth::Passive if self.stall.is_some() => BusHealth::Stalled,
            other => other,
        }
    }

    fn is_contested(&self, now: Stamp) -> bool {
        self.other_master.is_some_and(|at| now.since(at) < CONTESTED_FOR)
    }

    fn take(&mut self, now: Stamp, received: &BusFrame) {
        if self.take_direct(now, received) {
            return;
        }
        if !self.canopen {
            return self.count_foreign();
        }
        let stamp = received.stamp;
        match Message::parse(&received.frame) {
            // What only a master says, and not we: its commands would move our motors, and pass for our echoes.
            Ok(Message::Sync(_) | Message::Rpdo(..) | Message::Nmt(..) | Message::Heartbeat(Node::MASTER, _))
                if !received.own =>
            {
                self.counters.masters = self.counters.masters.saturating_add(1);
                self.other_master = Some(now);
            }
            Ok(Message::Sync(_)) => self.on_sync_echo(stamp),
            Ok(Message::Rpdo(_, node, _)) => self.on_command_echo(node, &received.frame),
            Ok(Message::Nmt(..)) => self.on_probe_echo(),
            Ok(Message::SdoRequest(..) | Message::Heartbeat(Node::MASTER, _)) => {}
            Ok(Message::Tpdo(1, node, pdo)) => match (Answer::parse(&pdo), self.drive(node)) {
                (Some(answer), Some(drive)) => self.on_answer(drive, &answer, stamp),
                _ => self.count_foreign(),
            },
            Ok(Message::SdoReply(node, reply)) => self.with(node, |drive, _| drive.on_sdo(&reply, stamp)),
            Ok(Message::Heartbeat(node, state)) => self.with(node, |drive, counters| {
                counters.reboots += u32::from(drive.on_heartbeat(state, stamp));
            }),
            Ok(Message::Emergency(node, emergency)) => self.with(node, |drive, counters| {
                counters.emergencies += u32::from(emergency.code != 0);
                drive.on_emergency(&emergency, stamp);
            }),
            Ok(Message::Tpdo(..)) | Err(_) => self.count_foreign(),
        }
    }

    /// True if the frame is to or from a drive that is commanded frame by frame.
    fn take_direct(&mut self, now: Stamp, received: &BusFrame) -> bool {
        for member in self.drives.iter_mut().flatten() {
            let Member::Direct(drive) = member else { continue };
            match drive.hear(received) {
                Heard::Foreign => continue,
                Heard::Garbled => self.counters.foreign = self.counters.foreign.saturating_add(1),
                Heard::Echo | Heard::OwnQuestion if !received.own => {
                    self.counters.masters = self.counters.masters.saturating_add(1);
                    self.other_master = Some(now);
                }
                Heard::OwnQuestion => {}
                Heard::Word(word) if !word.answers_command => {}
                Heard::Word(_) => self.waited = Span::ZERO,
                Heard::Echo => {
                    self.waited = Span::ZERO;
                    if !self.canopen && drive.probe() == Some(received.frame) {
                        self.on_probe_echo();
                    }
                }
            }
            return true;
        }
        false
    }

    fn drive(&self, node: Node) -> Option<usize> {
        let mut drives = self.drives.iter().flatten();
        drives.find(|member| matches!(member, Member::Canopen(drive) if drive.node == node)).map(Member::index)
    }

    fn with(&mut self, node: Node, act: impl FnOnce(&mut DriveLine, &mut LineCounters)) {
        let found = self.drives.iter_mut().flatten().find_map(|member| match member {
            Member::Canopen(drive) => Some(drive).filter(|drive| drive.node == node),
            Member::Direct(_) => None,
        });
        match found {
            Some(drive) => act(drive, &mut self.counters),
            None => self.count_foreign(),
        }
    }

    fn count_foreign(&mut self) {
        self.counters.foreign = self.counters.foreign.saturating_add(1);
    }

    /// A queue keeps its order: a SYNC that was sent before this command has left too, though nobody heard its echo.
    fn on_command_echo(&mut self, node: Node, frame: &CanFrame) {
        self.waited = Span::ZERO;
        let mut sent = None;
        self.with(node, |drive, _| sent = drive.in_flight.hear_echo(frame));
        if sent.is_some_and(|sent| self.sync_in_flight.is_some_and(|sync| sync < sent)) {
            self.sync_in_flight = None;
        }
    }

    /// A queue keeps its order: what was sent before this SYNC has left too.
    fn on_sync_echo(&mut self, stamp: Stamp) {
        self.sync_seen = stamp;
        if let Some(sent) = self.sync_in_flight.take() {
            self.prove_departure(sent);
        }
    }

    fn prove_departure(&mut self, until: Stamp) {
        self.waited = Span::ZERO;
        for drive in self.drives.iter_mut().flatten() {
            drive.prove_departure(until);
        }
    }

    fn on_probe_echo(&mut self) {
        if self.stall.is_some_and(|s| s.probe.is_some()) {
            self.stall = None;
            self.sync_in_flight = None;
            self.waited = Span::ZERO;
        }
    }

    fn on_answer(&mut self, index: usize, answer: &Answer, stamp: Stamp) {
        // Without echoes (some adapters give none) an answer proves that the SYNC before it left.
        if let Some(sent) = self.sync_in_flight.filter(|sent| stamp.since(*sent) >= FASTEST_ANSWER) {
            self.sync_in_flight = None;
            self.prove_departure(sent);
        }
        let sampled = if self.sync_seen <= stamp && self.sync_seen != Stamp::NEVER { self.sync_seen } else { stamp };
        if let Some(Member::Canopen(drive)) = self.drives.get_mut(index).and_then(Option::as_mut) {
            drive.on_answer(answer, sampled);
        }
    }

    fn supervise(&mut self, now: Stamp, health: BusHealth, listened: Span) {
        for drive in self.drives.iter_mut().flatten() {
            drive.supervise(now, listened);
        }
        let link_dead = matches!(health, BusHealth::Off | BusHealth::Down);
        let dead = link_dead || health == BusHealth::Stalled;
        let overdue = self.waited > self.echo_timeout || self.in_flight_for(now) > self.watchdog;
        match &mut self.stall {
            None if dead || overdue => {
                self.counters.stalls += 1;
                self.stall = Some(Stall { probe: None, link_dead, powers_off: false });
                self.drives.iter_mut().flatten().for_each(Member::on_stall);
            }
            None => {}
            Some(stall) => {
                stall.link_dead = link_dead;
                // A probe that was on its way when the link died is lost.
                stall.probe = stall.probe.filter(|_| !link_dead);
                stall.powers_off &= !link_dead;
            }
        }
    }

    /// How long the oldest frame in flight has been so.
    fn in_flight_for(&self, now: Stamp) -> Span {
        let oldest =
            self.drives.iter().flatten().filter_map(Member::command_in_flight).chain(self.sync_in_flight).min();
        oldest.map_or(Span::ZERO, |sent| now.since(sent))
    }

    fn is_waiting(&self) -> bool {
        self.sync_in_flight.is_some() || self.drives.iter().flatten().any(|drive| drive.command_in_flight().is_some())
    }

    fn probe(&mut self, now: Stamp, out: &mut FrameBatch) {
        let frame = self.probe_frame();
        let Some(stall) = &mut self.stall else { return };
        if stall.link_dead || stall.probe.is_some_and(|sent| now.since(sent) <= PROBE_EVERY) {
            return;
        }
        stall.probe = Some(now);
        out.push(BusFrame::ours(now, frame));
        // Some motors keep their power when they hear nothing: each gets its power off right behind what it would follow.
        if std::mem::replace(&mut stall.powers_off, true) {
            return;
        }
        for drive in self.drives.iter().flatten() {
            let Member::Direct(drive) = drive else { continue };
            if let Some(off) = drive.probe().filter(|off| *off != frame) {
                out.push(BusFrame::ours(now, off));
            }
        }
    }

    /// On a bus with CANopen drives a reset of all nodes; else the first drive's power off.
    fn probe_frame(&self) -> CanFrame {
        let direct = self.drives.iter().flatten().find_map(|member| match member {
            Member::Direct(drive) => drive.probe(),
            Member::Canopen(_) => None,
        });
        let reset = Message::Nmt(NmtCommand::ResetNode, None).emit();
        direct.filter(|_| !self.canopen).unwrap_or(reset)
    }

    /// One set-up frame, the drives taking turns, where the timetable has room.
    fn put_setup(&mut self, now: Stamp, phase: u32, out: &mut FrameBatch) {
        if !self.plan.allows_setup(phase) {
            return;
        }
        for k in 0..DRIVES {
            let index = (self.next_setup + k) % DRIVES;
            let drive = self.drives.get_mut(index).and_then(Option::as_mut);
            if let Some(frame) = drive.and_then(|d| d.setup_frame(now, phase)) {
                self.next_setup = index + 1;
                out.push(BusFrame::ours(now, frame));
                return;
            }
        }
    }

    fn put_heartbeat(&mut self, now: Stamp, phase: u32, out: &mut FrameBatch) {
        // The lowest of all priorities: in a queue that does not move it would hold up the power off behind it.
        let moves = self.waited <= self.moves_within;
        let due = phase + 1 == self.plan.round && now.since(self.heartbeat_sent) >= self.heartbeat_every;
        if self.canopen && due && moves {
            self.heartbeat_sent = now;
            let frame = Message::Heartbeat(Node::MASTER, NmtState::Operational).emit();
            out.push(BusFrame::ours(now, frame));
        }
    }

    fn put_commands(&mut self, now: Stamp, phase: u32, commands: &DriveCommands, out: &mut FrameBatch) {
        for drive in self.drives.iter_mut().flatten() {
            let command = commands.drives.get(drive.index()).copied().unwrap_or(DriveCommand::default());
            drive.note_command(&command);
            if !drive.wants_command(phase, &command) {
                continue;
            }
            // A command that takes goal or torque away may follow the one in flight: it is safer behind it than not there.
            if drive.command_in_flight().is_some() && !drive.is_lowered_by(&command) {
                self.counters.withheld = self.counters.withheld.saturating_add(1);
                continue;
            }
            out.push(BusFrame::ours(now, drive.command(now, &command)));
        }
    }

    /// The round advances with the SYNCs that go out, because the drives count those.
    fn put_sync(&mut self, now: Stamp, out: &mut FrameBatch) {
        if !self.sync_by_us || !self.canopen {
            self.cycle = self.cycle.wrapping_add(1);
        } else if let Some(place) = self.next_sync(now) {
            *place = Some(now);
            self.cycle = self.cycle.wrapping_add(1);
            out.push(BusFrame::ours(now, SYNC_FRAME));
        }
    }

    /// Where the next SYNC is noted, if one may go out. Where no drive answers every SYNC nothing else than its echo proves that
    /// it left: a single echo that is lost must not stop the round. So one more may go, without torque in it; what is proved
    /// by either is what was sent before the first.
    fn next_sync(&mut self, now: Stamp) -> Option<&mut Option<Stamp>> {
        match (self.sync_in_flight, self.sync_again) {
            (None, _) => {
                self.sync_again = None;
                Some(&mut self.sync_in_flight)
            }
            (Some(sent), None) if now.since(sent) >= self.moves_within => Some(&mut self.sync_again),
            _ => None,
        }
    }
}

#[cfg(test)]
mod tests;
