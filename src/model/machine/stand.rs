//! The commonest machine of all, quicker: one foot stands on a point, its toe as long as it is told, nothing is stuck.
//!
//! Foot and toes are eliminated instead of held by forces: `a_toe = (r cos θ, r sin θ) a_s + g`, with r what the leg is
//! shorter, leaves two equations for the legs. Rotors hang on springs and have their own. The forces of the ground follow
//! from the rows that were left out. Own derivation; `machine::tests` hold it against the equations with constraints.
//! RT: yes, no allocation.

use super::contact::Contact;
use super::foot::on_slope;
use super::hold::Holder;
use super::motion::{Phase, Plant, Work};
use crate::base::scalar::Scalar;
use crate::model::mechanism::Freedom;

impl<S: Scalar> Plant<S> {
    /// True if [`Self::stand`] holds.
    #[inline]
    pub(super) fn stands_on_a_point(&self) -> bool {
        let (ground, feet) = (&self.ground, &self.feet);
        let stands = feet.contact == Contact::Held && feet.second.is_none();
        let is_point = ground.radius.is_none() && ground.compliance.is_none();
        stands
            && is_point
            && !self.keeps_constraints
            && self.legs().is_some_and(|legs| legs.freedom() == Freedom::Floating)
            && self.structures.is_empty()
            && self.rotors.iter().all(|rotor| rotor.spring.is_some())
            && self.axes.iter().zip(&self.grips).all(|(axis, grip)| axis.slides(*grip) && !axis.is_soft())
    }

    /// Accelerations from the sum of all forces, and the forces of the ground.
    pub(super) fn stand(&self, y: &Phase<S>, work: &mut Work<S>) {
        let Some(legs) = self.legs() else { return };
        let (s, w) = (legs.stance(), 1 - legs.stance());
        let (m, f) = (&work.eq.mass, &work.eq.force);
        let (mut mss, mut msw, mww) = (m[s][s], m[s][w], m[w][w]);
        let (mut fs, mut fw) = (f[s], f[w]);
        let (mut lever, mut known) = ([S::zero(); 2], [S::zero(); 2]);
        if let Some(toes) = self.feet.toes {
            let (short, rate, acceleration) = (y.q[toes + s], y.v[toes + s], self.feet.toe_acceleration[s]);
            let (sin, cos) = work.eq.stance;
            let (centripetal, coriolis) = (short * y.v[s].square(), rate * y.v[s] * 2.0);
            lever = [short * cos, short * sin];
            known = [
                (acceleration - centripetal) * sin + coriolis * cos,
                (centripetal - acceleration) * cos + coriolis * sin,
            ];
            mss += (lever[0] * m[s][2] + lever[1] * m[s][3]) * 2.0 + legs.mass() * short.square();
            msw += lever[0] * m[w][2] + lever[1] * m[w][3];
            let (along, normal) = (f[2] - legs.mass() * known[0], f[3] - legs.mass() * known[1]);
            fs += lever[0] * along + lever[1] * normal - m[s][2] * known[0] - m[s][3] * known[1];
            fw -= m[w][2] * known[0] + m[w][3] * known[1];
            work.driven = toes..toes + 2;
            work.a[toes] = self.feet.toe_acceleration[0];
            work.a[toes + 1] = self.feet.toe_acceleration[1];
        }
        let per_det = S::one() / (mss * mww - msw.square());
        let (a_s, a_w) = ((fs * mww - fw * msw) * per_det, (fw * mss - fs * msw) * per_det);
        let toe = [lever[0] * a_s + known[0], lever[1] * a_s + known[1]];
        (work.a[s], work.a[w], work.a[2], work.a[3]) = (a_s, a_w, toe[0], toe[1]);
        for rotor in &self.rotors {
            work.a[rotor.index] = f[rotor.index] / rotor.inertia;
        }
        work.toe_bias = [f[2], f[3]];
        if work.held.wants_forces() {
            let force = |k: usize| m[s][k] * a_s + m[w][k] * a_w + legs.mass() * toe[k - 2] - f[k];
            let force = on_slope([force(2), force(3)], self.feet.rise);
            work.held.note(Holder::Tangent, force[0]);
            work.held.note(Holder::Normal, force[1]);
        }
    }
}
