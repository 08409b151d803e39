//! What the IMU's attitude reads too much, learnt from the balance of angular momentum. RT: yes.
//!
//! The 3DM-GX3 is wrong by up to half a degree at rest and drifts (Thesis 2.1.2); the thesis zeroed it with a laser
//! scanner. With one ([`super::terrain`]) this here learns what the scanner leaves, without one everything. Uncorrected the simulated robot falls: LQR pulls towards a wrong upright, where only a swing leg 40 times as
//! far out could keep the centre of mass over the toe, and the observer, which trusts its model, doubles the error.
//!
//! About the toe only gravity has a moment, whatever torque, friction or spring acts inside the robot:
//! `L' = M(q)`, `L = [1,1] H q̇`, `M = -[1,1] G`. L is known from the gyro and the plain difference of the hip encoder
//! (noisy, but T smooths it; a filtered rate would be late and cost 20 %), M from the angles less the learnt bias δ̂. A second-order observer compares the two:
//! `L̂' = M(y - δ̂) + (2/T)(L - L̂)`, `δ̂' = -(L - L̂)/(T² M')`, `M' = w²(1 - c4 - c5 + 4c6)`: double pole at -1/T,
//! independent of what the controller does, and of a constant error of the gyro. Own derivation; proven by the tests
//! `bias_is_learnt_...` and by the balance experiments in `sim`.
//!
//! Alternative that failed: learning δ̂ from the standing innovation of the main observer. That is only right when much
//! slower than ε = .2 s and the fall, and by then the robot lies on the floor (0.5° of error on the outer leg).
//!
//! Limits: valid while the stance toe neither slips nor lifts and nobody holds the robot. It learns the direction in
//! which the *model* balances, so an error of the centre of mass is learnt as if it were the IMU's: right for balance.

use crate::model::compass_gait::dynamics::{gravity_at, mass_matrix_at};
use crate::model::compass_gait::kinematics::Trig;
use crate::model::compass_gait::params::Normalised;

/// Largest bias that is believed, rad: the device's 2° in motion, with margin.
const LARGEST_RAD: f64 = 0.06;

/// Momentum and bias as believed.
#[derive(Clone, Copy, Debug)]
pub(super) struct BiasObserver {
    /// T, s; 0 = learns nothing.
    time_s: f64,
    /// A momentum that no bias explains is not learnt.
    rejects_pushes: bool,
    momentum: Option<f64>,
    bias_rad: f64,
    /// What it was when it was last trusted, rad.
    trusted_rad: f64,
    /// The next momentum is that of the rates that the observer believes.
    trusts_observer: bool,
}

impl BiasObserver {
    /// Double pole at -1/`time_s`; 0 turns it off.
    pub(super) const fn new(time_s: f64, rejects_pushes: bool) -> Self {
        Self { time_s, rejects_pushes, momentum: None, bias_rad: 0.0, trusted_rad: 0.0, trusts_observer: false }
    }

    /// Bias as believed now, rad.
    pub(super) const fn bias_rad(&self) -> f64 {
        self.bias_rad
    }

    /// Forgets all.
    pub(super) const fn reset(&mut self) {
        self.momentum = None;
        self.bias_rad = 0.0;
        self.trusted_rad = 0.0;
    }

    /// It is at work: armed, and not switched off.
    pub(super) const fn learns(&self) -> bool {
        self.momentum.is_some() || self.trusts_observer
    }

    /// Somebody else has taken so much of the bias over: the sum stays. A learner that is off has none to give.
    pub(super) fn hand_over(&mut self, rad: f64) {
        if self.time_s > 0.0 {
            for bias in [&mut self.bias_rad, &mut self.trusted_rad] {
                *bias = (*bias - rad).clamp(-LARGEST_RAD, LARGEST_RAD);
            }
        }
    }

    /// Keeps the bias but not the momentum: somebody may hold the robot, or the stance leg changes.
    pub(super) const fn pause(&mut self) {
        self.momentum = None;
        self.trusts_observer = false;
    }

    /// Nothing speaks against what has been learnt so far.
    pub(super) const fn trust(&mut self) {
        self.trusted_rad = self.bias_rad;
    }

    /// What was learnt since [`Self::trust`] was learnt with the wrong foot.
    pub(super) const fn take_back(&mut self) {
        self.bias_rad = self.trusted_rad;
    }

