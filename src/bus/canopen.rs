//! CiA 301: identifiers and the messages that are not SDO, as pure parse and emit. Little endian throughout.
//!
//! RT: yes, no allocation.

use super::sdo::{SdoReply, SdoRequest};
use crate::msg::CanFrame;

/// A CANopen node, 1 to 127.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Node(u8);

impl Node {
    /// The node that we are: drives watch its heartbeat.
    pub const MASTER: Self = Self(127);

    /// A node number, if it is one.
    #[must_use]
    pub const fn new(number: u8) -> Option<Self> {
        if number >= 1 && number <= 127 { Some(Self(number)) } else { None }
    }

    /// Its number.
    #[must_use]
    pub const fn number(self) -> u8 {
        self.0
    }
}

/// What an 11-bit identifier stands for (CiA 301, predefined connection set).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Object {
    /// Network management command.
    Nmt,
    /// The clock of the bus.
    Sync,
    /// Emergency of a node.
    Emergency(Node),
    /// Process data from the drive, number 1 to 4.
    Tpdo(u8, Node),
    /// Process data to the drive, number 1 to 4.
    Rpdo(u8, Node),
    /// Answer of a node's object server.
    SdoReply(Node),
    /// Question to a node's object server.
    SdoRequest(Node),
    /// Heartbeat or boot-up of a node.
    Heartbeat(Node),
}

impl Object {
    /// Identifier on the wire.
    #[must_use]
    pub const fn id(self) -> u16 {
        match self {
            Self::Nmt => 0x000,
            Self::Sync => 0x080,
            Self::Emergency(n) => 0x080 + n.0 as u16,
            Self::Tpdo(k, n) => 0x080 + 0x100 * k as u16 + n.0 as u16,
            Self::Rpdo(k, n) => 0x100 + 0x100 * k as u16 + n.0 as u16,
            Self::SdoReply(n) => 0x580 + n.0 as u16,
            Self::SdoRequest(n) => 0x600 + n.0 as u16,
            Self::Heartbeat(n) => 0x700 + n.0 as u16,
        }
    }

    /// What an identifier stands for; `None` outside of the predefined set.
    #[must_use]
    pub const fn from_id(id: u16) -> Option<Self> {
        if id > 0x7FF {
            return None;
        }
        let function = id & 0x780;
        let Some(node) = Node::new((id & 0x7F) as u8) else {
            return match id {
                0x000 => Some(Self::Nmt),
                0x080 => Some(Self::Sync),
                _ => None,
            };
        };
        match function {
            0x080 => Some(Self::Emergency(node)),
            0x180 | 0x280 | 0x380 | 0x480 => Some(Self::Tpdo((function >> 8) as u8, node)),
            0x200 | 0x300 | 0x400 | 0x500 => Some(Self::Rpdo((function >> 8) as u8 - 1, node)),
            0x580 => Some(Self::SdoReply(node)),
            0x600 => Some(Self::SdoRequest(node)),
            0x700 => Some(Self::Heartbeat(node)),
            _ => None,
        }
    }
}

/// What a node shall do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum NmtCommand {
    /// Go operational: process data flow.
    Start = 0x01,
    /// Stop everything but network management.
    Stop = 0x02,
    /// Go pre-operational: object access, no process data.
    PreOperational = 0x80,
    /// Restart the device.
    ResetNode = 0x81,
    /// Restart its communication.
    ResetCommunication = 0x82,
}

impl NmtCommand {
    const ALL: [Self; 5] = [Self::Start, Self::Stop, Self::PreOperational, Self::ResetNode, Self::ResetCommunication];

    fn from_u8(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|c| *c as u8 == byte)
    }
}

/// Network state that a node tells in its heartbeat.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum NmtState {
    /// Sent once after a restart.
    BootUp = 0x00,
    /// Only network management.
    Stopped = 0x04,
    /// Process data flow.
    Operational = 0x05,
    /// Object access only.
    PreOperational = 0x7F,
}

impl NmtState {
    const ALL: [Self; 4] = [Self::BootUp, Self::Stopped, Self::Operational, Self::PreOperational];

    /// Bit 7 is the toggle of old node guarding and is not looked at.
    fn from_u8(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|s| *s as u8 == byte & 0x7F)
    }
}

/// Emergency: what a node shouts when something breaks, or with code 0 when it is well again.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Emergency {
    /// Error code of CiA 301 and CiA 402; 0x0000 = no error.
    pub code: u16,
    /// Copy of object 0x1001.
    pub register: u8,
    /// Maker's bytes.
    pub maker: [u8; 5],
}

/// Emergency code: the drive no longer hears a heartbeat that it watches.
pub const EMCY_HEARTBEAT_LOST: u16 = 0x8130;
/// Emergency code: process data did not come in time.
pub const EMCY_RPDO_TIMEOUT: u16 = 0x8250;
/// Emergency code: process data too short.
pub const EMCY_PDO_TOO_SHORT: u16 = 0x8210;

