//! The key that a hand holds: of an input device, or of a terminal. RT: no.
#![expect(unsafe_code, reason = "the state of a key has no safe wrapper in our dependencies")]

use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Between two heartbeats: five fit into the 100 ms after which silence is a fault.
const HEARTBEAT: Duration = Duration::from_millis(20);
/// Keys repeat 20 to 30 times a second; a longer gap is a hand that let go.
const LONGEST_GAP: Duration = Duration::from_millis(100);
/// Bytes of the kernel's bit field of keys: KEY_MAX is 0x2FF.
const KEY_BYTES: usize = 96;

/// What the person does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum KeyState {
    /// The switch is held, or not.
    Switch(bool),
    /// Confirms the hip's zero.
    Zero,
    /// Wants to end.
    Quit,
}

/// A key.
pub(super) enum Key {
    Device(File, u16),
    Terminal(Repeats),
}

impl Key {
    /// The key with this number of an input device.
    pub(super) fn device(path: &Path, number: u16) -> anyhow::Result<Self> {
        let device = File::open(path)?;
        anyhow::ensure!(usize::from(number) < 8 * KEY_BYTES, "there is no key {number}");
        is_down(&device, number)?;
        Ok(Self::Device(device, number))
    }

    /// The space bar of the terminal, which is put into raw mode.
    pub(super) fn terminal() -> io::Result<Self> {
        enable_raw_mode()?;
        Ok(Self::Terminal(Repeats::default()))
    }

    /// Waits for one heartbeat, then says what the person does.
    pub(super) fn wait(&mut self) -> io::Result<KeyState> {
        match self {
            Self::Device(device, number) => {
                sleep(HEARTBEAT);
                is_down(device, *number).map(KeyState::Switch)
            }
            Self::Terminal(repeats) => wait_in_terminal(repeats),
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

fn wait_in_terminal(repeats: &mut Repeats) -> io::Result<KeyState> {
    let end = Instant::now() + HEARTBEAT;
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
pub(super) struct Repeats {
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

/// Asks the kernel whether the key is down now (EVIOCGKEY); an error when the device is gone or is none.
fn is_down(device: &File, number: u16) -> io::Result<bool> {
    let mut keys = [0_u8; KEY_BYTES];
    // _IOC(_IOC_READ, 'E', 0x18, KEY_BYTES)
    let request = 2 << 30 | (KEY_BYTES as libc::c_ulong) << 16 | 0x45 << 8 | 0x18;
    // SAFETY: the call fills at most the bytes whose number is in the request.
    if unsafe { libc::ioctl(device.as_raw_fd(), request, keys.as_mut_ptr()) } < 0 {
        return Err(io::Error::last_os_error());
    }
    Ok(keys.get(usize::from(number / 8)).is_some_and(|byte| byte & (1 << (number % 8)) != 0))
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

    #[test]
    fn what_is_no_input_device_is_refused() {
        assert!(Key::device(Path::new("/dev/null"), 57).is_err());
        assert!(Key::device(Path::new("/nowhere"), 57).is_err());
    }
}
