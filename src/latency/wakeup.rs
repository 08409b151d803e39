//! Wake-up of our control thread against cyclictest: same priority, same core, same period, windows in turn.
//!
//! cyclictest does nothing but note the time, so its thread finds its instructions and data in the cache again. Ours does
//! a real tick after each wake-up, which displaces them: that is what the robot sees. To tell the two apart our sleeper
//! is measured once with a tick and once without. RT: the measured thread.

use std::thread;

use super::cyclictest::{self, CyclictestError};
use super::window::{Paired, Window};
use crate::base::time::Span;
use crate::config::checked::Thread;
use crate::rt::clock::Monotonic;
use crate::rt::cycle::Cycle;
use crate::rt::thread as scheduling;

/// Windows of both our sleepers beside the same windows of cyclictest.
#[derive(Clone, Debug, Default)]
pub struct Pairs {
    /// With a tick after each wake-up.
    pub working: Paired,
    /// With nothing to do.
    pub resting: Paired,
}

/// How to measure.
#[derive(Clone, Copy, Debug)]
pub struct Wakeup {
    /// FIFO priority of both.
    pub priority: u8,
    /// Core of both.
    pub core: usize,
    /// Period of both, us.
    pub period_us: u32,
    /// Wake-ups in a window.
    pub loops: u32,
}

impl Wakeup {
    /// One window of our thread; `work` is what it does after each wake-up.
    pub fn ours(&self, mut work: impl FnMut() + Send) -> Window {
        let config = Thread { priority: self.priority, core: Some(self.core), stack_bytes: 256 * 1024 };
        let (period, loops) = (Span::from_us(i64::from(self.period_us)), self.loops);
        thread::scope(|scope| {
            let measured = scope.spawn(move || {
                let mut samples = Vec::with_capacity(loops as usize);
                scheduling::enter(&config);
                let mut cycle = Cycle::start(Monotonic, period);
                for _ in 0..loops {
                    samples.push(cycle.wait().latency.as_us());
                    work();
                }
                Window::new(samples)
            });
            measured.join().unwrap_or_default()
        })
    }

    /// One window of cyclictest.
    ///
    /// # Errors
    /// If cyclictest is missing or fails.
    pub fn theirs(&self) -> Result<Window, CyclictestError> {
        cyclictest::window(self.priority, self.core, self.period_us, self.loops)
    }

    /// `windows` of each, in turn; `after_each` is told how many rounds are done.
    ///
    /// # Errors
    /// If cyclictest is missing or fails.
    pub fn compare(
        &self,
        windows: usize,
        mut work: impl FnMut() + Send,
        mut after_each: impl FnMut(usize),
    ) -> Result<Pairs, CyclictestError> {
        let mut pairs = Pairs::default();
        for done in 0..windows {
            pairs.working.ours.push(self.ours(&mut work));
            let theirs = self.theirs()?;
            pairs.working.theirs.push(theirs.clone());
            pairs.resting.theirs.push(theirs);
            pairs.resting.ours.push(self.ours(|| {}));
            after_each(done + 1);
        }
        Ok(pairs)
    }
}
