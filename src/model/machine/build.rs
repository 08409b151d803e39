//! Builds a machine from a setting. RT: before arming only.

use super::contact::{Feet, Ground};
use super::motion::{FlowOf, Plant, Stages};
use super::start::Bristled;
use super::{MAX_BRISTLES, Machine, MachineError, Phase, Play, Push, Work};
use crate::base::scalar::Scalar;
use crate::model::effect::EffectKind;
use crate::model::effect::actuator::Drive;
use crate::model::effect::drive::{Rotor, StructuralMode};
use crate::model::effect::friction::{Axis, DryFriction, Grip, Ripple, Spring, soft_rate_1_s};
use crate::model::effect::sensing::Pickup;
use crate::model::mechanism::{Body, DoublePendulum, Legs, MAX, Mechanism, Pendulum, Row, Slider};
use crate::model::rig::{MechanismKind, Setup, Side, Site};
use crate::model::setting::{EffectSetting, Number, Setting};
use std::collections::VecDeque;

/// How a number of a setting becomes a scalar: a constant, or a direction of the derivative.
pub(super) type Lift<'l, S> = &'l dyn Fn(&Number) -> S;

impl<S: Scalar> Machine<S> {
    /// Builds the machine of `setting`; `lift` makes scalars of its numbers; `refine` divides the step.
    ///
    /// # Errors
    /// The setting asks for something that is not modelled.
    pub fn new(setting: &Setting, lift: &dyn Fn(&Number) -> S, refine: u32) -> Result<Self, MachineError> {
        let body = body(setting, lift)?;
        let n_body = body.dof();
        let plant = Plant {
            n_body,
            n: n_body,
            bristles: 0,
            fastest_yield_1_s: f64::INFINITY,
            is_loaded: false,
            axes: Vec::new(),
            grips: Vec::new(),
            rotors: Vec::new(),
            plays: Vec::new(),
            structures: Vec::new(),
            drives: Vec::new(),
            walks: setting.mechanism == MechanismKind::CompassGait && setting.setup.is_none_or(|s| s == Setup::Walk),
            ground: ground(setting, lift),
            feet: Feet::default(),
            keeps_constraints: false,
            body,
        };
        let mut machine = Self {
            plant,
            pickups: Vec::new(),
            pushes: Vec::new(),
            now: S::zero(),
            y: Phase::default(),
            end: Phase::default(),
            stages: Stages::default(),
            flow_of: FlowOf::Nothing,
            work: Work::default(),
            lagged: vec![S::zero(); setting.sensors.len()],
            before: vec![S::zero(); setting.sensors.len()],
            history: VecDeque::new(),
            keeps_history: false,
            step_s: super::LONGEST_STEP_S,
            euler_step_s: setting.numerics.euler_step_s,
            refine: refine.max(1),
            steps: 0,
        };
        machine.check_ground()?;
        machine.add_rotors_of(setting, lift);
        machine.check_rotors(setting)?;
        machine.add_structures(setting, lift);
        if machine.plant.n > MAX {
            return Err(MachineError::Unsupported(format!(
                "{} coordinates, at most {MAX} are possible",
                machine.plant.n
            )));
        }
        for effect in &setting.effects {
            machine.add_law(effect, lift);
        }
        for dry in machine.plant.axes.iter_mut().filter_map(|axis| axis.dry.as_mut()) {
            dry.smooth_rate = setting.numerics.smooth_rate;
            dry.soft_1_s = setting.numerics.soft_constraint_s().map(soft_rate_1_s);
        }
        machine.plant.is_loaded =
            machine.plant.axes.iter().any(|a| a.dry.as_ref().is_some_and(DryFriction::needs_load));
        machine.plant.bristles = machine.plant.axes.iter().filter(|a| a.is_bristled()).count();
        if machine.plant.bristles > MAX_BRISTLES {
            return Err(MachineError::Unsupported(format!("at most {MAX_BRISTLES} joints may have presliding")));
        }
        machine.plant.grips = vec![Grip::Stuck; machine.plant.axes.len()];
        machine.add_drives(setting, lift);
        machine.add_pickups(setting, lift);
        machine.keeps_history = machine.pickups.iter().any(Pickup::is_shifted);
        Ok(machine)
    }

    /// What turns with the motor of `joint`: its rotor, or the link.
    fn motor_row(&self, joint: usize) -> Row {
        let rotor = self.plant.rotors.iter().find(|r| r.joint == joint);
        rotor.map_or_else(|| self.plant.body.row(joint), |r| Row::one(r.index, 1.0))
    }

