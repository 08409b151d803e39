//! Score test of additions to a fitted model: how much would the misfit fall if this signal were added, with all base
//! parameters and initial states free to follow?
//!
//! The whitened residual and sensitivities of the base solution are kept; a candidate is one or several columns (its
//! response at zero strength). What base parameters and initial states could mimic is projected out first, so a good
//! overlay by a wrong base cannot hide it nor can it claim what the base explains.
//! RT: no.

use crate::base::linalg::inner_product;
use crate::identify::fit::{FreeRuns, Point, Series, present};
use crate::identify::noise::{Colour, weight};
use nalgebra::{DMatrix, DVector};
use rayon::prelude::*;
use std::ops::AddAssign;

/// Response of all windows to one unit of a candidate: per window, per channel, per row. An empty window is zero.
pub type Column = Vec<Vec<Vec<f64>>>;

/// Responses of one window alone, each with an amplitude of its own (what rings from before it): per response, per
/// channel, per row.
pub type Own = Vec<Vec<Vec<f64>>>;

/// Whitened misfit and sensitivities of the base solution.
pub struct ScoreTest {
    windows: Vec<Window>,
    noise: Vec<Colour>,
    /// Reduced normal matrix of the shared parameters, and its inverse.
    normal: DMatrix<f64>,
    inverse: DMatrix<f64>,
    gradient: DVector<f64>,
    shared: usize,
}

struct Window {
    channels: Vec<Channel>,
    px: DMatrix<f64>,
    xx_inverse: DMatrix<f64>,
    gx: DVector<f64>,
}

struct Channel {
    rows: Vec<usize>,
    length: usize,
    /// Root of the robust weight per present row.
    root: Vec<f64>,
    residual: Vec<f64>,
    /// Shared parameters, then states; per present row.
    slopes: Vec<Vec<f64>>,
}

/// What a set of columns would gain.
#[derive(Clone, Debug)]
pub struct Score {
    /// Fall of the sum of squares of the whitened residual.
    pub gain: f64,
    /// Best amplitude of each column, as an addition to the simulation.
    pub amplitudes: Vec<f64>,
    /// The same of columns that are known beforehand to be about as large as the best determined of them: what the recordings do
    /// not tell is nothing then, not anything.
    pub shrunken: Vec<f64>,
    /// Standard deviation of each amplitude for unit innovations.
    pub deviations: Vec<f64>,
}

impl Channel {
    fn new(series: Series, colour: &Colour) -> Self {
        let rows = if colour.sigma > 0.0 && colour.sigma.is_finite() { present(&series) } else { Vec::new() };
        let length = series.residual.len();
        let mut all = series.residual;
        colour.whiten(&mut all, &rows);
        let root: Vec<f64> = rows.iter().map(|k| libm::sqrt(weight(all[*k]))).collect();
        let pick = |s: &[f64]| -> Vec<f64> { rows.iter().zip(&root).map(|(k, w)| s[*k] * w).collect() };
        let residual = pick(&all);
        let slopes = series
            .slopes
            .into_iter()
            .map(|mut slope| {
                colour.whiten(&mut slope, &rows);
                pick(&slope)
            })
            .collect();
        Self { rows, length, root, residual, slopes }
    }

    fn whiten(&self, colour: &Colour, column: &[f64]) -> Vec<f64> {
        let mut all = column.to_vec();
        all.resize(self.length, 0.0);
        colour.whiten(&mut all, &self.rows);
        self.rows.iter().zip(&self.root).map(|(k, w)| all[*k] * w).collect()
    }
}

