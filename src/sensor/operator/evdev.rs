//! An input device of Linux: which keys are down now, as the kernel knows it. RT: no, in ordinary threads.
//!
//! Events are not read. They are silent while nothing changes, and some are lost when nobody reads in time; the state that
//! the kernel keeps is always whole, and asking for it fails when the device is unplugged.
#![expect(unsafe_code, reason = "the state of keys and axes has no safe wrapper in our dependencies")]

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
        let [a, b, c, d, ..]: [u8; 24] = self.ask(STATE_OF_AXIS + libc::c_ulong::from(axis & MOST_AXES))?;
        Ok(i32::from_ne_bytes([a, b, c, d]))
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
    fn bits_are_counted_from_the_lowest_of_the_first_byte() {
        let set: Vec<u16> = (0..30).filter(|n| is_set(&[0x01, 0x82], *n)).collect();
        assert_eq!(set, [0, 9, 15]);
    }
}
