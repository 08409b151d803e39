//! Which foot carries the weight, from the balance of angular momentum about each foot. Thesis 2.1.4. RT: yes.
//!
//! About a foot that stands alone only gravity has a moment, whatever torque, friction or spring acts inside the robot. If
//! the other foot carries the share s of the weight, its force has the moment `s w² d` about this one, d the distance
//! between the feet in leg lengths. A momentum observer (De Luca 2005) sees it:
//! `r' = L' - M - r / T`, `r / T → s w² d`, smoothed by a low-pass of the same T, with `L = [1,1] H q̇` and
//! `M = -[1,1] G` for the leg that is supposed to stand.
//!
//! It needs no contact sensor, so it affirms what the toe springs say, notices a touchdown that they missed, and takes back
//! one that never was. It is blind while the feet are side by side: d = 0.
//! Own derivation; proven by the tests of [`super::touchdown`] and by the walks in `sim`.

use super::high_gain::StanceModel;
use crate::model::compass_gait::dynamics::{gravity_at, mass_matrix_at};
use crate::model::compass_gait::kinematics::Trig;

/// T, s, of the observer and of the low-pass behind it: half of a change of foot shows after 1.7 T. The encoder's counts
/// (.09 mrad rms) differentiated twice make the share uncertain by some .15 at steps of .3 m on the outer leg.
const TIME_S: f64 = 0.014;
/// Feet nearer than this, in leg lengths, say nothing: what is left of the noise would be many times the weight.
const BLIND: f64 = 0.08;

/// After a change of foot: samples that mix before and after are left out, s. They are some 3 ms late, and the legs ring.
const BLANK_S: f64 = 0.008;
/// What is believed of the share until the first samples on a new foot have been seen.
const UNDECIDED: f64 = 0.5;

/// Momentum about the foot that is supposed to stand, and its change that gravity does not explain.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Weight {
    momentum: Option<f64>,
    residual: f64,
    elsewhere: f64,
    blank_s: f64,
}

impl Weight {
    /// Forgets all.
    pub(super) fn reset(&mut self) {
        *self = Self::default();
    }

    /// The other foot is supposed to stand from now on.
    pub(super) const fn change(&mut self) {
        *self = Self { momentum: None, residual: 0.0, elsewhere: UNDECIDED, blank_s: BLANK_S };
    }

    /// Samples are missing: the momentum is not carried on.
    pub(super) const fn pause(&mut self) {
        self.momentum = None;
    }

    /// An IMU sample; `model` of the leg that is supposed to stand, `measured` `[θs, θw, θ̇s, θ̇w]`.
    pub(super) fn step(&mut self, model: &StanceModel, measured: &[f64; 4], dt_s: f64) {
        self.blank_s -= dt_s;
        if self.blank_s > 0.0 {
            return;
        }
        let b = balance(model, measured);
        let last = self.momentum.replace(b.momentum).unwrap_or(b.momentum);
        self.residual += b.momentum - last - dt_s * (b.moment + self.residual / TIME_S);
        let lever = if b.full.abs() < b.least { 0.0 } else { b.full / (b.full * b.full + b.least * b.least) };
        self.elsewhere += dt_s / TIME_S * (self.residual / TIME_S * lever - self.elsewhere);
        if !self.elsewhere.is_finite() {
            self.reset();
        }
    }

    /// Share of the weight that the other foot carries: 0 = the foot that is supposed to stand stands alone, 1 = the other
    /// one does. Near 0 while the feet are side by side.
    pub(super) const fn elsewhere(&self) -> f64 {
        self.elsewhere
    }
}

/// Momentum about the toe, moment of gravity, and that of the whole weight on the other foot.
struct Balance {
    momentum: f64,
    moment: f64,
    full: f64,
    /// The same at the distance from which on the share means something.
    least: f64,
}

fn balance(model: &StanceModel, [ts, tw, vs, vw]: &[f64; 4]) -> Balance {
    let (p, t) = (&model.whole, Trig::new([*ts, *tw]));
    let ([[h11, h12], [h21, h22]], [gs, gw]) = (mass_matrix_at(p, &t), gravity_at(p, &t));
    let ((sin_s, _), (sin_w, _)) = (t.stance, t.swing);
    Balance {
        momentum: (h11 + h21) * vs + (h12 + h22) * vw,
        moment: -gs - gw,
        full: p.w2 * (sin_w - sin_s),
        least: p.w2 * BLIND,
    }
}
