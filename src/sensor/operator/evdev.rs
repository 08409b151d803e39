//! An input device of Linux: which keys are down now, as the kernel knows it. RT: no, in ordinary threads.
//!
//! Events are not read. They are silent while nothing changes, and some are lost when nobody reads in time; the state that
//! the kernel keeps is always whole, and asking for it fails when the device is unplugged.
#![expect(unsafe_code, reason = "the state of keys and axes has no safe wrapper in our dependencies")]

use crate::config::checked::Stick;
use std::fs::File;
use std::io;
use std::os::fd::AsRawFd;
use std::path::Path;

/// Highest number of a key (KEY_MAX).
pub const MOST_KEYS: u16 = 0x2FF;
/// Highest number of an axis (ABS_MAX).
pub const MOST_AXES: u16 = 0x3F;
/// Bytes of the bit field of keys.
const KEY_BYTES: usize = 96;
/// Bytes of the bit field of axes.
const AXIS_BYTES: usize = 8;

/// Requests of the input layer, by number (linux/input.h).
const STATE_OF_KEYS: libc::c_ulong = 0x18;
const BITS_OF_KEYS: libc::c_ulong = 0x20 + 0x01;
const BITS_OF_AXES: libc::c_ulong = 0x20 + 0x03;
const STATE_OF_AXIS: libc::c_ulong = 0x40;

/// An open device.
#[derive(Debug)]
pub struct InputDevice(File);

impl InputDevice {
    /// Opens it and looks whether it has this key.
    ///
    /// # Errors
    /// When it cannot be opened, is no input device, or lacks the key.
    pub fn with_key(path: &Path, key: u16) -> io::Result<Self> {
        let device = Self(File::open(path)?);
        let keys: [u8; KEY_BYTES] = device.ask(BITS_OF_KEYS)?;
        if is_set(&keys, key) { Ok(device) } else { Err(missing("it has no such key")) }
    }

    /// Looks whether it has this axis.
    ///
    /// # Errors
    /// When it lacks the axis or is gone.
    pub fn require_axis(&self, axis: u16) -> io::Result<()> {
        let axes: [u8; AXIS_BYTES] = self.ask(BITS_OF_AXES)?;
        if is_set(&axes, axis) { Ok(()) } else { Err(missing("it has no such axis")) }
    }

    /// Which of these keys are down now.
    ///
    /// # Errors
    /// When the device is gone.
    pub fn down<const N: usize>(&self, keys: [u16; N]) -> io::Result<[bool; N]> {
        let state: [u8; KEY_BYTES] = self.ask(STATE_OF_KEYS)?;
        Ok(keys.map(|key| is_set(&state, key)))
    }

    /// Where an axis stands now, counts of the device.
    ///
    /// # Errors
    /// When the device is gone.
    pub fn axis(&self, axis: u16) -> io::Result<i32> {
        let [value, ..] = self.state_of_axis(axis)?;
        Ok(value)
    }

    /// Looks whether it has the axis of a stick, and whether that goes where the stick is said to go.
    ///
    /// # Errors
    /// When it lacks the axis, has another range, or is gone.
    pub fn require_stick(&self, stick: &Stick) -> io::Result<()> {
        self.require_axis(stick.axis)?;
        let [_, least, most, ..] = self.state_of_axis(stick.axis)?;
        stays_within(stick, least, most)
    }

    /// Value, least and greatest value, and what does not matter here (`input_absinfo`).
    fn state_of_axis(&self, axis: u16) -> io::Result<[i32; 6]> {
        let bytes: [u8; 24] = self.ask(STATE_OF_AXIS + libc::c_ulong::from(axis & MOST_AXES))?;
        let mut words = [0; 6];
        for (word, bytes) in words.iter_mut().zip(bytes.as_chunks::<4>().0) {
            *word = i32::from_ne_bytes(*bytes);
        }
        Ok(words)
    }

    /// The answer to a request for so many bytes.
    fn ask<const N: usize>(&self, request: libc::c_ulong) -> io::Result<[u8; N]> {
        let mut answer = [0_u8; N];
        // _IOC(_IOC_READ, 'E', request, N)
        let code = 2 << 30 | (N as libc::c_ulong) << 16 | 0x45 << 8 | request;
        // SAFETY: the call fills at most the bytes whose number is in the request.
        if unsafe { libc::ioctl(self.0.as_raw_fd(), code, answer.as_mut_ptr()) } < 0 {
            return Err(io::Error::last_os_error());
        }
        Ok(answer)
    }
}

fn is_set(bits: &[u8], number: u16) -> bool {
    bits.get(usize::from(number / 8)).is_some_and(|byte| byte & (1 << (number % 8)) != 0)
}

/// A stick that goes beyond its axis would be one of another device.
#[expect(clippy::disallowed_macros, reason = "not real-time")]
fn stays_within(stick: &Stick, least: i32, most: i32) -> io::Result<()> {
    let outside = [("rest_counts", stick.rest), ("full_counts", stick.full)];
    match outside.into_iter().find(|(_, place)| !(least..=most).contains(place)) {
        None => Ok(()),
        Some((key, place)) => {
            let what =
                format!("its axis {} goes from {least} to {most} counts: {key} = {place} is outside", stick.axis);
            Err(io::Error::new(io::ErrorKind::InvalidInput, what))
        }
    }
}

fn missing(what: &'static str) -> io::Error {
    io::Error::new(io::ErrorKind::InvalidInput, what)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_no_input_device_is_refused() {
        assert!(InputDevice::with_key(Path::new("/dev/null"), 57).is_err());
        assert!(InputDevice::with_key(Path::new("/nowhere"), 57).is_err());
    }

    #[test]
    fn a_stick_must_stay_within_its_axis_and_is_pushed_from_its_rest_on() {
        let stick = Stick { axis: 1, rest: 128, full: 0, dead_zone: 0.25 };
        assert!(stays_within(&stick, 0, 255).is_ok());
        let told = stays_within(&Stick { full: -32_768, ..stick }, 0, 255).unwrap_err().to_string();
        assert_eq!(told, "its axis 1 goes from 0 to 255 counts: full_counts = -32768 is outside");
        let shares = [255, 128, 96, 72, 48, 0, -500].map(|counts| stick.share(counts));
        let expected = [0.0, 0.0, 0.0, 0.25, 0.5, 1.0, 1.0];
        assert!(shares.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12), "{shares:?}");
        assert!((Stick { full: 256, ..stick }.share(256) - 1.0).abs() < 1e-12 && stick.share(i32::MAX) <= 0.0);
    }

    #[test]
    fn bits_are_counted_from_the_lowest_of_the_first_byte() {
        let set: Vec<u16> = (0..30).filter(|n| is_set(&[0x01, 0x82], *n)).collect();
        assert_eq!(set, [0, 9, 15]);
    }
}
