//! Motion capture beside a run: a thread that puts poses into the recording. RT: no; no tick knows of it.

use crate::base::time::{Span, Stamp};
use crate::config::checked::{Mocap, MocapSource};
use crate::msg::MocapSample;
use crate::rt::{clock, poll};
use crate::sensor::mocap::{MocapCounters, MocapNews, MocapReader};
use crate::sensor::natnet;
use anyhow::Context;
use std::io;
use std::net::{IpAddr, Ipv4Addr, SocketAddr, UdpSocket};
use std::os::fd::AsRawFd;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// The thread looks at least so often whether it is still needed.
const TURN: Span = Span::from_ms(100);
/// Between two words to the server.
const SPEAK_EVERY: Duration = Duration::from_secs(1);
/// After so long another may be the sender.
const SILENT: Span = Span::from_ms(1000);
/// The largest datagram of UDP.
const LONGEST: usize = 1 << 16;

/// A running thread; it ends with this.
pub(super) struct Capture {
    over: Arc<AtomicBool>,
    thread: Option<JoinHandle<(MocapCounters, u32)>>,
}

impl Capture {
    /// Opens the port; `each` gets every pose, `tell` what a person should know.
    pub(super) fn start(
        config: &Mocap,
        each: impl FnMut(&MocapSample) + Send + 'static,
        tell: impl FnMut(String) + Send + 'static,
    ) -> anyhow::Result<Self> {
        let sockets = Sockets::open(config).with_context(|| format!("robot.mocap.listen = {}", config.listen))?;
        let (over, config) = (Arc::<AtomicBool>::default(), config.clone());
        let flag = Arc::clone(&over);
        let thread =
            Builder::new().name("mocap".into()).spawn(move || listen(&sockets, &config, &flag, (each, tell)))?;
        Ok(Self { over, thread: Some(thread) })
    }

    /// Ends it; what was missing, in words.
    pub(super) fn finish(mut self) -> Option<String> {
        self.over.store(true, Ordering::Release);
        let (counters, foreign) = self.thread.take()?.join().ok()?;
        let MocapCounters { damaged, missing, overtaken, without_body, clock_jumps } = counters;
        (counters != MocapCounters::default() || foreign > 0).then(|| {
            format!(
                "motion capture: {missing} frames missing, {overtaken} overtaken, {without_body} without the robot's \
                 body, {damaged} damaged, the server's clock set {clock_jumps} times, {foreign} datagrams of others"
            )
        })
    }
}

impl Drop for Capture {
    fn drop(&mut self) {
        self.over.store(true, Ordering::Release);
    }
}

/// Our end: where we listen, and for NatNet its group on the same interface. No other interface is listened to.
struct Sockets {
    own: UdpSocket,
    group: Option<UdpSocket>,
}

impl Sockets {
    fn open(config: &Mocap) -> io::Result<Self> {
        let own = UdpSocket::bind(config.listen)?;
        own.set_nonblocking(true)?;
        let is_natnet = matches!(config.source, MocapSource::NatNet { .. });
        let group = match config.listen {
            // A server that sends to single clients needs no group; nor does one on this machine.
            SocketAddr::V4(here) if is_natnet && !here.ip().is_loopback() => join(*here.ip(), here.port()).ok(),
            _ => None,
        };
        Ok(Self { own, group })
    }

    /// Waits for a datagram, not for long.
    fn wait(&self) {
        let fd = |socket: Option<&UdpSocket>| socket.map_or(-1, AsRawFd::as_raw_fd);
        poll::readable([fd(Some(&self.own)), fd(self.group.as_ref())], clock::now() + TURN);
    }

    /// The next datagram that has come.
    fn receive(&self, bytes: &mut [u8]) -> Option<(usize, IpAddr)> {
        let mut sockets = std::iter::once(&self.own).chain(&self.group);
        sockets.find_map(|socket| socket.recv_from(bytes).ok()).map(|(count, from)| (count, from.ip()))
    }
}

/// Bound to the group, a socket gets nothing else.
fn join(here: Ipv4Addr, port: u16) -> io::Result<UdpSocket> {
    let group = Ipv4Addr::from(natnet::DATA_GROUP);
    let socket = UdpSocket::bind((group, port))?;
    socket.join_multicast_v4(&group, &here)?;
    socket.set_nonblocking(true)?;
    Ok(socket)
}

