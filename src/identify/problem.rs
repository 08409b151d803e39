//! A rig and its fit recordings as a least-squares problem: what [`crate::identify::fit`] minimises.
//!
//! Shared parameters are the free numbers of the rig (those over decades as logarithms); each window has its own
//! initial state. Windows may be cut shorter than the contract's for the first stages of a fit (growing horizon):
//! full-horizon least squares from a poor guess fell into false minima in 8 of 8 runs.
//! RT: no.

use crate::identify::experiment::Recording;
use crate::identify::fit::{Bound, FreeRuns, Point, Series};
use crate::identify::rollout::{Fidelity, Linearised, Readings, Rollout};
use crate::identify::theta::{Entry, Theta};
use crate::model::effect::Role;
use crate::model::rig::{Rig, Slot};

/// A rig against recordings, its free numbers as a vector.
#[derive(Clone, Debug)]
pub struct Problem {
    /// The rig; its free numbers are replaced by those of a point.
    pub rig: Rig,
    /// What is free.
    pub theta: Theta,
    /// Which entries of `theta` are fitted as logarithms.
    pub logarithmic: Vec<bool>,
    /// Recordings, possibly with shorter windows and with samples taken out.
    pub recordings: Vec<Recording>,
    /// Recording and its own window number, of each window.
    pub windows: Vec<(usize, usize)>,
    /// How finely runs are integrated.
    pub fidelity: Fidelity,
}

/// Smallest ratio of bounds from which a positive number is fitted as a logarithm.
const DECADES: f64 = 30.0;

impl Problem {
    /// All free numbers of `rig` against `recordings`.
    #[must_use]
    pub fn new(rig: Rig, recordings: Vec<Recording>) -> Self {
        let theta = Theta::of(&rig);
        let logarithmic =
            theta.entries.iter().map(|e| is_logarithmic(&rig, e.slot, e.bounds.min, e.bounds.max)).collect();
        let windows = recordings
            .iter()
            .enumerate()
            .flat_map(|(r, recording)| (0..recording.windows().len()).map(move |w| (r, w)))
            .collect();
        Self { rig, theta, logarithmic, recordings, windows, fidelity: Fidelity::default() }
    }

    /// The same recordings with another rig.
    #[must_use]
    pub fn with_rig(&self, rig: Rig) -> Self {
        Self { fidelity: self.fidelity, ..Self::new(rig, self.recordings.clone()) }
    }

    /// The same problem with windows of at most `horizon_s`.
    #[must_use]
    pub fn with_horizon(&self, horizon_s: f64) -> Self {
        let cut = |recording: &Recording| {
            let window_s = Some(recording.window_s.map_or(horizon_s, |w| w.min(horizon_s)));
            Recording { window_s, ..recording.clone() }
        };
        Self::new(self.rig.clone(), self.recordings.iter().map(cut).collect())
    }

    /// Longest window, s.
    #[must_use]
    pub fn longest_s(&self) -> f64 {
        let length = |&(r, w): &(usize, usize)| {
            let recording = &self.recordings[r];
            let rows = &recording.windows()[w];
            recording.times[rows.end - 1] - recording.times[rows.start]
        };
        self.windows.iter().map(length).fold(0.0, f64::max)
    }

    /// Bounds of the vector.
    #[must_use]
    pub fn bounds(&self) -> Vec<Bound> {
        let one = |(entry, log): (&Entry, &bool)| {
            let to = |x: f64| if *log { libm::log(x) } else { x };
            Bound { min: to(entry.bounds.min), max: to(entry.bounds.max) }
        };
        self.theta.entries.iter().zip(&self.logarithmic).map(one).collect()
    }

    /// The vector of the rig's present numbers.
    #[must_use]
    pub fn vector(&self) -> Vec<f64> {
        let values = self.theta.values.iter().zip(&self.logarithmic);
        let inside = values.zip(self.bounds());
        inside.map(|((x, log), b)| if *log { libm::log(x.max(1e-300)) } else { *x }.clamp(b.min, b.max)).collect()
    }

    /// Numbers of the rig at a vector.
    #[must_use]
    pub fn values(&self, vector: &[f64]) -> Vec<f64> {
        vector.iter().zip(&self.logarithmic).map(|(x, log)| if *log { libm::exp(*x) } else { *x }).collect()
    }

    /// The rig at a vector.
    #[must_use]
    pub fn rig_at(&self, vector: &[f64]) -> Rig {
        Theta { values: self.values(vector), ..self.theta.clone() }.applied(&self.rig)
    }

    /// The rig's present numbers, with initial states guessed from the first samples of each window.
    #[must_use]
    pub fn start(&self) -> Point {
        let states = self.windows.iter().map(|(r, w)| self.guess(*r, *w)).collect();
        Point { parameters: self.vector(), states }
    }

    fn guess(&self, recording: usize, window: usize) -> Vec<f64> {
        Rollout::new(&self.rig, &self.recordings[recording], self.fidelity).map(|r| r.guess(window)).unwrap_or_default()
    }

