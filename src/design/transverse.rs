//! Transverse linearisation of a walking motion, its periodic Riccati equation, its multipliers. RT: no.
//!
//! Scaled coordinates `y = diag(1, 1, .15, .15) x`; unit normals z(t) of the surfaces; rows of Π orthonormal to z;
//! `x⊥ = Π (y - y*)`, `f* = ẏ*`:
//! ```text
//!   A⊥ = Π A Πᵀ - Π Π̇ᵀ - Π f* (zᵀ A Πᵀ - zᵀ Π̇ᵀ)/(zᵀ f*)      B⊥ = Π B - Π f* (zᵀ B)/(zᵀ f*)      jump: Π⁺ D Π⁻ᵀ
//! ```
//! z is the guard's normal `-(1, 1, 0, 0)/√2` at both ends of a phase (so an impact maps surface to surface and needs no
//! term of time) and the direction of the flow between, blended by raised cosines over a share of the phase. Π is moved
//! parallel, `π̇ = -(π ż) z`, hence `Π Π̇ᵀ = 0` and `zᵀ Π̇ᵀ = -(Π ż)ᵀ`.
//!
//! Surfaces of neighbouring instants cross at the distance `zᵀf*/|ż|` from the orbit; beyond, the phase is not defined.
//! The share of the blend is chosen to make the smallest such distance as large as possible.
//! Source: Manchester 2011; section 8 of the model notes.

#![expect(non_snake_case, reason = "symbols of the equations")]

use super::trajectory::{Arc, Trajectory};
use super::tvlqr::{STEPS, Weights, impact_jacobian, linearised};
use nalgebra::{Matrix3, Matrix3x4, Matrix4, RowVector3, Vector3, Vector4};

/// Scale of the coordinates: a rate of 1 rad/s counts as .15 rad.
pub const SCALE: [f64; 4] = [1.0, 1.0, 0.15, 0.15];
/// Shares of a phase tried for the blend.
const BLENDS: [f64; 9] = [0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4, 0.45, 0.5];
/// A start belongs to the guard if the flow crosses it at more than this cosine.
const ALIGNED: f64 = 0.1;
/// Cycles of the periodic Riccati equation; it converges in three to six.
const CYCLES: usize = 60;

/// The surfaces of one phase on a grid of half steps, `2 STEPS + 1` instants.
#[derive(Clone, Debug)]
pub struct Surfaces {
    /// Normals in scaled coordinates.
    pub z: Vec<Vector4<f64>>,
    /// Bases of the surfaces in scaled coordinates.
    pub basis: Vec<Matrix3x4<f64>>,
    /// A⊥ and B⊥.
    pub a: Vec<Matrix3<f64>>,
    /// See `a`.
    pub b: Vec<Vector3<f64>>,
    /// Smallest `zᵀ f*/|f*|`: must be positive.
    pub alignment: f64,
    /// Smallest distance at which neighbouring surfaces cross, scaled coordinates.
    pub room: f64,
    /// Share of the phase over which the normals turn.
    pub blend: f64,
}

/// Why there are no transverse gains.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum TransverseError {
    /// The flow does not cross the surfaces.
    #[error("the motion does not cross its transverse surfaces (phase {phase}): it slows down too much there")]
    IllPosed {
        /// Phase, from 1.
        phase: usize,
    },
    /// The Riccati equation does not settle.
    #[error("the periodic Riccati equation does not converge: change {change:.1e} after {CYCLES} cycles")]
    NoConvergence {
        /// Relative change over the last cycle.
        change: f64,
    },
    /// A touchdown without an impact map.
    #[error("an impact of the motion is singular")]
    SingularImpact,
}

/// Gains of a phase at `STEPS + 1` equally spaced instants.
#[derive(Clone, Debug)]
pub struct Transverse {
    /// `τ = τ* - k x⊥`, torque normalised.
    pub gain: Vec<RowVector3<f64>>,
    /// Cost-to-go of x⊥.
    pub cost: Vec<Matrix3<f64>>,
}

