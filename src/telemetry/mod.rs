//! L4: what a person sees while the robot runs. Reads ticks from a [`Feed`], never touches the loop.
//!
//! On a terminal: a full screen ([`screen`]) with a stick figure ([`figure`]), torque, buses, drives, latencies,
//! recording and faults. Elsewhere: one line a second ([`plain`]). Both show the same [`state`]. RT: no.

mod figure;
mod footing;
mod plain;
mod screen;
mod state;
mod terminal;

use crate::config::checked::Config;
use crate::msg::{RecorderStatus, TickRecord};
use state::State;
use std::io::{self, IsTerminal, Write};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Where ticks come from: a channel of the running loop, a simulation, a recording.
pub trait Feed {
    /// Hands over the ticks that came since the last call, in order, without waiting. False when no more will come.
    fn poll(&mut self, each: &mut dyn FnMut(&TickRecord)) -> bool;

    /// What does not travel with the ticks. Asked for at each redraw.
    fn side(&mut self) -> Side {
        Side::default()
    }

    /// What the key `q` does, as it stands on the screen.
    fn quit_means(&self) -> &'static str {
        "q: quit"
    }
}

/// What does not travel with the ticks.
#[derive(Clone, Debug, Default)]
pub struct Side {
    /// How the recording is.
    pub recorder: RecorderStatus,
    /// One line per thread.
    pub threads: Vec<ThreadLine>,
    /// News for a person; each once.
    pub notices: Vec<String>,
}

/// How a thread is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ThreadLine {
    /// Its name.
    pub name: String,
    /// Such as `FIFO 80 core 1`.
    pub detail: String,
    /// False if a person should look.
    pub good: bool,
}

/// Redraws per second: smooth for the eye, 3 % of a core.
const REDRAWS_HZ: u32 = 20;

/// Shows the feed until it ends, `stop` is set, or the person presses `q` (which sets `stop`).
///
/// # Errors
/// When the terminal or stdout cannot be written.
pub fn run(config: &Config, feed: &mut dyn Feed, stop: &AtomicBool) -> io::Result<()> {
    let mut state = State::new(config)?;
    state.quit_means = feed.quit_means();
    if io::stdout().is_terminal() && io::stdin().is_terminal() {
        let mut screen = terminal::Screen::open()?;
        while follow(&mut state, feed, Duration::ZERO) && !stop.load(Ordering::Relaxed) {
            screen.draw(&state)?;
            if terminal::quit_pressed(Duration::from_secs(1) / REDRAWS_HZ)? {
                stop.store(true, Ordering::Relaxed);
            }
        }
        Ok(())
    } else {
        lines(&mut state, feed, stop, &mut io::stdout().lock())
    }
}

/// One line a second of tick time, however fast the feed runs.
fn lines(state: &mut State, feed: &mut dyn Feed, stop: &AtomicBool, out: &mut impl Write) -> io::Result<()> {
    let mut told = Instant::now();
    while follow(state, feed, Duration::from_millis(20)) && !stop.load(Ordering::Relaxed) {
        for notice in state.take_news() {
            writeln!(out, "{notice}")?;
        }
        if told.elapsed() >= Duration::from_secs(1) {
            told += Duration::from_secs(1);
            writeln!(out, "{}", plain::line(state))?;
            out.flush()?;
        }
    }
    state.take_news().iter().try_for_each(|notice| writeln!(out, "{notice}"))?;
    writeln!(out, "{}", plain::line(state))
}

/// Takes what came; then sleeps. False at the end of the feed.
fn follow(state: &mut State, feed: &mut dyn Feed, pause: Duration) -> bool {
    let more = feed.poll(&mut |tick| state.take(tick));
    state.take_side(feed.side());
    if more && !pause.is_zero() {
        std::thread::sleep(pause);
    }
    more
}
