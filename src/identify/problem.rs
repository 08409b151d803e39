//! A rig and its fit recordings as a least-squares problem: what [`crate::identify::fit`] minimises.
//!
//! Shared parameters are the free numbers of the rig (those over decades as logarithms); each window has its own
//! initial state. Windows may be cut shorter than the contract's for the first stages of a fit (growing horizon):
//! full-horizon least squares from a poor guess fell into false minima in 8 of 8 runs.
//! RT: no.

use crate::identify::effort::Effort;
use crate::identify::experiment::Recording;
use crate::identify::fit::{Bound, FreeRuns, Point, Series};
use crate::identify::noise::Colour;
use crate::identify::rollout::{Fidelity, Linearised, Readings, Rollout};
use crate::identify::theta::{Entry, Theta};
use crate::model::effect::Role;
use crate::model::rig::{Rig, Slot};
use crate::model::setting::Setting;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

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
    pub recordings: Arc<Vec<Recording>>,
    /// The rig as it holds for each recording.
    pub settings: Vec<Setting>,
    /// Recording and its own window number, of each window.
    pub windows: Vec<(usize, usize)>,
    /// Rows of each window within its recording.
    pub spans: Vec<Range<usize>>,
    /// How finely runs are integrated.
    pub fidelity: Fidelity,
    /// What runs of this problem and of all that come from it have cost.
    pub effort: Arc<Effort>,
    /// Longest memory of noise that is believed, in samples: what is slower is mismatch.
    pub longest_memory: f64,
}

/// Smallest ratio of bounds from which a positive number is fitted as a logarithm.
const DECADES: f64 = 30.0;

impl Problem {
    /// All free numbers of `rig` against `recordings`.
    #[must_use]
    pub fn new(rig: Rig, recordings: Vec<Recording>) -> Self {
        Self::shared(rig, Arc::new(recordings))
    }

    fn shared(rig: Rig, recordings: Arc<Vec<Recording>>) -> Self {
        let theta = Theta::of(&rig);
        let logarithmic =
            theta.entries.iter().map(|e| is_logarithmic(&rig, e.slot, e.bounds.min, e.bounds.max)).collect();
        let settings = recordings.iter().map(|r| Setting::of(&rig, Some(r.index), r.setup)).collect();
        let (mut windows, mut spans) = (Vec::new(), Vec::new());
        for (r, recording) in recordings.iter().enumerate() {
            for (w, rows) in recording.windows().into_iter().enumerate() {
                windows.push((r, w));
                spans.push(rows);
            }
        }
        Self {
            rig,
            theta,
            logarithmic,
            recordings,
            settings,
            windows,
            spans,
            fidelity: Fidelity::default(),
            effort: Arc::default(),
            longest_memory: f64::INFINITY,
        }
    }

    /// The same windows with another rig.
    #[must_use]
    pub fn with_rig(&self, rig: Rig) -> Self {
        let (windows, spans, effort) = (self.windows.clone(), self.spans.clone(), Arc::clone(&self.effort));
        let (fidelity, longest_memory) = (self.fidelity, self.longest_memory);
        let same = Self::shared(rig, Arc::clone(&self.recordings));
        Self { fidelity, windows, spans, effort, longest_memory, ..same }
    }

    /// The same, counting for itself up to `most`; [`Self::is_exhausted`](FreeRuns::is_exhausted) then.
    #[must_use]
    pub fn with_allowance(self, most: u64) -> Self {
        Self { effort: Arc::new(Effort::of_at_most(most)), ..self }
    }

    /// What comes of work with these windows that may cost `most`; what it costs is counted here. How far windows were when they gave
    /// up is chance; the effort that is told is not.
    pub fn at_most<T>(&self, most: u64, work: impl FnOnce(&Self) -> T) -> T {
        let limited = self.clone().with_allowance(most);
        let done = work(&limited);
        self.effort.add(limited.effort.spent().min(limited.effort.patience()));
        done
    }

