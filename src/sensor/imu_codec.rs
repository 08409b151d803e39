//! MicroStrain 3DM-GX3-25, single-byte protocol, big endian: requests, replies, and a parser that finds its feet again.
//!
//! A reply is the command's byte, data, and a checksum: the sum of all bytes before it modulo 65536. Streamed messages
//! carry the device's timer (62 500 Hz, 16 us) before the checksum. RT: yes, no allocation.

/// Ticks of the device's timer per second.
pub const TICKS_PER_S: u32 = 62_500;
/// Longest reply that is known here.
pub const MAX_REPLY: usize = 67;
/// Longest request.
pub const MAX_REQUEST: usize = 20;
/// Standard gravity, m/s^2: one g of the device.
pub const STANDARD_GRAVITY_M_S2: f64 = 9.80665;

/// Orientation quantities come at most so often, Hz (decimation 2).
pub const MAX_ORIENTATION_HZ: u32 = 500;
/// Anything comes at most so often, Hz (decimation 1).
pub const MAX_RATE_HZ: u32 = 1000;
/// Sampling flags after power-up: orientation, coning and sculling.
pub const DEFAULT_FLAGS: u16 = 0x0003;
/// Sampling flag: compute orientation.
pub const FLAG_ORIENTATION: u16 = 0x0001;

/// What a reply is, by its first byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Kind {
    /// Acceleration and rate.
    AccelRate = 0xC2,
    /// Continuous mode was set.
    SetContinuous = 0xC4,
    /// Acceleration, rate and orientation matrix.
    AccelRateMatrix = 0xC8,
    /// Euler angles.
    Euler = 0xCE,
    /// Euler angles and rates.
    EulerRate = 0xCF,
    /// Device mode.
    Mode = 0xD4,
    /// Sampling settings.
    Sampling = 0xDB,
    /// Identity string.
    Identity = 0xEA,
}

impl Kind {
    /// All of them.
    pub const ALL: [Self; 8] = [
        Self::AccelRate,
        Self::SetContinuous,
        Self::AccelRateMatrix,
        Self::Euler,
        Self::EulerRate,
        Self::Mode,
        Self::Sampling,
        Self::Identity,
    ];

    /// The kind of a reply that starts with this byte.
    #[must_use]
    pub fn from_u8(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|k| *k as u8 == byte)
    }

    /// Bytes of such a reply.
    #[must_use]
    pub const fn reply_bytes(self) -> usize {
        match self {
            Self::Mode => 4,
            Self::SetContinuous => 8,
            Self::Euler | Self::Sampling => 19,
            Self::Identity => 20,
            Self::AccelRate | Self::EulerRate => 31,
            Self::AccelRateMatrix => 67,
        }
    }

    /// True for what can be streamed.
    #[must_use]
    pub const fn is_measurement(self) -> bool {
        matches!(self, Self::AccelRate | Self::AccelRateMatrix | Self::Euler | Self::EulerRate)
    }

    /// True if the device must compute its orientation for it.
    #[must_use]
    pub const fn needs_orientation(self) -> bool {
        matches!(self, Self::AccelRateMatrix | Self::Euler | Self::EulerRate)
    }
}

/// Sampling settings (request and reply DB).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sampling {
    /// 1000 Hz over this is the rate.
    pub decimation: u16,
    /// Bit 0 orientation, 1 coning and sculling, ...
    pub flags: u16,
    /// Window of the gyro and accelerometer filter, samples.
    pub window: u8,
    /// Window of the magnetometer filter, samples.
    pub mag_window: u8,
    /// Time constant of the up compensation, s.
    pub up_s: u16,
    /// Time constant of the north compensation, s.
    pub north_s: u16,
    /// Magnetometer power.
    pub mag_power: u8,
}

impl Default for Sampling {
    /// As the device leaves the factory, at 100 Hz.
    fn default() -> Self {
        Self { decimation: 10, flags: DEFAULT_FLAGS, window: 15, mag_window: 17, up_s: 10, north_s: 10, mag_power: 0 }
    }
}

