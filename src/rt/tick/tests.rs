use super::*;
use crate::base::time::{Span, Stamp};
use crate::config;
use crate::msg::{BusFrame, CanFrame, DriveGoal, DriveState, ImuSample, OperatorSample};
use crate::rt::{allocation, memory};

/// The walk of the default robot with nobody on the buses.
fn tick() -> Tick {
    Tick::new(&config::load(None, &[]).unwrap().config).unwrap()
}

fn input(index: u64) -> TickInput {
    let now = Stamp(1_000_000_000) + Span::from_ms(i64::try_from(index).unwrap());
    let mut input = TickInput { index, now, heard_until: [now; BUSES], imu_heard_until: now, ..TickInput::default() };
    input.operator =
        OperatorSample { stamp: now, dead_man: index % 100 > 50, sequence: 1, ..OperatorSample::default() };
    input.imu.push(ImuSample { stamp: now, has_attitude: true, euler_rad: [0.0, 0.02, 0.0], ..ImuSample::default() });
    for (bus, batch) in input.received.iter_mut().enumerate() {
        // Boot-ups, answers and noise from all nodes, so that every branch of the bus master sees traffic.
        for n in 0..6_u16 {
            let id = [0x700, 0x180, 0x580, 0x080, 0x7FF][(usize::from(n) + bus) % 5] + n;
            let byte = u8::try_from(index % 251).unwrap();
            batch.push(BusFrame::theirs(now, CanFrame::new(id, &[byte; 8])));
        }
    }
    input
}

#[test]
fn ten_thousand_ticks_neither_allocate_nor_fault() {
    let (mut tick, mut record) = (tick(), TickRecord::default());
    memory::touch_stack(512 * 1024);
    (0..1_000).for_each(|i| tick.step(&input(i), &mut record));
    let before = (allocation::on_this_thread(), memory::faults_of_this_thread());
    (1_000..11_000).for_each(|i| tick.step(&input(i), &mut record));
    let after = (allocation::on_this_thread(), memory::faults_of_this_thread());
    assert_eq!(before, after);
}

#[test]
fn the_same_inputs_give_the_same_bits() {
    let run = || {
        let (mut tick, mut record) = (tick(), TickRecord::default());
        let step = |i| {
            tick.step(&input(i), &mut record);
            format!("{record:?}")
        };
        (0..300).map(step).collect::<Vec<_>>()
    };
    assert_eq!(run(), run());
}

#[test]
fn silent_drives_are_never_enabled_and_get_no_torque() {
    let (mut tick, mut record) = (tick(), TickRecord::default());
    for index in 0..500 {
        tick.step(&TickInput { received: Default::default(), ..input(index) }, &mut record);
        assert!(record.drives.drives.iter().all(|d| d.goal != DriveGoal::Enabled && d.torque_permille == 0));
        assert!(record.feedback.drives.iter().all(|d| d.state != DriveState::Enabled));
    }
}

#[test]
fn every_drive_has_a_stop_frame() {
    let counts = tick().stop_frames().map(|batch| batch.count);
    assert_eq!(counts, [4, 3], "three drives and two, and a SYNC that makes it act");
}
