//! Planned motions with their gains: the file format, and look-up at a phase of the motion.
//!
//! `compass plan` writes this file, controllers read it before arming. States are `[θs, θw, θ̇s, θ̇w]`, stance leg first,
//! torques Nm on the stance row, friction already taken off: the law adds its compensation. A table has equally spaced
//! nodes from the first to the last instant of a phase; between two nodes states are cubics (their rates stand in the
//! node), everything else is linear.
//!
//! Time-varying law (TV-LQR): `τ = torque(t) - time_gain (x - state(t))`.
//! Transverse law: `t` with `surface(t) (x - state(t)) = 0`, then `τ = torque(t) - transverse_gain (x - state(t))`.
//! RT: reading and writing before arming only; look-up yes, no allocation.
#![expect(clippy::disallowed_types, clippy::disallowed_macros, clippy::disallowed_methods, reason = "before arming")]

use crate::base::linalg::{add_scaled, dot};
use crate::model::compass_gait::params::Params;
use nalgebra::SVector;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;

/// First word of every plan file: format and version.
pub const FORMAT: &str = "compass-plan-1";

/// A plan file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PlanFile {
    /// [`FORMAT`].
    pub format: String,
    /// What it is: gait, rebalance, step-in, change, stop.
    pub kind: String,
    /// The command that made it.
    pub command: String,
    /// [`model_hash`] of the model it was made for.
    pub model_hash: String,
    /// The last impact leads back to the first state.
    pub periodic: bool,
    /// Length of the last step, m.
    pub step_m: f64,
    /// Mean speed, m/s; 0 where it has no meaning.
    pub speed_m_s: f64,
    /// Toes of the swing leg, if the plan asks for clearance.
    pub toes: Option<ToeTravel>,
    /// Phases in order of time.
    pub phases: Vec<PhaseTable>,
}

/// How the swing leg's toe is to be drawn in.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ToeTravel {
    /// Clearance that the plan keeps, m.
    pub clearance_m: f64,
    /// Travel, m.
    pub retract_m: f64,
    /// Speed, m/s.
    pub rate_m_s: f64,
    /// Acceleration, m/s².
    pub acceleration_m_s2: f64,
    /// Clearance is kept until this long before touchdown, s.
    pub until_s: f64,
}

/// How a phase ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PhaseEnd {
    /// The swing foot lands and the other leg stands from then on.
    Touchdown,
    /// The swing foot lands and both feet stay.
    Rest,
    /// Upright, or another state: no touchdown.
    State,
}

/// One phase.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PhaseTable {
    /// The inner leg stands.
    pub inner_stands: bool,
    /// How it ends.
    pub end: PhaseEnd,
    /// Duration, s.
    pub duration_s: f64,
    /// Transverse surfaces and gains are in the nodes; not for motions that end at rest, where no surface exists.
    pub transverse: bool,
    /// The nodes.
    pub nodes: Vec<Node>,
}

/// A node of a table.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Node {
    /// Planned state.
    pub state: [f64; 4],
    /// Its derivative.
    pub rate: [f64; 4],
    /// Planned net torque, Nm.
    pub torque_nm: f64,
    /// Gain of the time-varying law, Nm per state.
    pub time_gain_nm: [f64; 4],
    /// Its cost-to-go: upper triangle of S by rows, for torque divided by `m_t l²`.
    pub time_cost: [f64; 10],
    /// Row of the transverse surface through the planned state.
    pub surface: [f64; 4],
    /// Gain of the transverse law, Nm per state.
    pub transverse_gain_nm: [f64; 4],
    /// Its cost-to-go, upper triangle by rows; zero along the flow.
    pub transverse_cost: [f64; 10],
}

/// Why a plan cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    /// The file cannot be read.
    #[error("{file}: {cause}")]
    Read {
        /// Which.
        file: String,
        /// Why.
        cause: std::io::Error,
    },
    /// The file is no plan.
    #[error("{file}: not a {form} file ({cause})")]
    Format {
        /// Which.
        file: String,
        /// What it should be: plan or tree.
        form: &'static str,
        /// Why.
        cause: String,
    },
    /// Made for another robot.
    #[error(
        "{file}: made for another model (its hash {theirs:.12}…, this model's {ours:.12}…): a gait and its gains hold for \
         one set of numbers only; make it anew with `compass plan`"
    )]
    OtherModel {
        /// Which.
        file: String,
        /// Hash in the file.
        theirs: String,
        /// Hash of the model in use.
        ours: String,
    },
}

