//! The library as hypotheses: for each effect its places, its parameters with bounds, and where to start looking.
//!
//! Starts are fractions of the scales that the recordings themselves show (torque, rate, travel, sampling), never
//! numbers of a case. A start is near zero effect where the effect is nested there, else the weakest strength that
//! acts at all; shape parameters (a velocity, a frequency, a gap) get a grid.
//! RT: no.

use crate::diagnose::screen::scales::{ActuatorScale, JointScale, Scales, SensorScale};
use crate::model::rig::Side;

/// A parameter of a candidate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Key {
    /// Name of contract §3.
    pub name: &'static str,
    /// Smallest value.
    pub min: f64,
    /// Largest value.
    pub max: f64,
    /// Fitted as a logarithm: positive over decades.
    pub log: bool,
}

/// An effect at a place, as a hypothesis.
#[derive(Clone, Debug, PartialEq)]
pub struct Candidate {
    /// Id of contract §3.
    pub effect: &'static str,
    /// Its place.
    pub at: String,
    /// Its parameters.
    pub keys: Vec<Key>,
    /// Values to start from, in the order of `keys`.
    pub starts: Vec<Vec<f64>>,
    /// The one recording that it acts in, for single events.
    pub only: Option<String>,
    /// The sensor that sits on the motor side of the joint then, where two read the same coordinate.
    pub motor_sensor: Option<String>,
    /// Side of the joint that it acts on.
    pub side: Side,
}

impl Candidate {
    /// True if it adds numbers to the initial state of every window.
    #[must_use]
    pub fn has_inner_states(&self) -> bool {
        ["joint_elasticity", "backlash", "link_flexibility", "presliding", "sensor_lag"].contains(&self.effect)
    }

    /// True if it is the same effect at the same place, whatever its starts and how far it may go.
    #[must_use]
    pub fn is_same_as(&self, other: &Self) -> bool {
        let order = |c: &Self| c.keys.iter().find(|k| k.name == "order").copied();
        (self.effect, &self.at, &self.only, &self.motor_sensor, self.side, order(self))
            == (other.effect, &other.at, &other.only, &other.motor_sensor, other.side, order(other))
    }

    /// True if it is another effect at the same place that data may take for this one ([`look_alike`]), or the same on the other side
    /// of the joint.
    #[must_use]
    pub fn looks_like(&self, other: &Self) -> bool {
        let place = |c: &Self| (c.at.clone(), c.only.clone(), c.motor_sensor.clone());
        let is_other = match self.effect == other.effect {
            true => self.side != other.side,
            false => self.side == other.side && look_alike(self.effect, other.effect),
        };
        place(self) == place(other) && is_other
    }

    /// Its place, and what tells it from others of its kind there.
    #[must_use]
    pub fn place(&self) -> String {
        let order =
            self.keys.iter().find(|k| k.name == "order").map(|k| format!(", order {:.4}", 0.5 * (k.min + k.max)));
        let side = if self.side == Side::Motor { ", on the motor's side" } else { "" };
        format!(
            "{}{}{side}",
            self.at,
            order.map(|o| o.trim_end_matches('0').trim_end_matches('.').to_owned()).unwrap_or_default()
        )
    }
}

const fn linear(name: &'static str, min: f64, max: f64) -> Key {
    Key { name, min, max, log: false }
}

const fn decades(name: &'static str, min: f64, max: f64) -> Key {
    Key { name, min, max, log: true }
}

fn candidate(effect: &'static str, at: &str, keys: Vec<Key>, starts: Vec<Vec<f64>>) -> Candidate {
    Candidate { effect, at: at.to_owned(), keys, starts, only: None, motor_sensor: None, side: Side::Link }
}

/// Every candidate of the library that makes sense on this mechanism. Localised ones (a push, lost counts) start at
/// the times that a scan of the residual proposes and are not here.
#[must_use]
pub fn library(scales: &Scales) -> Vec<Candidate> {
    let mut all = Vec::new();
    for joint in &scales.joints {
        if joint.borne {
            all.extend(friction(joint, scales));
        }
        all.extend(forces(joint));
        if joint.driven {
            all.extend(transmission(joint));
            all.extend(two_encoders(joint, scales));
        }
        // A mode stands at a link; the hip of a compass gait has none of its own.
        if joint.name != "hip" {
            all.extend(structure(joint));
        }
    }
    for actuator in &scales.actuators {
        all.extend(drive(actuator, scales));
    }
    for sensor in &scales.sensors {
        all.extend(sensing(sensor, scales));
    }
    if let Some(leg_m) = scales.leg_m {
        all.extend(ground(leg_m, scales));
    }
    all
}

