use super::*;
use crate::bus::loopback::{Loopback, pair};
use crate::config;
use crate::config::checked::Trigger;
use crate::msg::{BusFrame, CanFrame, TickInput, TickRecord};
use crate::rt::clock;
use crate::rt::io::ByteLine;
use crate::sensor::imu::ImuReader;
use std::os::fd::RawFd;
use std::sync::atomic::AtomicUsize;
use std::thread;
use std::time::Duration;

/// Answers each frame it sees with a frame of its own number.
struct Echoing;

impl Walk for Echoing {
    fn step(&mut self, input: &TickInput, tick: &mut TickRecord) {
        tick.input = *input;
        tick.output = Default::default();
        for (frames, send) in input.received.iter().zip(&mut tick.output.send) {
            for frame in frames.iter().filter(|f| f.frame.id == 0x181) {
                send.push(BusFrame::ours(input.now, CanFrame::new(0x201, frame.frame.payload())));
            }
        }
    }
}

/// No IMU at all.
struct Silence;

impl ByteLine for Silence {
    fn read(&mut self, _: &mut [u8]) -> Option<usize> {
        Some(0)
    }
    fn write(&mut self, _: &[u8]) -> bool {
        true
    }
    fn readable_fd(&self) -> RawFd {
        -1
    }
}

/// A bus in memory for the process, and its far end.
fn port() -> (BusPort, Loopback) {
    let (host, robot) = pair().unwrap();
    let (words, _) = pair().unwrap();
    let (transmit, receive) = host.split();
    let port = BusPort { transmit: Box::new(transmit), receive: Box::new(receive), last_words: Box::new(words) };
    (port, robot)
}

struct Rig {
    running: Running,
    stop: Stop,
    robots: [Loopback; BUSES],
    seen: Arc<AtomicUsize>,
}

fn rig(name: &str, input: Input, trigger: Trigger) -> Rig {
    let (parts, robots, seen) = parts(name, input, trigger);
    let stop = parts.stop.clone();
    Rig { running: start(Echoing, parts).unwrap(), stop, robots, seen }
}

fn parts(name: &str, input: Input, trigger: Trigger) -> (Parts, [Loopback; BUSES], Arc<AtomicUsize>) {
    let mut config = config::load(None, &[]).unwrap().config;
    config.real_time.input = input;
    config.real_time.trigger = trigger;
    config.real_time.lock_memory = false;
    let ([(a, far_a), (b, far_b)], stop) = ([port(), port()], Stop::default());
    let seen = Arc::new(AtomicUsize::new(0));
    let counter = seen.clone();
    let each = move |_: &TickRecord| {
        counter.fetch_add(1, Ordering::Relaxed);
    };
    let parts = Parts {
        robot: format!("test-process-{name}-{}", std::process::id()),
        buses: [a, b],
        imu: ImuPort::new(ImuReader::new(&config.robot.imu), Box::new(Silence)),
        lidar: None,
        hand: Hand::open(&config).unwrap(),
        stop_frames: Default::default(),
        missing: Missing::default(),
        simulated: true,
        sinks: Sinks { each: Box::new(each), beside: Box::new(|| None), dump: Box::new(|_, _| {}) },
        stop,
        config,
    };
    (parts, [far_a, far_b], seen)
}

/// The answer of the loop to one frame of the hip, or none within a second.
fn answer(robot: &mut Loopback) -> Option<CanFrame> {
    robot.send(&CanFrame::new(0x181, &[7, 7])).unwrap();
    let end = clock::now() + crate::base::time::Span::from_ms(1_000);
    while clock::now() < end {
        let found = std::iter::from_fn(|| robot.receive()).find(|f| f.frame.id == 0x201);
        if let Some(found) = found {
            return Some(found.frame);
        }
        thread::sleep(Duration::from_millis(1));
    }
    None
}

