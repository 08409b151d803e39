//! What no recording tells explains too: the instant of a row is known to half a step of what made it, and a touchdown takes a moment
//! ([`super::touchdowns`]).
//!
//! Two simulators of one machine that hold a command, step and read in another order differ by up to half a step, and so do a drive and
//! its logger ([`crate::identify::sampling`]). Steps down to [`FINEST_STEPS_PER_ROW`] are found
//! ([`crate::diagnose::search::numerics`]); half of that step stays open. They read all angles at one instant of their step, and all rates at
//! one; so these move together, and one sensor that is late beside the others is a finding. What goes with rates (coupling, damping) they take
//! from the rates before the step or after it: that acts as late or early ([`rate_forces_later`]). Beside what those instants explain
//! an effect must still count; else an eighth of a row that is late is called a clock, a lag, a push, a drag. What is later than that
//! breaks the contract (a row is what was read at its instant, and its command acts from there on): it is a finding.
//! RT: no.

use crate::diagnose::library::candidate_fit::REFIT;
use crate::diagnose::robustness::touchdowns::touchdown_changes;
use crate::diagnose::screen::linearise::ltv_windows;
use crate::diagnose::screen::ltv::{LtvWindow, STATES, StateRow};
use crate::diagnose::screen::score_test::{Column, ScoreTest};
use crate::identify::covariance::Change;
use crate::identify::fit::{Bound, FreeRuns, Point, Series, fit};
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::identify::sampling::one_row_later;

/// Steps per row of a simulator down to which they are found.
pub const FINEST_STEPS_PER_ROW: f64 = 4.0;

/// Rows by which the instant of a reading may be off: half of the finest step.
const HALF_A_STEP: f64 = 0.5 / FINEST_STEPS_PER_ROW;

/// Changes of the predictions when all angles are read a row later, and when all rates are. A command that acts a row earlier is
/// both together.
fn readings_later(of: &FittedModel) -> Vec<Change> {
    let changes = one_row_later(&of.problem, &of.point);
    if changes.is_empty() {
        return changes;
    }
    let sensors = &of.rig.sensors;
    let together = |is_rate: bool| {
        let mut own = changes.iter().zip(sensors).filter(|(_, sensor)| sensor.is_rate == is_rate).map(|(c, _)| c);
        let first = own.next()?.clone();
        Some(own.fold(first, sum))
    };
    [false, true].into_iter().filter_map(together).collect()
}

/// Changes of the predictions when forces that go with rates follow those of a row before: an integrator that takes them from the
/// beginning of its step is half a step late with them, an implicit one early. By the tangent: over row k the rates change by
/// `(V_k - I) (v_(k+1) - v_k)` less, where `V_k` is how they carry over.
fn rate_forces_later(windows: &[LtvWindow]) -> Column {
    let of_window = |window: &LtvWindow| {
        let coordinates = window.rates.len();
        let rates = coordinates.min(STATES / 2);
        let rate = |k: usize, i: usize| window.states[k].get(coordinates + i).copied().unwrap_or(0.0);
        let mut out = vec![Vec::with_capacity(window.rows()); window.output.len()];
        let mut x = StateRow::zeros();
        for k in 0..window.rows() {
            for (channel, row) in out.iter_mut().zip(&window.output) {
                channel.push(row.dot(&x));
            }
            let Some(phi) = window.phi.get(k).filter(|_| k + 1 < window.rows()) else { continue };
            x = phi * x;
            for i in 0..rates {
                let carried = |j: usize| phi[(rates + i, rates + j)] - if i == j { 1.0 } else { 0.0 };
                x[rates + i] -= (0..rates).map(|j| carried(j) * (rate(k + 1, j) - rate(k, j))).sum::<f64>();
            }
        }
        out
    };
    windows.iter().map(of_window).collect()
}

