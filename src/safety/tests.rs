#![expect(clippy::float_cmp, reason = "exact by construction")]

use super::*;
use crate::config;
use crate::msg::{BUSES, BusHealth, Drive, DriveFeedback, OperatorSample};
use proptest::prelude::*;

/// A healthy robot around a guard: every source speaks each tick, drives follow their goal at once.
struct Bench {
    guard: Guard,
    input: TickInput,
    feedback: DriveFeedbacks,
    snapshot: Snapshot,
    estimate: Estimate,
    wanted: JointCommand,
    /// Sources go on being stamped.
    live: bool,
    /// But for this drive.
    mute: Option<Drive>,
    /// The threads that bring input do so.
    listening: bool,
    drives_follow: bool,
}

const MS: i64 = 1_000_000;

impl Bench {
    fn new() -> Self {
        let config = config::load(None, &[]).unwrap().config;
        let mut bench = Self {
            guard: Guard::new(&config),
            input: TickInput { now: Stamp(1_000 * MS), ..TickInput::default() },
            feedback: DriveFeedbacks::default(),
            snapshot: Snapshot { toe_position_m: [0.03, 0.03, 0.01, 0.01], ..Snapshot::default() },
            estimate: Estimate { valid: true, ..Estimate::default() },
            wanted: JointCommand { hip_torque_nm: 10.0, toe_position_m: [0.01; 4], ..JointCommand::default() },
            live: true,
            mute: None,
            listening: true,
            drives_follow: true,
        };
        for drive in &mut bench.feedback.drives {
            drive.state = DriveState::Ready;
            drive.zero = ZeroState::Known;
        }
        bench
    }

    /// Armed, with the ramp behind it.
    fn armed() -> Self {
        let mut bench = Self::new();
        bench.run(10, false);
        bench.run(100, true);
        assert_eq!(bench.guard.mode(), Mode::Armed);
        bench
    }

    fn tick(&mut self, held: bool) -> Decision {
        self.input.now += Span::from_ms(1);
        self.input.index += 1;
        self.snapshot.dead_man = held;
        if self.listening {
            self.input.heard_until = [self.input.now; BUSES];
            self.input.imu_heard_until = self.input.now;
        }
        if self.live {
            for (index, drive) in self.feedback.drives.iter_mut().enumerate() {
                if self.mute.is_none_or(|mute| mute as usize != index) {
                    drive.stamp = self.input.now;
                }
            }
        } else {
            self.snapshot.operator_age.0 += MS;
            self.snapshot.imu_age.0 += MS;
        }
        self.guard.late(&self.input);
        let decision = self.guard.step(&Facts {
            input: &self.input,
            feedback: &self.feedback,
            snapshot: &self.snapshot,
            estimate: &self.estimate,
            wanted: &self.wanted,
        });
        if self.drives_follow {
            self.follow(decision.goal);
        }
        decision
    }

    fn follow(&mut self, goal: DriveGoal) {
        for drive in &mut self.feedback.drives {
            drive.state = match goal {
                DriveGoal::Disabled => DriveState::SwitchOnDisabled,
                DriveGoal::Ready => DriveState::Ready,
                DriveGoal::Enabled => DriveState::Enabled,
            };
        }
    }

    fn run(&mut self, ticks: usize, held: bool) -> Decision {
        (0..ticks).map(|_| self.tick(held)).last().unwrap()
    }
}

/// From the armed state, `harm` gives this fault and zero torque in the very tick.
fn trips(expected: FaultCode, harm: impl FnOnce(&mut Bench)) {
    let mut bench = Bench::armed();
    assert_eq!(bench.tick(true).allowed.hip_torque_nm, 10.0);
    harm(&mut bench);
    let decision = bench.tick(true);
    assert_eq!(decision.status.first_fault.code, expected);
    assert_eq!(decision.status.mode, Mode::Faulted);
    assert_eq!(decision.allowed.hip_torque_nm, 0.0);
    assert_eq!(decision.allowed.toe_position_m, bench.snapshot.toe_position_m, "toes hold");
    assert_eq!(decision.goal, DriveGoal::Disabled);
}

