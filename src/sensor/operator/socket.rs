//! A hand at the other end of a UNIX datagram socket. RT: [`SocketHand::poll`] yes, it never waits; binding before arming
//! only.
//!
//! | datagram | what |
//! |---|---|
//! | `0` | the switch is open |
//! | `1` | it is held |
//! | `2`, then a double (little endian) | the hip stands at this angle now, inner minus outer, rad: its zero |
//! | `3`, `0` or `1`, then a double (little endian) | the switch, and how far the stick beside it is pushed, 0 to 1 |
//!
//! A robot without `robot.operator.speed` does not take a `3`: it would walk by its schedule under a hand that believes to stop
//! it by the stick. One with it takes `0` and `1` for a stick at rest.
//!
//! One sender holds the switch: the process that was heard first, as the kernel names it (datagrams have no address). A
//! second one is refused and told, or two would make one another's "fresh edge". Another may take over once the first
//! has been silent for [`HANDOVER`], which is a fault long before. A zero may come from any process that may write here.
//! A datagram counts from when it was sent, not from when we came to read it.
#![expect(unsafe_code, reason = "recvmsg with control messages has no safe wrapper that neither waits nor allocates")]

use crate::base::time::{Span, Stamp};
use crate::channel::socket_file;
use crate::msg::OperatorSample;
use std::f64::consts::PI;
use std::io;
use std::os::fd::{AsRawFd, RawFd};
use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::sync::Arc;
use std::sync::atomic::{AtomicI32, AtomicU32, Ordering};

/// Datagrams taken in one poll: more than the kernel queues for a socket (net.unix.max_dgram_qlen, 10 or 512).
const MAX_DATAGRAMS: usize = 512;
/// A sender that was silent for so long is gone, and another may come.
const HANDOVER: Span = Span::from_ms(1000);

/// Datagram: the switch is open.
pub const OPEN: u8 = 0;
/// Datagram: it is held.
pub const HELD: u8 = 1;
/// First byte of a zero.
pub const ZERO: u8 = 2;
/// First byte of a switch with a stick.
pub const STICK: u8 = 3;

/// A zero as bytes.
#[must_use]
pub fn zero_datagram(angle_rad: f64) -> [u8; 9] {
    let [a, b, c, d, e, f, g, h] = angle_rad.to_le_bytes();
    [ZERO, a, b, c, d, e, f, g, h]
}

/// A switch with a stick as bytes.
#[must_use]
pub fn stick_datagram(held: bool, share: f64) -> [u8; 10] {
    let [a, b, c, d, e, f, g, h] = share.to_le_bytes();
    [STICK, u8::from(held), a, b, c, d, e, f, g, h]
}

/// Senders that were refused because another one has the switch.
#[derive(Debug, Default)]
pub struct Refusals {
    count: AtomicU32,
    process: AtomicI32,
}

impl Refusals {
    /// Datagrams refused, and the process that sent the newest.
    #[must_use]
    pub fn newest(&self) -> (u32, i32) {
        (self.count.load(Ordering::Relaxed), self.process.load(Ordering::Relaxed))
    }
}

/// The process that has the switch.
#[derive(Clone, Copy, Debug)]
struct Owner {
    process: i32,
    heard: Stamp,
}

/// Listens on the socket.
#[derive(Debug)]
pub struct SocketHand {
    socket: UnixDatagram,
    owner: Option<Owner>,
    /// What a stick asks for at its end, m/s; none if no stick is wanted.
    highest_m_s: Option<f64>,
    handover: Span,
    newest: OperatorSample,
    /// When nothing waited here last.
    emptied: Stamp,
    refusals: Arc<Refusals>,
}

impl SocketHand {
    /// Makes the socket, for user and group; one that a dead process left behind is replaced, anything else is not.
    ///
    /// # Errors
    /// When the path cannot be bound, holds something else than a socket, or somebody listens there.
    pub fn bind(path: &Path, operator_age: Span, highest_m_s: Option<f64>) -> io::Result<Self> {
        socket_file::clear_the_way(path, |path| Ok(UnixDatagram::unbound()?.connect(path).is_ok()))?;
        let socket = UnixDatagram::bind(path)?;
        socket_file::open_to_the_group(path)?;
        socket.set_nonblocking(true)?;
        for option in [libc::SO_PASSCRED, libc::SO_TIMESTAMPNS] {
            switch_on(socket.as_raw_fd(), option)?;
        }
        Ok(Self {
            socket,
            owner: None,
            highest_m_s,
            handover: HANDOVER.max(operator_age),
            newest: OperatorSample { stamp: Stamp::NEVER, ..OperatorSample::default() },
            emptied: Stamp::NEVER,
            refusals: Arc::default(),
        })
    }