/// Transverse design of a motion whose every phase ends at a touchdown.
#[derive(Clone, Debug)]
pub struct Design {
    /// Surfaces of every phase.
    pub surfaces: Vec<Surfaces>,
    /// Gains of every phase.
    pub gains: Vec<Transverse>,
    /// Jump of x⊥ at the end of every phase but, for a motion that is not periodic, the last.
    pub jumps: Vec<Matrix3<f64>>,
    /// Largest multiplier of a cycle without feedback; not a number if not periodic.
    pub open_loop: f64,
    /// The same with feedback.
    pub closed_loop: f64,
}

/// How fast the normals turn from the guard's to the flow's.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Blend {
    /// The share of the phase that leaves most room around the orbit.
    Best,
    /// This share.
    Share(f64),
}

/// Designs surfaces and gains. A motion that is not periodic ends with the cost `end` by state before its last impact.
///
/// # Errors
/// [`TransverseError`].
pub fn design(
    motion: &Trajectory,
    weights: &Weights,
    blend: Blend,
    end: Option<&Matrix4<f64>>,
) -> Result<Design, TransverseError> {
    let mut surfaces = Vec::new();
    for (p, arc) in motion.arcs.iter().enumerate() {
        surfaces.push(best_surfaces(arc, blend).ok_or(TransverseError::IllPosed { phase: p + 1 })?);
    }
    let jumps = jumps(motion, &surfaces, end.is_none()).ok_or(TransverseError::SingularImpact)?;
    let gains = match end {
        Some(end) => {
            let last = surfaces[surfaces.len() - 1].basis[2 * STEPS] * unscale();
            cycle(motion, weights, &surfaces, &jumps, &(last * end * last.transpose()))
        }
        None => periodic(motion, weights, &surfaces, &jumps)?,
    };
    let zero = |_: usize, _: usize| RowVector3::zeros();
    let open_loop = multiplier(motion, &surfaces, &jumps, zero);
    let closed_loop = multiplier(motion, &surfaces, &jumps, |p, k| gains[p].gain[k]);
    Ok(Design { surfaces, gains, jumps, open_loop, closed_loop })
}

fn scale() -> Matrix4<f64> {
    Matrix4::from_diagonal(&Vector4::from(SCALE))
}

fn unscale() -> Matrix4<f64> {
    Matrix4::from_diagonal(&Vector4::from(SCALE.map(|s| 1.0 / s)))
}

fn best_surfaces(arc: &Arc, blend: Blend) -> Option<Surfaces> {
    let shares = match blend {
        Blend::Best => BLENDS.to_vec(),
        Blend::Share(share) => vec![share],
    };
    // A motion from rest does not cross the guard's surface at its start: there the flow is the normal from the first.
    let start = scale() * Vector4::from(arc.flow(&arc.state(0.0), arc.torque(0.0)));
    let from_guard = guard_normal().dot(&start) > ALIGNED * start.norm();
    let candidates = shares.iter().map(|blend| surfaces(arc, *blend, from_guard)).filter(|s| s.alignment > 0.0);
    candidates.max_by(|a, b| a.room.total_cmp(&b.room))
}

/// Surfaces with one share of the blend.
fn surfaces(arc: &Arc, blend: f64, from_guard: bool) -> Surfaces {
    let n = 2 * STEPS;
    #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
    let h = arc.duration_s / n as f64;
    #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
    let at = |k: usize| (k as f64 * h).min(arc.duration_s);
    let flow = |t: f64| scale() * Vector4::from(arc.flow(&arc.state(t), arc.torque(t)));
    let normal = |t: f64| {
        let share = t / arc.duration_s;
        normal(&flow(t), if from_guard { share.min(1.0 - share) } else { 1.0 - share }, blend)
    };
    let mut out = Surfaces {
        z: Vec::new(),
        basis: Vec::new(),
        a: Vec::new(),
        b: Vec::new(),
        alignment: f64::INFINITY,
        room: f64::INFINITY,
        blend,
    };
    let mut basis = first_basis(&normal(0.0));
    for k in 0..=n {
        let (t, f) = (at(k), flow(at(k)));
        let z = normal(t);
        // One-sided at the ends of the phase.
        let step = 1e-5 * arc.duration_s;
        let (early, late) = ((t - step).max(0.0), (t + step).min(arc.duration_s));
        let dz = (normal(late) - normal(early)) / (late - early);
        basis = carried(&basis, &z);
        let along = z.dot(&f);
        out.alignment = out.alignment.min(along / f.norm());
        out.room = out.room.min(along / dz.norm());
        let (A, B) = linearised(arc, t);
        let (A, B) = (scale() * A * unscale(), scale() * B);
        let Pf = basis * f / along;
        out.a.push(
            basis * A * basis.transpose() - Pf * (z.transpose() * A * basis.transpose() + (basis * dz).transpose()),
        );
        out.b.push(basis * B - Pf * z.dot(&B));
        out.z.push(z);
        out.basis.push(basis);
    }
    out
}

