//! A SocketCAN interface. RT: sending and receiving yes, they never wait; opening before arming only.
//!
//! One socket, shared by its halves. It hears its own frames (RECV_OWN_MSGS), so that every frame that left is proved
//! by its echo; it hears error frames; the kernel stamps what comes and tells what it dropped. How the bus is follows
//! from the error frames and from the age of the oldest frame without echo.
//!
//! A thread of its own, not real-time, looks after a bus that is dead ([`keeper`]): only taking the link down and up
//! empties the kernel's queue of old commands. A USB adapter may keep frames through that; then only its power helps.
//!
//! Wants hardware or vcan: the laws run when `COMPASS_CAN` names an interface.
#![expect(unsafe_code, reason = "recvmsg with control messages has no safe wrapper that neither waits nor allocates")]

mod echoes;
mod keeper;
pub mod link_report;
pub mod master;

use super::link;
use super::{Duplex, Receive, SendError, Transmit};
use crate::base::time::{Span, Stamp};
use crate::msg::{BusFrame, BusHealth, CanFrame, MAX_DATA};
use echoes::Echoes;
use socketcan::{CanSocket, Socket, SocketOptions};
use std::io::{Error, ErrorKind};
use std::os::fd::{AsRawFd, RawFd};
use std::sync::Arc;
use std::sync::atomic::{AtomicU8, AtomicU32, Ordering};

/// Error frame classes (linux/can/error.h).
const ERROR_CONTROLLER: u32 = 0x004;
const ERROR_BUS_OFF: u32 = 0x040;
const ERROR_RESTARTED: u32 = 0x100;
/// Controller states in data byte 1 of such a frame: warning or passive, receive or transmit; active again.
const STATE_TROUBLED: u8 = 0x3C;
const STATE_ACTIVE: u8 = 0x40;

/// Whose end of the wire a socket is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// The controller's: hears its own echoes.
    Controller,
    /// The simulated robot's: does not.
    Robot,
}

/// What the halves and the keeper know together.
#[derive(Debug)]
struct Shared {
    socket: CanSocket,
    end: End,
    echo_timeout: Span,
    /// [`BusHealth`] by the error frames.
    state: AtomicU8,
    echoes: Echoes,
    lost: AtomicU32,
}

/// Sending half.
#[derive(Clone, Debug)]
pub struct CanTx {
    shared: Arc<Shared>,
}

/// Receiving half.
#[derive(Debug)]
pub struct CanRx {
    shared: Arc<Shared>,
    kernel_drops: u32,
    /// When nothing more was there: what comes later was received later.
    emptied: Stamp,
}

/// A SocketCAN interface; its sending half can be cloned.
pub type SocketCan = Duplex<CanTx, CanRx>;

impl SocketCan {
    /// Opens an interface. `echo_timeout`: no echo for so long while frames are out means stalled.
    ///
    /// # Errors
    /// No such interface, or no permission.
    pub fn open(name: &str, end: End, echo_timeout: Span) -> std::io::Result<Self> {
        let socket = CanSocket::open(name)?;
        socket.set_nonblocking(true)?;
        socket.set_recv_own_msgs(end == End::Controller)?;
        socket.set_error_filter_accept_all()?;
        socket.set_recv_timestamp(true)?;
        socket.set_socket_option_int(libc::SOL_SOCKET, libc::SO_RXQ_OVFL, 1)?;
        // Harmless on a classic interface: frames beyond its MTU are refused when they are sent.
        socket.set_socket_option_int(libc::SOL_CAN_RAW, libc::CAN_RAW_FD_FRAMES, 1)?;
        let shared = Arc::new(Shared {
            socket,
            end,
            echo_timeout,
            state: AtomicU8::new(BusHealth::Active as u8),
            echoes: Echoes::default(),
            lost: AtomicU32::new(0),
        });
        if end == End::Controller {
            keeper::start(name, &shared)?;
        }
        Ok(Self {
            tx: CanTx { shared: Arc::clone(&shared) },
            rx: CanRx { shared, kernel_drops: 0, emptied: link::monotonic_now() },
        })
    }
}

impl Shared {
    fn set_state(&self, state: BusHealth) {
        self.state.store(state as u8, Ordering::Relaxed);
    }

    fn health(&self) -> BusHealth {
        let state = BusHealth::from_u8(self.state.load(Ordering::Relaxed)).unwrap_or(BusHealth::Down);
        match state {
            BusHealth::Active | BusHealth::Passive if self.is_stalled() => BusHealth::Stalled,
            other => other,
        }
    }

    fn is_stalled(&self) -> bool {
        self.end == End::Controller && self.echoes.are_overdue(link::monotonic_now(), self.echo_timeout)
    }