    /// Senders that were refused.
    #[must_use]
    pub fn refusals(&self) -> Arc<Refusals> {
        Arc::clone(&self.refusals)
    }

    /// How the hand is at `now`.
    pub fn poll(&mut self, now: Stamp) -> OperatorSample {
        for _ in 0..MAX_DATAGRAMS {
            let mut bytes = [0xFF; 16];
            let Some(datagram) = receive(self.socket.as_raw_fd(), &mut bytes) else {
                self.emptied = now;
                break;
            };
            let sent = sent_at(now, datagram.age, self.emptied);
            match bytes.get(..datagram.len) {
                Some([switch @ (OPEN | HELD)]) => self.hear(sent, datagram.process, *switch == HELD, 0.0),
                Some([ZERO, angle @ ..]) => self.take_zero(angle),
                Some([STICK, switch @ (OPEN | HELD), share @ ..]) => {
                    if let Some(speed_m_s) = self.speed_m_s(share) {
                        self.hear(sent, datagram.process, *switch == HELD, speed_m_s);
                    }
                }
                _ => {}
            }
        }
        self.newest
    }

    /// What a stick asks for; `None` if none is wanted, or none is pushed so far.
    fn speed_m_s(&self, share: &[u8]) -> Option<f64> {
        let share = f64::from_le_bytes(share.try_into().ok()?);
        self.highest_m_s.filter(|_| (0.0..=1.0).contains(&share)).map(|highest_m_s| share * highest_m_s)
    }

    fn hear(&mut self, sent: Stamp, process: i32, dead_man: bool, speed_m_s: f64) {
        // The kernel gives 0 for a process that it cannot name here (another PID namespace): it could be anybody.
        let taken = self.owner.is_some_and(|o| o.process != process && sent.since(o.heard) < self.handover);
        if taken || process <= 0 {
            self.refusals.process.store(process, Ordering::Relaxed);
            self.refusals.count.fetch_add(1, Ordering::Relaxed);
            return;
        }
        self.owner = Some(Owner { process, heard: sent });
        let sequence = self.newest.sequence.wrapping_add(1);
        self.newest = OperatorSample { stamp: sent, dead_man, sequence, speed_m_s, ..self.newest };
    }

    fn take_zero(&mut self, angle: &[u8]) {
        let Ok(bytes) = <[u8; 8]>::try_from(angle) else { return };
        let angle_rad = f64::from_le_bytes(bytes);
        if angle_rad.abs() <= PI {
            self.newest.zeroings = self.newest.zeroings.wrapping_add(1);
            self.newest.zero_angle_rad = angle_rad;
        }
    }
}

fn switch_on(fd: RawFd, option: libc::c_int) -> io::Result<()> {
    let on: libc::c_int = 1;
    let length = libc::socklen_t::try_from(size_of_val(&on)).unwrap_or(0);
    // SAFETY: four readable bytes of the length told.
    let result = unsafe { libc::setsockopt(fd, libc::SOL_SOCKET, option, (&raw const on).cast(), length) };
    if result == 0 { Ok(()) } else { Err(io::Error::last_os_error()) }
}

/// What the kernel says of a datagram.
#[derive(Clone, Copy, Debug)]
struct Datagram {
    len: usize,
    /// Sender; 0 if unknown.
    process: i32,
    /// How long ago it was sent, by the kernel's stamp and wall time.
    age: Span,
}

/// When it was sent. The kernel stamps with wall time, which may be set meanwhile: forward, and a datagram would be an hour old and
/// the hand gone (seen in the guest); so none is older than the last time that nothing waited. Backward: as young as it is to us.
fn sent_at(now: Stamp, age: Span, emptied: Stamp) -> Stamp {
    (now - age).max(emptied)
}

/// Room for credentials and a time stamp.
#[repr(C, align(8))]
struct Control([u8; 128]);

fn receive(fd: RawFd, bytes: &mut [u8; 16]) -> Option<Datagram> {
    let mut control = Control([0; 128]);
    let mut part = libc::iovec { iov_base: bytes.as_mut_ptr().cast(), iov_len: bytes.len() };
    // SAFETY: all-zero is a valid msghdr: null pointers with zero lengths.
    let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
    message.msg_iov = &raw mut part;
    message.msg_iovlen = 1;
    message.msg_control = control.0.as_mut_ptr().cast();
    message.msg_controllen = control.0.len();
    // SAFETY: every pointer of the message is to a live local of the length given.
    let count = unsafe { libc::recvmsg(fd, &raw mut message, libc::MSG_DONTWAIT | libc::MSG_CMSG_CLOEXEC) };
    let len = usize::try_from(count).ok()?;
    let (process, wall_ns) = read_control(&message);
    let age = wall_ns.map_or(0, |at| (wall_now_ns() - at).max(0));
    Some(Datagram { len, process, age: Span(age) })
}

