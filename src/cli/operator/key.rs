//! The key that a hand holds: of an input device, or of a terminal. RT: no.

use crate::cli::UsageError;
use crate::sensor::operator::evdev::InputDevice;
use anyhow::Context;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::io::{self, IsTerminal};
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Keys repeat 20 to 30 times a second; a longer gap is a hand that let go.
const LONGEST_GAP: Duration = Duration::from_millis(100);

/// What the person does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::cli) enum KeyState {
    /// The switch is held, or not.
    Switch(bool),
    /// Confirms the hip's zero.
    Zero,
    /// Wants to end.
    Quit,
}

/// A key.
pub(in crate::cli) enum Key {
    Device(InputDevice, u16),
    Terminal(Repeats),
}

impl Key {
    /// The key with this number of an input device.
    pub(in crate::cli) fn device(path: &Path, number: u16) -> io::Result<Self> {
        let device = InputDevice::with_key(path, number)?;
        Ok(Self::Device(device, number))
    }

    /// The space bar of the terminal, which is put into raw mode.
    fn terminal() -> io::Result<Self> {
        enable_raw_mode()?;
        Ok(Self::Terminal(Repeats::default()))
    }

    /// The key that these arguments name: of a device, or of this terminal.
    pub(in crate::cli) fn open(device: Option<&Path>, number: u16) -> anyhow::Result<Self> {
        match device {
            Some(path) => Self::device(path, number).with_context(|| format!("--device {}", path.display())),
            None if io::stdin().is_terminal() => Ok(Self::terminal()?),
            None => {
                let what = "a dead-man switch wants a hand: stdin is no terminal. Run it in one, or name a --device";
                Err(UsageError(what.into()).into())
            }
        }
    }

    /// Waits so long, then says what the person does.
    pub(in crate::cli) fn wait(&mut self, pause: Duration) -> io::Result<KeyState> {
        match self {
            Self::Device(device, number) => {
                sleep(pause);
                device.down([*number]).map(|[held]| KeyState::Switch(held))
            }
            Self::Terminal(repeats) => wait_in_terminal(repeats, pause),
        }
    }
}

impl Drop for Key {
    fn drop(&mut self) {
        if matches!(self, Self::Terminal(_)) {
            // Nothing more can be done if the terminal is gone.
            drop(disable_raw_mode());
        }
    }
}

fn wait_in_terminal(repeats: &mut Repeats, pause: Duration) -> io::Result<KeyState> {
    let end = Instant::now() + pause;
    while event::poll(end.saturating_duration_since(Instant::now()))? {
        let Event::Key(key) = event::read()? else { continue };
        if key.kind == KeyEventKind::Release {
            continue;
        }
        match key.code {
            KeyCode::Char(' ') => repeats.hear(Instant::now()),
            KeyCode::Char('z') => return Ok(KeyState::Zero),
            KeyCode::Char('q') | KeyCode::Esc => return Ok(KeyState::Quit),
            KeyCode::Char('c') if key.modifiers.contains(KeyModifiers::CONTROL) => return Ok(KeyState::Quit),
            // Any other key is no hand on the switch.
            _ => *repeats = Repeats::default(),
        }
    }
    Ok(KeyState::Switch(repeats.is_held(Instant::now())))
}

/// A key of a terminal: it is held while it repeats without a gap. The first stroke alone is no holding.
#[derive(Clone, Copy, Debug, Default)]
pub(in crate::cli) struct Repeats {
    last: Option<Instant>,
    repeats: bool,
}

impl Repeats {
    fn hear(&mut self, now: Instant) {
        self.repeats = self.last.is_some_and(|last| now.duration_since(last) <= LONGEST_GAP);
        self.last = Some(now);
    }

    fn is_held(&self, now: Instant) -> bool {
        self.repeats && self.last.is_some_and(|last| now.duration_since(last) <= LONGEST_GAP)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_key_of_a_terminal_is_held_while_it_repeats_without_a_gap() {
        let start = Instant::now();
        let at = |ms| start + Duration::from_millis(ms);
        let mut key = Repeats::default();
        assert!(!key.is_held(at(0)));
        key.hear(at(0));
        assert!(!key.is_held(at(1)), "one stroke is no holding");
        key.hear(at(500));
        assert!(!key.is_held(at(501)), "the keyboard's first delay");
        for ms in (533..1_500).step_by(33) {
            key.hear(at(ms));
            assert!(key.is_held(at(ms + 32)), "{ms}");
        }
        assert!(key.is_held(at(1_580)) && !key.is_held(at(1_600)), "let go: a gap of 100 ms");
        key.hear(at(1_700));
        assert!(!key.is_held(at(1_701)), "and a new stroke begins anew");
    }
}