impl Window {
    fn new(
        channels: Vec<Series>,
        noise: &[Colour],
        shared: usize,
        states: usize,
    ) -> (Self, DMatrix<f64>, DVector<f64>) {
        let channels: Vec<Channel> = channels.into_iter().zip(noise).map(|(s, c)| Channel::new(s, c)).collect();
        let entry = |a: usize, b: usize| {
            channels
                .iter()
                .filter(|c| !c.rows.is_empty())
                .map(|c| inner_product(&c.slopes[a], &c.slopes[b]))
                .sum::<f64>()
        };
        let slope = |a: usize| {
            channels
                .iter()
                .filter(|c| !c.rows.is_empty())
                .map(|c| inner_product(&c.slopes[a], &c.residual))
                .sum::<f64>()
        };
        let px = DMatrix::from_fn(shared, states, |a, b| entry(a, shared + b));
        let mut xx = DMatrix::from_fn(states, states, |a, b| entry(shared + a, shared + b));
        let gx = DVector::from_fn(states, |a, _| slope(shared + a));
        let largest = xx.diagonal().iter().copied().fold(0.0, f64::max);
        for i in 0..states {
            xx[(i, i)] += largest * 1e-12 + 1e-300;
        }
        let xx_inverse = xx.cholesky().map_or_else(|| DMatrix::zeros(states, states), |c| c.inverse());
        let pp = DMatrix::from_fn(shared, shared, entry) - &px * &xx_inverse * px.transpose();
        let gp = DVector::from_fn(shared, |a, _| slope(a)) - &px * &xx_inverse * &gx;
        (Self { channels, px, xx_inverse, gx }, pp, gp)
    }
}

impl ScoreTest {
    /// The screen at a solution of the base. `None` if a run there leaves the finite numbers.
    pub fn new(runs: &impl FreeRuns, at: &Point, noise: &[Colour]) -> Option<Self> {
        let shared = at.parameters.len();
        let one = |w: usize| {
            let channels = runs.run(w, &at.parameters, &at.states[w], true)?;
            Some(Window::new(channels, noise, shared, at.states[w].len()))
        };
        let parts: Vec<_> = (0..runs.windows()).into_par_iter().map(one).collect::<Option<_>>()?;
        let (mut pp, mut gp, mut windows) = (DMatrix::zeros(shared, shared), DVector::zeros(shared), Vec::new());
        for (window, p, g) in parts {
            pp += p;
            gp += g;
            windows.push(window);
        }
        let inverse = pseudo_inverse(&pp, 1e-10);
        Some(Self { windows, noise: noise.to_vec(), normal: pp, inverse, gradient: gp, shared })
    }

    /// What adding `columns` together would gain, everything else following.
    #[must_use]
    pub fn score(&self, columns: &[Column]) -> Score {
        self.score_beside(columns, &[])
    }

    /// What adding `columns` would gain beside responses of single windows, everything else following. `own`: those of
    /// each window, or nothing at all; their gain counts, their amplitudes are not told.
    #[must_use]
    pub fn score_beside(&self, columns: &[Column], own: &[Own]) -> Score {
        let n = columns.len();
        let Projected { normal, gradient, apart } = self.projected(columns, own);
        let inverse = pseudo_inverse(&normal, 1e-9);
        let amplitudes = -(&inverse * &gradient);
        Score {
            gain: apart - amplitudes.dot(&gradient),
            shrunken: shrunken(&normal, &gradient, &amplitudes).iter().copied().collect(),
            deviations: (0..n).map(|i| libm::sqrt(inverse[(i, i)].max(0.0))).collect(),
            amplitudes: amplitudes.iter().copied().collect(),
        }
    }

    /// Fall of the sum of squares if the simulation moved by the first of `columns`, as it is, by the others times
    /// amplitudes within `bounds`, and by `own` responses of the windows (or none).
    #[must_use]
    pub fn promise(&self, columns: &[Column], own: &[Own], bounds: &[(f64, f64)]) -> f64 {
        let free: Vec<usize> = (1..columns.len()).collect();
        Joint(self.projected(columns, own)).promise(&[0], &free, bounds)
    }

    /// What all of `columns` say of one another, everything else following: of some of them a promise then costs next to nothing.
    #[must_use]
    pub fn joint(&self, columns: &[Column]) -> Joint {
        Joint(self.projected(columns, &[]))
    }

    /// Squares of `column` as it is, what everything else mimics taken out of it, and the fall of the sum of squares if the
    /// simulation moved by it: as much where it is the truth.
    #[must_use]
    pub fn as_it_is(&self, column: &Column) -> (f64, f64) {
        let Projected { normal, gradient, .. } = self.projected(std::slice::from_ref(column), &[]);
        (normal[(0, 0)], -2.0 * gradient[0] - normal[(0, 0)])
    }

