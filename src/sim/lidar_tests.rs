//! The simulated scanner at the other end of real links: a TCP connection and a pseudo-terminal.

use super::*;
use crate::config::{self, checked::LidarLink};
use crate::msg::{FloorVerdict, LidarSample, LidarState, TOES};
use crate::rt::{clock, poll};
use crate::sensor::lidar::LidarReader;
use crate::sensor::lidar::link::{LidarLine, serve};
use crate::sensor::serial::PseudoTerminal;
use std::io::{ErrorKind, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// Long enough for any busy machine; nothing is said about how long it takes.
const PATIENCE: Duration = Duration::from_secs(60);

fn settings(link: LidarLink) -> Lidar {
    let example = include_str!("../../config/examples/lidar.toml");
    Lidar { link, ..config::load_text("lidar.toml", example, &[]).unwrap().config.robot.lidar.unwrap() }
}

/// A robot that leans and stands still, a metre over its floor.
struct Still;

impl World for Still {
    fn step(&mut self, _: f64, _: [f64; TOES], _: Span) {}
    fn let_go(&mut self) {}
    fn push(&mut self, _: f64) {}
    fn reading(&self) -> Reading {
        Reading { leg_angle_rad: [0.1, 0.0], ..Reading::default() }
    }
}

/// One turn of the device on some line: what it heard in, what it has to say out.
fn turn(device: &mut SimLidar, heard: &[u8], out: &mut Vec<u8>) {
    let now = clock::now();
    device.hear(now, heard);
    while let Some(at) = device.next_measurement().filter(|at| *at <= now) {
        device.measure(at, &Still.reading(), &Still);
    }
    device.take(now, out);
}

fn is_quiet(error: &std::io::Error) -> bool {
    matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut)
}

/// Serves one connection until the other end leaves or `deaf` is set; then it stays open and says nothing.
fn serve_connection(mut stream: TcpStream, deaf: &AtomicBool, over: &AtomicBool) {
    let mut device = SimLidar::new(&settings(LidarLink::Mock), None, 1);
    device.connect();
    stream.set_read_timeout(Some(Duration::from_millis(2))).unwrap();
    let (mut heard, mut out) = ([0; 256], Vec::new());
    while !over.load(Ordering::Relaxed) {
        let count = match stream.read(&mut heard) {
            Ok(0) => return,
            Ok(count) => count,
            Err(error) if is_quiet(&error) => 0,
            Err(_) => return,
        };
        if deaf.load(Ordering::Relaxed) {
            continue;
        }
        out.clear();
        turn(&mut device, &heard[..count], &mut out);
        if stream.write_all(&out).is_err() {
            return;
        }
    }
}

/// Serves the reader until it says what is waited for; all words.
fn until(
    reader: &mut LidarReader,
    line: &mut LidarLine,
    mut done: impl FnMut(&LidarSample) -> bool,
) -> Vec<LidarSample> {
    let (start, mut words) = (Instant::now(), Vec::new());
    while !words.last().is_some_and(&mut done) {
        assert!(start.elapsed() < PATIENCE, "it never came: {:?}", words.last());
        poll::readable([line.readable_fd()], clock::now() + Span::from_ms(2));
        serve(reader, line, clock::now(), |word| words.push(*word));
    }
    words
}

fn is_floor(word: &LidarSample) -> bool {
    word.verdict == FloorVerdict::Found && (word.lean_rad - 0.1).abs() < 0.001
}

