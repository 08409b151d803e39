//! A rig fitted to the recordings: one hypothesis of what the machine is, with its misfit.
//!
//! RT: no.

use crate::identify::covariance::{Knowledge, knowledge};
use crate::identify::fit::{Fit, Limits, Point, fit};
use crate::identify::likelihood::{Residuals, blocks, colours};
use crate::identify::noise::Colour;
use crate::identify::problem::Problem;
use crate::identify::sampling::one_row_later;
use crate::model::rig::Rig;
use nalgebra::{DMatrix, DVector};
use std::sync::Arc;

/// A fitted rig.
#[derive(Clone, Debug)]
pub struct FittedModel {
    /// The rig with its fitted numbers.
    pub rig: Rig,
    /// The problem that it solves.
    pub problem: Problem,
    /// Where it stands.
    pub point: Point,
    /// Residuals there.
    pub residuals: Residuals,
    /// Noise as these residuals show it.
    pub noise: Vec<Colour>,
    /// Twice the log-likelihood under that noise.
    pub likelihood: f64,
    /// Inverse covariance of the shared parameters: the reduced normal matrix of the fit, or better once
    /// [`Self::with_intervals`] was asked.
    pub information: DMatrix<f64>,
    /// How far the shared parameters move when commands act, or a sensor reads, a row later; empty until
    /// [`Self::with_intervals`] was asked.
    pub row_shifts: Vec<DVector<f64>>,
}

impl FittedModel {
    /// Fits `problem` from `start` under `noise`. `None` if the runs leave the finite numbers.
    #[must_use]
    pub fn fitted(problem: Problem, start: Point, noise: &[Colour], floors: &[f64], limits: Limits) -> Option<Self> {
        let bounds = problem.bounds();
        let Fit { point, cost, information: normal, .. } = fit(&problem, start, &bounds, noise, limits);
        if !cost.is_finite() {
            return None;
        }
        Self::at(problem, point, normal, floors)
    }

    /// The hypothesis at a point that is already known.
    #[must_use]
    pub fn at(problem: Problem, point: Point, information: DMatrix<f64>, floors: &[f64]) -> Option<Self> {
        let residuals = problem.residuals(&point)?;
        let noise = colours(&residuals, floors, &problem.rig, problem.longest_memory);
        let likelihood = blocks(&residuals, &noise).iter().sum();
        let rig = problem.rig_at(&point.parameters);
        Some(Self { rig, problem, point, residuals, noise, likelihood, information, row_shifts: Vec::new() })
    }

    /// The same, its work counted with that of `other`.
    #[must_use]
    pub fn counted_with(&self, other: &Self) -> Self {
        let problem = Problem { effort: Arc::clone(&other.problem.effort), ..self.problem.clone() };
        Self { problem, ..self.clone() }
    }

    /// Effort of one linearisation. Only a run knows its steps: it carries two numbers for each coordinate, a linearisation
    /// its directions as well.
    #[must_use]
    pub fn cost_of_linearisation(&self) -> u64 {
        let problem = self.problem.clone().with_allowance(u64::MAX);
        let directions = self.point.parameters.len() + self.point.states.first().map_or(0, Vec::len);
        let ran = problem.residuals(&self.point).is_some();
        u64::from(ran) * problem.effort.spent() * (directions as u64 + 2) / 2
    }

    /// Fits on from here under another noise.
    #[must_use]
    pub fn polished(&self, noise: &[Colour], floors: &[f64], limits: Limits) -> Option<Self> {
        Self::fitted(self.problem.clone(), self.point.clone(), noise, floors, limits)
    }

    /// The same with the information that intervals need: for answers, not for every fit on the way (one linearisation and a few runs).
    #[must_use]
    pub fn with_intervals(mut self) -> Self {
        let changes = one_row_later(&self.problem, &self.point);
        let widths: Vec<f64> = self.problem.bounds().iter().map(|b| b.max - b.min).collect();
        let better = knowledge(&self.problem, &self.point, &self.noise, (&changes, &widths));
        if let Some(Knowledge { information, shifts }) = better {
            self.information = information;
            self.row_shifts = shifts;
        }
        self
    }

    /// Samples that carry weight.
    #[must_use]
    pub fn samples(&self) -> usize {
        let has_weight = |colour: &Colour| colour.sigma.is_finite();
        let counted = self.residuals.iter().zip(&self.noise).filter(|(_, colour)| has_weight(colour));
        counted.map(|(runs, _)| runs.iter().map(Vec::len).sum::<usize>()).sum()
    }

    /// Twice the log-likelihood per block under a given noise.
    #[must_use]
    pub fn blocks(&self, noise: &[Colour]) -> Vec<f64> {
        blocks(&self.residuals, noise)
    }

    /// The same on some of the windows.
    #[must_use]
    pub fn on_windows(&self, kept: &[usize]) -> Self {
        let residuals: Residuals =
            self.residuals.iter().map(|runs| kept.iter().map(|w| runs[*w].clone()).collect()).collect();
        let states = kept.iter().map(|w| self.point.states[*w].clone()).collect();
        Self {
            problem: self.problem.on_windows(kept),
            point: Point { parameters: self.point.parameters.clone(), states },
            likelihood: blocks(&residuals, &self.noise).iter().sum(),
            residuals,
            rig: self.rig.clone(),
            noise: self.noise.clone(),
            information: self.information.clone(),
            row_shifts: self.row_shifts.clone(),
        }
    }

    /// A problem for another rig (this one with an effect more or less), started where this one stands.
    #[must_use]
    pub fn extended(&self, rig: Rig) -> (Problem, Point) {
        let problem = self.problem.with_rig(rig);
        let states = problem.adapted(&self.point);
        let parameters = problem.vector();
        (problem, Point { parameters, states })
    }
}
