//! The foot on the ground: pinned, rolling, sprung, sliding or in the air; touchdown and exchange of legs.
//!
//! Walking uses the floating coordinates (inner, outer, toe x along the ground, toe y normal to it, in m) and holds the
//! stance foot by constraints, so that a rotor or a structural mode takes part in impacts with its own inertia.
//!
//! # Touchdown
//! Own detection: the swing foot's height falls through zero. With a recorded stance column it is armed around each
//! change ([`Machine::expect_stance`]) and the change is made at the end of that time if the model's foot is late.
//! Without one it is armed once the foot has swung to the other side and is clearly apart from the stance foot: earlier
//! scuffing is ignored (the toe is retracted).
//!
//! With toes of known length ([`Machine::set_toes`]) nothing is ignored but feet side by side: a foot that has been clear
//! of the ground may come down on either side.
//!
//! # Limits
//! No double support: the old foot leaves at touchdown, with `toe_compliance` too. The stance foot leaves the ground by
//! rebound (`elastic_impact`), and when the ground would have to pull, if [`Machine::let_lift_off`] was called.
//! RT: yes, no allocation.

use super::events::Guard;
use super::motion::{Constraint, Holder, Phase, Work, product};
use super::{Machine, MachineError};
use crate::base::scalar::Scalar;
use crate::model::mechanism::{Body, Legs, MAX};

/// How the stance foot meets the ground.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Contact {
    /// It does not slide (it may roll, or spring along the leg).
    #[default]
    Held,
    /// It slides in this direction.
    Sliding(f64),
    /// It is in the air.
    Flight,
}

/// What the ground and the feet are like; absent = rigid point that never slips nor rebounds.
#[derive(Clone, Debug, Default)]
pub(super) struct Ground<S> {
    pub(super) friction: Option<S>,
    pub(super) restitution: Option<S>,
    /// Stiffness and damping along the leg.
    pub(super) compliance: Option<(S, S)>,
    pub(super) radius: Option<S>,
    /// The ground does not pull.
    pub(super) lift_off: bool,
}

/// State of the feet.
#[derive(Clone, Debug, Default)]
pub(super) struct Feet<S> {
    pub(super) contact: Contact,
    /// Where the tip of a sprung toe stands, m along the ground.
    pub(super) tip: S,
    /// Side on which the swing foot was just after the last touchdown: not armed there.
    pub(super) side: f64,
    /// A recording says when legs change.
    pub(super) told: bool,
    /// The leg it wants next, if a change is due.
    pub(super) due: Option<usize>,
    pub(super) touchdowns: u32,
    pub(super) last_touchdown: S,
    /// What each leg is shorter than its length, m, if the toes are followed.
    pub(super) short: Option<[S; 2]>,
    pub(super) last_strike: Strike<S>,
}

/// A foot's meeting with the ground: along it and normal to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strike<S> {
    /// Impulse on the foot, N s.
    pub impulse_ns: [S; 2],
    /// Velocity of the foot before, m/s.
    pub velocity_m_s: [S; 2],
}

/// Feet closer than this, in leg lengths, do not touch down by themselves: a leg passes the other.
const APART: f64 = 0.08;
/// Slower rebounds are none, m/s: bounces would never end.
const SLOWEST_REBOUND: f64 = 5e-3;
/// A foot slower than this, m/s, sticks after an impact.
const STICKS: f64 = 1e-9;
/// A swing foot below this at the start of a run stands on the ground.
const NEAR_GROUND_M: f64 = 0.01;
/// A foot above this has left the ground and may touch down anew.
const CLEAR_M: f64 = 2e-4;
/// A sprung toe shorter than this by, m, is not: rounding.
const ROUNDING: f64 = 1e-9;

/// Velocity rows of a foot, `contact velocity = row · v`, and what the rates add to its acceleration.
pub(super) struct FootRows<S> {
    tangent: [S; MAX],
    normal: [S; MAX],
    bias: [S; 2],
}

