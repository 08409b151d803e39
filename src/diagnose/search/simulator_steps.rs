//! Which steps the simulator took that made a recording, if one did.
//!
//! A simulator that takes forces from the beginning of a step as long as a row is off by what such a step makes of the machine: in two
//! links that whirl that is more than most effects of the library do, and half a row ([`crate::diagnose::robustness::instants`]) is but its first
//! order. No machine steps. So the scheme is a number like any other of the simulation: the likeliest is taken, exact integration unless
//! another is more than chance.
//! RT: no.

use crate::diagnose::judge::criterion::{Context, compare, detection_threshold};
use crate::diagnose::search::candidate_fit::REFIT;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::white;
use rayon::prelude::*;

/// Steps per row that are tried. The error of a step goes with its length: what lies between is nearly one of these.
const PER_ROW: [f64; 3] = [1.0, 2.0, 4.0];

/// `of` fitted again in the steps that these recordings show; `None` if it has them.
#[must_use]
pub fn in_likeliest_steps(of: &FittedModel, context: &Context) -> Option<FittedModel> {
    let row_s = shortest_row_s(of)?;
    let schemes: Vec<Option<f64>> =
        std::iter::once(None).chain(PER_ROW.map(|n| Some(row_s / n))).filter(|s| *s != of.rig.euler_step_s).collect();
    let fits: Vec<FittedModel> = schemes.into_par_iter().filter_map(|s| in_steps(of, s, context)).collect();
    let gain = |fit: &FittedModel| compare(fit, of, context).total;
    let best = fits.into_iter().max_by(|a, b| a.likelihood.total_cmp(&b.likelihood))?;
    (gain(&best) > detection_threshold(context, 1)).then_some(best)
}

/// `of` fitted again in steps of `euler_step_s`; `None`: integrated exactly.
#[must_use]
pub fn in_steps(of: &FittedModel, euler_step_s: Option<f64>, context: &Context) -> Option<FittedModel> {
    let mut rig = of.rig.clone();
    rig.euler_step_s = euler_step_s;
    let (problem, start) = of.extended(rig);
    let noise = white(&of.residuals, &context.floors);
    let first = FittedModel::fitted(problem, start, &noise, &context.floors, Limits::default())?;
    let finer = first.polished(&first.noise, &context.floors, REFIT);
    Some(finer.filter(|finer| finer.likelihood > first.likelihood).unwrap_or(first))
}

/// The usual time from row to row in the recording that has the shortest, s.
fn shortest_row_s(of: &FittedModel) -> Option<f64> {
    let usual = |times: &[f64]| {
        let mut steps: Vec<f64> = times.windows(2).map(|pair| pair[1] - pair[0]).collect();
        steps.sort_unstable_by(f64::total_cmp);
        steps.get(steps.len() / 2).copied()
    };
    of.problem.recordings.iter().filter_map(|r| usual(&r.times)).min_by(f64::total_cmp)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::identify::experiment::Recording;
    use crate::identify::noise::Colour;
    use crate::identify::problem::Problem;
    use crate::identify::synthesis::record;
    use crate::model::rig::Rig;

    /// Two links that whirl, rows of 10 ms, recorded in steps of `euler_step_s`, fitted in exact ones.
    fn fitted_exactly(euler_step_s: Option<f64>) -> (FittedModel, Context) {
        let links = |moment2: &str| {
            let text = format!(
                "schema = 1\nmechanism = \"double_pendulum\"\n[parameters]\ninertia1_kg_m2 = 0.02\ninertia2_kg_m2 = 0.055\n\
                 moment1_kg_m = 0.07\nmoment2_kg_m = {moment2}\nmass2_kg = 1.1\nlength1_m = 0.25\ngravity_m_s2 = 9.81\n\
                 [[sensor]]\nmeasures = \"q1\"\ncolumn = \"q1_rad\"\n[[sensor]]\nmeasures = \"q2\"\ncolumn = \"q2_rad\"\n"
            );
            Rig::parse(&text, "rig.toml").unwrap()
        };
        let times: Vec<f64> = (0..150).map(|k| f64::from(k) * 0.01).collect();
        let mut recording = Recording::new("a.csv", times, Vec::new(), vec![Vec::new(); 2]);
        let truth = Rig { euler_step_s, ..links("0.2") };
        recording.measured = record(&truth, &recording, &[1.2, -0.4, 0.0, 0.0], None).unwrap().measured;
        let context = Context {
            floors: vec![1e-3; 2],
            samples: 300,
            given: 0,
            is_trapped: false,
            seed: 1,
            ledger: Ledger::default(),
            held_out: None,
        };
        let problem = Problem::new(links("{ value = 0.205, min = 0.1, max = 0.3 }"), vec![recording]);
        let (start, noise) = (problem.start(), [Colour::white(0.01), Colour::white(0.01)]);
        (FittedModel::fitted(problem, start, &noise, &context.floors, Limits::default()).unwrap(), context)
    }

    #[test]
    fn steps_of_a_simulator_are_found_and_exact_motion_stays_exact() {
        for step_s in [0.01, 0.005] {
            let (of, context) = fitted_exactly(Some(step_s));
            let found = in_likeliest_steps(&of, &context).unwrap();
            assert!((found.rig.euler_step_s.unwrap() / step_s - 1.0).abs() < 1e-9);
            let moment2 = found.problem.values(&found.point.parameters)[0];
            assert!((moment2 / 0.2 - 1.0).abs() < 1e-3, "{moment2}");
            assert!(in_likeliest_steps(&found, &context).is_none(), "they are its own");
        }
        let (of, context) = fitted_exactly(None);
        assert!(in_likeliest_steps(&of, &context).is_none());
    }
}