#[test]
fn scans_come_over_tcp_and_a_half_open_connection_is_made_anew() {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = listener.local_addr().unwrap();
    let (deaf, over) = (Arc::new(AtomicBool::new(false)), Arc::new(AtomicBool::new(false)));
    let flags = (Arc::clone(&deaf), Arc::clone(&over));
    let server = std::thread::spawn(move || {
        let mut connections = 0;
        for stream in listener.incoming() {
            let (deaf, over) = (Arc::clone(&flags.0), Arc::clone(&flags.1));
            if over.load(Ordering::Relaxed) {
                return connections;
            }
            connections += 1;
            // Whoever comes after a dead connection is heard again.
            deaf.store(false, Ordering::Relaxed);
            let mine = Arc::new(AtomicBool::new(false));
            let ear = if connections == 1 { deaf } else { mine };
            std::thread::spawn(move || serve_connection(stream.unwrap(), &ear, &over));
        }
        connections
    });
    let lidar = settings(LidarLink::Tcp(address));
    let (mut reader, mut line) = (LidarReader::new(&lidar), LidarLine::new(&lidar.link).unwrap());
    until(&mut reader, &mut line, is_floor);
    deaf.store(true, Ordering::Relaxed);
    let words = until(&mut reader, &mut line, |word| word.state == LidarState::Silent);
    let scans = words.last().unwrap().scans;
    let words = until(&mut reader, &mut line, |word| is_floor(word) && word.scans > scans);
    assert!(words.last().unwrap().starts >= 2 && reader.counters().reconnects >= 1);
    over.store(true, Ordering::Relaxed);
    // Wakes the one who accepts.
    drop(TcpStream::connect(address));
    assert!(server.join().unwrap() >= 2);
}

#[test]
fn scans_come_over_a_serial_line_and_a_device_that_is_not_there_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lidar");
    let lidar = settings(LidarLink::Serial(path.to_str().unwrap().to_owned()));
    let (mut reader, mut line) = (LidarReader::new(&lidar), LidarLine::new(&lidar.link).unwrap());
    let words = until(&mut reader, &mut line, |word| word.state == LidarState::Gone);
    assert_eq!(words.len(), 1, "told once");
    let mut terminal = PseudoTerminal::new().unwrap();
    std::os::unix::fs::symlink(terminal.path().unwrap(), &path).unwrap();
    let over = Arc::new(AtomicBool::new(false));
    let flag = Arc::clone(&over);
    let device = std::thread::spawn(move || {
        let mut device = SimLidar::new(&settings(LidarLink::Mock), None, 1);
        device.connect();
        let (mut heard, mut out) = ([0; 256], Vec::new());
        while !flag.load(Ordering::Relaxed) {
            let count = terminal.far.read(&mut heard).unwrap_or(0);
            turn(&mut device, &heard[..count], &mut out);
            // A line that is full takes the rest later, as a USB modem does.
            let most = out.len().min(512);
            if terminal.far.write(&out[..most]) {
                out.drain(..most);
            }
            std::thread::sleep(Duration::from_millis(1));
        }
    });
    until(&mut reader, &mut line, is_floor);
    over.store(true, Ordering::Relaxed);
    device.join().unwrap();
}

#[test]
fn lines_split_across_segments_and_a_clock_that_wraps_do_not_matter() {
    let lidar = settings(LidarLink::Mock);
    for text in ["lidar_split@0:for=ever", "lidar_time_wrap@1"] {
        let fault = Injection::parse(text).unwrap();
        let (mut device, mut reader) = (SimLidar::new(&lidar, None, 1), LidarReader::new(&lidar));
        device.prepare(&[fault]);
        device.suffer(&fault, true);
        let (mut open, mut bytes, mut stamps) = (false, Vec::new(), Vec::new());
        for quarter in 0..12_000_i64 {
            let now = Stamp(quarter * 250_000);
            while let Some(at) = device.next_measurement().filter(|at| *at <= now) {
                device.measure(at, &Still.reading(), &Still);
            }
            let mut line = SimLine { device: &mut device, open: &mut open, now, bytes: &mut bytes };
            serve(&mut reader, &mut line, now, |word| {
                if word.state == LidarState::Streaming {
                    stamps.push((word.stamp, now));
                }
            });
        }
        assert!(stamps.len() > 100, "{text}: {}", stamps.len());
        let counters = *reader.counters();
        assert_eq!((counters.damaged, counters.missing, counters.starts), (0, 0, 1), "{text}");
        for pair in stamps.windows(2) {
            let step_s = pair[1].0.since(pair[0].0).as_s();
            // Whole milliseconds of the device's clock.
            assert!((step_s - 0.025).abs() < 0.0025, "{text}: {step_s} s at {:?}", pair[1]);
        }
    }
}
