//! Where recordings go: files in a folder, or something a test made up. RT: no.

#![expect(unsafe_code, reason = "statvfs")]

use std::ffi::CString;
use std::fs::{self, File, OpenOptions};
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::mem::MaybeUninit;
use std::os::unix::ffi::OsStrExt;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{SystemTime, UNIX_EPOCH};

/// An open file.
pub trait Storage: Write + Seek + Send {
    /// Returns when everything written so far survives a power cut.
    ///
    /// # Errors
    /// When the disk does not take it.
    fn sync(&mut self) -> io::Result<()>;
    /// Cuts the file to `length` bytes.
    ///
    /// # Errors
    /// When the disk refuses.
    fn cut(&mut self, length: u64) -> io::Result<()>;
}

impl Storage for File {
    fn sync(&mut self) -> io::Result<()> {
        self.sync_data()
    }
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.set_len(length)
    }
}

/// Opens the files of one recording, one after the other.
pub trait Shelf: Send {
    /// Opens file number `part`, from 1.
    ///
    /// # Errors
    /// When it cannot be created.
    fn open(&mut self, part: u32) -> io::Result<(PathBuf, Box<dyn Storage>)>;
    /// Removes a file that holds nothing of use.
    fn discard(&mut self, path: &Path);
    /// Bytes that the disk still takes; no limit where nobody knows.
    fn free_bytes(&self) -> u64 {
        u64::MAX
    }
    /// Removes the oldest recordings until those that are left take at most so many bytes and the disk takes `room_bytes` more;
    /// never the present one. Their number.
    fn prune(&mut self, _keep_bytes: u64, _room_bytes: u64, _present: &Path) -> u32 {
        0
    }
}

/// Bytes that an ordinary process may still write to the disk of this folder.
///
/// # Errors
/// When there is no such folder.
pub fn free_bytes(folder: &Path) -> io::Result<u64> {
    let stat = statvfs(folder)?;
    Ok(stat.f_bavail.saturating_mul(stat.f_frsize))
}

/// Whether the file system that holds a folder is mounted read-only, whatever the folder's mode says.
///
/// # Errors
/// When there is no such folder.
pub fn is_read_only(folder: &Path) -> io::Result<bool> {
    Ok(statvfs(folder)?.f_flag & libc::ST_RDONLY != 0)
}

fn statvfs(folder: &Path) -> io::Result<libc::statvfs> {
    let path = CString::new(folder.as_os_str().as_bytes())?;
    let mut stat = MaybeUninit::<libc::statvfs>::zeroed();
    // SAFETY: `path` ends with a NUL, `stat` has room for the one structure that is written.
    if unsafe { libc::statvfs(path.as_ptr(), stat.as_mut_ptr()) } != 0 {
        return Err(io::Error::last_os_error());
    }
    // SAFETY: all-zero bytes are a valid statvfs, and the call has filled it in.
    Ok(unsafe { stat.assume_init() })
}

/// A folder. Files are called `compass-2026-11-20T23-41-24Z.mcap`; after trouble with the disk `...Z-2.mcap` and so on.
pub struct Folder {
    folder: PathBuf,
    start: SystemTime,
}

impl Folder {
    /// Makes the folder if need be.
    ///
    /// # Errors
    /// When it cannot be made.
    pub fn new(folder: &Path) -> io::Result<Self> {
        fs::create_dir_all(folder)?;
        Ok(Self { folder: folder.to_owned(), start: SystemTime::now() })
    }
}

impl Shelf for Folder {
    fn open(&mut self, part: u32) -> io::Result<(PathBuf, Box<dyn Storage>)> {
        let date = utc(self.start.duration_since(UNIX_EPOCH).map_or(0, |d| d.as_secs()));
        // Two recordings within one second get different names; never overwrite.
        for attempt in 0..100 {
            let parts = if part > 1 { format!("-{part}") } else { String::new() };
            let twin = if attempt > 0 { format!("-{}", char::from(b'a' + attempt % 26)) } else { String::new() };
            let path = self.folder.join(format!("compass-{date}{twin}{parts}.mcap"));
            match OpenOptions::new().write(true).create_new(true).open(&path) {
                Ok(file) => {
                    // Its name survives a power cut too.
                    File::open(&self.folder)?.sync_all()?;
                    return Ok((path, Box::new(file)));
                }
                Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
                Err(error) => return Err(error),
            }
        }
        Err(io::Error::from(io::ErrorKind::AlreadyExists))
    }

    fn discard(&mut self, path: &Path) {
        // It holds nothing; if it stays, `inspect` says so.
        drop(fs::remove_file(path));
    }

    fn free_bytes(&self) -> u64 {
        free_bytes(&self.folder).unwrap_or(u64::MAX)
    }

    fn prune(&mut self, keep_bytes: u64, room_bytes: u64, present: &Path) -> u32 {
        let mut recordings = recordings(&self.folder);
        let mut total: u64 = recordings.iter().map(|(_, _, bytes)| bytes).sum();
        recordings.sort();
        let mut removed = 0;
        for (_, path, bytes) in recordings {
            if total <= keep_bytes && self.free_bytes() >= room_bytes {
                break;
            }
            if path != present && fs::remove_file(&path).is_ok() {
                total -= bytes;
                removed += 1;
            }
        }
        removed
    }
}

