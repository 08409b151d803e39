//! The serial line of a sensor, which never waits. RT: reading and writing yes; opening before arming only.

#![expect(unsafe_code, reason = "the low-latency flag has no safe wrapper in our dependencies")]

pub mod replug;

use serialport::{SerialPort, TTYPort};
use std::fs::File;
use std::io::{ErrorKind, Read, Write};
use std::os::fd::{AsRawFd, FromRawFd, IntoRawFd, RawFd};
use std::time::Duration;

/// An open line, 8 data bits, no parity, 1 stop bit.
#[derive(Debug)]
pub struct SerialLine {
    /// Not the port itself: its `read` allocates an error's text whenever nothing is there.
    port: File,
    /// The driver was told to deliver at once. False on a pseudo-terminal, and on adapters that cannot.
    pub low_latency: bool,
}

impl SerialLine {
    /// Opens a device, or the pseudo-terminal of a simulated one.
    ///
    /// # Errors
    /// No such device, no permission, or a rate that it cannot do.
    pub fn open(path: &str, baud: u32) -> Result<Self, serialport::Error> {
        // Not exclusive: that would outlive a killed process on a pseudo-terminal, and its successor could not open it.
        let port = serialport::new(path, baud).timeout(Duration::ZERO).exclusive(false).open_native()?;
        port.clear(serialport::ClearBuffer::All)?;
        let low_latency = set_low_latency(port.as_raw_fd());
        Ok(Self::new(port, low_latency))
    }

    fn new(port: TTYPort, low_latency: bool) -> Self {
        // SAFETY: an open descriptor, which the port gives away; flags without pointers.
        let port = unsafe {
            libc::fcntl(port.as_raw_fd(), libc::F_SETFL, libc::O_NONBLOCK);
            File::from_raw_fd(port.into_raw_fd())
        };
        Self { port, low_latency }
    }

    /// Bytes that are there, at most a buffer full; 0 if none. `None` when the device is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        match self.port.read(buffer) {
            // A line that is open but for nothing to read says so by an error: this is the end.
            Ok(0) => None,
            Ok(count) => Some(count),
            Err(e) if matches!(e.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) => Some(0),
            Err(_) => None,
        }
    }

    /// Hands over bytes (a request has at most 20, a driver's buffer 4096). False when the device is gone or full.
    pub fn write(&mut self, bytes: &[u8]) -> bool {
        self.port.write(bytes).is_ok_and(|count| count == bytes.len())
    }

    /// A descriptor that polls readable when bytes are there.
    #[must_use]
    pub fn readable_fd(&self) -> RawFd {
        self.port.as_raw_fd()
    }
}

/// A pseudo-terminal: the far end of a simulated device, and the path under which others open the near end.
#[derive(Debug)]
pub struct PseudoTerminal {
    /// The far end.
    pub far: SerialLine,
    /// Kept open, so that the far end does not see a hang-up while nobody has the near end open.
    near: TTYPort,
}

impl PseudoTerminal {
    /// A new one, raw.
    ///
    /// # Errors
    /// None left, or no permission.
    pub fn new() -> Result<Self, serialport::Error> {
        let (far, near) = TTYPort::pair()?;
        // It does not wait: with nobody reading, bytes are thrown away.
        Ok(Self { far: SerialLine::new(far, false), near })
    }

    /// Path of the near end.
    #[must_use]
    #[expect(clippy::disallowed_types, reason = "before arming")]
    pub fn path(&self) -> Option<String> {
        self.near.name()
    }
}

/// FTDI adapters deliver every 16 ms unless told otherwise (flag ASYNC_LOW_LATENCY of TIOCSSERIAL).
fn set_low_latency(fd: RawFd) -> bool {
    const ASYNC_LOW_LATENCY: libc::c_int = 0x2000;
    let mut serial = SerialStruct::default();
    // SAFETY: the structure has the kernel's layout and size; the calls only fill or read it.
    unsafe {
        if libc::ioctl(fd, TIOCGSERIAL, &raw mut serial) != 0 {
            return false;
        }
        serial.flags |= ASYNC_LOW_LATENCY;
        libc::ioctl(fd, TIOCSSERIAL, &raw const serial) == 0
    }
}

const TIOCGSERIAL: libc::c_ulong = 0x541E;
const TIOCSSERIAL: libc::c_ulong = 0x541F;

/// `struct serial_struct` of linux/serial.h.
#[repr(C)]
#[derive(Clone, Copy)]
struct SerialStruct {
    kind: libc::c_int,
    line: libc::c_int,
    port: libc::c_uint,
    irq: libc::c_int,
    flags: libc::c_int,
    xmit_fifo_size: libc::c_int,
    custom_divisor: libc::c_int,
    baud_base: libc::c_int,
    close_delay: libc::c_ushort,
    io_type: libc::c_char,
    reserved_char: [libc::c_char; 1],
    hub6: libc::c_int,
    closing_wait: libc::c_ushort,
    closing_wait2: libc::c_ushort,
    iomem_base: *mut libc::c_uchar,
    iomem_reg_shift: libc::c_ushort,
    port_high: libc::c_uint,
    iomap_base: libc::c_ulong,
}

impl Default for SerialStruct {
    fn default() -> Self {
        // SAFETY: all fields are integers or a pointer that is never followed; zero is valid for each.
        unsafe { std::mem::zeroed() }
    }
}

const _: () = assert!(size_of::<SerialStruct>() == 72, "linux/serial.h on 64 bits");

#[cfg(test)]
mod tests {
    use super::*;

    /// Reads until `count` bytes are there or nothing came for a while.
    fn read_all(line: &mut SerialLine, count: usize) -> Vec<u8> {
        let mut got = Vec::new();
        for _ in 0..1000 {
            let mut buffer = [0; 64];
            let n = line.read(&mut buffer).unwrap();
            got.extend_from_slice(&buffer[..n]);
            if got.len() >= count {
                break;
            }
            std::thread::sleep(Duration::from_millis(1));
        }
        got
    }

    #[test]
    fn every_byte_passes_a_pseudo_terminal_unchanged_both_ways() {
        let mut pty = PseudoTerminal::new().unwrap();
        let mut near = SerialLine::open(&pty.path().unwrap(), 921_600).unwrap();
        let all: Vec<u8> = (0..=255).collect();
        assert!(pty.far.write(&all));
        assert_eq!(read_all(&mut near, 256), all);
        assert!(near.write(&all));
        assert_eq!(read_all(&mut pty.far, 256), all);
    }

    #[test]
    fn a_line_that_nobody_reads_never_blocks_the_writer() {
        let mut pty = PseudoTerminal::new().unwrap();
        let refused = (0..10_000).filter(|_| !pty.far.write(&[0x55; 31])).count();
        assert!(refused > 0);
    }

    #[test]
    fn a_near_end_can_be_opened_again_after_its_user_is_gone() {
        let pty = PseudoTerminal::new().unwrap();
        let path = pty.path().unwrap();
        drop(SerialLine::open(&path, 115_200).unwrap());
        assert!(SerialLine::open(&path, 115_200).is_ok());
    }
}
