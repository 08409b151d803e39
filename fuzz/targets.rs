//! What is fuzzed: one function per parser of outside bytes. Shared by the targets of cargo-fuzz (`fuzz_targets/`) and by
//! `tests/fuzz.rs`, which feeds them seeded bytes and the kept regressions with the ordinary toolchain.
//!
//! A function takes any bytes, and must neither panic nor hang nor allocate out of proportion. What it checks beyond that
//! are promises: what was not understood changes nothing, numbers that are not finite do not come out.

use compass::base::time::{Span, Stamp};
use compass::bus::line::Line;
use compass::config;
use compass::config::checked::{Config, Imu, ImuProtocol, Lidar, Mocap, MocapSource};
use compass::identify::experiment::Table;
use compass::model::rig::Rig;
use compass::msg::{
    BusFrame, BusHealth, CanFrame, DriveCommands, DriveFeedbacks, DriveGoal, FrameBatch, ImuBatch, Status,
};
use compass::record::live::{Block, Parser, tick_of};
use compass::record::scan::Scan;
use compass::record::stream::{Assembled, Assembly, Stream};
use compass::sensor::imu::ImuReader;
use compass::sensor::lidar::LidarReader;
use compass::sensor::mocap::MocapReader;
use compass::sensor::natnet::{self, Version};
use compass::sensor::operator::remote::packet::Key;
use compass::sensor::operator::remote::receiver::Receiver;
use compass::sensor::operator::remote::sender::Sender;
use compass::sensor::operator::socket::SocketHand;
use compass::sensor::{mip, scip, vicon};
use std::cell::RefCell;
use std::io::Cursor;
use std::net::SocketAddr;
use std::os::unix::net::UnixDatagram;

/// A target: its name, what it does, and bytes to begin with.
pub type Target = (&'static str, fn(&[u8]), &'static [&'static [u8]]);

/// All of them.
pub const TARGETS: &[Target] = &[
    (
        "can_line",
        can_line,
        &[
            &[0, 1, 0x83, 0x05, 8, 0x60, 0x17, 0x10, 0, 0, 0, 0, 0],
            &[0, 1, 1, 0x07, 1, 0, 1, 0x81, 0x05, 8, 0x43, 0, 0x10, 0, 0x92, 1, 2, 0],
            &[5, 1, 0x29, 0, 8, 0, 0, 0, 0, 0, 0, 0, 0],
            &[0x83, 1, 4, 4, 12, 0x24, 4, 0, 10, 0, 0, 0, 0, 0, 0, 0x22, 0],
        ],
    ),
    ("imu_gx3", imu_gx3, &[&[20, 0xFA, 0x75, 0xB4, 0xC4, 0xC2, 0, 0, 0xF4, 0x24, 2, 0x9E]]),
    ("imu_mip", imu_mip, &[&[20, 0x75, 0x65, 0x0C, 4, 4, 0xF1, 8, 0, 0xE7, 0xBA]]),
    ("assembly", assembly, &[&[0, 4, 0, 1, 0, 0]]),
    ("mcap", mcap, &[b"\x89MCAP0\r\n\x01\x08\0\0\0\0\0\0\0\0\0\0\0\0\0\0\0"]),
    ("csv", csv, &[b"t_s,theta_rad\n0,1\n0.1,nan\n"]),
    ("rig", rig, &[b"[mechanism]\nkind = \"pendulum\"\n"]),
    ("config", config_text, &[b"robot.imu.rate_hz = 500\ncontrol.lqr_r = 0.1\n"]),
    (
        "operator_socket",
        operator_socket,
        &[&[1], &[0], &[2, 0, 0, 0, 0, 0, 0, 0xD0, 0x3F], &[3, 1, 0, 0, 0, 0, 0, 0, 0xD0, 0x3F]],
    ),
    ("remote", remote, &[b"CGR1\x01", b"CGR1\x03", b"CGR1\x05"]),
    ("watch_socket", watch_socket, &[b"COMPASS1\0\0\0\0\0\0\0\0\x02\0\0\0ab\x05\0\0\0\0"]),
    ("scip", scanner, &[b"MD0000108001000\n99b\n0000@\n", b"PP\n00P\nDMIN:23;7\n\n"]),
    (
        "lidar_dialogue",
        lidar_dialogue,
        &[
            &[120, 0x80, 1, 0x80, 1, 0xFF, 1, 0x80, 1, 0x84, b'0', b'0', b'0', b'@'],
            b"\x01\x36MD0000108001000\n99b\n0000@\n0C?0C?0C?0C?0C?0C?0C?0C?0C?n\n\n",
        ],
    ),
    ("natnet", natnet_frame, &[b"\x07\0\x04\0\x01\0\0\0"]),
    ("vicon", vicon_block, &[&[1, 0, 0, 0, 1, 0, 72, 0]]),
];

/// Cuts bytes into pieces with a time before each: a byte of milliseconds, then as many bytes as `piece` takes.
fn timed<'a>(mut bytes: &'a [u8], piece: impl Fn(&[u8]) -> usize + 'a) -> impl Iterator<Item = (Span, &'a [u8])> + 'a {
    std::iter::from_fn(move || {
        let (wait, rest) = bytes.split_first()?;
        let (taken, left) = rest.split_at(piece(rest).min(rest.len()));
        bytes = left;
        Some((Span::from_ms(i64::from(*wait)), taken))
    })
}

