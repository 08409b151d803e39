//! The straight line of the floor in a scan, robustly and with its uncertainty. RT: no, in an ordinary thread; bounded
//! and without allocation all the same.
//!
//! 1. Least median of squares (Rousseeuw 1984) over a fixed set of pairs: up to half of the points may be something else,
//!    wherever they lie. Lines that no robot can stand on (too steep, another height) are no candidates, so that a wall
//!    with more points than the floor is not taken for it.
//! 2. From there Tukey's biweight, some rounds of weighted least squares across the line.
//! 3. Variance by clusters (Liang and Zeger 1986): points on one tile err together, so what counts as independent is a
//!    stretch of [`CLUSTER_M`] of floor, not a point.
//!
//! Limits: a smooth ramp under the whole sector is a floor like any other; a distance that is wrong for all beams alike
//! bends the line, and tilts it where the sector is not symmetric.

use crate::config::checked::Lidar;
use crate::msg::FloorVerdict;
use crate::sensor::scip::{Parameters, STEPS, Scan};

/// Points that choose the first line.
const CHOSEN: usize = 48;
/// Points of a pair are at least so many of the chosen ones apart.
const APART: usize = 8;
/// Rounds of reweighting.
const ROUNDS: usize = 8;
/// No part of the robot leans by more against the floor, rad.
const STEEPEST_RAD: f64 = 0.7;
/// Median of absolute deviations to standard deviation.
const BY_MEDIAN: f64 = 1.4826;
/// Tukey's constant: 95 % efficient for normal errors.
const TUKEY: f64 = 4.685;
/// No floor and no scanner is finer than this, m.
const FINEST_M: f64 = 0.001;
/// So far apart along the floor errors are independent, m.
const CLUSTER_M: f64 = 0.1;
/// Fewer independent stretches tell no inclination.
const LEAST_CLUSTERS: usize = 5;

/// A return in the frame of the part that carries the scanner: forward, and up along the part.
#[derive(Clone, Copy, Debug, Default)]
struct Point {
    x: f64,
    y: f64,
    step: u32,
}

/// A line in that frame: its angle from "forward", and the scanner's distance from it.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Line {
    angle_rad: f64,
    height_m: f64,
}

impl Line {
    /// Along the line and down from it.
    fn coordinates(self, p: &Point) -> [f64; 2] {
        let (sin, cos) = libm::sincos(self.angle_rad);
        [cos * p.x + sin * p.y, sin * p.x - cos * p.y - self.height_m]
    }

    fn through(p: &Point, q: &Point) -> Option<Self> {
        let (dx, dy) = if q.x > p.x { (q.x - p.x, q.y - p.y) } else { (p.x - q.x, p.y - q.y) };
        let angle_rad = libm::atan2(dy, dx);
        let flat = Self { angle_rad, height_m: 0.0 };
        let [_, height_m] = flat.coordinates(p);
        (dx > 0.0).then_some(Self { angle_rad, height_m })
    }
}

/// What a scan shows of the floor.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FloorLine {
    /// Whether the rest holds.
    pub verdict: FloorVerdict,
    /// Inclination of the part against the floor's normal, rad, + leaning back, and its standard deviation.
    pub lean_rad: [f64; 2],
    /// Distance of the scanner from the line and its standard deviation, m.
    pub height_m: [f64; 2],
    /// Robust standard deviation of the points about the line, m.
    pub roughness_m: f64,
    /// Points in the sector.
    pub points: u16,
    /// Those on the line.
    pub used: u16,
    /// Mean step of those.
    pub step: u32,
}

/// Finds the floor; keeps the room for a scan's points.
#[derive(Clone, Debug)]
pub struct Fitter {
    sense: f64,
    down_rad: f64,
    floor_rad: [f64; 2],
    nearest_m: f64,
    height_m: [f64; 2],
    roughest_m: f64,
    least_points: u16,
    points: [Point; STEPS],
    count: usize,
    /// Absolute distances from the line, to find their median.
    distances: [f64; STEPS],
}

impl Fitter {
    /// For a scanner that is mounted so.
    #[must_use]
    pub const fn new(lidar: &Lidar) -> Self {
        Self {
            sense: lidar.sense,
            down_rad: lidar.down_rad,
            floor_rad: lidar.floor_rad,
            nearest_m: lidar.nearest_m,
            height_m: lidar.height_m,
            roughest_m: lidar.roughest_m,
            least_points: lidar.least_points,
            points: [Point { x: 0.0, y: 0.0, step: 0 }; STEPS],
            count: 0,
            distances: [0.0; STEPS],
        }
    }

