//! The control thread: wake, take the input, walk, send, hand over. RT: yes.
//!
//! It sends the frames itself: no further thread stands between the decision and the wire.

use super::awaited::Awaited;
use super::clock::{self, Monotonic};
use super::cycle::{Cycle, Wake};
use super::feed::Feed;
use super::process::Progress;
use super::stop::Stop;
use super::tick::Tick;
use crate::base::time::{Span, Stamp};
use crate::bus::line::SYNC_FRAME;
use crate::bus::{SendError, Transmit};
use crate::channel::ring::Ring;
use crate::config::checked::{RealTime, Trigger};
use crate::msg::{BUSES, BusHealth, FrameBatch, LidarSample, TickInput, TickRecord};
use crate::sensor::operator::Hand;
use std::sync::Arc;
use std::sync::atomic::Ordering;

/// Ticks after a stop was asked for: the drives are commanded to zero, confirm, and are disabled.
const TICKS_TO_STOP: u32 = 50;

/// What walks: the real tick, or a synthetic one on the bench.
pub trait Walk {
    /// A pure function of the input and the walker's own state.
    fn step(&mut self, input: &TickInput, tick: &mut TickRecord);
}

impl Walk for Tick {
    fn step(&mut self, input: &TickInput, tick: &mut TickRecord) {
        Self::step(self, input, tick);
    }
}

/// What the control thread owns.
pub struct ControlLoop<W, F> {
    /// What walks.
    pub walk: W,
    /// Where input comes from.
    pub feed: F,
    /// Sending half of each bus.
    pub wires: [Box<dyn Transmit + Send>; BUSES],
    /// The dead-man switch.
    pub hand: Hand,
    /// Words of the lidar, if there is one.
    pub lidar: Option<Arc<Ring<LidarSample>>>,
    /// Finished ticks, for the relay.
    pub handover: Arc<Ring<TickRecord>>,
    /// What a cycle waits for.
    pub awaited: Arc<Awaited>,
    /// Asks it to end.
    pub stop: Stop,
    /// What others may know while it runs.
    pub progress: Arc<Progress>,
    /// Timing.
    pub timing: RealTime,
    /// What was not granted; 0 if the buses are simulated.
    pub real_time_missing: u32,
}

/// What goes on from tick to tick. Large, so it is made before the loop and not on the way.
#[derive(Debug, Default)]
pub struct Desk {
    input: TickInput,
    record: TickRecord,
    link_down: [bool; BUSES],
}

impl<W: Walk, F: Feed> ControlLoop<W, F> {
    /// Runs until the stop, and `TICKS_TO_STOP` ticks longer. `after_each` is called between ticks. Returns what it
    /// worked on, so that the caller says when that is freed.
    pub fn run(&mut self, mut after_each: impl FnMut()) -> Box<Desk> {
        let mut desk = Box::<Desk>::default();
        let mut cycle = Cycle::start(Monotonic, self.timing.period);
        let mut left = TICKS_TO_STOP;
        while left > 0 {
            let wake = cycle.wait();
            self.take_input(&mut desk, wake);
            self.act(&mut desk);
            after_each();
            left -= u32::from(desk.input.stop_requested);
        }
        desk
    }

    fn take_input(&mut self, desk: &mut Desk, wake: Wake) {
        if self.timing.trigger == Trigger::Input {
            self.awaited.begin();
            self.sync(desk);
            self.feed.wait(wake.planned + self.timing.input_deadline);
        }
        let input = &mut desk.input;
        input.now = wake.planned;
        input.wake_latency = wake.latency;
        input.skipped = wake.skipped;
        input.real_time_missing = self.real_time_missing;
        input.stop_requested = self.stop.is_requested();
        self.feed.collect(input);
        input.lidar = self.lidar.as_deref().map_or_else(LidarSample::default, newest);
        input.operator = self.hand.poll(clock::now(), &desk.record.status);
        for (health, down) in input.bus_health.iter_mut().zip(desk.link_down) {
            *health = if down { (*health).max(BusHealth::Down) } else { *health };
        }
    }

    /// The clock of the buses, when the step itself comes later.
    fn sync(&mut self, desk: &mut Desk) {
        let synced = self.awaited.synced();
        let ends = self.wires.iter_mut().zip(&mut desk.link_down).zip(synced).zip(&desk.record.feedback.health);
        for (((wire, down), synced), health) in ends {
            // Over a bus that stalled only its probe goes: what would wait there is played when the peer is back.
            if synced && *health != BusHealth::Stalled {
                *down = self.progress.sent(wire.send(&SYNC_FRAME));
            }
        }
    }