/// The guard's unit normal, pointing along a walk.
fn guard_normal() -> Vector4<f64> {
    Vector4::new(-1.0, -1.0, 0.0, 0.0) / std::f64::consts::SQRT_2
}

/// Unit normal: the guard's at the ends, the flow's direction beyond the share `blend` of the phase from them.
fn normal(f: &Vector4<f64>, from_end: f64, blend: f64) -> Vector4<f64> {
    let guard = guard_normal();
    let near = from_end / blend;
    let weight = if near >= 1.0 { 0.0 } else { 0.5 + 0.5 * libm::cos(std::f64::consts::PI * near) };
    (guard * weight + f.normalize() * (1.0 - weight)).normalize()
}

/// Any orthonormal basis of the complement of `z`.
fn first_basis(z: &Vector4<f64>) -> Matrix3x4<f64> {
    let mut rows: Vec<Vector4<f64>> = Vec::new();
    let mut axes: Vec<usize> = (0..4).collect();
    axes.sort_by(|a, b| z[*a].abs().total_cmp(&z[*b].abs()));
    for axis in axes.into_iter().take(3) {
        let mut e = Vector4::zeros();
        e[axis] = 1.0;
        e -= z * z.dot(&e);
        for row in &rows {
            e -= row * row.dot(&e);
        }
        rows.push(e.normalize());
    }
    Matrix3x4::from_fn(|i, j| rows[i][j])
}

/// The basis moved parallel to a new normal: projected and made orthonormal again, symmetrically (Löwdin), which does
/// not turn it within the surface to second order.
fn carried(basis: &Matrix3x4<f64>, z: &Vector4<f64>) -> Matrix3x4<f64> {
    let flat = basis - (basis * z) * z.transpose();
    let gram = flat * flat.transpose();
    let eigen = gram.symmetric_eigen();
    let root = eigen.eigenvalues.map(|e| 1.0 / libm::sqrt(e));
    eigen.eigenvectors * Matrix3::from_diagonal(&root) * eigen.eigenvectors.transpose() * flat
}

/// `Π⁺ D Π⁻ᵀ` at every touchdown.
fn jumps(motion: &Trajectory, surfaces: &[Surfaces], periodic: bool) -> Option<Vec<Matrix3<f64>>> {
    let count = motion.arcs.len();
    let touchdowns = if periodic { count } else { count - 1 };
    (0..touchdowns)
        .map(|p| {
            let arc = &motion.arcs[p];
            let D = scale() * impact_jacobian(arc, &arc.state(arc.duration_s))? * unscale();
            let after = surfaces[(p + 1) % count].basis[0];
            let before = surfaces[p].basis.last()?;
            Some(after * D * before.transpose())
        })
        .collect()
}

fn periodic(
    motion: &Trajectory,
    weights: &Weights,
    surfaces: &[Surfaces],
    jumps: &[Matrix3<f64>],
) -> Result<Vec<Transverse>, TransverseError> {
    let last = jumps[jumps.len() - 1];
    let mut start = Matrix3::<f64>::identity();
    let mut change = f64::INFINITY;
    for _ in 0..CYCLES {
        let gains = cycle(motion, weights, surfaces, jumps, &(last.transpose() * start * last));
        let new = gains[0].cost[0];
        change = (new - start).norm() / new.norm();
        start = new;
        if change < 1e-12 {
            return Ok(gains);
        }
    }
    Err(TransverseError::NoConvergence { change })
}

