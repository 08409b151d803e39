//! The way out. Whatever ends the process, the drives hear zero torque and "voltage off" first. RT: sending only.
//!
//! Three layers: the tick itself, which goes to `Faulted` when a stop is asked for; [`StopGuard`], which sends the stop
//! frames when the control thread leaves for any reason; the panic hook, which sends them before anything else happens,
//! destructors included. Below these: the drives' own watchdogs, for kill -9.

use crate::bus::Transmit;
use crate::msg::{BUSES, FrameBatch};
use signal_hook::consts::{SIGHUP, SIGINT, SIGQUIT, SIGTERM};
use std::panic;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError};

/// Asks all threads to end. Signals set it too.
#[derive(Clone, Debug, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Also set by SIGTERM, SIGINT, SIGQUIT, and by SIGHUP: a terminal or connection that is gone is no hand.
    ///
    /// # Errors
    /// When the handlers cannot be installed.
    pub fn on_signals() -> std::io::Result<Self> {
        let stop = Self::default();
        for signal in [SIGTERM, SIGINT, SIGQUIT, SIGHUP] {
            signal_hook::flag::register(signal, Arc::clone(&stop.0))?;
        }
        Ok(stop)
    }

    /// The flag itself, for those who look at it often.
    #[must_use]
    pub fn flag(&self) -> &AtomicBool {
        &self.0
    }

    /// Asks.
    pub fn request(&self) {
        self.0.store(true, Ordering::Release);
    }

    /// True once somebody asked.
    #[must_use]
    pub fn is_requested(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }
}

/// What is sent last: the frames of each bus and a way to send them that is nobody else's.
pub struct LastWords {
    /// Zero torque and disable, for every drive of the bus.
    pub frames: [FrameBatch; BUSES],
    /// Sending halves.
    pub wires: [Box<dyn Transmit + Send>; BUSES],
}

impl LastWords {
    /// Allocates nothing and waits for nothing. Returns the frames that a wire refused.
    fn speak(&mut self) -> u32 {
        let mut refused = 0;
        for (batch, wire) in self.frames.iter().zip(&mut self.wires) {
            for frame in batch {
                refused += u32::from(wire.send(&frame.frame).is_err());
            }
        }
        refused
    }
}

/// Held by the control thread: however the thread ends, the stop frames go out.
pub struct StopGuard {
    words: Arc<Mutex<LastWords>>,
    stop: Stop,
}

impl StopGuard {
    /// Takes over the last words and puts itself before the present panic hook, for panics of any thread.
    #[must_use]
    pub fn new(words: LastWords, stop: Stop) -> Self {
        let guard = Self { words: Arc::new(Mutex::new(words)), stop };
        guard.hook();
        guard
    }

    fn hook(&self) {
        let (words, stop) = (Arc::downgrade(&self.words), self.stop.clone());
        let before = panic::take_hook();
        panic::set_hook(Box::new(move |info| {
            if let Some(words) = words.upgrade() {
                say(&words);
                stop.request();
            }
            PANICS.fetch_add(1, Ordering::Relaxed);
            before(info);
        }));
    }
}

impl Drop for StopGuard {
    fn drop(&mut self) {
        say(&self.words);
        self.stop.request();
    }
}

static PANICS: AtomicU32 = AtomicU32::new(0);

/// Panics seen by the hooks since start.
#[must_use]
pub fn panics() -> u32 {
    PANICS.load(Ordering::Relaxed)
}

/// Whoever holds the lock is saying the same words right now, so nobody waits for it.
fn say(words: &Mutex<LastWords>) {
    match words.try_lock().map_err(|error| match error {
        TryLockError::Poisoned(poisoned) => Some(PoisonError::into_inner(poisoned)),
        TryLockError::WouldBlock => None,
    }) {
        Ok(mut words) | Err(Some(mut words)) => {
            words.speak();
        }
        Err(None) => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::loopback::{Loopback, pair};
    use crate::bus::{Receive, SendError};
    use crate::msg::{BusFrame, CanFrame};

    fn words(host: [Loopback; BUSES]) -> LastWords {
        let mut batch = FrameBatch::default();
        batch.push(BusFrame { frame: CanFrame::new(0x201, &[0; 4]), ..BusFrame::default() });
        LastWords { frames: [batch; BUSES], wires: host.map(|end| Box::new(end) as Box<dyn Transmit + Send>) }
    }

    fn wires() -> ([Loopback; BUSES], [Loopback; BUSES]) {
        let [(a, b), (c, d)] = [pair().unwrap(), pair().unwrap()];
        ([a, c], [b, d])
    }

    #[test]
    fn a_panic_anywhere_sends_the_stop_frames_before_destructors_run() {
        struct Witness(Loopback);
        impl Drop for Witness {
            fn drop(&mut self) {
                assert!(self.0.receive().is_some(), "the hook was first");
            }
        }
        let (host, [robot, mut other]) = wires();
        let stop = Stop::default();
        let guard = StopGuard::new(words(host), stop.clone());
        let witness = Witness(robot);
        let thread = std::thread::spawn(move || {
            let _witness = witness;
            panic!("on purpose");
        });
        assert!(thread.join().is_err());
        assert!(other.receive().is_some() && stop.is_requested() && panics() > 0);
        drop(guard);
    }

    #[test]
    fn every_signal_that_asks_a_process_to_end_is_a_stop() {
        for signal in [SIGTERM, SIGINT, SIGQUIT, SIGHUP] {
            let stop = Stop::on_signals().unwrap();
            signal_hook::low_level::raise(signal).unwrap();
            assert!(stop.is_requested(), "{signal}");
        }
    }

    #[test]
    fn leaving_the_loop_sends_the_stop_frames() {
        let (host, mut robot) = wires();
        drop(StopGuard::new(words(host), Stop::default()));
        assert!(robot.iter_mut().all(|end| end.receive().is_some_and(|f| f.frame.id == 0x201)));
    }

    #[test]
    fn one_dead_wire_does_not_silence_the_other() {
        struct Dead;
        impl Transmit for Dead {
            fn send(&mut self, _: &CanFrame) -> Result<(), SendError> {
                Err(SendError::Down)
            }
        }
        let ([host, _], [_, _]) = wires();
        let mut last = words(wires().0);
        let (end, mut robot) = pair().unwrap();
        drop(host);
        last.wires = [Box::new(Dead), Box::new(end)];
        assert_eq!(last.speak(), 1);
        assert!(robot.receive().is_some());
    }
}