/// SHA-256 over the bits of everything that the equations of motion use, hexadecimal.
#[must_use]
pub fn model_hash(model: &Params<f64>) -> String {
    let Params { c, leg_length_m, total_mass_kg, gravity_m_s2, viscous_nm_s_rad, coulomb_nm } = *model;
    let mut hash = Sha256::new();
    for x in c.iter().chain(&[leg_length_m, total_mass_kg, gravity_m_s2, viscous_nm_s_rad, coulomb_nm]) {
        hash.update(x.to_bits().to_le_bytes());
    }
    hash.finalize().iter().fold(String::new(), |mut out, byte| {
        out.push_str(&format!("{byte:02x}"));
        out
    })
}

impl PlanFile {
    /// Reads a plan for a model. Before arming only.
    ///
    /// # Errors
    /// [`PlanError`]: not readable, not a plan, or made for another model.
    pub fn read(path: &Path, model: &Params<f64>) -> Result<Self, PlanError> {
        let file = path.display().to_string();
        let text = std::fs::read_to_string(path).map_err(|cause| PlanError::Read { file: file.clone(), cause })?;
        Self::parse(&file, &text, model)
    }

    /// Reads a plan from its text, `file` being what errors call it.
    ///
    /// # Errors
    /// [`PlanError`]: not a plan, or made for another model.
    pub fn parse(file: &str, text: &str, model: &Params<f64>) -> Result<Self, PlanError> {
        let plan = Self::parse_any(file, text)?;
        let ours = model_hash(model);
        if plan.model_hash != ours {
            return Err(PlanError::OtherModel { file: file.to_owned(), theirs: plan.model_hash, ours });
        }
        Ok(plan)
    }

    /// Reads a plan whatever its model, for looking at it.
    ///
    /// # Errors
    /// [`PlanError::Format`].
    pub fn parse_any(file: &str, text: &str) -> Result<Self, PlanError> {
        let wrong = |cause: String| PlanError::Format { file: file.to_owned(), form: "plan", cause };
        let plan: Self = serde_json::from_str(text).map_err(|cause| wrong(cause.to_string()))?;
        if plan.format != FORMAT {
            return Err(wrong(format!("format `{}`, expected `{FORMAT}`", plan.format)));
        }
        if plan.phases.is_empty() || plan.phases.iter().any(|phase| !phase.is_sound()) {
            return Err(wrong("a phase needs two nodes, a positive duration and finite numbers".to_owned()));
        }
        Ok(plan)
    }

    /// Text of the file: one line per node.
    ///
    /// # Errors
    /// Only if a number is not finite.
    pub fn to_text(&self) -> Result<String, serde_json::Error> {
        Ok(serde_json::to_string(self)?
            .replace("{\"state\"", "\n{\"state\"")
            .replace("{\"inner_stands\"", "\n{\"inner_stands\"")
            + "\n")
    }
}

impl PhaseTable {
    fn is_sound(&self) -> bool {
        let finite = |node: &Node| {
            let Node { state, rate, torque_nm, time_gain_nm, time_cost, surface, transverse_gain_nm, transverse_cost } =
                node;
            let rows = state.iter().chain(rate).chain(time_gain_nm).chain(surface).chain(transverse_gain_nm);
            rows.chain(time_cost).chain(transverse_cost).chain([torque_nm]).all(|x| x.is_finite())
        };
        self.nodes.len() >= 2 && self.duration_s.is_finite() && self.duration_s > 0.0 && self.nodes.iter().all(finite)
    }

    /// Everything at the instant `t_s` of the phase, held at its ends. RT: yes.
    #[must_use]
    pub fn at(&self, t_s: f64) -> Node {
        #[expect(clippy::cast_precision_loss, reason = "a few hundred nodes")]
        let intervals = self.nodes.len().saturating_sub(1) as f64;
        let place = (t_s / self.duration_s * intervals).clamp(0.0, intervals);
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped")]
        let k = (place as usize).min(self.nodes.len().saturating_sub(2));
        let (Some(a), Some(b)) = (self.nodes.get(k), self.nodes.get(k + 1)) else { return Node::default() };
        #[expect(clippy::cast_precision_loss, reason = "a few hundred nodes")]
        let s = place - k as f64;
        a.between(b, s, self.duration_s / intervals)
    }

