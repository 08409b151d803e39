//! What re-fitted parameters and initial states can absorb: the part of a hidden effect that remains visible is its
//! detectability. Gauss-Newton with finite differences on the generator's own machine. RT: no.

use nalgebra::{DMatrix, DVector};

use super::experiment::{Physics, Recording, free_run};
use super::machine::State;
use super::rig::Kind;

/// Most Gauss-Newton rounds; one that brings less than this part is the last.
const ROUNDS: usize = 12;
const BRINGS: f64 = 0.02;
/// The same for a refit that starts from afar and is compared to a few deviations of noise.
const ROUNDS_FAR: usize = 40;
const BRINGS_FAR: f64 = 0.002;
/// A step that goes uphill is halved at most so often.
const HALVINGS: u8 = 3;
/// A parameter changes at most by this factor per round.
const STRIDE: f64 = 1.5;

/// Base values (and values of an extra effect) that are free, and the initial states that go with them.
#[derive(Debug, Clone)]
pub(super) struct Fit {
    /// Physics with the values found.
    pub physics: Physics,
    /// Initial state per recording and window.
    pub starts: Vec<Vec<State>>,
    /// Σ ((measured - simulated) / noise)² over all rows.
    pub chi2: f64,
}

/// A free value: of the base by name, or of the extra effect by key.
#[derive(Debug, Clone)]
enum Free {
    Base(String),
    Extra(&'static str),
}

fn free_values(physics: &Physics) -> Vec<Free> {
    let base = physics.rig.uncertain.iter().cloned().map(Free::Base);
    let extra = physics
        .effects
        .iter()
        .flat_map(|effect| effect.values.keys().filter(|key| is_free(key)).map(|key| Free::Extra(key)));
    base.chain(extra).collect()
}

/// Numbers of an effect that are facts of the machine are not fitted.
fn is_free(key: &str) -> bool {
    !matches!(key, "whole" | "lever" | "order")
}

fn scaled(physics: &Physics, free: &Free, factor: f64) -> Physics {
    let mut other = physics.clone();
    match free {
        Free::Base(name) => {
            if let Some(value) = other.rig.values.get_mut(name) {
                *value *= factor;
            }
        }
        Free::Extra(key) => {
            for value in other.effects.iter_mut().filter_map(|effect| effect.values.get_mut(key)) {
                *value *= factor;
            }
        }
    }
    other
}

/// One window with its sensitivities; rows of all sensors stacked, divided by their noise.
struct Block {
    residual: DVector<f64>,
    states: DMatrix<f64>,
    values: DMatrix<f64>,
}

/// A window's readings over the noise, stacked.
fn stacked(physics: &Physics, readings: &[Vec<f64>]) -> DVector<f64> {
    let each = readings.iter().zip(&physics.rig.sensors);
    DVector::from_iterator(
        readings.iter().map(Vec::len).sum(),
        each.flat_map(|(signal, sensor)| {
            let sigma = libm::sqrt(sensor.noise * sensor.noise + sensor.quantum * sensor.quantum / 12.0);
            signal.iter().map(move |value| value / sigma)
        }),
    )
}

fn measured(recording: &Recording, signals: &[Vec<f64>], window: usize) -> Vec<Vec<f64>> {
    let rows = recording.windows[window].clone();
    signals.iter().map(|signal| signal[rows.clone()].to_vec()).collect()
}

fn nudged(start: &State, entry: usize, by: f64) -> State {
    let mut other = *start;
    other.y[entry] += by;
    other
}

/// Entries of the state that are free: coordinates and rates.
fn state_entries(physics: &Physics) -> &'static [usize] {
    if physics.rig.joints.len() > 1 || physics.rig.sensors.iter().any(|s| s.row[1] != 0.0) {
        &[0, 1, 2, 3]
    } else {
        &[0, 2]
    }
}

fn block(
    physics: &Physics,
    recording: &Recording,
    signals: &[Vec<f64>],
    window: usize,
    start: State,
    free: &[Free],
) -> Block {
    let simulate = |physics: &Physics, start: State| stacked(physics, &free_run(physics, recording, window, start));
    let now = simulate(physics, start);
    let (tiny, relative) = (1e-5, 1e-4);
    let by_state =
        state_entries(physics).iter().map(|entry| (simulate(physics, nudged(&start, *entry, tiny)) - &now) / tiny);
    // Derivative with respect to the logarithm of a value.
    let by_value = free.iter().map(|f| (simulate(&scaled(physics, f, 1.0 + relative), start) - &now) / relative);
    let (states, values): (Vec<_>, Vec<_>) = (by_state.collect(), by_value.collect());
    let values = if values.is_empty() { DMatrix::zeros(now.len(), 0) } else { DMatrix::from_columns(&values) };
    let residual = stacked(physics, &measured(recording, signals, window)) - &now;
    Block { residual, states: DMatrix::from_columns(&states), values }
}