/// On a nearly perfect base, or one that has made up for what is missing, a start of the size of the machine moves the simulation
/// beyond what a tangent says; a second, gentle one does not. So every effect has a start near nothing.
pub const GENTLE: f64 = 0.05;

fn friction(j: &JointScale, scales: &Scales) -> Vec<Candidate> {
    let level = j.torque.max(j.coulomb);
    let gentle = |start: f64| vec![vec![start], vec![GENTLE * start]];
    let viscous = level / j.rate.max(1e-12);
    let small = 0.003 * level;
    let mut all = vec![
        candidate("viscous_friction", &j.name, vec![linear("viscous", 0.0, 10.0 * viscous)], gentle(0.003 * viscous)),
        candidate("coulomb_friction", &j.name, vec![linear("coulomb", 0.0, 3.0 * level)], gentle(small)),
        candidate("load_friction", &j.name, vec![linear("coefficient", 0.0, 2.0)], gentle(0.01)),
        candidate(
            "quadratic_drag",
            &j.name,
            vec![linear("quadratic", 0.0, 10.0 * viscous / j.rate.max(1e-12))],
            gentle(0.002 * viscous / j.rate.max(1e-12)),
        ),
    ];
    if j.driven {
        // What passes through the joint lies between the motor's torque and the mean with what it holds up, by where
        // the inertia sits, which no rig tells.
        let load = all.iter().find(|c| c.effect == "load_friction").cloned();
        all.extend(load.map(|c| Candidate { side: Side::Motor, ..c }));
    }
    // These refine a Coulomb level; without one they would stand in for it.
    if j.coulomb > 0.0 {
        all.push(candidate(
            "stribeck_friction",
            &j.name,
            vec![linear("extra", 0.0, 3.0 * level), decades("velocity", 0.003 * j.rate, 2.0 * j.rate)],
            [0.03, 0.1, 0.3, 0.8].iter().map(|v| vec![small, v * j.rate]).collect(),
        ));
        let limit = 2.0 / scales.duration_s;
        all.push(candidate("friction_drift", &j.name, vec![linear("rate", -limit, 10.0 * limit)], vec![vec![0.0]]));
        // A bristle that does not yield within a window is a spring that every window loads anew.
        let softest = j.coulomb / (0.2 * j.stroke.max(1e-12));
        all.push(candidate(
            "presliding",
            &j.name,
            vec![decades("stiffness", 0.3 * softest, 3e4 * softest)],
            [4.0, 20.0, 100.0, 500.0].iter().map(|x| vec![x * softest]).collect(),
        ));
    }
    all
}

fn forces(j: &JointScale) -> Vec<Candidate> {
    let small = 0.01 * j.torque.max(j.coulomb);
    let stiffness = small / j.travel.max(1e-12);
    vec![
        candidate("torque_offset", &j.name, vec![linear("torque", -300.0 * small, 300.0 * small)], vec![vec![0.0]]),
        candidate(
            "parallel_spring",
            &j.name,
            vec![linear("stiffness", 0.0, 1e4 * stiffness), linear("rest", -20.0 * j.travel, 20.0 * j.travel)],
            [(1.0, 0.0), (1.0, -2.0), (1.0, 2.0), (GENTLE, 0.0)]
                .iter()
                .map(|(times, travels)| vec![times * stiffness, travels * j.travel])
                .collect(),
        ),
    ]
}

fn transmission(j: &JointScale) -> Vec<Candidate> {
    let (tau, pi) = (2.0 * std::f64::consts::PI, std::f64::consts::PI);
    let mut elastic = Vec::new();
    for share in [0.15, 0.5] {
        for hz in [4.0, 10.0, 25.0, 75.0] {
            let rotor = share * j.inertia;
            let reduced = rotor * (1.0 - share);
            let stiffness = reduced * (tau * hz) * (tau * hz);
            elastic.push(vec![stiffness, 0.06 * reduced * tau * hz, rotor]);
        }
    }
    let stiffest = j.inertia * (tau * 300.0) * (tau * 300.0);
    let rotor = Key { name: "rotor_inertia", min: 0.003 * j.inertia, max: 0.97 * j.inertia, log: true };
    let gaps = [0.0004, 0.002, 0.01, 0.05];
    vec![
        candidate(
            "joint_elasticity",
            &j.name,
            vec![
                decades("stiffness", 1e-6 * stiffest, stiffest),
                decades("damping", 1e-7 * j.inertia * tau, 10.0 * j.inertia * tau * pi),
                rotor,
            ],
            elastic,
        ),
        candidate(
            "backlash",
            &j.name,
            vec![decades("gap", 1e-4 * j.travel, j.travel), rotor],
            gaps.iter()
                .flat_map(|g| [vec![g * j.travel, 0.1 * j.inertia], vec![g * j.travel, 0.4 * j.inertia]])
                .collect(),
        ),
    ]
}

