//! L3, room 3: the robot's state from two angles, the torque and the model.
//!
//! | file | what |
//! |---|---|
//! | [`high_gain`] | observer of Thesis (4.14)-(4.17), corrected, around the nonlinear model with friction |
//! | [`bias`] | what the IMU reads too much, learnt from the balance of angular momentum |
//! | [`terrain`] | what it reads too much by the floor that a lidar sees: seconds and slower |
//! | [`attitude`] | leg angle: gyro for fast motion, device or accelerometer for slow |
//! | [`contact`] | what a change of the stance leg does to the state |
//! | [`touchdown`] | when it changes: the swing toe's spring gives way, affirmed by the weight |
//! | [`weight`] | which foot carries the weight: balance of angular momentum about each |
//!
//! Three ways to go on, chosen by the corridor: [`Estimator::follow`] while disarmed (somebody may hold the robot, so the
//! model does not apply: angles as measured, rates by gyro and filtered difference; it stands as configured),
//! [`Estimator::step`] while armed, and [`Estimator::stand_on_both`] while the controller rests: the model knows one foot.
//!
//! Limits: flight and slip are not known here; a push from outside is seen late, its error fades with 1/ε - 3.2 1/s. On both feet
//! nothing is predicted, so nothing contradicts a sensor; a robot that tips over is seen by its tilt alone.
//! RT: yes, no allocation, ~1 µs.

#![cfg_attr(
    not(test),
    deny(
        clippy::disallowed_methods,
        clippy::disallowed_types,
        clippy::disallowed_macros,
        clippy::expect_used,
        clippy::indexing_slicing
    )
)]

mod attitude;
mod bias;
mod contact;
mod high_gain;
mod measure;
mod terrain;
mod touchdown;
mod weight;

use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::msg::{Estimate, JointCommand, Leg, LidarSample, Snapshot, TOES, Terrain};
use bias::BiasObserver;
use high_gain::{HighGain, StanceModel, State};
use measure::{Measured, Sampled, Sensors};
use terrain::TerrainZero;
use touchdown::{Detector, Signs, Verdict, doubt};
use weight::Weight;

/// Longest gap that the observer bridges with its model; after more it starts again.
const LONGEST_GAP: Span = Span::from_ms(50);

/// Periods of the IMU, or of a slower tick, after which the momentum is carried on no longer.
const SAMPLES: f64 = 3.0;

/// So long after a touchdown the bias learns nothing: rates are means over some ms, and the legs ring.
const SETTLING: Span = Span::from_ms(40);

/// So long after a touchdown the weight raises no doubt: the foot that has landed may bounce or slip.
const LANDING: Span = Span::from_ms(20);

/// Why there is no estimator for a configuration.
#[derive(Clone, Copy, Debug, PartialEq, thiserror::Error)]
pub enum EstimatorError {
    /// The model inside falls faster than the observer follows.
    #[error(
        "control.observer_epsilon_s = {epsilon_s} s is too slow: the observer diverges from {limit_s:.3} s on \
         (1 / unstable pole of the model)"
    )]
    TooSlow {
        /// As configured.
        epsilon_s: f64,
        /// First value that diverges.
        limit_s: f64,
    },
}

/// Models and gains per stance leg, and the state.
#[derive(Clone, Debug)]
pub struct Estimator {
    observer: HighGain,
    models: [StanceModel; 2],
    torque_unit_nm: f64,
    first_stance: Leg,
    sensors: Sensors,
    stance: Leg,
    state: Option<State>,
    bias: BiasObserver,
    terrain: TerrainZero,
    touchdown: Detector,
    weight: Weight,
    leg_m: f64,
    /// Longest time between IMU samples that tells a rate, s.
    longest_interval_s: f64,
    innovation_rad: [f64; 2],
    last: Stamp,
    landed: Stamp,
    steps: u32,
}

