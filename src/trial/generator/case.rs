//! One case: a rig, programs, perhaps hidden effects at a drawn visibility, concealed at one of five levels. RT: no.

use super::dice::{Dice, NoiseKind, noise};
use super::draw;
use super::effect::{Effect, OUTSIDE};
use super::experiment::{COARSE, Physics, ROW_S, Recording, record};
use super::program::{self, Program};
use super::refit::{detectability, refit, refit_well};
use super::rig::{self, Kind, Rig};
use super::twins;

/// Two recordings are fitted, one is held out.
const RECORDINGS: usize = 3;
/// Draws of an effect before another one is tried.
const TRIES: usize = 6;
/// Visibility of hidden effects, in squared noise deviations that a re-fit leaves: log-evenly between these.
const VISIBILITY: [f64; 2] = [4e3, 4e5];
/// Beside a second effect each must leave this much by itself: less is below what coloured noise can imitate.
const FAINT: f64 = 1e3;

/// How an effect is concealed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Level {
    /// True parameters are published.
    True,
    /// They are off by up to 20 %.
    Off,
    /// They are re-fitted to the recordings, so that they hide the effect.
    Refitted,
    /// Re-fitted; closed loop, low excitation.
    Gentle,
    /// Re-fitted; a second effect, or outliers, or lost rows.
    Crowded,
}

impl Level {
    const ALL: [Self; 5] = [Self::True, Self::Off, Self::Refitted, Self::Gentle, Self::Crowded];

    /// Name on the design page.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::True => "C0",
            Self::Off => "C1",
            Self::Refitted => "C2",
            Self::Gentle => "C3",
            Self::Crowded => "C4",
        }
    }
}

/// What makes the recordings worse without being physics.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Nuisance {
    /// Part of the readings that are 20 noise deviations off.
    pub outliers: f64,
    /// Part of the rows whose readings are missing.
    pub dropouts: f64,
}

/// A complete case with its truth.
pub(super) struct Case {
    /// Rig with true values and what is hidden.
    pub physics: Physics,
    /// Values as published.
    pub published: Rig,
    /// Level of concealment.
    pub level: Level,
    /// Recordings with the truth of every row.
    pub recordings: Vec<Recording>,
    /// Readings as written: noise, grid; NaN for a missing one.
    pub readings: Vec<Vec<Vec<f64>>>,
    /// For each effect the answers that are right: id and place.
    pub accepted: Vec<Vec<(String, String)>>,
    /// Visibility of the hidden effects together, after a whole re-fit.
    pub visibility: f64,
    /// Per held-out sensor: re-fitted and floor, as part of the deviation of its signal.
    pub heldout: Vec<[f64; 2]>,
    /// Kind of noise.
    pub noise: NoiseKind,
    /// Nuisances.
    pub nuisance: Nuisance,
}

/// What a trial is asked for.
#[derive(Debug, Clone, Copy)]
pub struct Recipe {
    /// Rows per recording, 2.5 ms each.
    pub rows: usize,
    /// `Some(true)`: only healthy cases; `Some(false)`: only effects; `None`: a third healthy.
    pub healthy: Option<bool>,
}

/// Draws one case.
pub(super) fn draw(dice: &mut Dice, recipe: Recipe) -> Case {
    let healthy = recipe.healthy.unwrap_or_else(|| dice.chance(1.0 / 3.0));
    let kinds = [
        Kind::Pendulum,
        Kind::Pendulum,
        Kind::Rotor,
        Kind::Slider,
        Kind::Double,
        Kind::Biped,
        Kind::Walker,
        Kind::Walker,
    ];
    loop {
        let kind = *dice.pick(&kinds);
        let rig = rig::draw(dice, kind);
        let level = if healthy { *dice.pick(&Level::ALL[..2]) } else { *dice.pick(&Level::ALL) };
        let programs: Vec<Vec<Program>> =
            (0..RECORDINGS).map(|_| program::draw(dice, &rig, level == Level::Gentle)).collect();
        let lab = Lab { rig, programs, rows: recipe.rows };
        if let Some(effects) = hide(dice, &lab, level, healthy) {
            return finish(dice, &lab, level, effects);
        }
    }
}

/// A rig and how it is excited.
pub(super) struct Lab {
    /// Rig.
    pub rig: Rig,
    /// Per recording and joint.
    pub programs: Vec<Vec<Program>>,
    /// Rows per recording.
    pub rows: usize,
}

