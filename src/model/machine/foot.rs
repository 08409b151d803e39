//! The feet as geometry: where they are, what holds the stance foot, when the swing foot may touch down.
//!
//! Coordinates as in [`super::contact`]. RT: yes, no allocation.

use super::contact::Contact;
use super::hold::{Holder, product};
use super::motion::{Phase, Plant, Work};
use crate::base::scalar::Scalar;
use crate::model::compass_gait::kinematics::Trig;
use crate::model::mechanism::{Body, Legs, MAX};

/// First of the two generalised coordinates of the stance toe.
pub(super) const TOE: usize = 2;
/// Feet closer than this, in leg lengths, do not touch down by themselves: a leg passes the other.
pub(super) const APART: f64 = 0.08;
/// Slack of the friction cone, N.
const ROUNDING: f64 = 1e-9;

/// Velocity rows of a foot, `contact velocity = row · v`, and what the rates add to its acceleration: along and normal to a
/// floor that rises by `rise` from the mean ground.
pub(super) struct FootRows<S> {
    pub(super) tangent: [S; MAX],
    pub(super) normal: [S; MAX],
    pub(super) bias: [S; 2],
    pub(super) rise: f64,
}

impl<S: Scalar> FootRows<S> {
    /// Of the mean ground: along and normal to a floor that rises by `rise` from it.
    pub(super) fn on_slope(mut self, n: usize, rise: f64) -> Self {
        if rise.abs() > 0.0 {
            for i in 0..n {
                [self.tangent[i], self.normal[i]] = on_slope([self.tangent[i], self.normal[i]], rise);
            }
            self.bias = on_slope(self.bias, rise);
            self.rise = rise;
        }
        self
    }
}

/// What lies along and normal to the mean ground, along and normal to a floor that rises by `rise` from it.
pub(super) fn on_slope<S: Scalar>([along, normal]: [S; 2], rise: f64) -> [S; 2] {
    if rise.abs() <= 0.0 {
        return [along, normal];
    }
    let long = libm::sqrt(1.0 + rise * rise);
    [(along + normal * rise) * (1.0 / long), (normal - along * rise) * (1.0 / long)]
}

/// A sprung toe moves along the leg only: its speed across leg number `s`, the toe `along` it from its tip.
fn sprung_row<S: Scalar>(s: usize, along: S, (sin, cos): (S, S)) -> [S; MAX] {
    let mut row = [S::zero(); MAX];
    row[TOE] = cos;
    row[TOE + 1] = sin;
    row[s] = along;
    row
}

impl<S: Scalar> Plant<S> {
    pub(super) fn legs(&self) -> Option<&Legs<S>> {
        match &self.body {
            Body::Legs(legs) if self.walks => Some(legs),
            _ => None,
        }
    }

    /// Sine and cosine of the stance leg's and the swing leg's angle to the ground's normal, from two evaluations.
    #[inline]
    fn directions(&self, y: &Phase<S>, legs: &Legs<S>) -> [(S, S); 2] {
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let t = Trig::new([y.q[s] + legs.slope(), y.q[w] + legs.slope()]);
        [t.stance, t.swing]
    }

    /// Rows of the foot of `leg`, 0 stance, 1 swing (by role), along and normal to the profile under it.
    pub(super) fn foot_rows(&self, y: &Phase<S>, swing: bool) -> Option<FootRows<S>> {
        let legs = self.legs()?;
        Some(self.foot_rows_along(y, swing, legs, &self.directions(y, legs)))
    }

    /// The same along and normal to the mean ground.
    pub(super) fn level_foot_rows(&self, y: &Phase<S>, swing: bool) -> Option<FootRows<S>> {
        let legs = self.legs()?;
        Some(self.level_foot_rows_along(y, swing, legs, &self.directions(y, legs)))
    }

