//! Direct collocation: a [`Problem`](crate::design::problem::Problem) becomes a program, Hermite-Simpson in its compressed form. RT: no.
//!
//! Unknowns are the states and torques at the knots, the torques at the midpoints and the durations; the midpoint's
//! state follows from its neighbours: `x_m = (x0 + x1)/2 + h/8 (f0 - f1)`, and the defect is
//! `x1 - x0 - h/6 (f0 + 4 f_m + f1)`. Source: Hargraves, Paris 1987; Betts 2010, 4.5.
//!
//! - `layout`: which unknown stands where
//! - `point`, [`rows`], `terminal`, `clearance`: what is evaluated, and what it is called
//! - `values`: costs and residuals, for the line search
//! - `assemble`: exact gradients, Jacobians and the Hessian of the Lagrangian
//! - `program`: the two as an [`crate::design::nlp::Nlp`]
//!
//! Derivatives are exact: second-order numbers ([`crate::base::jet`]) at every point, the chain through the midpoint by
//! hand. Clearance is asked for at knots only.

mod assemble;
mod clearance;
mod guess;
mod layout;
mod point;
mod program;
pub mod rows;
mod terminal;
mod values;

pub use guess::guess;
pub use program::Program;

#[cfg(test)]
mod tests;
