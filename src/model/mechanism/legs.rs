//! The compass gait as a mechanism in SI: pinned, held, both legs as one, or with its stance toe free.
//!
//! The equations are those of [`crate::model::compass_gait`] with the parameters folded once (half the products);
//! `machine::tests` hold the two against each other and against the notes' numbers. RT: yes, no allocation.

use super::{Equations, MAX, Mechanism, Row};
use crate::base::scalar::Scalar;
use crate::model::compass_gait::kinematics::Trig;
use crate::model::compass_gait::params::Params;
use crate::model::rig::Setup;

/// How the compass gait's legs are free to move.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Freedom {
    /// Both legs about the pinned stance toe: coordinates inner, outer.
    Pinned,
    /// One leg held at 0, the other swings: its angle only.
    Held,
    /// Both legs as one.
    Together,
    /// Both legs and the stance toe: inner, outer, toe x and y in m (x along the ground, y normal to it).
    Floating,
}

/// The compass gait in SI, coordinates named by leg; which leg stands is a switch.
#[derive(Clone, Debug)]
pub struct Legs<S> {
    /// Inner leg standing, outer leg standing.
    folded: [Folded<S>; 2],
    /// Inertia of each leg about the hip without the body's share, kg m².
    inertia: [S; 2],
    /// `m_t`, l, g.
    mass: S,
    length: S,
    gravity: S,
    /// 0 inner, 1 outer.
    stance: usize,
    freedom: Freedom,
    /// Upward force at the hip, N.
    counterweight: S,
    /// Angle of the ground, + falls towards +x.
    slope: S,
    /// Its sine and cosine, if the ground is not level or that is to be differentiated.
    tilt: Option<(S, S)>,
}

/// Parameters of one stance folded into what the equations multiply by, SI.
#[derive(Clone, Debug)]
struct Folded<S> {
    /// `m_t l² (1 + c1 - 2 c4)`, `m_t l² c3`, `m_t l² c2`.
    inertia: [S; 3],
    /// `m_t l² c5`, `m_t l² c6`.
    swing: S,
    body: S,
    /// `m_t l² w² (c4 - 1) - F l`, `m_t l² w² c5`, `2 m_t l² w² c6`; F = counterweight.
    gravity: [S; 3],
    /// `m_t l (1 - c4)`, `m_t l c5`, `2 m_t l c6`: momentum per rate.
    momentum: [S; 3],
}

impl<S: Scalar> Folded<S> {
    fn new(p: &Params<S>, counterweight: S) -> Self {
        let [c1, c2, c3, c4, c5, c6] = p.c;
        let (unit, moment) = (p.inertia_kg_m2(), p.mass_moment_kg_m());
        let weight = moment * p.gravity_m_s2;
        Self {
            inertia: [unit * (c1 - c4 * 2.0 + 1.0), unit * c3, unit * c2],
            swing: unit * c5,
            body: unit * c6,
            // The hip is at l (-sin θs, cos θs) from the stance toe: a force upward turns the stance leg by -F l sin θs.
            gravity: [weight * (c4 - 1.0) + counterweight * p.leg_length_m, weight * c5, weight * c6 * 2.0],
            momentum: [moment * (-c4 + 1.0), moment * c5, moment * c6 * 2.0],
        }
    }
}

impl<S: Scalar> Legs<S> {
    /// From the parameters in the order of the rig.
    #[must_use]
    pub fn new(parameters: &[S], setup: Setup, floats: bool, counterweight: S, slope: S) -> Option<Self> {
        let [length, mass, gravity, c1, c2, c3, c4, c5, c6] = *parameters else { return None };
        let params = Params {
            c: [c1, c2, c3, c4, c5, c6],
            leg_length_m: length,
            total_mass_kg: mass,
            gravity_m_s2: gravity,
            viscous_nm_s_rad: S::zero(),
            coulomb_nm: S::zero(),
        };
        let stance = usize::from(matches!(setup, Setup::OuterStance | Setup::OuterFixed));
        let freedom = match setup {
            Setup::InnerFixed | Setup::OuterFixed => Freedom::Held,
            Setup::Parallel => Freedom::Together,
            _ if floats => Freedom::Floating,
            _ => Freedom::Pinned,
        };
        let unit = params.inertia_kg_m2();
        Some(Self {
            folded: [Folded::new(&params, counterweight), Folded::new(&params.swapped(), counterweight)],
            inertia: [(c1 - c3) * unit, (c2 - c3) * unit],
            mass,
            length,
            gravity,
            stance,
            freedom,
            counterweight,
            slope,
            tilt: (slope.value() != 0.0 || slope.is_varied()).then(|| slope.sin_cos()),
        })
    }