/// Our recordings in a folder: when they were written last, where, and how large they are.
fn recordings(folder: &Path) -> Vec<(SystemTime, PathBuf, u64)> {
    let Ok(entries) = fs::read_dir(folder) else { return Vec::new() };
    let ours = |path: &Path| {
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default();
        name.starts_with("compass-") && name.ends_with(".mcap")
    };
    let described = |path: PathBuf| {
        let metadata = fs::symlink_metadata(&path).ok().filter(fs::Metadata::is_file)?;
        Some((metadata.modified().ok()?, path, metadata.len()))
    };
    entries.filter_map(|entry| Some(entry.ok()?.path())).filter(|path| ours(path)).filter_map(described).collect()
}

/// Seconds since 1970 as `2026-11-20T23-41-24Z` (no colons: every file system takes it).
fn utc(seconds: u64) -> String {
    let (days, rest) = (seconds / 86_400, seconds % 86_400);
    // Civil date from days, Howard Hinnant's algorithm: years begin in March, so a leap day is the last of its year.
    let shifted = days + 719_468;
    let era = shifted / 146_097;
    let day_of_era = shifted % 146_097;
    let year_of_era = (day_of_era - day_of_era / 1_460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let month_from_march = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * month_from_march + 2) / 5 + 1;
    let month = if month_from_march < 10 { month_from_march + 3 } else { month_from_march - 9 };
    let year = year_of_era + era * 400 + u64::from(month <= 2);
    let (hour, minute, second) = (rest / 3600, rest / 60 % 60, rest % 60);
    format!("{year:04}-{month:02}-{day:02}T{hour:02}-{minute:02}-{second:02}Z")
}

/// What the MCAP writer writes into: buffers small writes, makes `flush` reach the disk, remembers how far that got.
pub(super) struct Sink {
    buffer: BufWriter<Box<dyn Storage>>,
    safe: Arc<AtomicU64>,
    end: u64,
}

/// Message indexes are many small writes; a chunk goes through at once.
const BUFFER_BYTES: usize = 64 * 1024;

impl Sink {
    pub(super) fn new(storage: Box<dyn Storage>) -> Self {
        Self { buffer: BufWriter::with_capacity(BUFFER_BYTES, storage), safe: Arc::default(), end: 0 }
    }

    /// Bytes that survive a power cut; goes on counting when the sink has moved into the MCAP writer.
    pub(super) fn safe(&self) -> Arc<AtomicU64> {
        self.safe.clone()
    }

    /// After an error: forgets what is buffered and cuts the torn end off. Returns the bytes that are safe.
    pub(super) fn abandon(self) -> u64 {
        let (mut storage, _unwritten) = self.buffer.into_parts();
        let safe = self.safe.load(Ordering::Relaxed);
        // A file with a torn end is readable too; cutting is only tidier, so a failure here is no news.
        drop(storage.cut(safe).and_then(|()| storage.sync()));
        safe
    }
}

impl Write for Sink {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let count = self.buffer.write(bytes)?;
        self.end += count as u64;
        Ok(count)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.buffer.flush()?;
        self.buffer.get_mut().sync()?;
        self.safe.store(self.end, Ordering::Relaxed);
        Ok(())
    }
}

impl Seek for Sink {
    /// The writer only ever asks where it is; an answer from our own count does not flush the buffer.
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        match to {
            SeekFrom::Current(0) => Ok(self.end),
            SeekFrom::Start(at) if at == self.end => Ok(at),
            _ => Err(io::Error::from(io::ErrorKind::NotSeekable)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_are_civil() {
        assert_eq!(utc(0), "1970-01-01T00-00-00Z");
        assert_eq!(utc(951_782_400), "2000-02-29T00-00-00Z");
        // `date -u -d @1795218084` says Fri Nov 20 23:41:24 UTC 2026.
        assert_eq!(utc(1_795_218_084), "2026-11-20T23-41-24Z");
    }

    #[test]
    fn files_of_one_second_do_not_overwrite_each_other() {
        let folder = tempfile::tempdir().unwrap();
        let mut shelf = Folder::new(folder.path()).unwrap();
        let names: Vec<_> = (0..3).map(|_| shelf.open(1).unwrap().0).collect();
        assert!(names[0] != names[1] && names[1] != names[2]);
        assert!(shelf.open(2).unwrap().0.display().to_string().ends_with("Z-2.mcap"));
    }

    #[test]
    fn the_oldest_recordings_go_and_nothing_else_does() {
        let folder = tempfile::tempdir().unwrap();
        let mut shelf = Folder::new(folder.path()).unwrap();
        let write = |name: &str, age_s: u64| {
            let path = folder.path().join(name);
            fs::write(&path, [0; 1000]).unwrap();
            let file = File::options().write(true).open(&path).unwrap();
            file.set_modified(SystemTime::now() - std::time::Duration::from_secs(age_s)).unwrap();
            path
        };
        let [old, middle, present] =
            [write("compass-a.mcap", 300), write("compass-b.mcap", 200), write("compass-c.mcap", 400)];
        let others = [write("notes.txt", 999), write("other.mcap", 999)];
        assert_eq!(shelf.prune(2_000, 0, &present), 1);
        assert!(!old.exists() && middle.exists() && present.exists() && others.iter().all(|path| path.exists()));
        let newer = write("compass-d.mcap", 100);
        assert_eq!(shelf.prune(u64::MAX, 0, &present), 0, "nothing asks for room");
        assert_eq!(shelf.prune(u64::MAX, u64::MAX, &present), 2, "no disk is so large");
        assert!(!newer.exists() && present.exists(), "the one that is being written stays");
    }
}