#[test]
fn it_boots_disarmed_and_arms_on_a_fresh_edge() {
    let mut bench = Bench::new();
    assert_eq!(bench.run(20, false).status.mode, Mode::Disarmed);
    assert_eq!(bench.tick(true).status.mode, Mode::Arming);
    assert_eq!(bench.tick(true).status.mode, Mode::Armed);
}

#[test]
fn without_the_zero_of_any_drive_no_press_arms() {
    for index in 0..DRIVES {
        let mut bench = Bench::new();
        bench.feedback.drives[index].zero = ZeroState::Unknown;
        bench.run(10, false);
        let decision = bench.run(500, true);
        assert_ne!(decision.status.arm_blockers & (1 << FaultCode::ZeroUnknown as u8), 0);
        let expected = if index == Drive::Hip as usize { Mode::Disarmed } else { Mode::Homing };
        assert_eq!((decision.status.mode, decision.goal), (expected, DriveGoal::Ready));
        assert_eq!(decision.allowed.hip_torque_nm, 0.0);
    }
}

#[test]
fn homing_ends_with_the_hand_and_with_the_last_zero_and_only_a_new_press_arms() {
    let lost = |bench: &mut Bench| {
        bench.feedback.drives[2].zero = ZeroState::Unknown;
        bench.run(10, false);
        assert_eq!(bench.run(20, true).status.mode, Mode::Homing);
    };
    let mut bench = Bench::new();
    lost(&mut bench);
    let decision = bench.tick(false);
    assert_eq!((decision.status.mode, decision.status.faults), (Mode::Disarmed, 0), "letting go is no fault here");
    let mut bench = Bench::new();
    lost(&mut bench);
    bench.feedback.drives[2].zero = ZeroState::Known;
    assert_eq!(bench.run(100, true).status.mode, Mode::Disarmed, "the key is still held");
    bench.tick(false);
    assert_eq!(bench.tick(true).status.mode, Mode::Arming);
    let mut bench = Bench::new();
    lost(&mut bench);
    bench.feedback.drives[2].zero = ZeroState::Failed;
    let decision = bench.tick(true);
    assert_eq!((decision.status.mode, decision.status.first_fault.code), (Mode::Faulted, FaultCode::HomingFailed));
    let mut bench = Bench::new();
    lost(&mut bench);
    bench.snapshot.operator_age = Span::from_ms(101);
    assert_eq!(bench.tick(true).status.first_fault.code, FaultCode::OperatorStale);
}

#[test]
fn a_fault_while_homing_is_told_and_not_the_one_before_the_press() {
    let mut bench = Bench::new();
    bench.run(20, false);
    bench.run(20, true);
    assert_eq!(bench.tick(false).status.first_fault.code, FaultCode::DeadManReleased);
    // A toe's drive restarts and has lost its zero.
    bench.feedback.drives[2].zero = ZeroState::Unknown;
    bench.run(500, false);
    let pressed = bench.run(5, true).status;
    assert_eq!((pressed.mode, pressed.first_fault.code), (Mode::Homing, FaultCode::None));
    bench.feedback.drives[2].zero = ZeroState::Failed;
    let failed = bench.tick(true).status;
    assert_eq!((failed.mode, failed.first_fault.code, failed.faults), (Mode::Faulted, FaultCode::HomingFailed, 2));
}

#[test]
fn a_key_held_at_start_does_not_arm() {
    let mut bench = Bench::new();
    assert_eq!(bench.run(5_000, true).status.mode, Mode::Disarmed);
}

#[test]
fn drives_are_enabled_with_zero_torque() {
    let mut bench = Bench::new();
    bench.drives_follow = false;
    bench.run(10, false);
    for _ in 0..500 {
        let decision = bench.tick(true);
        assert_eq!((decision.goal, decision.allowed.hip_torque_nm), (DriveGoal::Enabled, 0.0));
    }
}