/// What the device is asked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Stop streaming; no reply.
    StopContinuous,
    /// Identity string number so and so.
    Identity(u8),
    /// Set the sampling.
    SetSampling(Sampling),
    /// Stream this.
    SetContinuous(Kind),
    /// Set or (0) ask the mode.
    Mode(u8),
    /// One measurement.
    Poll(Kind),
}

/// The bytes of a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RequestBytes {
    len: usize,
    bytes: [u8; MAX_REQUEST],
}

impl RequestBytes {
    fn new(bytes: &[u8]) -> Self {
        let mut out = Self { len: 0, bytes: [0; MAX_REQUEST] };
        for (slot, byte) in out.bytes.iter_mut().zip(bytes) {
            *slot = *byte;
            out.len += 1;
        }
        out
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&self.bytes)
    }
}

/// What a request parser found at the start of the bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Found {
    /// A request of so many bytes.
    Request(Request, usize),
    /// The start of one.
    Incomplete,
    /// Nothing that makes sense: skip a byte.
    Nothing,
}

impl Request {
    /// Its bytes.
    #[must_use]
    pub fn emit(&self) -> RequestBytes {
        match *self {
            Self::StopContinuous => RequestBytes::new(&[0xFA, 0x75, 0xB4]),
            Self::Identity(selector) => RequestBytes::new(&[0xEA, selector]),
            Self::SetContinuous(kind) => RequestBytes::new(&[0xC4, 0xC1, 0x29, kind as u8]),
            Self::Mode(mode) => RequestBytes::new(&[0xD4, 0xA3, 0x47, mode]),
            Self::Poll(kind) => RequestBytes::new(&[kind as u8]),
            Self::SetSampling(sampling) => {
                let mut bytes = [0; MAX_REQUEST];
                let head = [0xDB, 0xA8, 0xB9, 1];
                for (slot, byte) in bytes.iter_mut().zip(head.into_iter().chain(sampling.to_bytes())) {
                    *slot = byte;
                }
                RequestBytes { len: MAX_REQUEST, bytes }
            }
        }
    }

    /// The device's end: the request at the start of `bytes`.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Found {
        match *bytes {
            [] | [0xFA] | [0xFA, 0x75] | [0xEA] => Found::Incomplete,
            [0xFA, 0x75, 0xB4, ..] => Found::Request(Self::StopContinuous, 3),
            [0xEA, selector, ..] => Found::Request(Self::Identity(selector), 2),
            [0xC4, 0xC1, 0x29, kind, ..] => match Kind::from_u8(kind).filter(|k| k.is_measurement()) {
                Some(kind) => Found::Request(Self::SetContinuous(kind), 4),
                None => Found::Nothing,
            },
            [0xD4, 0xA3, 0x47, mode, ..] => Found::Request(Self::Mode(mode), 4),
            [0xDB, 0xA8, 0xB9, 1, ..] => match bytes.get(4..MAX_REQUEST) {
                Some(settings) => Found::Request(Self::SetSampling(Sampling::from_bytes(settings)), MAX_REQUEST),
                None => Found::Incomplete,
            },
            [0xC4 | 0xD4 | 0xDB] | [0xC4, 0xC1] | [0xD4, 0xA3] | [0xDB, 0xA8] => Found::Incomplete,
            [0xC4, 0xC1, 0x29] | [0xD4, 0xA3, 0x47] | [0xDB, 0xA8, 0xB9] => Found::Incomplete,
            [first, ..] => match Kind::from_u8(first).filter(|k| k.is_measurement()) {
                Some(kind) => Found::Request(Self::Poll(kind), 1),
                None => Found::Nothing,
            },
        }
    }
}

