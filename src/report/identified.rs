//! What an identification found, as plain data with its tables: for the terminal and for the page. RT: no.

use super::findings::{Estimate, Figure, Trace};
use super::interval::{interval, value};
use super::table::{Align, Table, number};
use serde::Serialize;
use std::collections::BTreeMap;

/// What decides the value of a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DecidedBy {
    /// The recordings.
    Data,
    /// The recordings, and they pull it to a bound.
    Bound,
    /// Its bounds: the recordings say less about it than they do.
    Nothing,
}

/// One fitted number.
#[derive(Clone, Debug, PartialEq)]
pub struct Line {
    /// Name, for example `inertia_kg_m2` or `viscous_friction@q1.viscous`.
    pub name: String,
    /// As given in the rig.
    pub given: f64,
    /// As fitted.
    pub fitted: Estimate,
    /// What decides it.
    pub decided_by: DecidedBy,
}

/// Everything that an identification tells.
#[derive(Clone, Debug)]
pub struct Identified {
    /// Name of the rig.
    pub rig: String,
    /// One or two sentences.
    pub headline: String,
    /// Fitted numbers.
    pub lines: Vec<Line>,
    /// Combinations that the data does not determine, and which experiment would.
    pub undetermined: Vec<String>,
    /// Free-run errors; `explained` repeats `refitted`.
    pub figures: Vec<Figure>,
    /// Measured and simulated signals.
    pub traces: Vec<Trace>,
    /// What was odd in the input.
    pub warnings: Vec<String>,
}

/// `identified.json`: the numbers for programs.
#[derive(Clone, Debug, Serialize)]
pub struct Summary<'f> {
    /// Value and standard deviation by name.
    pub parameters: BTreeMap<&'f str, Estimate>,
    /// Free-run errors; `nrmse_refitted` is that of the fitted model.
    pub fit: &'f [Figure],
}

impl Identified {
    /// What `identified.json` says.
    #[must_use]
    pub fn summary(&self) -> Summary<'_> {
        let parameters = self.lines.iter().map(|line| (line.name.as_str(), line.fitted)).collect();
        Summary { parameters, fit: &self.figures }
    }

    /// The fitted numbers with their intervals.
    #[must_use]
    pub fn parameters(&self) -> Table {
        let right = Align::Right;
        let mut table = Table::new(&[
            ("parameter", Align::Left),
            ("given", right),
            ("fitted", right),
            ("95 % interval", right),
            ("unit", Align::Left),
            ("", Align::Left),
        ]);
        for line in &self.lines {
            let [fitted, interval, note] = line.cells();
            let unit = line.fitted.unit.to_owned();
            table.push([line.name.clone(), number(line.given), fitted, interval, unit, note]);
        }
        table.without_empty_columns()
    }

    /// The errors of the free runs.
    #[must_use]
    pub fn errors(&self) -> Table {
        let mut table = Table::new(&[
            ("recording", Align::Left),
            ("use", Align::Left),
            ("channel", Align::Left),
            ("given", Align::Right),
            ("fitted", Align::Right),
        ]);
        for f in &self.figures {
            let tell = |x: f64| if x.is_finite() { number(x) } else { "ran away".to_owned() };
            let figures = [f.nrmse_given, f.nrmse_refitted].map(tell);
            table.push([f.recording.clone(), f.use_.clone(), f.channel.clone()].into_iter().chain(figures));
        }
        table
    }
}

impl Line {
    fn cells(&self) -> [String; 3] {
        let value = value(&self.fitted);
        match self.decided_by {
            DecidedBy::Data => [value, interval(&self.fitted), String::new()],
            DecidedBy::Bound => [value, interval(&self.fitted), "at its bound".to_owned()],
            DecidedBy::Nothing => {
                [number(self.fitted.value), String::new(), "not determined: its bounds decide".to_owned()]
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_that_only_its_bounds_decide_shows_no_interval() {
        let line =
            |decided_by| Line { name: "gain@u".into(), given: 1.0, fitted: Estimate::normal(0.9, 0.02), decided_by };
        assert_eq!(line(DecidedBy::Data).cells(), ["0.900", "0.861 to 0.939", ""].map(str::to_owned));
        assert_eq!(line(DecidedBy::Nothing).cells()[1], "");
    }
}