#[test]
fn torque_ramps_from_zero_after_arming() {
    let mut bench = Bench::new();
    bench.run(10, false);
    bench.tick(true);
    bench.wanted.hip_torque_nm = 30.0;
    let torque: Vec<f64> = (0..51).map(|_| bench.tick(true).allowed.hip_torque_nm).collect();
    assert_eq!(torque[0], 0.0);
    assert!((torque[25] - 15.0).abs() < 1e-9, "half way: {}", torque[25]);
    assert_eq!(torque[50], 30.0);
}

#[test]
fn toes_start_from_where_they_are_and_keep_their_speed() {
    let mut bench = Bench::new();
    bench.run(10, false);
    bench.tick(true);
    let mut last = bench.snapshot.toe_position_m;
    for _ in 0..200 {
        let toes = bench.tick(true).allowed.toe_position_m;
        assert!(toes.iter().zip(&last).all(|(a, b)| (a - b).abs() <= 0.25e-3 + 1e-12));
        last = toes;
    }
    assert_eq!(last, [0.01; 4]);
}

#[test]
fn dead_man_released_is_zero_torque_in_the_same_tick() {
    let mut bench = Bench::armed();
    let decision = bench.tick(false);
    assert_eq!(decision.allowed.hip_torque_nm, 0.0);
    assert_eq!(decision.status.first_fault.code, FaultCode::DeadManReleased);
    assert_eq!(decision.goal, DriveGoal::Disabled);
}

#[test]
fn stale_sources_trip() {
    trips(FaultCode::OperatorStale, |b| b.snapshot.operator_age = Span::from_ms(101));
    trips(FaultCode::OperatorStale, |b| b.snapshot.operator_age = Span(i64::MIN));
    trips(FaultCode::ImuStale, |b| b.snapshot.imu_age = Span(i64::MAX));
    let mut bench = Bench::armed();
    bench.live = false;
    let decision = bench.run(200, true);
    assert_eq!(decision.status.first_fault.code, FaultCode::DriveStale, "5 ms and a period is the shortest limit");
}

/// A drive's word is read in the tick after its SYNC: the one after two lost answers of a toe, which come every 4 ms, at 13 ms.
#[test]
fn two_answers_of_a_toe_in_a_row_may_be_lost_and_the_hip_may_be_silent_for_six_ms() {
    for (drive, most_ms) in [(Drive::Hip, 6), (Drive::InnerToeA, 13), (Drive::OuterToeB, 13)] {
        let mut bench = Bench::armed();
        bench.mute = Some(drive);
        let patient = bench.run(most_ms, true);
        assert_eq!((patient.status.mode, patient.allowed.hip_torque_nm), (Mode::Armed, 10.0), "{drive:?}");
        let fault = bench.tick(true).status.first_fault;
        assert_eq!((fault.code, usize::from(fault.index)), (FaultCode::DriveStale, drive as usize));
    }
}

#[test]
fn numbers_that_are_not_finite_trip() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        trips(FaultCode::NotFinite, |b| b.snapshot.leg_angle_rad = bad);
        trips(FaultCode::NotFinite, |b| b.estimate.theta_swing_rad_s = bad);
        trips(FaultCode::NotFinite, |b| b.wanted.hip_torque_nm = bad);
        trips(FaultCode::NotFinite, |b| b.wanted.toe_position_m[2] = bad);
    }
}

