//! Scans of the library's linear effects over dense grids of shape: orders of ripple, instants of a push or of lost
//! counts; and the free curves that say whether a force goes with angle, rate or time at all.
//!
//! RT: no.

use crate::diagnose::screen::ltv::{LtvWindow, force_column, local_force, reading_column};
use crate::diagnose::screen::score_test::{Column, Own, Score, ScoreTest};
use crate::identify::fit::Series;
use rayon::prelude::*;

/// A hit of a scan: where on the grid, and what it gains.
#[derive(Clone, Debug)]
pub struct Hit<T> {
    /// Point of the grid.
    pub at: T,
    /// Gain and amplitudes there.
    pub score: Score,
}

fn best<T: Send>(hits: Vec<Hit<T>>) -> Option<Hit<T>> {
    hits.into_iter().max_by(|a, b| a.score.gain.total_cmp(&b.score.gain))
}

/// Orders of a torque that goes with `sin` and `cos` of `order * q`, best first. Amplitudes: sine, cosine.
#[must_use]
pub fn ripple(screen: &ScoreTest, windows: &[LtvWindow], joint: usize, orders: &[f64]) -> Vec<Hit<f64>> {
    let one = |order: &f64| {
        let wave = |shift: f64| force_column(windows, joint, move |w, k| libm::sin(order * w.states[k][joint] + shift));
        Hit { at: *order, score: screen.score(&[wave(0.0), wave(std::f64::consts::FRAC_PI_2)]) }
    };
    let mut hits: Vec<Hit<f64>> = orders.par_iter().map(one).collect();
    hits.sort_by(|a, b| b.score.gain.total_cmp(&a.score.gain));
    hits
}

/// A force that falls linearly with the coordinate: amplitudes of its slope and of its level at zero.
#[must_use]
pub fn linear(screen: &ScoreTest, windows: &[LtvWindow], joint: usize) -> Score {
    let level = force_column(windows, joint, |_, _| 1.0);
    screen.score(&[force_column(windows, joint, |w, k| -w.states[k][joint]), level])
}

/// Best instant of one push at `joint`: window and row. The amplitude is an impulse.
#[must_use]
pub fn push(screen: &ScoreTest, windows: &[LtvWindow], joint: usize) -> Option<Hit<(usize, usize)>> {
    let one = |at: (usize, usize)| {
        let w = &windows[at.0];
        let dt = w.t_s[at.1 + 1] - w.t_s[at.1];
        let column = local_force(windows, at.0, joint, |k| if k == at.1 { 1.0 / dt } else { 0.0 });
        Hit { at, score: screen.score(&[column]) }
    };
    best(instants(windows).into_par_iter().map(one).collect())
}

/// Best instant at which `channel` jumps and stays, also over the following windows of the same recording.
#[must_use]
pub fn jump(screen: &ScoreTest, windows: &[LtvWindow], channel: usize) -> Option<Hit<(usize, usize)>> {
    let one = |at: (usize, usize)| Hit { at, score: screen.score(&[jump_column(windows, channel, at)]) };
    best(instants(windows).into_par_iter().map(one).collect())
}

fn jump_column(windows: &[LtvWindow], channel: usize, at: (usize, usize)) -> Column {
    let (recording, from_s) = (windows[at.0].recording, windows[at.0].t_s[at.1]);
    let column = |w: &LtvWindow| {
        if w.recording != recording || w.t_s.last().is_none_or(|t| *t < from_s) {
            return Vec::new();
        }
        w.reading(channel, |k| if w.t_s[k] >= from_s { 1.0 } else { 0.0 })
    };
    windows.iter().map(column).collect()
}