    fn add_rotors_of(&mut self, setting: &Setting, lift: Lift<'_, S>) {
        for joint in 0..setting.mechanism.coordinates().len() {
            let site = Site::Joint(joint);
            let elastic = setting.first(EffectKind::JointElasticity, site);
            let loose = setting.first(EffectKind::Backlash, site);
            let link = self.plant.body.row(joint);
            if link.is_none() || (elastic.is_none() && loose.is_none()) {
                continue;
            }
            let spring = elastic.map(|e| (lift(&e[0]), lift(&e[1])));
            let gap = loose.map_or(S::zero(), |l| lift(&l[0]));
            let inertia = elastic.map(|e| lift(&e[2])).or(loose.map(|l| lift(&l[1]))).unwrap_or_default();
            let inertia = if inertia.value() < LIGHTEST_ROTOR { inertia + LIGHTEST_ROTOR } else { inertia };
            let is_taken_out = self.plant.body.holds_rotor();
            self.plant.rotors.push(Rotor { joint, link, index: self.plant.n, inertia, is_taken_out, spring, gap });
            let rigid = gap.value() <= SMALLEST_GAP;
            self.plant.plays.push(if rigid && spring.is_none() { Play::Rigid } else { Play::Free });
            self.plant.n += 1;
        }
    }

    /// A rotor that is as heavy as rotor and link together leaves the link nothing to accelerate: such a link runs backwards.
    fn check_rotors(&self, setting: &Setting) -> Result<(), MachineError> {
        if setting.mechanism.whole_inertia().is_none() {
            return Ok(());
        }
        for rotor in &self.plant.rotors {
            let (own, whole) = (rotor.inertia.value(), self.plant.body.link_inertia(rotor.joint).value());
            if own >= whole {
                let at = setting.mechanism.coordinates()[rotor.joint];
                return Err(MachineError::Unsupported(format!(
                    "rotor_inertia at {at} is {own:.4e}, rotor and link together have {whole:.4e}: no such link exists"
                )));
            }
        }
        Ok(())
    }

    fn add_structures(&mut self, setting: &Setting, lift: Lift<'_, S>) {
        for effect in setting.effects.iter().filter(|e| e.kind == EffectKind::LinkFlexibility) {
            let Site::Joint(joint) = effect.site else { continue };
            let [frequency, damping, share] = effect.numbers.as_slice() else { continue };
            let link = self.plant.body.absolute_row(joint);
            if link.is_none() {
                continue;
            }
            let whole = self.plant.body.link_inertia(joint);
            let mode = StructuralMode::new(link, self.plant.n, whole, lift(frequency), lift(damping), lift(share));
            self.plant.structures.push(mode);
            self.plant.n += 1;
        }
    }

    /// The axis of one side of a joint, made on first use; none if it cannot move.
    fn axis(&mut self, joint: usize, side: Side) -> Option<&mut Axis<S>> {
        let is_motor = side == Side::Motor && self.plant.rotors.iter().any(|r| r.joint == joint);
        let row = if is_motor { self.motor_row(joint) } else { self.plant.body.row(joint) };
        if row.is_none() {
            return None;
        }
        let index = self.plant.axes.iter().position(|a| a.joint == joint && a.is_motor == is_motor);
        let index = index.unwrap_or_else(|| {
            self.plant.axes.push(Axis::new(row, joint, is_motor));
            self.plant.axes.len() - 1
        });
        self.plant.axes.get_mut(index)
    }

    /// Adds an effect that acts at one side of a joint.
    fn add_law(&mut self, effect: &EffectSetting, lift: Lift<'_, S>) {
        let Site::Joint(joint) = effect.site else { return };
        let x: Vec<S> = effect.numbers.iter().map(lift).collect();
        if effect.kind == EffectKind::ExternalPush {
            let row = self.motor_free_row(joint);
            self.pushes.push(Push { row, impulse: x[0], time: x[1], done: false });
            return;
        }
        let Some(axis) = self.axis(joint, effect.side) else { return };
        match effect.kind {
            EffectKind::ViscousFriction => axis.viscous += x[0],
            EffectKind::QuadraticDrag => add(&mut axis.quadratic, x[0]),
            EffectKind::CoulombFriction => axis.dry_mut().coulomb += x[0],
            EffectKind::FrictionAsymmetry => axis.offset -= x[0],
            EffectKind::StribeckFriction => axis.dry_mut().stribeck = Some((x[0], x[1])),
            EffectKind::LoadFriction if effect.side == Side::Motor => add(&mut axis.dry_mut().motor_load, x[0]),
            EffectKind::LoadFriction => add(&mut axis.dry_mut().load, x[0]),
            EffectKind::Presliding => axis.dry_mut().bristle = Some(x[0]),
            EffectKind::FrictionDrift => add(&mut axis.dry_mut().drift, x[0]),
            EffectKind::ParallelSpring => axis.springs.push(Spring { stiffness: x[0], rest: x[1] }),
            EffectKind::TorqueOffset => axis.offset += x[0],
            EffectKind::TorqueRipple => axis.ripples.push(Ripple { amplitude: x[0], order: x[1], phase: x[2] }),
            _ => {}
        }
    }

