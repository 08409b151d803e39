//! LQR gains of the upright balance, computed from the model at start. RT: before arming only.
//!
//! Cost `∫ xᵀQx + R τ²`, τ normalised, friction taken as compensated (section 8 of our notes). Sampled at the control
//! period with the torque held between ticks, weights Q T and R T.

use crate::base::riccati::{RiccatiError, discrete, zero_order_hold};
use crate::config::checked::Config;
use crate::model::compass_gait::elastic::without_rotor;
use crate::model::compass_gait::linear::{Linear, elastic_hip, rigid};
use crate::model::compass_gait::params::{Elasticity, Params};
use crate::msg::Leg;
use nalgebra::{Matrix1, SMatrix};

/// Gain on `[θs, θw, φ, θ̇s, θ̇w, φ̇]`, torque normalised: `τ = -K x`. A rigid hip has zeros at φ.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gain(pub [f64; 6]);

impl Gain {
    /// `-K x`.
    #[must_use]
    pub fn torque(&self, x: &[f64; 6]) -> f64 {
        -self.0.iter().zip(x).map(|(k, x)| k * x).sum::<f64>()
    }
}

/// Gain for balance on `stance` with the weights of the configuration.
///
/// # Errors
/// [`RiccatiError`] when the weights are not positive or the model cannot be stabilised.
pub fn balance_gain(config: &Config, stance: Leg) -> Result<Gain, RiccatiError> {
    let inner = config.robot.model.params();
    let params = match stance {
        Leg::Inner => inner,
        Leg::Outer => inner.swapped(),
    };
    match config.robot.model.hip_elasticity {
        None => rigid_gain(config, &params),
        Some(e) => elastic_gain(config, &params, &e.elasticity()),
    }
}

fn rigid_gain(config: &Config, params: &Params<f64>) -> Result<Gain, RiccatiError> {
    let model = rigid(&params.normalised().frictionless(), &[0.0; 4], 0.0);
    let [s, w, vs, vw] = lqr(config, &model, config.control.lqr_q)?;
    Ok(Gain([s, w, 0.0, vs, vw, 0.0]))
}

/// The rotor's own angle and rate cost nothing: what matters is where the legs are.
fn elastic_gain(config: &Config, params: &Params<f64>, e: &Elasticity<f64>) -> Result<Gain, RiccatiError> {
    let e = e.normalised(params.inertia_kg_m2());
    let legs = without_rotor(&params.normalised().frictionless(), e.rotor_inertia_kg_m2);
    let [s, w, vs, vw] = config.control.lqr_q;
    lqr(config, &elastic_hip(&legs, &e, &[0.0; 6], 0.0), [s, w, 0.0, vs, vw, 0.0]).map(Gain)
}

fn lqr<const N: usize>(config: &Config, model: &Linear<N>, weights: [f64; N]) -> Result<[f64; N], RiccatiError> {
    let period_s = config.real_time.period.as_s();
    let entry = |row: usize, column: usize| model.a.get(row).and_then(|r| r.get(column)).copied().unwrap_or(f64::NAN);
    let a = SMatrix::<f64, N, N>::from_fn(entry);
    let (ad, bd) = zero_order_hold(&a, &SMatrix::<f64, N, 1>::from(model.b), period_s);
    let q = SMatrix::<f64, N, N>::from_diagonal(&SMatrix::<f64, N, 1>::from(weights)) * period_s;
    let solution = discrete(&ad, &bd, &q, &Matrix1::new(config.control.lqr_r * period_s))?;
    Ok(solution.gain.transpose().into())
}
