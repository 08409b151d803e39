//! Parameters of the compass gait with a bisecting body, and what they must satisfy. RT: yes.
//!
//! One set describes the robot; which leg is "leg 1" (the one that stands) is a matter of [`Params::swapped`].

use crate::base::scalar::Scalar;

/// The robot, leg 1 standing (the thesis' order of Table 4.1, section 2 of our notes: leg 1 = inner).
///
/// The c's are divided by `m_t l²` (inertias) or `m_t l` (moments), so they have no unit.
/// They determine the pinned, the floating and the impact equations of *both* stance legs: nothing else is needed.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params<S> {
    /// c1 to c6, see [`Links::params`] for their meaning.
    pub c: [S; 6],
    /// Leg length l from hip to toe, m, > 0.
    pub leg_length_m: S,
    /// Mass of the whole robot m_t, kg, > 0.
    pub total_mass_kg: S,
    /// Gravity, m/s².
    pub gravity_m_s2: S,
    /// Viscous friction of the hip, Nm s/rad.
    pub viscous_nm_s_rad: S,
    /// Coulomb friction of the hip, Nm.
    pub coulomb_nm: S,
}

/// Reflected rotor and spring of the hip drive (section 6 of the notes), at the joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Elasticity<S> {
    /// Spring between rotor and legs, Nm/rad.
    pub stiffness_nm_rad: S,
    /// Damper beside the spring, Nm s/rad.
    pub damping_nm_s_rad: S,
    /// Rotor inertia times the gear ratio squared, kg m².
    pub rotor_inertia_kg_m2: S,
    /// Viscous friction of the rotor, at the joint, Nm s/rad.
    pub rotor_damping_nm_s_rad: S,
}

impl Params<f64> {
    /// The thesis' identified set (Table 4.1, "SysID"), leg 1 read as the inner one.
    #[must_use]
    pub const fn sysid() -> Self {
        Self {
            c: [0.1007, 0.1434, 0.000_596, 0.1151, 0.1264, 0.0026],
            leg_length_m: 1.045,
            total_mass_kg: 15.2,
            gravity_m_s2: 9.81,
            // The table's .0418 and .1109 enter the same row as the torque, so they are normalised (section 2 of the
            // notes): .694 Nm s/rad and 1.841 Nm.
            viscous_nm_s_rad: 0.0418 * INERTIA_SYSID_KG_M2,
            coulomb_nm: 0.1109 * INERTIA_SYSID_KG_M2,
        }
    }

    /// The same numbers as constants of another scalar.
    #[must_use]
    pub fn lift<S: Scalar>(&self) -> Params<S> {
        Params {
            c: self.c.map(S::constant),
            leg_length_m: S::constant(self.leg_length_m),
            total_mass_kg: S::constant(self.total_mass_kg),
            gravity_m_s2: S::constant(self.gravity_m_s2),
            viscous_nm_s_rad: S::constant(self.viscous_nm_s_rad),
            coulomb_nm: S::constant(self.coulomb_nm),
        }
    }
}

const INERTIA_SYSID_KG_M2: f64 = 15.2 * 1.045 * 1.045;

impl<S: Scalar> Params<S> {
    /// The same robot standing on the other leg: c1 ↔ c2, c4 ↔ c5.
    #[must_use]
    pub fn swapped(&self) -> Self {
        let [c1, c2, c3, c4, c5, c6] = self.c;
        Self { c: [c2, c1, c3, c5, c4, c6], ..*self }
    }

    /// `m_t l²`, kg m²: torque in Nm and energy in J are this times the normalised ones.
    #[must_use]
    pub fn inertia_kg_m2(&self) -> S {
        self.total_mass_kg * self.leg_length_m * self.leg_length_m
    }

    /// `m_t l`, kg m: force in N is this times the normalised one.
    #[must_use]
    pub fn mass_moment_kg_m(&self) -> S {
        self.total_mass_kg * self.leg_length_m
    }

    /// `w² = g/l`, 1/s².
    #[must_use]
    pub fn w2(&self) -> S {
        self.gravity_m_s2 / self.leg_length_m
    }

    /// What the equations of motion use, divided by `m_t l²` once.
    #[must_use]
    pub fn normalised(&self) -> Normalised<S> {
        let unit = self.inertia_kg_m2();
        Normalised { c: self.c, w2: self.w2(), viscous: self.viscous_nm_s_rad / unit, coulomb: self.coulomb_nm / unit }
    }

