//! Any input whatever, fed to the real tick of a robot that stands, arms or balances: the invariants hold.

use super::invariants::Invariants;
use crate::base::time::{Span, Stamp};
use crate::config;
use crate::config::checked::Config;
use crate::msg::{
    BUSES, BusFrame, BusHealth, CanFrame, FloorVerdict, ImuSample, LidarSample, LidarState, MAX_IMU, TickInput,
};
use crate::sim::lockstep::Lockstep;
use proptest::prelude::*;
use std::path::Path;

/// What is done to an input.
#[derive(Clone, Debug)]
enum Tampering {
    Now(i64),
    Index(u64),
    Skipped(u32),
    Latency(i64),
    Missing(u32),
    Stop,
    Unsent([bool; BUSES]),
    Health(usize, u8),
    Heard(usize, i64),
    ImuHeard(i64),
    NoFrames(usize),
    Frame {
        bus: usize,
        id: u32,
        data: [u8; 8],
        len: usize,
        own: bool,
        age: i64,
    },
    /// A frame that came is twisted in one byte.
    Twisted {
        bus: usize,
        which: usize,
        byte: usize,
        by: u8,
    },
    NoImu,
    ImuCount(u8),
    Imu {
        age: i64,
        numbers: [f64; 9],
        has_attitude: bool,
    },
    Hand {
        age: i64,
        held: bool,
        zeroings: u32,
        angle: f64,
    },
    Lidar {
        age: i64,
        state: u8,
        numbers: [f64; 5],
    },
}

/// The robot that comes with the program, one with a lidar, and one whose drives do not speak CANopen.
fn robot(name: Option<&str>) -> Config {
    let path = name.map(|name| Path::new(env!("CARGO_MANIFEST_DIR")).join("config/examples").join(name));
    config::load(path.as_deref(), &[]).unwrap().config
}

fn any_number() -> impl Strategy<Value = f64> {
    prop_oneof![
        Just(f64::NAN),
        Just(f64::INFINITY),
        Just(f64::NEG_INFINITY),
        Just(0.0),
        any::<f64>(),
        -4.0..4.0_f64,
        -1e6..1e6_f64,
    ]
}

fn any_time() -> impl Strategy<Value = i64> {
    prop_oneof![Just(i64::MIN), Just(i64::MAX), Just(0), any::<i64>(), -100_000_000..100_000_000_i64]
}

fn any_identifier() -> impl Strategy<Value = u32> {
    // Of the robot's own nodes, mostly.
    prop_oneof![
        4 => (prop::sample::select(vec![0x000_u32, 0x080, 0x180, 0x200, 0x580, 0x600, 0x700]), 0_u32..8).prop_map(|(f, n)| f + n),
        1 => 0_u32..0x800,
        1 => any::<u32>(),
    ]
}

fn tampering() -> impl Strategy<Value = Tampering> {
    let bus = 0..BUSES;
    prop_oneof![
        1 => any_time().prop_map(Tampering::Now),
        1 => any::<u64>().prop_map(Tampering::Index),
        1 => any::<u32>().prop_map(Tampering::Skipped),
        1 => any_time().prop_map(Tampering::Latency),
        1 => any::<u32>().prop_map(Tampering::Missing),
        1 => Just(Tampering::Stop),
        1 => any::<[bool; BUSES]>().prop_map(Tampering::Unsent),
        1 => (bus.clone(), 0_u8..6).prop_map(|(bus, health)| Tampering::Health(bus, health)),
        1 => (bus.clone(), any_time()).prop_map(|(bus, time)| Tampering::Heard(bus, time)),
        1 => any_time().prop_map(Tampering::ImuHeard),
        1 => bus.clone().prop_map(Tampering::NoFrames),
        3 => (bus.clone(), any_identifier(), any::<[u8; 8]>(), 0_usize..=8, any::<bool>(), any_time())
            .prop_map(|(bus, id, data, len, own, age)| Tampering::Frame { bus, id, data, len, own, age }),
        3 => (bus, any::<usize>(), 0_usize..8, any::<u8>())
            .prop_map(|(bus, which, byte, by)| Tampering::Twisted { bus, which, byte, by }),
        1 => Just(Tampering::NoImu),
        1 => any::<u8>().prop_map(Tampering::ImuCount),
        3 => (any_time(), prop::array::uniform9(any_number()), any::<bool>())
            .prop_map(|(age, numbers, has_attitude)| Tampering::Imu { age, numbers, has_attitude }),
        3 => (any_time(), any::<bool>(), any::<u32>(), any_number())
            .prop_map(|(age, held, zeroings, angle)| Tampering::Hand { age, held, zeroings, angle }),
        2 => (any_time(), 0_u8..10, prop::array::uniform5(any_number()))
            .prop_map(|(age, state, numbers)| Tampering::Lidar { age, state, numbers }),
    ]
}

