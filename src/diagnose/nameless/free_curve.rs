//! A force that goes with the position of a joint in any way at all, fitted in the simulation: what a magnet, a detent, a
//! dent in a rail or a cable would do, and no effect of the library says.
//!
//! The linear scan ([`crate::diagnose::screen::scan`]) sees such a force only as far as one step goes; where a base re-fitted
//! without it stands far off, a few effects of the library mimic it better than one step of the truth does. Fitted, it
//! leaves noise where they leave misfit.
//! RT: no.

use crate::diagnose::judge::criterion::Context;
use crate::diagnose::judge::nameless::curve_is_ahead;
use crate::diagnose::judge::verdict::Law;
use crate::diagnose::screen::ltv::LtvWindow;
use crate::diagnose::screen::score_test::pseudo_inverse;
use crate::identify::covariance::band_95;
use crate::identify::fit::Limits;
use crate::identify::fitted_model::FittedModel;
use crate::identify::likelihood::{is_misfit, white};
use crate::model::effect::EffectKind;
use crate::model::rig::{Effect, Scope, Slot, Value};
use nalgebra::DVector;
use std::f64::consts::{FRAC_PI_2, TAU};

/// Harmonics of the series: it resolves a thirtieth of the travel.
const HARMONICS: usize = 15;

/// Period of the series over the travel: its ends need not meet.
const WIDER: f64 = 1.15;

/// Most effort of the fit, about a third of a search.
const CURVE_EFFORT: u64 = 150_000_000;

/// The base with a free force over the position of a joint.
pub struct FreeCurve {
    /// Fitted.
    pub hypothesis: FittedModel,
    joint: usize,
    first: usize,
    travel: (f64, f64),
}

