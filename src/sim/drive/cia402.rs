//! A simulated CiA 402 drive: object server, network and power states, synchronous process data, heartbeat both ways,
//! emergencies, current loop with lag and limits. It knows nothing but frames and its shaft.
//!
//! When it no longer hears the heartbeat that it watches, or commands stay out beyond the RPDO's timer, it does what
//! object 0x6007 says: that is the protection that works when our process is killed. RT: no.

use super::{Asked, Defects, Electrics, Motion};
use crate::base::bytes::padded;
use crate::base::time::{Span, Stamp};
use crate::bus::canopen::{
    EMCY_HEARTBEAT_LOST, EMCY_PDO_TOO_SHORT, EMCY_RPDO_TIMEOUT, Emergency, Message, NmtCommand, NmtState, Node,
    PdoData, may_name,
};
use crate::bus::cia402::{self, State};
use crate::bus::pdo;
use crate::bus::sdo::{AbortCode, Address, SdoReply, SdoValue};
use crate::config::checked::{Cia402, DriveConfig, DriveMode, DriveProtocol};
use crate::msg::CanFrame;
use crate::sim::objects::{Objects, PdoSetup, Plate};
use crate::sim::torque_delay::TorqueDelay;

/// From reset to boot-up.
const BOOT_TIME: Span = Span::from_ms(40);
const MODE_POSITION: u32 = 8;
const MODE_TORQUE: u32 = 10;
const MODE_PROFILE_TORQUE: u32 = 4;

/// A drive.
#[derive(Clone, Debug)]
pub struct Cia402Drive {
    node: Node,
    mode: DriveMode,
    plate: Plate,
    objects: Objects,
    electrics: Electrics,
    /// What is broken.
    pub defects: Defects,
    nmt: NmtState,
    booting_until: Option<Stamp>,
    state: State,
    controlword: u16,
    rpdo: PdoSetup,
    tpdo: PdoSetup,
    waiting: Option<PdoData>,
    syncs: u32,
    /// Where the shaft is, counts from an origin of the world's.
    shaft_counts: i32,
    /// Where the shaft was when the drive began to count: its encoder is incremental.
    count_zero: i32,
    analog_counts: i16,
    torque_permille: f64,
    delay: TorqueDelay,
    heartbeat_due: Stamp,
    master_heard: Option<Stamp>,
    command_heard: Option<Stamp>,
    /// What the statusword is stuck at.
    stuck_at: Option<u16>,
}

impl Cia402Drive {
    pub(super) fn new(config: &DriveConfig, electrics: Electrics) -> Self {
        let node = Node::new(config.node).unwrap_or(Node::MASTER);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked: positive and small")]
        let rated_torque_mnm = libm::round(config.rated_torque_nm * 1e3) as u32;
        // A drive that is configured for profile torque has no cyclic torque: that is why.
        let profile = matches!(config.protocol, DriveProtocol::Cia402(Cia402 { profile_torque: true }));
        let torque_mode = if profile { MODE_PROFILE_TORQUE } else { MODE_TORQUE };
        let supported_modes = 1 << (MODE_POSITION - 1) | 1 << (torque_mode - 1);
        let plate = Plate { node, rated_torque_mnm, supported_modes };
        Self {
            node,
            mode: config.mode,
            plate,
            objects: Objects::new(plate),
            electrics,
            defects: Defects::default(),
            nmt: NmtState::PreOperational,
            booting_until: Some(Stamp::default() + BOOT_TIME),
            state: State::NotReady,
            controlword: 0,
            rpdo: PdoSetup::default(),
            tpdo: PdoSetup::default(),
            waiting: None,
            syncs: 0,
            shaft_counts: 0,
            count_zero: 0,
            analog_counts: 0,
            torque_permille: 0.0,
            delay: TorqueDelay::new(electrics.delay),
            heartbeat_due: Stamp::default(),
            master_heard: None,
            command_heard: None,
            stuck_at: None,
        }
    }

