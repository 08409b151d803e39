use super::*;
use crate::config;
use crate::msg::{Element, RecorderState};
use crate::record::cdr::encode;
use crate::record::reader::Reader;
use crate::record::scan::Ending;
use crate::record::storage::Storage;
use crate::record::stream::tests::random_record;
use std::fs::{self, File};
use std::io::{Seek, SeekFrom, Write};
use std::sync::atomic::AtomicI64;

fn bytes_of(message: &impl Element) -> Vec<u8> {
    let mut bytes = Vec::new();
    encode(message, &mut bytes);
    bytes
}

/// A tick of random content with a plain number and time.
fn tick(index: u64) -> TickRecord {
    let mut record = random_record(index);
    record.input.index = index;
    record.input.now = crate::base::time::Stamp(1_000_000 * (index as i64 + 1));
    record
}

fn default_config() -> Resolved {
    config::load(None, &[]).unwrap()
}

fn read_all(path: &Path) -> (Vec<TickRecord>, Reader) {
    let mut reader = Reader::open(path).unwrap();
    let mut ticks = Vec::new();
    while let Some(tick) = reader.next_tick().unwrap() {
        ticks.push(*tick);
    }
    (ticks, reader)
}

fn record_some(folder: &Path, count: u64) -> PathBuf {
    let recorder = Recorder::start(folder, &default_config()).unwrap();
    (0..count).for_each(|i| recorder.push(&tick(i)));
    let path = recorder.path();
    let status = recorder.finish();
    assert_eq!((status.written, status.dropped, status.state), (count, 0, RecorderState::Finished));
    assert_eq!(status.bytes, fs::metadata(&path).unwrap().len());
    path
}

#[test]
fn recording_holds_every_bit_of_every_tick_and_its_configuration() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_some(folder.path(), 300);
    let (ticks, reader) = read_all(&path);
    assert_eq!(reader.ending(), Some(Ending::Whole));
    assert_eq!(reader.broken_ticks(), 0);
    assert_eq!(ticks.len(), 300);
    for (i, read) in ticks.iter().enumerate() {
        assert_eq!(bytes_of(read), bytes_of(&tick(i as u64)), "tick {i}");
    }
    let resolved = default_config();
    assert_eq!(reader.about().config_text.as_deref(), Some(resolved.text.as_str()));
    assert_eq!(reader.about().program("config_sha256"), Some(resolved.hash.as_str()));
    assert_eq!(reader.about().program("version"), Some(env!("CARGO_PKG_VERSION")));
    assert_eq!(reader.about().clock().unwrap().0, 1_000_000);
}

#[test]
fn file_cut_anywhere_reads_up_to_the_last_whole_tick() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_some(folder.path(), 60);
    let whole = fs::read(&path).unwrap();
    let cut_path = folder.path().join("cut.mcap");
    let mut last = 0;
    for length in (8..whole.len()).step_by(1000) {
        fs::write(&cut_path, &whole[..length]).unwrap();
        let (ticks, reader) = read_all(&cut_path);
        for (i, read) in ticks.iter().enumerate() {
            assert_eq!(bytes_of(read), bytes_of(&tick(i as u64)), "cut at {length}, tick {i}");
        }
        assert!(ticks.len() >= last, "a longer file holds no less");
        last = ticks.len();
        assert!(ticks.len() == 60 || matches!(reader.ending(), Some(Ending::Torn { .. })), "cut at {length}");
    }
    assert_eq!(last, 60, "the summary alone is more than 1000 bytes");
}

#[test]
fn flipped_byte_never_panics_and_never_invents_ticks() {
    let folder = tempfile::tempdir().unwrap();
    let path = record_some(folder.path(), 20);
    let whole = fs::read(&path).unwrap();
    for at in (8..whole.len()).step_by(997) {
        let mut bytes = whole.clone();
        bytes[at] ^= 0x55;
        fs::write(&path, &bytes).unwrap();
        let Ok(mut reader) = Reader::open(&path) else { continue };
        let mut count = 0;
        while let Ok(Some(_)) = reader.next_tick() {
            count += 1;
        }
        assert!(count <= 20, "flipped at {at}");
    }
}

/// A disk with so many bytes of room left, shared by all its files; each sync takes `sync_time`.
struct SmallDisk {
    folder: PathBuf,
    room: Arc<AtomicI64>,
    sync_time: Duration,
}

struct SmallDiskFile {
    file: File,
    room: Arc<AtomicI64>,
    sync_time: Duration,
}