    fn act(&mut self, desk: &mut Desk) {
        let begin = clock::now();
        let until = send_until(desk.input.now, begin, self.timing.period);
        self.walk.step(&desk.input, &mut desk.record);
        let wires = self.wires.iter_mut().zip(&desk.record.output.send).zip(&mut desk.link_down);
        for (((wire, frames), down), unsent) in wires.zip(&mut desk.input.unsent) {
            let is_fresh = || clock::now() <= until;
            (*down, *unsent) = send_fresh(wire.as_mut(), frames, &self.progress, is_fresh);
        }
        let step_time: Span = clock::now().since(begin);
        self.handover.push(&desk.record);
        self.progress.note(&desk.record);
        desk.input.step_time = step_time;
        desk.input.index += 1;
    }
}

/// What was decided in the cycle planned for `planned`, and begun at `begin`, is fresh until then. Who wakes late acts on input that
/// is up to a period younger than the plan; who is held up between the two does not.
fn send_until(planned: Stamp, begin: Stamp, period: Span) -> Stamp {
    begin.min(planned + period) + period
}

/// The newest word that waits; nothing if there is none.
fn newest(words: &Ring<LidarSample>) -> LidarSample {
    let mut newest = LidarSample::default();
    for _ in 0..words.waiting() {
        newest = words.pop().unwrap_or(newest);
    }
    newest
}

/// Hands over the frames one by one, each only while it is fresh: preempted on the way, what was decided a period ago is
/// not sent any more, and the next tick decides anew. Says whether the link is down, and whether anything was not sent.
fn send_fresh(
    wire: &mut (dyn Transmit + Send),
    frames: &FrameBatch,
    progress: &Progress,
    is_fresh: impl Fn() -> bool,
) -> (bool, bool) {
    let mut down = false;
    for frame in frames {
        if !is_fresh() {
            return (down, true);
        }
        down |= progress.sent(wire.send(&frame.frame));
    }
    // With nothing to send, what counts is whether it would have been sent.
    (down, frames.count == 0 && !is_fresh())
}

impl Progress {
    /// Counts a refused frame; true if the link is down.
    fn sent(&self, result: Result<(), SendError>) -> bool {
        if result.is_err() {
            self.refused_frames.fetch_add(1, Ordering::Relaxed);
        }
        result == Err(SendError::Down)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::{BusFrame, CanFrame};
    use std::cell::Cell;
    use std::rc::Rc;

    /// Counts what it is handed.
    struct Counting(u32);

    impl Transmit for Counting {
        fn send(&mut self, _frame: &CanFrame) -> Result<(), SendError> {
            self.0 += 1;
            Ok(())
        }
    }

    /// So many of three frames are handed over when they grow old after so many looks; and whether all counted as sent.
    fn sent(fresh_looks: u32) -> (u32, bool) {
        let mut frames = FrameBatch::default();
        for k in 0..3 {
            assert!(frames.push(BusFrame::ours(Stamp(0), CanFrame::new(0x201 + k, &[]))));
        }
        let looks = Rc::new(Cell::new(0));
        let is_fresh = || {
            looks.set(looks.get() + 1);
            looks.get() <= fresh_looks
        };
        let mut wire = Counting(0);
        let (_, unsent) = send_fresh(&mut wire, &frames, &Progress::default(), is_fresh);
        (wire.0, !unsent)
    }

    #[test]
    fn who_was_held_up_before_it_decided_has_no_further_period() {
        let (planned, period) = (Stamp(5_000_000_000), Span::from_ms(1));
        let until = |begin_us: i64| send_until(planned, planned + Span::from_us(begin_us), period).since(planned);
        assert_eq!(until(10), Span::from_us(1010), "a period for the step");
        assert_eq!(until(900), Span::from_us(1900), "woken late");
        assert_eq!(until(20_000), Span::from_us(2000), "preempted between the input and the step: too late already");
    }

    #[test]
    fn a_frame_that_has_grown_old_between_step_and_wire_is_not_sent_nor_those_after_it() {
        assert_eq!(sent(3), (3, true), "what has been handed over was sent");
        assert_eq!(sent(0), (0, false), "preempted before the first");
        assert_eq!(sent(1), (1, false), "preempted after the first");
    }
}
