//! Reads `robot`: model, drives, buses, sensors, limits. RT: before arming only.

use super::checked::{
    BusBackend, BusConfig, Hip, HipElasticity, Imu, ImuMessage, ImuProtocol, Limits, Model, Parameter, Robot,
    SerialBackend, Toe,
};
use super::drive::drive;
use super::lidar::lidar;
use super::mocap::mocap;
use super::operator::operator;
use super::reader::{Reader, range};
use std::f64::consts::{PI, TAU};

/// In the order of `msg::Drive`.
pub(super) const DRIVE_KEYS: [&str; 5] = ["hip", "inner_toe_a", "inner_toe_b", "outer_toe_a", "outer_toe_b"];

pub(super) fn robot(r: &Reader<'_>) -> Robot {
    let (operator, operator_speed) = r.table("operator", operator);
    Robot {
        model: r.table("model", model),
        hip: r.table("hip", hip),
        toe: r.table("toe", toe),
        drives: r.table("drives", |d| DRIVE_KEYS.map(|name| d.table(name, drive))),
        buses: [r.table("bus0", bus), r.table("bus1", bus)],
        imu: r.table("imu", imu),
        limits: r.table("limits", limits),
        operator,
        operator_speed,
        lidar: r.optional_table("lidar", lidar),
        mocap: r.optional_table("mocap", mocap),
    }
}

pub(super) fn model(r: &Reader<'_>) -> Model {
    let leg_length_m = r.parameter("leg_length", range(0.05, 5.0, "m"), &[("m", 1.0)]);
    let total_mass_kg = r.parameter("total_mass", range(0.1, 500.0, "kg"), &[("kg", 1.0)]);
    // m_t l^2 turns the normalised friction of Thesis table 4.1 into SI.
    let norm = total_mass_kg.value * leg_length_m.value * leg_length_m.value;
    Model {
        gravity_m_s2: r.parameter("gravity", range(1.0, 30.0, "m/s^2"), &[("m/s^2", 1.0)]),
        c: ["c1", "c2", "c3", "c4", "c5", "c6"].map(|key| shape_number(r, key)),
        viscous_nm_s_rad: r.parameter("viscous", range(0.0, 1e3, "1"), &[("Nm s/rad", 1.0), ("1/s", norm)]),
        coulomb_nm: r.parameter("coulomb", range(0.0, 1e3, "1"), &[("Nm", 1.0), ("1/s^2", norm)]),
        hip_elasticity: r.optional_table("hip_elasticity", elasticity),
        leg_length_m,
        total_mass_kg,
    }
}

fn shape_number(r: &Reader<'_>, key: &'static str) -> Parameter {
    r.parameter(key, range(-10.0, 10.0, "1"), &[("1", 1.0)])
}

pub(super) fn elasticity(r: &Reader<'_>) -> HipElasticity {
    HipElasticity {
        stiffness_nm_rad: r.number("stiffness_nm_rad", range(1.0, 1e6, "Nm/rad")),
        damping_nm_s_rad: r.number("damping_nm_s_rad", range(0.0, 1e3, "Nm s/rad")),
        rotor_inertia_kg_m2: r.number("rotor_inertia_kg_m2", range(1e-4, 10.0, "kg m^2")),
    }
}

fn sign(r: &Reader<'_>, key: &'static str) -> f64 {
    let value: i32 = r.integer(key, -1, 1, "1");
    if value == 0 {
        r.refuse(key, "must be 1 or -1");
    }
    f64::from(value)
}

fn hip(r: &Reader<'_>) -> Hip {
    Hip {
        gear_ratio: r.number("gear_ratio", range(1.0, 500.0, "1")),
        gear_efficiency: r.number("gear_efficiency", range(0.1, 1.0, "1")),
        motor_sign: sign(r, "motor_sign"),
        encoder_counts_per_turn: r.number("encoder_counts_per_turn", range(100.0, 1e8, "counts")),
        encoder_offset_rad: r.number("encoder_offset_rad", range(-TAU, TAU, "rad")),
    }
}

fn toe(r: &Reader<'_>) -> Toe {
    let length = range(0.0, 0.5, "m");
    let toe = Toe {
        stroke_m: r.number("stroke_m", range(0.001, 0.5, "m")),
        rate_limit_m_s: r.number("rate_limit_m_s", range(0.001, 10.0, "m/s")),
        acceleration_limit_m_s2: r.number("acceleration_limit_m_s2", range(0.01, 100.0, "m/s^2")),
        force_limit_n: r.number("force_limit_n", range(1.0, 1e5, "N")),
        counts_per_m: r.number("counts_per_m", range(1e3, 1e9, "counts/m")),
        spring_n_m: r.number("spring_n_m", range(10.0, 1e7, "N/m")),
        preload_n: r.number("preload_n", range(0.0, 1e4, "N")),
        pot_counts_per_m: r.number("pot_counts_per_m", range(1e3, 1e7, "counts/m")),
        pot_noise_m: r.number("pot_noise_m", range(0.0, 0.01, "m")),
        extended_m: r.number("extended_m", length),
        retracted_m: r.number("retracted_m", length),
        homing_rate_m_s: r.number("homing_rate_m_s", range(0.001, 1.0, "m/s")),
        homing_torque_permille: r.integer("homing_torque_permille", 1, 2000, "1/1000 of rated"),
    };
    if toe.extended_m > toe.stroke_m {
        r.refuse("extended_m", &format!("must be within the stroke of {} m", toe.stroke_m));
    }
    if toe.homing_rate_m_s > toe.rate_limit_m_s {
        r.refuse("homing_rate_m_s", &format!("must be at most rate_limit_m_s = {} m/s", toe.rate_limit_m_s));
    }
    if toe.retracted_m > toe.extended_m {
        r.refuse("retracted_m", &format!("must be at most extended_m = {} m", toe.extended_m));
    }
    toe
}

