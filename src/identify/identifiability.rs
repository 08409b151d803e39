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
const NAMED: f64 = 0.2;

/// One parameter as the fit left it.
#[derive(Clone, Debug)]
pub struct Scaled {
    /// Name.
    pub name: String,
    /// What a change of 100 % means: its value, or the width of its bounds if the value is small against that.
    pub scale: f64,
}

/// A combination of parameters that the data does not determine.
#[derive(Clone, Debug, PartialEq)]
pub struct Combination {
    /// Parameters and their part in it, largest first, relative changes.
    pub parts: Vec<(String, f64)>,
    /// Standard deviation of the combination, relative; infinite if the data say nothing.
    pub relative_std: f64,
}

/// Standard deviation of each parameter, in its own unit; infinite where the data say nothing.
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
        .map(|k| Combination {
            parts: named(&vectors.column(k).iter().copied().collect::<Vec<_>>(), parameters),
            relative_std: if values[k] > 0.0 { 1.0 / libm::sqrt(values[k]) } else { f64::INFINITY },
        })
        .collect();
    out.sort_by(|a, b| b.relative_std.total_cmp(&a.relative_std));
    out
}

fn named(vector: &[f64], parameters: &[Scaled]) -> Vec<(String, f64)> {
    let largest = vector.iter().map(|x| x.abs()).fold(0.0, f64::max);
    let mut parts: Vec<(String, f64)> = vector
        .iter()
        .zip(parameters)
        .filter(|(x, _)| x.abs() >= NAMED * largest)
        .map(|(x, p)| (p.name.clone(), *x))
        .collect();
    parts.sort_by(|a, b| b.1.abs().total_cmp(&a.1.abs()));
    let sign = parts.first().map_or(1.0, |p| p.1.signum());
    for part in &mut parts {
        part.1 *= sign;
    }
    parts
}

fn eigen(information: &DMatrix<f64>, parameters: &[Scaled]) -> (Vec<f64>, DMatrix<f64>) {
    let n = parameters.len();
    let relative = DMatrix::from_fn(n, n, |r, c| information[(r, c)] * parameters[r].scale * parameters[c].scale);
    let e = relative.symmetric_eigen();
    (e.eigenvalues.iter().copied().collect(), e.eigenvectors)
}

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
        format!("{what}; {}.", remedy(&names))
    }
}

/// Which recording would tell the parameters of a combination apart.
fn remedy(names: &[&str]) -> &'static str {
    let any = |part: &str| names.iter().any(|n| n.contains(part));
    if names.iter().all(|n| matches!(*n, "c1" | "c2" | "c3" | "c4" | "c5" | "c6")) {
        "record the other stance as well, with the springs of that set-up and large hip motion"
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
        let names = ["inertia_kg_m2", "gain", "viscous"].map(|n| Scaled { name: n.into(), scale: 1.0 });
        // Only the difference of the first two shows in the data.
        let j = DMatrix::from_row_slice(2, 3, &[1e3, -1e3, 0.0, 0.0, 0.0, 1e3]);
        let found = undetermined(&(j.transpose() * j), &names);
        assert_eq!(found.len(), 1);
        let mut parts: Vec<&str> = found[0].parts.iter().map(|p| p.0.as_str()).collect();
        parts.sort_unstable();
        assert_eq!(parts, ["gain", "inertia_kg_m2"]);
        assert!(found[0].sentence().contains("weigh the torque"), "{}", found[0].sentence());
    }

    #[test]
    fn deviation_of_a_well_measured_parameter_is_the_textbook_one() {
        let names = [Scaled { name: "a".into(), scale: 2.0 }];
        let d = deviations(&DMatrix::from_element(1, 1, 400.0), &names);
        assert!((d[0] - 0.05).abs() < 1e-12);
    }
}