    /// Its statusword stays as it is; `no_power`: it switches itself off behind that.
    pub fn stick(&mut self, stuck: bool, no_power: bool) {
        self.stuck_at = stuck.then(|| self.statusword());
        if stuck && no_power {
            self.state = State::SwitchOnDisabled;
        }
    }

    /// Its power state.
    #[must_use]
    pub const fn state(&self) -> State {
        self.state
    }

    /// Torque that the motor makes, 1/1000 of rated.
    #[must_use]
    pub const fn torque_permille(&self) -> f64 {
        self.torque_permille
    }

    /// Position that its loop drives to, counts from the world's origin; `None` while it has no power or no such mode.
    #[must_use]
    pub fn target_counts(&self) -> Option<i32> {
        let follows = self.state == State::Enabled && self.objects.raw(0x6061, 0) == MODE_POSITION;
        follows.then(|| self.objects.raw(0x607A, 0).cast_signed().saturating_add(self.count_zero))
    }

    /// Torque that it should make now, 1/1000 of rated.
    fn torque_target(&self) -> f64 {
        let mode = self.objects.raw(0x6061, 0);
        if self.state != State::Enabled
            || self.defects.no_torque
            || (mode != MODE_TORQUE && mode != MODE_PROFILE_TORQUE)
        {
            return 0.0;
        }
        let [low, high, ..] = self.objects.raw(0x6071, 0).to_le_bytes();
        let limit = f64::from(self.objects.raw(0x6072, 0)).min(self.electrics.limit_permille);
        f64::from(i16::from_le_bytes([low, high])).clamp(-limit, limit)
    }

    /// Profile torque goes to its target at the slope of object 0x6087, 1/1000 of rated per s.
    fn ramped(&self, target: f64, dt: Span) -> f64 {
        if self.objects.raw(0x6061, 0) != MODE_PROFILE_TORQUE {
            return target;
        }
        let step = f64::from(self.objects.raw(0x6087, 0)) * dt.as_s();
        target.clamp(self.torque_permille - step, self.torque_permille + step)
    }

    /// Lets the current loop run for `dt` and gives the mean torque of that time, 1/1000 of rated.
    pub fn run_current_loop(&mut self, dt: Span) -> f64 {
        let target = self.delay.present(self.torque_target());
        let target = self.ramped(target, dt);
        self.electrics.run(&mut self.torque_permille, target, dt)
    }

    /// To be called after whatever may have changed its command.
    pub(super) fn note_command(&mut self, now: Stamp) {
        let target = (self.state == State::Enabled).then(|| self.torque_target());
        self.delay.note(now, target);
    }

    /// When a delayed command takes effect, if one is on its way.
    pub(super) fn next_torque(&self) -> Option<Stamp> {
        self.delay.next()
    }

    /// The delayed commands due by now take effect.
    pub(super) fn take_torque(&mut self, now: Stamp) {
        self.delay.arrive(now);
    }

    /// Where the shaft is, counts from the world's origin; the encoder's part of it is taken over by the next SYNC.
    pub fn set_position(&mut self, counts: i32) {
        self.shaft_counts = counts;
    }

    /// The analogue input's count, taken over by the next SYNC.
    pub fn set_analog(&mut self, counts: i16) {
        self.analog_counts = counts;
    }

    /// A frame on its bus; what it answers goes to `out`. True if it was a command to this drive.
    pub fn hear(&mut self, now: Stamp, frame: &CanFrame, out: &mut Vec<CanFrame>) -> bool {
        // Of what others say it listens to the heartbeat of the one it watches.
        let is_other = !may_name(frame, self.node.number()) && !may_name(frame, self.watched_node().number());
        if self.defects.unplugged || is_other {
            return false;
        }
        let Ok(message) = Message::parse(frame) else { return false };
        if self.booting_until.is_some() {
            return false;
        }
        match message {
            Message::Nmt(command, node) if node.is_none_or(|n| n == self.node) => self.obey(now, command),
            Message::Sync(_) => self.on_sync(out),
            Message::Rpdo(_, node, pdo) if node == self.node => {
                self.on_command(now, frame, pdo, out);
                return true;
            }
            Message::SdoRequest(node, request) if node == self.node && !self.defects.mute_server => {
                let flowing = self.nmt == NmtState::Operational;
                if self.nmt != NmtState::Stopped {
                    let reply = self.objects.serve(&request, flowing).and_then(|r| self.spoiled(r));
                    out.extend(reply.map(|r| Message::SdoReply(self.node, r).emit()));
                }
            }
            Message::Heartbeat(node, _) if node == self.watched_node() => {
                self.master_heard = Some(now);
                self.recover(EMCY_HEARTBEAT_LOST, out);
            }
            _ => {}
        }
        false
    }