/// At most some 400 instants per recording, spread evenly.
fn instants(windows: &[LtvWindow]) -> Vec<(usize, usize)> {
    let rows: usize = windows.iter().map(LtvWindow::rows).sum();
    let recordings = windows.iter().map(|w| w.recording).max().unwrap_or(0) + 1;
    let stride = (rows / (400 * recordings)).max(1);
    let of = |(w, tangent): (usize, &LtvWindow)| -> Vec<(usize, usize)> {
        (1..tangent.rows().saturating_sub(2)).step_by(stride).map(|k| (w, k)).collect()
    };
    windows.iter().enumerate().flat_map(of).collect()
}

/// What a free curve is drawn over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Over {
    /// The coordinate.
    Angle,
    /// Its rate.
    Rate,
    /// Time since the start of each recording.
    Time,
}

/// A free force curve at a joint: knots, and the score of its columns (one hat function each).
#[derive(Clone, Debug)]
pub struct Curve {
    /// What it is drawn over.
    pub over: Over,
    /// Index of the joint.
    pub joint: usize,
    /// Recording, for a curve over time.
    pub recording: Option<usize>,
    /// Abscissae.
    pub knots: Vec<f64>,
    /// Gain, force at each knot and its deviation.
    pub score: Score,
}

/// Hat function number `i` on evenly spaced `knots`.
fn hat(knots: &[f64], i: usize, x: f64) -> f64 {
    let width = knots[1] - knots[0];
    (1.0 - ((x - knots[i]) / width).abs()).max(0.0)
}

fn range(windows: &[LtvWindow], value: impl Fn(&LtvWindow, usize) -> f64) -> (f64, f64) {
    let mut all: Vec<f64> =
        windows.iter().flat_map(|w| (0..w.rows()).map(|k| value(w, k)).collect::<Vec<_>>()).collect();
    all.sort_by(f64::total_cmp);
    // A few rows far out would waste the knots.
    let at = |q: f64| all.get(((all.len().max(1) - 1) as f64 * q) as usize).copied().unwrap_or(0.0);
    (at(0.002), at(0.998))
}

/// The free force curve at `joint` over angle or rate with so many knots, all recordings together.
#[must_use]
pub fn state_curve(screen: &ScoreTest, windows: &[LtvWindow], joint: usize, over: Over, count: usize) -> Option<Curve> {
    let coordinates = windows.first()?.states.first()?.len() / 2;
    let index = if over == Over::Angle { joint } else { coordinates + joint };
    let value = |w: &LtvWindow, k: usize| w.states[k][index];
    let (low, high) = range(windows, value);
    if high - low <= 0.0 || !(high - low).is_finite() {
        return None;
    }
    let knots: Vec<f64> = (0..count).map(|i| low + (high - low) * i as f64 / (count - 1) as f64).collect();
    let columns: Vec<Column> = (0..count)
        .into_par_iter()
        .map(|i| force_column(windows, joint, |w, k| hat(&knots, i, value(w, k).clamp(low, high))))
        .collect();
    Some(Curve { over, joint, recording: None, score: screen.score(&columns), knots })
}

impl Curve {
    /// What this force does to readings, of these recordings or of others.
    #[must_use]
    pub fn response(&self, windows: &[LtvWindow]) -> Column {
        let (first, last) = (self.knots[0], self.knots[self.knots.len() - 1]);
        let force = |x: f64| -> f64 {
            let x = x.clamp(first, last);
            self.score.shrunken.iter().enumerate().map(|(i, a)| a * hat(&self.knots, i, x)).sum()
        };
        let abscissa = |w: &LtvWindow, k: usize| match self.over {
            Over::Angle => w.states[k][self.joint],
            Over::Rate => w.states[k][w.states[k].len() / 2 + self.joint],
            Over::Time => w.t_s[k],
        };
        let acts = |w: &LtvWindow| self.recording.is_none_or(|r| r == w.recording);
        let of = |w: &LtvWindow| {
            if acts(w) { w.respond(self.joint, |k| force(abscissa(w, k))) } else { Vec::new() }
        };
        windows.iter().map(of).collect()
    }
}

