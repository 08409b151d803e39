//! A device's clock mapped to ours by the lower envelope of the delays.
//!
//! Bytes arrive when an adapter, a scheduler and a buffer let them; the delay is never less than some minimum. So the
//! smallest `arrival - device time` seen is the best guess of the offset. It falls at once and rises slowly: the rise
//! follows clocks that drift apart by up to [`MAX_DRIFT`], and limits the error between two undelayed messages.
//! A least-squares line through all arrivals was the alternative; bursts of 16 ms (FTDI) pull it by milliseconds.
//! RT: yes.

use crate::base::time::{Span, Stamp};

/// Clocks drift apart by one part in so many at most: 100 ppm, twice what crystals of such devices are specified for.
const MAX_DRIFT: i64 = 10_000;
/// A gap of the device's timer beyond this is a restart of the device.
const MAX_GAP: Span = Span::from_ms(10_000);

/// The map of one device.
#[derive(Clone, Copy, Debug, Default)]
pub struct ClockFit {
    ticks_per_s: u32,
    started: bool,
    last_ticks: u32,
    /// Device time since the first message, ns.
    device_ns: i64,
    /// Ticks of `device_ns` that make no whole nanosecond are kept here.
    device_ticks: i64,
    /// Smallest arrival minus device time, ns, with its slow rise.
    offset_ns: i64,
}

impl ClockFit {
    /// For a timer of so many ticks per second that wraps at 32 bits.
    #[must_use]
    pub fn new(ticks_per_s: u32) -> Self {
        Self { ticks_per_s: ticks_per_s.max(1), ..Self::default() }
    }

    /// When the device's timer stood at `ticks`, given that the message with it arrived at `arrival`.
    pub fn map(&mut self, ticks: u32, arrival: Stamp) -> Stamp {
        let step = self.ns(i64::from(ticks.wrapping_sub(self.last_ticks)));
        if !self.started || step > MAX_GAP.0 {
            self.restart(ticks, arrival);
        } else {
            self.advance(ticks, arrival, step);
        }
        Stamp(self.device_ns.saturating_add(self.offset_ns))
    }

    fn restart(&mut self, ticks: u32, arrival: Stamp) {
        self.started = true;
        self.last_ticks = ticks;
        self.device_ticks = 0;
        self.device_ns = 0;
        self.offset_ns = arrival.0;
    }

    fn advance(&mut self, ticks: u32, arrival: Stamp, step_ns: i64) {
        self.device_ticks += i64::from(ticks.wrapping_sub(self.last_ticks));
        self.last_ticks = ticks;
        self.device_ns = self.ns(self.device_ticks);
        let risen = self.offset_ns.saturating_add(step_ns / MAX_DRIFT);
        self.offset_ns = risen.min(arrival.0.saturating_sub(self.device_ns));
    }

    fn ns(&self, ticks: i64) -> i64 {
        let per_s = i64::from(self.ticks_per_s);
        // In two parts, so that months of ticks do not overflow.
        ticks / per_s * 1_000_000_000 + ticks % per_s * 1_000_000_000 / per_s
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TICKS: u32 = 62_500;

    /// Runs messages at 1 kHz with a delay per message, device clock fast by `ppm`; worst error after `warm` messages.
    fn worst_error_us(count: u32, first_ticks: u32, ppm: f64, warm: u32, delay_us: impl Fn(u32) -> f64) -> f64 {
        let mut fit = ClockFit::new(TICKS);
        let mut worst: f64 = 0.0;
        for k in 0..count {
            let true_s = f64::from(k) * 1e-3;
            let device = (true_s * (1.0 + ppm * 1e-6) * f64::from(TICKS)) as u64;
            let ticks = first_ticks.wrapping_add(device as u32);
            let arrival = Stamp(((true_s + delay_us(k) * 1e-6) * 1e9) as i64);
            let error = fit.map(ticks, arrival).as_s() - true_s;
            if k >= warm {
                worst = worst.max(error.abs());
            }
        }
        worst * 1e6
    }

    #[test]
    fn bursts_of_sixteen_milliseconds_do_not_move_the_stamps() {
        // All messages of a burst arrive with its last one, which has no delay.
        let worst = worst_error_us(4000, 0, 0.0, 32, |k| f64::from(15 - k % 16) * 1000.0);
        // 16 us: one tick. 1.6 us: rise within a burst.
        assert!(worst < 20.0, "{worst} us");
    }

    #[test]
    fn drifting_clocks_are_followed_both_ways() {
        for ppm in [-80.0, 80.0] {
            let worst = worst_error_us(20_000, 0, ppm, 100, |k| f64::from(k % 7) * 100.0);
            assert!(worst < 20.0, "{ppm} ppm: {worst} us");
        }
    }

    #[test]
    fn the_timer_may_wrap() {
        let worst = worst_error_us(4000, u32::MAX - 60_000, 0.0, 16, |_| 0.0);
        assert!(worst < 20.0, "{worst} us");
    }

    #[test]
    fn a_restarted_device_starts_the_map_anew() {
        let mut fit = ClockFit::new(TICKS);
        fit.map(3_000_000_000, Stamp(5_000_000_000));
        assert_eq!(fit.map(7, Stamp(6_000_000_000)), Stamp(6_000_000_000));
    }
}
