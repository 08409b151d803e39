//! What every bus does, written once. Frames carry a run number, so that other traffic on a real wire is ignored.

use super::Bus;
use super::link;
use crate::base::time::Span;
use crate::msg::{BusFrame, CanFrame};

/// Identifiers that the suite uses: no CANopen device takes part in them.
const ID: u32 = 0x7E0;

/// Runs all laws on pairs of ends of one wire.
pub(crate) fn bus_laws<A: Bus, B: Bus>(pair: impl Fn() -> (A, B)) {
    empty_bus_gives_nothing_and_does_not_wait(pair());
    frames_arrive_unchanged_and_in_order(pair());
    sender_hears_each_own_frame_once(pair());
    descriptor_polls_readable_exactly_while_a_frame_waits(pair());
    stamps_do_not_go_back(pair());
}

/// What comes within half a second, until `count` frames of the suite are there.
fn collect(bus: &mut impl Bus, count: usize) -> Vec<BusFrame> {
    let mut got = Vec::new();
    let start = link::monotonic_now();
    while got.len() < count && link::monotonic_now().since(start) < Span::from_ms(500) {
        got.extend(bus.receive().filter(|f| f.frame.id == ID));
    }
    got
}

fn numbered(k: u8) -> CanFrame {
    CanFrame::new(u16::try_from(ID).unwrap(), &[k, 0xA5, 0xFF, 0, k][..usize::from(k % 5) + 1])
}

fn empty_bus_gives_nothing_and_does_not_wait((mut a, _b): (impl Bus, impl Bus)) {
    assert!(collect(&mut a, 1).is_empty());
}

fn frames_arrive_unchanged_and_in_order((mut a, mut b): (impl Bus, impl Bus)) {
    for k in 0..8 {
        a.send(&numbered(k)).unwrap();
    }
    let got = collect(&mut b, 8);
    assert_eq!(got.iter().map(|f| f.frame).collect::<Vec<_>>(), (0..8).map(numbered).collect::<Vec<_>>());
}

fn sender_hears_each_own_frame_once((mut a, mut b): (impl Bus, impl Bus)) {
    for k in 0..8 {
        a.send(&numbered(k)).unwrap();
    }
    assert_eq!(collect(&mut a, 9).len(), 8);
    assert_eq!(collect(&mut b, 9).len(), 8);
}

fn descriptor_polls_readable_exactly_while_a_frame_waits((mut a, mut b): (impl Bus, impl Bus)) {
    while b.receive().is_some() {}
    a.send(&numbered(1)).unwrap();
    assert!(polls_readable(b.readable_fd(), 500));
    assert_eq!(collect(&mut b, 1).len(), 1);
    while b.receive().is_some() {}
    assert!(!polls_readable(b.readable_fd(), 0));
}

fn stamps_do_not_go_back((mut a, mut b): (impl Bus, impl Bus)) {
    let before = link::monotonic_now();
    for k in 0..8 {
        a.send(&numbered(k)).unwrap();
    }
    let stamps: Vec<_> = collect(&mut b, 8).iter().map(|f| f.stamp).collect();
    assert!(stamps.is_sorted());
    // A kernel's stamp is mapped from another clock: allow for 1 ms of error.
    assert!(before.since(stamps[0]) < Span::from_ms(1));
    assert!(*stamps.last().unwrap() <= link::monotonic_now() + Span::from_ms(1));
}

#[expect(unsafe_code, reason = "poll has no safe wrapper here")]
fn polls_readable(fd: std::os::fd::RawFd, timeout_ms: i32) -> bool {
    let mut poll = libc::pollfd { fd, events: libc::POLLIN, revents: 0 };
    // SAFETY: one valid pollfd.
    unsafe { libc::poll(&raw mut poll, 1, timeout_ms) > 0 && poll.revents & libc::POLLIN != 0 }
}
