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
//! With toes that are followed ([`Machine::give_toes`]) nothing is ignored but feet side by side: a foot that has been
//! clear of the ground may come down on either side.
//!
//! # Limits
//! No double support unless [`Machine::let_stand_on_both`] was called ([`super::second`]): the old foot leaves at touchdown,
//! with `toe_compliance` too. The stance foot leaves the ground by rebound (`elastic_impact`), and when the ground would
//! have to pull, if [`Machine::let_lift_off`] was called.
//! RT: yes, no allocation.

use super::events::Guard;
use super::floor::Floor;
use super::foot::{APART, FootRows, on_slope};
use super::hold::{Holder, product};
use super::motion::FlowOf;
use super::second::Second;
use super::{Machine, MachineError};
use crate::base::scalar::Scalar;
use crate::model::mechanism::{Body, MAX};

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
    /// Both feet may touch at once.
    pub(super) both: bool,
    /// Heights; absent = even.
    pub(super) floor: Option<Floor>,
}

/// State of the feet.
#[derive(Clone, Debug, Default)]
pub(super) struct Feet<S> {
    pub(super) contact: Contact,
    /// Where the tip of a sprung toe stands, m along the ground.
    pub(super) tip: S,
    /// Side on which the swing foot was just after the last touchdown: not armed there.
    pub(super) side: f64,
    /// The swing foot began below the floor by so much, m: a foot that slid against an edge. It comes up from there.
    pub(super) sunk_m: f64,
    /// A recording says when legs change.
    pub(super) told: bool,
    /// The leg it wants next, if a change is due.
    pub(super) due: Option<usize>,
    pub(super) touchdowns: u32,
    pub(super) last_touchdown: S,
    /// First of the two coordinates of the toes, if they are followed.
    pub(super) toes: Option<usize>,
    pub(super) short_at_start: [S; 2],
    pub(super) toe_acceleration: [S; 2],
    /// The other foot, while it touches the ground too.
    pub(super) second: Option<Second<S>>,
    pub(super) last_strike: Strike<S>,
    /// How the floor's profile rises where the foot that stands has landed.
    pub(super) rise: f64,
}

/// A foot's meeting with the ground: along the mean ground and normal to it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Strike<S> {
    /// Impulse on the foot, N s.
    pub impulse_ns: [S; 2],
    /// Velocity of the foot before, m/s.
    pub velocity_m_s: [S; 2],
}

/// Slower rebounds are none, m/s: bounces would never end.
const SLOWEST_REBOUND: f64 = 5e-3;
/// A foot slower than this, m/s, sticks after an impact.
const STICKS: f64 = 1e-9;
/// A swing foot below this at the start of a run stands on the ground.
const NEAR_GROUND_M: f64 = 0.01;
/// A foot above this has left the ground and may touch down anew.
const CLEAR_M: f64 = 2e-4;

impl<S: Scalar> Machine<S> {
    /// Standing leg: 0 inner, 1 outer; 0 for a machine without legs.
    #[must_use]
    pub fn stance(&self) -> usize {
        match &self.plant.body {
            Body::Legs(legs) => legs.stance(),
            _ => 0,
        }
    }

    /// How the stance foot meets the ground.
    #[must_use]
    pub fn contact(&self) -> Contact {
        self.plant.feet.contact
    }

    /// Touchdowns since the reset, and when the last one was, s.
    #[must_use]
    pub fn touchdowns(&self) -> (u32, S) {
        (self.plant.feet.touchdowns, self.plant.feet.last_touchdown)
    }

    /// Position of the stance toe, m: along the ground since the reset, and above it.
    #[must_use]
    pub fn toe_m(&self) -> [S; 2] {
        if self.plant.walks { [self.y.q[2], self.y.q[3]] } else { [S::zero(); 2] }
    }

    /// Force of the ground on the stance foot, N: along the ground and normal to it. Zero in flight and off the ground.
    pub fn ground_force(&mut self) -> [S; 2] {
        self.ground_force_and_hip_acceleration().0
    }

