//! A serial line that comes back when its device is plugged in again. RT: reading and writing yes; opening is the part of
//! an ordinary thread.

use super::SerialLine;
use std::os::fd::RawFd;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, PoisonError, TryLockError, Weak};
use std::time::Duration;

/// The ordinary thread looks so often.
const LOOK_EVERY: Duration = Duration::from_millis(200);

/// What both sides know.
#[derive(Debug, Default)]
struct Shared {
    /// The device is gone: somebody should open it again.
    gone: AtomicBool,
    /// It is back.
    opened: Mutex<Option<SerialLine>>,
}

/// A line by the name of its device.
#[derive(Debug)]
pub struct LastingLine {
    line: Option<SerialLine>,
    shared: Arc<Shared>,
}

impl LastingLine {
    /// Opens the device, and starts the thread that opens it again; that ends with the line.
    ///
    /// # Errors
    /// As for [`SerialLine::open`]; no thread.
    #[expect(clippy::disallowed_methods, reason = "before arming, and in an ordinary thread")]
    pub fn open(path: &str, baud: u32) -> Result<Self, serialport::Error> {
        let line = SerialLine::open(path, baud)?;
        let shared = Arc::<Shared>::default();
        let (weak, path) = (Arc::downgrade(&shared), path.to_owned());
        std::thread::Builder::new().name("serial-keeper".into()).spawn(move || {
            while look_after(&weak, &path, baud) {
                std::thread::sleep(LOOK_EVERY);
            }
        })?;
        Ok(Self { line: Some(line), shared })
    }

    /// Bytes that are there, 0 if none. `None` while the device is gone.
    pub fn read(&mut self, buffer: &mut [u8]) -> Option<usize> {
        if self.line.is_none() {
            self.line = self.take_opened();
        }
        let count = self.line.as_mut()?.read(buffer);
        if count.is_none() {
            self.line = None;
            self.shared.gone.store(true, Ordering::Release);
        }
        count
    }

    /// Hands over bytes. False: gone or full.
    pub fn write(&mut self, bytes: &[u8]) -> bool {
        self.line.as_mut().is_some_and(|line| line.write(bytes))
    }

    /// A descriptor that polls readable when bytes are there; negative while the device is gone.
    #[must_use]
    pub fn readable_fd(&self) -> RawFd {
        self.line.as_ref().map_or(-1, SerialLine::readable_fd)
    }

    /// Never waits: while the thread has the lock there is nothing yet.
    fn take_opened(&self) -> Option<SerialLine> {
        match self.shared.opened.try_lock() {
            Ok(mut opened) => opened.take(),
            Err(TryLockError::Poisoned(poisoned)) => PoisonError::into_inner(poisoned).take(),
            Err(TryLockError::WouldBlock) => None,
        }
    }
}

/// Opens the device again if it is gone. False: nobody needs it any more.
#[expect(clippy::disallowed_methods, reason = "in an ordinary thread")]
fn look_after(shared: &Weak<Shared>, path: &str, baud: u32) -> bool {
    let Some(shared) = shared.upgrade() else { return false };
    if shared.gone.load(Ordering::Acquire)
        && let Ok(line) = SerialLine::open(path, baud)
    {
        shared.gone.store(false, Ordering::Release);
        *shared.opened.lock().unwrap_or_else(PoisonError::into_inner) = Some(line);
    }
    true
}

#[cfg(test)]
mod tests {
    use super::super::PseudoTerminal;
    use super::*;
    use std::os::unix::fs::symlink;
    use std::time::Instant;

    /// Reads until something happens, for some seconds at most.
    fn until(line: &mut LastingLine, done: impl Fn(Option<usize>) -> bool) {
        let start = Instant::now();
        while !done(line.read(&mut [0; 64])) {
            assert!(start.elapsed() < Duration::from_secs(20), "it never came");
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    #[test]
    fn a_device_that_is_plugged_in_again_is_heard_again() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("imu");
        let mut device = PseudoTerminal::new().unwrap();
        symlink(device.path().unwrap(), &path).unwrap();
        let mut line = LastingLine::open(path.to_str().unwrap(), 115_200).unwrap();
        assert!(device.far.write(b"before"));
        until(&mut line, |count| count == Some(6));
        drop(device);
        until(&mut line, |count| count.is_none());
        assert!(line.readable_fd() < 0 && !line.write(b"x"), "nothing to poll, or the thread would spin");
        let mut device = PseudoTerminal::new().unwrap();
        std::fs::remove_file(&path).unwrap();
        symlink(device.path().unwrap(), &path).unwrap();
        until(&mut line, |count| count == Some(0));
        assert!(device.far.write(b"after"));
        until(&mut line, |count| count == Some(5));
    }
}