impl Estimator {
    /// For this robot and this ε.
    ///
    /// # Errors
    /// [`EstimatorError::TooSlow`] when ε exceeds the slow-model limit on either leg.
    pub fn new(config: &Config) -> Result<Self, EstimatorError> {
        let (robot, control) = (&config.robot, &config.control);
        let period = config.real_time.period;
        let imu_period_s = 1.0 / f64::from(robot.imu.rate_hz.max(1));
        let params = robot.model.params();
        let spring = robot.model.hip_elasticity.map(|e| e.elasticity());
        let models = [params, params.swapped()].map(|p| StanceModel::new(&p, spring.as_ref()));
        let observer = HighGain::new(control.observer_epsilon_s);
        let limit_s = models.iter().map(|m| observer.slow_limit_s(m)).fold(f64::INFINITY, f64::min);
        if control.observer_epsilon_s >= limit_s {
            return Err(EstimatorError::TooSlow { epsilon_s: control.observer_epsilon_s, limit_s });
        }
        Ok(Self {
            observer,
            models,
            torque_unit_nm: params.inertia_kg_m2(),
            first_stance: control.stance,
            sensors: Sensors::new(robot, control.attitude_time_s, period),
            stance: control.stance,
            state: None,
            bias: BiasObserver::new(control.bias_time_s, control.bias_rejects_pushes),
            terrain: TerrainZero::new(robot.lidar.as_ref()),
            touchdown: Detector::new(control.touchdown_spring_m),
            weight: Weight::new(std::f64::consts::TAU / robot.hip.encoder_counts_per_turn),
            leg_m: params.leg_length_m,
            longest_interval_s: SAMPLES * imu_period_s.max(period.as_s()),
            innovation_rad: [0.0; 2],
            last: Stamp::NEVER,
            landed: Stamp::NEVER,
            steps: 0,
        })
    }

    /// Forgets everything: as after start.
    pub fn reset(&mut self) {
        self.sensors.reset();
        self.stance = self.first_stance;
        self.state = None;
        self.bias.reset();
        self.terrain.reset();
        self.touchdown.reset();
        self.weight.reset();
        self.innovation_rad = [0.0; 2];
        self.last = Stamp::NEVER;
        self.steps = 0;
    }

    /// What the lidar said since the call before, before each [`Self::follow`], [`Self::step`] or [`Self::stand_on_both`].
    pub fn hear(&mut self, now: Stamp, word: &LidarSample) {
        let moved_rad = self.terrain.hear(now, word);
        // Only a learner that is at work makes up for what the terrain takes over.
        if self.bias.learns() {
            self.bias.hand_over(moved_rad);
        }
    }

    /// What the floor says of the attitude.
    #[must_use]
    pub fn terrain(&self, now: Stamp) -> Terrain {
        self.terrain.tell(now)
    }

    /// Both legs as measured, less what the attitude is believed to read too much.
    fn measure(&mut self, snapshot: &Snapshot) -> Option<Measured> {
        let measured = self.sensors.measure(snapshot, self.bias.bias_rad() + self.terrain.zero_rad());
        if let Some(raw) = self.sensors.raw(snapshot) {
            self.terrain.remember(raw.stamp, raw.leg_rad, snapshot.hip_angle_rad);
        }
        measured
    }

    /// While disarmed: the state is what the sensors say, on the configured leg. Invalid until they are all fresh.
    pub fn follow(&mut self, now: Stamp, snapshot: &Snapshot) -> Estimate {
        self.stance = self.first_stance;
        self.touchdown.reset();
        self.weight.reset();
        self.begin(now, snapshot)
    }

    /// Starts from what the sensors say.
    fn begin(&mut self, now: Stamp, snapshot: &Snapshot) -> Estimate {
        let measured = self.measure(snapshot);
        self.state = measured.map(|m| start(&m.stance_first(self.stance)));
        self.bias.pause();
        self.innovation_rad = [0.0; 2];
        self.last = now;
        self.estimate(now, snapshot)
    }