fn listen(
    sockets: &Sockets,
    config: &Mocap,
    over: &AtomicBool,
    (mut each, mut tell): (impl FnMut(&MocapSample), impl FnMut(String)),
) -> (MocapCounters, u32) {
    let mut reader = MocapReader::new(config);
    let mut sender = Sender::new(config);
    let mut bytes = vec![0; LONGEST];
    let mut next_word = Instant::now();
    while !over.load(Ordering::Acquire) {
        let due = reader.takes_question() || Instant::now() >= next_word;
        if let (MocapSource::NatNet { server, .. }, Some(request)) = (&config.source, reader.request())
            && due
        {
            // A server that is not there yet is asked again.
            drop(sockets.own.send_to(request, server));
            next_word = Instant::now() + SPEAK_EVERY;
        }
        sockets.wait();
        while let Some((count, from)) = sockets.receive(&mut bytes) {
            if sender.is(clock::now(), from)
                && let Some(sample) = reader.take(clock::now(), &bytes[..count])
            {
                each(&sample);
            }
        }
        match reader.news(clock::now()) {
            Some(MocapNews::Trouble(trouble)) => tell(format!("motion capture: {}", trouble.in_words())),
            Some(MocapNews::Sound) => tell("motion capture: poses are sound again".to_owned()),
            None => {}
        }
        if sender.foreign > 0 && !std::mem::replace(&mut sender.told, true) {
            tell("motion capture: somebody else sends to our port too; that is counted and not taken".to_owned());
        }
    }
    (*reader.counters(), sender.foreign)
}

/// Whose datagrams are taken. Vicon's sender is not named: the one heard first, until it has been silent for a second.
struct Sender {
    named: Option<IpAddr>,
    heard: Option<(IpAddr, Stamp)>,
    foreign: u32,
    told: bool,
}

impl Sender {
    fn new(config: &Mocap) -> Self {
        let named = match &config.source {
            MocapSource::NatNet { server, .. } => Some(server.ip()),
            MocapSource::Vicon { .. } => None,
        };
        Self { named, heard: None, foreign: 0, told: false }
    }

    /// Only one sender gives ground truth; others are counted.
    fn is(&mut self, now: Stamp, from: IpAddr) -> bool {
        let heard = self.heard.filter(|(_, at)| now.since(*at) <= SILENT).map(|(who, _)| who);
        let taken = self.named.or(heard).is_none_or(|who| who == from);
        if taken {
            self.heard = Some((from, now));
        } else {
            self.foreign = self.foreign.saturating_add(1);
        }
        taken
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
        // Another address of this machine.
        let stranger = UdpSocket::bind("127.0.0.2:0").unwrap();
        block[0] = 10;
        stranger.send_to(&block, listen).unwrap();
        std::thread::sleep(Duration::from_millis(300));
        assert!(samples.try_recv().is_err(), "a stranger gives no ground truth");
        let words = capture.finish().unwrap();
        assert!(words.contains("1 damaged") && words.contains("1 datagrams of others"), "{words}");
    }

    #[test]
    fn the_named_server_is_taken_and_of_unnamed_ones_the_first_until_it_is_silent() {
        let [a, b] = [1, 2].map(|n| IpAddr::from([10, 0, 0, n]));
        let at = |ms: i64| Stamp(1_000_000_000) + Span::from_ms(ms);
        let listen = SocketAddr::from(([127, 0, 0, 1], 1));
        let server = SocketAddr::from((a, 1510));
        let mut named = Sender::new(&Mocap { listen, source: MocapSource::NatNet { server, body: 1 } });
        assert_eq!([(0, b), (1, a), (5000, b)].map(|(ms, who)| named.is(at(ms), who)), [false, true, false]);
        let mut first = Sender::new(&Mocap { listen, source: MocapSource::Vicon { body: "robot".into() } });
        let heard = [(0, a), (1, b), (900, a), (1800, b), (1901, b), (1902, a)].map(|(ms, who)| first.is(at(ms), who));
        assert_eq!((heard, first.foreign), ([true, false, true, false, true, false], 3));
    }

    #[test]
    fn only_the_named_interface_is_listened_to() {
        let port = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
        let server = SocketAddr::from(([127, 0, 0, 1], 1510));
        let config = Mocap { listen: ([127, 0, 0, 1], port).into(), source: MocapSource::NatNet { server, body: 1 } };
        let sockets = Sockets::open(&config).unwrap();
        assert_eq!(sockets.own.local_addr().unwrap(), config.listen);
        let sender = UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.send_to(&[1], ("127.0.0.2", port)).unwrap();
        sender.send_to(&[2], ("127.0.0.1", port)).unwrap();
        sockets.wait();
        let mut bytes = [0; 8];
        assert!(sockets.receive(&mut bytes).is_some() && bytes[0] == 2, "not what came to another address");
    }
}
