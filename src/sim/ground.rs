//! The simulated robot on the ground: [`World`] around the stepping machine that identification and diagnosis use too.
//!
//! Touchdown with exact event location, slip, flight, rebound, both feet on the ground and moving toes are the machine's;
//! how the toes' screws and springs move is [`super::toes`].
//! The leg length of the model is that with the toes at `robot.toe.extended_m`.
//! Limits: a robot whose hip comes to the floor stays there. RT: no.

use super::carry::{Carried, Carry};
use super::toes::Toes;
use super::{Place, Reading, World};
use crate::base::time::Span;
use crate::config::checked::{Config, Simulation};
use crate::model::effect::EffectKind;
use crate::model::machine::{Contact, Floor, Machine, MachineError};
use crate::model::rig::Side;
use crate::model::rig::{MechanismKind, Numerics, Setup, Site};
use crate::model::setting::{ActuatorSetting, EffectSetting, Number, Setting};
use crate::msg::{Leg, TOES};

/// Index of the hip among the machine's coordinates inner, outer, hip.
const HIP: usize = 2;

/// Mechanics on the ground, or pinned.
#[derive(Debug)]
pub struct GroundWorld {
    machine: Machine<f64>,
    toes: Toes,
    slope_rad: f64,
    leg_m: f64,
    floor: Floor,
    release_torque_nm: f64,
    held: bool,
    carry: Option<Carry>,
    now_s: f64,
    touchdowns: u32,
    /// It lies on the floor and stays as it is.
    fallen: bool,
    shown: Reading,
}

/// A stance leg that leans by more has brought the hip to the floor, rad.
const FALLEN_RAD: f64 = 1.3;

impl GroundWorld {
    /// As configured; on blocks the stance toe is pinned and the swing toe meets nothing.
    ///
    /// # Errors
    /// [`MachineError`] when the configuration asks for something that is not modelled.
    pub fn new(config: &Config) -> Result<Self, MachineError> {
        let (sim, params) = (&config.simulation, config.body().params());
        let mut machine = Machine::new(&setting(config), &|n| n.value, 1)?;
        if sim.lift_off {
            machine.let_lift_off();
        }
        let toes = Toes::new(config);
        if !sim.on_blocks {
            machine.let_stand_on_both();
            machine.give_toes(toes.motion().map(|m| m.short_m))?;
            machine.lay_floor(floor(sim));
        }
        let ([ai, ao], [vi, vo]) = (sim.initial_angle_rad, sim.initial_rate_rad_s);
        machine.set_stance(sim.stance as usize);
        machine.reset(0.0, &[ai, ao, vi, vo]);
        let mut world = Self {
            machine,
            toes,
            slope_rad: sim.ground_slope_rad,
            leg_m: params.leg_length_m,
            floor: if sim.on_blocks { Floor::default() } else { floor(sim) },
            release_torque_nm: sim.release_torque_nm,
            held: sim.release_torque_nm > 0.0 || sim.carried_until_s.is_some(),
            carry: Carry::new(sim),
            now_s: 0.0,
            touchdowns: 0,
            fallen: false,
            shown: Reading { toe_position_m: sim.initial_toe_m, ..Reading::default() },
        };
        // In the hand that holds it the robot stands with its weight.
        world.show([0.0, params.total_mass_kg * params.gravity_m_s2], [0.0; 2]);
        Ok(world)
    }

    /// What the instruments read under this ground force and acceleration of the hip.
    fn show(&mut self, ground_force_n: [f64; 2], imu_accel_m_s2: [f64; 2]) {
        let m = &self.machine;
        self.shown = Reading {
            leg_angle_rad: [m.coordinate(0), m.coordinate(1)],
            leg_rate_rad_s: [m.rate(0), m.rate(1)],
            imu_accel_m_s2,
            hip_encoder_rad: m.coordinate(HIP),
            ground_force_n,
            stance: if m.stance() == 0 { Leg::Inner } else { Leg::Outer },
            airborne: m.contact() == Contact::Flight,
            slides: matches!(m.contact(), Contact::Sliding(_)),
            ..self.shown
        };
    }

