//! What a tick costs: the walk without a controller (framework), with each controller, and the hand-over of its record.
//!
//! The inputs are those of a real run: the simulated robot balancing in lockstep. RT: no (the measured step is).

use std::time::Instant;

use super::our_chain::Step;
use super::window::{PERCENTILES, Window};
use crate::channel::ring::Ring;
use crate::config::checked::{Config, ControllerKind};
use crate::msg::{TickInput, TickOutput, TickRecord};
use crate::report::table::{Align, Table};
use crate::rt::tick::{Tick, TickError};
use crate::sim::lockstep::{Lockstep, LockstepError};

/// The cost could not be measured.
#[derive(Debug, thiserror::Error)]
pub enum CostError {
    /// No tick for this configuration.
    #[error(transparent)]
    Tick(#[from] TickError),
    /// No robot for it.
    #[error(transparent)]
    Lockstep(#[from] LockstepError),
}

/// One line of the table.
#[derive(Clone, Debug)]
pub struct Cost {
    /// What was timed.
    pub title: &'static str,
    /// Goal at each of [`PERCENTILES`], us.
    pub goals_us: [Option<f64>; 4],
    /// The samples.
    pub window: Window,
}

/// All lines.
#[derive(Clone, Debug, Default)]
pub struct Costs(pub Vec<Cost>);

impl Costs {
    /// A row per line and percentile.
    #[must_use]
    pub fn table(&self) -> Table {
        let columns = [("cost", Align::Left), ("percentile", Align::Right), ("us", Align::Right)];
        let mut table = Table::new(&[&columns[..], &[("goal, us", Align::Right), ("", Align::Left)]].concat());
        for cost in &self.0 {
            for (percent, goal) in PERCENTILES.into_iter().zip(cost.goals_us) {
                let us = cost.window.percentile_us(percent);
                table.push([
                    cost.title.to_owned(),
                    format!("{percent}"),
                    format!("{us:.3}"),
                    goal.map_or_else(String::new, |g| format!("{g}")),
                    goal.map_or("", |g| if us <= g { "reached" } else { "not reached" }).to_owned(),
                ]);
            }
        }
        table
    }
}

/// Times every line over `ticks` ticks of a simulated run.
///
/// # Errors
/// If the configuration does not run in simulation, or shared memory cannot be used.
pub fn all(config: &Config, ticks: usize) -> Result<Costs, CostError> {
    let inputs = recorded_inputs(config, ticks)?;
    let step = [None, Some(100.0), Some(100.0), Some(100.0)];
    let framework = [Some(2.0), None, Some(10.0), None];
    let mut costs = Costs::default();
    for (title, controller, goals_us) in [
        ("tick without controller (framework and observer)", ControllerKind::Idle, framework),
        ("tick with hold", ControllerKind::Hold, step),
        ("tick with balance", ControllerKind::Balance, step),
    ] {
        costs.0.push(Cost { title, goals_us, window: steps(config, controller, &inputs)? });
    }
    let goals_us = [None, None, Some(0.2), None];
    costs.0.push(Cost { title: "hand-over of a tick's record", goals_us, window: hand_over(inputs.len()) });
    Ok(costs)
}

fn recorded_inputs(config: &Config, ticks: usize) -> Result<Vec<TickInput>, LockstepError> {
    let mut run = Lockstep::new(config)?;
    let mut inputs = Vec::with_capacity(ticks);
    for _ in 0..ticks {
        inputs.push(run.step().input);
    }
    Ok(inputs)
}

fn steps(config: &Config, controller: ControllerKind, inputs: &[TickInput]) -> Result<Window, TickError> {
    let mut config = config.clone();
    config.control.controller = controller;
    let (mut tick, mut record) = (Tick::new(&config)?, TickRecord::default());
    let timed = inputs.iter().map(|input| {
        let start = Instant::now();
        tick.step(input, &mut record);
        start.elapsed().as_secs_f64() * 1e6
    });
    Ok(Window::new(timed.collect()))
}

fn hand_over(count: usize) -> Window {
    let ring = Ring::new(8);
    let record = TickRecord::default();
    let timed = (0..count).map(|_| {
        let start = Instant::now();
        ring.push(&record);
        let spent = start.elapsed().as_secs_f64() * 1e6;
        std::hint::black_box(ring.pop());
        spent
    });
    Window::new(timed.collect())
}

/// A tick of this configuration that sees nothing, for the wake-up bench: the least that our thread ever does.
///
/// # Errors
/// If the configuration has no tick.
pub fn idle_step(config: &Config) -> Result<impl FnMut() + Send + use<>, TickError> {
    let mut step = idle_output(config)?;
    let mut input = TickInput::default();
    Ok(move || {
        input.index += 1;
        std::hint::black_box(step(&input));
    })
}

/// The same as a step of [`super::our_chain`].
///
/// # Errors
/// If the configuration has no tick.
pub fn idle_output(config: &Config) -> Result<Step, TickError> {
    let (mut tick, mut record) = (Tick::new(config)?, Box::<TickRecord>::default());
    Ok(Box::new(move |input: &TickInput| -> TickOutput {
        tick.step(input, &mut record);
        record.output
    }))
}
