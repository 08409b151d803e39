//! What a change of the stance leg does to the observer's state. RT: yes.

use super::high_gain::{StanceModel, State};
use crate::model::compass_gait::impact::{Ground, touchdown as impact};

/// The swing foot lands without slip and bounce, Thesis (4.11); then the labels change places.
///
/// A spring between rotor and legs passes no impulse, so the rotor keeps its rate while the legs jump; its angle is
/// counted in the sense of stance - swing, hence changes sign. `None` when the impact has no solution.
pub(super) fn touchdown(model: &StanceModel, x: &State) -> Option<State> {
    let [ts, tw, phi, vs, vw, vphi] = *x;
    let legs = model.hip.as_ref().map_or(&model.whole, |(legs, _)| legs);
    let [vs, vw, ..] = impact(legs, [ts, tw], [vs, vw, 0.0, 0.0], &Ground::RIGID)?.velocity;
    let vphi = if model.hip.is_some() { vphi } else { vs - vw };
    Some([tw, ts, -phi, vw, vs, -vphi])
}
