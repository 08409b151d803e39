//! Bytes of bounded length, and readers of numbers in them. RT: yes, no allocation.

/// At most `N` bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Short<const N: usize> {
    len: usize,
    bytes: [u8; N],
}

impl<const N: usize> Short<N> {
    /// These bytes; what does not fit is cut off.
    #[must_use]
    pub fn new(bytes: &[u8]) -> Self {
        let mut out = Self { len: 0, bytes: [0; N] };
        out.put(bytes);
        out
    }

    /// Appends; what does not fit is cut off.
    pub fn put(&mut self, more: &[u8]) {
        for byte in more {
            if let Some(slot) = self.bytes.get_mut(self.len) {
                *slot = *byte;
                self.len += 1;
            }
        }
    }

    /// The bytes.
    #[must_use]
    pub fn as_slice(&self) -> &[u8] {
        self.bytes.get(..self.len).unwrap_or(&self.bytes)
    }
}

/// The first `N` bytes; zero beyond the end.
#[must_use]
pub fn padded<const N: usize>(bytes: &[u8]) -> [u8; N] {
    let mut out = [0; N];
    for (slot, byte) in out.iter_mut().zip(bytes) {
        *slot = *byte;
    }
    out
}

/// Big-endian numbers one after the other; zero beyond the end, which the caller's length check excludes.
#[derive(Clone, Copy, Debug)]
pub struct BigEndian<'a>(pub &'a [u8]);

impl BigEndian<'_> {
    /// The next bytes as they are.
    pub fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let out = padded(self.0);
        self.0 = self.0.get(N..).unwrap_or(&[]);
        out
    }

    /// The next two bytes.
    pub fn u16(&mut self) -> u16 {
        u16::from_be_bytes(self.bytes())
    }

    /// The next four bytes.
    pub fn u32(&mut self) -> u32 {
        u32::from_be_bytes(self.bytes())
    }

    /// The next `N` floats.
    pub fn floats<const N: usize>(&mut self) -> [f32; N] {
        std::array::from_fn(|_| f32::from_be_bytes(self.bytes()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_cut_off() {
        let mut short = Short::<3>::new(&[1, 2]);
        short.put(&[3, 4]);
        assert_eq!(short.as_slice(), [1, 2, 3]);
        assert_eq!(padded::<3>(&[1]), [1, 0, 0]);
    }

    #[test]
    fn numbers_are_read_in_turn_and_are_zero_beyond_the_end() {
        let mut r = BigEndian(&[0x12, 0x34, 0, 0, 1, 0, 0x3F]);
        assert_eq!((r.u16(), r.u32(), r.bytes::<2>(), r.u16()), (0x1234, 0x0000_0100, [0x3F, 0], 0));
    }
}