    fn note_error_frame(&self, frame: &CanFrame) {
        let controller = if frame.id & ERROR_CONTROLLER != 0 { frame.data[1] } else { 0 };
        if frame.id & ERROR_BUS_OFF != 0 {
            self.set_state(BusHealth::Off);
        } else if frame.id & ERROR_RESTARTED != 0 || controller & STATE_ACTIVE != 0 {
            self.set_state(BusHealth::Active);
        } else if controller & STATE_TROUBLED != 0 {
            self.set_state(BusHealth::Passive);
        }
    }
}

impl Transmit for CanTx {
    fn send(&mut self, frame: &CanFrame) -> Result<(), SendError> {
        // Counted before, because the echo may be read before `write` returns.
        self.shared.echoes.note_sent(link::monotonic_now());
        let raw = RawFrame { id: frame.id, len: frame.len, flags: frame.flags, reserved: [0; 2], data: frame.data };
        let length = if frame.is_fd() { FD_BYTES } else { CLASSIC_BYTES };
        // SAFETY: 72 readable bytes with the layout of canfd_frame, whose first 16 are a can_frame; the descriptor is
        // open as long as `shared` lives.
        let written = unsafe { libc::write(self.shared.socket.as_raw_fd(), (&raw const raw).cast(), length) };
        if usize::try_from(written) == Ok(length) {
            return Ok(());
        }
        self.shared.echoes.take_back();
        match Error::last_os_error().raw_os_error() {
            Some(libc::ENOBUFS | libc::EAGAIN | libc::EINTR) => Err(SendError::Full),
            _ => {
                self.shared.set_state(BusHealth::Down);
                Err(SendError::Down)
            }
        }
    }
}

impl Receive for CanRx {
    fn receive(&mut self) -> Option<BusFrame> {
        let looked = link::monotonic_now();
        let received = receive_message(self.shared.socket.as_raw_fd());
        let Received { raw, fd, own, age, drops } = match received {
            Ok(received) => received,
            Err(error) => {
                self.emptied = looked;
                if !matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::Interrupted) {
                    self.shared.set_state(BusHealth::Down);
                }
                return None;
            }
        };
        if drops != self.kernel_drops {
            self.shared.lost.fetch_add(drops.wrapping_sub(self.kernel_drops), Ordering::Relaxed);
            self.kernel_drops = drops;
            self.shared.echoes.forget();
        } else if own {
            self.shared.echoes.note_echo(link::monotonic_now());
        }
        let stamp = stamped(link::monotonic_now(), age, self.emptied);
        let frame = raw.frame(fd);
        if frame.is_error() {
            self.shared.note_error_frame(&frame);
        }
        Some(BusFrame { stamp, own, frame })
    }

    fn health(&self) -> BusHealth {
        self.shared.health()
    }

    fn readable_fd(&self) -> RawFd {
        self.shared.socket.as_raw_fd()
    }

    fn lost(&self) -> u32 {
        self.shared.lost.load(Ordering::Relaxed)
    }
}

/// Bytes of `struct can_frame`.
const CLASSIC_BYTES: usize = 16;
/// Bytes of `struct canfd_frame`: an FD socket tells the kinds apart by the number read or written.
const FD_BYTES: usize = 72;

/// `struct canfd_frame`; its first 16 bytes are a `struct can_frame`.
#[derive(Clone, Copy, Debug)]
#[repr(C, align(8))]
struct RawFrame {
    id: u32,
    len: u8,
    flags: u8,
    reserved: [u8; 2],
    data: [u8; MAX_DATA],
}

const _: () = assert!(size_of::<RawFrame>() == FD_BYTES);

impl RawFrame {
    const EMPTY: Self = Self { id: 0, len: 0, flags: 0, reserved: [0; 2], data: [0; MAX_DATA] };

    /// In a classic frame the flags' place is padding.
    fn frame(&self, fd: bool) -> CanFrame {
        if fd {
            let len = self.len.min(64);
            CanFrame { id: self.id, len, flags: self.flags | CanFrame::FD, data: self.data }
        } else {
            CanFrame { id: self.id, len: self.len.min(8), flags: 0, data: self.data }
        }
    }
}

/// A frame with what the kernel says about it.
struct Received {
    raw: RawFrame,
    fd: bool,
    own: bool,
    /// How old it is by the kernel's stamp and wall time.
    age: Span,
    /// Frames that the kernel has dropped on this socket since it was opened.
    drops: u32,
}

/// Room for a time stamp and a drop counter.
#[repr(C, align(8))]
struct Control([u8; 128]);