impl Lab {
    /// The rig with these effects.
    pub(super) fn physics(&self, effects: &[Effect]) -> Physics {
        Physics { rig: self.rig.clone(), effects: effects.to_vec(), coarse: 1.0 }
    }

    /// The same for estimates.
    pub(super) fn rough(&self, effects: &[Effect]) -> Physics {
        Physics { coarse: COARSE, ..self.physics(effects) }
    }

    fn record(&self, physics: &Physics) -> Vec<Recording> {
        let one = |(i, programs): (usize, &Vec<Program>)| record(physics, programs, i, i + 1 == RECORDINGS, self.rows);
        self.programs.iter().enumerate().map(one).collect()
    }

    /// Squared noise deviations that re-fitting the healthy base leaves of these effects.
    pub(super) fn visibility(&self, effects: &[Effect]) -> f64 {
        self.left_by(&[], effects)
    }

    /// The same after a whole re-fit instead of its first step: what may be asked of a diagnosis.
    fn remains(&self, effects: &[Effect]) -> f64 {
        self.remains_beside(&[], effects)
    }

    /// The same where the base knows of some effects.
    fn remains_beside(&self, known: &[Effect], effects: &[Effect]) -> f64 {
        let recordings = self.roughly_fitted(effects);
        let fit: Vec<&Recording> = recordings.iter().collect();
        let signals: Vec<&[Vec<f64>]> = fit.iter().map(|r| r.clean.as_slice()).collect();
        refit_well(&self.rough(known), &fit, &signals).chi2.min(self.left_by(known, effects))
    }

    /// What re-fitting the base with `known` leaves of `effects`.
    pub(super) fn left_by(&self, known: &[Effect], effects: &[Effect]) -> f64 {
        let recordings = self.roughly_fitted(effects);
        let fit: Vec<&Recording> = recordings.iter().collect();
        let signals: Vec<&[Vec<f64>]> = fit.iter().map(|r| r.clean.as_slice()).collect();
        detectability(&self.rough(known), &fit, &signals)
    }

    /// The recordings that are fitted, for estimates.
    pub(super) fn roughly_fitted(&self, effects: &[Effect]) -> Vec<Recording> {
        let physics = self.rough(effects);
        let fitted = self.programs.iter().enumerate().take(RECORDINGS - 1);
        fitted.map(|(i, programs)| record(&physics, programs, i, false, self.rows)).collect()
    }

    /// `effect` at a strength whose visibility is within a factor 1.6 of what is wanted. Visibility grows about with the
    /// square of the strength; where it does not (a limit that is never reached, a foot that never slides), halving
    /// between too weak and too strong finds it.
    pub(super) fn about_as_visible(&self, effect: &Effect, wanted: f64) -> Option<Effect> {
        let (mut factor, mut weak, mut strong) = (1.0_f64, None, None);
        for _ in 0..8 {
            let scaled = effect.stronger(factor);
            let seen = self.visibility(std::slice::from_ref(&scaled));
            if seen.is_finite() && (wanted / 1.6..wanted * 1.6).contains(&seen) {
                return Some(scaled);
            }
            let ratio = if seen.is_finite() { wanted / seen.max(1.0) } else { 1e-2 };
            *(if ratio > 1.0 { &mut weak } else { &mut strong }) = Some(factor);
            let guess = factor * libm::sqrt(ratio).clamp(0.2, 5.0);
            factor = match (weak, strong) {
                (Some(low), Some(high)) if !(low..high).contains(&guess) => libm::sqrt(low * high),
                _ => guess,
            };
            if !(1e-3..1e3).contains(&factor) {
                return None;
            }
        }
        None
    }

    /// Steps at least once in a second and a half to the end, legs apart at every change.
    fn is_walk(&self, recording: &Recording) -> bool {
        if self.rig.kind != Kind::Walker {
            return true;
        }
        let stance = &recording.stance;
        let changes = (1..stance.len()).filter(|k| stance[*k] != stance[k - 1]);
        let marks: Vec<usize> = [0].into_iter().chain(changes).chain([stance.len()]).collect();
        marks.windows(2).all(|pair| (pair[1] - pair[0]) as f64 * ROW_S < 1.5)
            && marks.windows(2).rev().skip(1).all(|pair| (pair[1] - pair[0]) as f64 * ROW_S > 0.2)
    }

