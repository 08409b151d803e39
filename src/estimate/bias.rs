//! What the IMU's attitude reads too much, learnt from where the robot balances. RT: yes.
//!
//! The 3DM-GX3 is wrong by up to half a degree at rest and drifts (Thesis 2.1.2); the thesis zeroed it with a laser
//! scanner. Uncorrected, half a degree leans the balancing robot by 1.6° and its swing leg by 12°, because balance needs
//! the centre of mass over the toe and LQR pulls towards the wrong upright.
//!
//! The model knows better: a robot that stays where it is under a known torque is upright in truth. A bias δ of both
//! angles leaves the observer with a standing innovation. With the steady state of the observer's error,
//! `(I/ε² - A₂₁) e = -A₂₁ 1 δ + B₂ Δτ`, the combination `k·e`, `k = mᵀ(I/ε² - A₂₁)` with `m ⟂ B₂`, sees δ alone and is
//! blind to a constant torque error Δτ such as friction that the model misjudges. So `δ̂' = k·e / (T m·(-A₂₁ 1))` learns
//! with the time constant T. Own derivation; proven by the tests `bias_is_learnt_...` and by the balance experiments.
//!
//! Limits: what it learns is the direction in which the *model* balances, so an error of the centre of mass is learnt as
//! if it were the IMU's. For balance that is the right answer; as a reading of the IMU it is not.

use super::high_gain::StanceModel;

/// The row `k`, divided by its time constant.
#[derive(Clone, Copy, Debug)]
pub(super) struct BiasGain([f64; 2]);

impl BiasGain {
    /// For one stance leg; `time_s` = 0 turns it off.
    pub(super) fn new(model: &StanceModel, epsilon_s: f64, time_s: f64) -> Self {
        if time_s <= 0.0 {
            return Self([0.0; 2]);
        }
        let ([[a, b], [c, d]], [bs, bw]) = model.upright();
        let (ms, mw) = (bw, -bs);
        let inverse = 1.0 / (epsilon_s * epsilon_s);
        let scale = 1.0 / (time_s * (-ms * (a + b) - mw * (c + d)));
        Self([scale * (ms * (inverse - a) - mw * c), scale * (mw * (inverse - d) - ms * b)])
    }

    /// Rate of the learnt bias, rad/s, for the innovation `e` (measured minus estimated, stance and swing).
    pub(super) fn rate(self, e: [f64; 2]) -> f64 {
        let (Self([ks, kw]), [es, ew]) = (self, e);
        let rate = ks * es + kw * ew;
        if rate.is_finite() { rate } else { 0.0 }
    }
}