    /// The floor in a scan.
    pub fn fit(&mut self, scan: &Scan, parameters: &Parameters) -> FloorLine {
        self.take_points(scan, parameters);
        let points = u16::try_from(self.count).unwrap_or(u16::MAX);
        let too_few = FloorLine { verdict: FloorVerdict::TooFew, points, ..FloorLine::default() };
        let Some((line, spread_m)) = self.least_median() else { return too_few };
        let Some((line, spread_m)) = self.reweight(line, spread_m) else { return too_few };
        let Some(mut found) = self.judge(line, spread_m) else { return too_few };
        found.points = points;
        if found.roughness_m > self.roughest_m {
            found.verdict = FloorVerdict::TooRough;
        } else if found.used < self.least_points || !self.is_plausible(line) {
            found.verdict = FloorVerdict::TooFew;
        }
        found
    }

    /// Returns of the floor's sector.
    fn take_points(&mut self, scan: &Scan, parameters: &Parameters) {
        self.count = 0;
        let [from, to] = self.floor_rad;
        for (value, step) in scan.distances_mm.iter().take(scan.count).zip(parameters.first..) {
            let turn = parameters.angle_rad(step) - self.down_rad;
            // From the beam along the part, + forward.
            let angle = self.sense * (turn - std::f64::consts::TAU * libm::round(turn / std::f64::consts::TAU));
            let Some(range_m) = parameters.distance_m(*value).filter(|r| *r >= self.nearest_m) else { continue };
            if let Some(slot) = self.points.get_mut(self.count).filter(|_| (from..=to).contains(&angle)) {
                let (sin, cos) = libm::sincos(angle);
                *slot = Point { x: range_m * sin, y: -range_m * cos, step };
                self.count += 1;
            }
        }
    }

    fn is_plausible(&self, line: Line) -> bool {
        let [low, high] = self.height_m;
        line.angle_rad.abs() <= STEEPEST_RAD && (low..=high).contains(&line.height_m)
    }

    /// The plausible line through two of the chosen points from which the chosen points lie nearest in the median.
    fn least_median(&mut self) -> Option<(Line, f64)> {
        if self.count < CHOSEN {
            return None;
        }
        let mut chosen = [Point::default(); CHOSEN];
        for (k, slot) in chosen.iter_mut().enumerate() {
            *slot = *self.points.get(k * (self.count - 1) / (CHOSEN - 1))?;
        }
        let mut best: Option<(Line, f64)> = None;
        for (i, p) in chosen.iter().enumerate() {
            for q in chosen.iter().skip(i + APART) {
                let Some(line) = Line::through(p, q).filter(|line| self.is_plausible(*line)) else { continue };
                let mut off = chosen.map(|point| line.coordinates(&point)[1].abs());
                let (_, median, _) = off.select_nth_unstable_by(CHOSEN / 2, f64::total_cmp);
                if best.is_none_or(|(_, least)| *median < least) {
                    best = Some((line, *median));
                }
            }
        }
        // A line through two points lies nearer to the others than they scatter (Rousseeuw and Leroy 1987, p. 202).
        best.map(|(line, median)| (line, (BY_MEDIAN * (1.0 + 5.0 / 46.0) * median).max(FINEST_M)))
    }

    /// Weighted least squares with Tukey's weights.
    fn reweight(&mut self, mut line: Line, mut spread_m: f64) -> Option<(Line, f64)> {
        for round in 0..ROUNDS {
            let mut sums = Sums::default();
            self.taken().for_each(|p| {
                let [a, d] = line.coordinates(p);
                sums.add(weight(d, spread_m), a, d);
            });
            let (offset_m, slope) = sums.line()?;
            line = Line {
                angle_rad: line.angle_rad - libm::atan(slope),
                height_m: (line.height_m + offset_m) / libm::sqrt(1.0 + slope * slope),
            };
            // The spread settles first, then the line under fixed weights' width.
            if round < 3 {
                spread_m = self.spread(line, spread_m)?;
            }
        }
        Some((line, spread_m))
    }