fn bus(r: &Reader<'_>) -> BusConfig {
    BusConfig {
        backend: BusBackend::parse(&r.text("backend"), |what| r.refuse("backend", what)),
        bitrate: r.integer("bitrate_bit_s", 10_000, 1_000_000, "bit/s"),
        data_bitrate: r.optional_integer("data_bitrate_bit_s", 1_000_000, 8_000_000, "bit/s"),
        echo_timeout: r.span("echo_timeout_ms", 1.0, 1000.0),
    }
}

impl BusBackend {
    fn parse(text: &str, mut refuse: impl FnMut(&str)) -> Self {
        // IFNAMSIZ of Linux is 16 with the final NUL.
        match text.strip_prefix("socketcan:") {
            Some(name) if !name.is_empty() && name.len() < 16 => Self::SocketCan(name.to_owned()),
            _ => {
                if text != "mock" {
                    refuse("must be \"mock\" or \"socketcan:NAME\" with an interface name of 1 to 15 letters");
                }
                Self::Mock
            }
        }
    }
}

impl SerialBackend {
    fn parse(text: &str, mut refuse: impl FnMut(&str)) -> Self {
        if text.starts_with('/') {
            return Self::Device(text.to_owned());
        }
        if text != "mock" {
            refuse("must be \"mock\" or the path of a device, such as \"/dev/ttyUSB0\"");
        }
        Self::Mock
    }
}

/// Device limit for anything with orientation (3DM-GX3 data communications protocol).
const MAX_ORIENTATION_HZ: u32 = 500;
const BITS_PER_BYTE: u32 = 10;

fn imu(r: &Reader<'_>) -> Imu {
    // Left out in robots that were written down before there was another.
    const PROTOCOLS: &[(&str, ImuProtocol)] = &[("gx3", ImuProtocol::Gx3), ("mip", ImuProtocol::Mip)];
    const MESSAGES: &[(&str, ImuMessage)] =
        &[("euler_rate", ImuMessage::EulerRate), ("accel_rate", ImuMessage::AccelRate)];
    let imu = Imu {
        backend: SerialBackend::parse(&r.text("backend"), |what| r.refuse("backend", what)),
        protocol: r.optional_choice("protocol", PROTOCOLS).unwrap_or(ImuProtocol::Gx3),
        baud: r.integer("baud_bit_s", 115_200, 921_600, "bit/s"),
        message: r.choice("message", MESSAGES, ImuMessage::EulerRate),
        rate_hz: r.integer("rate_hz", 1, 1000, "Hz"),
        sign: sign(r, "sign"),
        offset_rad: r.number("offset_rad", range(-PI, PI, "rad")),
        latency: r.span("latency_ms", 0.0, 50.0),
    };
    if imu.rate_hz > 0 && 1000 % imu.rate_hz != 0 {
        r.refuse("rate_hz", "must divide 1000 Hz (the device decimates by a whole number)");
    }
    let limited = imu.protocol == ImuProtocol::Gx3 && imu.message == ImuMessage::EulerRate;
    if limited && imu.rate_hz > MAX_ORIENTATION_HZ {
        r.refuse("rate_hz", "must be 1 to 500 Hz with message \"euler_rate\" (limit of the device for orientation)");
    }
    let bytes = match imu.protocol {
        ImuProtocol::Gx3 => 31,
        ImuProtocol::Mip => 48,
    };
    if imu.rate_hz * bytes * BITS_PER_BYTE > imu.baud {
        r.refuse("rate_hz", &format!("needs {} bit/s", imu.rate_hz * bytes * BITS_PER_BYTE));
    }
    imu
}

fn limits(r: &Reader<'_>) -> Limits {
    Limits {
        hip_torque_nm: r.number("hip_torque_nm", range(0.1, 1000.0, "Nm")),
        hip_torque_rate_nm_s: r.number("hip_torque_rate_nm_s", range(1.0, 1e6, "Nm/s")),
        demand_factor: r.number("demand_factor", range(1.0, 1e4, "1")),
        tilt_rad: r.number("tilt_rad", range(0.01, PI, "rad")),
        swing_rad: r.number("swing_rad", range(0.01, PI, "rad")),
        rate_rad_s: r.number("rate_rad_s", range(0.1, 100.0, "rad/s")),
        innovation_rad: r.number("innovation_rad", range(0.001, PI, "rad")),
        imu_age: r.span("imu_age_ms", 1.0, 1000.0),
        drive_age: r.span("drive_age_ms", 1.0, 1000.0),
        operator_age: r.span("operator_age_ms", 10.0, 1000.0),
        enable_timeout: r.span("enable_timeout_ms", 10.0, 60_000.0),
        ramp: r.span("ramp_ms", 0.0, 10_000.0),
        overruns_per_s: r.integer("overruns_per_s", 1, 1000, "1/s"),
        arm_tilt_rad: r.number("arm_tilt_rad", range(0.001, PI, "rad")),
    }
}
