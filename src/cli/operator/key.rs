//! The key that a hand holds: of an input device, or of a terminal. RT: no.

use crate::base::time::Span;
use crate::cli::UsageError;
use crate::config::checked::{Heartbeat, Stick};
use crate::rt::clock;
use crate::sensor::operator::device::{Look, Watch};
use crate::sensor::operator::evdev::InputDevice;
use anyhow::Context;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{disable_raw_mode, enable_raw_mode};
use std::io::{self, IsTerminal};
use std::path::{Path, PathBuf};
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Keys repeat 20 to 30 times a second; a longer gap is a hand that let go.
const LONGEST_GAP: Duration = Duration::from_millis(100);

/// What the person does.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(in crate::cli) enum KeyState {
    /// The switch is held, or not; how far the stick beside it is pushed, if there is one, 0 to 1.
    Switch { held: bool, stick: Option<f64> },
    /// Confirms the hip's zero.
    Zero,
    /// Wants to end.
    Quit,
}

/// Which key is held.
#[derive(clap::Args)]
pub(in crate::cli) struct KeyArgs {
    /// Input device with the key (evdev) instead of the terminal
    #[arg(long, value_name = "PATH")]
    device: Option<PathBuf>,
    /// Number of its key, as linux/input-event-codes.h counts (57 is the space bar, 304 the first button of a pad)
    #[arg(long, value_name = "N", default_value_t = 57, requires = "device")]
    key: u16,
    /// A wireless device: number of an analogue axis that is never quite still (0 is ABS_X). Its receiver may repeat the last
    /// state when the radio is gone
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..0x40),
        requires = "device", requires = "heartbeat_ms")]
    heartbeat_axis: Option<u16>,
    /// The axis moves at least once in this time, or the key counts as let go
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u16).range(20..=1000), requires = "heartbeat_axis")]
    heartbeat_ms: Option<u16>,
    /// Number of the axis by which the person asks for the walking speed (1 is ABS_Y); the robot must want it:
    /// robot.operator.speed
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(0..0x40),
        requires = "device", requires = "speed_rest", requires = "speed_full")]
    speed_axis: Option<u16>,
    /// Where it stands when nobody touches it, counts of the device (`evtest` shows them)
    #[arg(long, value_name = "COUNTS", allow_negative_numbers = true, requires = "speed_axis")]
    speed_rest: Option<i32>,
    /// Where it stands when it is pushed all the way, which asks for robot.operator.speed.highest_m_s
    #[arg(long, value_name = "COUNTS", allow_negative_numbers = true, requires = "speed_axis")]
    speed_full: Option<i32>,
    /// Share of its way that still counts as rest, 0 to 0.9
    #[arg(long, value_name = "SHARE", default_value_t = 0.1, requires = "speed_axis")]
    speed_dead_zone: f64,
}

impl KeyArgs {
    /// The stick, if there is one.
    fn stick(&self) -> Result<Option<Stick>, UsageError> {
        let (Some(axis), Some(rest), Some(full)) = (self.speed_axis, self.speed_rest, self.speed_full) else {
            return Ok(None);
        };
        if rest == full {
            return Err(UsageError(format!("--speed-full {full}: must be another place than --speed-rest")));
        }
        let dead_zone = self.speed_dead_zone;
        if !(0.0..=0.9).contains(&dead_zone) {
            return Err(UsageError(format!("--speed-dead-zone {dead_zone}: must be 0 to 0.9")));
        }
        Ok(Some(Stick { axis, rest, full, dead_zone }))
    }
}

/// A key.
pub(in crate::cli) enum Key {
    Device(DeviceKey),
    Terminal(Repeats),
}

/// A key of an input device.
pub(in crate::cli) struct DeviceKey {
    device: InputDevice,
    number: u16,
    heartbeat: Option<Heartbeat>,
    stick: Option<Stick>,
    watch: Watch,
}

impl DeviceKey {
    fn open(path: &Path, args: &KeyArgs, stick: Option<Stick>) -> io::Result<Self> {
        let device = InputDevice::with_key(path, args.key)?;
        let within = |ms: u16| Span::from_ms(i64::from(ms));
        let heartbeat = args.heartbeat_axis.zip(args.heartbeat_ms);
        let heartbeat = heartbeat.map(|(axis, ms)| Heartbeat { axis, within: within(ms) });
        if let Some(heartbeat) = heartbeat {
            device.require_axis(heartbeat.axis)?;
        }
        if let Some(stick) = &stick {
            device.require_stick(stick)?;
        }
        Ok(Self { device, number: args.key, heartbeat, stick, watch: Watch::new(heartbeat) })
    }

    /// Held, by the same rules as a device of the robot itself: seen released first, and alive. A stick counts while it is.
    fn state(&mut self) -> io::Result<KeyState> {
        let [held] = self.device.down([self.number])?;
        let axis = self.heartbeat.map(|heartbeat| self.device.axis(heartbeat.axis)).transpose()?;
        let held = self.watch.take(clock::now(), Some(Look { held, axis, ..Look::default() })).dead_man;
        let pushed = |stick: Stick| -> io::Result<f64> {
            Ok(if held { stick.share(self.device.axis(stick.axis)?) } else { 0.0 })
        };
        Ok(KeyState::Switch { held, stick: self.stick.map(pushed).transpose()? })
    }
}

impl Key {
    /// The space bar of the terminal, which is put into raw mode.
    fn terminal() -> io::Result<Self> {
        enable_raw_mode()?;
        Ok(Self::Terminal(Repeats::default()))
    }

    /// The key that these arguments name: of a device, or of this terminal.
    pub(in crate::cli) fn open(args: &KeyArgs) -> anyhow::Result<Self> {
        match &args.device {
            Some(path) => {
                let key = DeviceKey::open(path, args, args.stick()?);
                key.map(Self::Device).with_context(|| format!("--device {}", path.display()))
            }
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
            Self::Device(key) => {
                sleep(pause);
                key.state()
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
    Ok(KeyState::Switch { held: repeats.is_held(Instant::now()), stick: None })
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