    /// [`Self::ground_force`], and the acceleration of the hip, m/s²: horizontally and up.
    pub fn ground_force_and_hip_acceleration(&mut self) -> ([S; 2], [S; 2]) {
        self.flow_at_start();
        (self.stance_force(), self.hip_acceleration())
    }

    fn stance_force(&self) -> [S; 2] {
        if !self.plant.walks {
            return [S::zero(); 2];
        }
        // What moves the whole robot: M's toe rows times the accelerations, less gravity and rates.
        let force = |k: usize| product(&self.work.eq.mass[2 + k], &self.work.a, self.plant.n) - self.work.toe_bias[k];
        [force(0), force(1)]
    }

    fn hip_acceleration(&self) -> [S; 2] {
        let Body::Legs(legs) = &self.plant.body else { return [S::zero(); 2] };
        let (s, l, a) = (legs.stance(), legs.length(), &self.work.a);
        let toe = if self.plant.walks { [a[2], a[3]] } else { [S::zero(); 2] };
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
        self.plant.feet.last_strike
    }

    /// The ground does not pull from now on: a stance foot that is drawn up leaves it.
    pub fn let_lift_off(&mut self) {
        self.plant.ground.lift_off = true;
    }

    /// Walks over these heights from now on. A profile is for feet that are points: without `round_foot` and
    /// `toe_compliance`.
    pub fn lay_floor(&mut self, floor: Floor) {
        self.plant.ground.floor = Some(floor);
    }

    /// Place of the stance foot (the ground's point, not the end of the full leg), m: along the ground since the reset,
    /// and above its mean.
    #[must_use]
    pub fn foot_m(&self) -> [S; 2] {
        let Some(legs) = self.plant.legs() else { return [S::zero(); 2] };
        let (leg, slope) = (legs.stance(), legs.slope());
        let place = self.plant.foot_place(&self.y, leg).unwrap_or_default();
        [place, self.y.q[3] + self.plant.short(&self.y, leg) * (self.y.q[leg] + slope).cos()]
    }

    /// Height of the swing foot over the floor below it, m.
    #[must_use]
    pub fn swing_clearance(&self) -> S {
        self.plant.swing_height(&self.y).unwrap_or_default()
    }

    /// A foot that is clear of the ground may come down on either side; one that rises out of the ground is not let in
    /// again.
    pub(super) fn arm_clear_foot(&mut self) {
        if self.plant.feet.sunk_m > 0.0 {
            self.plant.feet.sunk_m = self.depth_m().clamp(0.0, self.plant.feet.sunk_m);
        }
        if self.plant.feet.side.abs() > 0.0 && self.plant.swing_height(&self.y).is_some_and(|h| h.value() > CLEAR_M) {
            self.plant.feet.side = 0.0;
        }
    }

    /// How deep the swing foot is in the floor as it lies there, m.
    fn depth_m(&self) -> f64 {
        self.plant.feet.sunk_m - self.plant.swing_height(&self.y).map_or(0.0, Scalar::value)
    }

    /// The recording says that `leg` stands from about now on; `None` disarms.
    pub fn expect_stance(&mut self, leg: Option<usize>) {
        self.plant.feet.told = true;
        self.plant.feet.due = leg;
    }

    /// Puts the swing leg down now, wherever it is: the recording says so.
    pub fn touch_down_now(&mut self) {
        self.touch_down();
        self.flow_of = FlowOf::Nothing;
        self.settle_modes();
    }

    /// Value and rate of a guard of the feet, for the correction of its instant.
    pub(super) fn foot_event(&self, guard: Guard) -> Option<(S, S)> {
        let rows = self.plant.foot_rows(&self.end, guard == Guard::Touchdown)?;
        match guard {
            Guard::Touchdown => {
                Some((self.plant.swing_height(&self.end)?, product(&rows.normal, &self.end.v, self.plant.n)))
            }
            Guard::Land => {
                Some((self.plant.stance_height(&self.end), product(&rows.normal, &self.end.v, self.plant.n)))
            }
            Guard::SlideStop => Some((
                product(&rows.tangent, &self.end.v, self.plant.n),
                product(&rows.tangent, &self.work.a, self.plant.n),
            )),
            _ => None,
        }
    }

