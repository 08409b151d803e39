//! The simulated robot on the ground: [`World`] around the stepping machine that identification and diagnosis use too.
//!
//! Touchdown with exact event location, slip, flight and rebound are the machine's; toes travel here.
//! Limits: not chosen by `world::build` yet, which always stands on blocks. The toes' travel and springs do not change the legs' length. The IMU's acceleration is not known. RT: no.

use super::{Reading, World};
use crate::base::time::Span;
use crate::config::checked::Config;
use crate::model::compass_gait::toe::Toe;
use crate::model::effect::EffectKind;
use crate::model::machine::{Contact, Machine, MachineError};
use crate::model::rig::Side;
use crate::model::rig::{MechanismKind, Setup, Site};
use crate::model::setting::{ActuatorSetting, EffectSetting, Number, Setting};
use crate::msg::{Leg, TOES};

/// Index of the hip among the machine's coordinates inner, outer, hip.
const HIP: usize = 2;

/// Mechanics on the ground, or pinned.
#[derive(Debug)]
pub struct GroundWorld {
    machine: Machine<f64>,
    toe: Toe<f64>,
    toes_m: [f64; TOES],
    release_torque_nm: f64,
    held: bool,
    now_s: f64,
    force_n: [f64; 2],
    /// The state left all bounds: it lies on the floor and stays as it was.
    lost: bool,
}

impl GroundWorld {
    /// As configured; on blocks the stance toe is pinned and the swing toe meets nothing.
    ///
    /// # Errors
    /// [`MachineError`] when the configuration asks for something that is not modelled.
    pub fn new(config: &Config) -> Result<Self, MachineError> {
        let sim = &config.simulation;
        let mut machine = Machine::new(&setting(config), &|n| n.value, 1)?;
        let ([ai, ao], [vi, vo]) = (sim.initial_angle_rad, sim.initial_rate_rad_s);
        machine.set_stance(sim.stance as usize);
        machine.reset(0.0, &[ai, ao, vi, vo]);
        let t = &config.robot.toe;
        Ok(Self {
            machine,
            toe: Toe {
                stroke_m: t.stroke_m,
                rate_limit_m_s: t.rate_limit_m_s,
                spring_n_m: t.spring_n_m,
                preload_n: t.preload_n,
            },
            toes_m: sim.initial_toe_m,
            release_torque_nm: sim.release_torque_nm,
            held: sim.release_torque_nm > 0.0,
            now_s: 0.0,
            force_n: [0.0; 2],
            lost: false,
        })
    }
}

const fn number(value: f64) -> Number {
    Number { value, slot: None }
}

/// The machine of a configuration: one hip motor that is its torque, no sensors.
fn setting(config: &Config) -> Setting {
    let (p, sim) = (config.robot.model.params(), &config.simulation);
    let scale = [p.leg_length_m, p.total_mass_kg, p.gravity_m_s2];
    let setup = match (sim.on_blocks, sim.stance) {
        (false, _) => Setup::Walk,
        (true, Leg::Inner) => Setup::InnerStance,
        (true, Leg::Outer) => Setup::OuterStance,
    };
    Setting {
        mechanism: MechanismKind::CompassGait,
        setup: Some(setup),
        parameters: scale.into_iter().chain(p.c).map(number).collect(),
        actuators: vec![ActuatorSetting { joint: HIP, gain: number(1.0), back_emf: number(0.0) }],
        sensors: Vec::new(),
        effects: effects(config),
    }
}

fn effects(config: &Config) -> Vec<EffectSetting> {
    let (p, sim) = (config.robot.model.params(), &config.simulation);
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
    if !sim.on_blocks {
        effects.push(effect(EffectKind::FootSlip, Site::Ground, &[sim.ground_friction]));
        effects.push(effect(EffectKind::ElasticImpact, Site::Ground, &[sim.restitution]));
        effects.push(effect(EffectKind::GroundSlope, Site::Ground, &[sim.ground_slope_rad]));
    }
    effects
}

impl World for GroundWorld {
    fn step(&mut self, hip_torque_nm: f64, toe_target_m: [f64; TOES], dt: Span) {
        for (at, target) in self.toes_m.iter_mut().zip(toe_target_m) {
            *at = self.toe.advance(*at, target, dt.as_s());
        }
        self.held = self.held && hip_torque_nm.abs() < self.release_torque_nm;
        if self.held || self.lost {
            return;
        }
        self.machine.command(0, hip_torque_nm, true);
        self.now_s += dt.as_s();
        self.lost = self.machine.advance_to(self.now_s).is_err();
        self.force_n = self.machine.ground_force();
    }

    fn reading(&self) -> Reading {
        let m = &self.machine;
        Reading {
            leg_angle_rad: [m.coordinate(0), m.coordinate(1)],
            leg_rate_rad_s: [m.rate(0), m.rate(1)],
            imu_accel_m_s2: [0.0; 2],
            hip_encoder_rad: m.coordinate(HIP),
            toe_position_m: self.toes_m,
            ground_force_n: self.force_n,
            stance: if m.stance() == 0 { Leg::Inner } else { Leg::Outer },
            airborne: m.contact() == Contact::Flight,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::load;
    use crate::sim::world::BlocksWorld;

    fn config(keys: &[&str]) -> Config {
        let free = ["sim.release_torque_nm=0.0"];
        load(None, &free.iter().chain(keys).map(|k| (*k).to_owned()).collect::<Vec<_>>()).unwrap().config
    }

    #[test]
    fn machine_and_blocks_world_agree_on_both_legs() {
        for stance in ["sim.stance=inner", "sim.stance=outer"] {
            let config = config(&[stance, "sim.initial_angle_rad=[0.05, -0.1]"]);
            let (mut a, mut b) = (GroundWorld::new(&config).unwrap(), BlocksWorld::new(&config));
            for k in 0..500 {
                let torque = 8.0 * libm::sin(f64::from(k) * 0.02);
                a.step(torque, [0.01; 4], Span::from_ms(1));
                b.step(torque, [0.01; 4], Span::from_ms(1));
            }
            let (a, b) = (a.reading(), b.reading());
            for i in 0..2 {
                let gap = (a.leg_angle_rad[i] - b.leg_angle_rad[i]).abs();
                assert!(gap < 1e-4, "{stance}: {:?} {:?}", a.leg_angle_rad, b.leg_angle_rad);
            }
        }
    }

    #[test]
    fn on_the_ground_the_falling_robot_lands_on_its_other_foot() {
        let keys = ["sim.on_blocks=false", "sim.initial_angle_rad=[-0.05, 0.3]", "sim.initial_rate_rad_s=[-0.8, 0.0]"];
        let mut world = GroundWorld::new(&config(&keys)).unwrap();
        assert_eq!(world.reading().stance, Leg::Inner);
        let landed = (0..1500).any(|_| {
            world.step(0.0, [0.03; 4], Span::from_ms(1));
            world.reading().stance == Leg::Outer
        });
        assert!(landed, "{:?}", world.reading());
    }
}
