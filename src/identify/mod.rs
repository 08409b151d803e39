//! L6: system identification by simulation error: rigs, recordings, free runs with sensitivities, fits.
//!
//! [`experiment`] reads a case, [`theta`] lists what is uncertain, [`rollout`] runs free and differentiates, [`fit`]
//! fits, [`covariance`] says how sure the numbers are, [`sampling`] what instants to a sample leave open, [`identifiability`] what the data determines; [`units`] refuses
//! readings in degrees.
//! RT: no.

#[cfg(test)]
mod at_truth;
pub mod computed;
pub mod covariance;
pub mod effort;
pub mod experiment;
pub mod fit;
pub mod floor;
pub mod identifiability;
pub mod noise;
pub mod problem;
pub mod rollout;
pub mod sampling;
pub mod synthesis;
pub mod thesis;
pub mod theta;
#[cfg(test)]
pub(crate) mod true_case;
pub mod units;
