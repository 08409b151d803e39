//! Which combinations of parameters the data determines, and which it does not.
//!
//! The reduced information matrix of a fit is scaled to relative changes of the parameters; each eigenvector is a
//! combination, its eigenvalue the inverse variance of that combination. An overparametrised optimisation fails
//! "without any warnings" (Thesis 4.2.3): this is the warning.
//! RT: no.

use nalgebra::DMatrix;

/// A combination whose relative standard deviation is beyond this is called undetermined: its sign is just known at
/// three standard deviations.
const UNDETERMINED: f64 = 0.33;

/// Members of a combination below this part of the largest are not named.
const LEAST_MEMBER: f64 = 0.1;

/// One parameter as the fit left it.
#[derive(Clone, Debug)]
pub struct Scaled {
    /// Name.
    pub name: String,
    /// Where the fit left it.
    pub value: f64,
    /// What a change of 100 % means: its value, or the width of its bounds if the value is small against that.
    pub scale: f64,
}

/// A combination of parameters that the data does not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// Parameters and their part in it, largest first, relative changes.
    pub parts: Vec<(String, f64)>,
    /// Standard deviation of the combination, relative; far above 1 if the data say nothing.
    pub relative_std: f64,
    /// What the data does know about them, in words; empty if there is nothing simple to say.
    pub known: String,
}

/// Standard deviation of each parameter, in its own unit; far beyond its scale where the data say nothing.
#[must_use]
pub fn deviations(information: &DMatrix<f64>, parameters: &[Scaled]) -> Vec<f64> {
    let (values, vectors) = eigen(information, parameters);
    (0..parameters.len())
        .map(|i| {
            let variance: f64 = (0..values.len()).map(|k| vectors[(i, k)].powi(2) / values[k].max(1e-300)).sum();
            libm::sqrt(variance) * parameters[i].scale
        })
        .collect()
}

/// The undetermined combinations, worst first.
#[must_use]
pub fn undetermined(information: &DMatrix<f64>, parameters: &[Scaled]) -> Vec<Combination> {
    let (values, vectors) = eigen(information, parameters);
    let mut out: Vec<Combination> = (0..values.len())
        .filter(|k| values[*k] < 1.0 / (UNDETERMINED * UNDETERMINED))
        .map(|k| {
            let direction: Vec<f64> = vectors.column(k).iter().copied().collect();
            Combination {
                parts: named(&direction, parameters),
                relative_std: 1.0 / libm::sqrt(values[k].max(1e-300)),
                known: known(&direction, parameters, |w| deviation_along(&values, &vectors, w)),
            }
        })
        .collect();
    out.sort_by(|a, b| b.relative_std.total_cmp(&a.relative_std));
    out
}

/// Standard deviation of the sum of relative changes weighted by `w`.
fn deviation_along(values: &[f64], vectors: &DMatrix<f64>, w: &[f64]) -> f64 {
    let along = |k: usize| -> f64 { vectors.column(k).iter().zip(w).map(|(v, w)| v * w).sum() };
    // What is left of a direction that cancels is rounding: a relative 1e-9 of the weights.
    let rounding = 1e-9 * w.iter().map(|x| x.abs()).sum::<f64>();
    let variance = |k: usize| {
        let part = along(k);
        if part.abs() <= rounding { 0.0 } else { part * part / values[k].max(1e-300) }
    };
    libm::sqrt((0..values.len()).map(variance).sum())
}

/// What stays fixed when the parameters move along `direction`: the ratios of a common scale, the sum of a pair.
fn known(direction: &[f64], parameters: &[Scaled], deviation: impl Fn(&[f64]) -> f64) -> String {
    let largest = direction.iter().map(|x| x.abs()).fold(0.0, f64::max);
    let members: Vec<usize> = (0..direction.len()).filter(|i| direction[*i].abs() >= LEAST_MEMBER * largest).collect();
    // Relative changes count in the sense of the value: a negative gain that grows, falls.
    let growth = |i: usize| direction[i] * parameters[i].scale / parameters[i].value;
    let (low, high) = members.iter().fold((f64::MAX, f64::MIN), |(l, h), i| (l.min(growth(*i)), h.max(growth(*i))));
    if members.len() > 1 && low * high > 0.0 && (low / high).max(high / low) < ALIKE {
        return "only their ratios are determined".to_owned();
    }
    let [a, b] = members[..] else { return String::new() };
    // Along the direction a changes by da and b by db: a - (da/db) b stays.
    let factor = -direction[a] * parameters[a].scale / (direction[b] * parameters[b].scale);
    let mut w = vec![0.0; direction.len()];
    (w[a], w[b]) = (parameters[a].scale, factor * parameters[b].scale);
    let sum = parameters[a].value + factor * parameters[b].value;
    let std = deviation(&w);
    if std.is_nan() || std >= 0.5 * sum.abs() {
        return String::new();
    }
    let sign = if factor < 0.0 { '-' } else { '+' };
    let (a, b) = (&parameters[a].name, &parameters[b].name);
    format!(
        "what is determined is {a} {sign} {:.3} {b} = {sum:.4e}, with a standard deviation of {std:.1e}",
        factor.abs()
    )
}

/// Growths that differ by less than this factor are one common scale.
const ALIKE: f64 = 1.3;