impl<S: Scalar> Machine<S> {
    fn legs(&self) -> Option<&Legs<S>> {
        match &self.body {
            Body::Legs(legs) if self.walks => Some(legs),
            _ => None,
        }
    }

    /// Standing leg: 0 inner, 1 outer; 0 for a machine without legs.
    #[must_use]
    pub fn stance(&self) -> usize {
        match &self.body {
            Body::Legs(legs) => legs.stance(),
            _ => 0,
        }
    }

    /// How the stance foot meets the ground.
    #[must_use]
    pub fn contact(&self) -> Contact {
        self.feet.contact
    }

    /// Touchdowns since the reset, and when the last one was, s.
    #[must_use]
    pub fn touchdowns(&self) -> (u32, S) {
        (self.feet.touchdowns, self.feet.last_touchdown)
    }

    /// Position of the stance toe, m: along the ground since the reset, and above it.
    #[must_use]
    pub fn toe_m(&self) -> [S; 2] {
        if self.walks { [self.y.q[2], self.y.q[3]] } else { [S::zero(); 2] }
    }

    /// Force of the ground on the stance foot, N: along the ground and normal to it. Zero in flight and off the ground.
    pub fn ground_force(&mut self) -> [S; 2] {
        if !self.walks {
            return [S::zero(); 2];
        }
        self.flow_at_start();
        // What moves the whole robot: M's toe rows times the accelerations, less gravity and rates.
        let force = |k: usize| product(&self.work.eq.mass[2 + k], &self.work.a, self.n) - self.work.toe_bias[k];
        [force(0), force(1)]
    }

    /// Acceleration of the hip, m/s²: horizontally and up.
    pub fn hip_acceleration(&mut self) -> [S; 2] {
        self.flow_at_start();
        let Body::Legs(legs) = &self.body else { return [S::zero(); 2] };
        let (s, l, a) = (legs.stance(), legs.length(), &self.work.a);
        let toe = if self.walks { [a[2], a[3]] } else { [S::zero(); 2] };
        let (sin, cos) = (self.y.q[s] + legs.slope()).sin_cos();
        let square = self.y.v[s] * self.y.v[s];
        // Hip = toe + l (-sin, cos), in axes along and normal to the ground.
        let along = toe[0] + l * (sin * square - cos * a[s]);
        let normal = toe[1] - l * (cos * square + sin * a[s]);
        let (sin, cos) = legs.slope().sin_cos();
        [along * cos + normal * sin, normal * cos - along * sin]
    }

    /// The last impact of a foot.
    #[must_use]
    pub fn last_strike(&self) -> Strike<S> {
        self.feet.last_strike
    }

    /// The ground does not pull from now on: a stance foot that is drawn up leaves it.
    pub fn let_lift_off(&mut self) {
        self.ground.lift_off = true;
    }

    /// Toes that make the legs shorter than their length by so much, m, inner and outer.
    ///
    /// Quasi-static: levers and heights change and the standing robot sinks or rises, but the speed with which a toe
    /// travels does not enter the motion.
    pub fn set_toes(&mut self, short: [S; 2]) {
        let Some(legs) = self.legs() else { return };
        let s = legs.stance();
        let change = short[s] - self.short(s);
        let (sin, cos) = (self.y.q[s] + legs.slope()).sin_cos();
        if self.feet.contact != Contact::Flight {
            // The tip stays; the toe of a leg of full length is `short` beyond it.
            let rate = self.y.v[s];
            self.y.q[2] += change * sin;
            self.y.q[3] -= change * cos;
            self.y.v[2] += change * cos * rate;
            self.y.v[3] += change * sin * rate;
        }
        self.feet.short = Some(short);
        if self.swing_height(&self.y).is_some_and(|h| h.value() > CLEAR_M) {
            self.feet.side = 0.0;
        }
    }

    fn short(&self, leg: usize) -> S {
        self.feet.short.map_or(S::zero(), |short| short[leg])
    }

    /// The recording says that `leg` stands from about now on; `None` disarms.
    pub fn expect_stance(&mut self, leg: Option<usize>) {
        self.feet.told = true;
        self.feet.due = leg;
    }

