//! Cost of free runs: 60 s of 1 kHz rows, elastic hip of the compass gait (six states), plain and with 8 directions.
//!
//! Goal: at most 30 ms plain and 150 ms with 8 directions on one core.
#![expect(clippy::expect_used, reason = "a bench stops at the first surprise")]

use compass::base::scalar::{Dual, Scalar};
use compass::model::machine::Machine;
use compass::model::rig::{Rig, Setup};
use compass::model::setting::{Number, Setting};
use criterion::{Criterion, criterion_group, criterion_main};
use std::hint::black_box;
use std::time::Duration;

const RIG: &str = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
    gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = 0.1434\nc3 = 0.000596\nc4 = 0.1151\nc5 = 0.1264\nc6 = 0.0026\n\
    [[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"inner\"\ncolumn = \"y\"\n\
    [[effect]]\neffect = \"viscous_friction\"\nat = \"hip\"\nviscous = 0.7\n\
    [[effect]]\neffect = \"coulomb_friction\"\nat = \"hip\"\ncoulomb = 0.5\n\
    [[effect]]\neffect = \"parallel_spring\"\nat = \"inner\"\nstiffness = 250.0\nrest = 0.0\n";
const ELASTIC: &str = "[[effect]]\neffect = \"joint_elasticity\"\nat = \"hip\"\nstiffness = 377.0\ndamping = 0.2\n\
    rotor_inertia = 0.09\n";
const ROWS: u32 = 60_000;

/// One run; the result keeps the optimiser honest.
fn run<S: Scalar>(setting: &Setting, lift: &dyn Fn(&Number) -> S) -> f64 {
    let mut machine = Machine::<S>::new(setting, lift, 1).expect("the rig of this bench is complete");
    machine.reset(0.0, &[S::constant(0.1), S::constant(-0.2)]);
    let mut sum = 0.0;
    for k in 0..ROWS {
        let t = f64::from(k) * 1e-3;
        machine.advance_to(t).expect("springs hold the robot");
        sum += machine.read(0).value();
        machine.command(0, 5.0 * (3.0 * t).sin(), true);
    }
    sum
}

fn rollout(c: &mut Criterion) {
    let mut group = c.benchmark_group("60 s x 1 kHz");
    group.sample_size(10).measurement_time(Duration::from_secs(3)).warm_up_time(Duration::from_millis(500));
    for (name, text) in [("4 states", RIG.to_owned()), ("6 states", format!("{RIG}{ELASTIC}"))] {
        let rig = Rig::parse(&text, "bench").expect("the rig of this bench parses");
        let setting = Setting::of(&rig, None, Some(Setup::InnerStance));
        let slots: Vec<_> = setting.slots().collect();
        let lift = |n: &Number| match slots.iter().position(|s| Some(*s) == n.slot) {
            Some(lane) if lane < 8 => Dual::<8>::variable(n.value, lane),
            _ => Dual::constant(n.value),
        };
        group.bench_function(format!("{name}, plain"), |b| b.iter(|| run::<f64>(black_box(&setting), &|n| n.value)));
        group
            .bench_function(format!("{name}, 8 directions"), |b| b.iter(|| run::<Dual<8>>(black_box(&setting), &lift)));
    }
    group.finish();
}

criterion_group!(benches, rollout);
criterion_main!(benches);
