//! OptiTrack NatNet 3 and 4 over UDP, little endian: rigid bodies in frames, and what a client has to say. Other
//! sections of a frame are walked over, or skipped by their length where the version tells it (4.1 and later).
//! RT: no, in an ordinary thread.

use crate::base::bytes::padded;

/// Port of the server for commands.
pub const COMMAND_PORT: u16 = 1510;
/// Port for data, and the group they are sent to by default.
pub const DATA_PORT: u16 = 1511;
/// The group that a server sends to by default.
pub const DATA_GROUP: [u8; 4] = [239, 255, 42, 99];

/// Messages by their number.
mod id {
    pub(super) const CONNECT: u16 = 0;
    pub(super) const SERVER_INFO: u16 = 1;
    pub(super) const FRAME: u16 = 7;
    pub(super) const KEEP_ALIVE: u16 = 10;
}

/// Bytes after the last section.
const SUFFIX: usize = 4 + 4 + 8 + 8 + 16 + 2 + 4;

/// More bodies, markers or channels than any room has: such a count is a damaged one.
const MOST: u32 = 4096;

/// Asks the server who it is and, of a server that sends to single clients, to send to us.
pub const CONNECT: [u8; 9] = [0, 0, 5, 0, b'P', b'i', b'n', b'g', 0];
const _: () = assert!(id::CONNECT == 0);
/// A client of a server that sends to single clients says this about once a second.
pub const KEEP_ALIVE: [u8; 4] = [id::KEEP_ALIVE.to_le_bytes()[0], 0, 0, 0];

/// Version of the stream's layout.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version {
    /// Before the point.
    pub major: u8,
    /// After it.
    pub minor: u8,
}

impl Version {
    const fn at_least(self, major: u8, minor: u8) -> bool {
        self.major > major || (self.major == major && self.minor >= minor)
    }
}

/// What the server says of itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ServerInfo {
    /// Layout of its frames.
    pub version: Version,
    /// Ticks of its clock per second; 0 if it does not tell.
    pub clock_hz: u64,
}

/// A rigid body in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Body {
    /// Its number at the server.
    pub id: u32,
    /// Position, m.
    pub position_m: [f32; 3],
    /// Attitude x, y, z, w.
    pub quaternion: [f32; 4],
    /// The cameras see it in this frame; otherwise the pose is an old one.
    pub tracked: bool,
}

/// What stands around the bodies.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameHead {
    /// Counts frames at the server.
    pub number: u32,
    /// The server's time of the exposure, ticks; 0 if it does not tell.
    pub exposed_ticks: u64,
    /// The server says that its bodies have changed.
    pub models_changed: bool,
}

/// These bytes are no whole message of this protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum Damage {
    /// It ends in the middle.
    #[error("ends in the middle")]
    Short,
    /// A count that cannot be.
    #[error("a count of {0}")]
    Count(u32),
    /// More bytes than it should have.
    #[error("{0} bytes too many")]
    Long(usize),
}

/// A message from the server.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Message {
    /// Who it is.
    Server(ServerInfo),
    /// A frame; its bodies were handed over.
    Frame(FrameHead),
    /// Something else, by its number.
    Other(u16),
}

/// Reads a datagram; `each` gets the bodies of a frame before anybody knows whether the rest is whole.
///
/// # Errors
/// [`Damage`]; then forget the bodies.
pub fn read(datagram: &[u8], version: Version, mut each: impl FnMut(Body)) -> Result<Message, Damage> {
    let mut bytes = Bytes(datagram);
    let (id, length) = (bytes.u16()?, bytes.u16()?);
    let mut payload = Bytes(bytes.take(usize::from(length))?);
    match id {
        id::SERVER_INFO => server_info(&mut payload).map(Message::Server),
        id::FRAME => frame(&mut payload, version, &mut each).map(Message::Frame),
        other => Ok(Message::Other(other)),
    }
}

fn server_info(bytes: &mut Bytes<'_>) -> Result<ServerInfo, Damage> {
    bytes.take(256 + 4)?;
    let &[major, minor, ..] = bytes.take(4)? else { return Err(Damage::Short) };
    let version = Version { major, minor };
    let clock_hz = if version.at_least(3, 0) { bytes.u64()? } else { 0 };
    Ok(ServerInfo { version, clock_hz })
}

/// The sections of a frame in their order (docs/protocols.md, section 10).
fn frame(bytes: &mut Bytes<'_>, version: Version, each: &mut dyn FnMut(Body)) -> Result<FrameHead, Damage> {
    let number = bytes.u32()?;
    bytes.section(version, |bytes| {
        bytes.text()?;
        bytes.items(12)
    })?;
    // Unlabelled markers: one length for all, no heads.
    bytes.section(version, |bytes| bytes.take(12).map(drop))?;
    bytes.section(version, |bytes| bytes.body(version).map(&mut *each))?;
    bytes.section(version, |bytes| bytes.skeleton(version))?;
    if version.at_least(4, 1) {
        bytes.section(version, |bytes| bytes.asset(version))?;
    }
    let labelled = 4 + 12 + 4 + 2 + if version.at_least(3, 0) { 4 } else { 0 };
    bytes.section(version, |bytes| bytes.take(labelled).map(drop))?;
    // Force plates and devices.
    for _ in 0..2 {
        bytes.section(version, Bytes::channels)?;
    }
    if version.at_least(4, 1) {
        bytes.skip_unknown_sections();
    }
    suffix(bytes, number)
}

