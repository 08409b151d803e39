//! What the view knows: the newest tick, and what has to be gathered over many. RT: no.

use super::Side;
use super::footing::Footing;
use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::msg::{BUSES, FaultCode, LidarState, Mode, Terrain, TerrainState, TickRecord, ZeroState};
use hdrhistogram::Histogram;
use std::collections::VecDeque;
use std::io;

/// Points of the torque's history.
pub(super) const HISTORY_POINTS: usize = 240;
/// Time of one point: 12 s in all.
const HISTORY_STEP: Span = Span::from_ms(50);
/// Events that are kept.
const EVENTS: usize = 50;

/// Everything that is shown.
pub(super) struct State {
    pub(super) config: Config,
    pub(super) tick: TickRecord,
    pub(super) seen: bool,
    pub(super) start: Stamp,
    pub(super) wake_ns: Histogram<u64>,
    pub(super) step_ns: Histogram<u64>,
    /// Hip torque let through, Nm, oldest first.
    pub(super) torque_nm: VecDeque<f64>,
    pub(super) footing: Footing,
    /// Mode changes, faults and notices with their times, newest last.
    pub(super) events: VecDeque<(Span, String)>,
    /// Ticks that the view itself did not get.
    pub(super) missed: u64,
    pub(super) side: Side,
    pub(super) quit_means: &'static str,
    pub(super) frames: [FrameRates; BUSES],
    news: Vec<String>,
    history_due: Stamp,
    losses_told: [u32; 3],
    losses_due: Stamp,
}

/// Frames of one bus: counted over a second, then shown for a second.
#[derive(Clone, Copy, Default)]
pub(super) struct FrameRates {
    pub(super) received_hz: u32,
    pub(super) sent_hz: u32,
    received: u32,
    sent: u32,
    since: Stamp,
}

impl FrameRates {
    fn add(&mut self, now: Stamp, received: u8, sent: u8) {
        self.received += u32::from(received);
        self.sent += u32::from(sent);
        if now.since(self.since) >= Span::from_ms(1000) {
            *self = Self { received_hz: self.received, sent_hz: self.sent, since: now, ..Self::default() };
        }
    }
}

/// Nanoseconds to one second with three digits: 60 kB.
fn histogram() -> io::Result<Histogram<u64>> {
    Histogram::new_with_bounds(1, 1_000_000_000, 3).map_err(io::Error::other)
}

impl State {
    pub(super) fn new(config: &Config) -> io::Result<Self> {
        Ok(Self {
            config: config.clone(),
            tick: TickRecord::default(),
            seen: false,
            start: Stamp(0),
            wake_ns: histogram()?,
            step_ns: histogram()?,
            torque_nm: VecDeque::with_capacity(HISTORY_POINTS),
            footing: Footing::default(),
            events: VecDeque::with_capacity(EVENTS),
            missed: 0,
            side: Side::default(),
            quit_means: "q: quit",
            frames: [FrameRates::default(); BUSES],
            news: Vec::new(),
            history_due: Stamp(0),
            losses_told: [0; 3],
            losses_due: Stamp::NEVER,
        })
    }

    /// Takes the next tick.
    pub(super) fn take(&mut self, tick: &TickRecord) {
        if !self.seen {
            self.start = tick.input.now;
            self.history_due = tick.input.now;
        }
        self.notice_events(tick);
        self.notice_losses(tick);
        self.notice_lidar(tick);
        self.footing.take(&self.config, &self.tick, tick);
        record(&mut self.wake_ns, tick.input.wake_latency);
        record(&mut self.step_ns, tick.input.step_time);
        let batches = tick.input.received.iter().zip(&tick.output.send);
        for (rates, (received, sent)) in self.frames.iter_mut().zip(batches) {
            rates.add(tick.input.now, received.count, sent.count);
        }
        if tick.input.now >= self.history_due {
            self.history_due += HISTORY_STEP;
            keep(&mut self.torque_nm, HISTORY_POINTS, tick.allowed.hip_torque_nm);
        }
        self.tick = *tick;
        self.seen = true;
    }