impl Sampling {
    /// Decimation, flags, windows, times, power and five zero bytes.
    fn to_bytes(self) -> [u8; 16] {
        let [d0, d1] = self.decimation.to_be_bytes();
        let [f0, f1] = self.flags.to_be_bytes();
        let [u0, u1] = self.up_s.to_be_bytes();
        let [n0, n1] = self.north_s.to_be_bytes();
        [d0, d1, f0, f1, self.window, self.mag_window, u0, u1, n0, n1, self.mag_power, 0, 0, 0, 0, 0]
    }

    fn from_bytes(bytes: &[u8]) -> Self {
        let at = |k: usize| bytes.get(k).copied().unwrap_or(0);
        let pair = |k: usize| u16::from_be_bytes([at(k), at(k + 1)]);
        Self {
            decimation: pair(0),
            flags: pair(2),
            window: at(4),
            mag_window: at(5),
            up_s: pair(6),
            north_s: pair(8),
            mag_power: at(10),
        }
    }
}

/// What the device says.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Reply {
    /// Acceleration in g and rate in rad/s.
    AccelRate {
        /// Specific force, g.
        accel_g: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Acceleration, rate and orientation matrix by rows.
    AccelRateMatrix {
        /// Specific force, g.
        accel_g: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Rows of the orientation matrix.
        matrix: [f32; 9],
        /// Timer.
        ticks: u32,
    },
    /// Euler angles.
    Euler {
        /// Roll, pitch, yaw, rad.
        euler_rad: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Euler angles and rates.
    EulerRate {
        /// Roll, pitch, yaw, rad.
        euler_rad: [f32; 3],
        /// Rate, rad/s.
        rate_rad_s: [f32; 3],
        /// Timer.
        ticks: u32,
    },
    /// Continuous mode was set to this message.
    SetContinuous {
        /// First byte of the streamed message.
        kind: u8,
        /// Timer.
        ticks: u32,
    },
    /// Mode of the device.
    Mode(u8),
    /// Sampling settings in force.
    Sampling(Sampling),
    /// Identity string number so and so.
    Identity {
        /// Which.
        selector: u8,
        /// Its characters.
        text: [u8; 16],
    },
}

/// The bytes of a reply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ReplyBytes {
    len: usize,
    bytes: [u8; MAX_REPLY],
}

impl ReplyBytes {
    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&self.bytes)
    }

    fn start(kind: Kind) -> Self {
        let mut out = Self { len: 0, bytes: [0; MAX_REPLY] };
        out.put(&[kind as u8]);
        out
    }

    fn put(&mut self, bytes: &[u8]) {
        for byte in bytes {
            if let Some(slot) = self.bytes.get_mut(self.len) {
                *slot = *byte;
                self.len += 1;
            }
        }
    }

    fn put_floats(&mut self, values: &[f32]) {
        for value in values {
            self.put(&value.to_be_bytes());
        }
    }

    fn close(mut self) -> Self {
        let sum = checksum(self.as_slice());
        self.put(&sum.to_be_bytes());
        self
    }
}

/// Sum of all bytes modulo 65536.
#[must_use]
pub fn checksum(bytes: &[u8]) -> u16 {
    bytes.iter().fold(0_u16, |sum, byte| sum.wrapping_add(u16::from(*byte)))
}

/// Big-endian numbers one after the other; zero beyond the end, which the caller's length check excludes.
struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let mut out = [0; N];
        for (slot, byte) in out.iter_mut().zip(self.0) {
            *slot = *byte;
        }
        self.0 = self.0.get(N..).unwrap_or(&[]);
        out
    }
    fn u32(&mut self) -> u32 {
        u32::from_be_bytes(self.bytes())
    }
    fn floats<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| f32::from_be_bytes(self.bytes()))
    }
}

