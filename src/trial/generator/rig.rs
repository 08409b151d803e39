//! A drawn rig: what is published about the machine, and how published values become the generator's own bodies. RT: no.

use std::collections::BTreeMap;

use super::chain::{Body, Pair};
use super::dice::Dice;
use super::machine::{Joint, Machine};
use super::walker::Ground;

/// The machines that trials are made of.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    /// A link that hangs.
    Pendulum,
    /// A rotor without gravity.
    Rotor,
    /// A cart.
    Slider,
    /// Two links.
    Double,
    /// Two legs, one pinned toe, a spring that holds the stance leg up.
    Biped,
    /// The same, walking.
    Walker,
}

/// What a sensor reads.
#[derive(Debug, Clone)]
pub(super) struct Sensor {
    /// Name in the rig file.
    pub measures: &'static str,
    /// Column.
    pub column: &'static str,
    /// `row · q`, or `row · v` for a rate.
    pub row: Pair,
    /// Reads the rate.
    pub is_rate: bool,
    /// Standard deviation of its noise.
    pub noise: f64,
    /// Grid of its readings; 0: none.
    pub quantum: f64,
}

/// A rig with its true values.
#[derive(Debug, Clone)]
pub(super) struct Rig {
    /// Machine.
    pub kind: Kind,
    /// Parameters of the mechanism and of the base effects (`viscous@q1`), true values.
    pub values: BTreeMap<String, f64>,
    /// Those that are published with bounds.
    pub uncertain: Vec<String>,
    /// Joint names, with column and gain.
    pub joints: Vec<(&'static str, &'static str, f64)>,
    /// Sensors.
    pub sensors: Vec<Sensor>,
    /// Spring of the set-up: stiffness, rest.
    pub spring: Pair,
    /// Free runs restart this often, s.
    pub window_s: f64,
    /// Of the compass gait.
    pub setup: &'static str,
}

impl Kind {
    /// Name of the contract.
    pub(super) fn mechanism(self) -> &'static str {
        match self {
            Self::Pendulum | Self::Rotor => "pendulum",
            Self::Slider => "slider",
            Self::Double => "double_pendulum",
            Self::Biped | Self::Walker => "compass_gait",
        }
    }
}

/// Draws a rig.
pub(super) fn draw(dice: &mut Dice, kind: Kind) -> Rig {
    let mut rig = match kind {
        Kind::Pendulum | Kind::Rotor => pendulum(dice, kind),
        Kind::Slider => slider(dice),
        Kind::Double => double(dice),
        Kind::Biped => biped(dice),
        Kind::Walker => walker(dice),
    };
    rig.uncertain.sort();
    let tells_grid = dice.chance(0.5);
    for sensor in &mut rig.sensors {
        sensor.noise *= dice.log_between(0.5, 2.0);
        sensor.quantum = if tells_grid && !sensor.is_rate { 1.5 * sensor.noise } else { 0.0 };
    }
    rig
}

fn named(pairs: &[(&str, f64)]) -> BTreeMap<String, f64> {
    pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect()
}

fn names(of: &[&str]) -> Vec<String> {
    of.iter().map(|name| (*name).to_owned()).collect()
}

fn sensor(measures: &'static str, column: &'static str, row: Pair, noise: f64) -> Sensor {
    Sensor { measures, column, row, is_rate: measures.ends_with("_rate"), noise, quantum: 0.0 }
}