    /// The standing leg, 0 inner, 1 outer.
    #[must_use]
    pub const fn stance(&self) -> usize {
        self.stance
    }
    /// Puts the robot on the other leg, or back.
    pub const fn set_stance(&mut self, leg: usize) {
        self.stance = if leg == 0 { 0 } else { 1 };
    }
    /// How it is free to move.
    #[must_use]
    pub const fn freedom(&self) -> Freedom {
        self.freedom
    }
    /// Leg length, m.
    #[must_use]
    pub const fn length(&self) -> S {
        self.length
    }
    /// Total mass, kg.
    #[must_use]
    pub const fn mass(&self) -> S {
        self.mass
    }
    /// Gravity, m/s².
    #[must_use]
    pub const fn gravity(&self) -> S {
        self.gravity
    }
    /// Angle of the ground.
    #[must_use]
    pub const fn slope(&self) -> S {
        self.slope
    }

    /// Mass matrix and -(C q̇ + G), stance leg first, with the counterweight's pull at the hip: Thesis (4.1)-(4.6)
    /// as in [`crate::model::compass_gait::dynamics`], parameters folded.
    #[inline]
    fn pinned(&self, qs: S, qw: S, vs: S, vw: S) -> ([S; 3], [S; 2], Trig<S>) {
        let p = &self.folded[self.stance];
        let t = Trig::new([qs, qw]);
        let body_cos = p.body * t.half.1 * 2.0;
        let mass = [p.inertia[0] + body_cos * 2.0, p.inertia[1] - p.swing * t.sigma.1 + body_cos, p.inertia[2]];
        let (body, swing) = (p.body * t.half.0, p.swing * t.sigma.0);
        let (vs2, weight) = (vs * vs, p.gravity[2] * t.body.0);
        let stance = body * (vs * vw * 2.0 - vs2) + (body - swing) * (vw * vw) + p.gravity[0] * t.stance.0 - weight;
        let swung = (swing - body * 2.0) * vs2 + p.gravity[1] * t.swing.0 - weight;
        (mass, [-stance, -swung], t)
    }

    /// Rows and columns of the toe, in axes along and normal to the ground: sections 3 of the notes.
    fn add_toe(&self, t: &Trig<S>, v: [S; 2], out: &mut Equations<S>) {
        let p = &self.folded[self.stance];
        // (x along the falling ground, y normal): unit vectors (cos α, -sin α), (sin α, cos α).
        let turn = |x: S, y: S| match self.tilt {
            None => [x, y],
            Some((sa, ca)) => [x * ca - y * sa, x * sa + y * ca],
        };
        let [above, swing, body] = p.momentum;
        let (sb, cb) = (body * t.body.0, body * t.body.1);
        let (vs2, vw2) = (above * v[0].square(), swing * v[1].square());
        let vb2 = (v[0] + v[1]).square() * 0.5;
        let pull = [vs2 * t.stance.0 - vw2 * t.swing.0 + sb * vb2, -(vs2 * t.stance.1) + vw2 * t.swing.1 - cb * vb2];
        let force = turn(-pull[0], self.counterweight - self.mass * self.gravity - pull[1]);
        let (s, w) = (self.stance, 1 - self.stance);
        let js = turn(-(above * t.stance.1) - cb, -(above * t.stance.0) - sb);
        let jw = turn(swing * t.swing.1 - cb, swing * t.swing.0 - sb);
        for k in 0..2 {
            out.mass[s][2 + k] = js[k];
            out.mass[2 + k][s] = js[k];
            out.mass[w][2 + k] = jw[k];
            out.mass[2 + k][w] = jw[k];
            out.force[2 + k] = force[k];
        }
        out.mass[2][2] = self.mass;
        out.mass[3][3] = self.mass;
        out.mass[2][3] = S::zero();
        out.mass[3][2] = S::zero();
    }

