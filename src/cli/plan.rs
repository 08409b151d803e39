//! `compass plan ...`: gaits, rebalances, step-ins, stops, changes of speed and LQR-trees, as files for the controllers.
//! RT: no.

mod show;
mod tree;

use super::config_args::ConfigArgs;
use super::output::spare_inputs;
use super::{Outcome, Run, UsageError, progress};
use crate::config::checked::Config;
use crate::control::tables::{PhaseTable, PlanFile};
use crate::design::file::{gains, plan_file};
use crate::design::problem::{Clearance, Cost, Limits, Problem};
use crate::design::solve::{Effort, Failure, Solution, plan};
use crate::design::tasks::Terms;
use crate::design::tvlqr::Weights;
use crate::msg::Leg;
use anyhow::Context;
use clap::{Subcommand, ValueEnum};
use nalgebra::Matrix4;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Plans motions of the walking robot with their feedback gains, and shows them.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass plan gait --step 0.4 --speed 0.4 --out gait.plan
  compass plan rebalance --stance inner --step 0.3 --out rebalance.plan
  compass plan step-in gait.plan --stance outer --out step-in.plan
  compass plan stop gait.plan --steps 3 --out stop.plan
  compass plan change gait.plan faster.plan --steps 2 --out change.plan
  compass plan tree --samples 20000 --out recovery.tree
  compass plan show gait.plan --out gait.html

A plan holds for the model it was made for; the file knows it. See docs/planning.md.
Exit codes: 0 planned, 1 infeasible (with the constraints that block), 2 usage, 3 bad input.")]
pub(crate) struct Args {
    #[command(subcommand)]
    task: Task,
}

#[derive(Subcommand)]
enum Task {
    /// Periodic walking in two steps
    #[command(after_help = "Example:\n  compass plan gait --step 0.4 --speed 0.4 --out gait.plan")]
    Gait {
        /// Step length, m
        #[arg(long, value_name = "M")]
        step: f64,
        /// Speed, m/s
        #[arg(long, value_name = "M_S")]
        speed: f64,
        #[command(flatten)]
        terms: TermArgs,
    },
    /// One step from a state to upright at rest on the other leg
    #[command(after_help = "Example:\n  compass plan rebalance --stance inner --step 0.3 --out rebalance.plan")]
    Rebalance {
        /// Leg that stands at first
        #[arg(long)]
        stance: Side,
        /// Step length, m; left out: anything from 0.1 to 0.6
        #[arg(long, value_name = "M")]
        step: Option<f64>,
        /// Start state: stance angle, swing angle (rad), their rates (rad/s)
        #[arg(
            long,
            value_name = "A,B,C,D",
            default_value = "0,0,0,0",
            value_delimiter = ',',
            allow_hyphen_values = true
        )]
        from: Vec<f64>,
        #[command(flatten)]
        terms: TermArgs,
    },
    /// From standing upright into a gait
    #[command(after_help = "Example:\n  compass plan step-in gait.plan --stance outer --out step-in.plan")]
    StepIn {
        /// Gait to join
        gait: PathBuf,
        /// Leg that stands at first
        #[arg(long)]
        stance: Side,
        /// Steps on the way
        #[arg(long, default_value_t = 1)]
        steps: usize,
        #[command(flatten)]
        terms: TermArgs,
    },
    /// From a gait to rest on both feet
    #[command(after_help = "Example:\n  compass plan stop gait.plan --steps 3 --out stop.plan")]
    Stop {
        /// Gait to leave
        gait: PathBuf,
        /// Leg that stands at first
        #[arg(long, default_value = "inner")]
        stance: Side,
        /// Steps on the way, the last of which ends at rest
        #[arg(long, default_value_t = 3)]
        steps: usize,
        #[command(flatten)]
        terms: TermArgs,
    },
    /// From one gait into another
    #[command(after_help = "Example:\n  compass plan change slow.plan fast.plan --steps 2 --out change.plan")]
    Change {
        /// Gait to leave
        gait: PathBuf,
        /// Gait to join
        to: PathBuf,
        /// Leg that stands at first
        #[arg(long, default_value = "inner")]
        stance: Side,
        /// Steps on the way
        #[arg(long, default_value_t = 2)]
        steps: usize,
        #[command(flatten)]
        terms: TermArgs,
    },
    Tree(tree::Args),
    /// A page with phase portrait, torque, clearance, ground force and an animation
    Show(show::Args),
}

