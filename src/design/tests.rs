use super::problem::{End, Problem};
use super::solve::{Effort, Failure, Solution, plan};
use super::tasks::Terms;
use crate::model::compass_gait::dynamics::friction;
use crate::model::compass_gait::impact;
use crate::model::compass_gait::params::Params;
use crate::msg::Leg;

fn terms() -> Terms {
    Terms::plain(Params::sysid())
}

fn solved(problem: &Problem) -> Solution {
    plan(problem, Effort { coarse: 12, fine: Some(40) }).unwrap()
}

fn peak_nm(solution: &Solution) -> f64 {
    let torques = solution.trajectory.arcs.iter().flat_map(|arc| &arc.torques);
    torques.fold(0.0, |peak: f64, x| peak.max(x.abs())) * Params::sysid().inertia_kg_m2()
}

/// Positive work of the motor, friction compensation included, J.
fn work_j(solution: &Solution) -> f64 {
    let robot = Params::sysid().normalised();
    let mut sum = 0.0;
    for arc in &solution.trajectory.arcs {
        let steps = 4000;
        let h = arc.duration_s / f64::from(steps);
        for k in 0..steps {
            let t = (f64::from(k) + 0.5) * h;
            let x = arc.state(t);
            let rate = x[2] - x[3];
            sum += h * ((arc.torque(t) - friction(&robot, rate)) * rate).max(0.0);
        }
    }
    sum * Params::sysid().inertia_kg_m2()
}

/// Energy that the impacts take, J.
fn loss_j(solution: &Solution) -> f64 {
    let robot = Params::sysid();
    let mut sum = 0.0;
    for arc in &solution.trajectory.arcs {
        let params = if arc.stance == Leg::Inner { robot } else { robot.swapped() };
        let x = arc.states[arc.states.len() - 1];
        let y = impact::step(&params.normalised(), &x).unwrap();
        sum +=
            params.energy_j([x[0], x[1]], [x[2], x[3]])[0] - params.swapped().energy_j([y[0], y[1]], [y[2], y[3]])[0];
    }
    sum
}

#[test]
fn gaits_meet_the_table_of_the_model_notes() {
    // step, speed, T inner, T outer, peak Nm, positive work J, impact loss J (section 8), to their printed digits.
    for [step, speed, inner, outer, peak, work, loss] in [
        [0.3, 0.3, 0.857, 1.143, 5.8, 4.7, 1.3],
        [0.4, 0.4, 0.841, 1.159, 9.6, 10.8, 4.6],
        [0.4, 0.5, 0.736, 0.864, 23.9, 11.1, 4.0],
        [0.3, 0.4, 0.697, 0.803, 16.1, 5.1, 1.2],
    ] {
        let gait = solved(&terms().gait(step, speed));
        let durations = [gait.trajectory.arcs[0].duration_s, gait.trajectory.arcs[1].duration_s];
        assert!((durations[0] - inner).abs() < 6e-4 && (durations[1] - outer).abs() < 6e-4, "{durations:?}");
        let figures = [peak_nm(&gait), work_j(&gait), loss_j(&gait)];
        for (got, want) in figures.iter().zip([peak, work, loss]) {
            assert!((got - want).abs() < 0.06, "{step} {speed}: {figures:?}");
        }
    }
}

#[test]
fn one_step_rebalance_meets_the_reference_and_works_from_both_legs() {
    let inner = solved(&terms().rebalance(Leg::Inner, [0.0; 4], [0.3, 0.3]));
    let durations = [inner.trajectory.arcs[0].duration_s, inner.trajectory.arcs[1].duration_s];
    assert!((durations[0] - 0.923).abs() < 6e-4 && (durations[1] - 1.169).abs() < 6e-4, "{durations:?}");
    assert!((peak_nm(&inner) - 7.5).abs() < 0.06);
    for leg in [Leg::Inner, Leg::Outer] {
        for step in [0.2, 0.6] {
            solved(&terms().rebalance(leg, [0.0; 4], [step, step]));
        }
    }
}

#[test]
fn planned_states_are_what_the_planned_torque_does() {
    let gait = solved(&terms().gait(0.4, 0.4));
    let arcs = &gait.trajectory.arcs;
    for arc in arcs {
        assert!(arc.defect(20) < 1e-7, "{:e}", arc.defect(20)); // order h⁵ of 40 knots
    }
    let robot = Params::sysid();
    let end = |k: usize| arcs[k].states[arcs[k].states.len() - 1];
    let after = impact::step(&robot.swapped().normalised(), &end(1)).unwrap();
    for i in 0..4 {
        assert!((after[i] - arcs[0].states[0][i]).abs() < 1e-8, "periodic");
    }
}

#[test]
fn standing_joins_the_gait_changes_its_speed_and_stops_on_both_feet() {
    let slow = solved(&terms().gait(0.4, 0.4));
    let fast = solved(&terms().gait(0.4, 0.5));
    let entry = |gait: &Solution, leg: usize| gait.trajectory.arcs[leg].states[0];
    solved(&terms().join(Leg::Outer, [0.0; 4], 1, [0.1, 0.5], entry(&slow, 0)));
    solved(&terms().join(Leg::Inner, entry(&slow, 0), 2, [0.1, 0.5], entry(&fast, 0)));
    let stop = solved(&terms().stop(Leg::Inner, entry(&slow, 0), 3, [0.1, 0.5]));
    let last = stop.trajectory.arcs.last().unwrap();
    let x = last.states.last().unwrap();
    assert!((x[0] + x[1]).abs() < 1e-8 && x[0] < 0.0);
}

#[test]
fn what_cannot_be_done_is_named() {
    let Err(Failure::Infeasible(blocked)) = plan(&terms().gait(0.4, 1.2), Effort::COARSE) else { panic!("feasible?") };
    assert!(blocked.iter().any(|v| v.what.contains("total time (speed)") && v.value > 0.02 && v.unit == "s"));
    // 0.2 rad of tilt is beyond what any controller recovers with 30 Nm (section 8).
    let fallen = terms().reach(Leg::Inner, [0.2, 0.0, 0.0, 0.0], End::State([0.0; 4]));
    assert!(matches!(plan(&fallen, Effort::COARSE), Err(Failure::Infeasible(blocked)) if !blocked.is_empty()));
}
