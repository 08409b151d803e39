//! Whether all recordings are of one machine and every channel follows, by residuals in units of sample-to-sample noise.
//!
//! RT: no.

use super::numbers::{ABOVE_NOISE, GREATER_PART};

/// True if a residual of so many times the noise is explained.
#[must_use]
pub fn is_explained(over_noise: f64) -> bool {
    over_noise <= ABOVE_NOISE
}

/// True if the common fit leaves enough to ask whether each recording alone would leave less.
#[must_use]
pub fn asks_for_separate_fits(over_noise: f64) -> bool {
    over_noise > ABOVE_NOISE
}

/// True if a recording fitted alone is explained so much better than together with the others that they are of different machines.
#[must_use]
pub fn disagrees(together: f64, alone: f64) -> bool {
    together > ABOVE_NOISE * alone
}

/// True if a residual of so many times the noise in one recording is no agreement, given its part of the channel's spread.
#[must_use]
pub fn is_unfollowed(over_noise: f64, part_of_spread: f64) -> bool {
    over_noise > ABOVE_NOISE && part_of_spread > GREATER_PART
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_disagrees_that_is_explained_alone_and_not_together() {
        assert!(asks_for_separate_fits(8.0) && !asks_for_separate_fits(2.0));
        assert!(is_explained(1.2) && !is_explained(3.5));
        assert!(disagrees(8.0, 1.2) && !disagrees(3.0, 1.2));
    }

    #[test]
    fn a_channel_is_not_followed_beyond_noise_and_by_a_good_part_of_its_spread() {
        assert!(is_unfollowed(9.0, 0.6) && !is_unfollowed(9.0, 0.1) && !is_unfollowed(2.0, 0.6));
    }
}