impl Shelf for SmallDisk {
    fn open(&mut self, part: u32) -> io::Result<(PathBuf, Box<dyn Storage>)> {
        let path = self.folder.join(format!("{part}.mcap"));
        let file = SmallDiskFile { file: File::create(&path)?, room: self.room.clone(), sync_time: self.sync_time };
        Ok((path, Box::new(file)))
    }
    fn discard(&mut self, path: &Path) {
        fs::remove_file(path).unwrap();
    }
    fn free_bytes(&self) -> u64 {
        self.room.load(Ordering::Relaxed).cast_unsigned()
    }
    fn prune(&mut self, _keep_bytes: u64, room_bytes: u64, present: &Path) -> u32 {
        let mut removed = 0;
        for path in (1..10).map(|part| self.folder.join(format!("{part}.mcap"))).filter(|path| path != present) {
            let Ok(metadata) = fs::metadata(&path).ok().filter(|_| self.free_bytes() < room_bytes).ok_or(()) else {
                continue;
            };
            fs::remove_file(&path).unwrap();
            self.room.fetch_add(metadata.len().cast_signed(), Ordering::Relaxed);
            removed += 1;
        }
        removed
    }
}

impl Write for SmallDiskFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let room = self.room.load(Ordering::Relaxed);
        if room <= 0 {
            return Err(io::Error::from(io::ErrorKind::StorageFull));
        }
        let taken = bytes.len().min(room as usize);
        self.room.fetch_sub(taken as i64, Ordering::Relaxed);
        self.file.write(&bytes[..taken])
    }
    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for SmallDiskFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Storage for SmallDiskFile {
    fn sync(&mut self) -> io::Result<()> {
        thread::sleep(self.sync_time);
        Ok(())
    }
    fn cut(&mut self, length: u64) -> io::Result<()> {
        self.file.set_len(length)
    }
}

fn small_disk(room: i64, sync_time: Duration) -> (Recorder, tempfile::TempDir, Arc<AtomicI64>) {
    small_disk_keeping(room, sync_time, None, &[])
}

/// The same; `older`: recordings of so many bytes each are there already.
fn small_disk_keeping(
    room: i64,
    sync_time: Duration,
    keep_bytes: Option<u64>,
    older: &[usize],
) -> (Recorder, tempfile::TempDir, Arc<AtomicI64>) {
    let folder = tempfile::tempdir().unwrap();
    for (part, bytes) in (5..).zip(older) {
        fs::write(folder.path().join(format!("{part}.mcap")), vec![0; *bytes]).unwrap();
    }
    let room = Arc::new(AtomicI64::new(room));
    let disk = SmallDisk { folder: folder.path().to_owned(), room: room.clone(), sync_time };
    let recorder = Recorder::start_on(Box::new(disk), Identity::new(&default_config()), keep_bytes);
    (recorder.unwrap_or_else(|_| panic!("start")), folder, room)
}

fn wait_until(recorder: &Recorder, what: impl Fn(&RecorderStatus) -> bool) {
    while !what(&recorder.status()) {
        thread::sleep(Duration::from_millis(5));
    }
}

/// Pushes ticks until the disk is full. Their number.
fn fill(recorder: &Recorder) -> u64 {
    let mut next = 0;
    while recorder.status().state != RecorderState::DiskFull {
        recorder.push(&tick(next));
        next += 1;
        thread::sleep(Duration::from_millis(1));
    }
    next
}

#[test]
fn full_disk_costs_ticks_which_are_counted_and_told_and_recording_goes_on_when_there_is_room() {
    let (recorder, folder, room) = small_disk(4_000_000, Duration::ZERO);
    let next = fill(&recorder);
    let safe = recorder.status().written;
    assert!(safe > 0);
    let notice = recorder.take_notices().concat();
    assert!(notice.contains("ticks are safe") && notice.contains("no storage space"), "the cause is named: {notice}");
    assert!(
        recorder.path().ends_with("1.mcap"),
        "not the next one, which holds nothing: {}",
        recorder.path().display()
    );
    // What was told to be safe is in the file, and its torn end is off.
    let (ticks, _) = read_all(&folder.path().join("1.mcap"));
    assert_eq!(ticks.len() as u64, safe);

    room.store(i64::MAX, Ordering::Relaxed);
    wait_until(&recorder, |status| status.state == RecorderState::Recording);
    (next..next + 10).for_each(|i| recorder.push(&tick(i)));
    let status = recorder.finish();
    assert_eq!(status.state, RecorderState::Finished);
    assert_eq!(status.written + status.dropped, next + 10, "every tick is either safe or counted");
    assert_eq!(status.files, 2);
    let (ticks, _) = read_all(&folder.path().join("2.mcap"));
    assert_eq!(ticks.last().unwrap().input.index, next + 9);
}