    /// Normal equations of `columns` with all base parameters, initial states and `own` responses projected out.
    fn projected(&self, columns: &[Column], own: &[Own]) -> Projected {
        let mut sums = Sums::new(columns.len(), self.shared);
        let none = Own::new();
        let one = |w: usize| self.projected_window(w, columns, own.get(w).unwrap_or(&none));
        let parts: Vec<_> = (0..self.windows.len()).into_par_iter().filter_map(one).collect();
        for part in &parts {
            sums.add(part);
        }
        let Sums { cc, cp, gc, full, less_pp, less_gp, mut apart } = sums;
        let (inverse, gradient) = if own.is_empty() {
            (self.inverse.clone(), self.gradient.clone())
        } else {
            // What the windows' own responses explain is no longer for the shared parameters to explain.
            let (inverse, gradient) = (pseudo_inverse(&(&self.normal - less_pp), 1e-10), &self.gradient - less_gp);
            let fall = |i: &DMatrix<f64>, g: &DVector<f64>| g.dot(&(i * g));
            apart += fall(&inverse, &gradient) - fall(&self.inverse, &self.gradient);
            (inverse, gradient)
        };
        let mut normal = cc - &cp * &inverse * cp.transpose();
        let gradient = gc - &cp * &inverse * &gradient;
        for i in 0..columns.len() {
            // A column that the base mimics to 1 part in 1e8 carries rounding only.
            normal[(i, i)] += 1e-8 * full[i] + 1e-300;
        }
        Projected { normal, gradient, apart }
    }

    /// What window number `w` says about `columns`, its initial state and `own` responses projected out; nothing if none of
    /// them lives there.
    fn projected_window(&self, w: usize, columns: &[Column], own: &Own) -> Option<Part> {
        let window = &self.windows[w];
        let active: Vec<usize> = (0..columns.len()).filter(|i| !columns[*i][w].is_empty()).collect();
        let responses: Vec<&Vec<Vec<f64>>> = active.iter().map(|i| &columns[*i][w]).chain(own).collect();
        if responses.is_empty() {
            return None;
        }
        let Seen { mut rr, mut rp, rx, mut gr } = self.seen(window, &responses);
        let reach = &rx * &window.xx_inverse;
        rr -= &reach * rx.transpose();
        rp -= &reach * window.px.transpose();
        gr -= &reach * &window.gx;
        let count = active.len();
        let full = (0..count).map(|a| rr[(a, a)]).collect();
        let mut less = None;
        if !own.is_empty() {
            let inverse = own_inverse(rr.view((count, count), (own.len(), own.len())).into_owned());
            let (op, go) = (rp.rows(count, own.len()).into_owned(), gr.rows(count, own.len()).into_owned());
            let reach = rr.view((0, count), (count, own.len())) * &inverse;
            let pp = op.transpose() * &inverse * &op;
            less = Some(Less { pp, gp: op.transpose() * &inverse * &go, apart: go.dot(&(&inverse * &go)) });
            let lost = &reach * rr.view((count, 0), (own.len(), count));
            rr.view_mut((0, 0), (count, count)).add_assign(-lost);
            rp.rows_mut(0, count).add_assign(-(&reach * &op));
            gr.rows_mut(0, count).add_assign(-(&reach * &go));
        }
        Some(Part { active, rr, rp, gr, full, less })
    }

    /// Products of whitened `responses` of a window with one another, with its sensitivities and with its residual.
    fn seen(&self, window: &Window, responses: &[&Vec<Vec<f64>>]) -> Seen {
        let (n, states) = (responses.len(), window.gx.len());
        let (mut rr, mut gr) = (DMatrix::zeros(n, n), DMatrix::zeros(n, 1));
        let (mut rp, mut rx) = (DMatrix::zeros(n, self.shared), DMatrix::zeros(n, states));
        for (c, channel) in window.channels.iter().enumerate().filter(|(_, c)| !c.rows.is_empty()) {
            let white: Vec<Vec<f64>> = responses.iter().map(|r| channel.whiten(&self.noise[c], &r[c])).collect();
            rr += products(&white, &white);
            let with_slopes = products(&white, &channel.slopes);
            rp += with_slopes.columns(0, self.shared);
            rx += with_slopes.columns(self.shared, states);
            gr += products(&white, std::slice::from_ref(&channel.residual));
        }
        Seen { rr, rp, rx, gr: gr.column(0).into_owned() }
    }
}

/// Signals from which on their products are taken as those of matrices, in blocks that stay in the cache.
const MATRIX: usize = 8;

