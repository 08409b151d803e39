//! From values to places on the paper, and the ticks on the way. RT: no.

/// How an axis is divided.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Scale {
    /// Evenly.
    #[default]
    Linear,
    /// By powers of ten; values at or below zero are left out.
    Log,
}

/// One axis.
#[derive(Debug, Clone, Default)]
pub struct Axis {
    /// Name and unit.
    pub label: String,
    /// Division.
    pub scale: Scale,
    /// What is shown; by default what the marks need.
    pub range: Option<[f64; 2]>,
}

impl Axis {
    /// A linear axis that shows everything.
    pub fn linear(label: &str) -> Self {
        Self { label: label.to_owned(), ..Self::default() }
    }

    /// A logarithmic axis that shows everything.
    pub fn log(label: &str) -> Self {
        Self { label: label.to_owned(), scale: Scale::Log, range: None }
    }

    /// Only from `low` to `high`.
    #[must_use]
    pub fn within(mut self, low: f64, high: f64) -> Self {
        self.range = Some([low, high]);
        self
    }
}

/// An axis laid on `length_px` of paper.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ruler {
    scale: Scale,
    low: f64,
    high: f64,
    length_px: f64,
}

impl Ruler {
    /// Lays an axis out; `needed` are the values that its marks want to show. `margin` is the part added at both ends.
    pub(super) fn new(axis: &Axis, needed: impl Iterator<Item = f64>, length_px: f64, margin: f64) -> Self {
        let usable = needed.filter(|v| v.is_finite() && (axis.scale == Scale::Linear || *v > 0.0));
        let extent = usable.fold(None, |range: Option<[f64; 2]>, v| {
            Some(range.map_or([v, v], |[low, high]| [low.min(v), high.max(v)]))
        });
        let padded = match axis.scale {
            Scale::Linear => padded_linear(extent.unwrap_or([0.0, 1.0]), margin),
            Scale::Log => padded_log(extent.unwrap_or([0.1, 10.0])),
        };
        let [low, high] = axis.range.unwrap_or(padded);
        Self { scale: axis.scale, low, high, length_px }
    }

    /// Distance from the low end, px; `None` for what cannot be shown on this scale.
    pub(super) fn place(&self, value: f64) -> Option<f64> {
        let part = match self.scale {
            Scale::Linear => (value - self.low) / (self.high - self.low),
            Scale::Log if value > 0.0 => (value / self.low).ln() / (self.high / self.low).ln(),
            Scale::Log => return None,
        };
        // Far outside the paper is as good as just outside, and keeps the file free of huge numbers.
        part.is_finite().then(|| part.clamp(-4.0, 5.0) * self.length_px)
    }

    pub(super) fn shows(&self, value: f64) -> bool {
        (self.low..=self.high).contains(&value)
    }

    /// The two ends.
    pub(super) fn ends(&self) -> [f64; 2] {
        [self.low, self.high]
    }

    /// Values worth a grid line, with their text.
    pub(super) fn ticks(&self, about: usize) -> Vec<(f64, String)> {
        match self.scale {
            Scale::Linear => linear_ticks(self.low, self.high, about),
            Scale::Log => log_ticks(self.low, self.high),
        }
    }
}

fn padded_linear([low, high]: [f64; 2], margin: f64) -> [f64; 2] {
    let width = if high > low { high - low } else { low.abs().max(1e-9) };
    let pad = if high > low { margin * width } else { width };
    [low - pad, high + pad]
}

fn padded_log([low, high]: [f64; 2]) -> [f64; 2] {
    let (from, to) = (low.log10().floor(), high.log10().ceil());
    [10f64.powf(from), 10f64.powf(if to > from { to } else { from + 1.0 })]
}

/// Ticks that an axis has at least: one alone gives no scale.
const LEAST_TICKS: usize = 2;
/// Steps to ask for where there would be fewer: rounded up they are at most two and a half times as long, so two ticks fit.
const ENOUGH: usize = 5;

/// 1, 2 or 5 times a power of ten, the nearest below that gives about so many steps.
fn nice_step(width: f64, about: usize) -> f64 {
    let raw = width / about.max(1) as f64;
    let decade = 10f64.powf(raw.log10().floor());
    let steps = [1.0, 2.0, 5.0, 10.0];
    decade * steps.into_iter().find(|step| step * decade >= raw * (1.0 - 1e-9)).unwrap_or(10.0)
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a handful of ticks, few decimals")]
fn linear_ticks(low: f64, high: f64, about: usize) -> Vec<(f64, String)> {
    let ticks = |step: f64| {
        let first = (low / step).ceil();
        (step, first, ((high / step).floor() - first).max(-1.0) as usize + 1)
    };
    let wanted = nice_step(high - low, about);
    if !wanted.is_finite() || wanted <= 0.0 {
        return Vec::new();
    }
    let few = ticks(wanted);
    let (step, first, count) = if few.2 < LEAST_TICKS { ticks(nice_step(high - low, about.max(ENOUGH))) } else { few };
    let decimals = (-step.log10().floor()).clamp(0.0, 9.0) as usize;
    let tick = |i: usize| (first + i as f64) * step;
    (0..count.min(50)).map(|i| (tick(i), tick_text(tick(i), step, decimals))).collect()
}

fn tick_text(value: f64, step: f64, decimals: usize) -> String {
    let value = if value.abs() < step / 2.0 { 0.0 } else { value };
    if (1e-5..1e5).contains(&step) { format!("{value:.decimals$}").replace('-', "−") } else { format!("{value:.1e}") }
}

#[expect(clippy::cast_possible_truncation, reason = "decades of a double")]
fn log_ticks(low: f64, high: f64) -> Vec<(f64, String)> {
    let (from, to) = (low.log10().ceil() as i32, high.log10().floor() as i32);
    let every = usize::try_from((to - from) / 6 + 1).unwrap_or(1);
    (from..=to).step_by(every).map(|decade| (10f64.powi(decade), decade_text(decade))).collect()
}

fn decade_text(decade: i32) -> String {
    match decade {
        -3..=4 => format!("{}", 10f64.powi(decade)),
        _ => format!("1e{decade}"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let texts: Vec<String> = linear_ticks(-0.13, 0.61, 5).into_iter().map(|(_, text)| text).collect();
        assert_eq!(texts, ["0.0", "0.2", "0.4", "0.6"]);
    }

    #[test]
    fn an_axis_has_two_ticks_at_least() {
        for (low, high) in [(-0.9, 0.9), (-0.43, 0.51), (0.12, 0.187), (-3.1, 1.9), (0.9, 1.9)] {
            for about in 1..8 {
                let ticks = linear_ticks(low, high, about);
                assert!(ticks.len() >= 2, "{low} to {high}, about {about}: {ticks:?}");
            }
        }
    }

    #[test]
    fn a_flat_signal_still_has_a_range() {
        let ruler = Ruler::new(&Axis::linear("q"), [2.0, 2.0].into_iter(), 100.0, 0.05);
        assert!(ruler.place(2.0).is_some_and(|p| (p - 50.0).abs() < 1e-9));
    }

    #[test]
    fn log_axis_leaves_zero_out_and_spaces_decades_evenly() {
        let ruler = Ruler::new(&Axis::log("s"), [0.0, 0.01, 1.0].into_iter(), 100.0, 0.05);
        assert!(ruler.place(0.0).is_none());
        assert!(ruler.place(0.1).is_some_and(|p| (p - 50.0).abs() < 1e-9));
        assert_eq!(ruler.ticks(5).len(), 3);
    }
}
