//! The simulated robot's mechanics behind [`World`]: pinned on either leg, true stick/slip friction, elastic hip, toes.
//!
//! [`BlocksWorld`] stands on blocks (Thesis 4.5): the swing toe meets no ground, the stance toe neither slips nor lifts,
//! the toe springs do not give. [`build`] makes the world that the configuration asks for, this one or [`GroundWorld`].
//! RT: no, but allocation-free.

use super::ground::GroundWorld;
use super::{Place, Reading, World};
use crate::base::ode::rk4;
use crate::base::time::Span;
use crate::config::checked::{Config, Simulation};
use crate::model::compass_gait::dynamics::{self, HipFriction};
use crate::model::compass_gait::params::{Elasticity, Normalised, Params};
use crate::model::compass_gait::{elastic, floating, toe};
use crate::model::machine::MachineError;
use crate::msg::{Leg, TOES};

/// Longest integration step, s: a fiftieth of the period of a 40 Hz mode.
const STEP_S: f64 = 5e-4;
/// Halvings that find the instant at which the hip comes to rest: 5e-4 s / 2^30 is half a picosecond.
const HALVINGS: usize = 30;

/// `[θs, θw, φ, θ̇s, θ̇w, φ̇]`; a rigid hip carries φ = σ along.
type State = [f64; 6];

/// Mechanics on blocks.
#[derive(Clone, Debug)]
pub struct BlocksWorld {
    whole: Normalised<f64>,
    spring: Option<(Normalised<f64>, Elasticity<f64>)>,
    params: Params<f64>,
    toe: toe::Toe<f64>,
    stance: Leg,
    x: State,
    stuck: bool,
    release_torque_nm: f64,
    held: bool,
    toes_m: [f64; TOES],
    torque_nm: f64,
}

impl BlocksWorld {
    /// As configured.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        let sim = &config.simulation;
        let params = real_params(config);
        let whole = params.normalised();
        let spring = sim.hip_elasticity.map(|e| {
            let e = e.elasticity().normalised(params.inertia_kg_m2());
            (elastic::without_rotor(&whole, e.rotor_inertia_kg_m2), e)
        });
        let t = &config.robot.toe;
        Self {
            whole,
            spring,
            params,
            toe: toe::Toe {
                stroke_m: t.stroke_m,
                rate_limit_m_s: t.rate_limit_m_s,
                spring_n_m: t.spring_n_m,
                preload_n: t.preload_n,
            },
            stance: sim.stance,
            x: initial_state(sim),
            stuck: false,
            release_torque_nm: sim.release_torque_nm,
            held: sim.release_torque_nm > 0.0,
            toes_m: sim.initial_toe_m,
            torque_nm: 0.0,
        }
    }

    /// The legs alone: what friction and gravity act on.
    const fn legs(&self) -> &Normalised<f64> {
        match &self.spring {
            Some((legs, _)) => legs,
            None => &self.whole,
        }
    }

    /// Torque that reaches the legs through the spring, or rigidly.
    fn transmitted(&self, x: &State, tau: f64) -> f64 {
        match &self.spring {
            Some((_, e)) => elastic::spring_torque(e, x[2] - x[0] + x[1], x[5] - x[3] + x[4]),
            None => tau,
        }
    }

    /// Friction torque in the present state of sticking or sliding in the sense of `slide`.
    fn friction(&self, x: &State, tau: f64, slide: Option<f64>) -> f64 {
        let legs = self.legs();
        match slide {
            Some(sign) => -legs.viscous * (x[3] - x[4]) - legs.coulomb * sign,
            None => self.holding(x, tau),
        }
    }

    /// Friction that would keep the hip where it is.
    fn holding(&self, x: &State, tau: f64) -> f64 {
        dynamics::locking_torque(self.legs(), [x[0], x[1]], [x[3], x[4]]) - self.transmitted(x, tau)
    }

    fn derivative(&self, x: &State, tau: f64, slide: Option<f64>) -> State {
        let friction = self.friction(x, tau, slide);
        if let Some((legs, e)) = &self.spring {
            let a = elastic::acceleration_with(legs, e, x, tau, friction);
            return [x[3], x[4], x[5], a[0], a[1], a[2]];
        }
        let a = dynamics::acceleration_without_friction(&self.whole, [x[0], x[1]], [x[3], x[4]], tau + friction);
        [x[3], x[4], x[3] - x[4], a[0], a[1], a[0] - a[1]]
    }

    /// One step of at most [`STEP_S`]; ends early when the hip comes to rest. Says the time used.
    fn advance(&mut self, tau: f64, h: f64) -> f64 {
        let rate = self.x[3] - self.x[4];
        if self.stuck {
            let legs = self.legs();
            if let HipFriction::Slip(f) = dynamics::stick_slip(legs, 0.0, true, self.holding(&self.x, tau)) {
                self.stuck = false;
                // Breaks away against the friction.
                self.x = rk4(&self.x, h, |x| self.derivative(x, tau, Some(-f.signum())));
            } else {
                self.x = rk4(&self.x, h, |x| self.derivative(x, tau, None));
            }
            return h;
        }
        let slide = if rate == 0.0 { 0.0 } else { rate.signum() };
        let next = rk4(&self.x, h, |x| self.derivative(x, tau, Some(slide)));
        if (next[3] - next[4]) * slide > 0.0 || self.legs().coulomb <= 0.0 {
            self.x = next;
            return h;
        }
        self.come_to_rest(tau, h, slide)
    }

    /// Bisects the instant at which the hip's rate changes sign, and sticks there.
    fn come_to_rest(&mut self, tau: f64, h: f64, slide: f64) -> f64 {
        let (mut low, mut high) = (0.0, h);
        for _ in 0..HALVINGS {
            let mid = 0.5 * (low + high);
            let x = rk4(&self.x, mid, |x| self.derivative(x, tau, Some(slide)));
            if (x[3] - x[4]) * slide > 0.0 { low = mid } else { high = mid }
        }
        self.x = rk4(&self.x, high, |x| self.derivative(x, tau, Some(slide)));
        // What is left of the rate (1e-9 rad/s) goes to the light swing leg.
        self.x[4] = self.x[3];
        self.stuck = true;
        high
    }

    /// Accelerations of the legs now.
    fn acceleration(&self, tau: f64) -> [f64; 2] {
        if self.held {
            return [0.0; 2];
        }
        let slide = if self.stuck { None } else { Some((self.x[3] - self.x[4]).signum()) };
        let d = self.derivative(&self.x, tau, slide);
        [d[3], d[4]]
    }

    const fn sign(&self) -> f64 {
        match self.stance {
            Leg::Inner => 1.0,
            Leg::Outer => -1.0,
        }
    }

    const fn by_leg(&self, stance_first: [f64; 2]) -> [f64; 2] {
        let [s, w] = stance_first;
        match self.stance {
            Leg::Inner => [s, w],
            Leg::Outer => [w, s],
        }
    }
}

