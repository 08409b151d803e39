//! What a touchdown that takes a moment explains: the model's impact is over at once, no foot's and no simulator's is.
//!
//! While a contact builds up its force the legs still move as before it, and what pushes them goes on pushing. So the state
//! after a touchdown is known to what some milliseconds make of it: the angles to what the change of the rates makes, the rates to
//! what the accelerations make. Beside that an effect must still count, as it must beside instants
//! ([`super::instants`]); else a soft contact is called a rebound, a slip, a slope.
//! RT: no.

use crate::diagnose::screen::ltv::{LtvWindow, StateRow};
use crate::diagnose::screen::score_test::Column;
use crate::identify::fitted_model::FittedModel;

/// Numbers of a leg pair's state: two angles, two rates.
const STATE: usize = 4;

/// Changes of the predictions when one number of the state after one touchdown moves by what `touchdown_s` makes of it: for
/// each touchdown that was recorded and each number. No two touchdowns take the same moment.
pub(super) fn touchdown_changes(of: &FittedModel, windows: &[LtvWindow], touchdown_s: f64) -> Vec<Column> {
    let recordings = &of.problem.recordings;
    if recordings.iter().all(|r| r.stance.is_empty()) {
        return Vec::new();
    }
    let joints = of.rig.mechanism.coordinates().len();
    let of_window = |(w, window): (usize, &LtvWindow)| -> Vec<Column> {
        let stance = recordings[window.recording].stance.get(of.problem.spans[w].clone()).unwrap_or_default();
        let touchdowns = (1..stance.len().min(window.rows())).filter(|k| stance[*k] != stance[k - 1]);
        let moves = touchdowns.flat_map(|k| (0..STATE).map(move |number| (k, number)));
        let column = |(k, number): (usize, usize)| {
            let mut column: Column = vec![Vec::new(); windows.len()];
            column[w] = moved_from(window, k, number, by_a_moment(window, k, joints, number) * touchdown_s);
            column
        };
        moves.map(column).collect()
    };
    windows.iter().enumerate().flat_map(of_window).collect()
}

/// Readings of one window when `number` of the state moves by `by` at row `k`.
fn moved_from(window: &LtvWindow, k: usize, number: usize, by: f64) -> Vec<Vec<f64>> {
    let mut out = vec![vec![0.0; k]; window.output.len()];
    let mut x = StateRow::zeros();
    x[number] = by;
    for phi in window.phi.iter().skip(k).take(window.rows() - k) {
        for (channel, row) in out.iter_mut().zip(&window.output) {
            channel.push(row.dot(&x));
        }
        x = phi * x;
    }
    out
}

/// How fast `number` of the state is wrong while a touchdown lasts that is over before row `k`: an angle by what its rate changes, a
/// rate by how it changes without the impact.
fn by_a_moment(window: &LtvWindow, k: usize, joints: usize, number: usize) -> f64 {
    let (leg, is_rate) = (number % 2, number >= 2);
    let rate = |row: usize| window.states[row].get(joints + leg).copied().unwrap_or(0.0);
    if !is_rate {
        return rate(k - 1) - rate(k);
    }
    let slope =
        |from: usize, to: usize| (rate(to) - rate(from)) / (window.t_s[to] - window.t_s[from]).max(f64::MIN_POSITIVE);
    let before = if k >= 2 { slope(k - 2, k - 1).abs() } else { 0.0 };
    let after = if k + 1 < window.rows() { slope(k, k + 1).abs() } else { 0.0 };
    before.max(after)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::linearise::ltv_windows;
    use crate::diagnose::screen::ltv::tests::mass;
    use crate::identify::experiment::Recording;
    use crate::identify::fitted_model::FittedModel;
    use crate::identify::problem::Problem;
    use crate::model::rig::{Rig, Setup};
    use nalgebra::DMatrix;

    const WALKER: &str = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
        gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = { value = 0.1434, min = 0.07, max = 0.3 }\nc3 = 0.000596\nc4 = 0.1151\n\
        c5 = 0.1264\nc6 = 0.0026\n[[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n\
        [[sensor]]\nmeasures = \"inner\"\ncolumn = \"inner_rad\"\n[[sensor]]\nmeasures = \"hip\"\ncolumn = \"hip_rad\"\n";

    fn changes_of(walk: &FittedModel) -> Vec<Column> {
        touchdown_changes(walk, &ltv_windows(walk).unwrap(), 0.01)
    }

    /// A robot that falls forwards onto its other leg in mid-recording; rows of 4 ms.
    fn walk(stance: Vec<u8>) -> FittedModel {
        let times: Vec<f64> = (0..60).map(|k| f64::from(k) * 0.004).collect();
        let measured = vec![vec![0.0; 60]; 2];
        let still = vec![vec![0.0; 60]];
        let recording =
            Recording { stance, setup: Some(Setup::Walk), ..Recording::new("a.csv", times, still, measured) };
        let problem = Problem::new(Rig::parse(WALKER, "rig.toml").unwrap(), vec![recording]);
        let mut point = problem.start();
        point.states[0] = vec![-0.12, 0.12, -0.6, 0.3];
        FittedModel::at(problem, point, DMatrix::zeros(1, 1), &[1e-3, 1e-3]).unwrap()
    }

    #[test]
    fn a_rate_that_moves_in_mid_window_moves_what_is_read_after_it() {
        let y = moved_from(&mass(), 50, 1, 2.0);
        assert!(y[0].len() == 100 && y[0][50] == 0.0 && (y[0][99] - 0.98).abs() < 1e-12, "{}", y[0][99]);
        assert!((moved_from(&mass(), 50, 0, 2.0)[0][50] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn each_touchdown_may_move_each_number_of_the_state_and_nothing_before_it() {
        let changed_at = |k: usize| (0..60).map(|row| u8::from(row >= k)).collect();
        let changes = changes_of(&walk(changed_at(30)));
        assert_eq!(changes.len(), STATE);
        for change in &changes {
            let before = change[0].iter().flat_map(|channel| &channel[..30]);
            assert!(before.copied().all(|y| y == 0.0));
            assert!(change[0].iter().flatten().any(|y| *y != 0.0), "something after it");
        }
        assert!(changes_of(&walk(changed_at(60))).is_empty(), "no touchdown");
        assert!(changes_of(&walk(Vec::new())).is_empty(), "none that was recorded");
    }

    #[test]
    fn an_angle_is_off_by_what_its_rate_changes_in_ten_milliseconds() {
        let of = walk((0..60).map(|row| u8::from(row >= 30)).collect());
        let [window] = &ltv_windows(&of).unwrap()[..] else { panic!() };
        let joints = of.rig.mechanism.coordinates().len();
        let rate = |row: usize| window.states[row][joints];
        let inner_after = changes_of(&of)[0][0][0][30];
        assert!((inner_after - 0.01 * (rate(29) - rate(30))).abs() < 1e-12, "{inner_after}");
    }
}
