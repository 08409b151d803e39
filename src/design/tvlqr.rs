//! Time-varying LQR along a planned motion, through its impacts. RT: no.
//!
//! `-Ṡ = AᵀS + SA - S B R⁻¹ BᵀS + Q`, and over an impact at the guard `g(x) = 0` `S⁻ = ΞᵀS⁺Ξ` with the saltation matrix
//! `Ξ = D + (f⁺ - D f⁻) ∇gᵀ / (∇gᵀ f⁻)`, D the Jacobian of impact and exchange of legs: a state that is off by δ reaches
//! the guard earlier or later, and what counts is where it is at the planned time.
//! Source: Underactuated Robotics, ch. LQR and limit cycles; section 8 of the model notes.

#![expect(non_snake_case, reason = "symbols of the equations")]

use super::trajectory::{Arc, Trajectory};
use crate::base::scalar::{Dual, Scalar};
use crate::model::compass_gait::kinematics::swing_toe;
use crate::model::compass_gait::{impact, linear};
use nalgebra::{Matrix4, RowVector4, Vector4};

/// Weights of the state `[θs, θw, θ̇s, θ̇w]` and of the torque divided by `m_t l²`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// Diagonal of Q.
    pub state: [f64; 4],
    /// R.
    pub torque: f64,
}

impl Weights {
    /// Stance angle first, then the swing leg; rates hardly (section 4.5 of the thesis, section 8 of the notes).
    pub const THESIS: Self = Self { state: [100.0, 10.0, 1.0, 0.1], torque: 1.0 };

    pub(super) fn q(&self) -> Matrix4<f64> {
        Matrix4::from_diagonal(&Vector4::from(self.state))
    }
}

/// Steps of the Riccati equation per phase.
pub(super) const STEPS: usize = 400;

/// Gains over a phase at equally spaced instants, both ends included.
#[derive(Clone, Debug)]
pub struct TimeVarying {
    /// `τ = τ* - K (x - x*)`, torque normalised.
    pub gain: Vec<RowVector4<f64>>,
    /// Cost-to-go.
    pub cost: Vec<Matrix4<f64>>,
}

/// A and B at an instant of a phase.
pub(super) fn linearised(arc: &Arc, t: f64) -> (Matrix4<f64>, Vector4<f64>) {
    let l = linear::rigid(&arc.model, &arc.state(t), arc.torque(t));
    (Matrix4::from_fn(|i, j| l.a[i][j]), Vector4::from(l.b))
}

/// Jacobian of impact and exchange of legs at a state of `arc`. `None` for a singular impact.
#[must_use]
pub fn impact_jacobian(arc: &Arc, x: &[f64; 4]) -> Option<Matrix4<f64>> {
    let state: [Dual<4>; 4] = std::array::from_fn(|i| Dual::variable(x[i], i));
    let after = impact::step(&arc.model.lift(), &state)?;
    Some(Matrix4::from_fn(|i, j| after[i].d[j]))
}

/// Saltation matrix of the touchdown between two phases.
#[must_use]
pub fn saltation(before: &Arc, after: &Arc) -> Option<Matrix4<f64>> {
    let x = before.state(before.duration_s);
    let D = impact_jacobian(before, &x)?;
    let f0 = Vector4::from(before.flow(&x, before.torque(before.duration_s)));
    let f1 = Vector4::from(after.flow(&after.state(0.0), after.torque(0.0)));
    let q: [Dual<2>; 2] = [Dual::variable(x[0], 0), Dual::variable(x[1], 1)];
    let height = swing_toe(q)[1];
    debug_assert!(height.value().is_finite());
    let normal = RowVector4::new(height.d[0], height.d[1], 0.0, 0.0);
    Some(D + (f1 - D * f0) * normal / (normal * f0)[0])
}

/// `-Ṡ` of the Riccati equation.
fn slope(S: &Matrix4<f64>, A: &Matrix4<f64>, B: &Vector4<f64>, w: &Weights) -> Matrix4<f64> {
    let SB = S * B;
    A.transpose() * S + S * A - SB * SB.transpose() / w.torque + w.q()
}

/// Gains of every phase, for the cost `final_cost` at the end of the last one. `None` for a singular impact.
#[must_use]
pub fn gains(motion: &Trajectory, weights: &Weights, final_cost: &Matrix4<f64>) -> Option<Vec<TimeVarying>> {
    gains_in(motion, weights, final_cost, |_| STEPS)
}

/// The same in so many steps for each phase.
#[must_use]
pub fn gains_in(
    motion: &Trajectory,
    weights: &Weights,
    final_cost: &Matrix4<f64>,
    steps: impl Fn(usize) -> usize,
) -> Option<Vec<TimeVarying>> {
    let mut S = *final_cost;
    let mut out = Vec::new();
    for (p, arc) in motion.arcs.iter().enumerate().rev() {
        if let Some(next) = motion.arcs.get(p + 1) {
            let jump = saltation(arc, next)?;
            S = jump.transpose() * S * jump;
        }
        let phase = backwards(arc, weights, &S, steps(p));
        S = phase.cost[0];
        out.push(phase);
    }
    out.reverse();
    Some(out)
}

/// RK4 backwards in time over one phase.
fn backwards(arc: &Arc, weights: &Weights, end: &Matrix4<f64>, steps: usize) -> TimeVarying {
    #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
    let h = arc.duration_s / steps as f64;
    let gain = |S: &Matrix4<f64>, B: &Vector4<f64>| B.transpose() * S / weights.torque;
    let mut S = *end;
    let (mut A1, mut B1) = linearised(arc, arc.duration_s);
    let mut out = TimeVarying { gain: vec![gain(&S, &B1)], cost: vec![S] };
    for k in (0..steps).rev() {
        #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
        let t = k as f64 * h;
        let (Am, Bm) = linearised(arc, t + 0.5 * h);
        let (A0, B0) = linearised(arc, t);
        let k1 = slope(&S, &A1, &B1, weights);
        let k2 = slope(&(S + k1 * (h / 2.0)), &Am, &Bm, weights);
        let k3 = slope(&(S + k2 * (h / 2.0)), &Am, &Bm, weights);
        let k4 = slope(&(S + k3 * h), &A0, &B0, weights);
        S += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        S = (S + S.transpose()) * 0.5;
        (A1, B1) = (A0, B0);
        out.gain.push(gain(&S, &B0));
        out.cost.push(S);
    }
    out.gain.reverse();
    out.cost.reverse();
    out
}