    /// Median distance of the points near the line, as a standard deviation.
    fn spread(&mut self, line: Line, before_m: f64) -> Option<f64> {
        let mut count = 0;
        for p in self.points.iter().take(self.count) {
            let off = line.coordinates(p)[1].abs();
            if let Some(slot) = self.distances.get_mut(count).filter(|_| off < TUKEY * before_m) {
                *slot = off;
                count += 1;
            }
        }
        let near = self.distances.get_mut(..count).filter(|near| !near.is_empty())?;
        let (_, median, _) = near.select_nth_unstable_by(count / 2, f64::total_cmp);
        Some((BY_MEDIAN * *median).max(FINEST_M))
    }

    /// Numbers of the line with their standard deviations.
    fn judge(&self, line: Line, spread_m: f64) -> Option<FloorLine> {
        let mut sums = Sums::default();
        let (mut used, mut steps) = (0_u16, 0_u32);
        for p in self.taken() {
            let [a, d] = line.coordinates(p);
            let w = weight(d, spread_m);
            sums.add(w, a, d);
            if w > 0.0 {
                used = used.saturating_add(1);
                steps = steps.saturating_add(p.step);
            }
        }
        sums.line()?;
        let (variance, clusters) = self.variance(line, spread_m, &sums);
        let [slope_sigma, height_sigma] = variance.map(libm::sqrt);
        let verdict = if clusters < LEAST_CLUSTERS { FloorVerdict::TooFew } else { FloorVerdict::Found };
        Some(FloorLine {
            verdict,
            lean_rad: [-line.angle_rad, slope_sigma],
            height_m: [line.height_m, height_sigma],
            roughness_m: spread_m,
            points: 0,
            used,
            step: steps.checked_div(u32::from(used)).unwrap_or(0),
        })
    }

    /// Of slope and height by clusters, and how many of these there are.
    fn variance(&self, line: Line, spread_m: f64, sums: &Sums) -> ([f64; 2], usize) {
        let mean = sums.wa / sums.w;
        let square = sums.waa - mean * sums.wa;
        let (mut variance, mut clusters) = ([0.0; 2], 0_usize);
        let (mut sum, mut cluster) = ([0.0; 2], f64::NAN);
        for p in self.taken() {
            let [a, d] = line.coordinates(p);
            let w = weight(d, spread_m);
            if w <= 0.0 {
                continue;
            }
            let here = libm::floor(a / CLUSTER_M);
            if here.to_bits() != cluster.to_bits() {
                variance = add_squares(variance, sum);
                (sum, cluster) = ([0.0; 2], here);
                clusters += 1;
            }
            let lever = (a - mean) / square;
            sum = [sum[0] + w * lever * d, sum[1] + w * (1.0 / sums.w - mean * lever) * d];
        }
        variance = add_squares(variance, sum);
        #[expect(clippy::cast_precision_loss, reason = "some dozens")]
        let n = clusters as f64;
        (variance.map(|v| v * n / (n - 2.0).max(1.0)), clusters)
    }

    fn taken(&self) -> impl Iterator<Item = &Point> {
        self.points.iter().take(self.count)
    }
}

const fn add_squares([a, b]: [f64; 2], [x, y]: [f64; 2]) -> [f64; 2] {
    [a + x * x, b + y * y]
}

/// Tukey's biweight.
fn weight(off_m: f64, spread_m: f64) -> f64 {
    let u = off_m / (TUKEY * spread_m);
    let left = 1.0 - u * u;
    if left > 0.0 { left * left } else { 0.0 }
}

/// Weighted sums of places and distances.
#[derive(Clone, Copy, Debug, Default)]
struct Sums {
    w: f64,
    wa: f64,
    waa: f64,
    wd: f64,
    wad: f64,
}

impl Sums {
    fn add(&mut self, w: f64, a: f64, d: f64) {
        self.w += w;
        self.wa += w * a;
        self.waa += w * a * a;
        self.wd += w * d;
        self.wad += w * a * d;
    }

    /// Offset and slope of the best line.
    fn line(&self) -> Option<(f64, f64)> {
        let det = self.w * self.waa - self.wa * self.wa;
        let slope = (self.w * self.wad - self.wa * self.wd) / det;
        let offset = (self.wd - slope * self.wa) / self.w;
        (det > 0.0 && slope.is_finite() && offset.is_finite()).then_some((offset, slope))
    }
}

#[cfg(test)]
#[path = "floor_line_tests.rs"]
mod tests;
