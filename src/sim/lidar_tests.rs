//! The simulated scanner at the other end of real links: a TCP connection and a pseudo-terminal.

use super::*;
use crate::config::{self, checked::LidarLink};
use crate::msg::{FloorVerdict, LidarSample, LidarState, TOES};
use crate::rt::{clock, poll};
use crate::sensor::lidar::LidarReader;
use crate::sensor::lidar::link::{LidarLine, serve};
use crate::sim::served::lidar::LidarPort;
use std::net::TcpListener;
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

/// The simulated scanner on real links, and who reads it.
struct Desk {
    port: LidarPort,
    device: SimLidar,
    reader: LidarReader,
    line: LidarLine,
}

impl Desk {
    fn new(link: &LidarLink) -> Self {
        let device = SimLidar::new(&settings(LidarLink::Mock), None, 1);
        let port = LidarPort::open(link).unwrap().unwrap();
        let reader = LidarReader::new(&settings(link.clone()));
        Self { port, device, reader, line: LidarLine::new(link).unwrap() }
    }

    /// Serves both ends until the reader says what is waited for; all words.
    fn until(&mut self, mut done: impl FnMut(&LidarSample) -> bool) -> Vec<LidarSample> {
        let (start, mut words) = (Instant::now(), Vec::new());
        while !words.last().is_some_and(&mut done) {
            assert!(start.elapsed() < PATIENCE, "it never came: {:?}", words.last());
            let [request, host] = self.port.readable_fds();
            poll::readable([self.line.readable_fd(), request, host], clock::now() + Span::from_ms(2));
            let now = clock::now();
            while let Some(at) = self.device.next_measurement().filter(|at| *at <= now) {
                self.device.measure(at, &Still.reading(), &Still);
            }
            self.port.turn(&mut self.device, now);
            serve(&mut self.reader, &mut self.line, clock::now(), |word| words.push(*word));
        }
        words
    }

    fn suffer(&mut self, fault: &str, on: bool) {
        self.device.suffer(&Injection::parse(fault).unwrap(), on);
    }
}

fn is_floor(word: &LidarSample) -> bool {
    word.verdict == FloorVerdict::Found && (word.lean_rad - 0.1).abs() < 0.001
}

#[test]
fn scans_come_over_tcp_and_a_half_open_connection_is_made_anew() {
    // A port that is free now.
    let address = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap();
    let mut desk = Desk::new(&LidarLink::Tcp(address));
    desk.until(is_floor);
    desk.suffer("lidar_half_open@0", true);
    let scans = desk.until(|word| word.state == LidarState::Silent).last().unwrap().scans;
    desk.suffer("lidar_half_open@0", false);
    let words = desk.until(|word| is_floor(word) && word.scans > scans);
    assert!(words.last().unwrap().starts >= 2 && desk.reader.counters().reconnects >= 1);
}

#[test]
fn scans_come_over_a_serial_line_and_a_device_that_is_not_there_is_told() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("lidar");
    let link = LidarLink::Serial(path.to_str().unwrap().to_owned());
    let mut desk = Desk::new(&link);
    desk.until(is_floor);
    // A device that was deaf for a while is heard again.
    desk.suffer("lidar_half_open@0", true);
    let scans = desk.until(|word| word.state == LidarState::Silent).last().unwrap().scans;
    desk.suffer("lidar_half_open@0", false);
    desk.until(|word| is_floor(word) && word.scans > scans);
    // The device's name goes with it.
    drop(desk);
    let (mut reader, mut line) = (LidarReader::new(&settings(link.clone())), LidarLine::new(&link).unwrap());
    let mut words = Vec::new();
    for turn in 0..5 {
        serve(&mut reader, &mut line, Stamp(turn * 600_000_000), |word| words.push(word.state));
    }
    assert_eq!(words, [LidarState::Gone], "told once");
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
