//! A key of an input device as the dead-man switch: pedal, pad, joystick. RT: no; see [`super::aside`].
//!
//! The key is asked for 100 times a second, because the device is silent while nothing changes. Any doubt (start, device
//! gone, a radio that is not heard) ends only with two steps: the key seen released, then pressed. A wireless receiver may
//! hold the last state when its radio is gone, so such a device must show life: an axis that is never quite still.

use super::aside::{AsideHand, Desk, now, sleep_until};
use super::evdev::InputDevice;
use crate::base::time::{Span, Stamp};
use crate::config::checked::{Heartbeat, OperatorDevice, OperatorSpeed};
use crate::msg::OperatorSample;
use std::io;
use std::path::Path;

/// Between two looks at the key.
const LOOK_EVERY: Span = Span::from_ms(10);
/// Between two attempts to open a device that is gone.
const OPEN_EVERY: Span = Span::from_ms(200);

/// Opens the device and starts its thread.
///
/// # Errors
/// When the device is not there or lacks a key or an axis.
pub(super) fn open(config: &OperatorDevice, speed: Option<OperatorSpeed>) -> io::Result<AsideHand> {
    let device = open_device(config, speed)?;
    let config = config.clone();
    AsideHand::start(move |desk| look_after(desk, &config, speed, device))
}

fn open_device(config: &OperatorDevice, speed: Option<OperatorSpeed>) -> io::Result<InputDevice> {
    let device = InputDevice::with_key(Path::new(&config.path), config.key)?;
    if let Some(heartbeat) = config.heartbeat {
        device.require_axis(heartbeat.axis)?;
    }
    if let Some(stick) = speed.and_then(|speed| speed.stick) {
        device.require_stick(&stick)?;
    }
    Ok(device)
}

/// Looks at the key until nobody needs it.
fn look_after(desk: &Desk, config: &OperatorDevice, speed: Option<OperatorSpeed>, device: InputDevice) {
    let mut device = Some(device);
    let mut watch = Watch::new(config.heartbeat);
    let (mut next, mut next_opening) = (now(), now());
    while !desk.is_over() {
        if device.is_none() && next >= next_opening {
            device = open_device(config, speed).ok();
            next_opening = next + OPEN_EVERY;
        }
        let look = device.as_ref().and_then(|device| look_at(device, config, speed).ok());
        if look.is_none() {
            device = None;
        }
        desk.put(&watch.take(now(), look));
        next = (next + LOOK_EVERY).max(now());
        sleep_until(next);
    }
}

fn look_at(device: &InputDevice, config: &OperatorDevice, speed: Option<OperatorSpeed>) -> io::Result<Look> {
    let [held, zero] = device.down([config.key, config.zero_key])?;
    let axis = config.heartbeat.map(|heartbeat| device.axis(heartbeat.axis)).transpose()?;
    let mut speed_m_s = 0.0;
    if let Some((speed, stick)) = speed.and_then(|speed| Some((speed, speed.stick?))) {
        speed_m_s = speed.highest_m_s * stick.share(device.axis(stick.axis)?);
    }
    Ok(Look { held, zero, axis, speed_m_s })
}

/// What the device shows in one look.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Look {
    /// The dead-man key is down.
    pub held: bool,
    /// The key that confirms the hip's zero is down.
    pub zero: bool,
    /// Where the axis of the heartbeat stands.
    pub axis: Option<i32>,
    /// What the stick asks for, m/s.
    pub speed_m_s: f64,
}

/// Judges what the looks mean.
#[derive(Clone, Copy, Debug)]
pub struct Watch {
    heartbeat: Option<Heartbeat>,
    sample: OperatorSample,
    /// The key was not seen released since the last doubt.
    doubt: bool,
    /// Where the axis stood, and when it moved last.
    moved: Option<(i32, Stamp)>,
    zero_was_down: bool,
}

impl Watch {
    /// Nothing was seen yet: in doubt.
    #[must_use]
    pub fn new(heartbeat: Option<Heartbeat>) -> Self {
        let sample = OperatorSample { stamp: Stamp::NEVER, ..OperatorSample::default() };
        Self { heartbeat, sample, doubt: true, moved: None, zero_was_down: true }
    }

    /// The hand after this look; `None`: the device is gone. A hand that does not live grows old.
    pub fn take(&mut self, now: Stamp, look: Option<Look>) -> OperatorSample {
        let Some(look) = look.filter(|look| self.lives(now, look)) else {
            (self.doubt, self.zero_was_down, self.sample.dead_man) = (true, true, false);
            self.sample.speed_m_s = 0.0;
            return self.sample;
        };
        self.doubt &= look.held;
        let confirms = look.zero && !self.zero_was_down && !look.held;
        self.zero_was_down = look.zero;
        self.sample = OperatorSample {
            stamp: now,
            dead_man: look.held && !self.doubt,
            sequence: self.sample.sequence.wrapping_add(1),
            zeroings: self.sample.zeroings.wrapping_add(u32::from(confirms)),
            // The key means aligned legs.
            zero_angle_rad: 0.0,
            speed_m_s: if look.held && !self.doubt { look.speed_m_s } else { 0.0 },
        };
        self.sample
    }

