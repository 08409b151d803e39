use super::*;
use crate::base::time::Stamp;
use crate::channel::topic;
use crate::msg::OperatorSample;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A robot that no other test and no other process uses.
fn robot(test: &str) -> String {
    format!("test-{test}-{}", std::process::id())
}

fn sample(sequence: u32) -> OperatorSample {
    OperatorSample { stamp: Stamp(1), dead_man: true, sequence, ..OperatorSample::default() }
}

#[test]
fn what_is_published_arrives_in_order() {
    let channels = Endpoint::join(&robot("order")).unwrap();
    let mut out = channels.publisher(&topic::OPERATOR).unwrap();
    let mut inlet = channels.subscriber(&topic::OPERATOR).unwrap();
    (0..5).for_each(|i| out.publish(&sample(i)));
    let got: Vec<u32> = std::iter::from_fn(|| inlet.receive()).map(|s| s.sequence).collect();
    assert_eq!(got, [0, 1, 2, 3, 4]);
    assert_eq!((inlet.missed(), out.refused()), (0, 0));
}

#[test]
fn a_slow_reader_loses_the_oldest_and_knows_how_many() {
    let channels = Endpoint::join(&robot("slow")).unwrap();
    let mut out = channels.publisher(&topic::OPERATOR).unwrap();
    let mut inlet = channels.subscriber(&topic::OPERATOR).unwrap();
    out.publish(&sample(0));
    assert!(inlet.receive().is_some());
    let flood = u32::try_from(topic::OPERATOR.buffer).unwrap() + 7;
    (1..=flood).for_each(|i| out.publish(&sample(i)));
    let first = inlet.receive().unwrap();
    assert_eq!((first.sequence, inlet.missed()), (8, 7));
    assert_eq!(out.refused(), 0, "the publisher never waits and never gives up");
}

#[test]
fn who_reads_along_finds_the_robot_and_sees_it_go() {
    let robot = robot("listen");
    let channels = Endpoint::join(&robot).unwrap();
    assert!(channels.listener(&topic::OPERATOR).is_err(), "nobody is there, and none is made");
    assert!(!robots_with(&topic::OPERATOR).unwrap().robots.contains(&robot));
    let mut out = channels.publisher(&topic::OPERATOR).unwrap();
    assert!(robots_with(&topic::OPERATOR).unwrap().robots.contains(&robot));
    let other = topic::Topic::<crate::msg::ImuSample>::new(topic::OPERATOR.name(), 8, 4);
    assert!(robots_with(&other).unwrap().other_builds.contains(&robot), "and another build is told from ours");
    let mut inlet = channels.listener(&topic::OPERATOR).unwrap();
    out.publish(&sample(3));
    assert_eq!(inlet.receive().map(|sample| sample.sequence), Some(3));
    assert!(inlet.has_publisher());
    drop(out);
    assert!(!inlet.has_publisher());
}

#[test]
fn a_changed_type_meets_nobody() {
    let robot = robot("retype");
    let channels = Endpoint::join(&robot).unwrap();
    let mut out = channels.publisher(&topic::OPERATOR).unwrap();
    let other = topic::Topic::<crate::msg::ImuSample>::new(topic::OPERATOR.name(), 8, 4);
    let mut inlet = channels.subscriber(&other).unwrap();
    out.publish(&sample(0));
    assert!(inlet.receive().is_none());
}

/// Not a test of its own: the process that [`a_killed_process_leaves_nothing_in_the_way`] kills.
#[test]
#[ignore = "run by the kill -9 test"]
fn child_that_gets_killed() {
    let Ok(robot) = std::env::var("COMPASS_TEST_ROBOT") else { return };
    let channels = Endpoint::join(&robot).unwrap();
    let mut out = channels.publisher(&topic::OPERATOR).unwrap();
    let end = Instant::now() + Duration::from_secs(20);
    while Instant::now() < end {
        out.publish(&sample(7));
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn a_killed_process_leaves_nothing_in_the_way() {
    let robot = robot("kill");
    let channels = Endpoint::join(&robot).unwrap();
    let mut inlet = channels.subscriber(&topic::OPERATOR).unwrap();
    // Both publisher places of the service get taken by a process that dies without goodbye, five times over.
    for _ in 0..5 {
        let mut child = Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "channel::port::tests::child_that_gets_killed", "--ignored"])
            .env("COMPASS_TEST_ROBOT", &robot)
            .stdout(Stdio::null())
            .spawn()
            .unwrap();
        wait_for_sample(&mut inlet);
        child.kill().unwrap();
        child.wait().unwrap();
    }
    let fresh = Endpoint::join(&robot).unwrap();
    let mut out = fresh.publisher(&topic::OPERATOR).unwrap();
    while inlet.receive().is_some() {}
    out.publish(&sample(42));
    assert_eq!(inlet.receive().unwrap().sequence, 42);
}

fn wait_for_sample(inlet: &mut Subscriber<OperatorSample>) {
    while inlet.receive().is_some() {}
    let end = Instant::now() + Duration::from_secs(20);
    while inlet.receive().is_none() {
        assert!(Instant::now() < end, "the child published nothing");
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn shared_memory_without_room_is_told_before_it_is_touched() {
    let needed = needed_bytes(&crate::channel::topic::TICK);
    assert!(needed > 10 << 20, "half a second of ticks for each of eight readers: {needed}");
    assert!(check_room("tick", needed, needed).is_ok());
    let error = check_room("tick", 64 * 1024, needed).unwrap_err().to_string();
    assert!(error.contains("/dev/shm has 0 MiB of room") && error.contains("channel tick"), "{error}");
}