    /// Puts the swing leg down now, wherever it is: the recording says so.
    pub fn touch_down_now(&mut self) {
        self.touch_down();
        self.settle_modes();
    }

    /// Rows of the foot of `leg`: 0 stance, 1 swing (by role).
    fn foot_rows(&self, y: &Phase<S>, swing: bool) -> Option<FootRows<S>> {
        let legs = self.legs()?;
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let mut rows = FootRows { tangent: [S::zero(); MAX], normal: [S::zero(); MAX], bias: [S::zero(); 2] };
        rows.tangent[2] = S::one();
        rows.normal[3] = S::one();
        let l = legs.length();
        if swing {
            let ((ss, cs), (sw, cw)) = ((y.q[s] + legs.slope()).sin_cos(), (y.q[w] + legs.slope()).sin_cos());
            rows.tangent[s] = -(l * cs);
            rows.tangent[w] = l * cw;
            rows.normal[s] = -(l * ss);
            rows.normal[w] = l * sw;
        }
        let leg = if swing { w } else { s };
        // A rolling arc: its contact point moves with the toe and turns about the arc's centre. A short toe: so too,
        // but it does not roll.
        let (radius, short) = (self.ground.radius.unwrap_or_default(), self.short(leg));
        let reach = radius + short;
        if self.ground.radius.is_some() || self.feet.short.is_some() {
            let (sin, cos) = (y.q[leg] + legs.slope()).sin_cos();
            let rate = y.v[leg];
            rows.tangent[leg] -= reach * cos - radius;
            rows.normal[leg] -= reach * sin;
            rows.bias = [reach * sin * rate * rate, -(reach * cos * rate * rate)];
        }
        Some(rows)
    }

    /// Height of the swing foot above the ground, m.
    fn swing_height(&self, y: &Phase<S>) -> Option<S> {
        let legs = self.legs()?;
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let (cs, cw) = ((y.q[s] + legs.slope()).cos(), (y.q[w] + legs.slope()).cos());
        let mut height = y.q[3] + legs.length() * (cs - cw);
        if let Some(radius) = self.ground.radius {
            height += radius * (cw - 1.0);
        }
        Some(height + self.short(w) * cw)
    }

    /// Swing toe ahead of the stance toe, m along the ground.
    fn stride(&self, y: &Phase<S>) -> Option<S> {
        let legs = self.legs()?;
        let (s, w) = (legs.stance(), 1 - legs.stance());
        Some(legs.length() * ((y.q[w] + legs.slope()).sin() - (y.q[s] + legs.slope()).sin()))
    }

    /// Height of the swing foot if it may touch down now.
    pub(super) fn touchdown_guard(&self, y: &Phase<S>) -> Option<f64> {
        let legs = self.legs()?;
        if self.feet.told {
            self.feet.due.filter(|leg| *leg != legs.stance())?;
        } else {
            let stride = self.stride(y)?.value();
            if stride.abs() < APART * legs.length().value() || stride * self.feet.side > 0.0 {
                return None;
            }
            // A foot that scuffed in mid-swing comes up again: the toe is retracted, nothing happens.
            let rises = product(&self.foot_rows(y, true)?.normal, &y.v, self.n).value() > 0.0;
            if rises {
                return None;
            }
        }
        self.swing_height(y).map(Scalar::value)
    }

    /// Height of a stance foot in flight.
    pub(super) fn landing_guard(&self, y: &Phase<S>) -> Option<f64> {
        (self.walks && self.feet.contact == Contact::Flight).then(|| self.stance_height(y).value())
    }

    fn stance_height(&self, y: &Phase<S>) -> S {
        let Some(legs) = self.legs() else { return y.q[3] };
        let cos = (y.q[legs.stance()] + legs.slope()).cos();
        y.q[3] + self.ground.radius.unwrap_or_default() * (cos - 1.0) + self.short(legs.stance()) * cos
    }

