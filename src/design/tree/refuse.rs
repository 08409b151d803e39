//! A proof that a state is lost: whatever the torque within its limits, the stance leg falls beyond the longest step before
//! the swing foot can be where it would land. RT: no.
//!
//! All motions are enclosed in a box of `θs, θw, θ̇s, θ̇w` and `y = θs + θw` (zero when the foot of an equally long leg is
//! on the floor), step by step: over a step the box of states lies in a larger one that is shown to hold itself (Picard),
//! and the accelerations over that one, torque anywhere within its limits, bound the next box. `y` has bounds of its own,
//! because its acceleration is nearly the torque's alone, while `θs` hardly feels the torque.
//! If `0` is outside `y` as long as `θs` may be in the range of a foothold, and `θs` ends beyond all footholds where it counts
//! as fallen, then no motion steps before it has fallen. Rounding is not enclosed; it is 1e-12 of what the boxes leave.

use super::{Ground, State};
use crate::model::compass_gait::params::Normalised;
use crate::msg::Leg;

/// From lowest to highest.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Range(f64, f64);

impl Range {
    const fn of(x: f64) -> Self {
        Self(x, x)
    }
    fn scaled(self, s: f64) -> Self {
        if s >= 0.0 { Self(s * self.0, s * self.1) } else { Self(s * self.1, s * self.0) }
    }
    fn holds(self, other: Self) -> bool {
        self.0 <= other.0 && other.1 <= self.1
    }
    fn hull(self, other: Self) -> Self {
        Self(self.0.min(other.0), self.1.max(other.1))
    }
    fn wider(self, by: f64) -> Self {
        let room = by * (self.1 - self.0) + 1e-9;
        Self(self.0 - room, self.1 + room)
    }
    fn square(self) -> Self {
        let (a, b) = (self.0 * self.0, self.1 * self.1);
        Self(if self.0 <= 0.0 && self.1 >= 0.0 { 0.0 } else { a.min(b) }, a.max(b))
    }
    /// For angles within ±π/2, where the sine rises.
    fn sin(self) -> Self {
        Self(libm::sin(self.0), libm::sin(self.1))
    }
    /// For angles within ±π, where the cosine falls from zero outward.
    fn cos(self) -> Self {
        let (a, b) = (libm::cos(self.0), libm::cos(self.1));
        Self(a.min(b), if self.0 <= 0.0 && self.1 >= 0.0 { 1.0 } else { a.max(b) })
    }
}

impl std::ops::Add for Range {
    type Output = Self;
    fn add(self, o: Self) -> Self {
        Self(self.0 + o.0, self.1 + o.1)
    }
}

impl std::ops::Sub for Range {
    type Output = Self;
    fn sub(self, o: Self) -> Self {
        Self(self.0 - o.1, self.1 - o.0)
    }
}

impl std::ops::Mul for Range {
    type Output = Self;
    fn mul(self, o: Self) -> Self {
        let [a, b, c, d] = [self.0 * o.0, self.0 * o.1, self.1 * o.0, self.1 * o.1];
        Self(a.min(b).min(c.min(d)), a.max(b).max(c.max(d)))
    }
}

/// All states at a time, or over a time.
#[derive(Clone, Copy, Debug)]
struct Set {
    q: [Range; 2],
    v: [Range; 2],
    y: Range,
    y_rate: Range,
}

/// Accelerations of θs, θw and y.
type Pull = [Range; 3];

/// Step of the enclosure, s; and how long it is followed.
const STEP_S: f64 = 0.01;
const LONGEST_S: f64 = 1.5;
/// A stance leg that leans so far and falls on counts as fallen: a step of 600 mm needs 0.29 rad.
const LOST_RAD: f64 = 0.36;

/// No state of the robot: the swing foot is in the floor although its toe is drawn in.
#[must_use]
pub fn is_impossible(ground: &Ground, x: &State) -> bool {
    let drawn = ground.terms.toe.retract_m / ground.terms.robot.leg_length_m;
    libm::cos(x[0]) < (1.0 - drawn) * libm::cos(x[1])
}

/// The state is lost: no motion within the torque's limits steps or stands up. `false` proves nothing.
#[must_use]
pub fn is_lost(ground: &Ground, x: &State, stance: Leg) -> bool {
    // Which way it falls: the mirrored robot falls the other way.
    let x = if ground.fall(x, stance) > 0.0 { x.map(|x| -x) } else { *x };
    let [short, long] = ground.terms.step_m.map(|step| libm::asin(0.5 * step / ground.terms.robot.leg_length_m));
    let foothold = Range(-long, -short);
    let mut set = Set {
        q: [Range::of(x[0]), Range::of(x[1])],
        v: [Range::of(x[2]), Range::of(x[3])],
        y: Range::of(x[0] + x[1]),
        y_rate: Range::of(x[2] + x[3]),
    };
    let mut t = 0.0;
    while t < LONGEST_S {
        let Some(over) = enclose(ground, &set, stance) else { return false };
        let may_land = over.y.0 <= 0.0 && over.y.1 >= 0.0;
        let in_reach = over.q[0].1 >= foothold.0 && over.q[0].0 <= foothold.1;
        if may_land && in_reach {
            return false;
        }
        let pull = accelerations(ground, &over, stance);
        set = set.after(&pull);
        if set.q[0].1 < -LOST_RAD && set.v[0].1 < 0.0 {
            return true;
        }
        // Stance never near falling: no proof from here.
        if set.q[0].0 > 0.3 || set.q[1].0.abs().max(set.q[1].1.abs()) > 1.4 {
            return false;
        }
        t += STEP_S;
    }
    false
}

