//! The floor as its footholds tell it: a straight line, and how far the present foothold is off it. RT: yes.
//!
//! Least squares over all footholds so far, each step counting the older ones for less. Tiles have no mean, so a line through
//! some twenty footholds hardly sees them: ±10 mm leave .12 mrad of its slope (standard deviation of 5000 steps drawn, memory
//! .95). And it is right from the first steps on: they count for all while there are no others.
//!
//! The alternative that failed: a mean rise of a step, and the rises beyond it summed up. Until the mean had been learnt, a
//! slope of 2° was taken for a hollow of 40 mm, the stance toe filled it, and had no length left to brake with.

/// Sums over the footholds, by place and height from the present one.
#[derive(Clone, Copy, Debug)]
pub(super) struct Floor {
    weight: f64,
    place_m: f64,
    place2_m2: f64,
    height_m: f64,
    product_m2: f64,
}

impl Floor {
    /// The robot stands on its first foothold.
    pub(super) const fn new() -> Self {
        Self { weight: 1.0, place_m: 0.0, place2_m2: 0.0, height_m: 0.0, product_m2: 0.0 }
    }

    /// The next foothold is so far ahead, and so much higher; all before it count for `memory` of what they did.
    pub(super) fn step(&mut self, ahead_m: f64, rise_m: f64, memory: f64) {
        self.product_m2 += ahead_m * rise_m * self.weight - rise_m * self.place_m - ahead_m * self.height_m;
        self.place2_m2 += ahead_m * (ahead_m * self.weight - 2.0 * self.place_m);
        self.place_m -= ahead_m * self.weight;
        self.height_m -= rise_m * self.weight;
        for sum in [&mut self.weight, &mut self.place_m, &mut self.place2_m2, &mut self.height_m, &mut self.product_m2]
        {
            *sum *= memory;
        }
        self.weight += 1.0;
    }

    /// Slope of the line, rad; above zero it goes up.
    pub(super) fn slope_rad(&self) -> f64 {
        let spread = self.weight * (self.place2_m2 + LEVEL_M2) - self.place_m * self.place_m;
        (self.weight * self.product_m2 - self.place_m * self.height_m) / spread
    }

    /// Height of the present foothold over the line, m.
    pub(super) fn over_m(&self) -> f64 {
        (self.slope_rad() * self.place_m - self.height_m) / self.weight
    }
}

/// Before the first step the floor is level, as a foothold .3 m away would say, m².
const LEVEL_M2: f64 = 0.09;

#[cfg(test)]
mod tests {
    use super::*;

    const MEMORY: f64 = 0.95;

    #[test]
    fn a_slope_is_no_hollow_and_is_known_after_a_few_steps() {
        let mut floor = Floor::new();
        for k in 1..=40 {
            // Steps of two lengths: a limp.
            let ahead_m = if k % 2 == 0 { 0.2 } else { 0.3 };
            floor.step(ahead_m, -0.035 * ahead_m, MEMORY);
            assert!(floor.over_m().abs() < 0.004, "{k}: {}", floor.over_m());
            assert!(k < 4 || (floor.slope_rad() + 0.035).abs() < 0.01, "{k}: {}", floor.slope_rad());
        }
        assert!((floor.slope_rad() + 0.035).abs() < 1e-3 && floor.over_m().abs() < 1e-4);
    }

    #[test]
    fn a_tile_is_felt_at_once_and_makes_no_slope() {
        let mut floor = Floor::new();
        (0..40).for_each(|_| floor.step(0.3, 0.0, MEMORY));
        floor.step(0.3, 0.01, MEMORY);
        assert!(floor.over_m() > 0.008 && floor.slope_rad().abs() < 1e-3, "{floor:?}");
        // Back on the mean floor: the line has taken up little of it.
        floor.step(0.3, -0.01, MEMORY);
        assert!(floor.over_m().abs() < 0.0015, "{floor:?}");
    }

    #[test]
    fn a_step_backwards_is_a_foothold_like_others() {
        let mut floor = Floor::new();
        for ahead_m in [0.3, 0.3, -0.2, 0.3, 0.3, 0.3, -0.2].repeat(10) {
            floor.step(ahead_m, 0.02 * ahead_m, MEMORY);
        }
        assert!((floor.slope_rad() - 0.02).abs() < 1e-3 && floor.over_m().abs() < 1e-3, "{floor:?}");
    }
}