/// Inner products of each signal of `a` with each of `b`, all of one length.
fn products(a: &[Vec<f64>], b: &[Vec<f64>]) -> DMatrix<f64> {
    let rows = a.first().map_or(0, Vec::len);
    if a.len().min(b.len()) < MATRIX {
        return DMatrix::from_fn(a.len(), b.len(), |i, j| inner_product(&a[i], &b[j]));
    }
    let beside = |signals: &[Vec<f64>]| DMatrix::from_vec(rows, signals.len(), signals.concat());
    beside(a).transpose() * beside(b)
}

/// Products of the responses of one window: with one another, with parameters, states and residual.
struct Seen {
    rr: DMatrix<f64>,
    rp: DMatrix<f64>,
    rx: DMatrix<f64>,
    gr: DVector<f64>,
}

/// Normal equations of columns, summed over the windows.
struct Sums {
    cc: DMatrix<f64>,
    cp: DMatrix<f64>,
    gc: DVector<f64>,
    /// Squares of each column before anything but the initial states follows.
    full: Vec<f64>,
    /// What the windows' own responses take from the equations of the shared parameters.
    less_pp: DMatrix<f64>,
    less_gp: DVector<f64>,
    /// Fall of the sum of squares by the windows' own responses.
    apart: f64,
}

impl Sums {
    fn new(columns: usize, shared: usize) -> Self {
        Self {
            cc: DMatrix::zeros(columns, columns),
            cp: DMatrix::zeros(columns, shared),
            gc: DVector::zeros(columns),
            full: vec![0.0; columns],
            less_pp: DMatrix::zeros(shared, shared),
            less_gp: DVector::zeros(shared),
            apart: 0.0,
        }
    }

    fn add(&mut self, part: &Part) {
        for (a, i) in part.active.iter().enumerate() {
            self.full[*i] += part.full[a];
            self.gc[*i] += part.gr[a];
            for p in 0..part.rp.ncols() {
                self.cp[(*i, p)] += part.rp[(a, p)];
            }
            for (b, j) in part.active.iter().enumerate() {
                self.cc[(*i, *j)] += part.rr[(a, b)];
            }
        }
        if let Some(less) = &part.less {
            self.less_pp += &less.pp;
            self.less_gp += &less.gp;
            self.apart += less.apart;
        }
    }
}

/// Products of the columns that live in one window, everything of that window projected out.
struct Part {
    /// Which columns.
    active: Vec<usize>,
    rr: DMatrix<f64>,
    rp: DMatrix<f64>,
    gr: DVector<f64>,
    /// Squares of each, only the initial state projected out.
    full: Vec<f64>,
    less: Option<Less>,
}

/// What a window's own responses take from the equations of the shared parameters, and their fall of the sum of squares.
struct Less {
    pp: DMatrix<f64>,
    gp: DVector<f64>,
    apart: f64,
}

/// Inverse of the normal matrix of a window's own responses; what its initial state mimics stays out.
fn own_inverse(mut normal: DMatrix<f64>) -> DMatrix<f64> {
    for i in 0..normal.nrows() {
        normal[(i, i)] += 1e-8 * normal[(i, i)] + 1e-300;
    }
    pseudo_inverse(&normal, 1e-9)
}

/// Normal equations after projection.
struct Projected {
    normal: DMatrix<f64>,
    gradient: DVector<f64>,
    /// Fall of the sum of squares without any of the columns.
    apart: f64,
}

/// Columns projected together, of which some are asked at a time.
pub struct Joint(Projected);

impl Joint {
    /// Fall of the sum of squares if the simulation moved by the columns `as_they_are`, and by those that are `free` times amplitudes
    /// within `bounds`.
    #[must_use]
    pub fn promise(&self, as_they_are: &[usize], free: &[usize], bounds: &[(f64, f64)]) -> f64 {
        let Projected { normal, gradient, apart } = &self.0;
        // The first is the sum of those that are as they are.
        let members = |i: usize| if i == 0 { as_they_are } else { &free[i - 1..i] };
        let entry = |i: usize, j: usize| {
            let row = |a: &usize| members(j).iter().map(|b| normal[(*a, *b)]).sum::<f64>();
            members(i).iter().map(row).sum()
        };
        let normal = DMatrix::from_fn(free.len() + 1, free.len() + 1, entry);
        let slope = |i: usize, _: usize| members(i).iter().map(|a| gradient[*a]).sum();
        let gradient = DVector::from_fn(free.len() + 1, slope);
        let mut at = vec![1.0];
        at.extend(bounded_minimum(&normal, &gradient, bounds));
        let at = DVector::from_vec(at);
        apart - (2.0 * gradient.dot(&at) + at.dot(&(&normal * &at)))
    }
}

