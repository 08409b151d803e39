//! Names and types of the services.
//!
//! A service's name holds the robot, the topic and a hash over the message's shape. Two builds that disagree about a
//! message therefore meet on different services and see nothing of each other, instead of reading each other's bytes
//! wrongly. RT: before arming only.

use crate::msg::{Element, Kind, MocapSample, OperatorSample, RecorderStatus, Shape, TickRecord};
use std::marker::PhantomData;

/// A channel: what it is called, what it carries, how much waits for a slow reader.
#[derive(Clone, Copy, Debug)]
pub struct Topic<T> {
    name: &'static str,
    /// Messages that wait for one subscriber; when full, the oldest is lost and counted.
    pub buffer: usize,
    /// Most subscribers at a time.
    pub subscribers: usize,
    payload: PhantomData<T>,
}

impl<T> Topic<T> {
    /// A topic for `subscribers` readers with room for `buffer` messages each.
    #[must_use]
    pub const fn new(name: &'static str, buffer: usize, subscribers: usize) -> Self {
        Self { name, buffer, subscribers, payload: PhantomData }
    }

    /// Its name, the same for every robot.
    #[must_use]
    pub const fn name(&self) -> &'static str {
        self.name
    }
}

/// The operator's hand: from whoever serves the device.
pub const OPERATOR: Topic<OperatorSample> = Topic::new("operator", 8, 4);
/// Ticks for everybody: recorder, terminal, other processes.
pub const TICK: Topic<TickRecord> = Topic::new("tick", 512, 8);
/// How the recording is, for other processes.
pub const RECORDER: Topic<RecorderStatus> = Topic::new("recorder", 8, 8);
/// Poses of motion capture, for other processes.
pub const MOCAP: Topic<MocapSample> = Topic::new("mocap", 256, 8);

impl<T: Element> Topic<T> {
    /// Name of the service for one robot.
    #[must_use]
    pub fn service_name(&self, robot: &str) -> String {
        format!("compass/{robot}/{}/{:016x}", self.name, schema_hash(&T::KIND))
    }
}

/// FNV-1a over names and types of all fields, depth first: differs when a field is added, renamed, moved
/// or retyped, and when an enumeration gets another variant: its bytes would be no valid value to the other build.
#[must_use]
pub fn schema_hash(kind: &Kind) -> u64 {
    let mut hash = 0xCBF2_9CE4_8422_2325;
    mix_kind(&mut hash, kind);
    hash
}

fn mix(hash: &mut u64, bytes: &[u8]) {
    for byte in bytes {
        *hash = (*hash ^ u64::from(*byte)).wrapping_mul(0x0100_0000_01B3);
    }
}

fn mix_kind(hash: &mut u64, kind: &Kind) {
    match kind {
        Kind::Array(inner, count) => {
            mix(hash, b"[");
            mix(hash, &count.to_le_bytes());
            mix_kind(hash, inner);
        }
        Kind::Bytes(most) => {
            mix(hash, b"y");
            mix(hash, &most.to_le_bytes());
        }
        Kind::Struct(shape) => mix_shape(hash, shape),
        Kind::Bool => mix(hash, b"b"),
        Kind::U8 => mix(hash, b"u1"),
        Kind::Enum(variants) => {
            mix(hash, b"e");
            for (name, number) in variants.iter() {
                mix(hash, name.as_bytes());
                mix(hash, &[b'=', *number]);
            }
        }
        Kind::U16 => mix(hash, b"u2"),
        Kind::U32 => mix(hash, b"u4"),
        Kind::U64 => mix(hash, b"u8"),
        Kind::I16 => mix(hash, b"i2"),
        Kind::I32 => mix(hash, b"i4"),
        Kind::I64 => mix(hash, b"i8"),
        Kind::F64 => mix(hash, b"f8"),
    }
}

fn mix_shape(hash: &mut u64, shape: &Shape) {
    mix(hash, shape.name.as_bytes());
    mix(hash, b"{");
    for field in shape.fields {
        mix(hash, field.name.as_bytes());
        mix(hash, b":");
        mix_kind(hash, &field.kind);
    }
    mix(hash, b"}");
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::msg::FieldShape;

    const A: Shape = Shape { name: "A", fields: &[field("x_m", Kind::F64), field("n", Kind::U8)] };
    const RETYPED: Shape = Shape { name: "A", fields: &[field("x_m", Kind::F64), field("n", Kind::U16)] };
    const RENAMED: Shape = Shape { name: "A", fields: &[field("x_mm", Kind::F64), field("n", Kind::U8)] };
    const SWAPPED: Shape = Shape { name: "A", fields: &[field("n", Kind::U8), field("x_m", Kind::F64)] };

    const fn field(name: &'static str, kind: Kind) -> FieldShape {
        FieldShape { name, doc: "", kind }
    }

    #[test]
    fn any_change_of_a_type_changes_the_hash() {
        let original = schema_hash(&Kind::Struct(&A));
        for changed in [&RETYPED, &RENAMED, &SWAPPED] {
            assert_ne!(original, schema_hash(&Kind::Struct(changed)));
        }
    }

    #[test]
    fn any_change_of_an_enumeration_changes_the_hash() {
        const OLD: Kind = Kind::Enum(&[("Off", 0), ("On", 1)]);
        for changed in [&[("Off", 0), ("On", 1), ("Half", 2)][..], &[("Off", 0), ("On", 2)], &[("Off", 0), ("Up", 1)]] {
            let changed = Kind::Enum(Box::leak(changed.to_vec().into_boxed_slice()));
            assert_ne!(schema_hash(&OLD), schema_hash(&changed));
        }
        assert!(matches!(<crate::msg::Mode as Element>::KIND, Kind::Enum(v) if v.len() == crate::msg::Mode::ALL.len()));
    }

    #[test]
    fn names_tell_robots_and_topics_apart() {
        let names = [TICK.service_name("a"), TICK.service_name("b"), OPERATOR.service_name("a")];
        assert!(names.iter().enumerate().all(|(i, n)| !names[..i].contains(n)));
    }
}