    /// While armed: predict with the torque that was `applied` since the last call, correct with the measured angles.
    pub fn step(&mut self, now: Stamp, snapshot: &Snapshot, applied: &JointCommand) -> Estimate {
        let gap = now.since(self.last);
        match self.state {
            Some(state) if gap > Span::ZERO && gap <= LONGEST_GAP => {
                let measured = self.measure(snapshot);
                let tau = stance_sign(self.stance) * applied.hip_torque_nm / self.torque_unit_nm;
                self.advance(state, measured.as_ref(), tau, gap.as_s());
                self.last = now;
                self.judge_stance(now, snapshot, measured.as_ref());
                self.estimate(now, snapshot)
            }
            _ => self.begin(now, snapshot),
        }
    }

    /// While armed and at rest on both feet: angles less the bias as learnt before, rates by gyro and filtered difference. On two
    /// feet the moment of gravity says nothing of the attitude; taken for one foot's it was learnt as a bias of .06 rad.
    /// The foot in front counts as the one that stands: over that one the robot walks on.
    pub fn stand_on_both(&mut self, now: Stamp, snapshot: &Snapshot) -> Estimate {
        self.touchdown.stand_on_both(now);
        let measured = self.measure(snapshot);
        // Without a fresh measurement it stands as it stood; `safety` judges the age.
        if let Some(m) = &measured {
            let front = if snapshot.hip_angle_rad > 0.0 { Leg::Inner } else { Leg::Outer };
            if front != self.stance {
                self.stance = front;
                self.steps = self.steps.wrapping_add(1);
                self.weight.change();
            }
            self.state = Some(start(&m.stance_first(front)));
        }
        self.innovation_rad = [0.0; 2];
        self.last = now;
        // What it learns of the bias begins once the foot has stood alone for a while.
        self.landed = now;
        self.learn(measured.as_ref().and_then(|m| m.sampled.as_ref()));
        self.estimate(now, snapshot)
    }

    /// The swing foot stands from now on, and the stance foot swings: impact map on the state, labels exchanged.
    pub fn change_stance(&mut self) {
        if let Some(state) = self.state {
            self.state = contact::touchdown(self.model(), &state);
        }
        self.bias.restart();
        self.weight.change();
        self.stance = self.stance.other();
        self.steps = self.steps.wrapping_add(1);
    }

    /// Springs and weight say which leg stands.
    fn judge_stance(&mut self, now: Stamp, snapshot: &Snapshot, measured: Option<&Measured>) {
        let Some([ts, tw, ..]) = self.state else { return };
        let signs = Signs {
            now,
            seen: snapshot,
            stance: self.stance,
            elsewhere: self.weight.beside(self.stance),
            here: self.weight.beside(self.stance.other()),
            height_m: self.swing_height_m(ts, tw, &snapshot.toe_position_m),
        };
        let verdict = self.touchdown.judge(&signs);
        if !self.touchdown.suspects() && verdict == Verdict::Stays {
            self.bias.trust();
        }
        match (verdict, measured) {
            (Verdict::Stays, _) | (Verdict::TakenBack, None) => {}
            (Verdict::Changes | Verdict::ChangedBefore, _) => {
                self.change_stance();
                self.landed = now;
                if verdict == Verdict::ChangedBefore {
                    self.bias.take_back();
                }
            }
            (Verdict::TakenBack, Some(m)) => {
                // The impact that never was is forgotten with the rates that it gave.
                self.stance = self.stance.other();
                self.weight.change();
                self.steps = self.steps.wrapping_sub(1);
                self.state = Some(start(&m.stance_first(self.stance)));
                self.landed = now;
            }
        }
    }

    /// Height of the swing foot over the level of the stance foot, toes included, m.
    fn swing_height_m(&self, stance_rad: f64, swing_rad: f64, toes_m: &[f64; TOES]) -> f64 {
        let [inner_a, inner_b, outer_a, outer_b] = *toes_m;
        let (inner, outer) = (inner_a.max(inner_b), outer_a.max(outer_b));
        let (stance_m, swing_m) = if self.stance == Leg::Inner { (inner, outer) } else { (outer, inner) };
        let (cos_s, cos_w) = (libm::cos(stance_rad), libm::cos(swing_rad));
        (self.leg_m + stance_m) * cos_s - (self.leg_m + swing_m) * cos_w
    }

