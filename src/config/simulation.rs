//! Reads `sim`: the simulated robot and its imperfections. RT: before arming only.

use super::checked::{Floor, ImuErrors, LidarErrors, MocapServer, Model, ModelError, Push, RandomPushes, Simulation};
use super::fault::Injection;
use super::floor_profile;
use super::process::LEGS;
use super::reader::{Range, Reader, range};
use super::robot::{elasticity, model};
use crate::base::time::Span;
use crate::msg::Leg;
use std::f64::consts::PI;

/// A blow of 100 N s gives this robot 6 m/s.
const IMPULSE: Range = range(-100.0, 100.0, "N s");

pub(super) fn simulation(r: &Reader<'_>) -> Simulation {
    let second = range(0.0, 1e6, "s");
    Simulation {
        seed: r.integer("seed", 0, i64::MAX, "1"),
        initial_angle_rad: r.numbers("initial_angle_rad", range(-PI, PI, "rad")),
        initial_rate_rad_s: r.numbers("initial_rate_rad_s", range(-20.0, 20.0, "rad/s")),
        release_torque_nm: r.number("release_torque_nm", range(0.0, 1e3, "Nm")),
        release_after: Span::from_s(r.number("release_after_s", second)),
        carried_until_s: r.optional_number("carried_until_s", range(1.0, 1e6, "s")),
        stance: r.choice("stance", LEGS, Leg::Inner),
        on_blocks: r.flag("on_blocks"),
        body: r.optional_table("body", body),
        model_error: r.optional_table("model_error", model_error),
        hip_elasticity: r.optional_table("hip_elasticity", elasticity),
        friction_scale: r.numbers("friction_scale", range(0.0, 100.0, "1")),
        pushes: pushes(r),
        random_pushes: r.optional_table("random_pushes", random_pushes),
        faults: r.parsed_texts("faults", Injection::parse, Injection::text),
        actuator_lag_s: r.number("actuator_lag_s", range(0.0, 1.0, "s")),
        actuator_delay: Span::from_s(r.number("actuator_delay_s", range(0.0, 0.1, "s"))),
        torque_limit_nm: r.optional_number("torque_limit_nm", range(0.0, 1e4, "Nm")),
        ground_friction: r.optional_number("ground_friction", range(0.0, 10.0, "1")),
        restitution: r.number("restitution", range(0.0, 1.0, "1")),
        lift_off: r.flag("lift_off"),
        toe_springs: r.flag("toe_springs"),
        ground_slope_rad: r.number("ground_slope_rad", range(-0.5, 0.5, "rad")),
        floor: r.optional_table("floor", floor),
        initial_toe_m: r.numbers("initial_toe_m", range(0.0, 0.5, "m")),
        imu: r.table("imu", imu_errors),
        lidar: r.optional_table("lidar", lidar_errors),
        mocap: r.optional_table("mocap", mocap_server),
        bus_timing: r.flag("bus_timing"),
        operator_press_s: r.number("operator_press_s", second),
        operator_release_s: r.optional_number("operator_release_s", second),
    }
}

fn pushes(r: &Reader<'_>) -> Vec<Push> {
    let rows = r.rows("pushes", ["time_s", "impulse_ns"], [range(0.0, 1e6, "s"), IMPULSE]);
    let mut pushes: Vec<Push> = rows.into_iter().map(|[time_s, impulse_ns]| Push { time_s, impulse_ns }).collect();
    pushes.sort_by(|a, b| a.time_s.total_cmp(&b.time_s));
    pushes
}

fn model_error(r: &Reader<'_>) -> ModelError {
    let share = range(0.0, 0.9, "1");
    ModelError { inertia: r.number("inertia", share), friction: r.number("friction", share) }
}

fn random_pushes(r: &Reader<'_>) -> RandomPushes {
    RandomPushes {
        from_s: r.number("from_s", range(0.0, 1e6, "s")),
        interval_s: r.number("interval_s", range(0.1, 1e6, "s")),
        impulse_ns: r.number("impulse_ns", IMPULSE),
    }
}

/// The real machine; its compliance stands in `sim.hip_elasticity` alone.
fn body(r: &Reader<'_>) -> Model {
    let body = model(r);
    if body.hip_elasticity.is_some() {
        r.refuse("hip_elasticity", "belongs into sim.hip_elasticity");
    }
    body
}

fn floor(r: &Reader<'_>) -> Floor {
    let (height, place) = (range(-1.0, 1.0, "m"), range(-1e3, 1e6, "m"));
    let steps = r.pairs("steps", place, height);
    if steps.windows(2).any(|w| w[1][0] <= w[0][0]) {
        r.refuse("steps", "places must rise");
    }
    Floor {
        tile_m: r.number("tile_m", range(0.01, 10.0, "m")),
        half_width_m: r.number("half_width_m", range(0.0, 0.2, "m")),
        level_until_m: r.number("level_until_m", place),
        steps,
        tip_radius_m: r.number("tip_radius_m", range(0.0, 0.05, "m")),
        profile: floor_profile::profile(r, "profile"),
    }
}

fn imu_errors(r: &Reader<'_>) -> ImuErrors {
    let angle = range(0.0, 0.5, "rad");
    ImuErrors {
        static_error_rad: r.number("static_error_rad", angle),
        dynamic_error_rad: r.number("dynamic_error_rad", angle),
        drift_rad_sqrt_s: r.number("drift_rad_sqrt_s", range(0.0, 0.1, "rad/sqrt(s)")),
        lag_s: r.number("lag_s", range(0.0, 1.0, "s")),
        rate_noise_rad_s: r.number("rate_noise_rad_s", range(0.0, 1.0, "rad/s")),
        attitude_noise_rad: r.number("attitude_noise_rad", angle),
        accel_noise_g: r.number("accel_noise_g", range(0.0, 1.0, "g")),
        latency_s: r.number("latency_s", range(0.0, 1.0, "s")),
    }
}

fn lidar_errors(r: &Reader<'_>) -> LidarErrors {
    let share = range(0.0, 1.0, "1");
    LidarErrors {
        noise_m: r.number("noise_m", range(0.0, 0.5, "m")),
        offset_m: r.number("offset_m", range(-0.5, 0.5, "m")),
        lost_share: r.number("lost_share", share),
        clutter_share: r.number("clutter_share", share),
    }
}

fn mocap_server(r: &Reader<'_>) -> MocapServer {
    MocapServer {
        rate_hz: r.integer("rate_hz", 1, 1000, "Hz"),
        latency: Span::from_s(r.number("latency_s", range(0.0, 1.0, "s"))),
        noise_m: r.number("noise_m", range(0.0, 0.1, "m")),
    }
}