/// Two changes at the same time.
fn sum(mut all: Change, other: &Change) -> Change {
    let channels = all.iter_mut().flatten().zip(other.iter().flatten());
    channels.for_each(|(a, b)| a.iter_mut().zip(b).for_each(|(x, y)| *x += y));
    all
}

/// By how much `richer` gains more than `plain` when the instants of both are free within their rows. `gain`: with instants as
/// they are. `only`: the recording of an event, each window of which has instants of its own: what happens once is told from
/// what is late once. `touchdown_s`: how long a touchdown may take. Linear around both; what is more than `least` then is fitted, but
/// for an event.
#[must_use]
pub fn gain_beside_instants(
    plain: &FittedModel,
    richer: &FittedModel,
    (gain, least): (f64, f64),
    only: Option<&str>,
    touchdown_s: f64,
) -> f64 {
    let noise = &richer.noise;
    let free = |of| FreeInstants::around(of, &ltv_windows(of).unwrap_or_default(), touchdown_s);
    let moved = [plain, richer].map(|of| (of, free(of)));
    let [of_plain, of_richer] = moved.each_ref().map(|(of, (free, _))| explained_by_instants(of, free, noise, only));
    let linear = gain - of_plain + of_richer;
    if linear <= least || only.is_some() {
        return linear;
    }
    let [without, with] = moved.map(|(_, (free, start))| cost_beside_instants(&free, start, noise));
    without.zip(with).map_or(linear, |(without, with)| without - with)
}

/// What is left, in twice the negative log-likelihood but for a constant, when instants and touchdowns are fitted too.
fn cost_beside_instants(free: &FreeInstants, start: Point, noise: &[Colour]) -> Option<f64> {
    let bounds = [free.problem.bounds(), free.bounds()].concat();
    let cost = fit(free, start, &bounds, noise, REFIT).cost;
    cost.is_finite().then_some(cost)
}

/// Rise of twice the log-likelihood of `of` under `noise` when readings move within their rows and touchdowns take their moment.
fn explained_by_instants(of: &FittedModel, free: &FreeInstants, noise: &[Colour], only: Option<&str>) -> f64 {
    let (changes, touchdowns) = free.changes.split_at(free.within_a_row);
    if changes.is_empty() {
        return 0.0;
    }
    let Some(screen) = ScoreTest::new(&of.problem, &of.point, noise) else { return 0.0 };
    let windows = of.problem.windows.len();
    let own: Vec<usize> =
        (0..windows).filter(|w| only == Some(of.problem.recordings[of.problem.windows[*w].0].name.as_str())).collect();
    let nothing: Column = vec![Vec::new(); windows];
    let alone = |change: &Change, w: usize| -> Column {
        let mut column = nothing.clone();
        column[w].clone_from(&change[w]);
        column
    };
    let others = |change: &Change| -> Column {
        let of_window = |w: usize| if own.contains(&w) { Vec::new() } else { change[w].clone() };
        (0..windows).map(of_window).collect()
    };
    let apart = changes.iter().flat_map(|change| own.iter().map(|w| alone(change, *w)));
    let columns: Vec<Column> =
        std::iter::once(nothing.clone()).chain(changes.iter().map(others)).chain(apart).collect();
    let mut bounds = vec![(-HALF_A_STEP, HALF_A_STEP); columns.len() - 1];
    bounds.extend(touchdowns.iter().map(|_| (-1.0, 1.0)));
    screen.promise(&[&columns[..], touchdowns].concat(), &[], &bounds).max(0.0)
}

/// A problem in which the predictions move by changes whose sizes are fitted as well: the instants of readings and of forces that go with
/// rates within their rows, in rows, then the states after touchdowns, once either way.
pub struct FreeInstants<'p> {
    problem: &'p Problem,
    changes: Vec<Change>,
    within_a_row: usize,
}