/// Bytes of a process data frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PdoData {
    /// Number of bytes, 0 to 8.
    pub len: u8,
    /// The bytes; zero from `len` on.
    pub data: [u8; 8],
}

impl PdoData {
    /// The bytes that are there.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        self.data.get(..usize::from(self.len)).unwrap_or(&self.data)
    }
}

/// A CANopen message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Message {
    /// Network management: command, and the node or all.
    Nmt(NmtCommand, Option<Node>),
    /// The clock of the bus, with its counter if one is configured.
    Sync(Option<u8>),
    /// Emergency.
    Emergency(Node, Emergency),
    /// Process data from a drive.
    Tpdo(u8, Node, PdoData),
    /// Process data to a drive.
    Rpdo(u8, Node, PdoData),
    /// Answer of an object server.
    SdoReply(Node, SdoReply),
    /// Question to an object server.
    SdoRequest(Node, SdoRequest),
    /// Heartbeat or boot-up.
    Heartbeat(Node, NmtState),
}

/// Why a frame is no CANopen message.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ParseError {
    /// 29-bit, remote, error or CAN-FD frame, or an identifier outside of the predefined set.
    #[error("identifier {0:#x} is not of CANopen's predefined set")]
    Foreign(u32),
    /// Wrong number of bytes for this kind of message.
    #[error("message {id:#05x} has {len} bytes")]
    Length {
        /// Identifier.
        id: u16,
        /// Number of bytes that came.
        len: u8,
    },
    /// A byte with no meaning where it stands.
    #[error("message {id:#05x} has the unknown code {code:#04x}")]
    Code {
        /// Identifier.
        id: u16,
        /// The byte.
        code: u8,
    },
}

/// False if this frame is for or from another node than `node` (the lowest seven bits of an identifier; zero there is
/// for all). Quicker than [`Message::parse`].
#[must_use]
pub const fn may_name(frame: &CanFrame, node: u8) -> bool {
    let named = frame.id & 0x7F;
    named == 0 || named == node as u32
}

impl Message {
    /// Reads a frame.
    ///
    /// # Errors
    /// [`ParseError`] says what is wrong with it.
    pub fn parse(frame: &CanFrame) -> Result<Self, ParseError> {
        let foreign = ParseError::Foreign(frame.id);
        let id = u16::try_from(frame.id).ok().filter(|_| !frame.is_fd()).ok_or(foreign)?;
        let object = Object::from_id(id).ok_or(foreign)?;
        let len = frame.len;
        let wrong_length = ParseError::Length { id, len };
        let wrong_code = |code: u8| ParseError::Code { id, code };
        let data = frame.first_eight();
        match (object, len) {
            (Object::Nmt, 2) => {
                let command = NmtCommand::from_u8(data[0]).ok_or_else(|| wrong_code(data[0]))?;
                match (data[1], Node::new(data[1])) {
                    (0, _) => Ok(Self::Nmt(command, None)),
                    (_, Some(node)) => Ok(Self::Nmt(command, Some(node))),
                    (other, None) => Err(wrong_code(other)),
                }
            }
            (Object::Sync, 0) => Ok(Self::Sync(None)),
            (Object::Sync, 1) => Ok(Self::Sync(Some(data[0]))),
            (Object::Emergency(node), 8) => Ok(Self::Emergency(node, Emergency::from_bytes(data))),
            (Object::Tpdo(k, node), 0..=8) => Ok(Self::Tpdo(k, node, PdoData::from_frame(frame))),
            (Object::Rpdo(k, node), 0..=8) => Ok(Self::Rpdo(k, node, PdoData::from_frame(frame))),
            (Object::SdoReply(node), 8) => {
                Ok(Self::SdoReply(node, SdoReply::parse(data).ok_or_else(|| wrong_code(data[0]))?))
            }
            (Object::SdoRequest(node), 8) => {
                Ok(Self::SdoRequest(node, SdoRequest::parse(data).ok_or_else(|| wrong_code(data[0]))?))
            }
            (Object::Heartbeat(node), 1) => {
                Ok(Self::Heartbeat(node, NmtState::from_u8(data[0]).ok_or_else(|| wrong_code(data[0]))?))
            }
            _ => Err(wrong_length),
        }
    }

    /// The frame of this message.
    #[must_use]
    pub fn emit(&self) -> CanFrame {
        match *self {
            Self::Nmt(command, node) => CanFrame::new(Object::Nmt.id(), &[command as u8, node.map_or(0, Node::number)]),
            Self::Sync(None) => CanFrame::new(Object::Sync.id(), &[]),
            Self::Sync(Some(counter)) => CanFrame::new(Object::Sync.id(), &[counter]),
            Self::Emergency(node, emergency) => CanFrame::new(Object::Emergency(node).id(), &emergency.to_bytes()),
            Self::Tpdo(k, node, pdo) => CanFrame::new(Object::Tpdo(k, node).id(), pdo.bytes()),
            Self::Rpdo(k, node, pdo) => CanFrame::new(Object::Rpdo(k, node).id(), pdo.bytes()),
            Self::SdoReply(node, reply) => CanFrame::new(Object::SdoReply(node).id(), &reply.emit()),
            Self::SdoRequest(node, request) => CanFrame::new(Object::SdoRequest(node).id(), &request.emit()),
            Self::Heartbeat(node, state) => CanFrame::new(Object::Heartbeat(node).id(), &[state as u8]),
        }
    }
}

