//! Moving toes against MuJoCo: flow, force of the ground, landing and impulse.
//!
//! The numbers come from `tests/oracle/toes.py`, whose head says how to make them anew; they do not come from this code.

use super::*;
use crate::model::rig::{Rig, Setup};
use crate::model::setting::{Number, Setting};

const NUMBERS: &str = include_str!("../../../tests/data/toes_mujoco.csv");
/// As in the script.
const WALKER: &str = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
    gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = 0.1434\nc3 = 0.000596\nc4 = 0.1151\nc5 = 0.1264\nc6 = 0.0026\n\
    [[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"inner\"\ncolumn = \"y\"\n";

/// A motion of the script: its torque, and from when each toe has which acceleration of what its leg is shorter.
struct Case {
    name: &'static str,
    stance: usize,
    start: [f64; 4],
    short_m: [f64; 2],
    torque_nm: fn(f64) -> f64,
    toes: &'static [(f64, [f64; 2])],
}

const CASES: [Case; 2] = [
    Case {
        name: "push_off",
        stance: 0,
        start: [0.16, -0.2, -0.95, 1.6],
        short_m: [0.015, 0.04],
        torque_nm: |t| if t < 0.15 { -4.0 } else { 6.0 },
        toes: &[(0.0, [0.0, 0.0]), (0.1, [-5.0, 0.0]), (0.12, [5.0, 0.0]), (0.14, [0.0, -5.0]), (0.16, [0.0, 0.0])],
    },
    Case {
        name: "give_way",
        stance: 1,
        start: [-0.15, 0.13, 1.6, -0.9],
        short_m: [0.02, 0.0],
        torque_nm: |t| if t < 0.1 { 3.0 } else { -5.0 },
        toes: &[(0.0, [5.0, 5.0]), (0.03, [-5.0, -5.0]), (0.06, [0.0, 0.0]), (0.2, [-5.0, 0.0]), (0.23, [0.0, 0.0])],
    },
];

impl Case {
    fn machine(&self, eliminates: bool) -> Machine<f64> {
        let rig = Rig::parse(WALKER, "test").unwrap();
        let setting = Setting::of(&rig, None, Some(Setup::Walk));
        let mut m = Machine::new(&setting, &|n: &Number| n.value, 1).unwrap();
        m.plant.keeps_constraints = !eliminates;
        m.give_toes(self.short_m).unwrap();
        m.set_stance(self.stance);
        m.reset(0.0, &self.start);
        m
    }

    /// Commands for the millisecond from `t`.
    fn command(&self, m: &mut Machine<f64>, t: f64) {
        let (_, acceleration) = self.toes.iter().rev().find(|(since, _)| t >= since - 1e-9).unwrap();
        let toes = m.toes();
        m.set_toes([0, 1].map(|leg| ToeMotion {
            short_m: toes[leg][0],
            rate_m_s: toes[leg][1],
            acceleration_m_s2: acceleration[leg],
        }));
        m.command(0, (self.torque_nm)(t), true);
    }

    fn rows(&self, kind: &str) -> Vec<Vec<f64>> {
        let mine = NUMBERS.lines().map(|line| line.split(',').collect::<Vec<_>>());
        let mine = mine.filter(|cells| cells[0] == self.name && cells[1] == kind);
        mine.map(|cells| cells[2..].iter().filter_map(|cell| cell.parse().ok()).collect()).collect()
    }
}

fn near(ours: &[f64], theirs: &[f64], tolerance: f64, what: &str) {
    for (a, b) in ours.iter().zip(theirs) {
        assert!((a - b).abs() < tolerance, "{what}: {ours:?}, MuJoCo {theirs:?}");
    }
}

/// Nine decimals are stored. RK4 at 1 ms is exact to 1e-9 here; the motion makes that and the rounding grow tenfold.
const STATE: f64 = 2e-8;
/// A force per 15 kg and m: the same, times some 100 N a rad.
const FORCE_N: f64 = 5e-6;

#[test]
fn toes_on_slides_move_load_and_land_as_in_mujoco() {
    for (case, eliminates) in CASES.iter().flat_map(|case| [(case, true), (case, false)]) {
        let mut m = case.machine(eliminates);
        let (flow, landing) = (case.rows("flow"), case.rows("landing").remove(0));
        assert!(flow.len() >= 8, "{}", case.name);
        for k in 0_u32.. {
            let t = f64::from(k) * 1e-3;
            case.command(&mut m, t);
            if let Some(row) = flow.iter().find(|row| (row[0] - t).abs() < 1e-9) {
                let what = format!("{} at {t} s", case.name);
                let state = [m.coordinate(0), m.coordinate(1), m.rate(0), m.rate(1)];
                near(&state, &row[1..5], STATE, &what);
                near(&m.ground_force(), &row[5..7], FORCE_N, &what);
            }
            m.advance_to((t + 1e-3).min(landing[0])).unwrap();
            if t + 1e-3 >= landing[0] {
                break;
            }
        }
        // The last digit of the landing's time is 1 ns; it lands within two of them.
        m.advance_to(landing[0] + 1e-8).unwrap();
        let (count, at_s) = m.touchdowns();
        assert!(count == 1 && (at_s - landing[0]).abs() < STATE, "{} {count} {at_s}", case.name);
        let strike = m.last_strike();
        near(&[m.coordinate(0), m.coordinate(1), m.rate(0), m.rate(1)], &landing[1..5], 1e-6, "after the landing");
        near(&strike.impulse_ns, &landing[5..7], 1e-6, "impulse");
        near(&strike.velocity_m_s, &landing[7..9], 1e-6, "landing speed");
    }
}