impl Reply {
    /// What it is.
    #[must_use]
    pub const fn kind(&self) -> Kind {
        match self {
            Self::AccelRate { .. } => Kind::AccelRate,
            Self::AccelRateMatrix { .. } => Kind::AccelRateMatrix,
            Self::Euler { .. } => Kind::Euler,
            Self::EulerRate { .. } => Kind::EulerRate,
            Self::SetContinuous { .. } => Kind::SetContinuous,
            Self::Mode(_) => Kind::Mode,
            Self::Sampling(_) => Kind::Sampling,
            Self::Identity { .. } => Kind::Identity,
        }
    }

    /// Reads exactly one reply; `None` if length, first byte or checksum is wrong.
    #[must_use]
    pub fn parse(bytes: &[u8]) -> Option<Self> {
        let kind = Kind::from_u8(*bytes.first()?)?;
        let (body, sum) = bytes.split_last_chunk::<2>()?;
        if bytes.len() != kind.reply_bytes() || checksum(body) != u16::from_be_bytes(*sum) {
            return None;
        }
        let mut r = Reader(body.get(1..)?);
        Some(match kind {
            Kind::AccelRate => Self::AccelRate { accel_g: r.floats(), rate_rad_s: r.floats(), ticks: r.u32() },
            Kind::AccelRateMatrix => Self::AccelRateMatrix {
                accel_g: r.floats(),
                rate_rad_s: r.floats(),
                matrix: r.floats(),
                ticks: r.u32(),
            },
            Kind::Euler => Self::Euler { euler_rad: r.floats(), ticks: r.u32() },
            Kind::EulerRate => Self::EulerRate { euler_rad: r.floats(), rate_rad_s: r.floats(), ticks: r.u32() },
            Kind::SetContinuous => {
                let [kind] = r.bytes();
                Self::SetContinuous { kind, ticks: r.u32() }
            }
            Kind::Mode => {
                let [mode] = r.bytes();
                Self::Mode(mode)
            }
            Kind::Sampling => Self::Sampling(Sampling::from_bytes(&r.bytes::<16>())),
            Kind::Identity => {
                let [selector] = r.bytes();
                Self::Identity { selector, text: r.bytes() }
            }
        })
    }

    /// Its bytes.
    #[must_use]
    pub fn emit(&self) -> ReplyBytes {
        let mut out = ReplyBytes::start(self.kind());
        match self {
            Self::AccelRate { accel_g, rate_rad_s, ticks } => {
                out.put_floats(accel_g);
                out.put_floats(rate_rad_s);
                out.put(&ticks.to_be_bytes());
            }
            Self::AccelRateMatrix { accel_g, rate_rad_s, matrix, ticks } => {
                out.put_floats(accel_g);
                out.put_floats(rate_rad_s);
                out.put_floats(matrix);
                out.put(&ticks.to_be_bytes());
            }
            Self::Euler { euler_rad, ticks } => {
                out.put_floats(euler_rad);
                out.put(&ticks.to_be_bytes());
            }
            Self::EulerRate { euler_rad, rate_rad_s, ticks } => {
                out.put_floats(euler_rad);
                out.put_floats(rate_rad_s);
                out.put(&ticks.to_be_bytes());
            }
            Self::SetContinuous { kind, ticks } => {
                out.put(&[*kind]);
                out.put(&ticks.to_be_bytes());
            }
            Self::Mode(mode) => out.put(&[*mode]),
            Self::Sampling(sampling) => out.put(&sampling.to_bytes()),
            Self::Identity { selector, text } => {
                out.put(&[*selector]);
                out.put(text);
            }
        }
        out.close()
    }
}

/// Finds replies in a stream of bytes. A wrong checksum costs one byte, not a message: the search goes on behind it.
#[derive(Clone, Debug)]
pub struct Parser {
    held: [u8; MAX_REPLY],
    count: usize,
    /// Bit k: kind number k of [`Kind::ALL`] is looked for.
    wanted: u8,
    /// Candidates whose checksum was wrong.
    pub failures: u32,
    /// Bytes that belonged to no message.
    pub skipped: u64,
}

