//! Progress on stderr of anything longer than a second; silent when stderr is not a terminal. RT: no.

use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::time::Duration;

/// A bar over a known number of steps.
#[must_use]
pub fn bar(steps: u64, what: &'static str) -> ProgressBar {
    // indicatif hides itself when stderr is no terminal; ten redraws a second are enough for a person.
    let bar = ProgressBar::with_draw_target(Some(steps), ProgressDrawTarget::stderr_with_hz(10));
    if let Ok(style) = ProgressStyle::with_template("{msg} {wide_bar} {percent:>3} % {eta:>4}") {
        bar.set_style(style);
    }
    bar.with_message(what)
}

/// A spinner for work of unknown length.
#[must_use]
pub fn spinner(what: &'static str) -> ProgressBar {
    let spinner = ProgressBar::new_spinner().with_message(what);
    spinner.enable_steady_tick(Duration::from_millis(100));
    spinner
}