/// `(JᵀJ)⁻¹ Jᵀ b` with a ridge of 1e-9 of the diagonal against columns that say the same.
fn least_squares(j: &DMatrix<f64>, b: &DMatrix<f64>) -> DMatrix<f64> {
    let mut normal = j.tr_mul(j);
    for i in 0..normal.nrows() {
        normal[(i, i)] += 1e-9 * normal[(i, i)] + 1e-12;
    }
    let right = j.tr_mul(b);
    normal.cholesky().map_or_else(|| DMatrix::zeros(j.ncols(), b.ncols()), |factor| factor.solve(&right))
}

impl Block {
    /// Residual and value sensitivities that no initial state can absorb.
    fn without_states(&self) -> (DMatrix<f64>, DMatrix<f64>) {
        let residual = DMatrix::from_columns(std::slice::from_ref(&self.residual));
        let left = |m: &DMatrix<f64>| m - &self.states * least_squares(&self.states, m);
        (left(&residual), left(&self.values))
    }
}

/// Stacked normal equations of all blocks: step of the values and what remains.
fn value_step(blocks: &[Block], count: usize) -> (DMatrix<f64>, f64) {
    let (mut normal, mut right, mut energy) = (DMatrix::zeros(count, count), DMatrix::zeros(count, 1), 0.0);
    for block in blocks {
        let (residual, values) = block.without_states();
        normal += values.tr_mul(&values);
        right += values.tr_mul(&residual);
        energy += residual.norm_squared();
    }
    for i in 0..count {
        normal[(i, i)] += 1e-9 * normal[(i, i)] + 1e-12;
    }
    let step = normal.cholesky().map_or_else(|| DMatrix::zeros(count, 1), |factor| factor.solve(&right));
    let gained = right.tr_mul(&step);
    (step.clone(), energy - if count > 0 { gained[(0, 0)] } else { 0.0 })
}

fn blocks(
    physics: &Physics,
    recordings: &[&Recording],
    signals: &[&[Vec<f64>]],
    starts: &[Vec<State>],
    free: &[Free],
) -> Vec<Block> {
    let mut all = Vec::new();
    for ((recording, signals), starts) in recordings.iter().zip(signals).zip(starts) {
        for (window, start) in starts.iter().enumerate() {
            all.push(block(physics, recording, signals, window, *start, free));
        }
    }
    all
}

fn starts_of(recordings: &[&Recording]) -> Vec<Vec<State>> {
    recordings.iter().map(|recording| recording.starts.clone()).collect()
}

/// What remains visible of `signals` after one linear re-fit of values and initial states.
pub(super) fn detectability(physics: &Physics, recordings: &[&Recording], signals: &[&[Vec<f64>]]) -> f64 {
    let free = free_values(physics);
    value_step(&blocks(physics, recordings, signals, &starts_of(recordings), &free), free.len()).1
}

/// Re-fits the free values (`values` false: only the initial states) to `signals`.
pub(super) fn refit(physics: &Physics, recordings: &[&Recording], signals: &[&[Vec<f64>]], values: bool) -> Fit {
    let free = if values { free_values(physics) } else { Vec::new() };
    fitted(physics, recordings, signals, &free, Care { seats: false, rounds: ROUNDS, brings: BRINGS })
}

/// Re-fits all free values, and where that halts each window by itself: slower, for what decides.
pub(super) fn refit_well(physics: &Physics, recordings: &[&Recording], signals: &[&[Vec<f64>]]) -> Fit {
    fitted(physics, recordings, signals, &free_values(physics), Care { seats: true, rounds: ROUNDS, brings: BRINGS })
}

/// Re-fits all free values from afar, to the last digit that counts.
pub(super) fn refit_far(physics: &Physics, recordings: &[&Recording], signals: &[&[Vec<f64>]]) -> Fit {
    let care = Care { seats: false, rounds: ROUNDS_FAR, brings: BRINGS_FAR };
    fitted(physics, recordings, signals, &free_values(physics), care)
}