/// The model's parameters, leg 1 the one that stands, with the real friction.
fn real_params(config: &Config) -> Params<f64> {
    let sim = &config.simulation;
    let inner = config.body().params();
    let params = if sim.stance == Leg::Inner { inner } else { inner.swapped() };
    Params {
        viscous_nm_s_rad: params.viscous_nm_s_rad * sim.friction_scale[0],
        coulomb_nm: params.coulomb_nm * sim.friction_scale[1],
        ..params
    }
}

fn initial_state(sim: &Simulation) -> State {
    let ([ai, ao], [vi, vo]) = (sim.initial_angle_rad, sim.initial_rate_rad_s);
    match sim.stance {
        Leg::Inner => [ai, ao, ai - ao, vi, vo, vi - vo],
        Leg::Outer => [ao, ai, ao - ai, vo, vi, vo - vi],
    }
}

impl World for BlocksWorld {
    fn step(&mut self, hip_torque_nm: f64, toe_target_m: [f64; TOES], dt: Span) {
        let dt_s = dt.as_s();
        self.torque_nm = hip_torque_nm;
        for (at, target) in self.toes_m.iter_mut().zip(toe_target_m) {
            *at = self.toe.advance(*at, target, dt_s);
        }
        self.held = self.held && hip_torque_nm.abs() < self.release_torque_nm;
        if self.held {
            return;
        }
        let tau = self.sign() * hip_torque_nm / self.params.inertia_kg_m2();
        let mut left = dt_s;
        while left > 1e-12 {
            left -= self.advance(tau, left.min(STEP_S));
        }
    }

    fn let_go(&mut self) {
        self.held = false;
    }

    /// The hip moves with -l cos θs per rate of the stance leg; legs alone take the blow, a sprung rotor stays behind.
    fn push(&mut self, impulse_ns: f64) {
        if self.held {
            return;
        }
        let lever_m = -self.params.leg_length_m * libm::cos(self.x[0]);
        let blow = lever_m * impulse_ns / self.params.inertia_kg_m2();
        let [[h11, h12], [_, h22]] = dynamics::mass_matrix(self.legs(), [self.x[0], self.x[1]]);
        let det = h11 * h22 - h12 * h12;
        self.x[3] += h22 * blow / det;
        self.x[4] -= h12 * blow / det;
        if self.spring.is_none() {
            self.x[5] = self.x[3] - self.x[4];
        }
        self.stuck = false;
    }

    fn reading(&self) -> Reading {
        let tau = self.sign() * self.torque_nm / self.params.inertia_kg_m2();
        let ([ts, tw, _, vs, vw, _], l) = (self.x, self.params.leg_length_m);
        let a = self.acceleration(tau);
        let (s, c) = libm::sincos(ts);
        let force = floating::ground_force(self.legs(), [ts, tw], [vs, vw], a);
        Reading {
            leg_angle_rad: self.by_leg([ts, tw]),
            leg_rate_rad_s: self.by_leg([vs, vw]),
            imu_accel_m_s2: [l * (s * vs * vs - c * a[0]), -l * (c * vs * vs + s * a[0])],
            hip_encoder_rad: self.sign() * (ts - tw),
            toe_position_m: self.toes_m,
            toe_spring_m: [0.0; TOES],
            ground_force_n: force.map(|f| f * self.params.mass_moment_kg_m()),
            stance: self.stance,
            airborne: false,
            slides: false,
        }
    }

    fn place(&self) -> Place {
        let ([ts, _, _, vs, ..], l) = (self.x, self.params.leg_length_m);
        let (sin, cos) = libm::sincos(ts);
        let rate = if self.held { 0.0 } else { vs };
        Place { hip_m: [-l * sin, l * cos], hip_m_s: [-l * cos * rate, -l * sin * rate], slope_rad: 0.0 }
    }
}

/// Why there is no world for a configuration.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum WorldError {
    /// On the ground, something that the stepping machine does not model.
    #[error("sim.on_blocks = false: {0}")]
    Ground(#[from] MachineError),
}

/// The world of a configuration: `sim.on_blocks` chooses.
///
/// # Errors
/// [`WorldError`].
pub fn build(config: &Config) -> Result<Box<dyn World>, WorldError> {
    Ok(if config.simulation.on_blocks {
        Box::new(BlocksWorld::new(config))
    } else {
        Box::new(GroundWorld::new(config)?)
    })
}