impl<'p> FreeInstants<'p> {
    /// Around the fit `of`, and where that stands. `tangent`: of `of`; empty if there is none. `touchdown_s`: how long a touchdown may
    /// take.
    #[must_use]
    pub fn around(of: &'p FittedModel, tangent: &[LtvWindow], touchdown_s: f64) -> (Self, Point) {
        let mut changes = readings_later(of);
        if !tangent.is_empty() {
            changes.push(rate_forces_later(tangent));
        }
        let within_a_row = changes.len();
        changes.extend(touchdown_changes(of, tangent, touchdown_s));
        let parameters = [&of.point.parameters[..], &vec![0.0; changes.len()]].concat();
        (Self { problem: &of.problem, changes, within_a_row }, Point { parameters, states: of.point.states.clone() })
    }

    /// Of the sizes of the changes.
    fn bounds(&self) -> Vec<Bound> {
        let most = |i: usize| if i < self.within_a_row { HALF_A_STEP } else { 1.0 };
        (0..self.changes.len()).map(|i| Bound { min: -most(i), max: most(i) }).collect()
    }
}

impl FreeRuns for FreeInstants<'_> {
    fn windows(&self) -> usize {
        self.problem.windows.len()
    }

    fn run(&self, window: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>> {
        let shared = parameters.len() - self.changes.len();
        let (own, sizes) = parameters.split_at(shared);
        let mut out = self.problem.run(window, own, state, slopes)?;
        for (c, series) in out.iter_mut().enumerate() {
            let of_channel = |change: &Change| change[window].get(c).cloned().unwrap_or_default();
            for (change, size) in self.changes.iter().zip(sizes).filter(|(_, size)| **size != 0.0) {
                for (residual, by) in series.residual.iter_mut().zip(of_channel(change)) {
                    *residual += size * by;
                }
            }
            if slopes {
                let rows = series.residual.len();
                let slope = |change: &Change| {
                    let mut slope = of_channel(change);
                    slope.resize(rows, 0.0);
                    slope
                };
                series.slopes.splice(shared..shared, self.changes.iter().map(slope));
            }
        }
        Some(out)
    }

    fn reach(&self, index: usize) -> f64 {
        if index < self.problem.logarithmic.len() { self.problem.reach(index) } else { f64::INFINITY }
    }

    fn is_exhausted(&self) -> bool {
        self.problem.is_exhausted()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::library::worked::hiding;
    use crate::diagnose::screen::ltv::tests::mass;
    use crate::identify::experiment::Recording;
    use crate::identify::fit::Limits;
    use crate::identify::synthesis::record;
    use crate::model::rig::Rig;

    const LATE: &str = "[[effect]]\neffect = \"sensor_delay\"\nat = \"y\"\ndelay = ";
    const DRAG: &str = "[[effect]]\neffect = \"quadratic_drag\"\nat = \"q1\"\nquadratic = ";

    /// What `effect` gains over the machine as given, alone and beside the instants; rows of 10 ms.
    fn gains(hidden: &str, effect: &str) -> (f64, f64) {
        let problem = hiding(hidden);
        let (plain, richer) = (problem.fitted("", 20), problem.fitted(effect, 20));
        let total = |h: &FittedModel| -> f64 { h.blocks(&richer.noise).iter().sum() };
        let gain = total(&richer) - total(&plain);
        (gain, gain_beside_instants(&plain, &richer, (gain, 0.0), None, 0.01))
    }

    #[test]
    fn a_reading_that_is_late_by_a_tenth_of_a_row_is_no_finding_and_by_four_tenths_it_is_one() {
        let late = format!("{LATE}{{ value = 0.002, min = 0.0, max = 0.1 }}\n");
        let (gain, beside) = gains(&format!("{LATE}0.001\n"), &late);
        assert!(gain > 10.0 && beside.abs() < 0.05 * gain, "{gain} {beside}");
        let (gain, beside) = gains(&format!("{LATE}0.004\n"), &late);
        assert!(gain > 100.0 && beside > 0.3 * gain, "{gain} {beside}");
    }

    /// A pendulum with an encoder on either side of its shaft, of which `late` are 1 ms late: what that delay gains over the machine as
    /// given, alone and beside the instants.
    fn gains_of_two(late: &[&str]) -> (f64, f64) {
        let rig = "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = 0.4\n\
            [[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.3\n\
            [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\nnoise_std = 0.001\n\
            [[sensor]]\nmeasures = \"q1\"\ncolumn = \"z\"\nnoise_std = 0.001\n";
        let delays = |value: &str| -> String {
            late.iter()
                .map(|at| format!("[[effect]]\neffect = \"sensor_delay\"\nat = \"{at}\"\ndelay = {value}\n"))
                .collect()
        };
        let parsed = |text: &str| Rig::parse(&format!("{rig}{text}"), "rig.toml").unwrap();
        let times: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.01).collect();
        let input = times.iter().map(|t| libm::sin(9.0 * t)).collect();
        let blank = Recording::new("a.csv", times, vec![input], vec![vec![0.0; 200]; 2]);
        let measured = record(&parsed(&delays("0.001")), &blank, &[0.3, 0.0], Some(7)).unwrap().measured;
        let fitted = |text: &str| {
            let problem = Problem::new(parsed(text), vec![Recording { measured: measured.clone(), ..blank.clone() }]);
            let (noise, limits) =
                ([Colour::white(0.001), Colour::white(0.001)], Limits { iterations: 20, tolerance: 1e-7 });
            FittedModel::fitted(problem.clone(), problem.start(), &noise, &[1e-5; 2], limits).unwrap()
        };
        let (plain, richer) = (fitted(""), fitted(&delays("{ value = 0.002, min = 0.0, max = 0.1 }")));
        let total = |h: &FittedModel| -> f64 { h.blocks(&richer.noise).iter().sum() };
        let gain = total(&richer) - total(&plain);
        (gain, gain_beside_instants(&plain, &richer, (gain, 0.0), None, 0.01))
    }

    #[test]
    fn one_sensor_that_is_late_beside_the_other_is_a_finding_and_both_alike_are_none() {
        let (gain, beside) = gains_of_two(&["y"]);
        assert!(gain > 100.0 && beside > 0.3 * gain, "{gain} {beside}");
        let (gain, beside) = gains_of_two(&["y", "z"]);
        assert!(gain > 100.0 && beside.abs() < 0.05 * gain, "{gain} {beside}");
    }

    /// A mass with a damper, `v' = -d v`, rows of 10 ms, that tells its rate.
    #[test]
    fn forces_half_a_row_late_are_what_an_explicit_euler_step_a_row_makes_of_a_damper() {
        let (d, h) = (2.0_f64, 0.01_f64);
        let carries = libm::exp(-d * h);
        let v = |k: usize| libm::exp(-d * h * k as f64);
        let mut damped = mass();
        damped.states = (0..100).map(|k| vec![(1.0 - v(k)) / d, v(k)]).collect();
        damped.phi.iter_mut().for_each(|phi| {
            phi[(0, 1)] = (1.0 - carries) / d;
            phi[(1, 1)] = carries;
        });
        damped.output = damped.rates.clone();
        let change = rate_forces_later(&[damped]).remove(0).remove(0);
        for k in [1, 50, 99] {
            let euler = libm::pow(1.0 - d * h, k as f64);
            assert!((0.5 * change[k] / (euler - v(k)) - 1.0).abs() < 0.03, "{k}: {} {}", 0.5 * change[k], euler - v(k));
        }
    }

    #[test]
    fn what_no_instant_explains_keeps_its_gain() {
        let drag = format!("{DRAG}{{ value = 0.001, min = 0.0, max = 0.1 }}\n");
        let (gain, beside) = gains(&format!("{DRAG}0.004\n"), &drag);
        assert!(gain > 100.0 && beside > 0.5 * gain, "{gain} {beside}");
    }
}