    /// One period of the observer. Without a fresh measurement the model goes on alone; `safety` judges the age.
    fn advance(&mut self, state: State, measured: Option<&Measured>, tau: f64, dt_s: f64) {
        let mut predicted = self.model().predict(&state, tau, dt_s);
        self.innovation_rad = [0.0; 2];
        match measured {
            None => self.bias.restart(),
            Some(m) => {
                let y = m.stance_first(self.stance);
                self.innovation_rad = [y[0] - predicted[0], y[1] - predicted[1]];
                predicted = self.observer.correct(&predicted, self.innovation_rad, dt_s);
                self.learn(m.sampled.as_ref());
            }
        }
        self.state = Some(predicted);
    }

    /// What the balance of momentum says of weight and bias, from each IMU sample.
    fn learn(&mut self, sampled: Option<&Sampled>) {
        let Some(m) = sampled else { return };
        let (model, measured) = (*self.model(), m.stance_first(self.stance));
        if m.dt_s > self.longest_interval_s {
            self.weight.pause();
            return self.bias.restart();
        }
        self.weight.step(&self.models, &[Leg::Inner, Leg::Outer].map(|leg| m.stance_first(leg)), m.dt_s);
        // A mean rate that mixes before and after a touchdown says nothing about the moment of gravity.
        if self.landed != Stamp::NEVER && self.last.since(self.landed) < SETTLING {
            return self.bias.restart();
        }
        let believed = self.state.map(|[_, _, _, vs, vw, _]| [vs, vw]);
        self.bias.step(&model.whole, &measured, believed, m.dt_s);
    }

    /// The foot stands that landed last.
    fn is_settled(&self, now: Stamp) -> bool {
        self.landed == Stamp::NEVER || now.since(self.landed) >= LANDING
    }

    const fn model(&self) -> &StanceModel {
        let [inner, outer] = &self.models;
        match self.stance {
            Leg::Inner => inner,
            Leg::Outer => outer,
        }
    }

    fn estimate(&self, now: Stamp, snapshot: &Snapshot) -> Estimate {
        let [ts, tw, phi, vs, vw, vphi] = self.state.unwrap_or_default();
        let [innovation_stance_rad, innovation_swing_rad] = self.innovation_rad;
        // A rigid hip carries φ along; what the rounding leaves is not a twist.
        let elastic = f64::from(u8::from(self.model().hip.is_some()));
        Estimate {
            stamp: now,
            valid: self.state.is_some(),
            stance: self.stance,
            theta_stance_rad: ts,
            theta_swing_rad: tw,
            theta_stance_rad_s: vs,
            theta_swing_rad_s: vw,
            innovation_stance_rad,
            innovation_swing_rad,
            hip_angle_rad: snapshot.hip_angle_rad,
            hip_twist_rad: elastic * (phi - (ts - tw)),
            hip_twist_rad_s: elastic * (vphi - (vs - vw)),
            attitude_bias_rad: self.bias.bias_rad(),
            steps: self.steps,
            weight_elsewhere: self.weight.beside(self.stance),
            stance_doubt: if self.is_settled(now) { doubt(self.weight.beside(self.stance)) } else { 0.0 },
            stuck_pots: self.touchdown.stuck(),
        }
    }
}

/// Sign of the motor's torque (+ on inner) on the stance row: the positive feedback of Thesis 2.1.4 when mistaken.
const fn stance_sign(stance: Leg) -> f64 {
    match stance {
        Leg::Inner => 1.0,
        Leg::Outer => -1.0,
    }
}

/// State from measured `[θs, θw, θ̇s, θ̇w]`, the spring relaxed.
const fn start(m: &[f64; 4]) -> State {
    let [ts, tw, vs, vw] = *m;
    [ts, tw, ts - tw, vs, vw, vs - vw]
}

#[cfg(test)]
mod terrain_tests;
#[cfg(test)]
mod tests;
