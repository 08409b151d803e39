//! The numerical floor: what predictions change by when every step is four times shorter.
//!
//! An effect that explains less than a few times this explains the integrator. RT: no.

use crate::identify::fit::{FreeRuns, Point, Series};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::identify::rollout::Fidelity;
use rayon::prelude::*;

/// Steps of the comparison are this many times shorter. The error of RK4 falls by 256, that of a badly stepped kink by 4.
const FINER: u32 = 4;
/// A floor above this part of the noise is told to the user: three times it may no longer be called negligible.
const NEGLIGIBLE: f64 = 0.3;

/// Root mean square of the change per channel, over all windows of `problem` at `at`; `None` if a run leaves the finite
/// numbers.
#[must_use]
pub fn numerical_floor(problem: &Problem, at: &Point) -> Option<Vec<f64>> {
    let fidelity = Fidelity { refine: problem.fidelity.refine * FINER };
    let finer = Problem { fidelity, ..problem.clone() };
    // Squares and samples of each channel of a window.
    let one = |(window, state): (usize, &Vec<f64>)| {
        let coarse = problem.run(window, &at.parameters, state, false)?;
        let fine = finer.run(window, &at.parameters, state, false)?;
        let squares = |(coarse, fine): (&Series, &Series)| {
            let present = coarse.residual.iter().zip(&fine.residual).filter(|(a, _)| a.is_finite());
            present.fold((0.0, 0), |(sum, count), (a, b)| (sum + (a - b) * (a - b), count + 1))
        };
        Some(coarse.iter().zip(&fine).map(squares).collect())
    };
    let windows: Vec<Vec<(f64, usize)>> = at.states.par_iter().enumerate().map(one).collect::<Option<_>>()?;
    let channel = |c: usize| {
        let of = windows.iter().map(|window| window[c]);
        let (sum, count) = of.fold((0.0, 0), |(sum, count), (more, samples)| (sum + more, count + samples));
        if count > 0 { libm::sqrt(sum / count as f64) } else { 0.0 }
    };
    Some((0..problem.rig.sensors.len()).map(channel).collect())
}

/// A sentence per channel whose numerical floor is not negligible beside its noise.
#[must_use]
pub fn complaints(problem: &Problem, at: &Point, noise: &[Colour]) -> Vec<String> {
    // Coarse steps that the rig asks for are meant.
    if problem.rig.numerics.euler_step_s.is_some() {
        return Vec::new();
    }
    let Some(floor) = numerical_floor(problem, at) else {
        return vec!["the simulation diverges with shorter steps: do not trust small effects".to_owned()];
    };
    let channels = problem.rig.sensors.iter().zip(floor).zip(noise);
    let loud = channels.filter(|((_, floor), colour)| colour.sigma.is_finite() && *floor > NEGLIGIBLE * colour.sigma);
    loud.map(|((sensor, floor), colour)| {
        format!(
            "{}: shorter steps of the simulation change the prediction by {floor:.2e} (noise {:.2e}): do not trust \
             effects of that size",
            sensor.column, colour.sigma
        )
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::identify::experiment::Recording;
    use crate::model::rig::Rig;

    fn swinging(gravity: f64) -> Problem {
        let text = format!(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = 0.01\ngravity_nm = {gravity}\n\
             [[sensor]]\nmeasures = \"q1\"\ncolumn = \"y\"\n"
        );
        let times = (0..400).map(|k| f64::from(k) * 0.01).collect();
        let recording = Recording::new("free.csv", times, Vec::new(), vec![vec![0.0; 400]]);
        Problem::new(Rig::parse(&text, "free").unwrap(), vec![recording])
    }

    #[test]
    fn slow_swing_is_far_above_the_floor_and_the_floor_is_not_nothing() {
        let problem = swinging(0.1);
        let at = Point { parameters: Vec::new(), states: vec![vec![0.5, 0.0]] };
        let floor = numerical_floor(&problem, &at).unwrap()[0];
        assert!(floor > 1e-12 && floor < 1e-6, "{floor}");
        assert!(complaints(&problem, &at, &[Colour::white(1e-4)]).is_empty());
        assert_eq!(complaints(&problem, &at, &[Colour::white(floor)]).len(), 1);
    }
}
