//! How the real machine differs from its model: `sim.model_error`, drawn by the seed. RT: before arming only.

use super::checked::{Config, Model};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// Makes the machine's errors another stream than the noise of its sensors.
const STREAM: u64 = 0x6D6F_6465_6C00;

/// Puts the drawn machine in the place of `sim.body` and `sim.friction_scale`.
///
/// c3 is the body's inertia, c1 and c2 are the legs' with it, all over `m_t l²` (model notes, section 2). First moments
/// and mass stay: a scale and a balance tell them.
pub(super) fn draw(config: &mut Config) {
    let Some(error) = config.simulation.model_error else { return };
    let mut rng = ChaCha8Rng::seed_from_u64(config.simulation.seed ^ STREAM);
    #[expect(clippy::cast_precision_loss, reason = "53 bits")]
    let mut factor = |share: f64| 1.0 + share * (2.0 * ((rng.next_u64() >> 11) as f64 / 9_007_199_254_740_992.0) - 1.0);
    let [inner, outer, body] = std::array::from_fn(|_| factor(error.inertia));
    let friction: [f64; 2] = std::array::from_fn(|_| factor(error.friction));
    let mut model: Model = config.body().clone();
    let [c1, c2, c3] = [0, 1, 2].map(|i| model.c[i].value);
    model.c[2].value = c3 * body;
    model.c[0].value = c3 * body + (c1 - c3) * inner;
    model.c[1].value = c3 * body + (c2 - c3) * outer;
    // The compliance stands in `sim.hip_elasticity` alone.
    model.hip_elasticity = None;
    config.simulation.body = Some(model);
    for (scale, drawn) in config.simulation.friction_scale.iter_mut().zip(friction) {
        *scale *= drawn;
    }
}

#[cfg(test)]
mod tests {
    use crate::config::checked::Config;
    use crate::config::{from_canonical, load};

    fn drawn(seed: u32) -> Config {
        let keys = ["sim.model_error.inertia=0.1", "sim.model_error.friction=0.2", &format!("sim.seed={seed}")];
        load(None, &keys.map(str::to_owned)).unwrap().config
    }

    #[test]
    fn machines_differ_by_up_to_the_shares_and_fill_them() {
        let mut most = [0.0_f64; 2];
        for seed in 0..300 {
            let config = drawn(seed);
            let (real, model) = (config.body().params(), config.robot.model.params());
            let leg = |p: [f64; 6], k: usize| p[k] - p[2];
            for k in 0..2 {
                most[0] = most[0].max((leg(real.c, k) / leg(model.c, k) - 1.0).abs());
                most[1] = most[1].max((config.simulation.friction_scale[k] - 1.0).abs());
            }
            assert!((real.c[3] - model.c[3]).abs() < 1e-15 && (real.total_mass_kg - model.total_mass_kg).abs() < 1e-15);
        }
        assert!((0.095..=0.1 + 1e-12).contains(&most[0]) && (0.19..=0.2 + 1e-12).contains(&most[1]), "{most:?}");
    }

    #[test]
    fn a_recording_of_such_a_run_gives_the_same_machine() {
        let keys = ["sim.model_error.inertia=0.1", "sim.model_error.friction=0.2"].map(str::to_owned);
        let first = load(None, &keys).unwrap();
        assert_eq!(from_canonical(&first.text, &[]).unwrap().config, first.config);
        assert_ne!(drawn(1).simulation.body, drawn(2).simulation.body);
    }
}