/// Minimum of the quadratic beside a prior that each amplitude is as large as `amplitudes` are in the mean, weighed by what is known
/// of each (ridge regression, Hoerl and Kennard 1970).
fn shrunken(normal: &DMatrix<f64>, gradient: &DVector<f64>, amplitudes: &DVector<f64>) -> DVector<f64> {
    let n = amplitudes.len();
    let known = normal.diagonal();
    let size = amplitudes.component_mul(amplitudes).dot(&known) / known.sum();
    if n < 2 || !(size > 0.0 && size.is_finite()) {
        return amplitudes.clone();
    }
    let prior = DMatrix::from_diagonal_element(n, n, 1.0 / size);
    (normal + prior).cholesky().map_or_else(|| amplitudes.clone(), |c| -c.solve(gradient))
}

/// The amplitudes beside the first (which is 1) that minimise the quadratic within their bounds: what would leave is
/// held at its bound and the rest is solved again.
fn bounded_minimum(normal: &DMatrix<f64>, gradient: &DVector<f64>, bounds: &[(f64, f64)]) -> Vec<f64> {
    let n = bounds.len();
    let mut held: Vec<Option<f64>> = vec![None; n];
    for _ in 0..=n {
        let free: Vec<usize> = (0..n).filter(|i| held[*i].is_none()).collect();
        let right = |i: usize| {
            let pulled: f64 = (0..n).filter_map(|j| held[j].map(|x| normal[(i + 1, j + 1)] * x)).sum();
            gradient[i + 1] + normal[(i + 1, 0)] + pulled
        };
        let a = DMatrix::from_fn(free.len(), free.len(), |r, c| normal[(free[r] + 1, free[c] + 1)]);
        let b = DVector::from_fn(free.len(), |r, _| -right(free[r]));
        let x = pseudo_inverse(&a, 1e-9) * b;
        let outside = |(r, i): (usize, &usize)| (x[r] < bounds[*i].0 || x[r] > bounds[*i].1).then_some((r, *i));
        let leaving: Vec<(usize, usize)> = free.iter().enumerate().filter_map(outside).collect();
        if leaving.is_empty() {
            for (r, i) in free.iter().enumerate() {
                held[*i] = Some(x[r]);
            }
            break;
        }
        for (r, i) in leaving {
            held[i] = Some(x[r].clamp(bounds[i].0, bounds[i].1));
        }
    }
    held.into_iter().map(|x| x.unwrap_or(0.0)).collect()
}

