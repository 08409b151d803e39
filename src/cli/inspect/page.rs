//! `compass inspect REC --page FILE` and `--animation FILE`: the recorded robot in motion. RT: no.

use crate::base::time::Stamp;
use crate::config;
use crate::msg::{Leg, Mode, TickRecord};
use crate::record::Reader;
use crate::report::animation::{Pose, animated_svg};
use crate::report::recorded::{Recorded, page};
use anyhow::Context;
use std::fs;
use std::path::Path;

/// Instants of the signals and poses of the animation: more does not show.
const MOST_INSTANTS: usize = 6000;

/// Writes the page.
pub(super) fn write(recording: &Path, file: &Path) -> anyhow::Result<()> {
    fs::write(file, page(&read(recording)?)).with_context(|| file.display().to_string())
}

/// Writes the motion alone, from shortly before the first step on.
pub(super) fn write_animation(recording: &Path, file: &Path) -> anyhow::Result<()> {
    let run = read(recording)?;
    let first_s = run.steps.first().map_or(0.0, |[t_s, _]| t_s - BEFORE_S);
    let poses: Vec<Pose> = run.poses.into_iter().filter(|pose| pose.t_s >= first_s).collect();
    anyhow::ensure!(!poses.is_empty(), "{}: the robot was never armed", recording.display());
    fs::write(file, animated_svg(&poses)).with_context(|| file.display().to_string())
}

/// So long before the second touchdown, whose step is the first with a speed, an animation begins, s.
const BEFORE_S: f64 = 2.5;

fn read(recording: &Path) -> anyhow::Result<Recorded> {
    let ticks = count(recording)?;
    let mut reader = Reader::open(recording)?;
    let mut first = reader.next_tick()?.context("the recording holds no tick")?;
    let text = reader.about().config_text.clone().context("the recording holds no configuration")?;
    let config = config::from_canonical(&text, &[]).context("the recorded configuration")?.config;
    let every = ticks.div_ceil(MOST_INSTANTS).max(1);
    let mut run = Collector::new(config.robot.model.params().leg_length_m, &first);
    for k in 0.. {
        run.see(&first, k % every == 0);
        let Some(next) = reader.next_tick()? else { break };
        first = next;
    }
    let name = recording.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    Ok(run.finish(name))
}

fn count(recording: &Path) -> anyhow::Result<usize> {
    let mut reader = Reader::open(recording)?;
    let mut ticks = 0;
    while reader.next_tick()?.is_some() {
        ticks += 1;
    }
    Ok(ticks)
}

/// What the page shows, tick by tick.
struct Collector {
    leg_m: f64,
    start: Stamp,
    run: Recorded,
    foot_m: [f64; 2],
    armed_s: f64,
    walked: u32,
    last: Option<Last>,
}

/// The tick before.
#[derive(Clone, Copy)]
struct Last {
    t_s: f64,
    steps: u32,
    angles_rad: [f64; 2],
    lengths_m: [f64; 2],
    stepped_s: Option<f64>,
}

impl Collector {
    fn new(leg_m: f64, first: &TickRecord) -> Self {
        Self {
            leg_m,
            start: first.input.now,
            run: Recorded::default(),
            foot_m: [0.0; 2],
            armed_s: 0.0,
            walked: 0,
            last: None,
        }
    }

    fn see(&mut self, tick: &TickRecord, is_shown: bool) {
        let e = &tick.estimate;
        let t_s = tick.input.now.since(self.start).as_s();
        let [inner_a, inner_b, outer_a, outer_b] = tick.snapshot.toe_position_m;
        let toes_m = [inner_a.max(inner_b), outer_a.max(outer_b)];
        let by_role = |[inner, outer]: [f64; 2]| if e.stance == Leg::Inner { [inner, outer] } else { [outer, inner] };
        let angles_rad = [e.theta_stance_rad, e.theta_swing_rad];
        let lengths_m = by_role(toes_m).map(|toe| self.leg_m + toe);
        let mut stepped_s = self.last.and_then(|last| last.stepped_s);
        if let Some(last) = self.last {
            if tick.status.mode == Mode::Armed {
                self.armed_s += t_s - last.t_s;
            }
            // The estimator may take a step back as well: the foot goes where the other one was.
            if e.steps != last.steps {
                let ([stance, swing], [stance_m, swing_m]) = (last.angles_rad, last.lengths_m);
                let length_m = swing_m * libm::sin(swing) - stance_m * libm::sin(stance);
                self.foot_m[0] += length_m;
                self.foot_m[1] += stance_m * libm::cos(stance) - swing_m * libm::cos(swing);
                // At rest the weight goes from foot to foot until the legs are still: no steps.
                if !tick.control.motion.is_on_both_feet() {
                    self.walked += 1;
                    if let Some(before_s) = stepped_s {
                        self.run.steps.push([t_s, length_m / (t_s - before_s)]);
                    }
                }
                stepped_s = Some(t_s);
            }
        }
        self.last = Some(Last { t_s, steps: e.steps, angles_rad, lengths_m, stepped_s });
        if is_shown {
            self.show(tick, t_s, by_role(angles_rad), toes_m);
            if e.valid && tick.status.mode == Mode::Armed {
                let inner_stands = e.stance == Leg::Inner;
                self.run.poses.push(Pose { t_s, inner_stands, angles_rad, lengths_m, foot_m: self.foot_m });
            }
        }
    }

    fn show(&mut self, tick: &TickRecord, t_s: f64, leg_rad: [f64; 2], toes_m: [f64; 2]) {
        let s = &mut self.run.signals;
        s.t_s.push(t_s);
        s.hip_torque_nm.push(tick.allowed.hip_torque_nm);
        for (out, value) in s.leg_rad.iter_mut().zip(leg_rad).chain(s.toe_m.iter_mut().zip(toes_m)) {
            out.push(value);
        }
    }

    fn finish(mut self, name: String) -> Recorded {
        let (steps, armed_s) = (self.walked, self.armed_s);
        self.run.headline = if self.run.steps.is_empty() {
            format!("Armed for {armed_s:.1} s.")
        } else {
            format!("Armed for {armed_s:.1} s, {steps} steps, {:.1} m.", self.foot_m[0])
        };
        self.run.name = name;
        self.run
    }
}