    /// Takes what does not travel with ticks.
    pub(super) fn take_side(&mut self, mut side: Side) {
        for notice in std::mem::take(&mut side.notices) {
            self.event(notice);
        }
        self.side = side;
    }

    /// Lines that were not told yet.
    pub(super) fn take_news(&mut self) -> Vec<String> {
        std::mem::take(&mut self.news)
    }

    /// Time since the first tick.
    pub(super) fn elapsed(&self) -> Span {
        self.tick.input.now.since(self.start)
    }

    fn notice_events(&mut self, tick: &TickRecord) {
        let (before, after) = (self.tick.status, tick.status);
        let index_before = self.tick.input.index;
        if self.seen && tick.input.index > index_before + 1 {
            self.missed += tick.input.index - index_before - 1;
        }
        if !self.seen || before.mode != after.mode {
            self.event_at(tick.input.now, format!("mode {}", mode_name(after.mode)));
            if let Some(text) = missing_zeros(tick).filter(|_| after.mode == Mode::Disarmed) {
                self.event_at(tick.input.now, text);
            }
        }
        let fault = after.first_fault;
        let is_new = fault.code != before.first_fault.code || fault.stamp != before.first_fault.stamp;
        if fault.code != FaultCode::None && is_new {
            let text = format!("fault {} {fault}", fault.code as u8);
            self.event_at(tick.input.now, text);
        }
    }

    /// Frames and samples that were lost on their way, told when their number has grown, once a second at most.
    fn notice_losses(&mut self, tick: &TickRecord) {
        let input = &tick.input;
        let [bus0, bus1] = input.received.each_ref().map(|batch| batch.dropped);
        let lost = [bus0, bus1, input.imu.dropped];
        let grown = lost.iter().zip(self.losses_told).any(|(now, told)| *now > told);
        if grown && input.now >= self.losses_due {
            self.losses_told = lost;
            self.losses_due = input.now + Span::from_ms(1000);
            let text = format!("lost so far: {bus0} and {bus1} frames, {} IMU messages", input.imu.dropped);
            self.event_at(input.now, text);
        }
    }

    /// What the lidar says of itself, told when it changes.
    fn notice_lidar(&mut self, tick: &TickRecord) {
        let (before, after) = (self.tick.terrain, tick.terrain);
        if after.lidar != before.lidar {
            self.event_at(tick.input.now, format!("lidar {}{}", after.lidar.name(), status_of(&after)));
        }
        if after.state != before.state && after.state == TerrainState::Holding {
            self.event_at(tick.input.now, "no line of the floor: the attitude's last correction is held".to_owned());
        }
    }

    fn event(&mut self, text: String) {
        self.event_at(self.tick.input.now, text);
    }

    fn event_at(&mut self, now: Stamp, text: String) {
        let since = now.since(self.start);
        self.news.push(format!("{:9.3} s  {text}", since.as_s()));
        keep(&mut self.events, EVENTS, (since, text));
    }
}

/// What a person has to do before the robot can be armed, if zeros are missing.
fn missing_zeros(tick: &TickRecord) -> Option<String> {
    let [hip, toes @ ..] = tick.feedback.drives.each_ref().map(|drive| drive.zero == ZeroState::Known);
    let hip = if hip { None } else { Some("align the legs and confirm the hip's zero (compass zero)") };
    let toes = if toes.iter().all(|known| *known) { None } else { Some("hold the switch while the toes find theirs") };
    let todo: Vec<&str> = hip.into_iter().chain(toes).collect();
    (!todo.is_empty()).then(|| format!("zeros are missing: {}", todo.join(", ")))
}