impl Tampering {
    fn apply(&self, input: &mut TickInput) {
        let now = input.now;
        let at = |age: i64| Stamp(now.0.saturating_sub(age));
        match *self {
            Self::Now(by) => input.now = Stamp(now.0.saturating_add(by)),
            Self::Index(index) => input.index = index,
            Self::Skipped(skipped) => input.skipped = skipped,
            Self::Latency(latency) => (input.wake_latency, input.step_time) = (Span(latency), Span(latency)),
            Self::Missing(missing) => input.real_time_missing = missing,
            Self::Stop => input.stop_requested = true,
            Self::Unsent(unsent) => input.unsent = unsent,
            Self::Health(bus, health) => input.bus_health[bus] = BusHealth::from_u8(health).unwrap_or(BusHealth::Down),
            Self::Heard(bus, age) => input.heard_until[bus] = at(age),
            Self::ImuHeard(age) => input.imu_heard_until = at(age),
            Self::NoFrames(bus) => input.received[bus].clear(),
            Self::Frame { bus, id, data, len, own, age } => {
                let frame = CanFrame::classic(id, &data[..len]);
                input.received[bus].push(BusFrame { stamp: at(age), own, frame });
            }
            Self::Twisted { bus, which, byte, by } => {
                let frames: Vec<BusFrame> = input.received[bus].iter().collect();
                input.received[bus].clear();
                let twisted = which % frames.len().max(1);
                for (k, mut frame) in frames.into_iter().enumerate() {
                    frame.frame.data[byte] ^= if k == twisted { by } else { 0 };
                    input.received[bus].push(frame);
                }
            }
            Self::NoImu => input.imu.count = 0,
            Self::ImuCount(count) => input.imu.count = count,
            Self::Imu { age, numbers, has_attitude } => {
                let three = |k: usize| [numbers[k], numbers[k + 1], numbers[k + 2]];
                let sample = ImuSample {
                    stamp: at(age),
                    has_attitude,
                    euler_rad: three(0),
                    rate_rad_s: three(3),
                    accel_g: three(6),
                    ..ImuSample::default()
                };
                input.imu.samples = [sample; MAX_IMU];
                input.imu.count = input.imu.count.max(1);
            }
            Self::Hand { age, held, zeroings, angle } => {
                let hand = &mut input.operator;
                (hand.stamp, hand.dead_man) = (at(age), held);
                (hand.zeroings, hand.zero_angle_rad) = (zeroings, angle);
            }
            Self::Lidar { age, state, numbers: [lean, lean_sigma, height, height_sigma, roughness] } => {
                input.lidar = LidarSample {
                    stamp: at(age),
                    arrived: at(age),
                    state: LidarState::from_u8(state).unwrap_or(LidarState::Gone),
                    verdict: FloorVerdict::Found,
                    lean_rad: lean,
                    lean_sigma_rad: lean_sigma,
                    height_m: height,
                    height_sigma_m: height_sigma,
                    roughness_m: roughness,
                    ..LidarSample::default()
                };
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 48, ..ProptestConfig::default() })]
    #[test]
    fn whatever_is_fed_to_the_tick_the_invariants_hold(
        name in prop::sample::select(vec![None, Some("lidar.toml"), Some("mit.toml")]),
        // Before homing, while homing, about to arm, balancing.
        undisturbed in prop::sample::select(vec![0_u32, 150, 400, 520, 700, 1500]),
        ticks in prop::collection::vec(prop::option::weighted(0.3, prop::collection::vec(tampering(), 1..4)), 1..150),
    ) {
        let config = robot(name);
        let mut lockstep = Lockstep::with_rearming_hand(&config).unwrap();
        let mut invariants = Invariants::new(&config);
        for _ in 0..undisturbed {
            let looked = invariants.look(lockstep.step());
            prop_assert_eq!(looked, Ok(()));
        }
        for tampered in ticks {
            let record = lockstep.step_with(|input| tampered.iter().flatten().for_each(|t| t.apply(input)));
            let looked = invariants.look(record);
            prop_assert_eq!(looked, Ok(()), "after {:?}", tampered);
        }
        // And it comes back: what was fed does not stay.
        for _ in 0..50 {
            let looked = invariants.look(lockstep.step());
            prop_assert_eq!(looked, Ok(()));
        }
    }
}
