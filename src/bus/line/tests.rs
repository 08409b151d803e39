//! Laws of the master that need no drive on the wire; those with drives are in `sim`, which has them.

use super::*;
use crate::bus::canopen::{Object, PdoData};
use crate::bus::frame::worst_bits;
use crate::bus::sdo::{Address, SdoReply, SdoRequest};
use crate::config;
use crate::msg::DriveState;

fn line(bus: usize) -> Line {
    let config = config::load(None, &[]).unwrap().config;
    Line::new(&config.robot, bus, &config.real_time).unwrap()
}

fn at_ms(ms: i64) -> Stamp {
    Stamp(ms * 1_000_000)
}

/// One cycle in which all frames of the last one are echoed, and `more` comes after them.
fn cycle(line: &mut Line, now: Stamp, sent: &FrameBatch, more: &[CanFrame]) -> (FrameBatch, DriveFeedbacks) {
    let mut received = *sent;
    for frame in more {
        received.push(BusFrame::theirs(now, *frame));
    }
    let mut feedbacks = DriveFeedbacks::default();
    line.receive(now, now, &received, BusHealth::Active, &mut feedbacks);
    let mut out = FrameBatch::default();
    line.transmit(now, &DriveCommands::default(), &mut out);
    (out, feedbacks)
}

fn ids(batch: &FrameBatch) -> Vec<u32> {
    batch.iter().map(|f| f.frame.id).collect()
}

#[test]
fn worst_case_of_every_cycle_fits_one_millisecond() {
    let config = config::load(None, &[]).unwrap().config;
    for bus in 0..2 {
        let plan = budget::Plan::new(&config.robot, bus).unwrap();
        let phases = plan.worst_case_us(&config.robot, bus);
        println!("bus {bus}: {phases:?} us");
        assert!(phases.iter().all(|us| *us <= 1000.0), "bus {bus}: {phases:?}");
    }
}

#[test]
fn budget_is_the_sum_of_the_frame_table() {
    let config = config::load(None, &[]).unwrap().config;
    let plan = budget::Plan::new(&config.robot, 0).unwrap();
    // SYNC, hip command and answer, three heartbeats, emergency; then per phase: two toe answers; a set-up exchange; two
    // toe commands; a set-up exchange and our heartbeat.
    let each = 55 + 95 + 135 + 3 * 65 + 135;
    let expected = [each + 2 * 135, each + 270, each + 2 * 115, each + 270 + 65];
    assert_eq!(worst_bits(6, false), 115);
    assert_eq!(plan.worst_case_us(&config.robot, 0), expected.map(f64::from));
}

#[test]
fn toes_at_every_sync_would_not_fit() {
    let mut robot = config::load(None, &[]).unwrap().config.robot;
    for drive in &mut robot.drives {
        drive.sync_divisor = 1;
    }
    let plan = budget::Plan::new(&robot, 0).unwrap();
    assert!(plan.worst_case_us(&robot, 0)[0] > 1000.0);
}

#[test]
fn two_drives_with_one_node_are_refused() {
    let mut config = config::load(None, &[]).unwrap().config;
    config.robot.drives[1].node = config.robot.drives[0].node;
    let node = config.robot.drives[0].node;
    let error = Line::new(&config.robot, 0, &config.real_time).map(|_| ()).unwrap_err();
    assert_eq!(error, LineError::Twice { bus: 0, node });
}

#[test]
fn set_up_begins_with_a_reset_of_each_drive_and_takes_one_frame_per_cycle() {
    let mut line = line(0);
    let mut out = FrameBatch::default();
    let mut resets = 0;
    for k in 0..8 {
        (out, _) = cycle(&mut line, at_ms(k), &out, &[]);
        let nmt = out.iter().filter(|f| f.frame.id == 0).count();
        assert!(nmt <= 1);
        assert_eq!(ids(&out).last(), Some(&0x080), "SYNC closes the cycle");
        resets += nmt;
    }
    assert_eq!(resets, 3);
}

#[test]
fn first_question_after_boot_up_is_the_device_type_and_a_stranger_is_refused() {
    let mut line = line(1);
    let Some(Member::Canopen(DriveLine { node, index, .. })) = line.drives.iter().flatten().next() else { panic!() };
    let (node, index) = (*node, *index);
    let mut out = FrameBatch::default();
    for k in 0..8 {
        (out, _) = cycle(&mut line, at_ms(k), &out, &[]);
    }
    let boot = Message::Heartbeat(node, NmtState::BootUp).emit();
    let mut question = None;
    (out, _) = cycle(&mut line, at_ms(8), &out, &[boot]);
    for k in 9..14 {
        question = question.or(out.iter().map(|f| f.frame).find(|f| f.id == u32::from(Object::SdoRequest(node).id())));
        (out, _) = cycle(&mut line, at_ms(k), &out, &[]);
    }
    let ask = SdoRequest::Read(Address::new(0x1000, 0));
    assert_eq!(question, Some(Message::SdoRequest(node, ask).emit()));
    let stranger = SdoReply::Value(Address::new(0x1000, 0), crate::bus::sdo::SdoValue::u32(401));
    let (_, feedbacks) = cycle(&mut line, at_ms(14), &out, &[Message::SdoReply(node, stranger).emit()]);
    assert_eq!(feedbacks.drives[index].state, DriveState::Lost);
    assert_eq!(feedbacks.drives[index].error_code, SetupFault::WrongDevice as u16);
}