/// The lidar's status where it tells more than the state's name.
fn status_of(terrain: &Terrain) -> String {
    let [a, b] = terrain.status.to_be_bytes().map(char::from);
    let tells = matches!(terrain.lidar, LidarState::Hardware | LidarState::Refused);
    if tells { format!(", status {a}{b}") } else { String::new() }
}

/// What the floor says of the attitude, in a line; nothing without a lidar.
pub(super) fn terrain_in_words(terrain: &Terrain) -> Option<String> {
    let zero = format!("{:+.3}° ±{:.3}°", terrain.zero_rad.to_degrees(), terrain.zero_sigma_rad.to_degrees());
    match terrain.state {
        TerrainState::Off => None,
        TerrainState::Waiting => Some(format!("no floor yet, lidar {}", terrain.lidar.name())),
        TerrainState::Following => Some(format!("attitude {zero} by {} lines", terrain.lines)),
        TerrainState::Holding => {
            let age_s = terrain.line_age.as_s();
            Some(format!("attitude {zero} held for {age_s:.1} s, lidar {}", terrain.lidar.name()))
        }
    }
}

/// Puts an item at the end and takes the oldest away when there are too many.
fn keep<T>(items: &mut VecDeque<T>, most: usize, item: T) {
    if items.len() == most {
        items.pop_front();
    }
    items.push_back(item);
}

fn record(histogram: &mut Histogram<u64>, span: Span) {
    // A tick can be early by nothing, but never by less; a span beyond a second counts as a second.
    histogram.saturating_record(u64::try_from(span.0).unwrap_or(0));
}

/// A mode as a person says it.
pub(super) const fn mode_name(mode: Mode) -> &'static str {
    match mode {
        Mode::Starting => "starting",
        Mode::Disarmed => "disarmed",
        Mode::Arming => "arming",
        Mode::Armed => "ARMED",
        Mode::Faulted => "FAULT",
        Mode::Homing => "homing",
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    #[test]
    fn a_lidar_in_trouble_and_a_correction_that_is_held_are_told_when_they_begin() {
        let mut state = State::new(&config::load(None, &[]).unwrap().config).unwrap();
        let mut told = Vec::new();
        for (ms, lidar, terrain) in [
            (0, LidarState::Connecting, TerrainState::Waiting),
            (1, LidarState::Streaming, TerrainState::Following),
            (2, LidarState::Hardware, TerrainState::Following),
            (3, LidarState::Hardware, TerrainState::Holding),
            (4, LidarState::Hardware, TerrainState::Holding),
        ] {
            let mut tick = TickRecord::default();
            tick.input.now = Stamp(0) + Span::from_ms(ms);
            tick.terrain = Terrain { state: terrain, lidar, status: u16::from_be_bytes(*b"52"), ..Terrain::default() };
            state.take(&tick);
            told.extend(state.take_news());
        }
        let of = |what: &str| told.iter().filter(|line| line.contains(what)).count();
        assert_eq!((of("lidar Hardware, status 52"), of("is held"), of("lidar Streaming")), (1, 1, 1), "{told:?}");
    }

    #[test]
    fn losses_and_missing_zeros_are_told_and_not_at_every_tick() {
        let mut state = State::new(&config::load(None, &[]).unwrap().config).unwrap();
        let mut told = Vec::new();
        for ms in 0..3_000 {
            let mut tick = TickRecord::default();
            tick.input.now = Stamp(0) + Span::from_ms(ms);
            tick.input.received[1].dropped = u32::try_from(ms / 100).unwrap();
            tick.status.mode = if ms < 10 { Mode::Starting } else { Mode::Disarmed };
            state.take(&tick);
            told.extend(state.take_news());
        }
        assert_eq!(told.iter().filter(|line| line.contains("lost so far: 0 and")).count(), 3, "{told:?}");
        let zeros: Vec<_> = told.iter().filter(|line| line.contains("compass zero")).collect();
        assert_eq!(zeros.len(), 1, "{told:?}");
    }
}