/// The free force curve at `joint` over the time of one recording, one knot every `knot_s`.
#[must_use]
pub fn time_curve(
    screen: &ScoreTest,
    windows: &[LtvWindow],
    joint: usize,
    recording: usize,
    knot_s: f64,
) -> Option<Curve> {
    let mine: Vec<&LtvWindow> = windows.iter().filter(|w| w.recording == recording).collect();
    let (from, to) = (*mine.first()?.t_s.first()?, *mine.last()?.t_s.last()?);
    let count = ((to - from) / knot_s).ceil().clamp(2.0, 400.0) as usize;
    let knots: Vec<f64> = (0..=count).map(|i| from + (to - from) * i as f64 / count as f64).collect();
    let width = knots[1] - knots[0];
    let columns: Vec<Column> = (0..=count)
        .into_par_iter()
        .map(|i| {
            let of = |w: &LtvWindow| {
                let outside = w.recording != recording
                    || w.t_s.last().is_none_or(|t| *t < knots[i] - width)
                    || w.t_s.first().is_none_or(|t| *t > knots[i] + width);
                if outside { Vec::new() } else { w.respond(joint, |k| hat(&knots, i, w.t_s[k])) }
            };
            windows.iter().map(of).collect()
        })
        .collect();
    Some(Curve { over: Over::Time, joint, recording: Some(recording), score: screen.score(&columns), knots })
}

/// Best frequency of a force at `joint` that oscillates with time, its phase free in each recording.
#[must_use]
pub fn vibration(screen: &ScoreTest, windows: &[LtvWindow], joint: usize, hz: &[f64]) -> Option<Hit<f64>> {
    let recordings = windows.iter().map(|w| w.recording).max()? + 1;
    let one = |f: &f64| Hit { at: *f, score: screen.score(&vibration_columns(windows, joint, recordings, *f)) };
    best(hz.par_iter().map(one).collect())
}

/// A force at `joint` that oscillates with time: sine and cosine, recording by recording.
#[must_use]
pub fn vibration_columns(windows: &[LtvWindow], joint: usize, recordings: usize, hz: f64) -> Vec<Column> {
    let both = |recording: usize| {
        [0.0, std::f64::consts::FRAC_PI_2].map(|shift| vibration_column(windows, joint, recording, hz, shift))
    };
    (0..recordings).flat_map(both).collect()
}

fn vibration_column(windows: &[LtvWindow], joint: usize, recording: usize, hz: f64, shift: f64) -> Column {
    let omega = 2.0 * std::f64::consts::PI * hz;
    let of = |w: &LtvWindow| {
        if w.recording == recording { w.respond(joint, |k| libm::sin(omega * w.t_s[k] + shift)) } else { Vec::new() }
    };
    windows.iter().map(of).collect()
}

/// Instant of a recording from which on the machine is another one: its fitted numbers differ from before, as does the state
/// that it goes on from. Chow's test (Econometrica 28, 1960) over all instants, linear around the fit whose `runs` with their
/// slopes these are; the gain is what other numbers bring beyond what another state alone does.
#[must_use]
pub fn change(
    screen: &ScoreTest,
    windows: &[LtvWindow],
    runs: &[Vec<Series>],
    shared: usize,
) -> Option<Hit<(usize, f64)>> {
    let recordings = windows.iter().map(|w| w.recording).max()? + 1;
    let instants = |recording: usize| {
        let mine =
            || windows.iter().filter(move |w| w.recording == recording).filter_map(|w| w.t_s.first().zip(w.t_s.last()));
        let (from, to) = (mine().next().map_or(0.0, |w| *w.0), mine().next_back().map_or(0.0, |w| *w.1));
        (CHANGES / 10..=CHANGES - CHANGES / 10)
            .map(move |i| (recording, from + (to - from) * i as f64 / CHANGES as f64))
    };
    let all: Vec<(usize, f64)> = (0..recordings).flat_map(instants).collect();
    let one = |at: &(usize, f64)| {
        let after = |w: usize, slope: usize| -> Vec<Vec<f64>> {
            let masked = |s: &Series| {
                s.slopes[slope].iter().zip(&windows[w].t_s).map(|(x, t)| if *t < at.1 { 0.0 } else { *x }).collect()
            };
            runs[w].iter().map(masked).collect()
        };
        let is_after = |w: &LtvWindow| w.recording == at.0 && w.t_s.last().is_some_and(|t| *t >= at.1);
        let is_split = |w: &LtvWindow| is_after(w) && w.t_s.first().is_some_and(|t| *t < at.1);
        let column = |p: usize| -> Column {
            windows.iter().enumerate().map(|(w, t)| if is_after(t) { after(w, p) } else { Vec::new() }).collect()
        };
        let states = |w: usize| runs[w].first().map_or(0, |s| s.slopes.len()).saturating_sub(shared);
        let own: Vec<Own> = windows
            .iter()
            .enumerate()
            .map(|(w, t)| if is_split(t) { (0..states(w)).map(|x| after(w, shared + x)).collect() } else { Own::new() })
            .collect();
        let mut score = screen.score_beside(&(0..shared).map(column).collect::<Vec<_>>(), &own);
        score.gain -= screen.score_beside(&[], &own).gain;
        Hit { at: *at, score }
    };
    best(all.par_iter().map(one).collect())
}