#[test]
fn drives_and_buses_that_fail_trip() {
    let hip = Drive::Hip as usize;
    trips(FaultCode::DriveFault, |b| b.feedback.drives[hip].state = DriveState::Fault);
    trips(FaultCode::DriveFault, |b| b.feedback.drives[3].error_code = 0x8130);
    trips(FaultCode::DriveNotEnabled, |b| b.feedback.drives[hip].state = DriveState::SwitchedOn);
    trips(FaultCode::DriveNotEnabled, |b| b.feedback.drives[4] = DriveFeedback::default());
    for health in [BusHealth::Off, BusHealth::Stalled, BusHealth::Down, BusHealth::Contested] {
        trips(FaultCode::BusUnhealthy, |b| b.input.bus_health[1] = health);
        trips(FaultCode::BusUnhealthy, |b| b.feedback.health[0] = health);
    }
}

#[test]
fn limits_of_posture_trip() {
    trips(FaultCode::TiltLimit, |b| b.estimate.theta_stance_rad = -0.51);
    trips(FaultCode::TiltLimit, |b| b.estimate.theta_swing_rad = 1.01);
    trips(FaultCode::RateLimit, |b| b.estimate.theta_swing_rad_s = 10.1);
    trips(FaultCode::EstimateLost, |b| b.estimate.innovation_swing_rad = 0.31);
    trips(FaultCode::EstimateLost, |b| b.estimate.valid = false);
    trips(FaultCode::OutOfRange, |b| b.snapshot.hip_angle_rad = 3.2);
    trips(FaultCode::TorqueDemand, |b| b.wanted.hip_torque_nm = 1501.0);
}

#[test]
fn lost_real_time_and_shut_down_trip() {
    trips(FaultCode::NotRealTime, |b| b.input.real_time_missing = 4);
    trips(FaultCode::Stopping, |b| b.input.stop_requested = true);
}

#[test]
fn without_real_time_it_never_arms() {
    let mut bench = Bench::new();
    bench.input.real_time_missing = 1;
    bench.run(10, false);
    let decision = bench.run(1_000, true);
    assert_eq!(decision.status.mode, Mode::Disarmed);
    assert_eq!(decision.status.arm_blockers, 1 << FaultCode::NotRealTime as u8);
}

#[test]
fn a_press_while_something_is_in_the_way_is_used_up() {
    let mut bench = Bench::new();
    bench.estimate.theta_stance_rad = 0.08;
    bench.run(10, false);
    bench.run(5, true);
    bench.estimate.theta_stance_rad = 0.0;
    assert_eq!(bench.run(100, true).status.mode, Mode::Disarmed);
}

#[test]
fn drives_that_do_not_get_enabled_in_time_trip() {
    let mut bench = Bench::new();
    bench.run(10, false);
    bench.drives_follow = false;
    assert_eq!(bench.run(3_000, true).status.mode, Mode::Arming);
    assert_eq!(bench.run(10, true).status.first_fault.code, FaultCode::DriveNotEnabled);
}

#[test]
fn the_first_fault_is_kept_until_armed_again() {
    let mut bench = Bench::armed();
    bench.estimate.theta_stance_rad = 0.6;
    bench.tick(true);
    bench.estimate.theta_stance_rad = 0.0;
    let decision = bench.run(1_000, true);
    assert_eq!((decision.status.mode, decision.goal), (Mode::Faulted, DriveGoal::Disabled), "held all the time");
    assert_eq!(decision.status.first_fault.code, FaultCode::TiltLimit);
    let decision = bench.run(200, false);
    assert_eq!(decision.status.first_fault.code, FaultCode::TiltLimit);
    assert_eq!(decision.goal, DriveGoal::Ready, "drives get ready once the hand is open");
    let decision = bench.tick(true);
    assert_eq!((decision.status.mode, decision.status.first_fault.code), (Mode::Arming, FaultCode::None));
    assert_eq!(decision.status.faults, 1);
}

#[test]
fn a_fault_that_stays_keeps_the_robot_from_arming_again() {
    let mut bench = Bench::armed();
    bench.estimate.theta_stance_rad = 0.6;
    bench.run(10, true);
    bench.run(500, false);
    assert_eq!(bench.run(10, true).status.mode, Mode::Faulted);
}