/// The Riccati equation backwards over all phases, from the cost `end` before the last touchdown.
fn cycle(
    motion: &Trajectory,
    weights: &Weights,
    surfaces: &[Surfaces],
    jumps: &[Matrix3<f64>],
    end: &Matrix3<f64>,
) -> Vec<Transverse> {
    let mut S = *end;
    let mut out = Vec::new();
    for p in (0..motion.arcs.len()).rev() {
        if p + 1 < motion.arcs.len() {
            S = jumps[p].transpose() * S * jumps[p];
        }
        let phase = backwards(motion.arcs[p].duration_s, weights, &surfaces[p], &S);
        S = phase.cost[0];
        out.push(phase);
    }
    out.reverse();
    out
}

fn slope(S: &Matrix3<f64>, s: &Surfaces, k: usize, w: &Weights) -> Matrix3<f64> {
    let (A, B, P) = (&s.a[k], &s.b[k], &s.basis[k]);
    let Q = P * unscale() * w.q() * unscale() * P.transpose();
    let SB = S * B;
    A.transpose() * S + S * A - SB * SB.transpose() / w.torque + Q
}

fn backwards(duration_s: f64, weights: &Weights, s: &Surfaces, end: &Matrix3<f64>) -> Transverse {
    #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
    let h = duration_s / STEPS as f64;
    let gain = |S: &Matrix3<f64>, k: usize| s.b[k].transpose() * S / weights.torque;
    let mut S = *end;
    let mut out = Transverse { gain: vec![gain(&S, 2 * STEPS)], cost: vec![S] };
    for k in (0..STEPS).rev() {
        let (late, mid, early) = (2 * k + 2, 2 * k + 1, 2 * k);
        let k1 = slope(&S, s, late, weights);
        let k2 = slope(&(S + k1 * (h / 2.0)), s, mid, weights);
        let k3 = slope(&(S + k2 * (h / 2.0)), s, mid, weights);
        let k4 = slope(&(S + k3 * h), s, early, weights);
        S += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        S = (S + S.transpose()) * 0.5;
        out.gain.push(gain(&S, early));
        out.cost.push(S);
    }
    out.gain.reverse();
    out.cost.reverse();
    out
}

/// Largest eigenvalue (in size) of x⊥ over a cycle under `τ = τ* - gain x⊥`.
fn multiplier(
    motion: &Trajectory,
    surfaces: &[Surfaces],
    jumps: &[Matrix3<f64>],
    gain: impl Fn(usize, usize) -> RowVector3<f64>,
) -> f64 {
    if jumps.len() < motion.arcs.len() {
        return f64::NAN;
    }
    let mut M = Matrix3::identity();
    for (p, s) in surfaces.iter().enumerate() {
        #[expect(clippy::cast_precision_loss, reason = "a few hundred steps")]
        let h = motion.arcs[p].duration_s / STEPS as f64;
        for k in 0..STEPS {
            let closed = |i: usize, g: RowVector3<f64>| s.a[i] - s.b[i] * g;
            let (g0, g1) = (gain(p, k), gain(p, k + 1));
            let mid = closed(2 * k + 1, (g0 + g1) * 0.5);
            let k1 = closed(2 * k, g0) * M;
            let k2 = mid * (M + k1 * (h / 2.0));
            let k3 = mid * (M + k2 * (h / 2.0));
            let k4 = closed(2 * k + 2, g1) * (M + k3 * h);
            M += (k1 + (k2 + k3) * 2.0 + k4) * (h / 6.0);
        }
        M = jumps[p] * M;
    }
    M.complex_eigenvalues().iter().map(|e| libm::hypot(e.re, e.im)).fold(0.0, f64::max)
}

/// Row of the surface and gain by plain state differences, from node `k` of `STEPS` of a phase.
impl Design {
    /// Normal by the unscaled state.
    #[must_use]
    pub fn surface(&self, phase: usize, k: usize) -> [f64; 4] {
        (scale() * self.surfaces[phase].z[2 * k]).into()
    }

    /// Gain by the unscaled state, torque normalised.
    #[must_use]
    pub fn gain(&self, phase: usize, k: usize) -> [f64; 4] {
        (self.gains[phase].gain[k] * self.surfaces[phase].basis[2 * k] * scale()).transpose().into()
    }

    /// Cost-to-go by the unscaled state.
    #[must_use]
    pub fn cost(&self, phase: usize, k: usize) -> Matrix4<f64> {
        let P = self.surfaces[phase].basis[2 * k] * scale();
        P.transpose() * self.gains[phase].cost[k] * P
    }
}