    /// What this frame asks of the drive, mapped as the configuration has it; see [`super::SimDrive::asked`].
    pub(super) fn asked(&mut self, frame: &CanFrame) -> Option<Asked> {
        let Ok(Message::Rpdo(1, node, pdo)) = Message::parse(frame) else { return None };
        if node != self.node {
            return None;
        }
        if self.rpdo.entries.is_empty() {
            let mapping = match self.mode {
                DriveMode::CyclicTorque => pdo::TORQUE_COMMAND,
                DriveMode::CyclicPosition => pdo::POSITION_COMMAND,
            };
            self.rpdo.entries = mapping.to_vec();
        }
        let mut ends_enabled = |state: State| {
            (self.state, self.controlword) = (state, cia402::SWITCH_ON);
            self.apply(&pdo, &mut Vec::new());
            self.state == State::Enabled
        };
        let powers = ends_enabled(State::SwitchedOn);
        let keeps = ends_enabled(State::Enabled);
        let motion = match self.mode {
            // Without power too: it would act on it as soon as it has some.
            DriveMode::CyclicTorque => {
                let [low, high, ..] = self.objects.raw(0x6071, 0).to_le_bytes();
                Motion::Torque(f64::from(i16::from_le_bytes([low, high])))
            }
            DriveMode::CyclicPosition if keeps => {
                Motion::Position { counts: f64::from(self.objects.raw(0x607A, 0).cast_signed()), most_permille: None }
            }
            DriveMode::CyclicPosition => Motion::Off,
        };
        Some(Asked { powers, motion })
    }

    /// What a broken object server makes of an answer.
    fn spoiled(&self, reply: SdoReply) -> Option<SdoReply> {
        let at = reply.address();
        match self.defects.server {
            "silent" => None,
            "abort" => Some(SdoReply::Abort(at, AbortCode::NO_SUCH_OBJECT)),
            "wrong_index" => Some(SdoReply::Written(Address::new(at.index ^ 1, at.sub))),
            _ => Some(reply),
        }
    }

    /// What it does by itself: boot-up, heartbeat, watching us. To be called once per millisecond.
    pub fn tick(&mut self, now: Stamp, out: &mut Vec<CanFrame>) {
        if let Some(until) = self.booting_until {
            if now >= until {
                self.booting_until = None;
                self.nmt = NmtState::PreOperational;
                self.state = State::SwitchOnDisabled;
                self.heartbeat_due = now;
                self.say(Message::Heartbeat(self.node, NmtState::BootUp), out);
            }
            return;
        }
        self.beat(now, out);
        self.watch(now, out);
        if self.state == State::FaultReaction {
            self.state = State::Fault;
        }
    }

    /// Cold start, as after a loss of power: everything that was written is gone, and the encoder counts from where the
    /// shaft happens to be.
    pub fn reboot(&mut self, now: Stamp) {
        self.count_zero = self.shaft_counts;
        let torque_modes = 1 << (MODE_TORQUE - 1) | 1 << (MODE_PROFILE_TORQUE - 1);
        let supported_modes = self.plate.supported_modes & if self.defects.no_torque_mode { !torque_modes } else { !0 };
        self.objects = Objects::new(Plate { supported_modes, ..self.plate });
        self.booting_until = Some(now + BOOT_TIME);
        self.nmt = NmtState::PreOperational;
        self.state = State::NotReady;
        self.controlword = 0;
        self.waiting = None;
        self.master_heard = None;
        self.command_heard = None;
    }

