//! Ways in which a force that the model lacks could go with something: position, rate, time, a vibration.
//!
//! RT: no.

use crate::diagnose::judge::nameless::beyond_chance;
use crate::diagnose::judge::verdict::{Law, Place};
use crate::diagnose::screen::ltv::LtvWindow;
use crate::diagnose::screen::scan::{Curve, Over, state_curve, time_curve, vibration, vibration_columns};
use crate::diagnose::screen::score_test::{Column, ScoreTest};
use crate::diagnose::screen::subsample::windows_of_a_first_look;
use crate::identify::covariance::band_95;
use crate::identify::fitted_model::FittedModel;
use crate::identify::noise::Colour;

/// Knots of a free curve over position or rate: smooth laws, and narrow ones (a detent, a magnet).
const KNOTS: [usize; 2] = [40, 120];

/// One way in which a free force could go with something.
pub(in crate::diagnose) struct Pattern {
    /// Where it acts.
    pub(in crate::diagnose) joint: usize,
    /// What it goes with, in words.
    pub(in crate::diagnose) over: String,
    /// Rise of twice the log-likelihood.
    pub(in crate::diagnose) gain: f64,
    /// Its numbers.
    pub(in crate::diagnose) numbers: usize,
    /// The curve that shows it.
    pub(in crate::diagnose) curve: Option<Curve>,
    /// Recording and time in which it acts, if that is a part.
    pub(in crate::diagnose) interval: Option<(usize, f64, f64)>,
    /// The force itself.
    pub(in crate::diagnose) force: Force,
}

/// The force of a pattern, as it would act in other windows.
pub(in crate::diagnose) enum Force {
    /// Curves that add up.
    Curves(Vec<Curve>),
    /// Frequency, and the amplitudes of sine and cosine, recording by recording.
    Vibration(f64, Vec<f64>),
}

impl Force {
    /// What it does to readings.
    pub(in crate::diagnose) fn response(&self, windows: &[LtvWindow], joint: usize) -> Column {
        let parts: Vec<(f64, Column)> = match self {
            Self::Curves(curves) => curves.iter().map(|curve| (1.0, curve.response(windows))).collect(),
            Self::Vibration(hz, amplitudes) => {
                let columns = vibration_columns(windows, joint, amplitudes.len() / 2, *hz);
                amplitudes.iter().copied().zip(columns).collect()
            }
        };
        let mut sum: Column = vec![Vec::new(); windows.len()];
        for (amplitude, column) in parts {
            for (sum, window) in sum.iter_mut().zip(column).filter(|(_, window)| !window.is_empty()) {
                if sum.is_empty() {
                    *sum = window.iter().map(|channel| vec![0.0; channel.len()]).collect();
                }
                let rows = sum.iter_mut().flatten().zip(window.iter().flatten());
                rows.for_each(|(sum, x)| *sum += amplitude * x);
            }
        }
        sum
    }
}

impl Pattern {
    /// True if the force goes with the position of its joint.
    pub(in crate::diagnose) fn is_over_position(&self) -> bool {
        self.curve.as_ref().is_some_and(|c| c.over == Over::Angle)
    }

    /// True for a vibration.
    pub(in crate::diagnose) fn is_sine(&self) -> bool {
        self.curve.is_none() && self.is_over_time()
    }

    /// True if the force goes with nothing but time.
    pub(in crate::diagnose) fn is_over_time(&self) -> bool {
        self.curve.as_ref().is_none_or(|c| c.over == Over::Time)
    }

    /// Gain beyond what its numbers bring by chance.
    pub(in crate::diagnose) fn excess(&self) -> f64 {
        beyond_chance(self.gain, self.numbers)
    }
}

/// Part of the squares of `found` that the force explains, both of the innovations of its noise.
pub(in crate::diagnose) fn share(found: &FittedModel, p: &Pattern) -> f64 {
    let squares = |(runs, colour): (&Vec<Vec<f64>>, &Colour)| -> f64 {
        let innovations = |run: &Vec<f64>| {
            let mut e = run.clone();
            colour.whiten(&mut e, &(0..run.len()).collect::<Vec<_>>());
            e.iter().map(|x| x * x).sum::<f64>()
        };
        if colour.sigma.is_finite() { runs.iter().map(innovations).sum() } else { 0.0 }
    };
    let energy: f64 = found.residuals.iter().zip(&found.noise).map(squares).sum();
    (p.gain / energy.max(1e-12)).clamp(0.0, 1.0)
}

/// All ways in which a free force could go with something, joint by joint; `screen`, `windows`: of the fit `of`.
pub(in crate::diagnose) fn patterns(of: &FittedModel, screen: &ScoreTest, windows: &[LtvWindow]) -> Vec<Pattern> {
    let names = of.rig.mechanism.coordinates();
    let some = windows_of_a_first_look(of, windows);
    let mut out = Vec::new();
    for (joint, name) in names.iter().enumerate() {
        for (over, what) in [(Over::Angle, "position"), (Over::Rate, "rate")] {
            for knots in KNOTS {
                out.extend(state_curve(screen, windows, joint, over, knots).map(|curve| Pattern {
                    joint,
                    over: format!("the {what} of {name}"),
                    gain: curve.score.gain,
                    numbers: curve.knots.len(),
                    curve: Some(curve.clone()),
                    interval: None,
                    force: Force::Curves(vec![curve]),
                }));
            }
        }
        out.extend(vibration_pattern(screen, (windows, &some), joint));
        out.extend(time_patterns(screen, windows, joint));
    }
    out
}