    /// Brings the states of `point` to the length that this problem's rig has: new inner states start as guessed.
    #[must_use]
    pub fn adapted(&self, point: &Point) -> Vec<Vec<f64>> {
        let one = |(&(r, w), old): (&(usize, usize), &Vec<f64>)| {
            let mut state = self.guess(r, w);
            let rigid = 2 * self.degrees();
            // Coordinates and rates are shared; inner states belong to the effects of each rig.
            let kept = if old.len() == state.len() { old.len() } else { rigid.min(old.len()).min(state.len()) };
            state[..kept].copy_from_slice(&old[..kept]);
            state
        };
        self.windows.iter().zip(&point.states).map(one).collect()
    }

    /// Independent coordinates of the mechanism.
    #[must_use]
    pub fn degrees(&self) -> usize {
        self.rig.mechanism.coordinates().len().min(2)
    }

    /// Residuals of all windows at a point, per channel a list of runs without the missing samples; `None` if a run
    /// leaves the finite numbers.
    #[must_use]
    pub fn residuals(&self, at: &Point) -> Option<Vec<Vec<Vec<f64>>>> {
        let mut out = vec![Vec::new(); self.rig.sensors.len()];
        for w in 0..self.windows.len() {
            let channels = self.run(w, &at.parameters, &at.states[w], false)?;
            for (list, series) in out.iter_mut().zip(channels) {
                list.push(series.residual.into_iter().filter(|x| x.is_finite()).collect());
            }
        }
        Some(out)
    }
}

fn is_logarithmic(rig: &Rig, slot: Slot, min: f64, max: f64) -> bool {
    let shape = match slot {
        Slot::Effect(scope, e, k) => {
            rig.effects_of(scope).get(e).is_some_and(|effect| !matches!(effect.kind.keys()[k].role, Role::Strength(_)))
        }
        Slot::Parameter(..) | Slot::Gain(_) | Slot::BackEmf(_) => false,
    };
    shape && min > 0.0 && max / min > DECADES
}

impl FreeRuns for Problem {
    fn windows(&self) -> usize {
        self.windows.len()
    }

    fn run(&self, window: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>> {
        let (r, w) = self.windows[window];
        let theta = Theta { values: self.values(parameters), ..self.theta.clone() };
        let rig = theta.applied(&self.rig);
        let rollout = Rollout::new(&rig, &self.recordings[r], self.fidelity).ok()?;
        if slopes {
            let mut lin = Linearised::default();
            rollout.linearise(&theta, w, state, &mut lin).ok()?;
            let scale = |(x, log): (&f64, &bool)| if *log { *x } else { 1.0 };
            let scales: Vec<f64> = theta.values.iter().zip(&self.logarithmic).map(scale).collect();
            Some(self.unpacked(&lin, &scales))
        } else {
            let mut readings = Readings::default();
            rollout.simulate(w, state, &mut readings).ok()?;
            let rows = rollout.windows()[w].clone();
            let one = |(predicted, measured): (&Vec<f64>, &Vec<f64>)| Series {
                residual: predicted.iter().zip(&measured[rows.clone()]).map(|(p, m)| p - m).collect(),
                slopes: Vec::new(),
            };
            let out: Vec<Series> = readings.channels.iter().zip(&self.recordings[r].measured).map(one).collect();
            readings.channels.iter().all(|c| c.iter().all(|x| x.is_finite())).then_some(out)
        }
    }
}

impl Problem {
    /// One window as [`FreeRuns::run`] gives it, but differentiated only by those entries of theta that `wanted` keeps
    /// and by the initial numbers from `held` on.
    #[must_use]
    pub fn run_along(
        &self,
        window: usize,
        at: &Point,
        wanted: impl Fn(Slot) -> bool,
        held: usize,
    ) -> Option<Vec<Series>> {
        let (r, w) = self.windows[window];
        let values = self.values(&at.parameters);
        let rig = Theta { values: values.clone(), ..self.theta.clone() }.applied(&self.rig);
        let part = Theta::of_slots(&rig, wanted);
        let rollout = Rollout::new(&rig, &self.recordings[r], self.fidelity).ok()?;
        let mut lin = Linearised::default();
        rollout.linearise_beyond(held, &part, w, &at.states[window], &mut lin).ok()?;
        let index = |entry: &Entry| self.theta.index_of_slot(entry.slot);
        let scale = |i: Option<usize>| i.filter(|i| self.logarithmic[*i]).map_or(1.0, |i| values[i]);
        let scales: Vec<f64> = part.entries.iter().map(|e| scale(index(e))).collect();
        Some(self.unpacked(&lin, &scales))
    }

    /// Rows of the Jacobian as columns per channel, the first ones times `scales` (the chain rule of logarithms); sign
    /// turned to simulated minus measured.
    fn unpacked(&self, lin: &Linearised, scales: &[f64]) -> Vec<Series> {
        let channel = |c: usize| {
            let rows = c * lin.rows..(c + 1) * lin.rows;
            let slope = |j: usize| {
                let scale = scales.get(j).copied().unwrap_or(1.0);
                rows.clone().map(|r| lin.jacobian[r * lin.columns + j] * scale).collect()
            };
            Series {
                residual: lin.residual[rows.clone()].iter().map(|x| -x).collect(),
                slopes: (0..lin.columns).map(slope).collect(),
            }
        };
        (0..self.rig.sensors.len()).map(channel).collect()
    }
}