    /// Sliding speed in the direction of sliding.
    pub(super) fn slide_guard(&self, y: &Phase<S>) -> Option<f64> {
        let Contact::Sliding(direction) = self.feet.contact else { return None };
        self.foot_rows(y, false).map(|rows| product(&rows.tangent, &y.v, self.n).value() * direction)
    }

    /// What is left of the friction cone while the foot is held.
    pub(super) fn cone_guard(&self, work: &Work<S>) -> Option<f64> {
        let friction = self.ground.friction?.value();
        let (tangent, normal) = (work.force_of(Holder::Tangent)?.value(), work.force_of(Holder::Normal)?.value());
        Some(friction * normal.max(0.0) * (1.0 + 1e-10) + ROUNDING - tangent.abs())
    }

    /// Value and rate of a guard of the feet, for the correction of its instant.
    pub(super) fn foot_event(&self, guard: Guard) -> Option<(S, S)> {
        let rows = self.foot_rows(&self.end, guard == Guard::Touchdown)?;
        match guard {
            Guard::Touchdown => Some((self.swing_height(&self.end)?, product(&rows.normal, &self.end.v, self.n))),
            Guard::Land => Some((self.stance_height(&self.end), product(&rows.normal, &self.end.v, self.n))),
            Guard::SlideStop => {
                Some((product(&rows.tangent, &self.end.v, self.n), product(&rows.tangent, &self.work.a, self.n)))
            }
            _ => None,
        }
    }

    /// Constraints of the stance foot.
    pub(super) fn add_foot(&self, y: &Phase<S>, work: &mut Work<S>) {
        let Some(rows) = self.foot_rows(y, false) else { return };
        work.toe_bias = [work.eq.force[2], work.eq.force[3]];
        match self.feet.contact {
            Contact::Flight => {}
            _ if self.ground.compliance.is_some() => self.add_sprung_foot(y, work),
            Contact::Held => {
                work.hold(Constraint {
                    holder: Holder::Tangent,
                    row: rows.tangent,
                    force: rows.tangent,
                    bias: rows.bias[0],
                });
                work.hold(Constraint {
                    holder: Holder::Normal,
                    row: rows.normal,
                    force: rows.normal,
                    bias: rows.bias[1],
                });
            }
            Contact::Sliding(direction) => {
                let drag = self.ground.friction.unwrap_or_default() * direction;
                let mut force = rows.normal;
                for i in 0..self.n {
                    force[i] -= rows.tangent[i] * drag;
                }
                work.hold(Constraint { holder: Holder::Normal, row: rows.normal, force, bias: rows.bias[1] });
            }
        }
    }

    /// A spring along the leg between toe and tip; the tip does not move, across the leg the toe stays in line.
    fn add_sprung_foot(&self, y: &Phase<S>, work: &mut Work<S>) {
        let (Some(legs), Some((stiffness, damping))) = (self.legs(), self.ground.compliance) else { return };
        let s = legs.stance();
        let (sin, cos) = (y.q[s] + legs.slope()).sin_cos();
        let (rx, ry) = (y.q[2] - self.feet.tip, y.q[3]);
        // d = (-sin, cos) along the leg, e = (cos, sin) across it.
        let along = ry * cos - rx * sin;
        let speed = y.v[3] * cos - y.v[2] * sin;
        let push = -(stiffness * along) - damping * speed;
        work.eq.force[2] -= push * sin;
        work.eq.force[3] += push * cos;
        let mut row = [S::zero(); MAX];
        row[2] = cos;
        row[3] = sin;
        row[s] = along;
        let bias = y.v[s] * speed * 2.0;
        work.hold(Constraint { holder: Holder::Tangent, row, force: row, bias });
    }

