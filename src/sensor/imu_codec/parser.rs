//! Finds replies in a stream of bytes. RT: yes.

use super::{Kind, MAX_REPLY, Reply};

/// Finds replies in a stream of bytes. A wrong checksum costs one byte, not a message: the search goes on behind it.
#[derive(Clone, Debug)]
pub struct Parser {
    held: [u8; MAX_REPLY],
    pub(super) count: usize,
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