    /// The instant whose surface goes through `x`, by Newton from `near_s`; `steps` at most. RT: yes.
    #[must_use]
    pub fn project(&self, x: &[f64; 4], near_s: f64, steps: u32) -> f64 {
        let mut t = near_s;
        for _ in 0..steps {
            let node = self.at(t);
            let ahead = dot(&node.surface, &add_scaled(x, -1.0, &node.state));
            let speed = dot(&node.surface, &node.rate);
            let dt = ahead / speed;
            if !dt.is_finite() {
                return t;
            }
            // A surface far away says little: at most a tenth of the phase at once.
            let reach = 0.1 * self.duration_s;
            t = (t + dt.clamp(-reach, reach)).clamp(0.0, self.duration_s);
        }
        t
    }
}

impl Node {
    /// Between this node and the next, `s` from 0 to 1, `h` seconds apart.
    fn between(&self, next: &Self, s: f64, h: f64) -> Self {
        fn mix<const N: usize>(a: &[f64; N], b: &[f64; N], s: f64) -> [f64; N] {
            (SVector::from(*a) * (1.0 - s) + SVector::from(*b) * s).into()
        }
        let (s2, s3) = (s * s, s * s * s);
        let [a, b, c, d] = [2.0 * s3 - 3.0 * s2 + 1.0, (s3 - 2.0 * s2 + s) * h, 3.0 * s2 - 2.0 * s3, (s3 - s2) * h];
        let states = SVector::from(self.state) * a + SVector::from(next.state) * c;
        let rates = SVector::from(self.rate) * b + SVector::from(next.rate) * d;
        Self {
            state: (states + rates).into(),
            rate: mix(&self.rate, &next.rate, s),
            torque_nm: self.torque_nm + s * (next.torque_nm - self.torque_nm),
            time_gain_nm: mix(&self.time_gain_nm, &next.time_gain_nm, s),
            time_cost: mix(&self.time_cost, &next.time_cost, s),
            surface: mix(&self.surface, &next.surface, s),
            transverse_gain_nm: mix(&self.transverse_gain_nm, &next.transverse_gain_nm, s),
            transverse_cost: mix(&self.transverse_cost, &next.transverse_cost, s),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn plan() -> PlanFile {
        let node = |k: f64| Node {
            state: [k, 0.0, 1.0, 0.0],
            rate: [1.0, 0.0, 0.0, 0.0],
            surface: [1.0, 0.0, 0.0, 0.0],
            torque_nm: 2.0 * k,
            ..Node::default()
        };
        let phase = PhaseTable {
            inner_stands: true,
            end: PhaseEnd::Touchdown,
            duration_s: 3.0,
            transverse: true,
            nodes: (0..4).map(|k| node(f64::from(k))).collect(),
        };
        PlanFile {
            format: FORMAT.into(),
            kind: "gait".into(),
            command: "test".into(),
            model_hash: model_hash(&Params::sysid()),
            periodic: true,
            step_m: 0.1 + 0.2,
            speed_m_s: 0.4,
            toes: None,
            phases: vec![phase],
        }
    }

    #[test]
    fn file_comes_back_to_the_bit_and_only_for_its_own_model() {
        let text = plan().to_text().unwrap();
        assert_eq!(PlanFile::parse("f", &text, &Params::sysid()).unwrap(), plan());
        let mut other = Params::sysid();
        other.c[3] += 1e-6;
        let error = PlanFile::parse("my.plan", &text, &other).unwrap_err().to_string();
        assert!(error.contains("my.plan") && error.contains("another model"), "{error}");
        let odd = text.replace("\"speed_m_s\"", "\"speed\"");
        assert!(matches!(PlanFile::parse("f", &odd, &Params::sysid()), Err(PlanError::Format { .. })));
    }

    #[test]
    fn look_up_meets_the_nodes_and_runs_between_them() {
        let plan = plan();
        let phase = &plan.phases[0];
        for (t, want) in [(-1.0, 0.0), (0.0, 0.0), (1.25, 1.25), (3.0, 3.0), (9.0, 3.0)] {
            let node = phase.at(t);
            assert!((node.state[0] - want).abs() < 1e-12 && (node.torque_nm - 2.0 * want).abs() < 1e-12);
        }
        assert!((phase.project(&[1.7, 9.0, 9.0, 9.0], 1.5, 3) - 1.7).abs() < 1e-12);
        assert!(phase.at(f64::NAN).state[0].is_nan() || phase.at(f64::NAN).state[0].abs() < 4.0);
    }
}