fn receive_message(fd: RawFd) -> std::io::Result<Received> {
    let mut raw = RawFrame::EMPTY;
    let mut control = Control([0; 128]);
    let mut part = libc::iovec { iov_base: (&raw mut raw).cast(), iov_len: size_of::<RawFrame>() };
    // SAFETY: all-zero is a valid msghdr: null pointers with zero lengths.
    let mut message: libc::msghdr = unsafe { std::mem::zeroed() };
    message.msg_iov = &raw mut part;
    message.msg_iovlen = 1;
    message.msg_control = control.0.as_mut_ptr().cast();
    message.msg_controllen = control.0.len();
    // SAFETY: every pointer of the message is to a live local of the length given.
    let count = unsafe { libc::recvmsg(fd, &raw mut message, libc::MSG_DONTWAIT) };
    if count < 0 {
        return Err(Error::last_os_error());
    }
    let fd = match usize::try_from(count) {
        Ok(CLASSIC_BYTES) => false,
        Ok(FD_BYTES) => true,
        _ => return Err(ErrorKind::UnexpectedEof.into()),
    };
    let (wall_ns, drops) = read_control(&message);
    let age = wall_ns.map_or(0, |at| (link::clock_ns(libc::CLOCK_REALTIME) - at).max(0));
    let own = message.msg_flags & libc::MSG_CONFIRM != 0;
    Ok(Received { raw, fd, own, age: Span(age), drops: drops.unwrap_or(0) })
}

/// When a frame came. The kernel stamps with wall time: the difference of the clocks now is the difference then, unless
/// the wall clock was set in between. So a frame is never taken for older than the last time that nothing was there.
fn stamped(now: Stamp, age: Span, emptied: Stamp) -> Stamp {
    (now - age).max(emptied).min(now)
}