fn read_control(message: &libc::msghdr) -> (i32, Option<i64>) {
    let (mut process, mut wall_ns) = (0, None);
    // SAFETY: `message` was filled by recvmsg; the macros walk within msg_controllen, and each payload is read
    // unaligned with the type that its level and type say.
    unsafe {
        let mut header = libc::CMSG_FIRSTHDR(message);
        while !header.is_null() {
            match ((*header).cmsg_level, (*header).cmsg_type) {
                (libc::SOL_SOCKET, libc::SCM_CREDENTIALS) => {
                    let sender: libc::ucred = std::ptr::read_unaligned(libc::CMSG_DATA(header).cast());
                    process = sender.pid;
                }
                (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                    let time: libc::timespec = std::ptr::read_unaligned(libc::CMSG_DATA(header).cast());
                    wall_ns = Some(time.tv_sec * 1_000_000_000 + time.tv_nsec);
                }
                _ => {}
            }
            header = libc::CMSG_NXTHDR(message, header);
        }
    }
    (process, wall_ns)
}

fn wall_now_ns() -> i64 {
    let mut time = libc::timespec { tv_sec: 0, tv_nsec: 0 };
    // SAFETY: `time` is a valid timespec for the call to fill; the clock exists on every Linux.
    unsafe { libc::clock_gettime(libc::CLOCK_REALTIME, &raw mut time) };
    time.tv_sec * 1_000_000_000 + time.tv_nsec
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;
    use std::io::{ErrorKind, Write};
    use std::os::unix::fs::PermissionsExt;
    use std::process::{Child, Command, Stdio};

    const AGE: Span = Span::from_ms(100);

    fn at(ms: i64) -> Stamp {
        Stamp(5_000_000_000) + Span::from_ms(ms)
    }

    fn bound() -> (tempfile::TempDir, std::path::PathBuf, SocketHand) {
        bound_for(None)
    }

    fn bound_for(highest_m_s: Option<f64>) -> (tempfile::TempDir, std::path::PathBuf, SocketHand) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("hand");
        let hand = SocketHand::bind(&path, AGE, highest_m_s).unwrap();
        (folder, path, hand)
    }

    fn send(path: &Path, bytes: &[u8]) {
        UnixDatagram::unbound().unwrap().send_to(bytes, path).unwrap();
    }

    /// Another process that sends each byte of its input as a datagram.
    fn other_process(path: &Path) -> Child {
        let program = "import socket,sys\ns=socket.socket(socket.AF_UNIX,socket.SOCK_DGRAM)\nwhile True:\n  b=sys.stdin.buffer.read(1)\n  if not b: break\n  s.sendto(b,sys.argv[1])\n  print(1,flush=True)\n";
        let path = path.to_str().unwrap();
        Command::new("python3")
            .args(["-c", program, path])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap()
    }

    fn tell(child: &mut Child, byte: u8) {
        use std::io::BufRead;
        child.stdin.as_mut().unwrap().write_all(&[byte]).unwrap();
        child.stdin.as_mut().unwrap().flush().unwrap();
        let mut line = String::new();
        std::io::BufReader::new(child.stdout.as_mut().unwrap()).read_line(&mut line).unwrap();
    }

    #[test]
    fn the_socket_hears_the_newest_byte_and_keeps_its_time() {
        let (_folder, path, mut hand) = bound();
        assert_eq!(hand.poll(at(0)).stamp, Stamp::NEVER);
        for bytes in [&[0][..], &[1], &[7], &[], &[1, 1], &[2, 0, 0], &[0; 40]] {
            send(&path, bytes);
        }
        let first = hand.poll(at(1_000));
        assert!(first.dead_man && first.sequence == 2 && first.zeroings == 0, "{first:?}");
        let age = at(1_000).since(first.stamp);
        assert!(age > Span::ZERO && age < Span::from_ms(1_000), "from when it was sent: {age:?}");
        assert_eq!(hand.poll(at(1_090)), first, "silence changes nothing but the age");
    }

    #[test]
    fn what_waited_while_we_stalled_is_as_old_as_it_is() {
        let (_folder, path, mut hand) = bound();
        send(&path, &[HELD]);
        std::thread::sleep(std::time::Duration::from_millis(150));
        let age = at(500).since(hand.poll(at(500)).stamp);
        assert!(age >= Span::from_ms(150), "{age:?}");
    }

    #[test]
    fn a_step_of_the_wall_clock_ages_no_datagram_beyond_the_last_empty_look() {
        assert_eq!(sent_at(at(1_000), Span::from_ms(20), at(900)), at(980), "an ordinary one");
        assert_eq!(sent_at(at(1_000), Span::from_ms(3_600_000), at(995)), at(995), "an hour forward");
        let (_folder, path, mut hand) = bound();
        hand.poll(at(0));
        send(&path, &[HELD]);
        std::thread::sleep(std::time::Duration::from_millis(50));
        assert_eq!(hand.poll(at(5)).stamp, at(0), "older by its stamp than it can be");
    }

    #[test]
    fn a_second_sender_is_refused_until_the_first_is_gone() {
        let (_folder, path, mut hand) = bound();
        let mut second = other_process(&path);
        send(&path, &[HELD]);
        assert!(hand.poll(at(1_000)).dead_man);
        // The second's release would make the first's key, held from the start, a fresh edge.
        tell(&mut second, OPEN);
        let sample = hand.poll(at(1_010));
        assert!(sample.dead_man && sample.sequence == 1, "{sample:?}");
        assert_eq!(hand.refusals().newest(), (1, i32::try_from(second.id()).unwrap()));
        tell(&mut second, OPEN);
        assert!(!hand.poll(at(3_000)).dead_man, "the first has been silent for longer than a second");
        send(&path, &[HELD]);
        assert!(!hand.poll(at(3_010)).dead_man, "now it is the first that is refused");
        drop(second.stdin.take());
        second.wait().unwrap();
    }

    #[test]
    fn a_zero_comes_from_anybody_and_must_be_an_angle() {
        let (_folder, path, mut hand) = bound();
        send(&path, &zero_datagram(0.25));
        let sample = hand.poll(at(0));
        assert_eq!((sample.zeroings, sample.zero_angle_rad.to_bits()), (1, 0.25f64.to_bits()));
        for wrong in [f64::NAN, f64::INFINITY, 4.0] {
            send(&path, &zero_datagram(wrong));
        }
        assert_eq!(hand.poll(at(1)).zeroings, 1);
        assert_eq!(hand.poll(at(1)).stamp, Stamp::NEVER, "it is no heartbeat");
    }

    #[test]
    fn a_stick_asks_for_its_share_of_the_highest_speed_and_nothing_that_no_stick_says_is_taken() {
        let (_folder, path, mut hand) = bound_for(Some(0.5));
        send(&path, &stick_datagram(true, 0.5));
        let sample = hand.poll(at(0));
        assert!(sample.dead_man && (sample.speed_m_s - 0.25).abs() < 1e-12, "{sample:?}");
        let cut = &stick_datagram(true, 1.0)[..9];
        let other = [STICK, 2, 0, 0, 0, 0, 0, 0, 0, 0];
        for wrong in [f64::NAN, f64::INFINITY, -0.1, 1.1].map(|share| stick_datagram(true, share)).iter() {
            send(&path, wrong);
        }
        send(&path, cut);
        send(&path, &other);
        assert_eq!(hand.poll(at(1)).sequence, 1);
        send(&path, &[HELD]);
        assert!(hand.poll(at(2)).dead_man && hand.poll(at(2)).speed_m_s <= 0.0, "a hand without a stick");
    }

    #[test]
    fn a_robot_that_wants_no_stick_does_not_take_a_hand_that_has_one() {
        let (_folder, path, mut hand) = bound();
        send(&path, &stick_datagram(true, 0.0));
        assert_eq!(hand.poll(at(0)).stamp, Stamp::NEVER);
    }

    #[test]
    fn the_group_may_write_and_nothing_but_a_dead_socket_is_removed() {
        let (folder, path, hand) = bound();
        assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, 0o660);
        assert_eq!(SocketHand::bind(&path, AGE, None).unwrap_err().kind(), ErrorKind::AddrInUse, "somebody listens");
        drop(hand);
        assert!(SocketHand::bind(&path, AGE, None).is_ok(), "left behind by a dead process");
        let file = folder.path().join("precious");
        fs::write(&file, "mine").unwrap();
        assert_eq!(SocketHand::bind(&file, AGE, None).unwrap_err().kind(), ErrorKind::AlreadyExists);
        assert_eq!(fs::read_to_string(&file).unwrap(), "mine");
    }
}
