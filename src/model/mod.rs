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
//! RT: yes, no allocation.

pub mod compass_gait;
pub mod energy;