    fn foot_rows_along(&self, y: &Phase<S>, swing: bool, legs: &Legs<S>, directions: &[(S, S); 2]) -> FootRows<S> {
        let rows = self.level_foot_rows_along(y, swing, legs, directions);
        let stands = !swing && self.feet.contact != Contact::Flight;
        let leg = if swing { 1 - legs.stance() } else { legs.stance() };
        rows.on_slope(self.n, if stands { self.feet.rise } else { self.profile_rise(y, leg) })
    }

    fn level_foot_rows_along(
        &self,
        y: &Phase<S>,
        swing: bool,
        legs: &Legs<S>,
        directions: &[(S, S); 2],
    ) -> FootRows<S> {
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let mut rows =
            FootRows { tangent: [S::zero(); MAX], normal: [S::zero(); MAX], bias: [S::zero(); 2], rise: 0.0 };
        rows.tangent[2] = S::one();
        rows.normal[3] = S::one();
        let l = legs.length();
        if swing {
            let [(ss, cs), (sw, cw)] = *directions;
            rows.tangent[s] = -(l * cs);
            rows.tangent[w] = l * cw;
            rows.normal[s] = -(l * ss);
            rows.normal[w] = l * sw;
        }
        let leg = if swing { w } else { s };
        // A rolling arc: its contact point moves with the toe and turns about the arc's centre. A short toe: so too,
        // but it does not roll.
        let (radius, short) = (self.ground.radius.unwrap_or_default(), self.short(y, leg));
        let reach = radius + short;
        if self.ground.radius.is_some() || self.feet.toes.is_some() {
            let (sin, cos) = directions[usize::from(swing)];
            let rate = y.v[leg];
            rows.tangent[leg] -= reach * cos - radius;
            rows.normal[leg] -= reach * sin;
            rows.bias = [reach * sin * rate * rate, -(reach * cos * rate * rate)];
            if let Some(toes) = self.feet.toes {
                // The foot is `short` up the leg: its speed along the leg, d = (-sin, cos), and twice that across it.
                (rows.tangent[toes + leg], rows.normal[toes + leg]) = (-sin, cos);
                let twice = y.v[toes + leg] * rate * 2.0;
                rows.bias[0] -= twice * cos;
                rows.bias[1] -= twice * sin;
            }
        }
        rows
    }

    /// Height of the swing foot above the ground, m.
    pub(super) fn swing_height(&self, y: &Phase<S>) -> Option<S> {
        let legs = self.legs()?;
        Some(self.swing_height_along(y, legs, &self.directions(y, legs)))
    }

    fn swing_height_along(&self, y: &Phase<S>, legs: &Legs<S>, [(ss, cs), (sw, cw)]: &[(S, S); 2]) -> S {
        let short = self.short(y, 1 - legs.stance());
        let mut height = y.q[3] + legs.length() * (*cs - *cw);
        if let Some(radius) = self.ground.radius {
            height += radius * (*cw - 1.0);
        }
        height += short * *cw + self.feet.sunk_m;
        match &self.ground.floor {
            None => height,
            Some(floor) => {
                let place = y.q[2] + legs.length() * (*sw - *ss) - short * *sw;
                height - floor.height_m(place.value())
            }
        }
    }

    /// Swing toe ahead of the stance toe, m along the ground.
    pub(super) fn stride(&self, y: &Phase<S>) -> Option<S> {
        let legs = self.legs()?;
        let [(ss, _), (sw, _)] = self.directions(y, legs);
        Some(legs.length() * (sw - ss))
    }

    /// Height of the swing foot if it may touch down now.
    pub(super) fn touchdown_guard(&self, y: &Phase<S>) -> Option<f64> {
        let legs = self.legs()?;
        if self.feet.second.is_some() {
            return None;
        }
        if self.feet.told {
            self.feet.due.filter(|leg| *leg != legs.stance())?;
            return self.swing_height(y).map(Scalar::value);
        }
        let directions = self.directions(y, legs);
        let stride = legs.length().value() * (directions[1].0 - directions[0].0).value();
        if stride.abs() < APART * legs.length().value() || stride * self.feet.side > 0.0 {
            return None;
        }
        // A foot that scuffed in mid-swing comes up again: the toe is retracted, nothing happens.
        let rises = product(&self.foot_rows_along(y, true, legs, &directions).normal, &y.v, self.n).value() > 0.0;
        (!rises).then(|| self.swing_height_along(y, legs, &directions).value())
    }

