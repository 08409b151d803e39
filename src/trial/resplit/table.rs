//! A recording as a table of text: cut, thinned and disturbed without touching any other cell. RT: no.

use std::path::Path;

use super::write::{ResplitError, io};

/// Header and rows of a CSV file.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Table {
    /// Names of the columns.
    pub(super) header: Vec<String>,
    /// Cells.
    pub(super) rows: Vec<Vec<String>>,
}

impl Table {
    /// Reads a CSV file.
    pub(super) fn read(path: &Path) -> Result<Self, ResplitError> {
        let form = |error: csv::Error| ResplitError::Form { path: path.to_path_buf(), reason: error.to_string() };
        let mut reader = csv::Reader::from_path(path).map_err(form)?;
        let text = |record: &csv::StringRecord| record.iter().map(|cell| cell.trim().to_owned()).collect();
        let header = text(reader.headers().map_err(form)?);
        let rows = reader.records().map(|row| row.map(|row| text(&row))).collect::<Result<_, _>>().map_err(form)?;
        Ok(Self { header, rows })
    }

    /// Writes it.
    pub(super) fn write(&self, path: &Path) -> Result<(), ResplitError> {
        let lines = std::iter::once(&self.header).chain(&self.rows).map(|row| row.join(",") + "\n");
        io(path, std::fs::write(path, lines.collect::<String>()))
    }

    /// Number of a column.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.header.iter().position(|column| column == name)
    }

    /// Numbers of a column; missing cells are NaN.
    pub(super) fn numbers(&self, column: usize) -> Vec<f64> {
        self.rows.iter().map(|row| row.get(column).and_then(|cell| cell.parse().ok()).unwrap_or(f64::NAN)).collect()
    }

    /// True if time grows in every row: else it is no single run.
    pub(super) fn is_one_run(&self) -> bool {
        let times = self.column("t_s").map(|t| self.numbers(t)).unwrap_or_default();
        times.len() > 1 && times.windows(2).all(|t| t[1] > t[0])
    }

    /// Duration, s.
    pub(super) fn duration_s(&self) -> f64 {
        let times = self.column("t_s").map(|t| self.numbers(t)).unwrap_or_default();
        times.last().zip(times.first()).map_or(0.0, |(last, first)| last - first)
    }

    /// The rows of one half.
    pub(super) fn half(&self, second: bool) -> Self {
        let middle = self.rows.len() / 2;
        let rows = if second { self.rows[middle..].to_vec() } else { self.rows[..middle].to_vec() };
        Self { header: self.header.clone(), rows }
    }

    /// Every second row, from the first or the second on.
    pub(super) fn every_second(&self, from: usize) -> Self {
        Self { header: self.header.clone(), rows: self.rows.iter().skip(from).step_by(2).cloned().collect() }
    }

    /// Replaces the filled cells of a column.
    pub(super) fn change(&mut self, column: usize, mut to: impl FnMut(f64) -> f64) {
        for cell in self.rows.iter_mut().filter_map(|row| row.get_mut(column)) {
            if let Ok(x) = cell.parse::<f64>() {
                *cell = to(x).to_string();
            }
        }
    }
}

/// Standard deviation of what is white in a signal, by its second differences, robustly: motion that is smooth over
/// three samples does not count. Missing samples are left out.
pub(super) fn scatter(signal: &[f64]) -> f64 {
    let mut bends: Vec<f64> = signal.windows(3).map(|y| (y[0] - 2.0 * y[1] + y[2]).abs()).collect();
    bends.retain(|x| x.is_finite());
    if bends.is_empty() {
        return 0.0;
    }
    let middle = bends.len() / 2;
    // Of a normal density the median lies at 0.6745 standard deviations; second differences have six times the variance.
    *bends.select_nth_unstable_by(middle, f64::total_cmp).1 / (0.6745 * libm::sqrt(6.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp() -> Table {
        let rows = (0..9).map(|k| vec![k.to_string(), if k == 4 { String::new() } else { (2 * k).to_string() }]);
        Table { header: vec!["t_s".into(), "q".into()], rows: rows.collect() }
    }

    #[test]
    fn halves_hold_every_row_once_and_seconds_every_other() {
        let (a, b) = (ramp().half(false), ramp().half(true));
        assert_eq!([a.rows, b.rows].concat(), ramp().rows);
        assert_eq!(ramp().every_second(1).numbers(0), [1.0, 3.0, 5.0, 7.0]);
        assert!(ramp().is_one_run() && (ramp().duration_s() - 8.0).abs() < 1e-12);
    }

    #[test]
    fn missing_cells_stay_missing() {
        let mut table = ramp();
        table.change(1, |x| x + 0.5);
        assert!(table.rows[4][1].is_empty() && table.rows[5][1] == "10.5");
    }

    #[test]
    fn scatter_sees_noise_and_not_motion() {
        let smooth: Vec<f64> = (0..400).map(|k| libm::sin(0.01 * f64::from(k))).collect();
        assert!(scatter(&smooth) < 1e-4);
        let rough: Vec<f64> =
            smooth.iter().enumerate().map(|(k, x)| x + [0.1, -0.1, -0.1, 0.1][(k * k / 3) % 4]).collect();
        assert!((0.03..0.3).contains(&scatter(&rough)), "{}", scatter(&rough));
    }
}