impl Parser {
    /// Looks for these kinds only, so that a lost byte in the middle of a stream is not taken for the start of another.
    #[must_use]
    pub fn new(wanted: &[Kind]) -> Self {
        let mut parser = Self { held: [0; MAX_REPLY], count: 0, wanted: 0, failures: 0, skipped: 0 };
        parser.look_for(wanted);
        parser
    }

    /// From now on looks for these kinds; forgets what it holds.
    pub fn look_for(&mut self, wanted: &[Kind]) {
        self.wanted = 0;
        for (bit, kind) in Kind::ALL.iter().enumerate() {
            self.wanted |= u8::from(wanted.contains(kind)) << bit;
        }
        self.count = 0;
    }

    /// Takes one byte; gives the reply that ends with it.
    pub fn push(&mut self, byte: u8) -> Option<Reply> {
        if let Some(slot) = self.held.get_mut(self.count) {
            *slot = byte;
            self.count += 1;
        }
        // Each round either waits for more, delivers, or drops at least one byte: at most MAX_REPLY rounds.
        while self.count > 0 {
            let held = self.held.get(..self.count).unwrap_or(&self.held);
            match self.expected_bytes(held) {
                Some(expected) if held.len() < expected => return None,
                Some(_) => {
                    if let Some(reply) = Reply::parse(held) {
                        self.count = 0;
                        return Some(reply);
                    }
                    self.failures = self.failures.saturating_add(1);
                }
                None => {}
            }
            self.drop_first();
        }
        None
    }

    /// Bytes of the reply that may start here.
    fn expected_bytes(&self, held: &[u8]) -> Option<usize> {
        let first = held.first()?;
        let (bit, kind) = Kind::ALL.iter().enumerate().find(|(_, k)| **k as u8 == *first)?;
        ((self.wanted >> bit) & 1 == 1).then(|| kind.reply_bytes())
    }

