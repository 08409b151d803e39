//! The object dictionary of a simulated drive: what its server lets be read and written, and how. RT: no.

use crate::bus::canopen::{Node, Object};
use crate::bus::pdo::{Entry, mapped_bytes};
use crate::bus::sdo::{AbortCode, Address, SdoReply, SdoRequest, SdoValue};

/// What may be done with an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    Read,
    /// Read and write at any time.
    Write,
    /// Written only while process data do not flow.
    Configure,
}

/// Slots of the table that finds an object: four times the objects.
const SLOTS: usize = 512;

/// Objects by address: looked up some hundred times per millisecond, so by a hash and not by search.
#[derive(Clone, Debug)]
pub(super) struct Objects {
    entries: Vec<(Address, SdoValue, Access)>,
    /// Place in `entries` + 1, at the address' hash or the next free slot; 0 = free.
    slots: Box<[u8; SLOTS]>,
    supported_modes: u32,
}

/// One process data object as configured.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct PdoSetup {
    /// Identifier, if it is on.
    pub(super) id: Option<u16>,
    /// Transmission type.
    pub(super) kind: u8,
    /// Event timer, ms.
    pub(super) timer_ms: u16,
    /// What is mapped.
    pub(super) entries: Vec<Entry>,
}

/// Numbers of the type plate.
#[derive(Clone, Copy, Debug)]
pub(super) struct Plate {
    pub(super) node: Node,
    pub(super) rated_torque_mnm: u32,
    pub(super) supported_modes: u32,
}

/// Where to look first. Shift and factor were searched for: no two objects of ours begin at one slot.
const fn hash(index: u16, sub: u8) -> usize {
    (index as usize ^ (index as usize >> 4) ^ (sub as usize * 79)) % SLOTS
}

impl Objects {
    /// As the drive leaves the factory: PDO 1 to 4 on, some default mapping, no heartbeat, no limits.
    pub(super) fn new(plate: Plate) -> Self {
        let mut objects =
            Self { entries: Vec::new(), slots: Box::new([0; SLOTS]), supported_modes: plate.supported_modes };
        objects.put_communication();
        objects.put_pdos(plate.node);
        objects.put_drive(plate);
        objects
    }

    fn put(&mut self, index: u16, sub: u8, value: SdoValue, access: Access) {
        self.entries.push((Address::new(index, sub), value, access));
        let mut slot = hash(index, sub);
        while self.slots[slot] != 0 {
            slot = (slot + 1) % SLOTS;
        }
        self.slots[slot] = u8::try_from(self.entries.len()).unwrap_or(u8::MAX);
    }

    /// Place of an object.
    #[inline]
    fn find(&self, at: Address) -> Option<usize> {
        let mut slot = hash(at.index, at.sub);
        loop {
            let place = usize::from(self.slots[slot].checked_sub(1)?);
            if self.entries[place].0 == at {
                return Some(place);
            }
            slot = (slot + 1) % SLOTS;
        }
    }

    fn put_communication(&mut self) {
        self.put(0x1000, 0, SdoValue::u32(0x0002_0192), Access::Read);
        self.put(0x1001, 0, SdoValue::u8(0), Access::Read);
        self.put(0x1016, 1, SdoValue::u32(0), Access::Write);
        self.put(0x1017, 0, SdoValue::u16(0), Access::Write);
        // Maker, product, revision, serial number: ours are not those of any real maker.
        for (sub, value) in [(1, 0x0000_C0DE), (2, 0x0000_0402), (3, 1), (4, 1)] {
            self.put(0x1018, sub, SdoValue::u32(value), Access::Read);
        }
    }

    fn put_pdos(&mut self, node: Node) {
        for k in 1..=4_u8 {
            let (rpdo, tpdo) = (u32::from(Object::Rpdo(k, node).id()), u32::from(Object::Tpdo(k, node).id()));
            let n = u16::from(k - 1);
            for (comm, map, id) in [(0x1400 + n, 0x1600 + n, rpdo), (0x1800 + n, 0x1A00 + n, tpdo)] {
                self.put(comm, 1, SdoValue::u32(id), Access::Configure);
                self.put(comm, 2, SdoValue::u8(255), Access::Configure);
                self.put(comm, 5, SdoValue::u16(0), Access::Configure);
                self.put(map, 0, SdoValue::u8(0), Access::Configure);
                for sub in 1..=8 {
                    self.put(map, sub, SdoValue::u32(0), Access::Configure);
                }
            }
        }
    }

    fn put_drive(&mut self, plate: Plate) {
        self.put(0x6007, 0, SdoValue::i16(1), Access::Write);
        self.put(0x603F, 0, SdoValue::u16(0), Access::Read);
        self.put(0x6040, 0, SdoValue::u16(0), Access::Write);
        self.put(0x6041, 0, SdoValue::u16(0), Access::Read);
        self.put(0x6060, 0, SdoValue::i8(0), Access::Write);
        self.put(0x6061, 0, SdoValue::i8(0), Access::Read);
        self.put(0x6064, 0, SdoValue::i32(0), Access::Read);
        self.put(0x6071, 0, SdoValue::i16(0), Access::Write);
        self.put(0x6072, 0, SdoValue::u16(1000), Access::Write);
        self.put(0x6076, 0, SdoValue::u32(plate.rated_torque_mnm), Access::Read);
        self.put(0x6077, 0, SdoValue::i16(0), Access::Read);
        self.put(0x607A, 0, SdoValue::i32(0), Access::Write);
        // Slow, as from the factory: profile torque that nobody set up ramps.
        self.put(0x6087, 0, SdoValue::u32(1000), Access::Write);
        self.put(0x60C2, 1, SdoValue::u8(1), Access::Write);
        self.put(0x60C2, 2, SdoValue::i8(-3), Access::Write);
        self.put(0x6401, 1, SdoValue::i16(0), Access::Read);
        self.put(0x6502, 0, SdoValue::u32(plate.supported_modes), Access::Read);
    }

