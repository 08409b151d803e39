//! Long signals on short paper: per column of pixels the extremes, so that no spike is lost. RT: no.

/// Runs of points in pixels (a run ends at a gap), at most four points per column of `width_px`.
pub(super) fn runs(points: impl Iterator<Item = Option<(f64, f64)>>, width_px: f64) -> Vec<Vec<(f64, f64)>> {
    let mut runs = vec![Vec::new()];
    for point in points {
        match point {
            Some(point) => {
                if let Some(run) = runs.last_mut() {
                    run.push(point);
                }
            }
            None => runs.push(Vec::new()),
        }
    }
    let longest = 2.0 * width_px;
    let total: usize = runs.iter().map(Vec::len).sum();
    let thin = |run: Vec<(f64, f64)>| if total as f64 > longest { by_column(&run) } else { run };
    runs.into_iter().filter(|run| !run.is_empty()).map(thin).collect()
}

/// First, lowest, highest and last point of every column, in order.
fn by_column(run: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let columns = run.chunk_by(|a, b| same_column(a.0, b.0));
    columns.flat_map(extremes).collect()
}

fn same_column(a: f64, b: f64) -> bool {
    (a.floor() - b.floor()).abs() < 0.5
}

fn extremes(column: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let by = |better: fn(f64, f64) -> bool| {
        (1..column.len()).fold(0, |best, i| if better(column[i].1, column[best].1) { i } else { best })
    };
    let mut keep = vec![0, by(|a, b| a < b), by(|a, b| a > b), column.len() - 1];
    keep.sort_unstable();
    keep.dedup();
    keep.into_iter().map(|i| column[i]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_single_spike_survives() {
        let points = (0..100_000).map(|i| Some((f64::from(i) * 1e-3, if i == 54_321 { 9.0 } else { 0.0 })));
        let runs = runs(points, 100.0);
        assert_eq!(runs.len(), 1);
        assert!(runs[0].len() <= 400, "{}", runs[0].len());
        assert!(runs[0].iter().any(|p| p.1 > 8.0));
    }

    #[test]
    fn a_gap_splits_the_line() {
        let points = [Some((0.0, 0.0)), None, Some((1.0, 0.0)), Some((2.0, 0.0))];
        assert_eq!(runs(points.into_iter(), 100.0).iter().map(Vec::len).collect::<Vec<_>>(), [1, 2]);
    }
}