/// Wall time of reception, ns, and drop counter, if told.
fn read_control(message: &libc::msghdr) -> (Option<i64>, Option<u32>) {
    let (mut wall_ns, mut drops) = (None, None);
    // SAFETY: `message` was filled by recvmsg; the macros walk within msg_controllen, and each payload is read
    // unaligned with the type that its level and type say.
    unsafe {
        let mut header = libc::CMSG_FIRSTHDR(message);
        while !header.is_null() {
            match ((*header).cmsg_level, (*header).cmsg_type) {
                (libc::SOL_SOCKET, libc::SCM_TIMESTAMPNS) => {
                    let time: libc::timespec = std::ptr::read_unaligned(libc::CMSG_DATA(header).cast());
                    wall_ns = Some(time.tv_sec * 1_000_000_000 + time.tv_nsec);
                }
                (libc::SOL_SOCKET, libc::SO_RXQ_OVFL) => {
                    drops = Some(std::ptr::read_unaligned(libc::CMSG_DATA(header).cast()));
                }
                _ => {}
            }
            header = libc::CMSG_NXTHDR(message, header);
        }
    }
    (wall_ns, drops)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::laws;

    /// The interface to test with, or a word about what is missing.
    fn interface() -> Option<String> {
        let name = std::env::var("COMPASS_CAN").ok();
        if name.is_none() {
            eprintln!(
                "SKIPPED: COMPASS_CAN names no CAN interface (vcan, or a bus with a second node that acknowledges)"
            );
        }
        name
    }

    fn open(name: &str) -> SocketCan {
        SocketCan::open(name, End::Controller, Span::from_ms(20)).unwrap()
    }

    #[test]
    fn socketcan_keeps_the_laws_of_a_bus() {
        let Some(name) = interface() else { return };
        laws::bus_laws(|| (open(&name), open(&name)));
    }

    #[test]
    fn a_bus_off_frame_makes_the_bus_off_and_the_keeper_brings_it_back() {
        let Some(name) = interface() else { return };
        let (mut a, mut b) = (open(&name), open(&name));
        let error = CanFrame::classic(CanFrame::ERROR | ERROR_BUS_OFF, &[0; 8]);
        a.send(&error).unwrap();
        let start = link::monotonic_now();
        let within = |ms| link::monotonic_now().since(start) < Span::from_ms(ms);
        while within(500) && b.health() != BusHealth::Off {
            b.receive();
        }
        assert_eq!(b.health(), BusHealth::Off);
        while within(3000) && b.health() != BusHealth::Active {
            b.receive();
        }
        assert_eq!(b.health(), BusHealth::Active);
    }

    /// An adapter that is unplugged and plugged in again: the same name, another number.
    #[test]
    fn a_socket_hears_and_is_heard_on_an_interface_that_was_made_anew() {
        let Some(_) = interface() else { return };
        let name = "vcan7";
        let ip = |arguments: &str| {
            let status = std::process::Command::new("ip").args(arguments.split(' ')).status().unwrap();
            assert!(status.success(), "ip {arguments}");
        };
        let plug_in = || {
            ip(&format!("link add {name} type vcan"));
            ip(&format!("link set {name} up"));
        };
        plug_in();
        let mut a = open(name);
        ip(&format!("link delete {name}"));
        let becomes = |bus: &mut SocketCan, health: BusHealth| {
            let start = link::monotonic_now();
            while bus.health() != health && link::monotonic_now().since(start) < Span::from_ms(4000) {
                bus.receive();
            }
            assert_eq!(bus.health(), health);
        };
        becomes(&mut a, BusHealth::Down);
        plug_in();
        becomes(&mut a, BusHealth::Active);
        let mut b = open(name);
        for _ in 0..2 {
            let frame = CanFrame::new(0x7E1, &[1, 2, 3]);
            a.send(&frame).unwrap();
            for (bus, own) in [(&mut a, true), (&mut b, false)] {
                let start = link::monotonic_now();
                let mut heard = None;
                while heard.is_none() && link::monotonic_now().since(start) < Span::from_ms(500) {
                    heard = bus.receive();
                }
                assert_eq!(heard.map(|f| (f.frame, f.own)), Some((frame, own)));
            }
            std::mem::swap(&mut a, &mut b);
        }
        ip(&format!("link delete {name}"));
    }

    /// On an interface with an MTU of 72; on one of 16 it says why not, and nothing of it goes out.
    #[test]
    fn fd_frames_pass_both_ways_or_are_refused() {
        let Some(name) = interface() else { return };
        let (mut a, mut b) = (open(&name), open(&name));
        let frame = |k: u8| CanFrame::fd(0x7E0 + u32::from(k), &[k; 64][..[1, 8, 12, 48, 64][usize::from(k)]], 0x50);
        let heard = |bus: &mut SocketCan| {
            let start = link::monotonic_now();
            let mut got = Vec::new();
            while got.len() < 5 && link::monotonic_now().since(start) < Span::from_ms(500) {
                got.extend(bus.receive().filter(|f| f.frame.is_fd()));
            }
            got
        };
        if let Err(error) = link_report::must_carry_fd(&name) {
            assert!(error.to_string().contains("mtu 16"), "{error}");
            assert_eq!(a.send(&frame(4)), Err(SendError::Down));
            assert!(heard(&mut b).is_empty());
            return;
        }
        for _ in 0..2 {
            (0..5).for_each(|k| a.send(&frame(k)).unwrap());
            let expected: Vec<_> = (0..5).map(frame).collect();
            for (bus, own) in [(&mut a, true), (&mut b, false)] {
                let got = heard(bus);
                assert_eq!(got.iter().map(|f| f.frame).collect::<Vec<_>>(), expected);
                assert!(got.iter().all(|f| f.own == own));
            }
            std::mem::swap(&mut a, &mut b);
        }
    }

    #[test]
    fn a_step_of_the_wall_clock_ages_no_frame_beyond_the_last_empty_look() {
        let ms = |ms: i64| Stamp(ms * 1_000_000);
        assert_eq!(stamped(ms(1_000), Span::from_ms(2), ms(990)), ms(998), "an ordinary frame");
        assert_eq!(stamped(ms(1_000), Span::from_ms(3_600_000), ms(999)), ms(999), "an hour forward");
        assert_eq!(stamped(ms(1_000), Span::ZERO, ms(999)), ms(1_000), "backward: as young as it can be");
    }

    /// A socket of this machine with the option that the CAN socket has; a datagram is as long as a classic frame.
    #[test]
    fn what_the_kernel_drops_for_want_of_room_is_counted() {
        let receiver = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        let set = |option: libc::c_int, value: libc::c_int| {
            let length = libc::socklen_t::try_from(size_of_val(&value)).unwrap();
            // SAFETY: the descriptor is open, the value is a live local of the length given.
            let done = unsafe {
                libc::setsockopt(receiver.as_raw_fd(), libc::SOL_SOCKET, option, (&raw const value).cast(), length)
            };
            assert_eq!(done, 0);
        };
        set(libc::SO_RXQ_OVFL, 1);
        set(libc::SO_RCVBUF, 1);
        let sender = std::net::UdpSocket::bind("127.0.0.1:0").unwrap();
        sender.connect(receiver.local_addr().unwrap()).unwrap();
        let send = |count: u32| (0..count).for_each(|_| assert_eq!(sender.send(&[0; CLASSIC_BYTES]).unwrap(), 16));
        let received = || std::iter::from_fn(|| receive_message(receiver.as_raw_fd()).ok()).collect::<Vec<_>>();
        send(500);
        let before = received();
        assert!(before.iter().all(|frame| frame.drops == 0), "told with the first frame after the gap");
        send(1);
        let [after] = &received()[..] else { panic!("one frame") };
        assert_eq!(before.len() + after.drops as usize, 500);
        assert!(after.drops > 0 && !after.fd);
    }

    #[test]
    fn an_interface_that_is_not_there_is_an_error() {
        assert!(SocketCan::open("nosuchcan0", End::Controller, Span::from_ms(20)).is_err());
    }
}
