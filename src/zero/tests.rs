use super::*;
use crate::base::time::Span;
use crate::config;

const MS: i64 = 1_000_000;

/// Toes with a stop, behind drives that follow at once; counts begin wherever the drive was switched on.
struct Bench {
    zeros: Zeros,
    now: Stamp,
    operator: OperatorSample,
    mode: Mode,
    /// True lengths, m, and where the drives began to count.
    toe_m: [f64; TOES],
    began_m: [f64; TOES],
    stop_m: [f64; TOES],
    hip_counts: i32,
    state: DriveState,
    feedbacks: DriveFeedbacks,
    commands: DriveCommands,
    counts_per_m: f64,
}

impl Bench {
    fn new() -> Self {
        let config = config::load(None, &[]).unwrap().config;
        let toe_m = [0.03, 0.03, 0.01, 0.0];
        Self {
            zeros: Zeros::new(&config),
            now: Stamp(MS),
            operator: OperatorSample::default(),
            mode: Mode::Disarmed,
            toe_m,
            began_m: toe_m,
            stop_m: [0.0; TOES],
            hip_counts: 77,
            state: DriveState::Ready,
            feedbacks: DriveFeedbacks::default(),
            commands: DriveCommands::default(),
            counts_per_m: config.robot.toe.counts_per_m,
        }
    }

    fn tick(&mut self) {
        self.now += Span::from_ms(1);
        for (index, feedback) in self.feedbacks.drives.iter_mut().enumerate() {
            feedback.stamp = self.now;
            feedback.state = self.state;
            feedback.torque_limit_permille = self.commands.drives[index].torque_limit_permille;
            feedback.position_counts = match index.checked_sub(FIRST_TOE) {
                None => self.hip_counts,
                Some(toe) => ((self.toe_m[toe] - self.began_m[toe]) * self.counts_per_m).round() as i32,
            };
        }
        self.zeros.receive(self.now, &self.operator, self.mode, &mut self.feedbacks);
        self.commands = DriveCommands::default();
        self.zeros.command(self.mode, &mut self.commands);
        let raw = self.zeros.to_encoders(&self.commands);
        for toe in 0..TOES {
            let command = raw.drives[FIRST_TOE + toe];
            if command.goal == DriveGoal::Enabled && !command.hold && self.state == DriveState::Enabled {
                let target_m = self.began_m[toe] + f64::from(command.position_counts) / self.counts_per_m;
                self.toe_m[toe] = target_m.max(self.stop_m[toe]);
            }
        }
    }

    fn run(&mut self, mode: Mode, state: DriveState, ticks: usize) {
        (self.mode, self.state) = (mode, state);
        (0..ticks).for_each(|_| self.tick());
    }

    fn toes(&self) -> [ZeroState; TOES] {
        std::array::from_fn(|toe| self.feedbacks.drives[FIRST_TOE + toe].zero)
    }

    fn hip(&self) -> (ZeroState, i32) {
        (self.feedbacks.drives[0].zero, self.feedbacks.drives[0].position_counts)
    }
}

#[test]
fn toes_find_the_stop_at_limited_torque_and_go_back_to_where_they_stood() {
    let mut bench = Bench::new();
    bench.run(Mode::Disarmed, DriveState::Ready, 5);
    assert_eq!(bench.toes(), [ZeroState::Unknown; TOES]);
    let before = bench.toe_m;
    let mut lowest = before;
    (bench.mode, bench.state) = (Mode::Homing, DriveState::Enabled);
    for _ in 0..600 {
        bench.tick();
        let limits = bench.commands.drives.map(|d| d.torque_limit_permille);
        for toe in 0..TOES {
            let known = bench.toes()[toe] == ZeroState::Known;
            assert!(known || limits[FIRST_TOE + toe] <= 500 || lowest[toe] < 1e-9, "{limits:?}");
            lowest[toe] = lowest[toe].min(bench.toe_m[toe]);
        }
    }
    assert_eq!(bench.toes(), [ZeroState::Known; TOES]);
    assert!(lowest.iter().all(|m| *m < 1e-9), "each met its stop: {lowest:?}");
    for (now, was) in bench.toe_m.iter().zip(before) {
        assert!((now - was).abs() < 3e-4, "{now} {was}");
    }
    for toe in 0..TOES {
        let shown_m = f64::from(bench.feedbacks.drives[FIRST_TOE + toe].position_counts) / bench.counts_per_m;
        assert!((shown_m - bench.toe_m[toe]).abs() < 1e-5, "our count zero is the stop");
    }
}

