//! The floor under a walking machine: height over the distance walked, normal to the mean ground. RT: yes.
//!
//! Tiles of one length whose heights are drawn from a seed, and terraces on top: each begins at a place and holds from
//! there on. The toe's tip is round: near an edge it rides up or down along the rounding instead of jumping.
//! An edge higher than the radius goes on as a face as steep as [`STEEPEST`], so that a foot meets a wall and not a jump.
//! Under all of it lies a profile of straight slopes, which tilts what stands on it.
//! Limits: the foot that stands is held where it landed, and slides along a straight line, as steep as the profile where it
//! landed. On a slope the rounding of the tip is left out: at a rise of .25 it would touch .6 mm higher.

/// Heights along the walk.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Floor {
    /// Length of a tile, m; 0 = no tiles.
    pub tile_m: f64,
    /// Tiles are uniformly within ± this, m.
    pub half_width_m: f64,
    /// Draws the tiles.
    pub seed: u64,
    /// The tiles begin here, m: the start is level.
    pub level_until_m: f64,
    /// `[from, height]`, m, in rising order: this high from there on.
    pub terraces: Vec<[f64; 2]>,
    /// Radius of the toe's tip, m.
    pub tip_radius_m: f64,
    /// `[place, height]`, m, in rising order: straight in between, level before the first and after the last.
    pub profile: Vec<[f64; 2]>,
}

impl Floor {
    /// Height at `x_m` for a point, m.
    #[must_use]
    pub fn point_height_m(&self, x_m: f64) -> f64 {
        self.stepped_height_m(x_m) + self.slope_at(x_m)[0]
    }

    /// How the profile rises at `x_m`, whatever lies on it.
    #[must_use]
    pub fn rise(&self, x_m: f64) -> f64 {
        self.slope_at(x_m)[1]
    }

    /// Height of the profile at `x_m`, m, and how it rises.
    fn slope_at(&self, x_m: f64) -> [f64; 2] {
        let after = self.profile.partition_point(|[place, _]| *place <= x_m);
        let before = after.checked_sub(1).and_then(|i| self.profile.get(i));
        match (before, self.profile.get(after)) {
            (Some([from, low]), Some([to, high])) => {
                let rise = (high - low) / (to - from);
                [low + rise * (x_m - from), rise]
            }
            (Some([_, height]), None) | (None, Some([_, height])) => [*height, 0.0],
            (None, None) => [0.0; 2],
        }
    }

    /// Height of tiles and terraces over the profile, m.
    fn stepped_height_m(&self, x_m: f64) -> f64 {
        self.tile_height_m(x_m) + self.terrace_height_m(x_m)
    }

    /// Height at which the round tip over `x_m` touches, m.
    #[must_use]
    pub fn height_m(&self, x_m: f64) -> f64 {
        let [height_m, _] = self.contact(x_m);
        height_m
    }

    /// Height at which the round tip over `x_m` touches, m, and how that rises with x.
    #[must_use]
    pub fn contact(&self, x_m: f64) -> [f64; 2] {
        let stepped = self.stepped_contact(x_m);
        if self.profile.is_empty() {
            return stepped;
        }
        let slope = self.slope_at(x_m);
        [stepped[0] + slope[0], stepped[1] + slope[1]]
    }

    /// The same over a level profile.
    fn stepped_contact(&self, x_m: f64) -> [f64; 2] {
        let radius_m = self.tip_radius_m;
        let mut contact = [self.stepped_height_m(x_m), 0.0];
        if radius_m <= 0.0 {
            return contact;
        }
        // No tile is higher: most edges are too far away to touch, whatever their height, which takes two draws to know.
        let highest_m = if self.terraces.is_empty() { self.half_width_m } else { f64::INFINITY };
        let mut edge = |at_m: f64| {
            let off_m = at_m - x_m;
            let [below_m, steep] = rounding(radius_m, off_m.abs());
            if highest_m - below_m <= contact[0] {
                return;
            }
            let beyond_m = self.stepped_height_m(at_m).max(self.stepped_height_m(at_m - EDGE_M));
            if beyond_m - below_m > contact[0] {
                contact = [beyond_m - below_m, steep * off_m.signum()];
            }
        };
        if self.tile_m > 0.0 && self.half_width_m > 0.0 {
            let tile = libm::floor(x_m / self.tile_m);
            edge(tile * self.tile_m);
            edge((tile + 1.0) * self.tile_m);
        }
        // A face of a terrace reaches further than the radius; higher ones than this are not met.
        let near_m = radius_m + HIGHEST_M / STEEPEST;
        let near = self.terraces.partition_point(|[from, _]| *from < x_m - near_m);
        for [from, _] in self.terraces.iter().skip(near).take_while(|[from, _]| *from < x_m + near_m) {
            edge(*from);
        }
        contact
    }

    fn tile_height_m(&self, x_m: f64) -> f64 {
        if self.tile_m <= 0.0 || self.half_width_m <= 0.0 || x_m < self.level_until_m {
            return 0.0;
        }
        #[expect(clippy::cast_possible_truncation, reason = "a walk of less than 2^63 tiles")]
        let tile = libm::floor(x_m / self.tile_m) as i64;
        self.half_width_m * uniform(self.seed, tile.cast_unsigned())
    }

    fn terrace_height_m(&self, x_m: f64) -> f64 {
        let after = self.terraces.partition_point(|[from, _]| *from <= x_m);
        after.checked_sub(1).and_then(|i| self.terraces.get(i)).map_or(0.0, |[_, height]| *height)
    }
}