    /// The same with some of the windows.
    #[must_use]
    pub fn on_windows(&self, kept: &[usize]) -> Self {
        let windows = kept.iter().map(|w| self.windows[*w]).collect();
        let spans = kept.iter().map(|w| self.spans[*w].clone()).collect();
        Self { windows, spans, ..self.clone() }
    }

    /// The same problem with windows of at most `horizon_s`.
    #[must_use]
    pub fn with_horizon(&self, horizon_s: f64) -> Self {
        let shorter = |recording: &Recording| {
            let window_s = Some(recording.window_s.map_or(horizon_s, |w| w.min(horizon_s)));
            Recording { window_s, ..recording.clone() }
        };
        let cut = Self::new(self.rig.clone(), self.recordings.iter().map(shorter).collect());
        Self { effort: Arc::clone(&self.effort), longest_memory: self.longest_memory, ..cut }
    }

    /// Longest window, s.
    #[must_use]
    pub fn longest_s(&self) -> f64 {
        let length = |((r, _), rows): (&(usize, usize), &Range<usize>)| {
            let times = &self.recordings[*r].times;
            times[rows.end - 1] - times[rows.start]
        };
        self.windows.iter().zip(&self.spans).map(length).fold(0.0, f64::max)
    }

    /// Longest time from the start of a recording's first window to the end of its last, s.
    #[must_use]
    pub fn longest_recording_s(&self) -> f64 {
        let ends = |((r, _), rows): (&(usize, usize), &Range<usize>)| {
            let times = &self.recordings[*r].times;
            (*r, times[rows.start], times[rows.end - 1])
        };
        let all: Vec<(usize, f64, f64)> = self.windows.iter().zip(&self.spans).map(ends).collect();
        let until = |(r, from, _): &(usize, f64, f64)| {
            all.iter().filter(|(other, ..)| other == r).map(|(.., to)| to - from).fold(0.0, f64::max)
        };
        all.iter().map(until).fold(0.0, f64::max)
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
        let states = (0..self.windows.len()).map(|w| self.guess(w)).collect();
        Point { parameters: self.vector(), states }
    }

    /// The initial state of one window, sought by itself: from the guess, on horizons that grow, with probes; as a prediction
    /// is made. `None` if the run fails.
    #[must_use]
    pub fn sought(&self, window: usize, at: &Point, noise: &[Colour]) -> Option<Vec<f64>> {
        let theta = Theta { values: self.values(&at.parameters), ..self.theta.clone() };
        let rollout = self.rollout(window, &theta);
        let weights: Vec<f64> = noise.iter().map(|c| 1.0 / c.sigma).collect();
        rollout.fit_initial(0, &weights, &rollout.guess(0)).ok()
    }

    fn guess(&self, window: usize) -> Vec<f64> {
        self.rollout(window, &self.theta).guess(0)
    }