    /// Is the motion of a kind that a laboratory would keep: finite, moving, not spinning away?
    fn is_sane(&self, recordings: &[Recording]) -> bool {
        let scale = draw::scales(&self.rig);
        let moves = |recording: &Recording| {
            let signal = &recording.clean[0];
            let mean = signal.iter().sum::<f64>() / signal.len() as f64;
            let spread = signal.iter().map(|x| (x - mean).abs()).fold(0.0, f64::max);
            spread.is_finite() && spread > 0.05 * scale.angle && spread < 12.0 * scale.angle
        };
        recordings.iter().all(|recording| moves(recording) && self.is_walk(recording))
    }
}

/// Draws the effects of a case at their visibility; `None` if this rig and programs cannot show any.
fn hide(dice: &mut Dice, lab: &Lab, level: Level, healthy: bool) -> Option<Vec<Effect>> {
    if !lab.is_sane(&lab.record(&lab.rough(&[]))) {
        return None;
    }
    if healthy {
        return Some(Vec::new());
    }
    let outside = level != Level::Crowded && dice.chance(0.1);
    let mut effects = vec![visible(dice, lab, outside, None)?];
    if level == Level::Crowded && dice.chance(0.5) {
        let first = effects[0].id;
        effects.push(visible(dice, lab, false, Some(first))?);
        let alone = |i: usize| lab.remains_beside(&effects[1 - i..2 - i], &effects);
        if (0..2).map(alone).any(|left| left.is_nan() || left < FAINT) {
            return None;
        }
    }
    // Taken linearly a re-fit may leave what it absorbs in truth: a lag is but a later start where no input moves the machine.
    (lab.is_sane(&lab.record(&lab.rough(&effects))) && lab.remains(&effects) >= FAINT).then_some(effects)
}

fn visible(dice: &mut Dice, lab: &Lab, outside: bool, not: Option<&str>) -> Option<Effect> {
    let wanted = dice.log_between(VISIBILITY[0], VISIBILITY[1]);
    let duration_s = lab.rows as f64 * ROW_S;
    for _ in 0..TRIES {
        let of = if outside { outside_of(&lab.rig) } else { draw::candidates(&lab.rig) };
        let id = *dice.pick(&of);
        if not == Some(id) {
            continue;
        }
        let effect = draw::draw(dice, &lab.rig, id, duration_s);
        if let Some(effect) = lab.about_as_visible(&effect, wanted).filter(|e| e.is_plausible(&lab.rig)) {
            return Some(effect);
        }
    }
    None
}

fn outside_of(rig: &Rig) -> Vec<&'static str> {
    if rig.kind == Kind::Walker {
        return vec!["magnet_detent"];
    }
    // A shaken base moves nothing that has no weight on an arm.
    OUTSIDE.into_iter().filter(|id| rig.kind != Kind::Rotor || *id != "base_vibration").collect()
}

fn finish(dice: &mut Dice, lab: &Lab, level: Level, effects: Vec<Effect>) -> Case {
    let recordings = lab.record(&lab.physics(&effects));
    let nuisance = match (level, effects.len()) {
        (Level::Crowded, 1) if dice.chance(0.5) => Nuisance { outliers: 0.004, dropouts: 0.0 },
        (Level::Crowded, 1) => Nuisance { outliers: 0.0, dropouts: 0.02 },
        _ => Nuisance::default(),
    };
    let kind = *dice.pick(&[NoiseKind::White, NoiseKind::White, NoiseKind::Coloured, NoiseKind::Heavy]);
    let noisy: Vec<Vec<Vec<f64>>> = recordings.iter().map(|r| with_noise(dice, &lab.rig, r, kind)).collect();
    let fit: Vec<&Recording> = recordings.iter().filter(|r| !r.heldout).collect();
    let signals: Vec<&[Vec<f64>]> =
        recordings.iter().zip(&noisy).filter(|(r, _)| !r.heldout).map(|(_, s)| s.as_slice()).collect();
    let base = lab.physics(&[]);
    // The fit's own step is not seen beside what it cannot explain.
    let refitted = if effects.is_empty() {
        base.clone()
    } else {
        Physics { coarse: 1.0, ..refit(&lab.rough(&[]), &fit, &signals, true).physics }
    };
    let published = match level {
        Level::True => lab.rig.clone(),
        Level::Off => off(dice, &lab.rig),
        Level::Refitted | Level::Gentle | Level::Crowded => near(&refitted.rig, &lab.rig),
    };
    let accepted = (0..effects.len()).map(|of| answers_or_unlisted(lab, &effects, of, kind)).collect();
    let visibility = if effects.is_empty() { 0.0 } else { lab.remains(&effects) };
    let heldout = recoverable(&refitted, &recordings, &noisy);
    let readings = noisy.iter().map(|signals| spoil(dice, &lab.rig, signals, nuisance)).collect();
    let physics = lab.physics(&effects);
    Case { physics, published, level, recordings, readings, accepted, visibility, heldout, noise: kind, nuisance }
}