    /// Where a push from outside acts: on the link.
    fn motor_free_row(&self, joint: usize) -> Row {
        self.plant.body.row(joint)
    }

    fn add_drives(&mut self, setting: &Setting, lift: Lift<'_, S>) {
        for (i, actuator) in setting.actuators.iter().enumerate() {
            let row = self.motor_row(actuator.joint);
            let mut drive = Drive::new(row, actuator.joint, lift(&actuator.gain), lift(&actuator.back_emf));
            for effect in setting.effects.iter().filter(|e| e.site == Site::Actuator(i)) {
                match effect.kind {
                    EffectKind::TransportDelay => drive.add_delay(lift(&effect.numbers[0])),
                    EffectKind::ActuatorLag => drive.set_lag(lift(&effect.numbers[0])),
                    EffectKind::TorqueLimit => drive.set_limit(lift(&effect.numbers[0])),
                    _ => {}
                }
            }
            self.plant.drives.push(drive);
        }
    }

    fn add_pickups(&mut self, setting: &Setting, lift: Lift<'_, S>) {
        for (i, sensor) in setting.sensors.iter().enumerate() {
            let row = if sensor.side == Side::Motor {
                self.motor_row(sensor.joint)
            } else {
                self.plant.body.row(sensor.joint)
            };
            let mut pickup = Pickup::new(row, sensor.is_rate);
            for effect in setting.effects.iter().filter(|e| e.site == Site::Sensor(i)) {
                let x: Vec<S> = effect.numbers.iter().map(lift).collect();
                match effect.kind {
                    EffectKind::SensorLag => pickup.lag = Some(x[0]),
                    EffectKind::SensorDelay => pickup.delay += x[0],
                    EffectKind::ClockSkew => pickup.skew += x[0],
                    EffectKind::SensorScale => pickup.scale *= x[0],
                    EffectKind::SensorBias => pickup.bias += x[0],
                    EffectKind::SensorDrift => pickup.drift += x[0],
                    EffectKind::EncoderEccentricity => pickup.eccentricity = Some((x[0], x[1])),
                    EffectKind::LostCounts => pickup.jumps.push((x[0], x[1])),
                    _ => {}
                }
            }
            self.pickups.push(pickup);
        }
    }
}

/// Several effects of one kind add up.
fn add<S: Scalar>(sum: &mut Option<S>, x: S) {
    *sum = Some(sum.map_or(x, |sum| sum + x));
}

/// A rotor without inertia cannot be accelerated; this is far below any real one.
const LIGHTEST_ROTOR: f64 = 1e-9;
/// Play below this is none.
const SMALLEST_GAP: f64 = 1e-9;

fn body<S: Scalar>(setting: &Setting, lift: Lift<'_, S>) -> Result<Body<S>, MachineError> {
    let p: Vec<S> = setting.parameters.iter().map(lift).collect();
    let wrong = || MachineError::Unsupported("the rig's parameters are incomplete".to_owned());
    Ok(match (setting.mechanism, p.as_slice()) {
        (MechanismKind::Pendulum, &[inertia, gravity]) => Body::Pendulum(Pendulum { inertia, gravity }),
        (MechanismKind::Slider, &[mass]) => Body::Slider(Slider { mass }),
        (MechanismKind::DoublePendulum, &[inertia1, inertia2, moment1, moment2, mass2, length1, gravity]) => {
            Body::DoublePendulum(DoublePendulum { inertia1, inertia2, moment1, moment2, mass2, length1, gravity })
        }
        (MechanismKind::CompassGait, p) => Body::Legs(legs(setting, lift, p).ok_or_else(wrong)?),
        _ => return Err(wrong()),
    })
}

fn legs<S: Scalar>(setting: &Setting, lift: Lift<'_, S>, p: &[S]) -> Option<Legs<S>> {
    let ground = |kind| setting.first(kind, Site::Ground).map_or(S::zero(), |x| lift(&x[0]));
    let setup = setting.setup.unwrap_or(Setup::Walk);
    Legs::new(p, setup, setup == Setup::Walk, ground(EffectKind::Counterweight), ground(EffectKind::GroundSlope))
}

fn ground<S: Scalar>(setting: &Setting, lift: Lift<'_, S>) -> Ground<S> {
    let first = |kind| setting.first(kind, Site::Ground);
    Ground {
        friction: first(EffectKind::FootSlip).map(|x| lift(&x[0])),
        restitution: first(EffectKind::ElasticImpact).map(|x| lift(&x[0])),
        compliance: first(EffectKind::ToeCompliance).map(|x| (lift(&x[0]), lift(&x[1]))),
        radius: first(EffectKind::RoundFoot).map(|x| lift(&x[0])),
        lift_off: false,
        both: false,
        floor: None,
    }
}