/// An elastic joint with two sensors of one kind: either of them may sit on the motor.
fn two_encoders(j: &JointScale, scales: &Scales) -> Vec<Candidate> {
    let here: Vec<&SensorScale> = scales.sensors.iter().filter(|s| s.joint == j.name).collect();
    let paired = |s: &SensorScale| here.iter().filter(|o| o.of_rate == s.of_rate).count() > 1;
    let elastic: Vec<Candidate> = transmission(j).into_iter().filter(|c| c.effect == "joint_elasticity").collect();
    let on_motor = |s: &&SensorScale| {
        let column = s.column.clone();
        elastic.iter().map(move |c| Candidate { motor_sensor: Some(column.clone()), ..c.clone() }).collect::<Vec<_>>()
    };
    here.iter().copied().filter(|s| paired(s)).flat_map(|s| on_motor(&s)).collect()
}

fn structure(j: &JointScale) -> Vec<Candidate> {
    let keys =
        vec![decades("frequency", 1.5, 200.0), decades("damping", 0.002, 0.5), linear("participation", 0.0, 0.9)];
    let starts = [3.0, 6.0, 12.0, 25.0, 50.0].iter().map(|f| vec![*f, 0.03, 0.03]).collect();
    vec![candidate("link_flexibility", &j.name, keys, starts)]
}

fn drive(a: &ActuatorScale, scales: &Scales) -> Vec<Candidate> {
    let longest = 100.0 * scales.step_s;
    vec![
        candidate(
            "actuator_lag",
            &a.column,
            vec![linear("time_constant", 0.0, longest)],
            delays(scales.step_s, 0.5 * scales.step_s),
        ),
        candidate("transport_delay", &a.column, vec![linear("delay", 0.0, longest)], delays(scales.step_s, longest)),
        candidate(
            "torque_limit",
            &a.column,
            vec![linear("limit", 0.02 * a.peak, 1.05 * a.peak)],
            [1.0 - 0.1 * GENTLE, 0.95, 0.85, 0.7, 0.5].iter().map(|x| vec![x * a.peak]).collect(),
        ),
    ]
}

/// Delays from which a fit starts, in rows. The first is so short that it changes next to nothing: a robot that balances is led far away by
/// half a row, and from there a linear step says nothing. A command is held from row to row: to a simulator with coarse steps each whole row
/// is an edge that no gradient sees beyond. A lag has no such edges.
const DELAYS_ROWS: [f64; 7] = [0.05, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0];

/// Those that are no longer than `longest`, s.
fn delays(step_s: f64, longest: f64) -> Vec<Vec<f64>> {
    DELAYS_ROWS.iter().map(|rows| rows * step_s).filter(|delay| *delay <= longest).map(|delay| vec![delay]).collect()
}

fn sensing(s: &SensorScale, scales: &Scales) -> Vec<Candidate> {
    // What a reading remembers for longer than a window is the start of each window and no law.
    let longest = (100.0 * scales.step_s).min(MEMORY * scales.window_s);
    let mut all = vec![
        candidate(
            "sensor_lag",
            &s.column,
            vec![linear("time_constant", 0.0, longest)],
            delays(scales.step_s, 0.5 * scales.step_s),
        ),
        candidate("sensor_delay", &s.column, vec![linear("delay", 0.0, longest)], delays(scales.step_s, longest)),
        candidate("sensor_bias", &s.column, vec![linear("bias", -3.0 * s.spread, 3.0 * s.spread)], vec![vec![0.0]]),
        candidate(
            "sensor_drift",
            &s.column,
            vec![linear("rate", -DRIFT * s.spread / scales.duration_s, DRIFT * s.spread / scales.duration_s)],
            vec![vec![0.0]],
        ),
        candidate("sensor_scale", &s.column, vec![linear("scale", 0.3, 3.0)], vec![vec![1.0]]),
        candidate("clock_skew", &s.column, vec![linear("skew", -0.1, 0.1)], vec![vec![0.0]]),
    ];
    if !s.of_rate {
        let amplitude = 0.003 * s.spread;
        all.push(candidate(
            "encoder_eccentricity",
            &s.column,
            vec![linear("amplitude", 0.0, 0.5 * s.spread), linear("phase", -20.0, 20.0)],
            vec![vec![amplitude, 0.0], vec![amplitude, 2.1], vec![amplitude, -2.1]],
        ));
    }
    all
}