fn answers_or_unlisted(lab: &Lab, effects: &[Effect], of: usize, kind: NoiseKind) -> Vec<(String, String)> {
    if effects[of].is_outside() { Vec::new() } else { twins::answers(lab, effects, of, kind) }
}

/// `fitted` no farther from `truth` than whoever publishes bounds believes: they must hold the truth.
fn near(fitted: &Rig, truth: &Rig) -> Rig {
    let mut other = fitted.clone();
    for name in &truth.uncertain {
        if let (Some(value), Some(true_value)) =
            (other.values.get_mut(name), truth.values.get(name).filter(|x| **x > 0.0))
        {
            *value = value.clamp(0.55 * true_value, 1.8 * true_value);
        }
    }
    other
}

/// Published values are rounded by whoever measured them: up to 20 % off.
fn off(dice: &mut Dice, rig: &Rig) -> Rig {
    let mut other = rig.clone();
    for name in &rig.uncertain {
        if let Some(value) = other.values.get_mut(name) {
            *value *= 1.0 + dice.sign() * dice.between(0.05, 0.2);
        }
    }
    other
}

fn with_noise(dice: &mut Dice, rig: &Rig, recording: &Recording, kind: NoiseKind) -> Vec<Vec<f64>> {
    let each = recording.clean.iter().zip(&rig.sensors);
    each.map(|(clean, sensor)| {
        let noise = noise(dice, kind, clean.len());
        let read = |(value, noise): (&f64, f64)| {
            let value = value + sensor.noise * noise;
            if sensor.quantum > 0.0 { (value / sensor.quantum).round() * sensor.quantum } else { value }
        };
        clean.iter().zip(noise).map(read).collect()
    })
    .collect()
}

fn spoil(dice: &mut Dice, rig: &Rig, signals: &[Vec<f64>], nuisance: Nuisance) -> Vec<Vec<f64>> {
    let mut spoiled = signals.to_vec();
    for (signal, sensor) in spoiled.iter_mut().zip(&rig.sensors) {
        for value in signal.iter_mut() {
            if dice.chance(nuisance.outliers) {
                *value += dice.sign() * 20.0 * sensor.noise;
            } else if dice.chance(nuisance.dropouts) {
                *value = f64::NAN;
            }
        }
    }
    spoiled
}

/// Held-out errors of the re-fitted base and of the truth, over the deviation of each signal.
fn recoverable(refitted: &Physics, recordings: &[Recording], noisy: &[Vec<Vec<f64>>]) -> Vec<[f64; 2]> {
    let Some((recording, signals)) = recordings.iter().zip(noisy).find(|(r, _)| r.heldout) else { return Vec::new() };
    let fit = refit(refitted, &[recording], &[signals], false);
    let sensors = 0..signals.len();
    sensors
        .map(|sensor| {
            let mut simulated = Vec::new();
            for (window, start) in fit.starts.first().into_iter().flatten().enumerate() {
                simulated.extend(super::experiment::free_run(&fit.physics, recording, window, *start)[sensor].iter());
            }
            let spread = deviation(&signals[sensor]);
            [rms(&signals[sensor], &simulated) / spread, rms(&signals[sensor], &recording.clean[sensor]) / spread]
        })
        .collect()
}

fn rms(a: &[f64], b: &[f64]) -> f64 {
    libm::sqrt(a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / a.len() as f64)
}

fn deviation(signal: &[f64]) -> f64 {
    let mean = signal.iter().sum::<f64>() / signal.len() as f64;
    libm::sqrt(signal.iter().map(|x| (x - mean) * (x - mean)).sum::<f64>() / signal.len() as f64)
}