/// Inverse of a symmetric matrix, scaled to unit diagonal first; directions below `floor` are left out.
#[must_use]
pub fn pseudo_inverse(a: &DMatrix<f64>, floor: f64) -> DMatrix<f64> {
    let n = a.nrows();
    if n == 0 {
        return a.clone();
    }
    let scale: Vec<f64> = (0..n).map(|i| if a[(i, i)] > 0.0 { 1.0 / libm::sqrt(a[(i, i)]) } else { 0.0 }).collect();
    let unit = DMatrix::from_fn(n, n, |r, c| 0.5 * (a[(r, c)] + a[(c, r)]) * scale[r] * scale[c]);
    let eigen = unit.symmetric_eigen();
    let values = eigen.eigenvalues.map(|x| if x > floor { 1.0 / x } else { 0.0 });
    let inverse = &eigen.eigenvectors * DMatrix::from_diagonal(&values) * eigen.eigenvectors.transpose();
    DMatrix::from_fn(n, n, |r, c| inverse[(r, c)] * scale[r] * scale[c])
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A straight line through the origin plus, unknown to the model, a step at row 30.
    struct Line;

    impl FreeRuns for Line {
        fn windows(&self) -> usize {
            1
        }
        fn run(&self, _: usize, p: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
            let row = |k: usize| k as f64 * 0.1;
            let truth = |k: usize| 0.5 * row(k) + 2.0 + if k >= 30 { 0.3 } else { 0.0 };
            let residual = (0..60).map(|k| p[0] * row(k) + x[0] - truth(k)).collect();
            Some(vec![Series { residual, slopes: vec![(0..60).map(row).collect(), vec![1.0; 60]] }])
        }
    }

    fn step_at(row: usize) -> Column {
        vec![vec![(0..60).map(|k| if k >= row { 1.0 } else { 0.0 }).collect()]]
    }

    #[test]
    fn a_hidden_step_is_found_where_it_is_whatever_the_base_absorbed() {
        let at = Point { parameters: vec![0.55], states: vec![vec![1.9]] };
        let screen = ScoreTest::new(&Line, &at, &[Colour::white(1.0)]).unwrap();
        let best =
            (5..55).max_by(|a, b| screen.score(&[step_at(*a)]).gain.total_cmp(&screen.score(&[step_at(*b)]).gain));
        assert_eq!(best, Some(30));
        assert!((screen.score(&[step_at(30)]).amplitudes[0] - 0.3).abs() < 0.02); // robust weights bend it a little
    }

    #[test]
    fn promise_of_a_start_counts_the_move_and_what_follows() {
        let at = Point { parameters: vec![0.55], states: vec![vec![1.9]] };
        let screen = ScoreTest::new(&Line, &at, &[Colour::white(1.0)]).unwrap();
        let whole = screen.score(&[step_at(30)]).gain;
        let tenth: Column = vec![vec![step_at(30)[0][0].iter().map(|x| 0.1 * x).collect()]];
        let free = screen.promise(&[tenth.clone(), step_at(30)], &[], &[(-10.0, 10.0)]);
        assert!((free - whole).abs() < 1e-6 * whole, "{free} {whole}");
        let held = screen.promise(&[tenth, step_at(30)], &[], &[(0.0, 0.0)]);
        assert!(held > 0.0 && held < 0.8 * whole, "{held} {whole}");
    }

    #[test]
    fn responses_of_the_windows_own_count_like_columns_that_live_in_one_window() {
        let at = Point { parameters: vec![0.55], states: vec![vec![1.9]] };
        let screen = ScoreTest::new(&Line, &at, &[Colour::white(1.0)]).unwrap();
        let (step, bend) = (step_at(35), vec![(0..60).map(|k| f64::from(k * k)).collect()]);
        let together = screen.score(&[step.clone(), vec![bend.clone()]]);
        let apart = screen.score_beside(std::slice::from_ref(&step), &[vec![bend.clone()]]);
        assert!((together.gain - apart.gain).abs() < 1e-6 * together.gain, "{together:?} {apart:?}");
        assert!((together.amplitudes[0] - apart.amplitudes[0]).abs() < 1e-6 * together.amplitudes[0].abs());
        assert!((together.deviations[0] - apart.deviations[0]).abs() < 1e-6 * together.deviations[0]);
        let [a, b] = [vec![(-9.0, 9.0)], Vec::new()];
        let promised = screen.promise(&[step.clone(), vec![bend.clone()]], &[], &a);
        let beside = screen.promise(&[step], &[vec![bend]], &b);
        assert!((promised - beside).abs() < 1e-6 * promised.abs(), "{promised} {beside}");
    }

    #[test]
    fn many_products_are_those_of_each_two() {
        let signals = |count: usize| -> Vec<Vec<f64>> {
            (0..count).map(|i| (0..50).map(|k| libm::sin((i * k) as f64)).collect()).collect()
        };
        let (a, b) = (signals(MATRIX + 3), signals(MATRIX));
        let all = products(&a, &b);
        let is_right = |(i, j): (usize, usize)| (all[(i, j)] - inner_product(&a[i], &b[j])).abs() < 1e-12;
        assert!((0..a.len()).all(|i| (0..b.len()).all(|j| is_right((i, j)))));
    }

    #[test]
    fn what_the_base_can_mimic_gains_nothing() {
        let at = Point { parameters: vec![0.4], states: vec![vec![2.0]] };
        let screen = ScoreTest::new(&Line, &at, &[Colour::white(1.0)]).unwrap();
        let line: Column = vec![vec![(0..60).map(|k| 3.0 * k as f64 + 1.0).collect()]];
        assert!(screen.score(&[line]).gain < 1e-6);
    }
}
