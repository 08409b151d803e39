//! Motion capture beside a run: a thread that puts poses into the recording. RT: no; no tick knows of it.

use crate::config::checked::{Mocap, MocapSource};
use crate::msg::MocapSample;
use crate::rt::clock;
use crate::sensor::mocap::{MocapCounters, MocapNews, MocapReader};
use crate::sensor::natnet;
use anyhow::Context;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// The thread looks at least so often whether it is still needed.
const TURN: Duration = Duration::from_millis(100);
/// Between two words to the server.
const SPEAK_EVERY: Duration = Duration::from_secs(1);
/// The largest datagram of UDP.
const LONGEST: usize = 1 << 16;

/// A running thread; it ends with this.
pub(super) struct Capture {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<MocapCounters>>,
}

impl Capture {
    /// Opens the port; `each` gets every pose, `tell` what a person should know.
    pub(super) fn start(
        config: &Mocap,
        each: impl FnMut(&MocapSample) + Send + 'static,
        tell: impl FnMut(String) + Send + 'static,
    ) -> anyhow::Result<Self> {
        let socket = open(config).with_context(|| format!("robot.mocap.listen = {}", config.listen))?;
        let (over, config) = (Arc::<AtomicBool>::default(), config.clone());
        let flag = Arc::clone(&over);
        let thread =
            Builder::new().name("mocap".into()).spawn(move || listen(&socket, &config, &flag, (each, tell)))?;
        Ok(Self { over, thread: Some(thread) })
    }

    /// Ends it; what was missing, in words.
    pub(super) fn finish(mut self) -> Option<String> {
        self.over.store(true, Ordering::Release);
        let counters = self.thread.take()?.join().ok()?;
        let MocapCounters { damaged, missing, overtaken, without_body, clock_jumps } = counters;
        (counters != MocapCounters::default()).then(|| {
            format!(
                "motion capture: {missing} frames missing, {overtaken} overtaken, {without_body} without the robot's \
                 body, {damaged} damaged, the server's clock set {clock_jumps} times"
            )
        })
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
    }
}

fn open(config: &Mocap) -> io::Result<UdpSocket> {
    let SocketAddr::V4(here) = config.listen else { return UdpSocket::bind(config.listen) };
    let is_natnet = matches!(config.source, MocapSource::NatNet { .. });
    let group = Ipv4Addr::from(natnet::DATA_GROUP);
    // Datagrams to a group reach only sockets of that group or of any address.
    let socket = UdpSocket::bind((if is_natnet { Ipv4Addr::UNSPECIFIED } else { *here.ip() }, here.port()))?;
    if is_natnet {
        // A server that sends to single clients needs no group.
        drop(socket.join_multicast_v4(&group, here.ip()));
    }
    socket.set_read_timeout(Some(TURN))?;
    Ok(socket)
}

fn listen(
    socket: &UdpSocket,
    config: &Mocap,
    over: &AtomicBool,
    (mut each, mut tell): (impl FnMut(&MocapSample), impl FnMut(String)),
) -> MocapCounters {
    let mut reader = MocapReader::new(config);
    let mut bytes = vec![0; LONGEST];
    let mut next_word = Instant::now();
    while !over.load(Ordering::Acquire) {
        let due = reader.takes_question() || Instant::now() >= next_word;
        if let (MocapSource::NatNet { server, .. }, Some(request)) = (&config.source, reader.request())
            && due
        {
            // A server that is not there yet is asked again.
            drop(socket.send_to(request, server));
            next_word = Instant::now() + SPEAK_EVERY;
        }
        let received = socket.recv_from(&mut bytes);
        if let Ok((count, from)) = received
            && is_theirs(config, from.ip())
            && let Some(sample) = reader.take(clock::now(), &bytes[..count])
        {
            each(&sample);
        }
        match reader.news(clock::now()) {
            Some(MocapNews::Trouble(trouble)) => tell(format!("motion capture: {}", trouble.in_words())),
            Some(MocapNews::Sound) => tell("motion capture: poses are sound again".to_owned()),
            None => {}
        }
    }
    *reader.counters()
}

/// Only the server that was named gives ground truth. Vicon's sender is not named.
fn is_theirs(config: &Mocap, from: IpAddr) -> bool {
    match &config.source {
        MocapSource::NatNet { server, .. } => server.ip() == from,
        MocapSource::Vicon { .. } => true,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc;

    #[test]
    fn poses_of_the_named_body_come_over_the_network() {
        // A port that is free now.
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let listen = SocketAddr::from(([127, 0, 0, 1], port));
        let config = Mocap { listen, source: MocapSource::Vicon { body: "robot".into() } };
        let (out, samples) = mpsc::channel();
        let capture = Capture::start(&config, move |sample| out.send(*sample).unwrap(), |_| {}).unwrap();
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        let mut block = vec![9, 0, 0, 0, 1, 0, 72, 0];
        block.extend(crate::base::bytes::padded::<24>(b"robot"));
        [1500.0_f64, 0.0, 0.0, 0.0, 0.0, 0.0].iter().for_each(|x| block.extend(x.to_le_bytes()));
        sender.send_to(&block, listen).unwrap();
        let sample = samples.recv_timeout(Duration::from_secs(20)).unwrap();
        assert_eq!((sample.frame, sample.tracked, sample.position_m[0]), (9, true, 1.5));
        sender.send_to(&[1, 2], listen).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        assert!(capture.finish().is_some_and(|words| words.contains("1 damaged")));
    }
}