    /// Height of a stance foot in flight.
    pub(super) fn landing_guard(&self, y: &Phase<S>) -> Option<f64> {
        (self.walks && self.feet.contact == Contact::Flight).then(|| self.stance_height(y).value())
    }

    pub(super) fn stance_height(&self, y: &Phase<S>) -> S {
        let Some(legs) = self.legs() else { return y.q[3] };
        let cos = (y.q[legs.stance()] + legs.slope()).cos();
        let height = y.q[3] + self.ground.radius.unwrap_or_default() * (cos - 1.0) + self.short(y, legs.stance()) * cos;
        height - self.floor_under(y, legs.stance()).unwrap_or_default()
    }

    /// Sliding speed in the direction of sliding.
    pub(super) fn slide_guard(&self, y: &Phase<S>) -> Option<f64> {
        let Contact::Sliding(direction) = self.feet.contact else { return None };
        self.foot_rows(y, false).map(|rows| product(&rows.tangent, &y.v, self.n).value() * direction)
    }

    /// What is left of the friction cone while the foot is held.
    pub(super) fn cone_guard(&self, work: &Work<S>) -> Option<f64> {
        let friction = self.ground.friction?.value();
        let (tangent, normal) =
            (work.held.force_of(Holder::Tangent)?.value(), work.held.force_of(Holder::Normal)?.value());
        Some(friction * normal.max(0.0) * (1.0 + 1e-10) + ROUNDING - tangent.abs())
    }

    /// True if the stance toe is a point that does not move, on the mean ground.
    pub(super) fn stands_still(&self) -> bool {
        let is_point = self.ground.radius.is_none() && self.ground.compliance.is_none() && self.feet.toes.is_none();
        self.walks && is_point && self.feet.contact == Contact::Held && self.feet.rise.abs() <= 0.0
    }

    /// Constraints of the stance foot.
    pub(super) fn add_foot(&self, y: &Phase<S>, work: &mut Work<S>) {
        if !self.walks {
            return;
        }
        work.toe_bias = [work.eq.force[TOE], work.eq.force[TOE + 1]];
        match self.feet.contact {
            Contact::Flight => {}
            _ if self.ground.compliance.is_some() => self.add_sprung_foot(y, work),
            Contact::Held => {
                if self.stands_still() {
                    work.held.still(Holder::Tangent, TOE, 1.0);
                    work.held.still(Holder::Normal, TOE + 1, 1.0);
                } else if let Some(rows) = self.foot_rows(y, false) {
                    work.held.along(Holder::Tangent, rows.tangent, rows.tangent, rows.bias[0]);
                    work.held.along(Holder::Normal, rows.normal, rows.normal, rows.bias[1]);
                }
            }
            Contact::Sliding(direction) => {
                let Some(rows) = self.foot_rows(y, false) else { return };
                let drag = self.ground.friction.unwrap_or_default() * direction;
                let mut force = rows.normal;
                for i in 0..self.n {
                    force[i] -= rows.tangent[i] * drag;
                }
                work.held.along(Holder::Normal, rows.normal, force, rows.bias[1]);
            }
        }
    }

    /// A spring along the leg between toe and tip; the tip does not move, across the leg the toe stays in line.
    fn add_sprung_foot(&self, y: &Phase<S>, work: &mut Work<S>) {
        let (Some(legs), Some((stiffness, damping))) = (self.legs(), self.ground.compliance) else { return };
        let s = legs.stance();
        let (sin, cos) = (y.q[s] + legs.slope()).sin_cos();
        // d = (-sin, cos) along the leg, e = (cos, sin) across it.
        let along = y.q[3] * cos - (y.q[2] - self.feet.tip) * sin;
        let speed = y.v[3] * cos - y.v[2] * sin;
        let push = -(stiffness * along) - damping * speed;
        work.eq.force[2] -= push * sin;
        work.eq.force[3] += push * cos;
        let row = sprung_row(s, along, (sin, cos));
        let bias = y.v[s] * speed * 2.0;
        work.held.along(Holder::Tangent, row, row, bias);
    }