/// Longest memory of a sensor, in windows.
const MEMORY: f64 = 0.2;

/// Most that a reading drifts over a recording, in parts of its spread: beyond, it is the reading itself.
const DRIFT: f64 = 1.0;

fn ground(leg_m: f64, scales: &Scales) -> Vec<Candidate> {
    let at = "ground";
    let mut all = vec![
        candidate("ground_slope", at, vec![linear("slope", -0.3, 0.3)], vec![vec![0.0]]),
        candidate(
            "counterweight",
            at,
            vec![linear("force", -0.5 * scales.weight_n, 2.0 * scales.weight_n)],
            vec![vec![0.0]],
        ),
        candidate("round_foot", at, vec![linear("radius", 0.0, leg_m)], vec![vec![0.0]]),
        candidate(
            "toe_compliance",
            at,
            vec![
                decades("stiffness", 3.0 * scales.weight_n / leg_m, 3e5 * scales.weight_n / leg_m),
                decades("damping", 0.03 * scales.weight_n / leg_m, 3e3 * scales.weight_n / leg_m),
            ],
            [100.0, 400.0, 1600.0, 6400.0, 25600.0]
                .iter()
                .map(|x| vec![x * scales.weight_n / leg_m, 4.0 * scales.weight_n / leg_m])
                .collect(),
        ),
        candidate(
            "foot_slip",
            at,
            vec![linear("friction", 0.02, 1.5)],
            [0.6, 0.4, 0.25, 0.15, 0.1].iter().map(|x| vec![*x]).collect(),
        ),
    ];
    if scales.walks {
        all.push(candidate(
            "elastic_impact",
            at,
            vec![linear("restitution", 0.0, 0.95)],
            vec![vec![0.05], vec![0.2], vec![0.4]],
        ));
    }
    all
}

/// Effects that this data may take for one another: all partners of a good candidate are fitted as well.
pub const LOOKALIKES: &[&[&str]] = &[
    &[
        "transport_delay",
        "actuator_lag",
        "joint_elasticity",
        "link_flexibility",
        "sensor_delay",
        "sensor_lag",
        "clock_skew",
    ],
    &[
        "coulomb_friction",
        "stribeck_friction",
        "presliding",
        "load_friction",
        "friction_drift",
        "quadratic_drag",
        "viscous_friction",
    ],
    &["presliding", "backlash", "joint_elasticity"],
    &["torque_limit", "viscous_friction", "load_friction", "quadratic_drag"],
    &["torque_offset", "parallel_spring", "sensor_bias", "ground_slope"],
    &["torque_ripple", "encoder_eccentricity"],
    &["counterweight", "round_foot", "parallel_spring", "ground_slope"],
    &["foot_slip", "elastic_impact", "toe_compliance"],
    // A leg that gives a little lands as on a slope.
    &["toe_compliance", "ground_slope"],
    &["sensor_scale", "sensor_lag", "sensor_delay"],
];