#[derive(Clone, Copy, ValueEnum)]
enum Side {
    Inner,
    Outer,
}

impl From<Side> for Leg {
    fn from(side: Side) -> Self {
        match side {
            Side::Inner => Self::Inner,
            Side::Outer => Self::Outer,
        }
    }
}

/// What a plan must keep, and how it is solved.
#[derive(clap::Args)]
struct TermArgs {
    /// The plan
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Knots per phase, coarse and fine
    #[arg(long, value_name = "COARSE,FINE", default_value = "12,60", value_delimiter = ',')]
    knots: Vec<usize>,
    /// Friction of foot on floor
    #[arg(long, value_name = "MU", default_value_t = 0.6)]
    friction: f64,
    /// Clearance of the swing foot, mm; 0: it may pass through the floor
    #[arg(long, value_name = "MM", default_value_t = 20.0)]
    clearance_mm: f64,
    /// Travel of the swing leg's toe, mm; left out: all the way in (robot.toe.extended_m)
    #[arg(long, value_name = "MM")]
    retract_mm: Option<f64>,
    /// Acceleration of the toe, m/s²; left out: the robot's (robot.toe.acceleration_limit_m_s2)
    #[arg(long, value_name = "M_S2")]
    toe_acceleration: Option<f64>,
    /// Slowest fall of the swing toe at touchdown, m/s: what makes a plan robust to the floor's height
    #[arg(long, value_name = "M_S", default_value_t = 0.15)]
    descent: f64,
    /// Weights of ∫ torque², motor torque², positive power, time
    #[arg(long, value_name = "T,M,P,S", default_value = "1,0,0,0.2", value_delimiter = ',')]
    cost: Vec<f64>,
    /// Weights of the feedback: stance angle, swing angle, their rates, torque / (m_t l²)
    #[arg(long, value_name = "S,W,RS,RW,T", default_value = "100,10,1,0.1,1", value_delimiter = ',')]
    weights: Vec<f64>,
    #[command(flatten)]
    config: ConfigArgs,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        match self.task {
            Task::Show(args) => args.run(),
            Task::Tree(args) => args.run(),
            Task::Gait { step, speed, terms } => {
                positive("--step", step)?;
                positive("--speed", speed)?;
                let config = terms.load(&[])?;
                terms.make("gait", &terms.terms(&config)?.gait(step, speed), None)
            }
            Task::Rebalance { stance, step, from, terms } => {
                let range = match step {
                    Some(step) => {
                        positive("--step", step)?;
                        [step, step]
                    }
                    None => STEPS_M,
                };
                let from = exactly("--from", &from)?;
                let config = terms.load(&[])?;
                terms.make("rebalance", &terms.terms(&config)?.rebalance(stance.into(), from, range), None)
            }
            Task::StepIn { gait, stance, steps, terms } => {
                let config = terms.load(&[&gait])?;
                let leg = Leg::from(stance);
                let entry = entry(&gait, &config, after(leg, steps)?)?;
                let problem = terms.terms(&config)?.join(leg, [0.0; 4], steps, STEPS_M, entry.state);
                terms.make("step-in", &problem, Some(&entry.cost))
            }
            Task::Stop { gait, stance, steps, terms } => {
                let config = terms.load(&[&gait])?;
                let leg = Leg::from(stance);
                after(leg, steps)?;
                let exit = entry(&gait, &config, leg)?;
                terms.make("stop", &terms.terms(&config)?.stop(leg, exit.state, steps, STEPS_M), None)
            }
            Task::Change { gait, to, stance, steps, terms } => {
                let config = terms.load(&[&gait, &to])?;
                let leg = Leg::from(stance);
                let (exit, entry) = (entry(&gait, &config, leg)?, entry(&to, &config, after(leg, steps)?)?);
                let problem = terms.terms(&config)?.join(leg, exit.state, steps, STEPS_M, entry.state);
                terms.make("change", &problem, Some(&entry.cost))
            }
        }
    }
}

/// Steps of a motion that may choose them, m.
const STEPS_M: [f64; 2] = [0.1, 0.6];

/// Where a gait is entered or left, and what it costs to be off there.
struct Entry {
    state: [f64; 4],
    cost: Matrix4<f64>,
}

