//! Tells the service manager how it goes, and ends the run when its time is up. RT: no.

use crate::rt::process::Progress;
use crate::rt::stop::Stop;
use sd_notify::{NotifyState, notify, watchdog_enabled};
use std::io;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::thread::{Builder, JoinHandle, sleep};
use std::time::{Duration, Instant};

/// How often it looks.
const LOOK_EVERY: Duration = Duration::from_millis(50);
/// How often the status line is renewed.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// How long closing the files may take before the service manager calls it hung, us: its own time limit for a stop.
const CLOSING_US: u32 = 30_000_000;

/// Starts the thread; it ends with the loop.
pub(super) fn spawn(progress: Arc<Progress>, stop: Stop, run_for: Option<Duration>) -> io::Result<JoinHandle<()>> {
    let supervisor = Supervisor {
        progress,
        stop,
        ends: run_for.map(|time| Instant::now() + time),
        watchdog: watchdog_enabled().map(|period| period / 2),
        fed: Instant::now(),
        seen_ticks: 0,
        told: None,
        ready: false,
    };
    Builder::new().name("supervisor".into()).spawn(|| supervisor.run())
}

struct Supervisor {
    progress: Arc<Progress>,
    stop: Stop,
    ends: Option<Instant>,
    watchdog: Option<Duration>,
    fed: Instant,
    seen_ticks: u64,
    told: Option<Instant>,
    ready: bool,
}

impl Supervisor {
    fn run(mut self) {
        while !self.progress.has_ended() {
            if self.ends.is_some_and(|end| Instant::now() >= end) {
                self.stop.request();
            }
            self.feed_watchdog();
            self.tell_status();
            sleep(LOOK_EVERY);
        }
        // The drives have been stopped; what is left is files, and a slow disk must not pass for a hung loop.
        let patience = self.watchdog.map(|_| NotifyState::WatchdogUsec(CLOSING_US));
        tell(&[&[NotifyState::Stopping][..], patience.as_slice()].concat());
    }

    /// Only a control thread that gets on feeds the watchdog: a loop that hangs is killed, and the drives stop.
    fn feed_watchdog(&mut self) {
        let ticks = self.progress.ticks.load(Ordering::Acquire);
        if ticks == self.seen_ticks {
            return;
        }
        if !self.ready {
            self.ready = true;
            tell(&[NotifyState::Ready]);
        }
        if self.watchdog.is_some_and(|period| self.fed.elapsed() >= period) {
            self.seen_ticks = ticks;
            self.fed = Instant::now();
            tell(&[NotifyState::Watchdog]);
        }
    }

    fn tell_status(&mut self) {
        if self.told.is_none_or(|at| at.elapsed() >= STATUS_EVERY) {
            self.told = Some(Instant::now());
            let ticks = self.progress.ticks.load(Ordering::Acquire);
            tell(&[NotifyState::Status(&format!("{}, {ticks} ticks", self.progress.mode().name()))]);
        }
    }
}

/// Nobody to tell is fine: then it was not started by a service manager.
fn tell(state: &[NotifyState<'_>]) {
    drop(notify(state));
}