    /// The free run of one window with the numbers of `theta`.
    fn rollout(&self, window: usize, theta: &Theta) -> Rollout<'_> {
        let r = self.windows[window].0;
        Rollout::of_window(&self.settings[r], theta, &self.recordings[r], self.spans[window].clone(), self.fidelity)
            .counted(&self.effort)
    }

    /// How many numbers of one window's state are coordinates and rates (a set-up may hold a leg); inner states follow.
    #[must_use]
    pub fn rigid(&self, window: usize) -> usize {
        self.rollout(window, &self.theta).rigid_len()
    }

    /// Where the run of one window from `state` is when the next one starts; `None` at the end of a recording, or if it fails.
    #[must_use]
    pub fn arrived(&self, window: usize, parameters: &[f64], state: &[f64]) -> Option<Vec<f64>> {
        let theta = Theta { values: self.values(parameters), ..self.theta.clone() };
        self.rollout(window, &theta).arrived(0, state).ok()?
    }

    /// What each sensor reads in the run of one window, missing samples as well; `None` if the run fails.
    #[must_use]
    pub fn readings(&self, window: usize, at: &Point) -> Option<Vec<Vec<f64>>> {
        let theta = Theta { values: self.values(&at.parameters), ..self.theta.clone() };
        let mut out = Readings::default();
        self.rollout(window, &theta).simulate(0, &at.states[window], &mut out).ok()?;
        out.channels.iter().flatten().all(|y| y.is_finite()).then_some(out.channels)
    }

    /// Brings the states of `point` to the length that this problem's rig has: new inner states start as guessed.
    #[must_use]
    pub fn adapted(&self, point: &Point) -> Vec<Vec<f64>> {
        let one = |(w, old): (usize, &Vec<f64>)| {
            let mut state = self.guess(w);
            let rigid = 2 * self.degrees();
            // Coordinates and rates are shared; inner states belong to the effects of each rig.
            let kept = if old.len() == state.len() { old.len() } else { rigid.min(old.len()).min(state.len()) };
            state[..kept].copy_from_slice(&old[..kept]);
            state
        };
        point.states.iter().enumerate().map(one).collect()
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
        let one = |w: usize| self.run(w, &at.parameters, &at.states[w], false);
        let windows: Vec<Vec<Series>> = (0..self.windows.len()).into_par_iter().map(one).collect::<Option<_>>()?;
        let mut out = vec![Vec::with_capacity(windows.len()); self.rig.sensors.len()];
        for channels in windows {
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

#[cfg(test)]
impl Problem {
    /// For tests: a rig with one actuator, shaken by a sine for 2 s, and 200 samples of its one sensor.
    pub(crate) fn shaken(rig: &str, window_s: Option<f64>, measured: Vec<f64>) -> Self {
        let times: Vec<f64> = (0..200).map(|k| f64::from(k) * 0.01).collect();
        let input = times.iter().map(|t| libm::sin(9.0 * t)).collect();
        let recording = Recording { window_s, ..Recording::new("a.csv", times, vec![input], vec![measured]) };
        Self::new(Rig::parse(rig, "rig.toml").unwrap(), vec![recording])
    }
}

/// A logarithm moves by a factor of ten a step at most: no tangent says more, and a spring a thousand times stiffer costs
/// thirty times the run that shows that it is wrong.
const LOG_REACH: f64 = std::f64::consts::LN_10;

impl FreeRuns for Problem {
    fn windows(&self) -> usize {
        self.windows.len()
    }

    fn reach(&self, index: usize) -> f64 {
        if self.logarithmic[index] { LOG_REACH } else { f64::INFINITY }
    }

    fn is_exhausted(&self) -> bool {
        self.effort.is_exhausted()
    }

    fn run(&self, window: usize, parameters: &[f64], state: &[f64], slopes: bool) -> Option<Vec<Series>> {
        let theta = Theta { values: self.values(parameters), ..self.theta.clone() };
        let rollout = self.rollout(window, &theta);
        if slopes {
            let mut lin = Linearised::default();
            rollout.linearise(&theta, 0, state, &mut lin).ok()?;
            let scale = |(x, log): (&f64, &bool)| if *log { *x } else { 1.0 };
            let scales: Vec<f64> = theta.values.iter().zip(&self.logarithmic).map(scale).collect();
            Some(self.unpacked(&lin, &scales))
        } else {
            let mut readings = Readings::default();
            rollout.simulate(0, state, &mut readings).ok()?;
            let rows = self.spans[window].clone();
            let one = |(predicted, measured): (&Vec<f64>, &Vec<f64>)| Series {
                residual: predicted.iter().zip(&measured[rows.clone()]).map(|(p, m)| p - m).collect(),
                slopes: Vec::new(),
            };
            let measured = &self.recordings[self.windows[window].0].measured;
            let out: Vec<Series> = readings.channels.iter().zip(measured).map(one).collect();
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
        let values = self.values(&at.parameters);
        let theta = Theta { values: values.clone(), ..self.theta.clone() };
        let part = Theta::of_slots(&self.rig, wanted);
        let mut lin = Linearised::default();
        self.rollout(window, &theta).linearise_beyond(held, &part, 0, &at.states[window], &mut lin).ok()?;
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
