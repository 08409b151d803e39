//! Any bus, made worse: frames that come are lost, doubled, late or flipped, by a seeded draw. For tests and trials.
//! RT: yes.

use super::{Receive, SendError, Transmit};
use crate::msg::{BusFrame, BusHealth, CanFrame};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use std::os::fd::RawFd;

/// How bad, as shares of the received frames.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Faults {
    /// Never arrive.
    pub lose: f64,
    /// Arrive twice.
    pub double: f64,
    /// Arrive after the next one.
    pub delay: f64,
    /// Arrive with one bit of the data flipped (real CAN's checksum would not let it through).
    pub flip: f64,
}

/// A bus with faults.
#[derive(Debug)]
pub struct Faulty<B> {
    bus: B,
    faults: Faults,
    rng: ChaCha8Rng,
    /// Comes before anything new.
    next: Option<BusFrame>,
    /// Comes after the next one that arrives.
    late: Option<BusFrame>,
}

impl<B> Faulty<B> {
    /// Wraps a bus. The same seed gives the same faults.
    pub fn new(bus: B, faults: Faults, seed: u64) -> Self {
        Self { bus, faults, rng: ChaCha8Rng::seed_from_u64(seed), next: None, late: None }
    }

    /// Other faults from now on.
    pub fn set(&mut self, faults: Faults) {
        self.faults = faults;
    }

    /// The bus behind the faults.
    pub fn inner_mut(&mut self) -> &mut B {
        &mut self.bus
    }

    #[expect(clippy::cast_precision_loss, reason = "a draw of 53 bits")]
    fn draw(&mut self, share: f64) -> bool {
        ((self.rng.next_u64() >> 11) as f64) < share * 9_007_199_254_740_992.0
    }

    fn flip_a_bit(&mut self, frame: &mut CanFrame) {
        let bits = u64::from(frame.len) * 8;
        if bits > 0 {
            let at = self.rng.next_u64() % bits;
            if let Some(byte) = frame.data.get_mut(usize::try_from(at / 8).unwrap_or(0)) {
                *byte ^= 1 << (at % 8);
            }
        }
    }
}

impl<B: Transmit> Transmit for Faulty<B> {
    fn send(&mut self, frame: &CanFrame) -> Result<(), SendError> {
        self.bus.send(frame)
    }
}

impl<B: Receive> Receive for Faulty<B> {
    fn receive(&mut self) -> Option<BusFrame> {
        if let Some(frame) = self.next.take() {
            return Some(frame);
        }
        loop {
            let Some(mut frame) = self.bus.receive() else { return self.late.take() };
            if self.faults == Faults::default() && self.late.is_none() {
                return Some(frame);
            }
            if self.draw(self.faults.lose) {
                continue;
            }
            if self.draw(self.faults.flip) {
                self.flip_a_bit(&mut frame.frame);
            }
            if self.late.is_none() && self.draw(self.faults.delay) {
                self.late = Some(frame);
                continue;
            }
            self.next = if self.draw(self.faults.double) { Some(frame) } else { self.late.take() };
            return Some(frame);
        }
    }

    fn health(&self) -> BusHealth {
        self.bus.health()
    }

    fn readable_fd(&self) -> RawFd {
        self.bus.readable_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::{laws, loopback};

    fn through(faults: Faults, seed: u64) -> Vec<CanFrame> {
        let (mut a, b) = loopback::pair().unwrap();
        let mut b = Faulty::new(b, faults, seed);
        for k in 0..200 {
            a.send(&CanFrame::new(5, &[k])).unwrap();
        }
        std::iter::from_fn(|| b.receive()).map(|f| f.frame).collect()
    }

    #[test]
    fn without_faults_it_is_a_bus_like_any_other() {
        laws::bus_laws(|| {
            let (a, b) = loopback::pair().unwrap();
            (Faulty::new(a, Faults::default(), 1), Faulty::new(b, Faults::default(), 2))
        });
    }

    #[test]
    fn lost_frames_are_missing_and_doubled_ones_come_twice() {
        let lost = through(Faults { lose: 0.5, ..Faults::default() }, 3).len();
        assert!((70..130).contains(&lost), "{lost}");
        let doubled = through(Faults { double: 0.5, ..Faults::default() }, 3).len();
        assert!((270..330).contains(&doubled), "{doubled}");
    }

    #[test]
    fn delayed_frames_all_arrive_out_of_order() {
        let got = through(Faults { delay: 0.3, ..Faults::default() }, 4);
        let mut numbers: Vec<u8> = got.iter().map(|f| f.data[0]).collect();
        assert!(!numbers.is_sorted());
        numbers.sort_unstable();
        assert_eq!(numbers, (0..200).collect::<Vec<u8>>());
    }

    #[test]
    fn the_same_seed_gives_the_same_faults() {
        let faults = Faults { lose: 0.1, double: 0.1, delay: 0.1, flip: 0.1 };
        assert_eq!(through(faults, 9), through(faults, 9));
        assert_ne!(through(faults, 9), through(faults, 10));
    }
}