/// A vibration, its frequency sought in `some` of the windows first.
fn vibration_pattern(
    screen: &ScoreTest,
    (windows, some): (&[LtvWindow], &[LtvWindow]),
    joint: usize,
) -> Option<Pattern> {
    let grid: Vec<f64> = (0..80).map(|i| 0.5 * libm::pow(1.05, f64::from(i))).collect();
    let coarse = vibration(screen, some, joint, &grid)?.at;
    // A recording of some seconds resolves more than the grid.
    let fine: Vec<f64> = (-10..=10).map(|i| coarse * (1.0 + 0.005 * f64::from(i))).collect();
    let hit = vibration(screen, windows, joint, &fine)?;
    Some(Pattern {
        joint,
        over: format!("time, like a vibration of {:.2} Hz", hit.at),
        gain: hit.score.gain,
        numbers: hit.score.amplitudes.len() + 6,
        curve: None,
        interval: None,
        force: Force::Vibration(hit.at, hit.score.amplitudes),
    })
}

/// Force over time: of all recordings together, and of the one in which most of it acts, if it acts in a part of that.
fn time_patterns(screen: &ScoreTest, windows: &[LtvWindow], joint: usize) -> Vec<Pattern> {
    let recordings = windows.iter().map(|w| w.recording).max().map_or(0, |last| last + 1);
    let curves: Vec<Curve> = (0..recordings).filter_map(|r| time_curve(screen, windows, joint, r, 0.15)).collect();
    let Some(most) = curves.iter().max_by(|a, b| a.score.gain.total_cmp(&b.score.gain)).cloned() else {
        return Vec::new();
    };
    let pattern = |curves: Vec<Curve>, interval: Option<(usize, f64, f64)>| Pattern {
        joint,
        over: "time".into(),
        gain: curves.iter().map(|c| c.score.gain).sum(),
        numbers: curves.iter().map(|c| c.knots.len()).sum(),
        interval,
        curve: Some(most.clone()),
        force: Force::Curves(curves),
    };
    let event = busy(&most).map(|interval| pattern(vec![most.clone()], Some(interval)));
    event.into_iter().chain([pattern(curves, None)]).collect()
}

/// The part of a recording in which nearly all of a force over time acts, if it is a part.
fn busy(curve: &Curve) -> Option<(usize, f64, f64)> {
    let weigh = |(a, s): (&f64, &f64)| if *s > 0.0 { (a / s).powi(2).clamp(1.0, 1e6) - 1.0 } else { 0.0 };
    let energy: Vec<f64> = curve.score.amplitudes.iter().zip(&curve.score.deviations).map(weigh).collect();
    let total: f64 = energy.iter().sum();
    let reached = |part: f64| {
        let mut sum = 0.0;
        energy.iter().position(|e| {
            sum += e;
            sum >= part * total
        })
    };
    let (first, last) = (reached(0.03)?, reached(0.97)?);
    let is_part = last - first < energy.len() * 4 / 5;
    is_part.then_some((curve.recording?, curve.knots[first], curve.knots[last]))
}

/// The curve for the report.
pub(in crate::diagnose) fn law(found: &FittedModel, curve: &Curve) -> Law {
    let name = found.rig.mechanism.coordinates()[curve.joint];
    let (x_label, what) = match curve.over {
        Over::Angle => (format!("{name} (rad or m)"), "position"),
        Over::Rate => (format!("rate of {name} (rad/s or m/s)"), "rate"),
        Over::Time => ("time (s)".to_owned(), "time"),
    };
    let (y, s) = (&curve.score.amplitudes, &curve.score.deviations);
    Law {
        title: format!("Force at {name} that the model lacks, over {what}"),
        x_label,
        y_label: "torque or force (Nm or N)".into(),
        x: curve.knots.clone(),
        y: y.clone(),
        low: y.iter().zip(s).map(|(a, b)| a - band_95() * b).collect(),
        high: y.iter().zip(s).map(|(a, b)| a + band_95() * b).collect(),
    }
}

/// Where and when it acts, if that is a part of a recording.
pub(in crate::diagnose) fn located(found: &FittedModel, p: &Pattern) -> Vec<Place> {
    let Some((recording, from_s, to_s)) = p.interval else { return Vec::new() };
    let sensor = found.rig.sensors.iter().find(|s| s.joint == p.joint).or_else(|| found.rig.sensors.first());
    let Some(sensor) = sensor else { return Vec::new() };
    vec![Place {
        recording: found.problem.recordings[recording].name.clone(),
        channel: sensor.column.clone(),
        from_s,
        to_s,
        share: share(found, p),
        phase: None,
        region: None,
        band_hz: None,
    }]
}