/// A machine of one driven joint.
fn one_joint(
    kind: Kind,
    values: BTreeMap<String, f64>,
    uncertain: Vec<String>,
    (input, gain): (&'static str, f64),
    sensors: Vec<Sensor>,
) -> Rig {
    let joints = vec![("q1", input, gain)];
    Rig { kind, values, uncertain, joints, sensors, spring: [0.0; 2], window_s: 2.0, setup: "" }
}

fn pendulum(dice: &mut Dice, kind: Kind) -> Rig {
    let inertia = dice.log_between(0.004, 0.05);
    let gravity = if kind == Kind::Rotor { 0.0 } else { inertia * dice.between(25.0, 80.0) };
    let torque = inertia * 50.0;
    let mut values =
        named(&[("inertia_kg_m2", inertia), ("gravity_nm", gravity), ("viscous@q1", inertia * dice.between(0.3, 1.2))]);
    if dice.chance(0.6) {
        values.insert("coulomb@q1".to_owned(), torque * dice.between(0.03, 0.09));
    }
    let mut uncertain: Vec<String> = values.keys().cloned().collect();
    uncertain.retain(|name| kind == Kind::Pendulum || name != "gravity_nm");
    let mut sensors = vec![sensor("q1", "q1_rad", [1.0, 0.0], 0.001)];
    if dice.chance(0.5) {
        sensors.push(sensor("q1_rate", "q1_rad_s", [1.0, 0.0], 0.04));
    }
    let gain = torque * dice.log_between(0.02, 2.0);
    one_joint(kind, values, uncertain, ("u_v", gain), sensors)
}

fn slider(dice: &mut Dice) -> Rig {
    let mass = dice.log_between(0.5, 5.0);
    let mut values = named(&[("mass_kg", mass), ("viscous@q1", mass * dice.between(0.6, 2.0))]);
    if dice.chance(0.6) {
        values.insert("coulomb@q1".to_owned(), mass * dice.between(0.2, 0.6));
    }
    let uncertain = values.keys().cloned().collect();
    let gain = mass * dice.log_between(0.2, 5.0);
    let sensors = vec![sensor("q1", "x_m", [1.0, 0.0], 0.000_2)];
    one_joint(Kind::Slider, values, uncertain, ("u_f", gain), sensors)
}

fn double(dice: &mut Dice) -> Rig {
    let (length1, mass1, mass2) = (dice.between(0.2, 0.35), dice.between(0.4, 0.9), dice.between(0.4, 0.8));
    let (centre1, centre2) = (length1 * dice.between(0.5, 0.9), dice.between(0.1, 0.2));
    let inertia1 = mass1 * centre1 * centre1 * dice.between(1.1, 1.4);
    let inertia2 = mass2 * centre2 * centre2 * dice.between(1.1, 1.4);
    let values = named(&[
        ("inertia1_kg_m2", inertia1),
        ("inertia2_kg_m2", inertia2),
        ("moment1_kg_m", mass1 * centre1),
        ("moment2_kg_m", mass2 * centre2),
        ("mass2_kg", mass2),
        ("length1_m", length1),
        ("gravity_m_s2", 9.81),
        ("viscous@q1", dice.between(0.004, 0.02)),
        ("viscous@q2", dice.between(0.002, 0.01)),
        ("coulomb@q1", dice.between(0.03, 0.1)),
        ("coulomb@q2", dice.between(0.02, 0.06)),
    ]);
    let uncertain = names(&[
        "inertia1_kg_m2",
        "inertia2_kg_m2",
        "moment1_kg_m",
        "moment2_kg_m",
        "viscous@q1",
        "viscous@q2",
        "coulomb@q1",
        "coulomb@q2",
    ]);
    let joints = vec![("q1", "u_a1", dice.log_between(0.2, 3.0)), ("q2", "u_a2", dice.log_between(0.2, 3.0))];
    let sensors = vec![sensor("q1", "q1_rad", [1.0, 0.0], 0.000_8), sensor("q2", "q2_rad", [0.0, 1.0], 0.000_8)];
    Rig { kind: Kind::Double, values, uncertain, joints, sensors, spring: [0.0; 2], window_s: 1.2, setup: "" }
}

/// Values of the robot of the thesis, a few per cent off.
fn robot(dice: &mut Dice, coulomb: f64) -> BTreeMap<String, f64> {
    let mut near = |value: f64| value * dice.between(0.96, 1.04);
    named(&[
        ("leg_length_m", 1.045),
        ("total_mass_kg", 15.2),
        ("gravity_m_s2", 9.81),
        ("c1", near(0.1007)),
        ("c2", near(0.1434)),
        ("c3", near(0.000_596)),
        ("c4", near(0.1151)),
        ("c5", near(0.1264)),
        ("c6", near(0.0026)),
        ("viscous@hip", near(0.75)),
        ("coulomb@hip", near(coulomb)),
    ])
}

/// One toe pinned, the stance leg held up by the spring of its set-up.
fn biped(dice: &mut Dice) -> Rig {
    let values = robot(dice, 0.5);
    let uncertain = names(&["c1", "c2", "c4", "c5", "viscous@hip", "coulomb@hip"]);
    let inner = dice.chance(0.6);
    let (setup, imu) = if inner {
        ("inner_stance", sensor("inner", "imu_inner_rad", [1.0, 0.0], 0.001))
    } else {
        ("outer_stance", sensor("outer", "imu_outer_rad", [0.0, 1.0], 0.001))
    };
    let sensors = vec![imu, sensor("hip", "hip_rad", [1.0, -1.0], 0.000_2)];
    let spring = [dice.between(205.0, 230.0), dice.between(-0.02, 0.02)];
    let joints = vec![("hip", "u_a", dice.log_between(0.5, 4.0))];
    Rig { kind: Kind::Biped, values, uncertain, joints, sensors, spring, window_s: 2.0, setup }
}

/// Free on the ground.
fn walker(dice: &mut Dice) -> Rig {
    let level = dice.between(0.15, 0.5);
    let values = robot(dice, level);
    let uncertain = names(&["c2", "c5", "viscous@hip", "coulomb@hip"]);
    let sensors =
        vec![sensor("inner", "imu_inner_rad", [1.0, 0.0], 0.001), sensor("hip", "hip_rad", [1.0, -1.0], 0.000_5)];
    let joints = vec![("hip", "u_hip", dice.log_between(0.5, 4.0))];
    Rig { kind: Kind::Walker, values, uncertain, joints, sensors, spring: [0.0; 2], window_s: 0.8, setup: "walk" }
}

impl Rig {
    fn value(&self, name: &str) -> f64 {
        self.values.get(name).copied().unwrap_or(0.0)
    }

    /// The healthy machine of these values. `rotor` is the part of the inertia that sits on the motor side of joint 1.
    pub(super) fn machine(&self, rotor: f64) -> Machine {
        let mut machine = match self.kind {
            Kind::Pendulum | Kind::Rotor => self.pendulum_machine(rotor),
            Kind::Slider => self.slider_machine(rotor),
            Kind::Double => self.double_machine(),
            Kind::Biped => self.biped_machine(rotor),
            Kind::Walker => self.walking_machine(),
        };
        let along: [Pair; 2] = if self.is_legged() { [[1.0, -1.0]; 2] } else { [[1.0, 0.0], [0.0, 1.0]] };
        for (i, (name, _, gain)) in self.joints.iter().enumerate() {
            machine.joints.push(Joint {
                along: along[i],
                gain: *gain,
                viscous: self.value(&format!("viscous@{name}")),
                coulomb: self.value(&format!("coulomb@{name}")),
                ..Joint::default()
            });
        }
        if let Some(joint) = machine.joints.first_mut() {
            joint.drive.rotor = rotor;
        }
        machine
    }

    fn pendulum_machine(&self, rotor: f64) -> Machine {
        let (inertia, moment) = (self.value("inertia_kg_m2") - rotor, self.value("gravity_nm") / 9.81);
        // Any mass will do: only inertia and moment act. A tenth of a metre of arm.
        let (arm, mass) = (0.1, moment / 0.1);
        let body = Body {
            mass,
            inertia: inertia - mass * arm * arm,
            arms: vec![(-arm, [1.0, 0.0])],
            turn: [1.0, 0.0],
            slides: false,
        };
        Machine { bodies: vec![body], size: 1, gravity_m_s2: 9.81, ..Machine::default() }
    }

    fn slider_machine(&self, rotor: f64) -> Machine {
        let body = Body { mass: self.value("mass_kg") - rotor, slides: true, ..Body::default() };
        Machine { bodies: vec![body], size: 1, ..Machine::default() }
    }

    fn double_machine(&self) -> Machine {
        let (mass2, length1) = (self.value("mass2_kg"), self.value("length1_m"));
        let centre2 = self.value("moment2_kg_m") / mass2;
        let centre1 = 0.2;
        let mass1 = self.value("moment1_kg_m") / centre1;
        let first = Body {
            mass: mass1,
            inertia: self.value("inertia1_kg_m2") - mass1 * centre1 * centre1,
            arms: vec![(-centre1, [1.0, 0.0])],
            turn: [1.0, 0.0],
            slides: false,
        };
        let second = Body {
            mass: mass2,
            inertia: self.value("inertia2_kg_m2") - mass2 * centre2 * centre2,
            arms: vec![(-length1, [1.0, 0.0]), (-centre2, [1.0, 1.0])],
            turn: [1.0, 1.0],
            slides: false,
        };
        Machine { bodies: vec![first, second], size: 2, gravity_m_s2: 9.81, ..Machine::default() }
    }

    /// Is it the compass gait?
    pub(super) fn is_legged(&self) -> bool {
        matches!(self.kind, Kind::Biped | Kind::Walker)
    }

    /// Leg that stands at first: 0 inner, 1 outer.
    pub(super) fn stance(&self) -> usize {
        usize::from(self.setup == "outer_stance")
    }

    fn biped_machine(&self, rotor: f64) -> Machine {
        let stance = self.stance();
        Machine {
            bodies: self.legs(rotor, stance),
            size: 2,
            gravity_m_s2: self.value("gravity_m_s2"),
            setup_springs: vec![(stance, self.spring[0], self.spring[1])],
            lifted: Some((stance, 0.0)),
            ..Machine::default()
        }
    }

    fn walking_machine(&self) -> Machine {
        let ground = Ground { outer: self.legs(0.0, 1), length_m: self.value("leg_length_m"), ..Ground::default() };
        Machine {
            bodies: self.legs(0.0, 0),
            size: 2,
            gravity_m_s2: self.value("gravity_m_s2"),
            ground: Some(ground),
            ..Machine::default()
        }
    }

    /// Three bodies that have these c1..c6 (model notes, section 2); how the mass is shared does not matter. The rotor
    /// adds to c1, c2 and takes from c3. `stance`: the leg whose toe is the origin.
    fn legs(&self, rotor: f64, stance: usize) -> Vec<Body> {
        let (l, total) = (self.value("leg_length_m"), self.value("total_mass_kg"));
        let unit = total * l * l;
        let jr = rotor / unit;
        let c3 = self.value("c3") + jr;
        let row = |leg: usize| if leg == 0 { [1.0, 0.0] } else { [0.0, 1.0] };
        let leg = |leg: usize, c: f64, moment: f64| {
            let mass = 0.3 * total;
            let centre = moment * total * l / mass;
            // The stance leg's hip end is at l, its mass below it; the other hangs from there.
            let arms = vec![(l, row(stance)), (-centre, row(leg))];
            Body { mass, inertia: (c - jr - c3) * unit - mass * centre * centre, arms, turn: row(leg), slides: false }
        };
        let mass3 = 0.4 * total;
        let centre3 = 4.0 * self.value("c6") * total * l / mass3;
        let body = Body {
            mass: mass3,
            inertia: 4.0 * c3 * unit - mass3 * centre3 * centre3,
            arms: vec![(l, row(stance)), (centre3, [0.5, 0.5])],
            turn: [0.5, 0.5],
            slides: false,
        };
        vec![leg(0, self.value("c1"), self.value("c4")), leg(1, self.value("c2"), self.value("c5")), body]
    }
}

#[cfg(test)]
mod tests {
    use super::super::chain::{equations, solve};
    use super::*;

    #[test]
    fn biped_meets_the_reference_accelerations_of_the_notes() {
        let mut rig = draw(&mut Dice::new(1, 1), Kind::Biped);
        rig.setup = "inner_stance";
        let set = [("c1", 0.1007), ("c2", 0.1434), ("c3", 0.000_596), ("c4", 0.1151), ("c5", 0.1264), ("c6", 0.0026)];
        rig.values.extend(named(&set));
        for rotor in [0.0, 0.09] {
            let machine = rig.machine(rotor);
            let sum = equations(&machine.bodies, [0.1, -0.2], [0.5, -1.0], 9.81, 0.0);
            let mut mass = sum.mass;
            for (i, j, sign) in [(0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0), (1, 0, -1.0)] {
                mass[i][j] += rotor * sign;
            }
            let acceleration = solve(mass, [5.0 - sum.bias[0], -5.0 - sum.bias[1]], [false, false]);
            // Model notes, section 10, inner stance, 5 Nm.
            assert!((acceleration[0] - 1.399_743_661_5).abs() < 1e-8, "{acceleration:?}");
            assert!((acceleration[1] - 0.585_229_355_3).abs() < 1e-8, "{acceleration:?}");
        }
    }
}
