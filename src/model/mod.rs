//! L1: machines as equations, generic in the scalar. No time, no input or output.
//!
//! # Frames and signs of the compass gait
//! ```text
//!          y ^      o  body at hip + lc3 d(θb)
//!            |      |
//!            |     hip        d(θ) = (-sin θ, cos θ): direction toe → hip of a leg
//!            |    /   \       θ > 0: hip to the left of the toe (counter-clockwise)
//!            |  θs     θw     stance leg first: q = [θs, θw], body θb = (θs + θw)/2, σ = θs - θw
//!            | /         \
//!            *----------- * ---> x   walking in +x: the stance angle goes from + to -
//!          stance toe   swing toe
//! ```
//! Hip torque τ: +τ on the stance row, -τ on the swing row. The motor's own sign is fixed to the legs (+ on inner),
//! so `τ = +τ_m` when the inner leg stands and `τ = -τ_m` when the outer leg stands.
//!
//! # The other mechanisms
//! - `pendulum`: `q1` from hanging straight down, + counter-clockwise. `slider`: `q1` position in m.
//! - `double_pendulum`: `q1` from hanging down, `q2` of link 2 relative to link 1.
//!
//! # Map
//! [`rig`] is a model file (mechanism, parameters, actuators, sensors, effects, recordings); [`effect`] the catalogue;
//! [`compass_gait`] the walking robot's equations; [`energy`] serves the laws.
//! RT: yes, no allocation; but reading and writing rig files is not.

pub mod compass_gait;
pub mod effect;
pub mod energy;
pub mod machine;
pub mod mechanism;
pub mod resonance;
pub mod rig;
pub mod setting;
