//! Samples of a running stream: their times, and what is missing among them. RT: yes.

use super::ImuCounters;
use crate::base::time::{Span, Stamp};
use crate::msg::{ImuBatch, ImuSample};
use crate::sensor::clock_fit::ClockFit;

/// A stream of one device.
#[derive(Clone, Debug)]
pub(super) struct Stream {
    ticks_per_s: u32,
    ticks_per_sample: u32,
    /// What a message takes on the line.
    line_time: Span,
    fit: ClockFit,
    last_ticks: Option<u32>,
    pub(super) counters: ImuCounters,
}

impl Stream {
    /// For a device whose timer counts so.
    pub(super) fn new(ticks_per_s: u32, ticks_per_sample: u32, line_time: Span) -> Self {
        let (fit, counters) = (ClockFit::new(ticks_per_s), ImuCounters::default());
        Self { ticks_per_s, ticks_per_sample, line_time, fit, last_ticks: None, counters }
    }

    /// The device tells its base rate only when it is asked.
    pub(super) fn set_ticks_per_sample(&mut self, ticks: u32) {
        self.ticks_per_sample = ticks;
    }

    /// Another stream begins: nothing is known of its clock.
    pub(super) fn restart(&mut self) {
        self.fit = ClockFit::new(self.ticks_per_s);
        self.last_ticks = None;
    }

    /// Messages lost since the start, of which so many were damaged: damaged, missing, not finite or overtaken.
    pub(super) fn lost(&self, damaged: u32) -> u32 {
        // A damaged message is also missing by the timer: not both.
        let lost = self.counters.missing.max(damaged).saturating_add(self.counters.not_finite);
        lost.saturating_add(self.counters.overtaken)
    }

    /// Stamps a sample whose message arrived at `now`, and adds it to the batch.
    pub(super) fn take(&mut self, now: Stamp, mut sample: ImuSample, batch: &mut ImuBatch) {
        self.count_missing(sample.device_ticks);
        sample.stamp = self.fit.map(sample.device_ticks, now) - self.line_time;
        if is_finite(&sample) {
            let overtaken = u32::from(!batch.push_newest(sample));
            self.counters.overtaken = self.counters.overtaken.saturating_add(overtaken);
        } else {
            self.counters.not_finite = self.counters.not_finite.saturating_add(1);
        }
    }

    /// A step of the timer by several samples' worth: the ones between are lost.
    fn count_missing(&mut self, ticks: u32) {
        if let Some(last) = self.last_ticks.replace(ticks) {
            let step = ticks.wrapping_sub(last);
            // A timer that steps back gives nearly the largest number.
            let samples =
                step.saturating_add(self.ticks_per_sample / 2).checked_div(self.ticks_per_sample).unwrap_or(1);
            // Beyond ten seconds the device was restarted.
            if step < self.ticks_per_s.saturating_mul(10) {
                self.counters.missing = self.counters.missing.saturating_add(samples.saturating_sub(1));
            }
        }
    }
}

fn is_finite(sample: &ImuSample) -> bool {
    sample.euler_rad.iter().chain(&sample.rate_rad_s).chain(&sample.accel_g).all(|x| x.is_finite())
}