/// How much is done for a refit: windows seated for themselves, rounds, and what one must bring.
struct Care {
    seats: bool,
    rounds: usize,
    brings: f64,
}

fn fitted(physics: &Physics, recordings: &[&Recording], signals: &[&[Vec<f64>]], free: &[Free], care: Care) -> Fit {
    let mut fit = Fit { physics: physics.clone(), starts: starts_of(recordings), chi2: f64::INFINITY };
    let mut here = blocks(&fit.physics, recordings, signals, &fit.starts, free);
    fit.chi2 = energy(&here);
    for _ in 0..care.rounds {
        let (step, _) = value_step(&here, free.len());
        let stepped = (0..=HALVINGS).find_map(|halved| {
            let next = moved(&fit, &here, &(&step * libm::exp2(-f64::from(halved))), free);
            lower(next, &fit, recordings, signals)
        });
        let walks = physics.rig.kind == Kind::Walker;
        let stuck = care.seats && (walks || stepped.as_ref().is_none_or(|next| next.chi2 > (1.0 - BRINGS) * fit.chi2));
        let mut next = stepped.unwrap_or_else(|| fit.clone());
        if stuck {
            seat(&mut next, recordings, signals);
        }
        let Some(next) = lower(next, &fit, recordings, signals) else { break };
        let is_last = next.chi2 > (1.0 - care.brings) * fit.chi2;
        fit = next;
        if is_last {
            break;
        }
        here = blocks(&fit.physics, recordings, signals, &fit.starts, free);
    }
    fit
}

/// `next` with its misfit, if that is below the one of `now`.
fn lower(mut next: Fit, now: &Fit, recordings: &[&Recording], signals: &[&[Vec<f64>]]) -> Option<Fit> {
    next.chi2 = energy(&blocks(&next.physics, recordings, signals, &next.starts, &[]));
    (next.chi2 < now.chi2).then_some(next)
}

fn energy(blocks: &[Block]) -> f64 {
    blocks.iter().map(|block| block.residual.norm_squared()).sum()
}

/// `fit` moved by `step` of its values, its initial states following.
fn moved(fit: &Fit, blocks: &[Block], step: &DMatrix<f64>, free: &[Free]) -> Fit {
    let mut next = fit.clone();
    for (i, free) in free.iter().enumerate() {
        let factor = libm::exp(step[(i, 0)]).clamp(1.0 / STRIDE, STRIDE);
        next.physics = scaled(&next.physics, free, factor);
    }
    move_starts(&mut next, blocks, step);
    next
}

/// Steps of one window's initial state by itself.
const SEATINGS: usize = 3;

/// Each window's initial state for itself: where feet land one window has edges, and would hold up all the others.
fn seat(fit: &mut Fit, recordings: &[&Recording], signals: &[&[Vec<f64>]]) {
    let entries = state_entries(&fit.physics);
    for ((recording, signals), starts) in recordings.iter().zip(signals).zip(&mut fit.starts) {
        for (window, start) in starts.iter_mut().enumerate() {
            let look = |start: State| block(&fit.physics, recording, signals, window, start, &[]);
            let mut here = look(*start);
            for _ in 0..SEATINGS {
                let step = least_squares(&here.states, &DMatrix::from_columns(std::slice::from_ref(&here.residual)));
                let tried = (0..=HALVINGS).find_map(|halved| {
                    let mut next = *start;
                    for (i, entry) in entries.iter().enumerate() {
                        next.y[*entry] += step[(i, 0)] * libm::exp2(-f64::from(halved));
                    }
                    let there = look(next);
                    (there.residual.norm_squared() < (1.0 - BRINGS) * here.residual.norm_squared())
                        .then_some((next, there))
                });
                let Some(better) = tried else { break };
                (*start, here) = better;
            }
        }
    }
}

fn move_starts(fit: &mut Fit, blocks: &[Block], step: &DMatrix<f64>) {
    let entries = state_entries(&fit.physics);
    for (start, block) in fit.starts.iter_mut().flatten().zip(blocks) {
        let left = DMatrix::from_columns(std::slice::from_ref(&block.residual)) - &block.values * step;
        let moved = least_squares(&block.states, &left);
        for (i, entry) in entries.iter().enumerate() {
            start.y[*entry] += moved[(i, 0)];
        }
    }
}
