use super::*;
use crate::msg::MocapSample;
use crate::record::stream::tests::random_record;
use proptest::prelude::*;
use std::os::unix::fs::PermissionsExt;
use std::os::unix::net::UnixStream;
use std::path::{Path, PathBuf};
use std::thread;

fn window() -> (tempfile::TempDir, PathBuf, Window) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("watch");
    let window = Window::open(&path, "a = 1\n").unwrap();
    (folder, path, window)
}

fn tick(index: u64) -> TickRecord {
    let mut tick = random_record(index);
    tick.input.index = index;
    tick
}

/// Connects, while the window serves ticks from this number on until the greeting is there; then the next tick's number.
fn connected(path: &Path, window: &mut Window, mut next: u64) -> (LiveReader, u64) {
    let path = path.to_owned();
    let reader = thread::spawn(move || LiveReader::connect(&path).unwrap());
    while !reader.is_finished() {
        window.serve(&tick(next));
        next += 1;
        thread::sleep(std::time::Duration::from_millis(1));
    }
    (reader.join().unwrap(), next)
}

fn numbers(reader: &mut LiveReader) -> Vec<u64> {
    let mut seen = Vec::new();
    while reader.poll(|tick| seen.push(tick.input.index), |_| ()).unwrap() {
        let before = seen.len();
        reader.poll(|tick| seen.push(tick.input.index), |_| ()).unwrap();
        if seen.len() == before {
            break;
        }
    }
    seen
}

#[test]
fn whoever_connects_learns_the_configuration_and_sees_every_tick_to_the_bit() {
    let (_folder, path, mut window) = window();
    assert_eq!(std::fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o660, "user and group");
    let (mut reader, next) = connected(&path, &mut window, 0);
    assert_eq!(reader.config_text(), "a = 1\n");
    let mut seen = Vec::new();
    for index in next..next + 40 {
        window.serve(&tick(index));
        reader.poll(|tick| seen.push(*tick), |_| ()).unwrap();
    }
    let newest = seen.last().unwrap();
    assert_eq!(newest.input.index, next + 39);
    let bytes = |tick: &TickRecord| {
        let mut bytes = Vec::new();
        crate::record::cdr::encode(tick, &mut bytes);
        bytes
    };
    assert_eq!(bytes(newest), bytes(&tick(next + 39)));
    drop(window);
    assert!(!reader.poll(|_| (), |_| ()).unwrap(), "the end of the run is seen");
    assert!(!path.exists(), "and the socket goes with it");
}

#[test]
fn a_configuration_with_a_large_tree_is_read_and_one_that_no_reader_takes_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("watch");
    // 1.5 MB: a tree of 5940 nodes.
    let text = "a".repeat(1_511_821);
    let mut window = Window::open(&path, &text).unwrap();
    let (mut reader, next) = connected(&path, &mut window, 0);
    assert!(reader.config_text() == text);
    window.serve(&tick(next));
    assert!(numbers(&mut reader).ends_with(&[next]), "ticks follow it");
    drop(window);
    let error = Window::open(&path, &"a".repeat(LONGEST_CONFIG + 1)).unwrap_err();
    assert!(error.to_string().contains("LQR-tree"), "{error}");
    assert!(!path.exists());
}

#[test]
fn what_stands_beside_the_ticks_comes_with_the_next_one() {
    let (_folder, path, mut window) = window();
    let pose = |frame: u32| MocapSample { stamp: Stamp(i64::from(frame)), frame, ..MocapSample::default() };
    window.put_beside(Stream::Mocap, Stamp(1), &pose(1));
    let (mut reader, next) = connected(&path, &mut window, 0);
    window.put_beside(Stream::Mocap, Stamp(2), &pose(2));
    window.put_beside(Stream::Mocap, Stamp(3), &pose(3));
    let (mut seen, mut beside) = (Vec::new(), Vec::new());
    for index in next..next + 20 {
        window.serve(&tick(index));
        let note = |(stream, at, bytes): Message<'_>| {
            beside.push((stream, at, crate::record::cdr::decode::<MocapSample>(bytes).unwrap().frame));
        };
        reader.poll(|tick| seen.push(tick.input.index), note).unwrap();
    }
    assert_eq!(seen.last(), Some(&(next + 19)));
    assert_eq!(beside, [(Stream::Mocap, Stamp(2), 2), (Stream::Mocap, Stamp(3), 3)], "once, and none of before");
}

