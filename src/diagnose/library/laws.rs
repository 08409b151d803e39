//! Effects that are a law of one coordinate or its rate: what acts, reads or comes of a command at one point, and the numbers for which
//! a law is nearest to a force that is known along a run.
//!
//! RT: no.

use crate::diagnose::library::candidates::Candidate;
use crate::model::effect::EffectKind;
use crate::model::rig::Effect;

/// What a law goes with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Form {
    /// Friction over the rate of a coordinate.
    Friction,
    /// Conservative force over a coordinate.
    Force,
    /// Error of an encoder over the coordinate that it reads.
    Reading,
    /// Applied over commanded torque.
    Saturation,
}

/// What an effect goes with; `None` if it is no law of one number.
#[must_use]
pub fn form(kind: EffectKind) -> Option<Form> {
    match kind {
        EffectKind::ViscousFriction
        | EffectKind::CoulombFriction
        | EffectKind::StribeckFriction
        | EffectKind::QuadraticDrag
        | EffectKind::FrictionAsymmetry => Some(Form::Friction),
        EffectKind::ParallelSpring | EffectKind::TorqueOffset | EffectKind::TorqueRipple => Some(Form::Force),
        EffectKind::EncoderEccentricity => Some(Form::Reading),
        EffectKind::TorqueLimit => Some(Form::Saturation),
        _ => None,
    }
}

/// Friction (against the motion), force or error of a reading at `x` (rad, m, rad/s or m/s), in Nm, N, rad or m.
#[must_use]
pub fn at(effect: &Effect, x: f64) -> f64 {
    let v = |key: &str| effect.get(key).map_or(0.0, |v| v.value);
    let sign = if x < 0.0 { -1.0 } else { 1.0 };
    match effect.kind {
        EffectKind::ViscousFriction => v("viscous") * x,
        EffectKind::CoulombFriction => v("coulomb") * sign,
        EffectKind::StribeckFriction => v("extra") * libm::exp(-(x / v("velocity")).powi(2)) * sign,
        EffectKind::QuadraticDrag => v("quadratic") * x * x.abs(),
        EffectKind::FrictionAsymmetry => v("difference"),
        EffectKind::ParallelSpring => -v("stiffness") * (x - v("rest")),
        EffectKind::TorqueOffset => v("torque"),
        EffectKind::TorqueRipple => v("amplitude") * libm::sin(v("order") * x + v("phase")),
        EffectKind::EncoderEccentricity => v("amplitude") * libm::sin(x + v("phase")),
        _ => 0.0,
    }
}

/// Numbers of `candidate`, in the order of its keys, for which its law is nearest to the forces at `points` (x, force) in least squares.
/// `None` if it is no force of one coordinate, if a shape of it is not asked (a velocity), or if it would push the other way.
#[must_use]
pub fn nearest(candidate: &Candidate, points: &[(f64, f64)]) -> Option<Vec<f64>> {
    let key = |name: &str| candidate.keys.iter().find(|k| k.name == name);
    let through = |shape: fn(f64) -> f64| {
        let (above, below) =
            points.iter().fold((0.0, 0.0), |(a, b), (x, f)| (a + shape(*x) * f, b + shape(*x) * shape(*x)));
        (below > 0.0).then(|| vec![above / below])
    };
    let values = match EffectKind::from_id(candidate.effect)? {
        EffectKind::ViscousFriction => through(|x| x)?,
        EffectKind::CoulombFriction => through(f64::signum)?,
        EffectKind::QuadraticDrag => through(|x| x * x.abs())?,
        EffectKind::FrictionAsymmetry | EffectKind::TorqueOffset => through(|_| 1.0)?,
        EffectKind::ParallelSpring => {
            let [constant, slope] = two_shapes(points, |x| [1.0, x])?;
            (slope < 0.0).then(|| vec![-slope, -constant / slope])?
        }
        EffectKind::TorqueRipple => {
            let order = key("order").map(|k| 0.5 * (k.min + k.max))?;
            let [sine, cosine] = two_shapes(points, |x| [libm::sin(order * x), libm::cos(order * x)])?;
            let value = |name: &str| match name {
                "amplitude" => libm::hypot(sine, cosine),
                "phase" => libm::atan2(cosine, sine),
                _ => order,
            };
            candidate.keys.iter().map(|k| value(k.name)).collect()
        }
        _ => return None,
    };
    let is_within = candidate.keys.iter().zip(&values).all(|(k, v)| (k.min..=k.max).contains(v));
    is_within.then_some(values)
}

/// Amplitudes of two shapes that add up nearest to the forces at `points`.
fn two_shapes(points: &[(f64, f64)], shapes: impl Fn(f64) -> [f64; 2]) -> Option<[f64; 2]> {
    let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), nalgebra::Vector2::zeros());
    for (x, f) in points {
        let row = nalgebra::Vector2::from(shapes(*x));
        normal += row * row.transpose();
        right += row * *f;
    }
    normal.cholesky().map(|c| c.solve(&right)).map(|a| [a[0], a[1]])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::library::candidates::Key;
    use crate::model::rig::{Side, Value};

    #[test]
    fn stribeck_friction_falls_with_the_rate_and_turns_with_its_sign() {
        let stribeck = Effect::new(EffectKind::StribeckFriction, "q1", vec![Value::known(0.5), Value::known(0.1)]);
        assert!(at(&stribeck, 0.01) > 0.49 && at(&stribeck, 0.5) < 1e-6);
        assert!((at(&stribeck, -0.05) + at(&stribeck, 0.05)).abs() < 1e-15);
    }

    /// Each law of which the numbers are asked is found again in the forces that it makes.
    #[test]
    fn a_law_is_nearest_to_its_own_force() {
        let laws = [
            (EffectKind::ViscousFriction, vec![0.3]),
            (EffectKind::CoulombFriction, vec![0.3]),
            (EffectKind::QuadraticDrag, vec![0.3]),
            (EffectKind::FrictionAsymmetry, vec![-0.3]),
            (EffectKind::TorqueOffset, vec![-0.3]),
            (EffectKind::ParallelSpring, vec![1.4, 0.3]),
            (EffectKind::TorqueRipple, vec![0.2, 3.0, -2.0]),
        ];
        for (kind, values) in laws {
            let effect = Effect::new(kind, "q1", values.iter().map(|v| Value::known(*v)).collect());
            let points: Vec<(f64, f64)> =
                (-20..20).map(|i| 0.1 * f64::from(i) + 0.03).map(|x| (x, at(&effect, x))).collect();
            let bound = |name: &str, v: f64| if name == "order" { (v, v) } else { (-5.0, 5.0) };
            let key = |(k, v): (&crate::model::effect::Key, &f64)| {
                let (min, max) = bound(k.name, *v);
                Key { name: k.name, min, max, log: false }
            };
            let keys: Vec<Key> = kind.keys().iter().zip(&values).map(key).collect();
            let (starts, only, motor_sensor) = (Vec::new(), None, None);
            let candidate =
                Candidate { effect: kind.id(), at: "q1".into(), keys, starts, only, motor_sensor, side: Side::Link };
            let found = nearest(&candidate, &points).unwrap();
            assert!(found.iter().zip(&values).all(|(a, b)| (a - b).abs() < 1e-9), "{kind:?} {found:?}");
        }
    }
}