    fn drop_first(&mut self) {
        self.held.copy_within(1.., 0);
        self.count -= 1;
        self.skipped = self.skipped.saturating_add(1);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn hex(text: &str) -> Vec<u8> {
        let digits: Vec<u8> = text.bytes().filter(|c| !c.is_ascii_whitespace()).collect();
        digits.chunks(2).map(|pair| u8::from_str_radix(std::str::from_utf8(pair).unwrap(), 16).unwrap()).collect()
    }

    fn standing() -> Reply {
        Reply::AccelRate { accel_g: [0.0, 0.0, -1.0], rate_rad_s: [0.0; 3], ticks: 62_500 }
    }

    fn run(parser: &mut Parser, bytes: &[u8]) -> Vec<Reply> {
        bytes.iter().filter_map(|b| parser.push(*b)).collect()
    }

    #[test]
    fn vectors_of_the_reference_read_and_write() {
        let standing_bytes = hex("C2 00000000 00000000 BF800000 00000000 00000000 00000000 0000F424 0319");
        assert_eq!(Reply::parse(&standing_bytes), Some(standing()));
        assert_eq!(standing().emit().as_slice(), standing_bytes);
        let set = Reply::SetContinuous { kind: 0xC2, ticks: 62_500 };
        assert_eq!(set.emit().as_slice(), hex("C4 C2 00 00 F4 24 02 9E"));
        assert_eq!(Reply::Mode(2).emit().as_slice(), hex("D4 02 00 D6"));
        assert_eq!(Request::StopContinuous.emit().as_slice(), hex("FA 75 B4"));
        assert_eq!(Request::SetContinuous(Kind::AccelRate).emit().as_slice(), hex("C4 C1 29 C2"));
    }

    #[test]
    fn sampling_request_has_twenty_bytes_and_its_reply_nineteen() {
        let sampling = Sampling { decimation: 2, ..Sampling::default() };
        let request = Request::SetSampling(sampling).emit();
        assert_eq!(request.as_slice(), hex("DB A8 B9 01 0002 0003 0F 11 000A 000A 00 0000000000"));
        assert_eq!(Request::parse(request.as_slice()), Found::Request(Request::SetSampling(sampling), 20));
        assert_eq!(Reply::Sampling(sampling).emit().as_slice().len(), 19);
    }

    #[test]
    fn replies_are_refused_at_every_truncation() {
        let bytes = standing().emit();
        for len in 0..bytes.as_slice().len() {
            assert_eq!(Reply::parse(&bytes.as_slice()[..len]), None);
        }
    }

    #[test]
    fn parser_finds_the_next_message_after_a_lost_inserted_or_flipped_byte() {
        let good = standing().emit().as_slice().to_vec();
        for at in 0..good.len() {
            let mut lost = good.clone();
            lost.remove(at);
            let mut inserted = good.clone();
            inserted.insert(at, 0xC2);
            let mut flipped = good.clone();
            flipped[at] ^= 0x10;
            for bad in [lost, inserted, flipped] {
                let mut parser = Parser::new(&[Kind::AccelRate]);
                let stream = [bad, good.clone(), good.clone()].concat();
                let got = run(&mut parser, &stream);
                assert!(got.len() >= 2, "damage at {at}: {} messages", got.len());
                assert!(got.iter().all(|r| *r == standing()));
            }
        }
    }

    #[test]
    fn failures_are_counted() {
        let mut bytes = standing().emit().as_slice().to_vec();
        bytes[5] ^= 1;
        let mut parser = Parser::new(&[Kind::AccelRate]);
        assert!(run(&mut parser, &bytes).is_empty());
        assert_eq!((parser.failures, parser.skipped), (1, 31));
    }

    #[test]
    fn requests_in_pieces_are_waited_for() {
        for request in [
            Request::StopContinuous,
            Request::Identity(1),
            Request::SetSampling(Sampling::default()),
            Request::SetContinuous(Kind::EulerRate),
            Request::Mode(0),
        ] {
            let bytes = request.emit();
            for len in 0..bytes.as_slice().len() {
                assert_eq!(Request::parse(&bytes.as_slice()[..len]), Found::Incomplete, "{request:?} cut at {len}");
            }
            assert_eq!(Request::parse(bytes.as_slice()), Found::Request(request, bytes.as_slice().len()));
        }
    }

    proptest! {
        #[test]
        fn replies_survive_the_round_trip_and_the_parser(a in any::<[f32; 3]>(), b in any::<[f32; 3]>(), ticks: u32, text: [u8; 16], selector: u8) {
            let all = [
                Reply::AccelRate { accel_g: a, rate_rad_s: b, ticks },
                Reply::EulerRate { euler_rad: a, rate_rad_s: b, ticks },
                Reply::Euler { euler_rad: a, ticks },
                Reply::AccelRateMatrix { accel_g: a, rate_rad_s: b, matrix: [a[0]; 9], ticks },
                Reply::Identity { selector, text },
            ];
            for reply in all {
                let bytes = reply.emit();
                // Bytes, not values: a NaN is not equal to itself.
                prop_assert_eq!(Reply::parse(bytes.as_slice()).map(|r| r.emit()), Some(bytes));
                let mut parser = Parser::new(&Kind::ALL);
                prop_assert_eq!(run(&mut parser, bytes.as_slice()).len(), 1);
            }
        }

        #[test]
        fn random_bytes_never_panic_and_are_all_accounted_for(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            let mut parser = Parser::new(&Kind::ALL);
            let found: usize = run(&mut parser, &bytes).iter().map(|r| r.kind().reply_bytes()).sum();
            prop_assert_eq!(found as u64 + parser.skipped + parser.count as u64, bytes.len() as u64);
            if let Found::Request(request, len) = Request::parse(&bytes) {
                prop_assert!(len <= bytes.len());
                prop_assert_eq!(request.emit().as_slice().len(), len);
            }
        }
    }
}