/// Start of the phase of a gait in which `stance` stands.
fn entry(path: &Path, config: &Config, stance: Leg) -> anyhow::Result<Entry> {
    let plan = PlanFile::read(path, &config.robot.model.params())?;
    let stands = |phase: &&PhaseTable| phase.inner_stands == (stance == Leg::Inner);
    let phase = plan.phases.iter().find(stands).filter(|_| plan.periodic);
    let phase = phase.with_context(|| format!("{}: not a gait", path.display()))?;
    let node = phase.at(0.0);
    let c = node.time_cost;
    let place = |i: usize, j: usize| [0, 4, 7, 9][i.min(j)] + i.abs_diff(j);
    Ok(Entry { state: node.state, cost: Matrix4::from_fn(|i, j| c[place(i, j)]) })
}

/// The leg that stands after so many steps.
fn after(leg: Leg, steps: usize) -> Result<Leg, UsageError> {
    if !(1..=20).contains(&steps) {
        return Err(UsageError(format!("--steps {steps}: 1 to 20")));
    }
    Ok(if steps.is_multiple_of(2) { leg } else { leg.other() })
}

/// The numbers of a list, if there are so many.
fn exactly<T: Copy, const N: usize>(name: &str, given: &[T]) -> Result<[T; N], UsageError> {
    given.try_into().map_err(|_| UsageError(format!("{name}: {N} numbers, here are {}", given.len())))
}

fn positive(name: &str, value: f64) -> Result<(), UsageError> {
    if value.is_finite() && value > 0.0 && value < 2.0 {
        return Ok(());
    }
    Err(UsageError(format!("{name} {value}: must be more than 0 and less than 2")))
}

impl TermArgs {
    /// The configuration; neither it nor a plan that is read may be replaced by the new plan.
    fn load(&self, plans: &[&PathBuf]) -> anyhow::Result<Config> {
        let plans = plans.iter().copied().cloned();
        spare_inputs("--out", [&self.out], &plans.chain(self.config.files()).collect::<Vec<_>>())?;
        Ok(self.config.load()?.config)
    }

    fn terms(&self, config: &Config) -> Result<Terms, UsageError> {
        let toe = &config.robot.toe;
        let retract_m = self.retract_mm.map_or(toe.extended_m, |mm| mm / 1000.0);
        let acceleration_m_s2 = self.toe_acceleration.unwrap_or(toe.acceleration_limit_m_s2);
        let height_m = self.clearance_mm / 1000.0;
        if height_m > 0.0 && height_m >= retract_m {
            return Err(UsageError(format!(
                "--clearance-mm {}: must be less than the toe's travel of {} mm; legs of equal length pass each other \
                 with the foot exactly that travel above the floor",
                self.clearance_mm,
                1000.0 * retract_m
            )));
        }
        let clearance = (height_m > 0.0).then_some(Clearance {
            height_m,
            retract_m,
            rate_m_s: toe.rate_limit_m_s,
            acceleration_m_s2,
            until_s: 0.1,
            begun_s: 0.0,
        });
        let numbers = [self.friction, acceleration_m_s2];
        let bad = |x: f64| !x.is_finite() || x < 0.0;
        if numbers.iter().any(|x| bad(*x) || *x <= 0.0) || bad(self.descent) {
            return Err(UsageError(
                "--friction and --toe-acceleration must be positive, --descent not negative".into(),
            ));
        }
        let [torque, motor, power, time] = exactly("--cost", &self.cost)?;
        if [torque, motor, power, time].iter().any(|x| bad(*x)) || torque + motor <= 0.0 {
            return Err(UsageError("--cost: no weight below 0, and torque or motor torque above 0".into()));
        }
        let limits = Limits {
            hip_torque_nm: config.robot.limits.hip_torque_nm,
            compensation: config.control.friction_compensation,
            friction: self.friction,
            normal_force_n: 10.0,
            clearance,
            swing_rad: None,
            impact: true,
        };
        let cost = Cost { torque, motor, power, time: 0.0 };
        let robot = config.robot.model.params();
        Ok(Terms { robot, limits, cost, descent_m_s: self.descent, time, longest_s: 3.0 })
    }

