use super::*;
use crate::design::nlp::{Nlp, Options, Outcome, solve};
use crate::design::problem::{Clearance, Cost, End, Finish, Landing, Limits, Phase, Problem, Start};
use crate::model::compass_gait::params::Params;
use crate::msg::Leg;

const LIMITS: Limits = Limits {
    hip_torque_nm: 30.0,
    compensation: 1.0,
    friction: 0.6,
    normal_force_n: 0.0,
    swing_rad: Some(0.9),
    clearance: None,
    impact: false,
};

fn phase(stance: Leg, knots: usize, end: End) -> Phase {
    Phase { stance, knots, duration_s: [0.2, 3.0], end }
}

fn gait(step_m: f64, speed_m_s: f64, knots: usize) -> Problem {
    let landing = |leg| phase(leg, knots, End::Touchdown(Landing::step(step_m)));
    Problem {
        robot: Params::sysid(),
        phases: vec![landing(Leg::Inner), landing(Leg::Outer)],
        start: Start::Periodic,
        finish: Finish::Periodic,
        total_time_s: Some(2.0 * step_m / speed_m_s),
        limits: LIMITS,
        cost: Cost::TORQUE,
    }
}

fn rebalance(step_m: f64, knots: usize) -> Problem {
    Problem {
        robot: Params::sysid(),
        phases: vec![
            phase(Leg::Inner, knots, End::Touchdown(Landing::step(step_m))),
            phase(Leg::Outer, knots, End::State([0.0; 4])),
        ],
        start: Start::State([0.0; 4]),
        finish: Finish::Free,
        total_time_s: None,
        limits: LIMITS,
        cost: Cost::TORQUE,
    }
}

#[test]
fn gradients_and_hessian_are_those_of_the_values() {
    let mut problem = gait(0.4, 0.4, 4);
    problem.cost = Cost { torque: 1.0, motor: 0.3, power: 0.2, time: 0.1 };
    problem.limits.impact = true;
    problem.limits.clearance = Some(Clearance {
        height_m: 0.02,
        retract_m: 0.02,
        rate_m_s: 0.25,
        acceleration_m_s2: 5.0,
        until_s: 0.1,
        begun_s: 0.0,
    });
    problem.phases[1].end = End::Touchdown(Landing { step_m: [0.3, 0.5], floor_m: 0.003, descent_m_s: 0.1 });
    check_derivatives(&problem);
    let mut stop = rebalance(0.3, 3);
    stop.phases[1].end = End::Rest(Landing::step(0.2));
    check_derivatives(&stop);
    stop.phases[1].end = End::Basin { centre: [0.1, 0.0, 0.2, 0.0], form: [[1.0, 0.2, 0.0, 0.0]; 4], level: 2.0 };
    check_derivatives(&stop);
}

/// Central differences of the values against the Jacobians, of the Lagrangian's gradient against the Hessian (by way
/// of a solve: with `K x = b` the product of K and x is b).
fn check_derivatives(problem: &Problem) {
    let mut program = Program::new(problem);
    let size = program.size();
    let wiggle = |k: usize| 0.1 * libm::sin(1.7 * k as f64);
    let w: Vec<f64> = guess(problem).iter().enumerate().map(|(k, x)| x + wiggle(k)).collect();
    let lambda: Vec<f64> = (0..size.m).map(|k| 0.3 + wiggle(k + 3)).collect();
    let y: Vec<f64> = (0..size.p).map(|k| 0.2 - wiggle(k + 5)).collect();
    let values = |program: &mut Program, w: &[f64]| {
        let (mut c, mut g) = (vec![0.0; size.m], vec![0.0; size.p]);
        let f = program.values(w, &mut c, &mut g);
        (f, c, g)
    };
    let lagrangian = |program: &mut Program, w: &[f64]| {
        program.linearise(w, &lambda, &y, 0.7);
        let mut out = program.cost_gradient().to_vec();
        program.add_transposed(&lambda, &y, &mut out);
        out
    };
    let h = 1e-6;
    for k in 0..size.n {
        let (mut up, mut down, mut e) = (w.clone(), w.clone(), vec![0.0; size.n]);
        (up[k], down[k], e[k]) = (up[k] + h, down[k] - h, 1.0);
        program.linearise(&w, &lambda, &y, 0.7);
        let (mut dc, mut dg) = (vec![0.0; size.m], vec![0.0; size.p]);
        program.jacobian_times(&e, &mut dc, &mut dg);
        let slope = program.cost_gradient()[k] / 0.7;
        let (a, b) = (values(&mut program, &up), values(&mut program, &down));
        assert!(((a.0 - b.0) / (2.0 * h) - slope).abs() < 1e-6, "cost by {k}");
        for i in 0..size.m {
            let difference = (a.1[i] - b.1[i]) / (2.0 * h);
            assert!((difference - dc[i]).abs() < 2e-6, "equation {i} {:?} by {k}", program.equations()[i]);
        }
        for i in 0..size.p {
            let difference = (a.2[i] - b.2[i]) / (2.0 * h);
            let scale = difference.abs().max(1.0);
            assert!((difference - dg[i]).abs() < 3e-5 * scale, "bound {i} {:?} by {k}", program.bound_names()[i]);
        }
        let (a, b) = (lagrangian(&mut program, &up), lagrangian(&mut program, &down));
        program.linearise(&w, &lambda, &y, 0.7);
        let column = program.hessian_times(&e);
        for i in 0..size.n {
            let difference = (a[i] - b[i]) / (2.0 * h);
            let scale = difference.abs().max(1.0);
            assert!((difference - column[i]).abs() < 1e-4 * scale, "Hessian {i} by {k}: {difference} {}", column[i]);
        }
    }
}

#[test]
fn periodic_gait_meets_the_reference() {
    // Section 10 of the model notes: durations and the state that the orbit starts with.
    let mut problem = gait(0.4, 0.4, 40);
    problem.limits.impact = true;
    let mut program = Program::new(&problem);
    let solved = solve(&mut program, guess(&problem), &Options::COLD);
    assert_eq!(solved.outcome, Outcome::Converged);
    let tail = &solved.at.w[solved.at.w.len() - 6..];
    for (got, want) in
        tail.iter().zip([0.841_394_6, 1.158_605_4, 0.192_575_6, -0.192_575_6, -0.740_705_6, -0.715_040_1])
    {
        assert!((got - want).abs() < 2e-6, "{got} {want}"); // printed digits, other knots
    }
}
