//! The law that walks: the configured one, with foot placement for the first step, for the last ones, and wherever the
//! configured law does not hold. Which one chose the torque is told in every tick; they change at touchdowns, and where the
//! robot falls back. RT: yes.

use super::ControllerError;
use super::compliance::Compliance;
use super::foot_placement::{FootPlacement, Wish, falls_back};
use super::landing::Steady;
use super::transverse::Transverse;
use super::tvlqr::Tvlqr;
use super::virtual_constraint::VirtualConstraint;
use crate::base::time::Stamp;
use crate::config::checked::{Config, ControllerKind};
use crate::msg::{Estimate, LawName, Leg, Motion, Snapshot};

/// Laws, and which one is in charge.
#[derive(Clone, Debug)]
pub(super) struct Gait {
    placement: FootPlacement,
    own: Own,
    compliance: Compliance,
    in_charge: bool,
    stance: Option<Leg>,
}

#[derive(Clone, Debug)]
#[expect(clippy::large_enum_variant, reason = "there is one, made before arming")]
enum Own {
    Placement,
    Virtual(VirtualConstraint),
    Transverse(Transverse),
    Rebalance(Tvlqr),
}

impl Gait {
    /// Before arming only.
    ///
    /// # Errors
    /// The law needs a plan, and the configured one does not serve.
    pub(super) fn new(config: &Config) -> Result<Self, ControllerError> {
        let own = match config.control.controller {
            ControllerKind::VirtualConstraint => Own::Virtual(VirtualConstraint::new(config)),
            ControllerKind::Transverse => Own::Transverse(Transverse::new(config)?),
            ControllerKind::Tvlqr => Own::Rebalance(Tvlqr::new(config)?),
            ControllerKind::Idle
            | ControllerKind::Hold
            | ControllerKind::Balance
            | ControllerKind::Walk
            | ControllerKind::LqrTree => Own::Placement,
        };
        let mut placement = FootPlacement::new(config);
        match &own {
            Own::Virtual(_) => {
                placement.landing.walk_as(Steady::of_virtual_constraint(&config.control.virtual_constraint));
                placement.landing.brakes_at_once();
            }
            Own::Transverse(law) => placement.landing.walk_as(law.steady(placement.landing.leg_m())),
            Own::Placement | Own::Rebalance(_) => {}
        }
        Ok(Self { placement, own, compliance: Compliance::new(config), in_charge: false, stance: None })
    }

    /// On arming: the next tick begins a first step, out of balance, and nothing is known.
    pub(super) fn reset(&mut self) {
        self.placement.reset();
        match &mut self.own {
            Own::Placement => {}
            Own::Virtual(law) => law.join(),
            Own::Transverse(law) => law.reset(),
            Own::Rebalance(law) => law.reset(),
        }
        self.in_charge = false;
        self.stance = None;
    }

    /// The next tick goes on with a step that begins now, out of rest: both feet have stood, the front one will.
    pub(super) fn step_off(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot) {
        self.placement.take_over(now, e, seen);
        self.in_charge = false;
        self.stance = Some(e.stance);
    }

    /// ξ² below which a step is too slow, rad²/s².
    pub(super) fn slow_energy(&self, speed_m_s: f64) -> f64 {
        self.placement.landing.slow_energy(speed_m_s)
    }

    /// The configured law begins a step after one of foot placement.
    const fn join(&mut self) {
        match &mut self.own {
            Own::Placement | Own::Rebalance(_) => {}
            Own::Virtual(law) => law.join(),
            Own::Transverse(law) => law.join(),
        }
    }

    /// It makes one step and balances again.
    pub(super) const fn is_rebalance(&self) -> bool {
        matches!(self.own, Own::Rebalance(_))
    }

    /// Its one step is made.
    pub(super) fn is_over(&self, now: Stamp) -> bool {
        matches!(&self.own, Own::Rebalance(law) if law.is_over(now))
    }

    /// Torque and toes, and whose they are.
    pub(super) fn step(
        &mut self,
        now: Stamp,
        e: &Estimate,
        seen: &Snapshot,
        speed_m_s: f64,
        motion: Motion,
    ) -> (Wish, LawName) {
        let elastic = e;
        let e = &self.compliance.slow(elastic);
        if self.stance.replace(e.stance) != Some(e.stance) {
            self.choose(now, e, seen, speed_m_s, motion);
        } else if self.in_charge && falls_back(e) {
            // No gait that goes forward catches it; a step backwards does.
            self.placement.take_over(now, e, seen);
            self.in_charge = false;
        }
        let (mut wish, law) = match &mut self.own {
            Own::Rebalance(law) => (law.step(now, e, seen), LawName::Tvlqr),
            Own::Virtual(law) if self.in_charge => {
                let wish = law.step(now, e, seen, speed_m_s, &mut self.placement.landing);
                (wish, LawName::VirtualConstraint)
            }
            Own::Transverse(law) if self.in_charge => {
                (law.step(now, e, seen, &mut self.placement.landing), LawName::Transverse)
            }
            Own::Placement | Own::Virtual(_) | Own::Transverse(_) => {
                (self.placement.step(now, e, seen, speed_m_s), LawName::FootPlacement)
            }
        };
        wish.hip_torque_nm += self.compliance.damping_nm(elastic);
        (wish, law)
    }

    /// At a touchdown: who is in charge of the step that begins.
    fn choose(&mut self, now: Stamp, e: &Estimate, seen: &Snapshot, speed_m_s: f64, motion: Motion) {
        let own = motion == Motion::Walk
            && match &self.own {
                Own::Placement | Own::Rebalance(_) => false,
                Own::Virtual(_) => VirtualConstraint::holds(e, speed_m_s, &self.placement.landing),
                Own::Transverse(law) => law.holds(e, self.in_charge),
            };
        if own && !self.in_charge {
            self.join();
        } else if !own && self.in_charge {
            self.placement.join(now, e, seen);
        }
        self.in_charge = own;
    }
}
