//! L6: the harness of `compass bench` and `bench/`: our figures beside those of what a user would use instead, in
//! interleaved windows of one run, as ratios. It never judges: a goal that is not reached stands in the table.
//!
//! - [`our_chain`]: our path from sensor frame to command frame.
//! - [`wakeup`]: our control thread against cyclictest.
//! - [`logging`]: the recorder against the bare `mcap` crate.
//! - [`step_cost`]: what a tick costs.
//! - [`page`]: the HTML page.
//! - [`window`]: percentiles of a window, medians of per-window ratios, the machine's stolen time.
//! - [`cyclictest`]: wake-up latency of Debian's rt-tests.
//! - [`driver`]: one sensor datagram in per period, one reply out.
//! - [`hop`]: our channel against raw iceoryx2.
//! - [`lcm_chain`]: the thesis' architecture, three processes joined by LCM.
//!
//! Times on a virtual machine are gated on medians of per-window ratios; maxima are told beside the stolen time.
//! RT: no (the measured parts are).

pub mod cyclictest;
pub mod driver;
pub mod hop;
pub mod lcm_chain;
pub mod logging;
pub mod our_chain;
pub mod page;
pub mod step_cost;
pub mod wakeup;
pub mod window;