#[test]
fn without_echo_the_bus_stalls_and_only_the_probe_is_sent_until_it_is_echoed() {
    let mut line = line(0);
    let mut feedbacks = DriveFeedbacks::default();
    let mut sent = Vec::new();
    for k in 0..60 {
        line.receive(at_ms(k), at_ms(k), &FrameBatch::default(), BusHealth::Active, &mut feedbacks);
        let mut out = FrameBatch::default();
        line.transmit(at_ms(k), &DriveCommands::default(), &mut out);
        sent.push(ids(&out));
    }
    assert_eq!(feedbacks.health[0], BusHealth::Stalled);
    let syncs = sent.iter().enumerate().filter(|(_, ids)| ids.contains(&0x080)).map(|(k, _)| k).collect::<Vec<_>>();
    assert_eq!(syncs, [0, 2], "one SYNC, and one more as if its echo was lost");
    assert_eq!(sent[19], [0x000], "the probe, alone, within 20 ms of the last frame and a period for the next one");
    assert!(sent[20..].iter().all(Vec::is_empty));
    let mut echo = FrameBatch::default();
    let frame = Message::Nmt(NmtCommand::ResetNode, None).emit();
    echo.push(BusFrame::ours(at_ms(60), frame));
    let (out, feedbacks) = cycle(&mut line, at_ms(60), &echo, &[]);
    assert_eq!(feedbacks.health[0], BusHealth::Active);
    assert!(ids(&out).contains(&0x080));
    assert_eq!(line.counters().stalls, 1);
}

#[test]
fn a_lost_echo_of_sync_delays_the_round_by_a_cycle() {
    // No drive has booted: nothing answers.
    let mut line = line(1);
    let mut out = FrameBatch::default();
    let mut syncs = Vec::new();
    for k in 0..12 {
        if k == 5 {
            out.clear();
        }
        (out, _) = cycle(&mut line, at_ms(k), &out, &[]);
        syncs.push(ids(&out).contains(&0x080));
    }
    assert_eq!(syncs.iter().filter(|sync| !**sync).count(), 1, "{syncs:?}");
    assert!(!syncs[5] && line.counters().stalls == 0, "{syncs:?}");
}

#[test]
fn a_bus_that_is_off_is_left_alone_until_it_is_back() {
    let mut line = line(0);
    let mut feedbacks = DriveFeedbacks::default();
    for k in 0..300 {
        line.receive(at_ms(k), at_ms(k), &FrameBatch::default(), BusHealth::Off, &mut feedbacks);
        let mut out = FrameBatch::default();
        line.transmit(at_ms(k), &DriveCommands::default(), &mut out);
        assert_eq!(out.count, 0);
    }
    assert_eq!(feedbacks.health[0], BusHealth::Off);
    assert_eq!(line.counters().stalls, 1);
}

#[test]
fn stop_frames_disable_every_node_and_end_with_sync() {
    let mut out = FrameBatch::default();
    line(0).stop_frames(&mut out);
    assert_eq!(out.count, 4);
    for frame in out.iter().take(3) {
        let Ok(Message::Rpdo(1, _, PdoData { data, .. })) = Message::parse(&frame.frame) else {
            panic!("{frame:?} is no command");
        };
        assert_eq!(data, [0; 8]);
    }
    assert_eq!(out.iter().nth(3).unwrap().frame, SYNC_FRAME);
}

#[test]
fn whatever_only_a_master_says_and_we_did_not_is_told_and_never_taken_for_our_echo() {
    let node = Node::new(1).unwrap();
    let foreign = [
        SYNC_FRAME,
        Message::Rpdo(1, node, PdoData { len: 4, data: [0x0F, 0, 0xFF, 0x7F, 0, 0, 0, 0] }).emit(),
        Message::Nmt(NmtCommand::Start, None).emit(),
        Message::Heartbeat(Node::MASTER, NmtState::Operational).emit(),
    ];
    for frame in foreign {
        let mut line = line(0);
        let (out, _) = cycle(&mut line, at_ms(0), &FrameBatch::default(), &[]);
        let in_flight = line.sync_in_flight;
        // Nothing of ours is echoed; only the stranger speaks.
        let (_, feedbacks) = cycle(&mut line, at_ms(1), &FrameBatch::default(), &[frame]);
        assert_eq!(feedbacks.health[0], BusHealth::Contested, "{frame:?}");
        assert_eq!((line.counters().masters, line.sync_in_flight), (1, in_flight), "{frame:?}");
        let (out, _) = cycle(&mut line, at_ms(2), &out, &[]);
        let (_, feedbacks) = cycle(&mut line, at_ms(1_100), &out, &[]);
        assert_eq!(feedbacks.health[0], BusHealth::Active, "it has been silent for a second");
    }
}
