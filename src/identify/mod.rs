//! L6: system identification by simulation error: rigs, recordings, free runs with sensitivities, fits.
//!
//! [`experiment`] reads a case, [`theta`] lists what is uncertain, [`rollout`] runs free and differentiates, [`fit`]
//! fits, [`covariance`] says how sure the numbers are, [`sampling`] what instants to a sample leave open, [`identifiability`]
//! what the data determines; [`units`] refuses readings in degrees.
//!
//! One model of a machine, fitted: [`base_fit`] (the rig as given, its numbers free), [`fitted_model`], [`initial_states`] of its
//! windows, [`outliers`], the [`likelihood`] of what it leaves, [`validation`] on recordings kept back; [`own`] makes a case of the
//! robot's own recordings. Which model is better says [`crate::diagnose`].
//! RT: no.

#[cfg(test)]
mod at_truth;
pub mod base_fit;
pub mod computed;
pub mod covariance;
pub mod effort;
pub mod experiment;
pub mod fit;
pub mod fitted_model;
pub mod floor;
pub mod horizon;
pub mod identifiability;
pub mod initial_states;
pub mod likelihood;
pub mod noise;
pub mod outliers;
pub mod own;
pub mod problem;
pub mod rollout;
pub mod sampling;
pub mod synthesis;
pub mod thesis;
pub mod theta;
#[cfg(test)]
pub(crate) mod true_case;
pub mod units;
pub mod validation;