    fn feedback(&self) -> Result<Weights, UsageError> {
        let [stance, swing, stance_rate, swing_rate, torque] = exactly("--weights", &self.weights)?;
        let state = [stance, swing, stance_rate, swing_rate];
        if state.iter().any(|w| !w.is_finite() || *w < 0.0) || !torque.is_finite() || torque <= 0.0 {
            return Err(UsageError("--weights: no weight below 0, and the torque's above 0".into()));
        }
        Ok(Weights { state, torque })
    }

    /// Solves, designs the gains, writes the file, tells.
    fn make(&self, kind: &str, problem: &Problem, joined: Option<&Matrix4<f64>>) -> anyhow::Result<Outcome> {
        let [coarse, fine] = exactly("--knots", &self.knots)?;
        if coarse < 4 || fine < 4 || coarse > 400 || fine > 400 {
            return Err(UsageError("--knots: 4 to 400 each".into()).into());
        }
        let weights = self.feedback()?;
        let begin = Instant::now();
        let spinner = progress::spinner("planning");
        let solved = plan(problem, Effort { coarse, fine: Some(fine) });
        let took = begin.elapsed();
        spinner.finish_and_clear();
        let solution = match solved {
            Ok(solution) => solution,
            Err(failure @ (Failure::Infeasible(_) | Failure::NotConverged { .. })) => {
                writeln!(io::stdout(), "{failure}")?;
                return Ok(Outcome::Finding);
            }
        };
        let designed = gains(&solution, &weights, joined)?;
        let command: Vec<String> = std::env::args().skip(1).collect();
        let file = plan_file(kind, &format!("compass {}", command.join(" ")), &solution, &designed);
        fs::write(&self.out, file.to_text()?).with_context(|| self.out.display().to_string())?;
        let mut out = io::stdout().lock();
        tell(&mut out, problem, &solution)?;
        if let Some(design) = designed.transverse.as_ref().filter(|_| file.periodic) {
            let (open, closed) = (design.open_loop, design.closed_loop);
            writeln!(out, "multiplier of a cycle  {open:.3} without feedback, {closed:.4} with transverse feedback")?;
        }
        writeln!(
            out,
            "solved in {:.0} ms, {} iterations; {}",
            1e3 * took.as_secs_f64(),
            solution.iterations,
            self.out.display()
        )?;
        Ok(Outcome::Fine)
    }
}

fn tell(out: &mut impl Write, problem: &Problem, solution: &Solution) -> io::Result<()> {
    let unit = problem.robot.inertia_kg_m2();
    for (phase, arc) in problem.phases.iter().zip(&solution.trajectory.arcs) {
        let peak = arc.torques.iter().chain(&arc.mid_torques).fold(0.0, |peak: f64, x| peak.max(x.abs()));
        let (leg, duration) = (phase.stance.name(), arc.duration_s);
        writeln!(out, "{leg} leg stands  {duration:.4} s, net torque up to {:.2} Nm", peak * unit)?;
    }
    let defect = solution.trajectory.arcs.iter().map(|arc| arc.defect(20)).fold(0.0, f64::max);
    writeln!(
        out,
        "cost {:.6}, optimality error {:.0e}, defect after re-integration {defect:.0e}",
        solution.cost, solution.error
    )
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    #[derive(clap::Parser)]
    struct Line {
        #[command(flatten)]
        terms: TermArgs,
    }

    fn toe(more: &[&str]) -> Clearance {
        let line = [&["test", "--out", "no.plan"], more].concat();
        let terms = Line::parse_from(line).terms;
        terms.terms(&terms.load(&[]).unwrap()).unwrap().limits.clearance.unwrap()
    }

    #[test]
    fn a_plan_takes_the_toe_that_the_robot_has() {
        let robots = toe(&[]);
        assert_eq!((robots.retract_m, robots.rate_m_s, robots.acceleration_m_s2), (0.03, 0.25, 5.0));
        let slow = ["--set", "robot.toe.acceleration_limit_m_s2=2.0", "--set", "robot.toe.rate_limit_m_s=0.3"];
        let slower = toe(&slow);
        assert_eq!((slower.rate_m_s, slower.acceleration_m_s2), (0.3, 2.0));
        let told = toe(&[&slow[..], &["--toe-acceleration", "3"]].concat());
        assert_eq!((told.rate_m_s, told.acceleration_m_s2), (0.3, 3.0));
    }
}