    /// True if there is no radio that could have died, or its axis has moved lately.
    fn lives(&mut self, now: Stamp, look: &Look) -> bool {
        let (Some(heartbeat), Some(axis)) = (self.heartbeat, look.axis) else { return self.heartbeat.is_none() };
        match &mut self.moved {
            Some((was, _)) if *was == axis => {}
            // Where it stands at first is no movement: a dead radio has a last state too.
            None => self.moved = Some((axis, Stamp::NEVER)),
            Some(moved) => *moved = (axis, now),
        }
        self.moved.is_some_and(|(_, at)| at != Stamp::NEVER && now.since(at) <= heartbeat.within)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(ms: i64) -> Stamp {
        Stamp(5_000_000_000) + Span::from_ms(ms)
    }

    const HELD: Look = Look { held: true, zero: false, axis: None, speed_m_s: 0.0 };
    const OPEN: Look = Look { held: false, ..HELD };

    /// Looks every 10 ms; what the hand says after each: held, and whether it lives.
    fn say(watch: &mut Watch, from_ms: i64, looks: &[Option<Look>]) -> Vec<(bool, bool)> {
        let one = |(i, look): (usize, &Option<Look>)| {
            let now = at(from_ms + 10 * i as i64);
            let sample = watch.take(now, *look);
            (sample.dead_man, sample.stamp == now)
        };
        looks.iter().enumerate().map(one).collect()
    }

    #[test]
    fn a_key_held_at_the_start_is_not_held_until_it_was_released() {
        let mut watch = Watch::new(None);
        let said = say(&mut watch, 0, &[Some(HELD), Some(HELD), Some(OPEN), Some(HELD)]);
        assert_eq!(said, [(false, true), (false, true), (false, true), (true, true)]);
    }

    #[test]
    fn a_device_that_is_unplugged_grows_old_and_asks_for_release_and_press_when_it_is_back() {
        let mut watch = Watch::new(None);
        say(&mut watch, 0, &[Some(OPEN), Some(HELD)]);
        let said = say(&mut watch, 20, &[None, None, Some(HELD), Some(HELD), Some(OPEN), Some(HELD)]);
        let old = (false, false);
        assert_eq!(said, [old, old, (false, true), (false, true), (false, true), (true, true)]);
    }

    #[test]
    fn a_wireless_pad_whose_axis_stands_still_is_a_dead_radio() {
        let mut watch = Watch::new(Some(Heartbeat { axis: 1, within: Span::from_ms(50) }));
        let look = |held, axis| Some(Look { held, axis: Some(axis), ..OPEN });
        // The receiver repeats its last state: that is no life, from the start on.
        assert!(say(&mut watch, 0, &[look(false, 7); 20]).iter().all(|said| !said.1));
        // The axis trembles: alive. Release seen, pressed: held.
        let alive: Vec<_> = (0..20).map(|i| look(i >= 10, 7 + i % 2)).collect();
        let said = say(&mut watch, 200, &alive);
        assert_eq!(said[19], (true, true));
        // The radio dies with the key down: after 50 ms the hand is let go and grows old.
        let said = say(&mut watch, 400, &[look(true, 8); 20]);
        assert_eq!(said.iter().filter(|said| said.0).count(), 5, "{said:?}");
        assert!(said[6..].iter().all(|said| *said == (false, false)));
        // It is back with the key still down: two steps.
        let back: Vec<_> = (0..10).map(|i| look(i != 5, i)).collect();
        let said = say(&mut watch, 600, &back);
        assert!(said[..6].iter().all(|said| !said.0) && said[6..].iter().all(|said| said.0), "{said:?}");
    }

    #[test]
    fn the_zero_is_confirmed_by_an_edge_of_its_key_with_the_switch_open() {
        let mut watch = Watch::new(None);
        let both = Look { zero: true, ..HELD };
        let zero = Look { zero: true, ..OPEN };
        let looks = [zero, zero, OPEN, zero, zero, OPEN, HELD, both, HELD];
        say(&mut watch, 0, &looks.map(Some));
        assert_eq!(watch.sample.zeroings, 1, "not at the start, not while the switch is held");
    }

    #[test]
    fn the_stick_counts_only_while_a_living_hand_holds_the_switch() {
        let mut watch = Watch::new(None);
        let pushed = |look: Look| Some(Look { speed_m_s: 0.3, ..look });
        let speeds = |watch: &mut Watch, looks: &[Option<Look>]| {
            looks.iter().enumerate().map(|(i, look)| watch.take(at(10 * i as i64), *look).speed_m_s).collect::<Vec<_>>()
        };
        let looks =
            [pushed(HELD), pushed(OPEN), pushed(HELD), None, pushed(HELD), pushed(OPEN), pushed(HELD), Some(HELD)];
        assert_eq!(speeds(&mut watch, &looks), [0.0, 0.0, 0.3, 0.0, 0.0, 0.0, 0.3, 0.0]);
    }

    /// Reading a real device: `COMPASS_TEST_INPUT=/dev/input/eventN:KEY` names it. Needs a key that nobody holds.
    #[test]
    fn a_real_device_lives_and_nobody_holds_it() {
        let Ok(name) = std::env::var("COMPASS_TEST_INPUT") else { return };
        let (path, key) = name.rsplit_once(':').unwrap();
        let key = key.parse().unwrap();
        let config = OperatorDevice { path: path.into(), key, zero_key: key, heartbeat: None };
        let mut hand = open(&config, None).unwrap();
        sleep_until(now() + Span::from_ms(100));
        let sample = hand.poll(now(), &crate::msg::Status::default());
        assert!(!sample.dead_man && now().since(sample.stamp) < Span::from_ms(100), "{sample:?}");
    }
}
