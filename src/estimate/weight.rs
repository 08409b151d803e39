//! Which foot carries the weight, from the balance of angular momentum about each foot. Thesis 2.1.4. RT: yes.
//!
//! About a foot that stands alone only gravity has a moment, whatever torque, friction or spring acts inside the robot. If
//! the other foot carries the share s of the weight, its force has the moment `s w² d` about this one, d the distance
//! between the feet in leg lengths: `L' = M + s w² d`, with `L = [1,1] H q̇` and `M = -[1,1] G` for the leg that is supposed
//! to stand.
//!
//! A Kalman filter on `[Λ, L, s]`, Λ = ∫ L dt. What is measured is Λ, not L: L holds the hip's rate, a difference of encoder
//! counts, and the errors of differences cancel in their sum. So the filter knows how little the first samples after a
//! touchdown say on the outer leg, whose rate is gyro less encoder, and how much on the inner one, whose rate is the gyro's.
//! A share that was believed is forgotten toward none: blind while the feet are side by side (d = 0), it says what it
//! believes of a foot in the air.
//!
//! Both suppositions are followed: each foot stands. The momentum is that about a foot at rest, so about a foot that swings the
//! balance breaks, and its share says nothing. The balance about the foot that stands goes on to hold, whichever foot moves.
//!
//! It needs no contact sensor, so it affirms what the toe springs say, notices a touchdown that they missed, and takes back
//! one that never was.
//! Own derivation; proven by the tests of [`super::touchdown`] and by the walks in `sim`.

use super::high_gain::StanceModel;
use crate::base::linalg::times;
use crate::model::compass_gait::dynamics::{gravity_at, mass_matrix_at};
use crate::model::compass_gait::kinematics::Trig;
use crate::msg::Leg;

/// What a wrong model, a wrong attitude and a floor that is not level leave unexplained, as the weight so far beside the
/// foot, in leg lengths. Feet nearer than this say nothing of the share.
const UNEXPLAINED: f64 = 0.04;
/// What is believed of a share at most, either way, a model's error included. Less than none cannot be on the other foot: the
/// foot that is supposed to stand moves.
const LARGEST_SHARE: f64 = 1.5;
/// A share is forgotten in this time, s: less than half of the shortest step.
const MEMORY_S: f64 = 0.04;
/// Standard deviation of a share of which nothing is known: all or nothing.
const SPREAD: f64 = 0.5;
/// After a change of foot: samples that mix before and after are left out, s. They are some 3 ms late, and the legs ring.
const BLANK_S: f64 = 0.008;
/// What is believed of the share until the first samples on a new foot have been seen.
const UNDECIDED: f64 = 0.5;
/// Standard deviation of a mean rate between two samples by the gyro, rad/s: the 3DM-GX3's noise at 500 Hz.
const GYRO_RAD_S: f64 = 0.005;
/// Standard deviation of the momentum before the first sample, normalised, 1/s: any rate of a walk.
const ANY_MOMENTUM: f64 = 3.0;

/// The balance under both suppositions: each foot stands. Inner, outer.
#[derive(Clone, Copy, Debug)]
pub(super) struct Weight {
    about: [AboutFoot; 2],
}

impl Weight {
    /// `count_rad`: of the hip's encoder.
    pub(super) fn new(count_rad: f64) -> Self {
        Self { about: [AboutFoot::new(count_rad); 2] }
    }

    /// Forgets all.
    pub(super) fn reset(&mut self) {
        self.about.iter_mut().for_each(AboutFoot::reset);
    }

    /// Another foot is supposed to stand from now on.
    pub(super) fn change(&mut self) {
        self.about.iter_mut().for_each(AboutFoot::change);
    }

    /// Samples are missing: the momentum is not carried on.
    pub(super) fn pause(&mut self) {
        self.about.iter_mut().for_each(AboutFoot::pause);
    }

    /// An IMU sample; models of the inner and of the outer leg as the one that stands, `measured` `[θs, θw, θ̇s, θ̇w]` for each,
    /// the rates being means since the sample before.
    pub(super) fn step(&mut self, models: &[StanceModel; 2], measured: &[[f64; 4]; 2], dt_s: f64) {
        let [inner, outer] = &mut self.about;
        let ([inner_model, outer_model], [of_inner, of_outer]) = (models, measured);
        inner.step(inner_model, Leg::Inner, of_inner, dt_s);
        outer.step(outer_model, Leg::Outer, of_outer, dt_s);
    }

    /// Share of the weight that the other foot carries, by the balance about the foot of `stance`: 0 = that one stands alone,
    /// 1 = the other one does. Near 0 while the feet are side by side.
    pub(super) const fn beside(&self, stance: Leg) -> f64 {
        let [inner, outer] = &self.about;
        match stance {
            Leg::Inner => inner.elsewhere(),
            Leg::Outer => outer.elsewhere(),
        }
    }
}

/// Momentum about a foot that is supposed to stand, and its change that gravity does not explain.
#[derive(Clone, Copy, Debug)]
struct AboutFoot {
    /// Standard deviation of a hip reading, rad.
    hip_rad: f64,
    /// `[Λ less what was measured, L, s]`.
    x: [f64; 3],
    /// Its covariance.
    p: [[f64; 3]; 3],
    blank_s: f64,
}