    /// A fault of its own: it shouts, stops, and stays faulted until reset.
    pub fn fail(&mut self, code: u16, out: &mut Vec<CanFrame>) {
        self.shout(code, out);
        self.state = State::FaultReaction;
    }

    fn say(&self, message: Message, out: &mut Vec<CanFrame>) {
        if !self.defects.unplugged {
            out.push(message.emit());
        }
    }

    fn shout(&mut self, code: u16, out: &mut Vec<CanFrame>) {
        self.objects.set(0x603F, 0, SdoValue::u16(code));
        let register = u8::from(code != 0);
        self.objects.set(0x1001, 0, SdoValue::u8(register));
        self.say(Message::Emergency(self.node, Emergency { code, register, maker: [0; 5] }), out);
    }

    fn obey(&mut self, now: Stamp, command: NmtCommand) {
        match command {
            NmtCommand::Start => {
                self.nmt = NmtState::Operational;
                self.rpdo = self.objects.pdo(0x1400, 0x1600);
                self.tpdo = self.objects.pdo(0x1800, 0x1A00);
                self.syncs = 0;
                self.command_heard = None;
            }
            NmtCommand::Stop => self.leave_operational(NmtState::Stopped),
            NmtCommand::PreOperational => self.leave_operational(NmtState::PreOperational),
            NmtCommand::ResetNode | NmtCommand::ResetCommunication => self.reboot(now),
        }
    }

    fn leave_operational(&mut self, nmt: NmtState) {
        self.nmt = nmt;
        self.lose_communication();
    }

    /// Object 0x6007: what to do when commands no longer come.
    fn lose_communication(&mut self) {
        if !matches!(self.state, State::SwitchedOn | State::Enabled | State::QuickStop) {
            return;
        }
        self.state = match self.objects.raw(0x6007, 0) {
            0 => self.state,
            1 => State::FaultReaction,
            3 => State::QuickStop,
            _ => State::SwitchOnDisabled,
        };
    }

    fn on_command(&mut self, now: Stamp, frame: &CanFrame, pdo: PdoData, out: &mut Vec<CanFrame>) {
        if self.nmt != NmtState::Operational || self.rpdo.id.map(u32::from) != Some(frame.id) {
            return;
        }
        if pdo.len < pdo::mapped_bytes(&self.rpdo.entries) {
            self.shout(EMCY_PDO_TOO_SHORT, out);
            return;
        }
        self.command_heard = Some(now);
        self.recover(EMCY_RPDO_TIMEOUT, out);
        if self.rpdo.kind <= 240 {
            self.waiting = Some(pdo);
        } else {
            self.apply(&pdo, out);
        }
    }

    /// The end of an emergency.
    fn recover(&mut self, code: u16, out: &mut Vec<CanFrame>) {
        if self.objects.raw(0x603F, 0) == u32::from(code) {
            self.shout(0, out);
        }
    }

    /// Writes the mapped objects; a controlword moves the power state.
    fn apply(&mut self, pdo: &PdoData, out: &mut Vec<CanFrame>) {
        let mut at = 0;
        let entries = std::mem::take(&mut self.rpdo.entries);
        // By default only the controlword is mapped.
        let mapped = if self.defects.mapping_lost == "command" { 1 } else { entries.len() };
        for entry in entries.iter().take(mapped) {
            let end = at + usize::from(entry.bits / 8);
            let raw = u32::from_le_bytes(padded(&pdo.data[at..end]));
            at = end;
            let value = match entry.bits {
                8 => SdoValue::u8(raw.to_le_bytes()[0]),
                16 => SdoValue::u16((raw & 0xFFFF) as u16),
                _ => SdoValue::u32(raw),
            };
            self.objects.set(entry.index, entry.sub, value);
        }
        self.rpdo.entries = entries;
        let word = (self.objects.raw(0x6040, 0) & 0xFFFF) as u16;
        let before = self.state;
        self.state = before.after(word, self.controlword);
        self.controlword = word;
        if before == State::Fault && self.state != State::Fault {
            self.shout(0, out);
        }
    }