    /// What is physically impossible in this set for a robot with links of masses `share` (of m_t, leg 1, leg 2, body)
    /// and no rotor inertia: section 2 of the notes. Each inertia must be at least that of its mass at its centre.
    #[must_use]
    pub fn inconsistencies(&self, share: [f64; 3]) -> [bool; 3] {
        let [c1, c2, c3, c4, c5, c6] = self.c.map(Scalar::value);
        [(c1 - c3) * share[0] < c4 * c4, (c2 - c3) * share[1] < c5 * c5, c3 * share[2] < 4.0 * c6 * c6]
    }

    /// Smallest shares of the total mass that links may have (leg 1, leg 2, body). No robot has this set when they
    /// add up to more than 1 or one of them is not a positive number.
    #[must_use]
    pub fn least_mass_shares(&self) -> [f64; 3] {
        let [c1, c2, c3, c4, c5, c6] = self.c.map(Scalar::value);
        [c4 * c4 / (c1 - c3), c5 * c5 / (c2 - c3), 4.0 * c6 * c6 / c3]
    }
}

impl<S: Scalar> Elasticity<S> {
    /// Divided by `m_t l²`.
    #[must_use]
    pub fn normalised(&self, inertia_kg_m2: S) -> Self {
        Self {
            stiffness_nm_rad: self.stiffness_nm_rad / inertia_kg_m2,
            damping_nm_s_rad: self.damping_nm_s_rad / inertia_kg_m2,
            rotor_inertia_kg_m2: self.rotor_inertia_kg_m2 / inertia_kg_m2,
            rotor_damping_nm_s_rad: self.rotor_damping_nm_s_rad / inertia_kg_m2,
        }
    }
}

/// Parameters divided by `m_t l²`, lengths by `l`; time stays in seconds.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Normalised<S> {
    /// c1 to c6, leg 1 standing.
    pub c: [S; 6],
    /// g/l, 1/s².
    pub w2: S,
    /// Viscous friction of the hip, s.
    pub viscous: S,
    /// Coulomb friction of the hip.
    pub coulomb: S,
}

impl<S: Scalar> Normalised<S> {
    /// Without friction, for example because a controller compensates it.
    #[must_use]
    pub fn frictionless(&self) -> Self {
        Self { viscous: S::zero(), coulomb: S::zero(), ..*self }
    }
}

/// One link as a draughtsman gives it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Link<S> {
    /// Mass, kg.
    pub mass_kg: S,
    /// Centre of mass, m from the hip: towards the toe for a leg, upwards for the body.
    pub centre_m: S,
    /// Inertia about the centre of mass, kg m².
    pub inertia_kg_m2: S,
}

/// The three links: leg 1 (stands), leg 2 (swings), body.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Links<S> {
    /// Leg 1, leg 2, body.
    pub links: [Link<S>; 3],
    /// Leg length, m.
    pub leg_length_m: S,
    /// Gravity, m/s².
    pub gravity_m_s2: S,
}

impl<S: Scalar> Links<S> {
    /// The dynamic parameters, without friction.
    ///
    /// Source: what the definitions of Thesis Table 4.1 must mean (section 2 of the notes); appendix A prints lc2
    /// with the other sign.
    #[must_use]
    pub fn params(&self) -> Params<S> {
        let [one, two, body] = self.links;
        let l = self.leg_length_m;
        let m_t = one.mass_kg + two.mass_kg + body.mass_kg;
        let (unit, moment) = (m_t * l * l, m_t * l);
        let about_hip = |k: Link<S>| k.inertia_kg_m2 + k.mass_kg * k.centre_m * k.centre_m;
        let c3 = about_hip(body) / (unit * 4.0);
        Params {
            c: [
                about_hip(one) / unit + c3,
                about_hip(two) / unit + c3,
                c3,
                one.mass_kg * one.centre_m / moment,
                two.mass_kg * two.centre_m / moment,
                body.mass_kg * body.centre_m / (moment * 4.0),
            ],
            leg_length_m: l,
            total_mass_kg: m_t,
            gravity_m_s2: self.gravity_m_s2,
            viscous_nm_s_rad: S::zero(),
            coulomb_nm: S::zero(),
        }
    }
}
