//! Vicon's UDP object stream, little endian, packed: objects with their poses in blocks of fixed size.
//! RT: no, in an ordinary thread.

use crate::base::bytes::padded;

/// Port that the tracker sends to by default.
pub const PORT: u16 = 51001;
/// An item: id, size, name, six doubles.
const ITEM: usize = 3 + 72;
/// Its size as it says of itself.
const CONTENT: u16 = 72;
/// Characters of a name.
const NAME: usize = 24;

/// An object in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Object {
    /// Its name; zeros behind it.
    pub name: [u8; NAME],
    /// Position, m.
    pub position_m: [f64; 3],
    /// Euler angles about x, y, z, in this order, rad.
    pub euler_rad: [f64; 3],
}

impl Object {
    /// An object that no camera sees is told as all zeros.
    #[must_use]
    pub fn is_seen(&self) -> bool {
        self.position_m.iter().chain(&self.euler_rad).any(|x| *x != 0.0)
    }

    /// True if it is called so.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        let end = self.name.iter().position(|byte| *byte == 0).unwrap_or(NAME);
        self.name.get(..end) == Some(name.as_bytes())
    }

    /// The attitude x, y, z, w of the rotation about x, then about the new y, then about the new z.
    #[must_use]
    pub fn quaternion(&self) -> [f64; 4] {
        let [(sx, cx), (sy, cy), (sz, cz)] = self.euler_rad.map(|angle| libm::sincos(0.5 * angle));
        [
            sx * cy * cz + cx * sy * sz,
            cx * sy * cz - sx * cy * sz,
            cx * cy * sz + sx * sy * cz,
            cx * cy * cz - sx * sy * sz,
        ]
    }
}

/// Reads a datagram; hands over its objects. Gives the frame's number; `None` if it is none, and then forget the objects.
pub fn read(datagram: &[u8], mut each: impl FnMut(Object)) -> Option<u32> {
    let (head, mut rest) = datagram.split_first_chunk::<5>()?;
    let (number, items) = (u32::from_le_bytes(padded(head)), head[4]);
    for _ in 0..items {
        let (item, after) = rest.split_first_chunk::<ITEM>()?;
        rest = after;
        // Other kinds of items are not known.
        if item[0] != 0 || u16::from_le_bytes([item[1], item[2]]) != CONTENT {
            return None;
        }
        each(object(item)?);
    }
    // A block has a fixed size, and zeros behind its items.
    rest.iter().all(|byte| *byte == 0).then_some(number)
}

/// `None` if a number is not finite.
fn object(item: &[u8; ITEM]) -> Option<Object> {
    let mut numbers = [0.0; 6];
    let places = item.get(3 + NAME..)?.chunks_exact(8);
    numbers.iter_mut().zip(places).for_each(|(x, bytes)| *x = f64::from_le_bytes(padded(bytes)));
    let [x, y, z, rx, ry, rz] = numbers;
    // Millimetres on the wire.
    let position_m = [x, y, z].map(|mm| mm * 1e-3);
    let all_finite = numbers.iter().all(|x| x.is_finite());
    all_finite.then_some(Object { name: padded(item.get(3..3 + NAME)?), position_m, euler_rad: [rx, ry, rz] })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn item(name: &str, numbers: [f64; 6]) -> Vec<u8> {
        let mut out = vec![0, 72, 0];
        out.extend(padded::<NAME>(name.as_bytes()));
        numbers.iter().for_each(|x| out.extend(x.to_le_bytes()));
        out
    }

    fn block(number: u32, items: &[Vec<u8>]) -> Vec<u8> {
        let mut out = [&number.to_le_bytes()[..], &[u8::try_from(items.len()).unwrap()], &items.concat()].concat();
        out.resize(out.len().next_multiple_of(256), 0);
        out
    }

    fn objects(datagram: &[u8]) -> (Option<u32>, Vec<Object>) {
        let mut out = Vec::new();
        (read(datagram, |object| out.push(object)), out)
    }

    #[test]
    fn objects_of_a_block_are_read_in_metres() {
        let seen = item("robot", [1000.0, -250.0, 1500.0, 0.1, 0.0, 0.0]);
        let (number, found) = objects(&block(9, &[seen, item("box", [0.0; 6])]));
        assert_eq!((number, found.len()), (Some(9), 2));
        assert!(found[0].is_called("robot") && !found[0].is_called("rob") && found[0].is_seen());
        assert_eq!(found[0].position_m.map(f64::to_bits), [1.0, -0.25, 1.5_f64].map(f64::to_bits));
        assert!(!found[1].is_seen(), "occluded");
    }

    #[test]
    fn quaternions_turn_as_the_three_rotations_do() {
        use nalgebra::{UnitQuaternion, Vector3};
        let object = Object { name: [0; NAME], position_m: [0.0; 3], euler_rad: [0.3, -0.5, 1.1] };
        let about = |axis: Vector3<f64>, angle| UnitQuaternion::from_scaled_axis(axis * angle);
        let expected = about(Vector3::x(), 0.3) * about(Vector3::y(), -0.5) * about(Vector3::z(), 1.1);
        let [x, y, z, w] = object.quaternion();
        let error = (expected.i - x).abs() + (expected.j - y).abs() + (expected.k - z).abs() + (expected.w - w).abs();
        assert!(error < 1e-12, "{expected}");
    }

    #[test]
    fn truncations_foreign_items_and_numbers_that_are_none_are_refused() {
        let whole = [&5_u32.to_le_bytes()[..], &[1], &item("robot", [1.0; 6])].concat();
        assert_eq!(objects(&whole).0, Some(5));
        assert!((0..whole.len()).all(|end| objects(&whole[..end]).0.is_none()));
        for (at, byte) in [(5, 1), (6, 71)] {
            let mut foreign = whole.clone();
            foreign[at] = byte;
            assert_eq!(objects(&foreign).0, None);
        }
        assert_eq!(objects(&block(1, &[item("robot", [f64::NAN; 6])])).0, None);
        let mut dirty = block(1, &[item("robot", [1.0; 6])]);
        *dirty.last_mut().unwrap() = 1;
        assert_eq!(objects(&dirty).0, None);
    }

    proptest! {
        #[test]
        fn foreign_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
            objects(&bytes);
        }
    }
}