#[test]
fn a_released_switch_ends_the_search_and_no_toe_is_told_to_move() {
    let mut bench = Bench::new();
    bench.run(Mode::Homing, DriveState::Enabled, 60);
    assert_eq!(bench.toes()[0], ZeroState::Homing);
    bench.run(Mode::Disarmed, DriveState::Enabled, 1);
    let there = bench.toe_m;
    bench.run(Mode::Disarmed, DriveState::Enabled, 100);
    assert_eq!(bench.toe_m.map(f64::to_bits), there.map(f64::to_bits));
    assert_eq!(bench.toes()[0], ZeroState::Unknown);
}

#[test]
fn a_toe_without_a_stop_fails_within_its_stroke_and_may_be_tried_again() {
    let mut bench = Bench::new();
    bench.stop_m[0] = -1.0;
    // The guard ends homing in the very tick.
    let failed = (0..600).any(|_| {
        bench.run(Mode::Homing, DriveState::Enabled, 1);
        bench.toes()[0] == ZeroState::Failed
    });
    assert!(failed);
    assert!(bench.toe_m[0] > 0.03 - 0.04 - 0.006, "{}", bench.toe_m[0]);
    bench.stop_m[0] = bench.toe_m[0] - 0.01;
    bench.run(Mode::Disarmed, DriveState::Ready, 10);
    bench.run(Mode::Homing, DriveState::Enabled, 1000);
    assert_eq!(bench.toes()[0], ZeroState::Known);
}

#[test]
fn every_boot_up_loses_the_zero() {
    let mut bench = Bench::new();
    bench.run(Mode::Homing, DriveState::Enabled, 600);
    bench.run(Mode::Disarmed, DriveState::Ready, 200);
    bench.operator.zeroings = 1;
    bench.tick();
    assert_eq!((bench.toes(), bench.hip().0), ([ZeroState::Known; TOES], ZeroState::Known));
    for state in [DriveState::Configuring, DriveState::Lost, DriveState::Unknown] {
        let mut again = Bench { zeros: bench.zeros.clone(), ..Bench::new() };
        again.run(Mode::Disarmed, state, 1);
        again.run(Mode::Disarmed, DriveState::Ready, 300);
        assert_eq!((again.toes(), again.hip().0), ([ZeroState::Unknown; TOES], ZeroState::Unknown), "{state:?}");
    }
}

#[test]
fn the_hip_takes_its_zero_from_a_person_at_rest_and_without_torque_only() {
    let confirm = |mode, state, moving: bool| {
        let mut bench = Bench::new();
        (bench.mode, bench.state) = (mode, state);
        for k in 0..300 {
            bench.hip_counts = 77 + if moving { k } else { 0 };
            bench.tick();
        }
        assert_eq!(bench.hip().0, ZeroState::Unknown, "nobody has confirmed");
        bench.operator.zeroings += 1;
        bench.tick();
        bench.hip()
    };
    assert_eq!(confirm(Mode::Disarmed, DriveState::Ready, false), (ZeroState::Known, 0));
    assert_eq!(confirm(Mode::Disarmed, DriveState::Ready, true).0, ZeroState::Unknown, "it moves");
    assert_eq!(confirm(Mode::Disarmed, DriveState::Enabled, false).0, ZeroState::Unknown, "it has power");
    assert_eq!(confirm(Mode::Homing, DriveState::Ready, false).0, ZeroState::Unknown);
}

#[test]
fn an_angle_that_is_told_is_the_angle_that_is_shown() {
    let mut bench = Bench::new();
    bench.run(Mode::Disarmed, DriveState::Ready, 200);
    bench.operator = OperatorSample { zeroings: 1, zero_angle_rad: 0.0349, ..OperatorSample::default() };
    bench.tick();
    // 0.0349 rad of 20000 counts in a turn are 111.09 counts.
    assert_eq!(bench.hip(), (ZeroState::Known, 111));
    bench.operator = OperatorSample { zeroings: 2, zero_angle_rad: f64::NAN, ..OperatorSample::default() };
    bench.tick();
    assert_eq!(bench.hip(), (ZeroState::Known, 111), "no number, no change");
}