/// How far the tip is below the edge when it stands `off_m` beside it, m, and how steeply it rises towards it.
fn rounding(radius_m: f64, off_m: f64) -> [f64; 2] {
    let flat = 1.0 / libm::sqrt(1.0 + STEEPEST * STEEPEST);
    let beyond_m = off_m - radius_m * STEEPEST * flat;
    if beyond_m > 0.0 {
        return [radius_m * (1.0 - flat) + STEEPEST * beyond_m, STEEPEST];
    }
    let up_m = libm::sqrt(radius_m * radius_m - off_m * off_m);
    [radius_m - up_m, off_m / up_m]
}

/// Steepest face of an edge: a step of .5 ms moves a foot of 2 m/s by 1 mm along and 5 mm up it.
const STEEPEST: f64 = 5.0;
/// Highest edge whose face is looked for, m.
const HIGHEST_M: f64 = 0.1;
/// This side of an edge, m.
const EDGE_M: f64 = 1e-9;

/// Uniform in -1 .. 1, the same for the same numbers (SplitMix64, Steele et al. 2014).
fn uniform(seed: u64, index: u64) -> f64 {
    let mut z = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15).wrapping_add(index.wrapping_mul(0xBF58_476D_1CE4_E5B9));
    for _ in 0..2 {
        z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
    }
    #[expect(clippy::cast_precision_loss, reason = "53 bits fit")]
    let unit = (z >> 11) as f64 / (1_u64 << 53) as f64;
    2.0 * unit - 1.0
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tiles(seed: u64) -> Floor {
        Floor { tile_m: 0.1, half_width_m: 0.01, seed, ..Floor::default() }
    }

    #[test]
    fn tiles_are_uniform_and_repeat_for_a_seed() {
        let floor = tiles(3);
        let heights: Vec<f64> = (0..20_000).map(|k| floor.height_m(0.05 + 0.1 * f64::from(k))).collect();
        let mean = heights.iter().sum::<f64>() / 2e4;
        let square = heights.iter().map(|h| h * h).sum::<f64>() / 2e4;
        // Standard errors: h/√3/√20000 = 4e-5 of the mean, .6 % of the variance h²/3.
        assert!(mean.abs() < 2e-4 && (square / (1e-4 / 3.0) - 1.0).abs() < 0.03, "{mean} {square}");
        let lagged: f64 = heights.windows(2).map(|w| w[0] * w[1]).sum::<f64>() / 2e4;
        assert!(lagged.abs() < 0.03 * 1e-4 / 3.0, "neighbours are independent: {lagged}");
        assert!(heights.iter().all(|h| h.abs() <= 0.01));
        assert_eq!(tiles(3).height_m(7.77).to_bits(), floor.height_m(7.77).to_bits());
        assert!((tiles(4).height_m(7.77) - floor.height_m(7.77)).abs() > 1e-6);
    }

    #[test]
    fn the_start_is_level_and_terraces_add_up_on_tiles() {
        let floor = Floor { level_until_m: 1.0, terraces: vec![[2.0, 0.03], [3.0, -0.01]], ..tiles(1) };
        assert!(floor.height_m(-5.0).abs() < 1e-15 && floor.height_m(0.95).abs() < 1e-15);
        for (x, terrace) in [(2.55, 0.03), (3.55, -0.01)] {
            assert!((floor.height_m(x) - tiles(1).height_m(x) - terrace).abs() < 1e-15);
        }
    }

    #[test]
    fn an_edge_higher_than_the_radius_is_a_steep_face_without_a_jump() {
        let floor = Floor { terraces: vec![[1.0, 0.05]], tip_radius_m: 0.01, ..Floor::default() };
        let at = |k: i32| 0.97 + 1e-5 * f64::from(k);
        for k in 0..6000 {
            let (low, high) = (floor.height_m(at(k)), floor.height_m(at(k + 1)));
            assert!(high >= low - 1e-15 && high - low <= STEEPEST * 1e-5 + 1e-12, "{k}: {low} {high}");
            let [_, rise] = floor.contact(0.5 * (at(k) + at(k + 1)));
            // At a corner the difference lies between the slopes of its sides.
            let corner = (rise - (high - low) / 1e-5).abs() > 0.02;
            let turns = (floor.contact(at(k))[1] - floor.contact(at(k + 1))[1]).abs() > 1e-9;
            assert!(!corner || turns, "{k}: {rise}");
        }
        assert!((floor.height_m(1.0) - 0.05).abs() < 1e-12 && floor.height_m(0.975).abs() < 1e-15);
    }

    #[test]
    fn a_round_tip_rides_over_an_edge_without_a_jump() {
        let floor = Floor { terraces: vec![[1.0, 0.008]], tip_radius_m: 0.01, ..Floor::default() };
        let heights: Vec<f64> = (0..=4000).map(|k| floor.height_m(0.98 + 1e-5 * f64::from(k))).collect();
        assert!(heights[0].abs() < 1e-15 && (heights[4000] - 0.008).abs() < 1e-15);
        assert!(heights.windows(2).all(|w| w[1] >= w[0] - 1e-15 && w[1] - w[0] < 2e-4), "continuous and rising");
        // Half a radius before the edge the circle stands r - r√(3/4) lower than on it.
        let at = floor.height_m(0.995);
        assert!((at - (0.008 - 0.01 + 0.01 * 0.75_f64.sqrt())).abs() < 1e-12, "{at}");
    }
}
