//! Seeded draws: numbers, choices, noise of several kinds. The stream never changes between versions. RT: no.

use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha12Rng;
use std::f64::consts::PI;

/// A seeded source of draws.
pub(super) struct Dice(ChaCha12Rng);

impl Dice {
    /// A stream for one case: the same seed and number give the same case, whatever was drawn for others.
    pub(super) fn new(seed: u64, stream: u64) -> Self {
        let mut rng = ChaCha12Rng::seed_from_u64(seed);
        rng.set_stream(stream);
        Self(rng)
    }

    /// Evenly between two ends.
    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.0.random::<f64>()
    }

    /// Evenly in the logarithm.
    pub(super) fn log_between(&mut self, low: f64, high: f64) -> f64 {
        libm::exp(self.between(libm::log(low), libm::log(high)))
    }

    /// True with this probability.
    pub(super) fn chance(&mut self, probability: f64) -> bool {
        self.0.random::<f64>() < probability
    }

    /// -1 or 1.
    pub(super) fn sign(&mut self) -> f64 {
        if self.chance(0.5) { 1.0 } else { -1.0 }
    }

    /// One of several.
    pub(super) fn pick<'a, T>(&mut self, of: &'a [T]) -> &'a T {
        &of[self.0.random_range(0..of.len())]
    }

    /// Standard normal, after Box and Muller.
    pub(super) fn normal(&mut self) -> f64 {
        let radius = libm::sqrt(-2.0 * libm::log(1.0 - self.0.random::<f64>()));
        radius * libm::cos(2.0 * PI * self.0.random::<f64>())
    }
}

/// What the noise of a sensor is like.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum NoiseKind {
    /// Independent from sample to sample.
    White,
    /// First-order autoregressive, a correlation of 0.8 from sample to sample.
    Coloured,
    /// One sample of fifty is five times as far off.
    Heavy,
}

/// `count` samples of unit standard deviation.
pub(super) fn noise(dice: &mut Dice, kind: NoiseKind, count: usize) -> Vec<f64> {
    const KEEP: f64 = 0.8;
    let mut level = dice.normal();
    let sample = |_| {
        let fresh = dice.normal();
        match kind {
            NoiseKind::White => fresh,
            NoiseKind::Coloured => {
                level = KEEP * level + libm::sqrt(1.0 - KEEP * KEEP) * fresh;
                level
            }
            // 0.98 + 0.02 * 25 = 1.48: back to unit variance.
            NoiseKind::Heavy => fresh * if dice.chance(0.02) { 5.0 } else { 1.0 } / libm::sqrt(1.48),
        }
    };
    (0..count).map(sample).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kind_of_noise_has_unit_deviation() {
        for kind in [NoiseKind::White, NoiseKind::Coloured, NoiseKind::Heavy] {
            let samples = noise(&mut Dice::new(1, 0), kind, 40_000);
            let power = samples.iter().map(|x| x * x).sum::<f64>() / samples.len() as f64;
            assert!((power - 1.0).abs() < 0.05, "{kind:?} {power}");
        }
    }

    #[test]
    fn streams_of_one_seed_differ_and_repeat() {
        let draw = |stream| Dice::new(7, stream).between(0.0, 1.0);
        assert!((draw(1) - draw(2)).abs() > 1e-6 && draw(1).to_bits() == draw(1).to_bits());
    }
}