#[test]
fn a_slow_reader_loses_whole_ticks_and_holds_up_neither_the_robot_nor_the_others() {
    let (_folder, path, mut window) = window();
    let (mut slow, next) = connected(&path, &mut window, 0);
    let (mut quick, next) = connected(&path, &mut window, next);
    let mut seen = Vec::new();
    let mut tick = tick(1);
    for index in next..next + 4_000 {
        tick.input.index = index;
        window.serve(&tick);
        quick.poll(|tick| seen.push(tick.input.index), |_| ()).unwrap();
    }
    assert!(seen.ends_with(&(next + 3_000..next + 4_000).collect::<Vec<_>>()), "the quick one has all");
    let late = numbers(&mut slow);
    assert!(late.len() < 4_000, "{} ticks of some 4 kB waited for nobody", late.len());
    assert!(late.windows(2).all(|pair| pair[0] < pair[1]), "in order and whole");
}

#[test]
fn one_reader_too_many_is_turned_away_and_told() {
    let (_folder, path, mut window) = window();
    let readers: Vec<_> = (0..8).map(|_| connected(&path, &mut window, 0).0).collect();
    let extra = path.clone();
    let refused = thread::spawn(move || LiveReader::connect(&extra));
    let mut index = 0;
    while !refused.is_finished() {
        window.serve(&tick(index));
        index += 1;
        thread::sleep(std::time::Duration::from_millis(1));
    }
    assert!(matches!(refused.join().unwrap(), Err(LiveError::Full)));
    drop(readers);
    window.serve(&tick(1));
    assert_eq!(connected(&path, &mut window, 0).0.config_text(), "a = 1\n", "who left makes room");
}

#[test]
fn another_build_and_another_program_are_told_from_ours() {
    let folder = tempfile::tempdir().unwrap();
    let greet = |bytes: Vec<u8>| {
        let path = folder.path().join("other");
        drop(std::fs::remove_file(&path));
        let listener = std::os::unix::net::UnixListener::bind(&path).unwrap();
        let server = thread::spawn(move || {
            use std::io::Write;
            let (mut stream, _) = listener.accept().unwrap();
            stream.write_all(&bytes).unwrap();
            stream
        });
        let result = LiveReader::connect(&path);
        drop::<UnixStream>(server.join().unwrap());
        result.unwrap_err()
    };
    let other = Greeting { shape_hash: shape_hash() ^ 1, config_text: String::new() };
    assert!(matches!(greet(other.to_bytes()), LiveError::OtherBuild));
    assert!(matches!(greet(b"SSH-2.0-OpenSSH\r\n".to_vec()), LiveError::Foreign(_)));
    let mut endless = Greeting { shape_hash: shape_hash(), config_text: String::new() }.to_bytes();
    endless[16..20].fill(0xFF);
    assert!(matches!(greet(endless), LiveError::Foreign(_)), "4 GB of configuration");
}

#[test]
fn a_tick_with_any_byte_missing_is_no_tick() {
    let mut block = Vec::new();
    let Ok(()) = super::super::stream::explode(&tick(3), &mut Vec::new(), |stream, at, message| {
        put_message(&mut block, stream, at, message);
        Ok::<(), std::convert::Infallible>(())
    });
    assert!(tick_of(&block, |_| ()).is_ok());
    for end in 0..block.len() {
        assert!(tick_of(&block[..end], |_| ()).is_err(), "{end}");
    }
    block.push(0);
    assert!(tick_of(&block, |_| ()).is_err());
}

proptest! {
    #[test]
    fn foreign_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..300), greeted: bool) {
        let mut parser = Parser::default();
        if greeted {
            parser.push(&Greeting { shape_hash: 0, config_text: "x".into() }.to_bytes());
            prop_assert!(matches!(parser.take(), Ok(Some(Block::Greeting(_)))));
        }
        parser.push(&bytes);
        while let Ok(Some(Block::Tick(block))) = parser.take() {
            prop_assert!(tick_of(&block, |_| ()).is_err());
        }
    }
}