    fn on_sync(&mut self, out: &mut Vec<CanFrame>) {
        if self.nmt != NmtState::Operational {
            return;
        }
        if let Some(pdo) = self.waiting.take() {
            self.apply(&pdo, out);
        }
        self.syncs += 1;
        let kind = u32::from(self.tpdo.kind);
        if (1..=240).contains(&kind) && self.syncs >= kind {
            self.syncs = 0;
            self.answer(out);
        }
    }

    fn answer(&mut self, out: &mut Vec<CanFrame>) {
        let Some(id) = self.tpdo.id else { return };
        self.refresh();
        let (mut data, mut len) = ([0; 8], 0);
        for entry in &self.tpdo.entries {
            let bytes = usize::from(entry.bits / 8);
            let raw = self.objects.raw(entry.index, entry.sub).to_le_bytes();
            data[len..len + bytes].copy_from_slice(&raw[..bytes]);
            len += bytes;
        }
        if self.defects.no_answer {
            return;
        }
        // By default only the statusword is mapped.
        let len = match self.defects {
            Defects { mapping_lost: "answer", .. } => len.min(2),
            Defects { short_answers: true, .. } => len.saturating_sub(1),
            _ => len,
        };
        out.push(CanFrame::new(id, &data[..len]));
        if self.defects.twice {
            out.push(CanFrame::new(id, &data[..len]));
        }
    }

    const fn statusword(&self) -> u16 {
        const VOLTAGE_PRESENT: u16 = 1 << 4;
        const REMOTE: u16 = 1 << 9;
        const FOLLOWS: u16 = 1 << 12;
        let follows = if matches!(self.state, State::Enabled) { FOLLOWS } else { 0 };
        self.state.statusword() | VOLTAGE_PRESENT | REMOTE | follows
    }

    /// Brings the objects that are read up to date.
    fn refresh(&mut self) {
        let word = self.stuck_at.unwrap_or_else(|| self.statusword());
        self.objects.set(0x6041, 0, SdoValue::u16(word));
        self.objects.set(0x6064, 0, SdoValue::i32(self.shaft_counts - self.count_zero));
        self.objects.set(0x6401, 1, SdoValue::i16(self.analog_counts));
        #[expect(clippy::cast_possible_truncation, reason = "limited to i16 by the torque limit")]
        let torque = libm::round(self.torque_permille) as i16;
        self.objects.set(0x6077, 0, SdoValue::i16(torque));
    }

    fn beat(&mut self, now: Stamp, out: &mut Vec<CanFrame>) {
        let period = Span::from_ms(i64::from(self.objects.raw(0x1017, 0)));
        if period > Span::ZERO && now >= self.heartbeat_due && !self.defects.no_heartbeat {
            self.heartbeat_due = now + period;
            self.say(Message::Heartbeat(self.node, self.nmt), out);
        }
    }

    /// The node that it watches (object 0x1016).
    fn watched_node(&self) -> Node {
        let [_, _, node, _] = self.objects.raw(0x1016, 1).to_le_bytes();
        Node::new(node).unwrap_or(self.node)
    }

    /// Watches our heartbeat (once it has been heard) and our commands.
    fn watch(&mut self, now: Stamp, out: &mut Vec<CanFrame>) {
        let heartbeat_limit = Span::from_ms(i64::from(self.objects.raw(0x1016, 1) & 0xFFFF));
        if expired(now, self.master_heard, heartbeat_limit) {
            self.master_heard = None;
            self.shout(EMCY_HEARTBEAT_LOST, out);
            self.lose_communication();
        }
        let command_limit = Span::from_ms(i64::from(self.rpdo.timer_ms));
        if self.nmt == NmtState::Operational && expired(now, self.command_heard, command_limit) {
            self.command_heard = None;
            self.shout(EMCY_RPDO_TIMEOUT, out);
            self.lose_communication();
        }
    }
}

fn expired(now: Stamp, heard: Option<Stamp>, limit: Span) -> bool {
    limit > Span::ZERO && heard.is_some_and(|at| now.since(at) > limit)
}