/// Instants per recording at which a change is sought, but for a tenth at each end.
const CHANGES: usize = 40;

/// Gain of a once-per-turn error of `channel` that reads coordinate `joint`. Amplitudes: sine, cosine.
#[must_use]
pub fn eccentricity(screen: &ScoreTest, windows: &[LtvWindow], channel: usize, joint: usize) -> Score {
    let wave = |shift: f64| reading_column(windows, channel, move |w, k| libm::sin(w.states[k][joint] + shift));
    screen.score(&[wave(0.0), wave(std::f64::consts::FRAC_PI_2)])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::diagnose::screen::ltv::tests::mass;
    use crate::identify::fit::{FreeRuns, Point};
    use crate::identify::noise::Colour;

    /// A mass whose truth had a push of 0.02 N s at row 40.
    struct Pushed(LtvWindow);

    impl FreeRuns for Pushed {
        fn windows(&self) -> usize {
            1
        }
        fn run(&self, _: usize, _: &[f64], x: &[f64], _: bool) -> Option<Vec<Series>> {
            let truth = self.0.respond(0, |k| if k == 40 { 2.0 } else { 0.0 });
            let t = &self.0.t_s;
            let residual = (0..100).map(|k| x[0] + x[1] * t[k] - truth[0][k]).collect();
            Some(vec![Series { residual, slopes: vec![vec![1.0; 100], t.clone()] }])
        }
    }

    #[test]
    fn a_push_is_found_at_its_instant_with_its_impulse() {
        let runs = Pushed(mass());
        let at = Point { parameters: vec![], states: vec![vec![0.0, 0.0]] };
        let screen = ScoreTest::new(&runs, &at, &[Colour::white(0.1)]).unwrap();
        let hit = push(&screen, std::slice::from_ref(&runs.0), 0).unwrap();
        assert_eq!(hit.at, (0, 40));
        assert!((hit.score.amplitudes[0] - 0.02).abs() < 1e-4, "{:?}", hit.score);
    }

    #[test]
    fn a_force_over_time_is_recovered_as_a_curve() {
        let runs = Pushed(mass());
        let at = Point { parameters: vec![], states: vec![vec![0.0, 0.0]] };
        let screen = ScoreTest::new(&runs, &at, &[Colour::white(0.001)]).unwrap();
        let curve = time_curve(&screen, std::slice::from_ref(&runs.0), 0, 0, 0.05).unwrap();
        let peak = (0..curve.knots.len())
            .max_by(|a, b| curve.score.amplitudes[*a].abs().total_cmp(&curve.score.amplitudes[*b].abs()));
        assert!((curve.knots[peak.unwrap()] - 0.4).abs() < 0.06, "{curve:?}");
    }
}
