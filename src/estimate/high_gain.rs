//! Discrete high-gain observer around the nonlinear model, Thesis (4.14)-(4.17). RT: yes.
//!
//! `x̂⁺ = x̂ + T (f(x̂,u) + L (y - ŷ))`, `y = [θs, θw]`, `L = [(2/ε) I; (1/ε²) I]`. Corrected: (4.16) lacks a bracket,
//! (4.17) prints 2/ε² in its last row, which would put the poles of that leg at (-1±i)/ε instead of -1/ε twice.
//! Differs: first the prediction to the tick's instant, then the correction with the angles of the same instant, so that
//! the estimate is one period younger. And the model's part goes by a Runge-Kutta step instead of Euler's, because
//! Euler's turns a lightly damped spring (10.5 Hz, 2 %) into an unstable one at 1 kHz.

use crate::base::ode::rk4;
use crate::model::compass_gait::params::{Elasticity, Normalised, Params};
use crate::model::compass_gait::{dynamics, elastic, linear};

/// `[θs, θw, φ, θ̇s, θ̇w, φ̇]`, stance leg first; a rigid hip carries φ = σ along.
pub(super) type State = [f64; 6];

/// The model of one stance leg, all normalised.
#[derive(Clone, Copy, Debug)]
pub(super) struct StanceModel {
    /// Whole robot (rigid hip).
    pub(super) whole: Normalised<f64>,
    /// Legs without rotor, and the spring, if the model knows the hip's compliance.
    pub(super) hip: Option<(Normalised<f64>, Elasticity<f64>)>,
}

impl StanceModel {
    /// Of `params`, whose leg 1 stands.
    pub(super) fn new(params: &Params<f64>, spring: Option<&Elasticity<f64>>) -> Self {
        let whole = params.normalised();
        let hip = spring.map(|e| {
            let e = e.normalised(params.inertia_kg_m2());
            (elastic::without_rotor(&whole, e.rotor_inertia_kg_m2), e)
        });
        Self { whole, hip }
    }

    /// f(x, u), friction included.
    fn derivative(&self, x: &State, tau: f64) -> State {
        if let Some((legs, spring)) = &self.hip {
            return elastic::derivative(legs, spring, x, tau);
        }
        let [ts, tw, _, vs, vw, _] = *x;
        let [as_, aw] = dynamics::acceleration(&self.whole, [ts, tw], [vs, vw], tau);
        [vs, vw, vs - vw, as_, aw, as_ - aw]
    }

    /// The state after `dt_s` under `tau`: T f(x̂,u) of (4.16).
    pub(super) fn predict(&self, x: &State, tau: f64, dt_s: f64) -> State {
        rk4(x, dt_s, |x| self.derivative(x, tau))
    }

    /// Gravity and torque at the upright, friction aside: `q̈ = a q + b τ`.
    pub(super) fn upright(&self) -> ([[f64; 2]; 2], [f64; 2]) {
        let l = linear::rigid(&self.whole.frictionless(), &[0.0; 4], 0.0);
        let [_, _, [s0, s1, ..], [w0, w1, ..]] = l.a;
        let [_, _, bs, bw] = l.b;
        ([[s0, s1], [w0, w1]], [bs, bw])
    }
}

/// The observer's gains.
#[derive(Clone, Copy, Debug)]
pub(super) struct HighGain {
    /// 2/ε, 1/s.
    angle_gain: f64,
    /// 1/ε², 1/s².
    rate_gain: f64,
}

impl HighGain {
    /// Double pole at -1/ε.
    pub(super) fn new(epsilon_s: f64) -> Self {
        Self { angle_gain: 2.0 / epsilon_s, rate_gain: 1.0 / (epsilon_s * epsilon_s) }
    }

    /// ε from which on the model outruns the correction: the error obeys `ë + (2/ε) ė + (1/ε² - A₂₁) e = 0`, which is
    /// unstable as soon as A₂₁ has a real eigenvalue λ² > 1/ε².
    pub(super) fn slow_limit_s(self, model: &StanceModel) -> f64 {
        let ([[a, b], [c, d]], _) = model.upright();
        let (half, det) = (0.5 * (a + d), a * d - b * c);
        let largest = half + libm::sqrt((half * half - det).max(0.0));
        if largest > 0.0 { 1.0 / libm::sqrt(largest) } else { f64::INFINITY }
    }

    /// Takes the measured minus predicted angles `e` into the prediction of the same instant, for a period of `dt_s`.
    ///
    /// The rotor moves with the correction of the hip angle, so that correcting does not wind up the spring.
    pub(super) fn correct(self, predicted: &State, e: [f64; 2], dt_s: f64) -> State {
        let (p, v) = (self.angle_gain * dt_s, self.rate_gain * dt_s);
        let [es, ew] = e;
        let [ts, tw, phi, vs, vw, vphi] = *predicted;
        [ts + p * es, tw + p * ew, phi + p * (es - ew), vs + v * es, vw + v * ew, vphi + v * (es - ew)]
    }
}