impl Set {
    /// After a step over which the accelerations were in `pull`.
    fn after(&self, pull: &Pull) -> Self {
        let h = STEP_S;
        let speed = |v: Range, a: Range| v + a.scaled(h);
        // x + h v + h²/2 a holds for any acceleration that stays in its range.
        let place = |q: Range, v: Range, a: Range| q + v.scaled(h) + a.scaled(0.5 * h * h);
        let mut out = Self {
            q: [place(self.q[0], self.v[0], pull[0]), place(self.q[1], self.v[1], pull[1])],
            v: [speed(self.v[0], pull[0]), speed(self.v[1], pull[1])],
            y: place(self.y, self.y_rate, pull[2]),
            y_rate: speed(self.y_rate, pull[2]),
        };
        out.tighten();
        out
    }

    /// Each of θs, θw and y follows from the other two, and their rates.
    fn tighten(&mut self) {
        self.y = meet(self.y, self.q[0] + self.q[1]);
        self.y_rate = meet(self.y_rate, self.v[0] + self.v[1]);
        self.q[1] = meet(self.q[1], self.y - self.q[0]);
        self.v[1] = meet(self.v[1], self.y_rate - self.v[0]);
    }
}

fn meet(a: Range, b: Range) -> Range {
    Range(a.0.max(b.0), a.1.min(b.1))
}

/// A set that holds all states over a step from `set`; `None` if none was found.
fn enclose(ground: &Ground, set: &Set, stance: Leg) -> Option<Set> {
    let whole = Range(0.0, STEP_S);
    let mut over = *set;
    for _ in 0..8 {
        let pull = accelerations(ground, &over, stance);
        let v = [set.v[0] + pull[0] * whole, set.v[1] + pull[1] * whole];
        let y_rate = set.y_rate + pull[2] * whole;
        let next = Set { q: [set.q[0] + v[0] * whole, set.q[1] + v[1] * whole], v, y: set.y + y_rate * whole, y_rate };
        let within = |a: &Set, b: &Set| {
            a.q[0].holds(b.q[0]) && a.q[1].holds(b.q[1]) && a.v[0].holds(b.v[0]) && a.v[1].holds(b.v[1])
        };
        if within(&over, &next) {
            return Some(Set { y: next.y, y_rate: next.y_rate, ..over });
        }
        over = Set {
            q: [next.q[0].hull(over.q[0]).wider(0.02), next.q[1].hull(over.q[1]).wider(0.02)],
            v: [next.v[0].hull(over.v[0]).wider(0.02), next.v[1].hull(over.v[1]).wider(0.02)],
            ..next
        };
        if over.q[0].0 < -1.5 || over.q[0].1 > 1.5 || over.q[1].0 < -1.5 || over.q[1].1 > 1.5 {
            return None;
        }
    }
    None
}

/// Accelerations over a set, torque anywhere within the motor's limit. The equations of `dynamics`, solved by Cramer's
/// rule with the terms gathered so that ranges do not cancel.
fn accelerations(ground: &Ground, set: &Set, stance: Leg) -> Pull {
    let p: &Normalised<f64> = ground.model(stance);
    let [c1, c2, c3, c4, c5, c6] = p.c;
    let hip = set.q[0] - set.q[1];
    let (cos, cos_half) = (hip.cos(), hip.scaled(0.5).cos());
    let (sin, sin_half) = (hip.sin_wide(), hip.scaled(0.5).sin());
    let h11 = Range::of(1.0 + c1 - 2.0 * c4) + cos_half.scaled(4.0 * c6);
    let h12 = Range::of(c3) - cos.scaled(c5) + cos_half.scaled(2.0 * c6);
    let h22 = Range::of(c2);
    let det = h11 * h22 - h12.square();
    let inverse = Range(1.0 / det.1, 1.0 / det.0);
    let [v0, v1] = set.v;
    let (body, swing) = (sin_half.scaled(c6), sin.scaled(c5));
    let coriolis =
        [body * (v1.scaled(2.0) - v0) * v0 + (body - swing) * v1.square(), (swing - body.scaled(2.0)) * v0.square()];
    let lean = (set.q[0] + set.q[1]).scaled(0.5).sin().scaled(2.0 * c6);
    let b = [
        coriolis[0] + (set.q[0].sin().scaled(c4 - 1.0) - lean).scaled(p.w2),
        coriolis[1] + (set.q[1].sin().scaled(c5) - lean).scaled(p.w2),
    ];
    let rate = v0 - v1;
    let drag = |r: f64| ground.terms.compensation * (p.viscous * r + p.coulomb * libm::tanh(100.0 * r));
    let most = ground.torque_limit();
    let torque = Range(-most - drag(rate.1), most - drag(rate.0));
    // Without compensation the friction is there all the same; a share of 1 is what the planner has.
    [
        ((h22 + h12) * torque - h22 * b[0] + h12 * b[1]) * inverse,
        (h12 * b[0] - h11 * b[1] - (h11 + h12) * torque) * inverse,
        ((h22 - h11) * torque + (h12 - h22) * b[0] + (h12 - h11) * b[1]) * inverse,
    ]
}

impl Range {
    /// For angles within ±π.
    fn sin_wide(self) -> Self {
        let half = std::f64::consts::FRAC_PI_2;
        let (a, b) = (libm::sin(self.0), libm::sin(self.1));
        let low = if self.0 <= -half && -half <= self.1 { -1.0 } else { a.min(b) };
        let high = if self.0 <= half && half <= self.1 { 1.0 } else { a.max(b) };
        Self(low, high)
    }
}