#[test]
fn a_disk_that_stays_full_gets_no_further_files() {
    let (recorder, folder, room) = small_disk(4_000_000, Duration::ZERO);
    fill(&recorder);
    // Room for a head and some ticks is none.
    room.store(1_000_000, Ordering::Relaxed);
    thread::sleep(RETRY_FIRST + 10 * POLL);
    assert_eq!((recorder.status().files, fs::read_dir(folder.path()).unwrap().count()), (1, 1));
    assert!(recorder.finish().written > 0);
}

#[test]
fn with_a_cap_the_oldest_make_room_on_a_full_disk_at_the_start_and_on_the_way() {
    let older = [20 << 20; 2];
    let (recorder, folder, room) = small_disk_keeping(0, Duration::ZERO, Some(1 << 40), &older);
    let exists = |part: u32| folder.path().join(format!("{part}.mcap")).exists();
    assert_eq!([5, 6].map(exists), [false, true], "one makes room enough");
    room.store(1_000, Ordering::Relaxed);
    let mut index = 0;
    while exists(6) {
        recorder.push(&tick(index));
        index += 1;
        thread::sleep(Duration::from_millis(1));
    }
    wait_until(&recorder, |status| status.state == RecorderState::Recording);
    recorder.push(&tick(index));
    index += 1;
    let status = recorder.finish();
    assert_eq!((status.state, status.written + status.dropped), (RecorderState::Finished, index));
}

#[test]
fn slow_disk_never_makes_push_wait() {
    let (recorder, folder, _) = small_disk(i64::MAX, Duration::from_millis(300));
    let count = 3 * QUEUE_TICKS as u64;
    let record = tick(0);
    let mut slowest = Duration::ZERO;
    for _ in 0..count {
        let start = Instant::now();
        recorder.push(&record);
        slowest = slowest.max(start.elapsed());
    }
    let status = recorder.finish();
    assert_eq!(status.written + status.dropped, count, "every tick is either safe or counted");
    // A sync takes 300 ms; a push that waited for one would show. No bound on time itself: the machine is shared.
    println!("slowest push {slowest:?}, dropped {}", status.dropped);
    let (ticks, _) = read_all(&folder.path().join("1.mcap"));
    assert_eq!(ticks.len() as u64, status.written);
}

#[test]
fn folder_that_cannot_be_written_is_told_at_once() {
    let error = Recorder::start(Path::new("/proc/nowhere"), &default_config()).err().unwrap();
    assert!(error.to_string().contains("/proc/nowhere"), "{error}");
}

/// The service filled its disk with 7 GB an hour.
#[test]
fn a_folder_with_a_cap_holds_the_newest_and_no_more() {
    let folder = tempfile::tempdir().unwrap();
    let keep = 8_000_000;
    let recorder = Recorder::start_keeping(folder.path(), &default_config(), Some(keep)).unwrap();
    let mut index = 0;
    while recorder.status().files < 10 {
        recorder.push(&tick(index));
        index += 1;
        thread::sleep(Duration::from_millis(1));
    }
    let last = recorder.path();
    let status = recorder.finish();
    let total: u64 = fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().metadata().unwrap().len()).sum();
    // The cap, and what came in during the last flush period.
    assert!(total < keep + 4 * keep / 8 + status.bytes, "{total}");
    let (ticks, reader) = read_all(&last);
    assert_eq!(reader.ending(), Some(Ending::Whole));
    assert!(ticks.iter().all(|t| t.input.index < index) && status.dropped == 0);
}

#[test]
fn poses_of_motion_capture_stand_beside_the_ticks_and_are_no_part_of_them() {
    let folder = tempfile::tempdir().unwrap();
    let recorder = Recorder::start(folder.path(), &default_config()).unwrap();
    let pose = |frame: u32| MocapSample {
        stamp: Stamp(1_000_000 * i64::from(frame)),
        frame,
        tracked: true,
        position_m: [0.5, -1.0, 2.0],
        ..MocapSample::default()
    };
    for index in 0..20 {
        recorder.push(&tick(index));
        recorder.push_pose(&pose(u32::try_from(index).unwrap() + 1));
    }
    let path = recorder.path();
    recorder.close();
    assert_eq!(read_all(&path).0.len(), 20);
    let mut poses = Vec::new();
    Reader::open(&path)
        .unwrap()
        .messages(|message| {
            if message.stream == crate::record::stream::Stream::Mocap {
                poses.push(crate::record::cdr::decode::<MocapSample>(message.bytes).unwrap());
            }
            None::<()>
        })
        .unwrap();
    assert_eq!(poses, (1..=20).map(pose).collect::<Vec<_>>());
}