    /// The swing foot hits the ground: impulse, exchange of legs.
    pub(super) fn touch_down(&mut self) {
        let Some(rows) = self.foot_rows(&self.y, true) else { return };
        let Some(stride) = self.stride(&self.y) else { return };
        let toe = self.swing_toe_rows();
        self.flow_at_start();
        self.strike(&rows);
        // The foot that stands now becomes the origin of the toe's coordinates.
        let velocity = [product(&toe[0], &self.y.v, self.n), product(&toe[1], &self.y.v, self.n)];
        let height = self.swing_toe_height();
        self.y.q[2] += stride;
        self.y.q[3] = height;
        self.y.v[2] = velocity[0];
        self.y.v[3] = velocity[1];
        self.feet.tip = self.y.q[2];
        self.feet.side = -stride.sign();
        self.feet.touchdowns += 1;
        self.feet.last_touchdown = self.now;
        self.feet.due = None;
        if let Body::Legs(legs) = &mut self.body {
            legs.set_stance(1 - legs.stance());
        }
        self.after_impact();
    }

    /// A stance foot comes back from flight.
    pub(super) fn land(&mut self) {
        let Some(rows) = self.foot_rows(&self.y, false) else { return };
        self.flow_at_start();
        self.strike(&rows);
        self.feet.tip = self.y.q[2];
        self.after_impact();
    }

    fn after_impact(&mut self) {
        self.regrip();
        self.before_now();
    }

    /// Velocity rows of the point at the end of the swing leg.
    fn swing_toe_rows(&self) -> [[S; MAX]; 2] {
        let mut rows = [[S::zero(); MAX]; 2];
        if let Some(legs) = self.legs() {
            let (s, w) = (legs.stance(), 1 - legs.stance());
            let ((ss, cs), (sw, cw)) = ((self.y.q[s] + legs.slope()).sin_cos(), (self.y.q[w] + legs.slope()).sin_cos());
            let l = legs.length();
            rows[0][2] = S::one();
            rows[1][3] = S::one();
            (rows[0][s], rows[0][w]) = (-(l * cs), l * cw);
            (rows[1][s], rows[1][w]) = (-(l * ss), l * sw);
        }
        rows
    }

    fn swing_toe_height(&self) -> S {
        let Some(legs) = self.legs() else { return S::zero() };
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let (cs, cw) = ((self.y.q[s] + legs.slope()).cos(), (self.y.q[w] + legs.slope()).cos());
        self.y.q[3] + legs.length() * (cs - cw)
    }

    /// The impulse at a foot: inelastic and without slip, or with restitution and within the friction cone
    /// (section 5 of the model notes, on the machine's whole mass matrix). Sets the contact that follows.
    fn strike(&mut self, rows: &FootRows<S>) {
        let n = self.n;
        let (wt, wn) = (self.work.kick(&rows.tangent, n), self.work.kick(&rows.normal, n));
        let speed = [product(&rows.tangent, &self.y.v, n), product(&rows.normal, &self.y.v, n)];
        self.feet.last_strike = Strike { impulse_ns: [S::zero(); 2], velocity_m_s: speed };
        if self.ground.compliance.is_some() {
            self.strike_sprung(rows, &wt, &wn, speed);
            return;
        }
        let falls = speed[1].value() < 0.0;
        let e = self.ground.restitution.unwrap_or_default();
        let rebound = -(e * speed[1]);
        let bounces = falls && rebound.value() > SLOWEST_REBOUND;
        let wanted = if bounces { rebound } else { S::zero() };
        let d = [
            [product(&rows.tangent, &wt, n), product(&rows.tangent, &wn, n)],
            [product(&rows.normal, &wt, n), product(&rows.normal, &wn, n)],
        ];
        let c = [-speed[0], wanted - speed[1]];
        let det = d[0][0] * d[1][1] - d[0][1] * d[1][0];
        let mut impulse = [(d[1][1] * c[0] - d[0][1] * c[1]) / det, (d[0][0] * c[1] - d[1][0] * c[0]) / det];
        let mut slides = 0.0;
        if let Some(friction) = self.ground.friction
            && impulse[0].value().abs() > friction.value() * impulse[1].value()
        {
            let side = impulse[0].sign();
            let normal = c[1] / (d[1][1] + friction * side * d[1][0]);
            impulse = [friction * side * normal, normal];
            slides = -side;
        }
        self.feet.last_strike.impulse_ns = impulse;
        for i in 0..n {
            self.y.v[i] += wt[i] * impulse[0] + wn[i] * impulse[1];
        }
        self.feet.contact = if bounces {
            Contact::Flight
        } else if slides.abs() > 0.0 && product(&rows.tangent, &self.y.v, n).value().abs() > STICKS {
            Contact::Sliding(slides)
        } else {
            Contact::Held
        };
    }