    /// The swing foot hits the ground.
    pub(super) fn touch_down(&mut self) {
        if !self.lands_beside() {
            self.exchange();
        }
    }

    /// The swing foot becomes the one that stands: impulse, exchange of legs.
    fn exchange(&mut self) {
        self.plant.feet.second = None;
        let Some(rows) = self.plant.foot_rows(&self.y, true) else { return };
        let Some(stride) = self.plant.stride(&self.y) else { return };
        let toe = self.plant.swing_toe_rows(&self.y);
        self.flow_at_start();
        self.strike(&rows);
        self.plant.feet.rise = rows.rise;
        // The foot that stands now becomes the origin of the toe's coordinates.
        let velocity = [product(&toe[0], &self.y.v, self.plant.n), product(&toe[1], &self.y.v, self.plant.n)];
        let height = self.plant.swing_toe_height(&self.y);
        self.y.q[2] += stride;
        self.y.q[3] = height;
        self.y.v[2] = velocity[0];
        self.y.v[3] = velocity[1];
        self.plant.feet.tip = self.y.q[2];
        self.plant.feet.side = -stride.sign();
        self.plant.feet.touchdowns += 1;
        self.plant.feet.last_touchdown = self.now;
        self.plant.feet.due = None;
        if let Body::Legs(legs) = &mut self.plant.body {
            legs.set_stance(1 - legs.stance());
        }
        self.plant.feet.sunk_m = 0.0;
        if self.plant.ground.both {
            self.plant.feet.sunk_m = self.depth_m().max(0.0);
        }
        self.after_impact();
    }

    /// A stance foot comes back from flight.
    pub(super) fn land(&mut self) {
        let Some(rows) = self.plant.foot_rows(&self.y, false) else { return };
        self.flow_at_start();
        self.strike(&rows);
        self.plant.feet.rise = rows.rise;
        self.plant.feet.tip = self.y.q[2];
        self.after_impact();
    }

    fn after_impact(&mut self) {
        self.follow_stops();
        self.regrip();
        self.before_now();
    }

    /// The impulse at a foot: inelastic and without slip, or with restitution and within the friction cone
    /// (section 5 of the model notes, on the machine's whole mass matrix). Sets the contact that follows.
    ///
    /// A foot that rebounds with e keeps e² of its speed along the ground, where the notes let it stick. A contact that
    /// gives back e is a spring with damping D that lasts half a period, e = exp(-πD/√(1-D²)); the same damping
    /// takes the speed along the ground, without a spring, for the same time: exp(-2πD/√(1-D²)) = e² is left (own
    /// derivation, test `a_rebound_...`). A walk of another simulator with e = .334 has 1.01 of its noise left at the
    /// truth, 1.13 with sticking, which then fits e = .40.
    pub(super) fn strike(&mut self, rows: &FootRows<S>) {
        let n = self.plant.n;
        let (wt, wn) = (self.work.kick(&rows.tangent, n), self.work.kick(&rows.normal, n));
        let speed = [product(&rows.tangent, &self.y.v, n), product(&rows.normal, &self.y.v, n)];
        let velocity_m_s = on_slope(speed, -rows.rise);
        self.plant.feet.last_strike = Strike { impulse_ns: [S::zero(); 2], velocity_m_s };
        if self.plant.ground.compliance.is_some() {
            self.strike_sprung(rows, &wt, &wn, speed);
            return;
        }
        let falls = speed[1].value() < 0.0;
        let e = self.plant.ground.restitution.unwrap_or_default();
        let rebound = -(e * speed[1]);
        let bounces = falls && rebound.value() > SLOWEST_REBOUND;
        let wanted = if bounces { rebound } else { S::zero() };
        let d = [
            [product(&rows.tangent, &wt, n), product(&rows.tangent, &wn, n)],
            [product(&rows.normal, &wt, n), product(&rows.normal, &wn, n)],
        ];
        let glides = if bounces { e * e * speed[0] } else { S::zero() };
        let c = [glides - speed[0], wanted - speed[1]];
        let det = d[0][0] * d[1][1] - d[0][1] * d[1][0];
        let mut impulse = [(d[1][1] * c[0] - d[0][1] * c[1]) / det, (d[0][0] * c[1] - d[1][0] * c[0]) / det];
        let mut slides = 0.0;
        if let Some(friction) = self.plant.ground.friction
            && impulse[0].value().abs() > friction.value() * impulse[1].value()
        {
            let side = impulse[0].sign();
            let normal = c[1] / (d[1][1] + friction * side * d[1][0]);
            impulse = [friction * side * normal, normal];
            slides = -side;
        }
        self.plant.feet.last_strike.impulse_ns = on_slope(impulse, -rows.rise);
        for i in 0..n {
            self.y.v[i] += wt[i] * impulse[0] + wn[i] * impulse[1];
        }
        self.plant.feet.contact = if bounces {
            Contact::Flight
        } else if slides.abs() > 0.0 && product(&rows.tangent, &self.y.v, n).value().abs() > STICKS {
            Contact::Sliding(slides)
        } else {
            Contact::Held
        };
    }