#[test]
fn one_late_tick_does_not_drop_the_robot_but_many_do() {
    let mut bench = Bench::armed();
    bench.input.skipped = 9;
    let decision = bench.tick(true);
    assert_eq!((decision.status.mode, decision.status.last_fault.code), (Mode::Armed, FaultCode::Late));
    assert_eq!(decision.allowed.hip_torque_nm, 10.0);
    bench.run(3, true);
    assert_eq!(bench.tick(true).status.first_fault.code, FaultCode::Overrun, "45 within a second, 40 allowed");
}

/// Our own stall of `ms`, out of which the tick wakes with what had been said before it.
fn stall(bench: &mut Bench, ms: i64) -> Decision {
    bench.live = false;
    bench.input.now += Span(ms * MS);
    bench.snapshot.imu_age = Span(ms * MS);
    bench.input.skipped = u32::try_from(ms).unwrap();
    let decision = bench.tick(true);
    (bench.live, bench.input.skipped) = (true, 0);
    bench.snapshot.imu_age = Span::ZERO;
    bench.snapshot.operator_age = Span::ZERO;
    decision
}

#[test]
fn a_stall_of_our_own_costs_a_tick_of_torque_and_not_the_robot() {
    for ms in [7, 21, 39] {
        let mut bench = Bench::armed();
        let decision = stall(&mut bench, ms);
        assert_eq!((decision.status.mode, decision.goal), (Mode::Armed, DriveGoal::Enabled), "{ms} ms");
        assert_eq!(decision.allowed.hip_torque_nm, 0.0, "what the drives said {ms} ms ago moves no motor");
        assert_eq!(decision.allowed.toe_position_m, bench.snapshot.toe_position_m);
        bench.tick(true);
        assert_eq!(bench.tick(true).allowed.hip_torque_nm, 10.0, "{ms} ms");
    }
    assert_eq!(stall(&mut Bench::armed(), 41).status.first_fault.code, FaultCode::Overrun);
}

#[test]
fn a_loop_that_stood_still_blames_no_bus_and_no_drive() {
    let mut bench = Bench::armed();
    // Nobody has read the echoes meanwhile, and the drives' watchdogs have struck.
    bench.input.bus_health[0] = BusHealth::Stalled;
    bench.feedback.drives[0].error_code = 0x8130;
    let decision = stall(&mut bench, 300);
    assert_eq!(decision.status.first_fault.code, FaultCode::Overrun);
    assert_eq!(decision.allowed.hip_torque_nm, 0.0);
}

#[test]
fn a_stall_of_the_threads_that_bring_input_costs_torque_and_not_the_robot() {
    for ms in [7, 28, 45] {
        let mut bench = Bench::armed();
        (bench.live, bench.listening) = (false, false);
        let decisions: Vec<Decision> = (0..ms).map(|_| bench.tick(true)).collect();
        assert!(decisions.iter().all(|d| d.status.mode == Mode::Armed), "{ms} ms");
        assert!(decisions.iter().skip(6).all(|d| d.allowed.hip_torque_nm == 0.0), "{ms} ms");
        (bench.live, bench.listening) = (true, true);
        (bench.snapshot.imu_age, bench.snapshot.operator_age) = (Span::ZERO, Span::ZERO);
        bench.run(2, true);
        assert_eq!(bench.tick(true).allowed.hip_torque_nm, 10.0, "{ms} ms");
    }
    let mut bench = Bench::armed();
    (bench.live, bench.listening) = (false, false);
    assert_eq!(bench.run(60, true).status.first_fault.code, FaultCode::DriveStale, "longer than the drives' watchdogs");
}

#[test]
fn drives_that_stay_silent_after_a_stall_trip_without_having_had_torque() {
    let mut bench = Bench::armed();
    stall(&mut bench, 21);
    bench.live = false;
    let decisions: Vec<Decision> = (0..20).map(|_| bench.tick(true)).collect();
    assert!(decisions.iter().all(|d| d.allowed.hip_torque_nm == 0.0));
    assert_eq!(decisions[10].status.first_fault.code, FaultCode::DriveStale);
}