/// True if `a` and `b` are known to look alike.
#[must_use]
pub fn look_alike(a: &str, b: &str) -> bool {
    LOOKALIKES.iter().any(|group| group.contains(&a) && group.contains(&b))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::effect::{EffectKind, Role};

    pub(crate) fn scales() -> Scales {
        Scales {
            joints: vec![JointScale {
                name: "q1".into(),
                torque: 1.0,
                rate: 2.0,
                travel: 0.5,
                stroke: 0.5,
                inertia: 0.01,
                coulomb: 0.05,
                driven: true,
                turns: true,
                borne: true,
            }],
            actuators: vec![ActuatorScale { column: "u".into(), peak: 1.0 }],
            sensors: vec![SensorScale { column: "q1_rad".into(), joint: "q1".into(), spread: 0.3, of_rate: false }],
            step_s: 0.0025,
            duration_s: 6.0,
            window_s: 2.0,
            leg_m: Some(1.0),
            weight_n: 150.0,
            walks: true,
        }
    }

    #[test]
    fn every_start_lies_within_its_bounds() {
        for c in library(&scales()) {
            assert!(!c.starts.is_empty(), "{} has no start", c.effect);
            for start in &c.starts {
                assert_eq!(start.len(), c.keys.len());
                for (x, k) in start.iter().zip(&c.keys) {
                    assert!(*x >= k.min && *x <= k.max, "{} {} = {x} outside [{}, {}]", c.effect, k.name, k.min, k.max);
                }
            }
        }
    }

    /// The weakest start of a strength beside the strongest one, or beside its range where all are alike.
    #[test]
    fn what_has_a_strength_starts_near_nothing_too() {
        for c in library(&scales()) {
            let kind = EffectKind::ALL.iter().find(|k| k.id() == c.effect).unwrap();
            for (k, key) in kind.keys().iter().enumerate() {
                let Role::Strength(nothing) = key.role else { continue };
                let strengths = c.starts.iter().map(|s| (s[k] - nothing).abs());
                let (least, most) = strengths.fold((f64::INFINITY, 0.0_f64), |(a, b), x| (a.min(x), b.max(x)));
                let range = (c.keys[k].max - nothing).abs().max((c.keys[k].min - nothing).abs());
                let strong = if most > least { most } else { range };
                assert!(least <= 3.0 * GENTLE * strong, "{} {}: {least} beside {strong}", c.effect, key.name);
            }
        }
    }

    #[test]
    fn a_limit_starts_just_below_the_peak_where_it_hardly_acts() {
        let limit = library(&scales()).into_iter().find(|c| c.effect == "torque_limit").unwrap();
        let peak = scales().actuators[0].peak;
        assert!(limit.starts.iter().any(|s| s[0] < peak && s[0] > 0.99 * peak), "{:?}", limit.starts);
    }

    #[test]
    fn a_delay_starts_in_whole_rows_as_far_as_its_range_goes() {
        let longest = |c: &Candidate| c.keys[0].max;
        let short = Scales { window_s: 0.03, ..scales() };
        for c in library(&scales()).iter().chain(&library(&short)).filter(|c| c.effect.ends_with("_delay")) {
            let whole = c.starts.iter().filter(|s| (s[0] / 0.0025).fract() == 0.0).count();
            assert!(whole >= 2 && c.starts.iter().all(|s| s[0] <= longest(c)), "{:?} of {}", c.starts, longest(c));
        }
    }

    #[test]
    fn two_encoders_on_a_joint_make_each_of_them_a_motor_encoder() {
        let mut two = scales();
        two.sensors.push(SensorScale { column: "load_rad".into(), ..two.sensors[0].clone() });
        let on_motor = |s: &Scales| library(s).iter().filter(|c| c.motor_sensor.is_some()).count();
        assert_eq!((on_motor(&scales()), on_motor(&two)), (0, 2));
    }

    #[test]
    fn load_is_tried_on_both_sides_of_a_driven_joint() {
        let sides = |driven: bool| {
            let mut scales = scales();
            scales.joints[0].driven = driven;
            library(&scales).iter().filter(|c| c.effect == "load_friction").map(|c| c.side).collect::<Vec<_>>()
        };
        assert_eq!(sides(true), [Side::Link, Side::Motor]);
        assert_eq!(sides(false), [Side::Link]);
        let of = |side| Candidate { side, ..candidate("load_friction", "q1", Vec::new(), Vec::new()) };
        let [link, motor] = [of(Side::Link), of(Side::Motor)];
        assert!(motor.looks_like(&link) && !link.looks_like(&link));
    }

    #[test]
    fn a_leg_that_turns_about_nothing_does_not_rub() {
        let mut walking = scales();
        walking.joints.push(JointScale { name: "inner".into(), borne: false, ..walking.joints[0].clone() });
        let at_leg = library(&walking).into_iter().filter(|c| c.at == "inner").map(|c| c.effect).collect::<Vec<_>>();
        assert!(!at_leg.iter().any(|e| e.ends_with("friction") || e.ends_with("drag") || *e == "presliding"));
        assert!(at_leg.contains(&"parallel_spring"));
    }

    #[test]
    fn lookalikes_are_mutual() {
        assert!(look_alike("actuator_lag", "transport_delay") && look_alike("transport_delay", "actuator_lag"));
        assert!(!look_alike("sensor_bias", "backlash"));
    }
}