impl FreeCurve {
    /// Fits one from `base`, whose runs are `windows`. `None` if the joint does not move or no run is finite.
    #[must_use]
    pub fn fitted(base: &FittedModel, joint: usize, windows: &[LtvWindow], context: &Context) -> Option<Self> {
        let positions = windows.iter().flat_map(|w| w.states.iter().map(|state| state[joint]));
        let travel = positions.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), q| (low.min(q), high.max(q)));
        let wave = TAU / (WIDER * (travel.1 - travel.0));
        if !wave.is_finite() || wave <= 0.0 {
            return None;
        }
        let at = base.rig.mechanism.coordinates()[joint];
        let mut rig = base.rig.clone();
        for (order, phase) in (1..=HARMONICS).flat_map(|k| [(wave * k as f64, 0.0), (wave * k as f64, FRAC_PI_2)]) {
            let amplitude = Value::free(0.0, f64::NEG_INFINITY, f64::INFINITY);
            let values = vec![amplitude, Value::known(order), Value::known(phase)];
            rig.effects.push(Effect::new(EffectKind::TorqueRipple, at, values));
        }
        let (problem, point) = base.extended(rig);
        let (noise, far) = (white(&base.residuals, &context.floors), Limits { iterations: 12, tolerance: 1e-3 });
        let near = Limits { iterations: 8, tolerance: 1e-5 };
        let first = FittedModel::fitted(problem.with_allowance(CURVE_EFFORT), point, &noise, &context.floors, far)?;
        let hypothesis = first.polished(&first.noise, &context.floors, near).unwrap_or(first);
        Some(Self { hypothesis, joint, first: base.rig.effects.len(), travel })
    }

    /// True if it leaves but noise and is clearly ahead of `found`, its numbers paid for.
    #[must_use]
    pub fn says_more_than(&self, found: &FittedModel, base: &FittedModel, context: &Context) -> bool {
        if is_misfit(&self.hypothesis.residuals, &context.floors) {
            return false;
        }
        let at = base.rig.mechanism.coordinates()[self.joint];
        let is_ripple = |e: &&Effect| e.kind == EffectKind::TorqueRipple && e.at == at;
        let ripples = found.rig.effects[base.rig.effects.len()..].iter().filter(is_ripple).count() > 1;
        curve_is_ahead(&self.hypothesis, found, base, ripples, context)
    }

    /// The force over the travel with its band of 95 %.
    #[must_use]
    pub fn law(&self) -> Law {
        let of = self.hypothesis.clone().with_intervals();
        let name = of.rig.mechanism.coordinates()[self.joint];
        let covariance = pseudo_inverse(&of.information, 1e-12);
        let (low, high) = self.travel;
        let x: Vec<f64> = (0..Law::POINTS).map(|i| low + (high - low) * i as f64 / (Law::POINTS - 1) as f64).collect();
        let waves = &of.rig.effects[self.first..];
        let shape = |e: &Effect, x: f64| libm::sin(e.values[1].value * x + e.values[2].value);
        let y: Vec<f64> = x.iter().map(|x| waves.iter().map(|e| e.values[0].value * shape(e, *x)).sum()).collect();
        let reach = |x: &f64| {
            let mut slope = DVector::zeros(of.point.parameters.len());
            for (i, e) in waves.iter().enumerate() {
                if let Some(k) = of.problem.theta.index_of_slot(Slot::Effect(Scope::Rig, self.first + i, 0)) {
                    slope[k] = shape(e, *x);
                }
            }
            band_95() * libm::sqrt(slope.dot(&(&covariance * &slope)).max(0.0))
        };
        let reaches: Vec<f64> = x.iter().map(reach).collect();
        Law {
            title: format!("Force at {name} that the model lacks, over position"),
            x_label: format!("{name} (rad or m)"),
            y_label: "torque or force (Nm or N)".into(),
            low: y.iter().zip(&reaches).map(|(y, r)| y - r).collect(),
            high: y.iter().zip(&reaches).map(|(y, r)| y + r).collect(),
            x,
            y,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::judge::evidence::Ledger;
    use crate::diagnose::screen::linearise::ltv_windows;
    use crate::identify::base_fit::{fitted, floors};
    use crate::identify::experiment::Recording;
    use crate::identify::likelihood::samples;
    use crate::identify::rollout::Pooled;
    use crate::identify::synthesis::record;
    use crate::model::rig::Rig;
    use std::fmt::Write as _;

    /// A pendulum (its weight known: it goes with position too) with ripples of .01 Nm: order, and whether amplitude and phase are to be fitted.
    fn rig(ripples: &[f64], free: bool) -> Rig {
        let mut text = String::from(
            "schema = 1\nmechanism = \"pendulum\"\n[parameters]\ninertia_kg_m2 = { value = 0.01, min = 0.005, max = 0.02 }\n\
             gravity_nm = 0.36\n[[actuator]]\njoint = \"q1\"\ncolumn = \"u\"\ngain = 0.15\n\
             [[sensor]]\nmeasures = \"q1\"\ncolumn = \"q_rad\"\nnoise_std = 0.001\n[[effect]]\neffect = \"viscous_friction\"\n\
             at = \"q1\"\nviscous = { value = 0.01, min = 0.0, max = 0.05 }\n",
        );
        for order in ripples {
            let (amplitude, phase) = if free {
                ("{ value = 0.01, min = 0.0, max = 0.1 }", "{ value = 0.1, min = -3.2, max = 3.2 }")
            } else {
                ("0.01", "0.0")
            };
            let place = "[[effect]]\neffect = \"torque_ripple\"\nat = \"q1\"";
            writeln!(text, "{place}\namplitude = {amplitude}\norder = {order}\nphase = {phase}").unwrap();
        }
        text += "[[recording]]\nfile = \"a.csv\"\nuse = \"fit\"\nwindow_s = 1.0\n";
        Rig::parse(&text, "rig.toml").unwrap()
    }

    /// Base, ripples of these orders beside it, and a free curve in their place, on six seconds of `truth`.
    fn contest(truth: &Rig, ripples: &[f64]) -> (FreeCurve, bool) {
        let times: Vec<f64> = (0..1200).map(|k| f64::from(k) * 0.005).collect();
        let input = times.iter().map(|t| libm::sin(3.1 * t) + 0.5 * libm::sin(7.3 * t)).collect();
        let mut recording = Recording::new("a.csv", times, vec![input], Vec::new());
        recording.window_s = Some(1.0);
        recording.measured = record(truth, &recording, &[0.3], Some(5)).unwrap().measured;
        let all = [recording];
        let pooled = Pooled::of(truth, all.iter());
        let floors = floors(truth, &pooled, &all);
        let [base, found] = [&[][..], ripples].map(|r| fitted(&rig(r, true), &all, &pooled, &floors).unwrap());
        let samples = samples(&base.residuals, &floors);
        let context = Context {
            floors,
            samples,
            given: 1,
            is_trapped: false,
            seed: 0,
            ledger: Ledger::default(),
            held_out: None,
        };
        let curve = FreeCurve::fitted(&base, 0, &ltv_windows(&base).unwrap(), &context).unwrap();
        let more = curve.says_more_than(&found, &base, &context);
        (curve, more)
    }

    #[test]
    fn a_bump_that_no_ripple_makes_is_found_and_drawn_as_it_is() {
        // In phase at rest and nowhere else: a step of the force there.
        let orders = [3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let (curve, more) = contest(&rig(&orders, false), &[6.0]);
        assert!(more);
        let law = curve.law();
        // The ends of the travel are hardly visited.
        let (low, high) = curve.travel;
        let inside = |x: f64| x > low + 0.2 * (high - low) && x < high - 0.2 * (high - low);
        let truth = |x: f64| orders.iter().map(|order| 0.01 * libm::sin(order * x)).sum::<f64>();
        let drawn = law.x.iter().zip(&law.y).filter(|(x, _)| inside(**x));
        let errors: Vec<f64> = drawn.map(|(x, y)| y - truth(*x)).collect();
        let rms = libm::sqrt(errors.iter().map(|e| e * e).sum::<f64>() / errors.len() as f64);
        assert!(rms < 0.003, "{rms} beside a force of {}", truth(0.25));
    }

    #[test]
    fn two_ripples_that_are_the_truth_stay_and_two_that_mimic_a_bump_go() {
        assert!(!contest(&rig(&[6.0, 11.0], false), &[6.0, 11.0]).1);
        assert!(contest(&rig(&[3.0, 4.0, 5.0, 6.0], false), &[4.0, 6.0]).1);
    }

    #[test]
    fn a_ripple_is_said_better_by_a_ripple() {
        assert!(!contest(&rig(&[6.0], false), &[6.0]).1);
    }
}