    /// A sprung toe takes up the speed along the leg; only the speed across it meets the ground.
    fn strike_sprung(&mut self, rows: &FootRows<S>, wt: &[S; MAX], wn: &[S; MAX], speed: [S; 2]) {
        let n = self.n;
        let Some(legs) = self.legs() else { return };
        let leg = 1 - legs.stance();
        let (sin, cos) = (self.y.q[leg] + legs.slope()).sin_cos();
        let (mut row, mut response) = ([S::zero(); MAX], [S::zero(); MAX]);
        for i in 0..n {
            row[i] = rows.tangent[i] * cos + rows.normal[i] * sin;
            response[i] = wt[i] * cos + wn[i] * sin;
        }
        let impulse = -((speed[0] * cos + speed[1] * sin) / product(&row, &response, n));
        for i in 0..n {
            self.y.v[i] += response[i] * impulse;
        }
        self.feet.contact = Contact::Held;
    }

    /// Side of the swing foot if the feet are apart and both on the ground: as after a touchdown, it is not armed there.
    fn standing_side(&self) -> Option<f64> {
        let apart = APART * self.legs()?.length().value();
        let (stride, height) = (self.stride(&self.y)?, self.swing_height(&self.y)?);
        (stride.value().abs() > apart && height.value() < NEAR_GROUND_M).then(|| stride.sign())
    }

    /// The stance foot at the start of a run: on the ground, rolling or sprung as the legs turn.
    pub(super) fn start_feet(&mut self) {
        let Feet { told, short, .. } = self.feet;
        self.feet = Feet { told, side: self.standing_side().unwrap_or(0.0), ..Feet::default() };
        if let Some(short) = short {
            self.set_toes(short);
        }
        let Some(legs) = self.legs() else { return };
        let s = legs.stance();
        let (angle, rate) = (self.y.q[s] + legs.slope(), self.y.v[s]);
        let weight = legs.mass() * legs.gravity();
        let (sin, cos) = angle.sin_cos();
        if let Some(radius) = self.ground.radius {
            self.y.q[3] = radius * (-cos + 1.0);
            self.y.v[2] = radius * (cos - 1.0) * rate;
            self.y.v[3] = radius * sin * rate;
        }
        if let Some((stiffness, _)) = self.ground.compliance {
            // As compressed as the standing robot is; the toe turns with the leg about the tip.
            let short = weight * cos / stiffness;
            self.y.q[2] = short * sin;
            self.y.q[3] = -(short * cos);
            self.y.v[2] = short * cos * rate;
            self.y.v[3] = short * sin * rate;
        }
    }

    /// The foot begins to slide, against the force that held it.
    pub(super) fn start_sliding(&mut self) {
        self.flow_at_start();
        let held = self.work.force_of(Holder::Tangent).map_or(0.0, |f| f.sign());
        self.feet.contact = Contact::Sliding(if held > 0.0 { -1.0 } else { 1.0 });
    }

    /// The ground would have to pull.
    pub(super) fn lift_off(&mut self) {
        self.feet.contact = Contact::Flight;
    }

    /// A sliding foot has come to rest.
    pub(super) fn stop_sliding(&mut self) {
        self.feet.contact = Contact::Held;
    }

    /// Refuses combinations that have no model.
    pub(super) fn check_ground(&self) -> Result<(), MachineError> {
        let ground = &self.ground;
        let others = ground.friction.is_some() || ground.restitution.is_some() || ground.radius.is_some();
        if ground.compliance.is_some() && others {
            let text = "toe_compliance together with foot_slip, elastic_impact or round_foot is not modelled";
            return Err(MachineError::Unsupported(text.to_owned()));
        }
        Ok(())
    }
}