/// Robots whose drives speak every protocol that there is: `config/examples`.
const ROBOTS: [&str; 7] = [
    "",
    include_str!("../config/examples/mit.toml"),
    include_str!("../config/examples/mixed.toml"),
    include_str!("../config/examples/moteus.toml"),
    include_str!("../config/examples/myactuator.toml"),
    include_str!("../config/examples/odrive.toml"),
    include_str!("../config/examples/profile_torque.toml"),
];

/// Frames from drives that do as they please, over up to a minute, on a bus of the robot that the first byte names. The wire
/// works: what was sent is echoed, unless a frame says otherwise.
pub fn can_line(bytes: &[u8]) {
    thread_local!(static CONFIGS: Vec<Config> =
        ROBOTS.map(|text| config::load_text("robot", text, &[]).unwrap().config).into());
    let Some((robot, bytes)) = bytes.split_first() else { return };
    let mut line = CONFIGS.with(|configs| {
        let config = &configs[usize::from(robot & 0x7F) % configs.len()];
        Line::new(&config.robot, usize::from(robot >> 7), &config.real_time).unwrap()
    });
    let mut now = Stamp(1_000_000_000);
    let mut sent = FrameBatch::default();
    // Identifier, length, data. The time before it is some milliseconds, or long enough for anything to be given up.
    for (wait, frame) in timed(bytes, |rest| 3 + usize::from(rest.get(2).copied().unwrap_or(0) % 65)) {
        now += if wait < Span::from_ms(0xF0) { Span(wait.0 / 16 + 1_000_000) } else { wait };
        let [low, high, _, data @ ..] = frame else { continue };
        let mut received = FrameBatch::default();
        if high & 0x10 == 0 {
            for ours in &sent {
                received.push(BusFrame { stamp: now, own: true, ..ours });
            }
        }
        let id = u32::from(*low) | u32::from(*high & 7) << 8 | u32::from(high >> 6) << 30;
        let frame = if data.len() > 8 { CanFrame::fd(id, data, 0x50) } else { CanFrame::classic(id, data) };
        received.push(BusFrame { stamp: now, frame, own: high & 8 != 0 });
        let mut feedbacks = DriveFeedbacks::default();
        line.receive(now, now, &received, BusHealth::Active, &mut feedbacks);
        let mut commands = DriveCommands { stamp: now, ..DriveCommands::default() };
        if high & 0x20 != 0 {
            for drive in &mut commands.drives {
                (drive.goal, drive.torque_permille) = (DriveGoal::Enabled, 100);
            }
        }
        sent = FrameBatch::default();
        line.transmit(now, &commands, &mut sent);
        assert_eq!(sent.dropped, 0, "a cycle has room for what we send");
    }
}

