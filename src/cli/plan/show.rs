//! `compass plan show`: a plan as a page. RT: no.

use crate::cli::config_args::ConfigArgs;
use crate::cli::output::spare_inputs;
use crate::cli::{Outcome, Run};
use crate::control::tables::{PhaseTable, PlanFile};
use crate::model::compass_gait::dynamics::friction;
use crate::model::compass_gait::params::Params;
use crate::report::motion::{Instant, Motion, Stance, page};
use anyhow::Context;
use std::fs;
use std::io::{self, Write};
use std::path::PathBuf;

/// Draws a plan: phase portrait, torque, clearance, ground force, animation.
#[derive(clap::Args)]
#[command(after_help = "Example:\n  compass plan show gait.plan --out gait.html")]
pub(super) struct Args {
    /// The plan
    file: PathBuf,
    /// The page
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    config: ConfigArgs,
}

/// Instants per phase on the page.
const INSTANTS: u32 = 200;

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        spare_inputs("--out", [&self.out], &[self.config.files(), vec![self.file.clone()]].concat())?;
        let config = self.config.load()?.config;
        let robot = config.robot.model.params();
        let plan = PlanFile::read(&self.file, &robot)?;
        let motion = motion(&plan, &robot);
        fs::write(&self.out, page(&motion)).with_context(|| self.out.display().to_string())?;
        writeln!(io::stdout(), "{}", self.out.display())?;
        Ok(Outcome::Fine)
    }
}

/// What the page draws.
fn motion(plan: &PlanFile, robot: &Params<f64>) -> Motion {
    let mut instants = Vec::new();
    let mut begin_s = 0.0;
    let mut foot_m = [0.0, 0.0];
    for phase in &plan.phases {
        for k in 0..=INSTANTS {
            let t_s = phase.duration_s * f64::from(k) / f64::from(INSTANTS);
            instants.push(instant(plan, phase, robot, t_s, begin_s, foot_m));
        }
        begin_s += phase.duration_s;
        let x = phase.at(phase.duration_s).state;
        let l = robot.leg_length_m;
        foot_m[0] += l * (libm::sin(x[1]) - libm::sin(x[0]));
        foot_m[1] += l * (libm::cos(x[0]) - libm::cos(x[1]));
    }
    let kind = &plan.kind;
    let title = if plan.periodic {
        format!("{kind}: steps of {:.3} m at {:.2} m/s", plan.step_m, plan.speed_m_s)
    } else {
        format!("{kind}: {} phases in {begin_s:.2} s", plan.phases.len())
    };
    Motion { title, command: plan.command.clone(), leg_m: robot.leg_length_m, periodic: plan.periodic, instants }
}

fn instant(
    plan: &PlanFile,
    phase: &PhaseTable,
    robot: &Params<f64>,
    t_s: f64,
    begin_s: f64,
    foot_m: [f64; 2],
) -> Instant {
    let params = if phase.inner_stands { *robot } else { robot.swapped() };
    let node = phase.at(t_s);
    let ([s, w, vs, vw], l) = (node.state, robot.leg_length_m);
    let compensation = friction(&params.normalised(), vs - vw) * params.inertia_kg_m2();
    let [fx, fy] = params.ground_force_n([s, w], [vs, vw], node.torque_nm);
    let drawn_in_m = plan.toes.map_or(0.0, |toes| {
        crate::design::problem::Clearance {
            begun_s: 0.0,
            height_m: toes.clearance_m,
            retract_m: toes.retract_m,
            rate_m_s: toes.rate_m_s,
            acceleration_m_s2: toes.acceleration_m_s2,
            until_s: toes.until_s,
        }
        .drawn_in(t_s, phase.duration_s)
    });
    Instant {
        t_s: begin_s + t_s,
        stance: if phase.inner_stands { Stance::Inner } else { Stance::Outer },
        state: node.state,
        torque_nm: node.torque_nm,
        motor_nm: node.torque_nm - compensation,
        clearance_m: l * (libm::cos(s) - libm::cos(w)) + drawn_in_m * libm::cos(w),
        drawn_in_m,
        force_ratio: fx / fy,
        normal_n: fy,
        foot_m,
    }
}
