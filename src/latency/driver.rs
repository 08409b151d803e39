//! The clockwork around a chain under test: one datagram in per period, one reply out, timed by the chain itself.
//!
//! The reply carries when its sensor frame was sent and when the command frame was written, both on CLOCK_MONOTONIC,
//! so that the driver's own wake-ups do not count. RT: no.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::thread;
use std::time::{Duration, Instant};

use super::window::Window;
use crate::rt::clock;

/// Bytes of the datagram that stands for a sensor frame with its message around it.
pub const SENSOR_BYTES: usize = 200;
/// Bytes of the reply: two stamps, a number and a CAN frame.
pub const REPLY_BYTES: usize = 40;

/// A sensor datagram: sent at, number, state, padding. Layout as in `bench/latency/lcm_chain.c`.
#[must_use]
pub fn sensor_datagram(sent_ns: i64, number: u64, state: [f64; 4]) -> [u8; SENSOR_BYTES] {
    let mut out = [0; SENSOR_BYTES];
    out[0..8].copy_from_slice(&sent_ns.to_ne_bytes());
    out[8..16].copy_from_slice(&number.to_ne_bytes());
    for (i, x) in state.iter().enumerate() {
        out[16 + 8 * i..24 + 8 * i].copy_from_slice(&x.to_ne_bytes());
    }
    out
}

/// Stamps and state out of a sensor datagram.
#[must_use]
pub fn parse_sensor(bytes: &[u8; SENSOR_BYTES]) -> (i64, u64, [f64; 4]) {
    let word = |at: usize| {
        let mut b = [0; 8];
        b.copy_from_slice(&bytes[at..at + 8]);
        b
    };
    let state = [16, 24, 32, 40].map(|at| f64::from_ne_bytes(word(at)));
    (i64::from_ne_bytes(word(0)), u64::from_ne_bytes(word(8)), state)
}

/// A reply: sent at, number, written at, command frame.
#[must_use]
pub fn reply(sent_ns: i64, number: u64, written_ns: i64, frame: [u8; 16]) -> [u8; REPLY_BYTES] {
    let mut out = [0; REPLY_BYTES];
    out[0..8].copy_from_slice(&sent_ns.to_ne_bytes());
    out[8..16].copy_from_slice(&number.to_ne_bytes());
    out[16..24].copy_from_slice(&written_ns.to_ne_bytes());
    out[24..40].copy_from_slice(&frame);
    out
}

fn latency_us(bytes: &[u8; REPLY_BYTES]) -> f64 {
    let word = |at: usize| {
        let mut b = [0; 8];
        b.copy_from_slice(&bytes[at..at + 8]);
        i64::from_ne_bytes(b)
    };
    #[expect(clippy::cast_precision_loss, reason = "a latency, far below 2^52 ns")]
    let us = (word(16) - word(0)) as f64 * 1e-3;
    us
}

/// What a window of the driver saw.
#[derive(Debug)]
pub struct Driven {
    /// Latency of each reply, us.
    pub window: Window,
    /// Frames sent.
    pub sent: usize,
}

/// Sends `count` frames to `into`, one per `period`, and collects the replies that arrive at `out`.
///
/// # Errors
/// If a socket fails; a chain that is not there yet is not an error, its replies are just missing.
pub fn run(into: &Path, out: &UnixDatagram, count: usize, period: Duration) -> io::Result<Driven> {
    let socket = UnixDatagram::unbound()?;
    socket.set_nonblocking(true)?;
    out.set_nonblocking(true)?;
    let mut samples = Vec::with_capacity(count);
    let mut next = Instant::now();
    for number in 0..count {
        next += period;
        thread::sleep(next.saturating_duration_since(Instant::now()));
        collect(out, &mut samples);
        // A frame that finds no reader is lost, as on a bus.
        let sent = socket.send_to(&sensor_datagram(clock::now().0, number as u64, [0.01, -0.02, 0.1, 0.2]), into);
        drop(sent);
    }
    thread::sleep(Duration::from_millis(50));
    collect(out, &mut samples);
    Ok(Driven { window: Window::new(samples), sent: count })
}

fn collect(out: &UnixDatagram, samples: &mut Vec<f64>) {
    let mut bytes = [0; REPLY_BYTES];
    while matches!(out.recv(&mut bytes), Ok(REPLY_BYTES)) {
        samples.push(latency_us(&bytes));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datagrams_round_trip() {
        let d = sensor_datagram(-5, 7, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(parse_sensor(&d), (-5, 7, [1.0, 2.0, 3.0, 4.0]));
    }

    #[test]
    fn a_chain_that_answers_after_its_own_delay_is_timed_by_its_stamps() {
        let dir = tempfile::tempdir().unwrap();
        let (into, back) = (dir.path().join("in"), dir.path().join("out"));
        let (sensor, out) = (UnixDatagram::bind(&into).unwrap(), UnixDatagram::bind(&back).unwrap());
        let echo = thread::spawn(move || {
            let tx = UnixDatagram::unbound().unwrap();
            let mut bytes = [0; SENSOR_BYTES];
            for _ in 0..5 {
                sensor.recv(&mut bytes).unwrap();
                let (sent, number, _) = parse_sensor(&bytes);
                tx.send_to(&reply(sent, number, sent + 42_000, [0; 16]), &back).unwrap();
            }
        });
        let driven = run(&into, &out, 5, Duration::from_millis(1)).unwrap();
        echo.join().unwrap();
        assert_eq!(driven.window.samples_us(), [42.0; 5]);
    }
}