    /// Equations of the two legs about a stance toe that does not move; those of the toe are left as they are.
    #[inline]
    pub fn leg_equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        let (s, w) = (self.stance, 1 - self.stance);
        let (mass, force, _) = self.pinned(q[s], q[w], v[s], v[w]);
        self.put_legs(mass, force, out);
    }

    #[inline]
    fn put_legs(&self, mass: [S; 3], force: [S; 2], out: &mut Equations<S>) {
        let (s, w) = (self.stance, 1 - self.stance);
        out.mass[s][s] = mass[0];
        out.mass[s][w] = mass[1];
        out.mass[w][s] = mass[1];
        out.mass[w][w] = mass[2];
        out.force[s] = force[0];
        out.force[w] = force[1];
    }
}

impl<S: Scalar> Mechanism<S> for Legs<S> {
    fn dof(&self) -> usize {
        match self.freedom {
            Freedom::Held | Freedom::Together => 1,
            Freedom::Pinned => 2,
            Freedom::Floating => 4,
        }
    }
    fn row(&self, joint: usize) -> Row {
        match (self.freedom, joint) {
            (Freedom::Together, 0 | 1) => Row::one(0, 1.0),
            (Freedom::Together, _) => Row::NONE,
            // The held leg is the "standing" one.
            (Freedom::Held, 0 | 1) if joint == self.stance => Row::NONE,
            (Freedom::Held, 0 | 1) => Row::one(0, 1.0),
            (Freedom::Held, _) => Row::one(0, if self.stance == 1 { 1.0 } else { -1.0 }),
            (_, 0 | 1) => Row::one(joint, 1.0),
            _ => Row::two(0, 1.0, 1, -1.0),
        }
    }
    fn link_inertia(&self, joint: usize) -> S {
        self.inertia[if joint == 1 { 1 } else { 0 }]
    }
    fn held_torque(&self, joint: usize, force: &[S; MAX]) -> S {
        match (self.freedom, joint) {
            (Freedom::Held, _) => self.row(joint).of(&{
                let mut f = [S::zero(); MAX];
                f[0] = -force[0];
                f
            }),
            (Freedom::Together, _) => S::zero(),
            // The hip holds up the swing leg.
            _ if self.stance == 0 => force[1],
            _ => -force[0],
        }
    }
    #[inline]
    fn equations(&self, q: &[S; MAX], v: &[S; MAX], out: &mut Equations<S>) {
        let (s, w) = (self.stance, 1 - self.stance);
        match self.freedom {
            Freedom::Held => {
                let (mass, force, _) = self.pinned(S::zero(), q[0], S::zero(), v[0]);
                out.mass[0][0] = mass[2];
                out.force[0] = force[1];
            }
            Freedom::Together => {
                let (mass, force, _) = self.pinned(q[0], q[0], v[0], v[0]);
                out.mass[0][0] = mass[0] + mass[1] * 2.0 + mass[2];
                out.force[0] = force[0] + force[1];
            }
            Freedom::Pinned => self.leg_equations(q, v, out),
            Freedom::Floating => {
                let (mass, force, t) = self.pinned(q[s], q[w], v[s], v[w]);
                self.put_legs(mass, force, out);
                self.add_toe(&t, [v[s], v[w]], out);
                let (sin, cos) = t.stance;
                out.stance = match self.tilt {
                    None => t.stance,
                    Some((sa, ca)) => (sin * ca + cos * sa, cos * ca - sin * sa),
                };
            }
        }
    }
}