fn imu(bytes: &[u8], protocol: ImuProtocol) {
    thread_local!(static IMU: Imu = config::load(None, &[]).unwrap().config.robot.imu);
    let mut reader = IMU.with(|imu| ImuReader::new(&Imu { protocol, ..imu.clone() }));
    let mut now = Stamp(1_000_000_000);
    // Whatever was asked, 16 bytes come.
    for (wait, piece) in timed(bytes, |_| 16) {
        now += wait;
        reader.transmit(now);
        let mut batch = ImuBatch::default();
        reader.receive(now, piece, &mut batch);
        for sample in batch.as_slice() {
            let numbers = sample.euler_rad.iter().chain(&sample.rate_rad_s).chain(&sample.accel_g);
            assert!(numbers.clone().all(|x| x.is_finite()));
        }
    }
}

/// A serial line with a 3DM-GX3, or with anything.
pub fn imu_gx3(bytes: &[u8]) {
    imu(bytes, ImuProtocol::Gx3);
}

/// A serial line with a MIP device, or with anything.
pub fn imu_mip(bytes: &[u8]) {
    imu(bytes, ImuProtocol::Mip);
    let mut parser = mip::Parser::default();
    for byte in bytes {
        parser.push(*byte, |packet| {
            let _read = (packet.measurement(), packet.fields().count());
        });
    }
}

/// Messages of a recording: stream, length, bytes.
pub fn assembly(mut bytes: &[u8]) {
    let mut assembly = Assembly::default();
    while let [stream, length, rest @ ..] = bytes {
        let (message, left) = rest.split_at(usize::from(*length).min(rest.len()));
        bytes = left;
        let stream = Stream::ALL[usize::from(*stream) % Stream::ALL.len()];
        // A whole tick of 4 kB is not made of chance; what is told is that it is not.
        assert!(!matches!(assembly.take(stream, message), Assembled::Tick(_)) || bytes.len() > 1000);
    }
}

/// A recording, whole or not.
pub fn mcap(bytes: &[u8]) {
    let Ok(Some(mut scan)) = Scan::new(Cursor::new(bytes)) else { return };
    while let Ok(Some(_)) = scan.next_record() {}
}

/// A table of somebody else.
pub fn csv(bytes: &[u8]) {
    if let Ok(table) = Table::parse("fuzz.csv", bytes) {
        assert!(table.names().len() <= bytes.len());
    }
}

/// A model file.
pub fn rig(bytes: &[u8]) {
    drop(Rig::parse(&String::from_utf8_lossy(bytes), "fuzz.toml"));
}

/// The configuration of a recording, which may be damaged.
pub fn config_text(bytes: &[u8]) {
    drop(config::from_canonical(&String::from_utf8_lossy(bytes), &[]));
}

/// Datagrams at the dead-man's socket.
pub fn operator_socket(bytes: &[u8]) {
    thread_local!(static ENDS: RefCell<(SocketHand, UnixDatagram)> = {
        let path = std::env::temp_dir().join(format!("compass-fuzz-{}-{:?}", std::process::id(), std::thread::current().id()));
        let hand = SocketHand::bind(&path, Span::from_ms(100), Some(0.5)).unwrap();
        let sender = UnixDatagram::unbound().unwrap();
        sender.connect(&path).unwrap();
        // The socket lives on without its name.
        std::fs::remove_file(&path).unwrap();
        RefCell::new((hand, sender))
    });
    ENDS.with_borrow_mut(|(hand, sender)| {
        sender.send(bytes).unwrap();
        let sample = hand.poll(Stamp(1_000_000_000));
        assert!(sample.zero_angle_rad.is_finite() && (0.0..=0.5).contains(&sample.speed_m_s));
        assert!(bytes != [0] || !sample.dead_man);
    });
}

/// Datagrams at both ends of a remote hand. Without the secret nothing is answered and nothing changes.
pub fn remote(bytes: &[u8]) {
    let key = || Key::new(b"a secret of two ends").unwrap();
    let mut receiver = Receiver::new(key(), Span::from_ms(100), Some(0.5));
    let from = SocketAddr::from(([127, 0, 0, 1], 1));
    let now = Stamp(1_000_000_000);
    assert!(receiver.take(now, from, bytes, || Some([7; 16])).is_none());
    assert!(receiver.sample().sequence == 0 && receiver.view(now, &Status::default()).is_none());
    assert!(!Sender::new(key(), [1; 16]).take(now, bytes));
}