    /// It hits the floor and stays there.
    fn fall(&mut self) {
        self.fallen = true;
        self.shown = Reading {
            leg_rate_rad_s: [0.0; 2],
            imu_accel_m_s2: [0.0; 2],
            airborne: false,
            slides: false,
            ..self.shown
        };
    }

    /// Component of a vector along and normal to the ground along a leg, from toe to hip.
    fn along_leg(&self, leg: usize, [along, normal]: [f64; 2]) -> f64 {
        let (sin, cos) = libm::sincos(self.machine.coordinate(leg) + self.slope_rad);
        normal * cos - along * sin
    }

    /// In the hand that carries it: the stance foot stays where it is.
    fn carried(&self, carry: &Carry) -> Reading {
        let Carried { angle_rad, rate_rad_s, acceleration_rad_s2 } = carry.now();
        let stance = self.machine.stance();
        let (rate, acceleration) = (rate_rad_s[stance], acceleration_rad_s2[stance]);
        let (sin, cos) = libm::sincos(angle_rad[stance]);
        let accel = |along: f64, across: f64| self.leg_m * (along * rate * rate - across * acceleration);
        Reading {
            leg_angle_rad: angle_rad,
            leg_rate_rad_s: rate_rad_s,
            imu_accel_m_s2: [accel(sin, cos), -accel(cos, -sin)],
            hip_encoder_rad: angle_rad[0] - angle_rad[1],
            ..self.shown
        }
    }

    /// Moves the legs up to now.
    fn advance(&mut self) {
        if self.machine.advance_to(self.now_s).is_err() {
            return self.fall();
        }
        let (force_n, accel_m_s2) = self.machine.ground_force_and_hip_acceleration();
        self.show(force_n, accel_m_s2);
        self.load_toes();
        let lean_rad = self.machine.coordinate(self.machine.stance()) + self.slope_rad;
        if lean_rad.abs() > FALLEN_RAD {
            self.fall();
        }
    }

    /// The springs take up what the legs have met.
    fn load_toes(&mut self) {
        let mut load_n = [0.0; 2];
        let stance = self.machine.stance();
        load_n[stance] = self.along_leg(stance, self.shown.ground_force_n);
        if let Some(force_n) = self.machine.second_foot_force() {
            load_n[1 - stance] = self.along_leg(1 - stance, force_n);
        }
        self.toes.load(load_n);
        let (touchdowns, _) = self.machine.touchdowns();
        if touchdowns != self.touchdowns {
            self.touchdowns = touchdowns;
            let strike = self.machine.last_strike();
            let speed = -self.along_leg(stance, strike.velocity_m_s);
            self.toes.strike(stance, self.along_leg(stance, strike.impulse_ns), speed);
        }
    }
}

/// The floor of a configuration.
fn floor(sim: &Simulation) -> Floor {
    let Some(f) = &sim.floor else { return Floor::default() };
    Floor {
        tile_m: f.tile_m,
        half_width_m: f.half_width_m,
        seed: sim.seed,
        level_until_m: f.level_until_m,
        terraces: f.steps.clone(),
        tip_radius_m: f.tip_radius_m,
        profile: f.profile.clone(),
    }
}

const fn number(value: f64) -> Number {
    Number { value, slot: None }
}

/// The machine of a configuration: one hip motor that is its torque, no sensors.
fn setting(config: &Config) -> Setting {
    let (p, sim) = (config.body().params(), &config.simulation);
    let scale = [p.leg_length_m, p.total_mass_kg, p.gravity_m_s2];
    let setup = match (sim.on_blocks, sim.stance) {
        (false, _) => Setup::Walk,
        (true, Leg::Inner) => Setup::InnerStance,
        (true, Leg::Outer) => Setup::OuterStance,
    };
    Setting {
        mechanism: MechanismKind::CompassGait,
        numerics: Numerics::default(),
        setup: Some(setup),
        parameters: scale.into_iter().chain(p.c).map(number).collect(),
        actuators: vec![ActuatorSetting { joint: HIP, gain: number(1.0), back_emf: number(0.0) }],
        sensors: Vec::new(),
        effects: effects(config),
    }
}