fn named(vector: &[f64], parameters: &[Scaled]) -> Vec<(String, f64)> {
    let largest = vector.iter().map(|x| x.abs()).fold(0.0, f64::max);
    let mut parts: Vec<(String, f64)> = vector
        .iter()
        .zip(parameters)
        .filter(|(x, _)| x.abs() >= LEAST_MEMBER * largest)
        .map(|(x, p)| (p.name.clone(), *x))
        .collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let sign = parts.first().map_or(1.0, |p| p.1.signum());
    for part in &mut parts {
        part.1 *= sign;
    }
    parts
}

/// Eigenvalues of the information for relative changes, and their vectors. Below rounding an eigenvalue means nothing:
/// it stands at the floor, so that the last digits of its vector do not reach the other parameters.
fn eigen(information: &DMatrix<f64>, parameters: &[Scaled]) -> (Vec<f64>, DMatrix<f64>) {
    let n = parameters.len();
    let relative = DMatrix::from_fn(n, n, |r, c| information[(r, c)] * parameters[r].scale * parameters[c].scale);
    let e = relative.symmetric_eigen();
    let floor = EIGENVALUE_ROUNDING * e.eigenvalues.amax();
    (e.eigenvalues.iter().map(|x| if *x > floor { *x } else { floor }).collect(), e.eigenvectors)
}

/// Relative accuracy of the eigenvalues of an information matrix that was summed over many samples.
const EIGENVALUE_ROUNDING: f64 = 1e-13;

impl Combination {
    /// In words, with the kind of recording that would determine it.
    #[must_use]
    pub fn sentence(&self) -> String {
        let names: Vec<&str> = self.parts.iter().map(|p| p.0.as_str()).collect();
        let spread = if self.relative_std > 10.0 {
            "hardly at all".to_owned()
        } else {
            format!("to no better than {:.0} %", 100.0 * self.relative_std)
        };
        let what = if names.len() == 1 {
            format!("{} is determined {spread}", names[0])
        } else {
            format!("{} move together: this combination is determined {spread}", names.join(", "))
        };
        let known = if self.known.is_empty() { String::new() } else { format!(" ({})", self.known) };
        format!("{what}{known}; {}.", remedy(&names))
    }
}

/// Which recording would tell the parameters of a combination apart.
fn remedy(names: &[&str]) -> &'static str {
    let any = |part: &str| names.iter().any(|n| n.contains(part));
    if any("mass2") && (any("moment1") || any("inertia1")) {
        "weigh link 2 and state its mass: motion alone shows only inertia1 + mass2 length1² and moment1 + mass2 length1"
    } else if names.iter().all(|n| matches!(*n, "c1" | "c2" | "c3" | "c4" | "c5" | "c6")) {
        "record both stances, each with its springs, longer and with larger hip motion"
    } else if any("gain") {
        "weigh the torque: record with a known mass or force attached, or state the gain"
    } else if any("inertia") || any("mass_kg") {
        "record fast motion (a chirp or steps), so that acceleration shows"
    } else if any("coulomb") || any("viscous") || any("stribeck") || any("load_friction") {
        "record constant speeds, slow and fast, in both directions"
    } else if any("gravity") || any("moment") || any("spring") {
        "record slow motion over the whole travel"
    } else if any("bias") {
        "record a rest position from both sides"
    } else {
        "record motion that excites it more, or hold it at a known value"
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scale_shared_by_two_parameters_is_named() {
        let names = ["inertia_kg_m2", "gain", "viscous"].map(|n| Scaled { name: n.into(), value: 1.0, scale: 1.0 });
        // Only the difference of the first two shows in the data.
        let j = DMatrix::from_row_slice(2, 3, &[1e3, -1e3, 0.0, 0.0, 0.0, 1e3]);
        let found = undetermined(&(j.transpose() * j), &names);
        assert_eq!(found.len(), 1);
        let mut parts: Vec<&str> = found[0].parts.iter().map(|p| p.0.as_str()).collect();
        parts.sort_unstable();
        assert_eq!(parts, ["gain", "inertia_kg_m2"]);
        assert!(found[0].sentence().contains("weigh the torque"), "{}", found[0].sentence());
        assert!(found[0].sentence().contains("only their ratios"), "{}", found[0].sentence());
    }

    #[test]
    fn the_sum_that_a_weak_pair_keeps_is_told_with_its_deviation() {
        let pair = [("c3", 6e-4), ("c6", 2.6e-3)].map(|(n, x)| Scaled { name: n.into(), value: x, scale: x });
        // c3 + 2 c6 is known to 1e-4; either alone only by the bounds.
        let j = DMatrix::from_row_slice(1, 2, &[1e4, 2e4]);
        let found = undetermined(&(j.transpose() * j), &pair);
        let said = found[0].sentence();
        assert!(said.contains("c3 + 2.000 c6 = 5.8000e-3, with a standard deviation of 1.0e-4"), "{said}");
        assert!(said.contains("both stances"), "{said}");
    }

    #[test]
    fn deviation_of_a_well_measured_parameter_is_the_textbook_one() {
        let names = [Scaled { name: "a".into(), value: 2.0, scale: 2.0 }];
        let d = deviations(&DMatrix::from_element(1, 1, 400.0), &names);
        assert!((d[0] - 0.05).abs() < 1e-12);
    }
}
