//! Makes a thread real-time as configured, and says what was not granted. RT: before arming only.
#![expect(unsafe_code, reason = "prctl")]

use super::memory;
use crate::config::checked::Thread;
use core_affinity::CoreId;
use std::fs::File;
use std::io::Write;
use std::ops::BitOr;
use thread_priority::{
    RealtimeThreadSchedulePolicy, ThreadPriority, ThreadPriorityValue, ThreadSchedulePolicy,
    set_thread_priority_and_policy, thread_native_id,
};

/// What real time needs and was not granted, as the bits of [`crate::msg::TickInput::real_time_missing`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Missing(pub u32);

impl Missing {
    /// SCHED_FIFO for a thread that asks for it.
    pub const FIFO: Self = Self(1);
    /// The core that a thread is pinned to.
    pub const CORE: Self = Self(2);
    /// Locked memory.
    pub const MEMORY: Self = Self(4);
    /// /dev/cpu_dma_latency. Told, but no reason not to arm: it costs microseconds, not deadlines.
    pub const AWAKE: Self = Self(8);
    /// A bus that can be restarted and emptied after a stall (CAP_NET_ADMIN).
    pub const BUS_RESTART: Self = Self(16);

    /// Only what stands in the way of arming.
    #[must_use]
    pub const fn needed(self) -> Self {
        Self(self.0 & !Self::AWAKE.0)
    }

    /// Each missing thing in words, with the remedy.
    pub fn in_words(self) -> impl Iterator<Item = &'static str> {
        let words = [
            (Self::FIFO, "SCHED_FIFO: needs LimitRTPRIO=95 or CAP_SYS_NICE"),
            (Self::CORE, "a core to pin to: does not exist, or is outside the allowed CPU set"),
            (Self::MEMORY, "locked memory: needs LimitMEMLOCK=infinity or CAP_IPC_LOCK"),
            (Self::AWAKE, "/dev/cpu_dma_latency: needs write permission; wake-ups will be later"),
            (Self::BUS_RESTART, "restart of a CAN link: needs CAP_NET_ADMIN and restart-ms > 0"),
        ];
        words.into_iter().filter(move |(bit, _)| self.0 & bit.0 != 0).map(|(_, text)| text)
    }
}

impl BitOr for Missing {
    type Output = Self;
    fn bitor(self, rhs: Self) -> Self {
        Self(self.0 | rhs.0)
    }
}

/// Gives the calling thread its priority, core and touched stack.
pub fn enter(config: &Thread) -> Missing {
    memory::touch_stack(config.stack_bytes);
    // SAFETY: sets the timer slack of the calling thread to 1 ns; no pointers.
    unsafe { libc::prctl(libc::PR_SET_TIMERSLACK, 1_usize) };
    let pinned = config.core.is_none_or(pin);
    let scheduled = config.priority == 0 || fifo(config.priority);
    missing_unless(scheduled, Missing::FIFO) | missing_unless(pinned, Missing::CORE)
}

const fn missing_unless(granted: bool, bit: Missing) -> Missing {
    if granted { Missing(0) } else { bit }
}

fn pin(id: usize) -> bool {
    // Asking for a core beyond the kernel's set would panic, hence the look first.
    let exists = core_affinity::get_core_ids().is_some_and(|cores| cores.contains(&CoreId { id }));
    exists && core_affinity::set_for_current(CoreId { id })
}

fn fifo(priority: u8) -> bool {
    let policy = ThreadSchedulePolicy::Realtime(RealtimeThreadSchedulePolicy::Fifo);
    let Ok(value) = ThreadPriorityValue::try_from(priority) else { return false };
    set_thread_priority_and_policy(thread_native_id(), ThreadPriority::Crossplatform(value), policy).is_ok()
}

/// Keeps the CPU out of deep sleep while it lives.
#[derive(Debug)]
pub struct Awake {
    _held_open: File,
}

impl Awake {
    /// Asks for 0 us of wake-up latency from the idle states. `None`: not granted.
    #[must_use]
    pub fn hold() -> Option<Self> {
        let mut file = File::options().write(true).open("/dev/cpu_dma_latency").ok()?;
        file.write_all(&0_i32.to_ne_bytes()).ok()?;
        Some(Self { _held_open: file })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_core_that_does_not_exist_is_reported() {
        let config = Thread { priority: 0, core: Some(100_000), stack_bytes: 128 * 1024 };
        let missing = std::thread::spawn(move || enter(&config)).join().unwrap();
        assert_eq!(missing, Missing::CORE);
        assert_eq!(missing.in_words().count(), 1);
    }

    #[test]
    fn sleepy_idle_states_are_no_reason_not_to_arm() {
        assert_eq!((Missing::AWAKE | Missing::FIFO).needed(), Missing::FIFO);
    }
}
