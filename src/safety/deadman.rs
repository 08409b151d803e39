//! The dead-man switch: held, released, or in doubt. RT: yes.

/// The operator's hand in this tick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Hand {
    /// Held, by a source that lives.
    pub(super) held: bool,
    /// Released, by a source that lives. Neither `held` nor `open`: in doubt.
    pub(super) open: bool,
    /// Pressed just now, after a release was seen.
    pub(super) edge: bool,
}

/// Remembers whether a release was seen since the last doubt or press.
///
/// A key that is held at start, or held while its source was silent, gives no edge: the source could be a radio
/// receiver that repeats the last state for ever.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DeadMan {
    release_seen: bool,
}

impl DeadMan {
    /// Takes the newest sample.
    pub(super) fn update(&mut self, held: bool, fresh: bool) -> Hand {
        let edge = fresh && held && self.release_seen;
        self.release_seen = fresh && !held;
        Hand { held: fresh && held, open: fresh && !held, edge }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_press_after_a_fresh_release_is_an_edge() {
        let edges = |samples: &[(bool, bool)]| {
            let mut dead_man = DeadMan::default();
            samples.iter().map(|(held, fresh)| dead_man.update(*held, *fresh).edge).collect::<Vec<_>>()
        };
        assert_eq!(edges(&[(true, true), (true, true)]), [false, false], "held at start");
        assert_eq!(edges(&[(false, true), (true, true), (true, true)]), [false, true, false], "release, press");
        assert_eq!(edges(&[(false, false), (true, true)]), [false, false], "stale release");
        assert_eq!(edges(&[(false, true), (true, false), (true, true)]), [false; 3], "silence between");
    }
}