    /// A sprung toe, on a floor without a profile, takes up the speed along the leg; only the speed across it meets the ground.
    fn strike_sprung(&mut self, rows: &FootRows<S>, wt: &[S; MAX], wn: &[S; MAX], speed: [S; 2]) {
        let n = self.plant.n;
        let Some(legs) = self.plant.legs() else { return };
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
        self.plant.feet.contact = Contact::Held;
    }

    /// Side of the swing foot if the feet are apart and both on the ground: as after a touchdown, it is not armed there.
    fn standing_side(&self) -> Option<f64> {
        let apart = APART * self.plant.legs()?.length().value();
        let (stride, height) = (self.plant.stride(&self.y)?, self.plant.swing_height(&self.y)?);
        (stride.value().abs() > apart && height.value() < NEAR_GROUND_M).then(|| stride.sign())
    }

    /// The stance foot at the start of a run: on the ground, rolling or sprung as the legs turn.
    pub(super) fn start_feet(&mut self) {
        let Feet { told, toes, short_at_start, .. } = self.plant.feet;
        self.plant.feet = Feet { told, toes, short_at_start, ..Feet::default() };
        self.start_toes();
        self.plant.feet.rise = self.plant.profile_rise(&self.y, self.stance());
        self.plant.feet.side = self.standing_side().unwrap_or(0.0);
        self.arm_clear_foot();
        let Some(legs) = self.plant.legs() else { return };
        let s = legs.stance();
        let (angle, rate) = (self.y.q[s] + legs.slope(), self.y.v[s]);
        let weight = legs.mass() * legs.gravity();
        let (sin, cos) = angle.sin_cos();
        if let Some(radius) = self.plant.ground.radius {
            self.y.q[3] = radius * (-cos + 1.0);
            self.y.v[2] = radius * (cos - 1.0) * rate;
            self.y.v[3] = radius * sin * rate;
        }
        if let Some((stiffness, _)) = self.plant.ground.compliance {
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
        let held = self.work.held.force_of(Holder::Tangent).map_or(0.0, |f| f.sign());
        self.plant.feet.contact = Contact::Sliding(if held > 0.0 { -1.0 } else { 1.0 });
    }

    /// The ground would have to pull: the other foot stands from now on if it is on the ground.
    pub(super) fn lift_off(&mut self) {
        if self.second_foot_force().is_some() {
            self.exchange();
        } else {
            self.plant.feet.contact = Contact::Flight;
        }
    }

    /// A sliding foot has come to rest.
    pub(super) fn stop_sliding(&mut self) {
        self.plant.feet.contact = Contact::Held;
    }

    /// Refuses combinations that have no model.
    pub(super) fn check_ground(&self) -> Result<(), MachineError> {
        let ground = &self.plant.ground;
        let others = ground.friction.is_some() || ground.restitution.is_some() || ground.radius.is_some();
        if ground.compliance.is_some() && others {
            let text = "toe_compliance together with foot_slip, elastic_impact or round_foot is not modelled";
            return Err(MachineError::Unsupported(text.to_owned()));
        }
        Ok(())
    }
}