/// What `compass watch` reads.
pub fn watch_socket(bytes: &[u8]) {
    let mut parser = Parser::default();
    for piece in bytes.chunks(7) {
        parser.push(piece);
        while let Ok(Some(block)) = parser.take() {
            if let Block::Tick(tick) = block {
                drop(tick_of(&tick, |_| ()));
            }
        }
    }
}

/// A laser scanner, or anything.
pub fn scanner(bytes: &[u8]) {
    let (mut reader, mut parameters) = (scip::Reader::default(), scip::Parameters::default());
    for byte in bytes {
        reader.push(*byte, |line| {
            parameters.take(line);
        });
    }
    assert!(!parameters.is_sound() || parameters.angle_rad(parameters.last).is_finite());
    assert!(reader.scan().count <= scip::STEPS);
}

/// What a sound UTM-30LX-EW says of itself; the check of each line follows.
const SCANNER: [&str; 8] =
    ["MODL:UTM-30LX-EW", "DMIN:23", "DMAX:60000", "ARES:1440", "AMIN:0", "AMAX:1080", "AFRT:540", "SCAN:2400"];

/// The whole dialogue with a scanner, over minutes: a byte of milliseconds, a length, bytes. A length with its high bit set
/// answers the last request as a sound device would, with the bytes as a further line that has the check it should have.
pub fn lidar_dialogue(bytes: &[u8]) {
    thread_local!(static LIDAR: Lidar = config::load_text("lidar", include_str!("../config/examples/lidar.toml"), &[])
        .unwrap().config.robot.lidar.unwrap());
    let mut reader = LIDAR.with(LidarReader::new);
    let mut now = Stamp(1_000_000_000);
    let mut request: &[u8] = b"";
    let check = |sample: &compass::msg::LidarSample| {
        let numbers =
            [sample.lean_rad, sample.height_m, sample.lean_sigma_rad, sample.height_sigma_m, sample.roughness_m];
        assert!(numbers.iter().all(|x| x.is_finite()), "{sample:?}");
    };
    let length = |rest: &[u8]| 1 + usize::from(rest.first().copied().unwrap_or(0) & 0x7F);
    for (wait, piece) in timed(bytes, length) {
        now += wait;
        request = reader.transmit(now, check).unwrap_or(request);
        let [kind, data @ ..] = piece else { continue };
        if kind & 0x80 == 0 {
            reader.receive(now, data, check);
            continue;
        }
        let mut answer = request.to_vec();
        answer.extend(b"00P\n");
        if request == scip::PARAMETERS {
            for line in SCANNER {
                answer.extend(line.bytes().chain([b';', scip::check(line.as_bytes()), b'\n']));
            }
        }
        if !data.is_empty() {
            answer.extend(data.iter().copied().chain([scip::check(data), b'\n']));
        }
        answer.push(b'\n');
        reader.receive(now, &answer, check);
    }
    let counters = reader.counters();
    assert!(u64::from(counters.scans) <= bytes.len() as u64, "{counters:?}");
}

/// Datagrams of motion capture.
pub fn natnet_frame(bytes: &[u8]) {
    for version in [Version { major: 3, minor: 0 }, Version { major: 4, minor: 1 }] {
        natnet::read(bytes, version, |_| ()).ok();
    }
    poses(bytes, MocapSource::NatNet { server: SocketAddr::from(([127, 0, 0, 1], 2)), body: 1 });
}

/// Blocks of motion capture.
pub fn vicon_block(bytes: &[u8]) {
    vicon::read(bytes, |object| assert!(object.position_m.iter().all(|x| x.is_finite())));
    poses(bytes, MocapSource::Vicon { body: "robot".into() });
}

/// Datagrams of a source: the length of each, then its bytes.
fn poses(bytes: &[u8], source: MocapSource) {
    let mut reader = MocapReader::new(&Mocap { listen: SocketAddr::from(([127, 0, 0, 1], 1)), source });
    reader.take(Stamp(1), bytes);
    for (wait, datagram) in timed(bytes, |rest| rest.first().map_or(1, |n| usize::from(*n))) {
        if let Some(pose) = reader.take(Stamp(1_000_000_000) + wait, datagram) {
            assert!(!pose.tracked || pose.position_m.iter().all(|x| x.is_finite()));
        }
    }
}