    /// Samples are missing, or mix two states: goes on from the rates that the observer believes. A single difference of
    /// the encoder is too rough to begin with (a count is .16 rad/s).
    pub(super) const fn restart(&mut self) {
        self.momentum = None;
        self.trusts_observer = true;
    }

    /// One period: measured `[θs, θw, θ̇s, θ̇w]` less the bias as believed, rates those of the middle of the last period.
    /// The momentum is carried from middle to middle, so that the moment of this instant is the mean between them.
    /// `believed`: the observer's rates.
    pub(super) fn step(&mut self, p: &Normalised<f64>, measured: &[f64; 4], believed: Option<[f64; 2]>, dt_s: f64) {
        let [ts, tw, vs, vw] = *measured;
        let t = Trig::new([ts, tw]);
        let ([[h11, h12], [h21, h22]], [gs, gw]) = (mass_matrix_at(p, &t), gravity_at(p, &t));
        let momentum_of = |vs: f64, vw: f64| (h11 + h21) * vs + (h12 + h22) * vw;
        let momentum = momentum_of(vs, vw);
        let start = || believed.filter(|_| self.trusts_observer).map_or(momentum, |[vs, vw]| momentum_of(vs, vw));
        let believed = self.momentum.unwrap_or_else(start);
        let error = momentum - believed;
        if self.time_s <= 0.0 || !error.is_finite() {
            return self.pause();
        }
        if self.rejects_pushes && error.abs() > self.largest_error(p) {
            // It goes on from here.
            self.momentum = Some(momentum);
            return;
        }
        let rate = 1.0 / self.time_s;
        self.momentum = Some(believed + dt_s * (2.0 * rate * error - gs - gw));
        let bias = self.bias_rad - dt_s * rate * rate * error / moment_slope(p);
        self.bias_rad = bias.clamp(-LARGEST_RAD, LARGEST_RAD);
    }

    /// Largest error of the momentum that a bias of [`LARGEST_RAD`] makes, T after it has come: what is beyond is a push, or a
    /// hand that lets go.
    fn largest_error(&self, p: &Normalised<f64>) -> f64 {
        LARGEST_RAD * moment_slope(p) * self.time_s / std::f64::consts::E
    }
}

/// Moment of gravity about the toe per angle by which the whole robot leans, at the upright.
fn moment_slope(p: &Normalised<f64>) -> f64 {
    let [_, _, _, c4, c5, c6] = p.c;
    p.w2 * (1.0 - c4 - c5 + 4.0 * c6)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_learnt_with_the_wrong_foot_is_taken_back_and_what_was_handed_over_is_not() {
        let mut bias = BiasObserver { bias_rad: 0.01, ..BiasObserver::new(0.2, false) };
        bias.trust();
        bias.bias_rad = 0.04;
        bias.hand_over(0.003);
        bias.take_back();
        assert!((bias.bias_rad() - 0.007).abs() < 1e-15, "{}", bias.bias_rad());
        bias.reset();
        bias.take_back();
        assert!(bias.bias_rad().abs() < 1e-15);
    }

    #[test]
    fn a_push_is_not_learnt_as_a_bias_and_a_bias_is() {
        let p = crate::model::compass_gait::params::Params::sysid().normalised();
        // Standing upright; the device reads `bias` too much, and from 1 s on the stance leg turns at `push_rad_s`.
        let learnt = |rejects: bool, bias: f64, push_rad_s: f64| {
            let mut observer = BiasObserver::new(0.3, rejects);
            let mut most: f64 = 0.0;
            for k in 0..1200 {
                let rate = if k < 1000 { 0.0 } else { push_rad_s };
                let angle = bias - observer.bias_rad();
                observer.step(&p, &[angle, angle, rate, 0.0], None, 1e-3);
                most = most.max((observer.bias_rad() - bias).abs() * f64::from(u8::from(k > 900)));
            }
            most
        };
        assert!(learnt(false, 0.0, 0.4) > 0.02, "what it is about");
        assert!(learnt(true, 0.0, 0.4) < 0.002);
        // All that is believed is learnt as before.
        for bias in [0.01, -0.055] {
            assert!((learnt(true, bias, 0.0) - learnt(false, bias, 0.0)).abs() < 1e-15);
        }
    }

    #[test]
    fn a_learner_that_is_off_has_no_bias_to_take_back() {
        let mut off = BiasObserver::new(0.0, false);
        off.restart();
        off.hand_over(0.01);
        off.take_back();
        assert!(off.bias_rad().abs() < 1e-15);
    }
}