fn suffix(bytes: &mut Bytes<'_>, number: u32) -> Result<FrameHead, Damage> {
    // Time code, its sub-frame, time since the software's start.
    bytes.take(4 + 4 + 8)?;
    let exposed_ticks = bytes.u64()?;
    bytes.take(16)?;
    let flags = bytes.u16()?;
    bytes.take(4)?;
    // Newer servers may say more behind the mark.
    Ok(FrameHead { number, exposed_ticks, models_changed: flags & 2 != 0 })
}

/// Bytes that are not read yet.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], Damage> {
        let (part, rest) = self.0.split_at_checked(count).ok_or(Damage::Short)?;
        self.0 = rest;
        Ok(part)
    }

    fn u16(&mut self) -> Result<u16, Damage> {
        self.take(2).map(|b| u16::from_le_bytes(padded(b)))
    }

    fn u32(&mut self) -> Result<u32, Damage> {
        self.take(4).map(|b| u32::from_le_bytes(padded(b)))
    }

    fn u64(&mut self) -> Result<u64, Damage> {
        self.take(8).map(|b| u64::from_le_bytes(padded(b)))
    }

    fn f32(&mut self) -> Result<f32, Damage> {
        self.take(4).map(|b| f32::from_le_bytes(padded(b)))
    }

    fn floats<const N: usize>(&mut self) -> Result<[f32; N], Damage> {
        let mut out = [0.0; N];
        for slot in &mut out {
            *slot = self.f32()?;
        }
        Ok(out)
    }

    fn count(&mut self) -> Result<u32, Damage> {
        let count = self.u32()?;
        if count > MOST { Err(Damage::Count(count)) } else { Ok(count) }
    }

    /// A text that ends with a zero.
    fn text(&mut self) -> Result<(), Damage> {
        let end = self.0.iter().position(|byte| *byte == 0).ok_or(Damage::Short)?;
        self.take(end + 1).map(drop)
    }

    /// A count and so many items of this size.
    fn items(&mut self, size: usize) -> Result<(), Damage> {
        let count = self.count()?;
        self.take(usize::try_from(count).unwrap_or(usize::MAX).saturating_mul(size)).map(drop)
    }

    /// A count, from 4.1 on the section's length, and the items. The length is what counts where it is there.
    fn section(
        &mut self,
        version: Version,
        mut item: impl FnMut(&mut Self) -> Result<(), Damage>,
    ) -> Result<(), Damage> {
        let count = self.count()?;
        if !version.at_least(4, 1) {
            return (0..count).try_for_each(|_| item(self));
        }
        let length = usize::try_from(self.u32()?).unwrap_or(usize::MAX);
        let mut inner = Self(self.take(length)?);
        (0..count).try_for_each(|_| item(&mut inner))
    }

    /// Sections of a newer server before the suffix: skipped if with them everything adds up, and only then.
    fn skip_unknown_sections(&mut self) {
        let mut rest = Bytes(self.0);
        let mut skip = || {
            while rest.0.len() > SUFFIX {
                rest.u32()?;
                let length = usize::try_from(rest.u32()?).unwrap_or(usize::MAX);
                rest.take(length)?;
            }
            Ok::<_, Damage>(rest.0)
        };
        if let Ok(suffix) = skip()
            && suffix.len() == SUFFIX
        {
            self.0 = suffix;
        }
    }

    fn body(&mut self, version: Version) -> Result<Body, Damage> {
        let (id, position_m, quaternion) = (self.u32()?, self.floats()?, self.floats()?);
        if !version.at_least(3, 0) {
            let markers = usize::try_from(self.count()?).unwrap_or(usize::MAX);
            self.take(markers.saturating_mul(12 + 4 + 4))?;
        }
        self.f32()?;
        let tracked = self.u16()? & 1 != 0;
        Ok(Body { id, position_m, quaternion, tracked })
    }

    fn skeleton(&mut self, version: Version) -> Result<(), Damage> {
        self.u32()?;
        let bodies = self.count()?;
        (0..bodies).try_for_each(|_| self.body(version).map(drop))
    }

    /// Bodies and markers of an asset, both as elsewhere.
    fn asset(&mut self, version: Version) -> Result<(), Damage> {
        self.skeleton(version)?;
        self.items(4 + 12 + 4 + 2 + 4)
    }

    /// A force plate or a device: number, channels, samples.
    fn channels(&mut self) -> Result<(), Damage> {
        self.u32()?;
        let channels = self.count()?;
        (0..channels).try_for_each(|_| self.items(4))
    }
}

#[cfg(test)]
mod tests;
