//! The floor under a walking machine: height over the distance walked, normal to the mean ground. RT: yes.
//!
//! Tiles of one length whose heights are drawn from a seed, and terraces on top: each begins at a place and holds from
//! there on. The toe's tip is round: near an edge it rides up or down along the rounding instead of jumping.
//! Limits: contact forces stay normal to the mean ground; an edge higher than the tip's radius is a wall only as far as
//! the radius reaches.

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
}

impl Floor {
    /// Height at `x_m` for a point, m.
    #[must_use]
    pub fn point_height_m(&self, x_m: f64) -> f64 {
        self.tile_height_m(x_m) + self.terrace_height_m(x_m)
    }

    /// Height at which the round tip over `x_m` touches, m.
    #[must_use]
    pub fn height_m(&self, x_m: f64) -> f64 {
        let mut height_m = self.point_height_m(x_m);
        let radius_m = self.tip_radius_m;
        if radius_m <= 0.0 {
            return height_m;
        }
        let mut edge = |at_m: f64| {
            let off_m = at_m - x_m;
            let reach = radius_m * radius_m - off_m * off_m;
            if reach > 0.0 {
                let beyond = self.point_height_m(at_m).max(self.point_height_m(at_m - EDGE_M));
                height_m = height_m.max(beyond - radius_m + libm::sqrt(reach));
            }
        };
        if self.tile_m > 0.0 && self.half_width_m > 0.0 {
            let tile = libm::floor(x_m / self.tile_m);
            edge(tile * self.tile_m);
            edge((tile + 1.0) * self.tile_m);
        }
        let near = self.terraces.partition_point(|[from, _]| *from < x_m - radius_m);
        for [from, _] in self.terraces.iter().skip(near).take_while(|[from, _]| *from < x_m + radius_m) {
            edge(*from);
        }
        height_m
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