#[test]
fn every_kind_of_input_brings_frames_to_the_tick_and_commands_to_the_wire() {
    let kinds = [
        ("threads", Input::Threads, Trigger::Timer),
        ("triggered", Input::Threads, Trigger::Input),
        ("inline", Input::Inline, Trigger::Input),
        ("busy", Input::Busy, Trigger::Input),
    ];
    for (name, input, trigger) in kinds {
        let mut rig = rig(name, input, trigger);
        let first = answer(&mut rig.robots[0]);
        let second = answer(&mut rig.robots[1]);
        rig.stop.request();
        let summary = rig.running.wait();
        assert_eq!(first.map(|f| f.data[0]), Some(7), "{name}");
        assert_eq!(second.map(|f| f.data[0]), Some(7), "{name}");
        let ticks = summary.observed.last.input.index + 1;
        let seen = rig.seen.load(Ordering::Relaxed) as u64;
        assert_eq!(seen + summary.observed.missed, ticks, "{name}: no tick goes uncounted");
        assert!(!summary.panicked);
    }
}

#[test]
fn real_motors_with_a_simulated_hand_or_imu_never_start() {
    let (real_parts, _far, _) = parts("made-up", Input::Threads, Trigger::Timer);
    let refused = start(Echoing, Parts { simulated: false, ..real_parts });
    assert!(matches!(refused, Err(ProcessError::MadeUpSenses)), "a simulated hand");
    let (mut named_parts, _far, _) = parts("made-up", Input::Threads, Trigger::Timer);
    for bus in &mut named_parts.config.robot.buses {
        bus.backend = crate::config::checked::BusBackend::SocketCan("can0".into());
    }
    assert!(matches!(start(Echoing, named_parts), Err(ProcessError::MadeUpSenses)), "real buses by the configuration");
}

#[test]
fn a_panic_of_the_relay_stops_the_robot_and_is_told() {
    let (mut made, robots, _) = parts("panic", Input::Threads, Trigger::Timer);
    made.sinks.each = Box::new(|record| assert!(record.input.index < 5, "on purpose"));
    let stop = made.stop.clone();
    let summary = start(Echoing, made).unwrap().wait();
    assert!(summary.panicked && stop.is_requested(), "nobody else has asked it to end");
    assert_eq!(summary.observed.last.input.index, 5, "what was seen until then is told");
    assert!(summary.observed.panicked);
    drop(robots);
}

/// A walk that is preempted for two periods now and then.
struct Preempted(u64);

impl Walk for Preempted {
    fn step(&mut self, input: &TickInput, tick: &mut TickRecord) {
        Echoing.step(input, tick);
        tick.output.send[0]
            .push(BusFrame::ours(input.now, CanFrame::new(0x202, &[u8::from(input.index.is_multiple_of(10))])));
        self.0 += 1;
        if input.index.is_multiple_of(10) {
            thread::sleep(Duration::from_millis(2));
        }
    }
}

#[test]
fn a_command_that_grew_old_between_step_and_wire_is_not_sent_and_the_next_tick_knows() {
    let (mut made, mut robots, _) = parts("preempted", Input::Threads, Trigger::Timer);
    let unsent = Arc::new(AtomicUsize::new(0));
    let counter = unsent.clone();
    made.sinks.each = Box::new(move |record| {
        counter.fetch_add(usize::from(record.input.unsent == [true; BUSES]), Ordering::Relaxed);
    });
    let stop = made.stop.clone();
    let running = start(Preempted(0), made).unwrap();
    let mut old = 0;
    for _ in 0..100 {
        thread::sleep(Duration::from_millis(5));
        let frames = std::iter::from_fn(|| robots[0].receive());
        old += frames.filter(|f| f.frame.id == 0x202 && f.frame.data[0] == 1).count();
    }
    stop.request();
    drop(running.wait());
    assert_eq!(old, 0, "every tenth was two periods old");
    assert!(unsent.load(Ordering::Relaxed) > 5, "{unsent:?}");
}