#[test]
fn torque_changes_no_faster_than_its_rate_limit() {
    let mut bench = Bench::armed();
    bench.wanted.hip_torque_nm = -10.0;
    let decision = bench.tick(true);
    assert_eq!(decision.allowed.hip_torque_nm, 4.0);
    assert_eq!(decision.status.last_fault.code, FaultCode::TorqueRateLimited);
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![Just(f64::NAN), Just(f64::INFINITY), Just(-0.0), any::<f64>(), -50.0..50.0]
}

fn any_state() -> impl Strategy<Value = DriveState> {
    (0..DriveState::ALL.len()).prop_map(|i| DriveState::ALL[i])
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn torque_is_finite_and_within_its_limit_for_any_input(
        numbers in prop::array::uniform8(any_number()),
        ages in prop::array::uniform4(any::<i64>()),
        state in any_state(),
        flags in any::<[bool; 4]>(),
        only in 0_usize..13,
    ) {
        let mut bench = Bench::armed();
        let [leg, hip, stance, swing, rate, innovation, torque, toe] = numbers;
        // One thing goes wrong, or (at 11) everything at once.
        let hit = |n: usize| only == n || only == 11;
        if hit(0) { bench.snapshot.leg_angle_rad = leg; }
        if hit(1) { bench.snapshot.hip_angle_rad = hip; }
        if hit(2) { bench.estimate.theta_stance_rad = stance; }
        if hit(3) { bench.estimate.theta_swing_rad = swing; }
        if hit(4) { bench.estimate.theta_stance_rad_s = rate; }
        if hit(5) { bench.estimate.innovation_stance_rad = innovation; }
        if hit(6) { bench.wanted.hip_torque_nm = torque; }
        if hit(7) { bench.wanted.toe_position_m[1] = toe; bench.snapshot.toe_position_m[3] = toe; }
        if hit(8) { bench.snapshot.imu_age = Span(ages[0]); bench.snapshot.operator_age = Span(ages[1]); }
        if hit(9) { bench.feedback.drives[0].stamp = Stamp(ages[2]); bench.live = flags[0]; }
        if hit(10) { bench.input.now = Stamp(ages[3]); bench.input.skipped = u32::from(flags[1]); }
        if hit(12) {
            bench.listening = flags[3];
            bench.input.heard_until = [Stamp(ages[0]), Stamp(ages[1])];
            bench.input.imu_heard_until = Stamp(ages[2]);
        }
        bench.feedback.drives[2].state = if only == 11 { state } else { DriveState::Enabled };
        for step in 0..40 {
            let decision = bench.tick(flags[2] || step % 7 < 3);
            let torque = decision.allowed.hip_torque_nm;
            prop_assert!(torque.is_finite() && torque.abs() <= 30.0);
            prop_assert!(torque == 0.0 || decision.status.mode == Mode::Armed);
            prop_assert!(decision.allowed.toe_position_m.iter().all(|toe| (0.0..=0.04).contains(toe)));
        }
    }

    #[test]
    fn the_mode_leaves_faulted_only_by_an_edge(events in any::<[bool; 8]>()) {
        let [heard, edge, healthy, fault, enabled, homable, held, homed] = events;
        let next = mode::next(Mode::Faulted, Events { heard, edge, healthy, fault, enabled, homable, held, homed });
        prop_assert_eq!(next == Mode::Faulted, !(edge && (healthy || homable)));
    }
}

#[test]
fn operator_sample_without_a_heartbeat_is_never_fresh() {
    let never = OperatorSample { stamp: Stamp::NEVER, dead_man: true, ..OperatorSample::default() };
    assert!(!health::fresh(Stamp(0).since(never.stamp), Span::from_ms(100)));
}