    /// Raw value; 0 for an object that is not there.
    #[inline]
    pub(super) fn raw(&self, index: u16, sub: u8) -> u32 {
        self.find(Address::new(index, sub)).map_or(0, |place| self.entries[place].1.raw())
    }

    /// The drive's own hand: writes whatever the access.
    pub(super) fn set(&mut self, index: u16, sub: u8, value: SdoValue) {
        if let Some(place) = self.find(Address::new(index, sub)) {
            self.entries[place].1 = value;
        }
    }

    /// The server's answer to a request. `flowing`: process data flow, so that they cannot be configured.
    pub(super) fn serve(&mut self, request: &SdoRequest, flowing: bool) -> Option<SdoReply> {
        match *request {
            SdoRequest::Read(at) => Some(match self.find(at) {
                Some(place) => SdoReply::Value(at, self.entries[place].1),
                None => SdoReply::Abort(at, self.missing(at)),
            }),
            SdoRequest::Write(at, value) => Some(match self.write(at, value, flowing) {
                Ok(()) => SdoReply::Written(at),
                Err(code) => SdoReply::Abort(at, code),
            }),
            SdoRequest::Abort(..) => None,
        }
    }

    fn missing(&self, at: Address) -> AbortCode {
        let known = self.entries.iter().any(|(k, ..)| k.index == at.index);
        if known { AbortCode::NO_SUCH_SUB } else { AbortCode::NO_SUCH_OBJECT }
    }

    fn write(&mut self, at: Address, value: SdoValue, flowing: bool) -> Result<(), AbortCode> {
        let place = self.find(at).ok_or_else(|| self.missing(at))?;
        let (_, old, access) = self.entries[place];
        match access {
            Access::Read => return Err(AbortCode::READ_ONLY),
            Access::Configure if flowing => return Err(AbortCode::WRONG_STATE),
            Access::Configure | Access::Write => {}
        }
        if old.len() != value.len() {
            return Err(AbortCode::WRONG_LENGTH);
        }
        self.check(at, value)?;
        self.entries[place].1 = value;
        if at == Address::new(0x6060, 0) {
            self.set(0x6061, 0, value);
        }
        Ok(())
    }

    /// Modes that are not there, and mappings that cannot be.
    fn check(&self, at: Address, value: SdoValue) -> Result<(), AbortCode> {
        let mapping = matches!(at.index, 0x1600..=0x1603 | 0x1A00..=0x1A03);
        match (at.index, at.sub) {
            (0x6060, 0) => {
                let mode = value.raw();
                let supported = mode == 0 || (mode <= 32 && (self.supported_modes >> (mode - 1)) & 1 == 1);
                if supported { Ok(()) } else { Err(AbortCode::VALUE_RANGE) }
            }
            (map, 0) if mapping => {
                let bytes = mapped_bytes(&self.mapping(map, value.raw()));
                if bytes <= 8 { Ok(()) } else { Err(AbortCode::MAPPING_TOO_LONG) }
            }
            _ if mapping => {
                let entry = Entry::from_raw(value.raw());
                let target = self.find(Address::new(entry.index, entry.sub));
                let fits = target.is_some_and(|place| self.entries[place].1.len() * 8 == entry.bits);
                if fits { Ok(()) } else { Err(AbortCode::NOT_MAPPABLE) }
            }
            _ => Ok(()),
        }
    }

    fn mapping(&self, map: u16, count: u32) -> Vec<Entry> {
        let count = u8::try_from(count.min(8)).unwrap_or(8);
        (1..=count).map(|sub| Entry::from_raw(self.raw(map, sub))).collect()
    }

    /// Process data object at this communication and mapping index.
    pub(super) fn pdo(&self, comm: u16, map: u16) -> PdoSetup {
        let id = self.raw(comm, 1);
        PdoSetup {
            id: if id & 0x8000_0000 == 0 { u16::try_from(id & 0x7FF).ok() } else { None },
            kind: self.raw(comm, 2).to_le_bytes()[0],
            timer_ms: u16::try_from(self.raw(comm, 5)).unwrap_or(u16::MAX),
            entries: self.mapping(map, self.raw(map, 0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_object_is_found_where_it_is_looked_for_first() {
        let plate = Plate { node: Node::new(1).unwrap(), rated_torque_mnm: 1, supported_modes: 0 };
        let objects = Objects::new(plate);
        for (place, (at, ..)) in objects.entries.iter().enumerate() {
            assert_eq!(usize::from(objects.slots[hash(at.index, at.sub)]), place + 1, "{at:?}");
        }
    }
}