/// Each imperfection that is switched on.
fn effects(config: &Config) -> Vec<EffectSetting> {
    let (p, sim) = (config.body().params(), &config.simulation);
    let hip = Site::Joint(HIP);
    let effect = |kind, site, numbers: &[f64]| EffectSetting {
        kind,
        site,
        side: Side::Link,
        numbers: numbers.iter().copied().map(number).collect(),
    };
    let mut effects = vec![
        effect(EffectKind::ViscousFriction, hip, &[p.viscous_nm_s_rad * sim.friction_scale[0]]),
        effect(EffectKind::CoulombFriction, hip, &[p.coulomb_nm * sim.friction_scale[1]]),
    ];
    if let Some(e) = sim.hip_elasticity {
        let spring = [e.stiffness_nm_rad, e.damping_nm_s_rad, e.rotor_inertia_kg_m2];
        effects.push(effect(EffectKind::JointElasticity, hip, &spring));
    }
    if sim.on_blocks {
        return effects;
    }
    if let Some(friction) = sim.ground_friction {
        effects.push(effect(EffectKind::FootSlip, Site::Ground, &[friction]));
    }
    effects.push(effect(EffectKind::ElasticImpact, Site::Ground, &[sim.restitution]));
    effects.push(effect(EffectKind::GroundSlope, Site::Ground, &[sim.ground_slope_rad]));
    effects
}

impl World for GroundWorld {
    fn step(&mut self, hip_torque_nm: f64, toe_target_m: [f64; TOES], dt: Span) {
        let motion = self.toes.set_out(toe_target_m, dt.as_s());
        self.machine.set_toes(motion);
        self.toes.advance(dt.as_s());
        self.held = self.held
            && match &mut self.carry {
                Some(carry) => carry.advance(dt.as_s()),
                None => hip_torque_nm.abs() < self.release_torque_nm,
            };
        if !self.held && !self.fallen {
            self.machine.command(0, hip_torque_nm, true);
            self.now_s += dt.as_s();
            self.advance();
        }
        self.shown.toe_position_m = self.toes.position_m();
        self.shown.toe_spring_m = self.toes.compression_m();
    }

    /// A hand that carries lets go when it has brought the legs where it means to.
    fn let_go(&mut self) {
        self.held &= self.carry.is_some();
    }

    fn push(&mut self, impulse_ns: f64) {
        if !self.held && !self.fallen {
            self.machine.push_hip(impulse_ns);
        }
    }

    /// In the hand it is still: it gets its initial rates as the hand lets go.
    fn reading(&self) -> Reading {
        match &self.carry {
            Some(carry) if self.held => self.carried(carry),
            None if self.held => Reading { leg_rate_rad_s: [0.0; 2], ..self.shown },
            _ => self.shown,
        }
    }

    /// The speed of a foot that slides or flies is left out.
    fn place(&self) -> Place {
        let (stance, reading) = (self.machine.stance(), self.reading());
        let [x, y] = self.machine.toe_m();
        let (sin, cos) = libm::sincos(reading.leg_angle_rad[stance] + self.slope_rad);
        let speed_m_s = self.leg_m * reading.leg_rate_rad_s[stance];
        Place {
            hip_m: [x - self.leg_m * sin, y + self.leg_m * cos],
            hip_m_s: [-cos * speed_m_s, -sin * speed_m_s],
            slope_rad: self.slope_rad,
        }
    }

    fn floor_height_m(&self, along_m: f64) -> f64 {
        self.floor.point_height_m(along_m)
    }

    fn floor_range_m(&self) -> [f64; 2] {
        let range = |of: &[[f64; 2]]| {
            of.iter().fold([0.0_f64; 2], |[low, high], [_, height]| [low.min(*height), high.max(*height)])
        };
        let ([low, high], [lowest, highest]) = (range(&self.floor.terraces), range(&self.floor.profile));
        let half = if self.floor.tile_m > 0.0 { self.floor.half_width_m } else { 0.0 };
        [lowest + low - half, highest + high + half]
    }
}

#[cfg(test)]
#[path = "ground_tests.rs"]
mod tests;