    /// Rows along which the stance foot cannot move, whatever strikes the robot elsewhere.
    pub(super) fn foot_holds(&self, y: &Phase<S>) -> [Option<[S; MAX]>; 2] {
        let Some(legs) = self.legs() else { return [None, None] };
        if self.feet.contact == Contact::Flight {
            return [None, None];
        }
        if self.ground.compliance.is_some() {
            let (sin, cos) = (y.q[legs.stance()] + legs.slope()).sin_cos();
            let along = y.q[3] * cos - (y.q[2] - self.feet.tip) * sin;
            return [Some(sprung_row(legs.stance(), along, (sin, cos))), None];
        }
        let Some(rows) = self.foot_rows(y, false) else { return [None, None] };
        let stands = self.feet.contact == Contact::Held;
        [Some(rows.normal), stands.then_some(rows.tangent)]
    }

    /// Velocity rows of the point at the end of the swing leg.
    pub(super) fn swing_toe_rows(&self, y: &Phase<S>) -> [[S; MAX]; 2] {
        let mut rows = [[S::zero(); MAX]; 2];
        if let Some(legs) = self.legs() {
            let (s, w) = (legs.stance(), 1 - legs.stance());
            let ((ss, cs), (sw, cw)) = ((y.q[s] + legs.slope()).sin_cos(), (y.q[w] + legs.slope()).sin_cos());
            let l = legs.length();
            rows[0][2] = S::one();
            rows[1][3] = S::one();
            (rows[0][s], rows[0][w]) = (-(l * cs), l * cw);
            (rows[1][s], rows[1][w]) = (-(l * ss), l * sw);
        }
        rows
    }

    /// Its height, m.
    pub(super) fn swing_toe_height(&self, y: &Phase<S>) -> S {
        let Some(legs) = self.legs() else { return S::zero() };
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let (cs, cw) = ((y.q[s] + legs.slope()).cos(), (y.q[w] + legs.slope()).cos());
        y.q[3] + legs.length() * (cs - cw)
    }

    /// What `leg` is shorter than its length, m.
    pub(super) fn short(&self, y: &Phase<S>, leg: usize) -> S {
        self.feet.toes.map_or(S::zero(), |toes| y.q[toes + leg])
    }

    /// Place of the foot of `leg` along the ground, m.
    pub(super) fn foot_place(&self, y: &Phase<S>, leg: usize) -> Option<S> {
        let legs = self.legs()?;
        let toe = if leg == legs.stance() { y.q[2] } else { y.q[2] + self.stride(y)? };
        Some(toe - self.short(y, leg) * (y.q[leg] + legs.slope()).sin())
    }

    /// How the floor rises under the foot of `leg`, edges included.
    pub(super) fn rise_under(&self, y: &Phase<S>, leg: usize) -> f64 {
        let (Some(floor), Some(place)) = (&self.ground.floor, self.foot_place(y, leg)) else { return 0.0 };
        let [_, rise] = floor.contact(place.value());
        rise
    }

    /// How the floor's profile rises under the foot of `leg`.
    pub(super) fn profile_rise(&self, y: &Phase<S>, leg: usize) -> f64 {
        let Some(floor) = self.ground.floor.as_ref().filter(|floor| !floor.profile.is_empty()) else { return 0.0 };
        self.foot_place(y, leg).map_or(0.0, |place| floor.rise(place.value()))
    }

    /// Height of the floor under the foot of `leg`, m.
    fn floor_under(&self, y: &Phase<S>, leg: usize) -> Option<f64> {
        let Some(floor) = &self.ground.floor else { return Some(0.0) };
        Some(floor.height_m(self.foot_place(y, leg)?.value()))
    }
}