impl AboutFoot {
    /// `count_rad`: of the hip's encoder.
    fn new(count_rad: f64) -> Self {
        let mut about = Self { hip_rad: count_rad / libm::sqrt(12.0), x: [0.0; 3], p: [[0.0; 3]; 3], blank_s: 0.0 };
        about.begin(0.0);
        about
    }

    /// Forgets all.
    const fn reset(&mut self) {
        self.begin(0.0);
        self.blank_s = 0.0;
    }

    /// The other foot is supposed to stand from now on.
    const fn change(&mut self) {
        self.begin(UNDECIDED);
        self.blank_s = BLANK_S;
    }

    /// Samples are missing: the momentum is not carried on.
    const fn pause(&mut self) {
        let [.., share] = self.x;
        let [_, _, [.., spread]] = self.p;
        self.begin(share);
        let [_, _, [.., p]] = &mut self.p;
        *p = spread;
    }

    const fn begin(&mut self, share: f64) {
        self.x = [0.0, 0.0, share];
        self.p = [[0.0, 0.0, 0.0], [0.0, ANY_MOMENTUM * ANY_MOMENTUM, 0.0], [0.0, 0.0, SPREAD * SPREAD]];
    }

    /// An IMU sample; `model` of the leg that is supposed to stand, `measured` `[θs, θw, θ̇s, θ̇w]`, the rates being means
    /// since the sample before.
    fn step(&mut self, model: &StanceModel, stance: Leg, measured: &[f64; 4], dt_s: f64) {
        self.blank_s -= dt_s;
        if self.blank_s > 0.0 {
            return;
        }
        let b = balance(model, measured);
        self.predict(&b, dt_s);
        let of_hip = match stance {
            Leg::Inner => b.by_swing,
            Leg::Outer => b.by_stance,
        };
        self.correct(of_hip * self.hip_rad);
        let [.., share] = &mut self.x;
        *share = share.clamp(-LARGEST_SHARE, LARGEST_SHARE);
        if !self.x.iter().all(|x| x.is_finite()) {
            self.reset();
        }
    }

    /// Λ is counted from what has been measured of it.
    fn predict(&mut self, b: &Balance, dt_s: f64) {
        let [lambda, momentum, share] = self.x;
        let (half, kept) = (0.5 * dt_s * dt_s, libm::exp(-dt_s / MEMORY_S));
        let moment = b.moment + share * b.full;
        let measured = b.momentum * dt_s;
        self.x = [lambda + dt_s * momentum + half * moment - measured, momentum + dt_s * moment, kept * share];
        let f = [[1.0, dt_s, half * b.full], [0.0, 1.0, dt_s * b.full], [0.0, 0.0, kept]];
        // F P Fᵀ, row by row: P is symmetric.
        let mut p = f.map(|row| times(&f, &times(&self.p, &row)));
        let gyro = (b.by_stance + b.by_swing) * GYRO_RAD_S * dt_s;
        let [[first, ..], [_, middle, _], [.., last]] = &mut p;
        *first += gyro * gyro;
        // It lasts as long as a share is remembered.
        *middle += 2.0 * b.unexplained * b.unexplained * MEMORY_S * dt_s;
        *last += SPREAD * SPREAD * (1.0 - kept * kept);
        self.p = p;
    }

    /// What was measured of Λ has this standard deviation.
    fn correct(&mut self, deviation: f64) {
        let column = self.p.map(|[first, ..]| first);
        let [p00, ..] = column;
        let total = p00 + deviation * deviation;
        if total <= 0.0 {
            return;
        }
        let [lambda, ..] = self.x;
        for ((x, row), c) in self.x.iter_mut().zip(&mut self.p).zip(column) {
            let gain = c / total;
            *x -= gain * lambda;
            for (p, r) in row.iter_mut().zip(column) {
                *p -= gain * r;
            }
        }
    }

    /// Share of the weight on the other foot.
    const fn elsewhere(&self) -> f64 {
        let [.., share] = self.x;
        share
    }
}

/// Momentum about the toe, moment of gravity, and that of the whole weight on the other foot .
struct Balance {
    momentum: f64,
    /// What the rate of the stance leg, and of the swing leg, is worth in it.
    by_stance: f64,
    by_swing: f64,
    moment: f64,
    full: f64,
    /// Standard deviation of the moment that neither explains.
    unexplained: f64,
}

fn balance(model: &StanceModel, [ts, tw, vs, vw]: &[f64; 4]) -> Balance {
    let (p, t) = (&model.whole, Trig::new([*ts, *tw]));
    let ([[h11, h12], [h21, h22]], [gs, gw]) = (mass_matrix_at(p, &t), gravity_at(p, &t));
    let ((sin_s, _), (sin_w, _)) = (t.stance, t.swing);
    let (by_stance, by_swing) = (h11 + h21, h12 + h22);
    Balance {
        momentum: by_stance * vs + by_swing * vw,
        by_stance,
        by_swing,
        moment: -gs - gw,
        full: p.w2 * (sin_w - sin_s),
        unexplained: p.w2 * UNEXPLAINED,
    }
}
