use super::*;
use crate::cli::laws;
use crate::config;
use crate::msg::{ControlState, Mode, TickInput, TickRecord};
use crate::rt::relay::Observed;
use crate::rt::thread::Missing;
use crate::rt::{allocation, memory};
use crate::sim::lockstep::Lockstep;

#[test]
fn durations_have_units() {
    assert_eq!(duration("30s"), Ok(Duration::from_secs(30)));
    assert_eq!(duration("1.5m"), Ok(Duration::from_secs(90)));
    assert_eq!(duration("250ms"), Ok(Duration::from_millis(250)));
    assert_eq!(duration("30"), Ok(Duration::from_secs(30)));
    for wrong in ["", "s", "-1s", "1d", "1e300h", "nans"] {
        assert!(duration(wrong).is_err(), "{wrong}");
    }
}

#[test]
fn sizes_have_units_and_a_least() {
    assert_eq!(size("100GB"), Ok(100_000_000_000));
    for wrong in ["100", "GB", "-1GB", "1.5GB", "99MB", "1GiB", "99999999999TB"] {
        assert!(size(wrong).is_err(), "{wrong}");
    }
}

/// The inputs of a run in lockstep: the robot arms at half a second.
fn inputs_of(config: &Config, ticks: usize) -> Vec<TickInput> {
    let mut run = Lockstep::new(config).unwrap();
    (0..ticks).map(|_| run.step().input).collect()
}

#[test]
fn the_tick_of_an_armed_robot_neither_allocates_nor_faults() {
    let config = config::load(None, &[]).unwrap().config;
    let inputs = inputs_of(&config, 12_000);
    let (mut tick, mut record) = (Tick::new(&config).unwrap(), Box::<TickRecord>::default());
    memory::touch_stack(512 * 1024);
    let (before, after) = inputs.split_at(1_000);
    before.iter().for_each(|input| tick.step(input, &mut record));
    assert_eq!(record.status.mode, Mode::Armed);
    let start = (allocation::on_this_thread(), memory::faults_of_this_thread());
    after.iter().for_each(|input| tick.step(input, &mut record));
    let end = (allocation::on_this_thread(), memory::faults_of_this_thread());
    assert_eq!((record.status.mode, record.status.faults), (Mode::Armed, 0));
    assert_eq!(end, start, "allocations, page faults in {} ticks", after.len());
}

/// Armed or fallen: a law that lets the robot fall owes it too.
#[test]
fn the_tick_of_every_law_on_the_ground_neither_allocates_nor_faults() {
    for (keys, law) in laws::ALL {
        steps_without_allocation(keys, laws::EACH_MS, |control| control.law == law);
    }
    let (keys, ms, motion) = laws::AGAIN;
    steps_without_allocation(keys, ms, |control| control.motion == motion);
}

/// `is_it`: what the controller must have done at some time, armed.
fn steps_without_allocation(keys: &[&str], ms: usize, is_it: impl Fn(&ControlState) -> bool) {
    let config = config::load(None, &laws::on_the_ground(keys)).unwrap().config;
    let inputs = inputs_of(&config, ms);
    let (mut tick, mut record) = (Tick::new(&config).unwrap(), Box::<TickRecord>::default());
    memory::touch_stack(512 * 1024);
    let (before, after) = inputs.split_at(1_500);
    before.iter().for_each(|input| tick.step(input, &mut record));
    assert_eq!(record.status.mode, Mode::Armed, "{keys:?}");
    let mut had_its_turn = false;
    let start = (allocation::on_this_thread(), memory::faults_of_this_thread());
    for input in after {
        tick.step(input, &mut record);
        had_its_turn |= record.status.mode == Mode::Armed && is_it(&record.control);
    }
    let end = (allocation::on_this_thread(), memory::faults_of_this_thread());
    assert!(had_its_turn, "{keys:?}");
    assert_eq!(end, start, "{keys:?}: allocations, page faults in {} ticks", after.len());
}

/// What the relay saw of a run with this fault and this state of the threads.
fn ended(faulted: bool, panicked: bool) -> Summary {
    let observed = Observed { faulted, ..Observed::default() };
    Summary { observed, missing: Missing::default(), refused_frames: 0, allocations: None, page_faults: None, panicked }
}

#[test]
fn a_release_ends_in_0_a_fault_in_1_and_a_panic_of_any_thread_in_70() {
    assert_eq!(outcome(&ended(false, false), 0, 0).unwrap(), Outcome::Fine);
    assert_eq!(outcome(&ended(true, false), 0, 0).unwrap(), Outcome::Finding);
    assert_eq!(outcome(&ended(false, false), 1, 0).unwrap(), Outcome::Finding, "a tick that was not recorded");
    for (panicked, counted) in [(true, 0), (false, 1)] {
        let summary = ended(false, panicked);
        let result = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| outcome(&summary, 0, counted)));
        assert!(result.is_err(), "which the exit code 70 is made of");
    }
}