impl PdoData {
    fn from_frame(frame: &CanFrame) -> Self {
        let mut pdo = Self::default();
        for (slot, byte) in pdo.data.iter_mut().zip(frame.payload()) {
            *slot = *byte;
            pdo.len += 1;
        }
        pdo
    }
}

impl Emergency {
    fn from_bytes(b: [u8; 8]) -> Self {
        Self { code: u16::from_le_bytes([b[0], b[1]]), register: b[2], maker: [b[3], b[4], b[5], b[6], b[7]] }
    }

    fn to_bytes(self) -> [u8; 8] {
        let [low, high] = self.code.to_le_bytes();
        let [a, b, c, d, e] = self.maker;
        [low, high, self.register, a, b, c, d, e]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bus::sdo::{AbortCode, Address, SdoValue};
    use proptest::prelude::*;

    fn node(n: u8) -> Node {
        Node::new(n).unwrap()
    }

    #[test]
    fn identifiers_are_those_of_the_predefined_set() {
        let n = node(3);
        let table = [
            (Object::Nmt, 0x000),
            (Object::Sync, 0x080),
            (Object::Emergency(n), 0x083),
            (Object::Tpdo(1, n), 0x183),
            (Object::Rpdo(1, n), 0x203),
            (Object::Tpdo(2, n), 0x283),
            (Object::Rpdo(2, n), 0x303),
            (Object::Tpdo(4, n), 0x483),
            (Object::Rpdo(4, n), 0x503),
            (Object::SdoReply(n), 0x583),
            (Object::SdoRequest(n), 0x603),
            (Object::Heartbeat(n), 0x703),
        ];
        for (object, id) in table {
            assert_eq!(object.id(), id);
            assert_eq!(Object::from_id(id), Some(object));
        }
    }

    #[test]
    fn each_identifier_stands_for_at_most_one_object() {
        for id in 0..=0xFFFF {
            if let Some(object) = Object::from_id(id) {
                assert_eq!(object.id(), id);
            }
        }
    }

    #[test]
    fn captured_frames_read_as_the_reference_says() {
        let write = Message::SdoRequest(node(3), SdoRequest::Write(Address::new(0x1017, 0), SdoValue::u16(20)));
        assert_eq!(write.emit(), CanFrame::new(0x603, &[0x2B, 0x17, 0x10, 0, 0x14, 0, 0, 0]));
        let accepted = Message::SdoReply(node(3), SdoReply::Written(Address::new(0x1017, 0)));
        assert_eq!(accepted.emit(), CanFrame::new(0x583, &[0x60, 0x17, 0x10, 0, 0, 0, 0, 0]));
        let abort = CanFrame::new(0x583, &[0x80, 0x34, 0x12, 0, 0, 0, 2, 6]);
        let reply = SdoReply::Abort(Address::new(0x1234, 0), AbortCode::NO_SUCH_OBJECT);
        assert_eq!(Message::parse(&abort), Ok(Message::SdoReply(node(3), reply)));
    }

    #[test]
    fn guarding_toggle_bit_is_ignored() {
        let frame = CanFrame::new(0x703, &[0x85]);
        assert_eq!(Message::parse(&frame), Ok(Message::Heartbeat(node(3), NmtState::Operational)));
    }

    #[test]
    fn messages_are_refused_at_every_wrong_length() {
        for (id, right) in [(0x000, 2), (0x083, 8), (0x583, 8), (0x603, 8), (0x703, 1)] {
            for len in (0..=8usize).filter(|len| *len != right) {
                let frame = CanFrame::new(id, &[0x40; 8][..len]);
                assert!(Message::parse(&frame).is_err(), "{id:#x} with {len} bytes");
            }
        }
    }

    proptest! {
        #[test]
        fn what_parses_emits_and_parses_to_the_same(id in 0u32..0x7FF, payload in prop::collection::vec(any::<u8>(), 0..=8)) {
            let frame = CanFrame::classic(id, &payload);
            if let Ok(message) = Message::parse(&frame) {
                prop_assert_eq!(Message::parse(&message.emit()), Ok(message));
            }
        }

        #[test]
        fn random_frames_never_panic(id: u32, flags: u8, len: u8, data: [u8; 8]) {
            if let Ok(message) = Message::parse(&CanFrame { flags, len, ..CanFrame::classic(id, &data) }) {
                prop_assert_eq!(message.emit().id, id);
            }
        }
    }
}
