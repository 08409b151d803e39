//! Our path from a sensor frame to a command frame, fed and timed like the LCM chain.
//!
//! Three ways in, all with the real tick behind them:
//! - [`Input::Thread`]: an I/O thread reads, publishes through the channel, wakes the control thread once.
//! - [`Input::Inline`]: the control thread blocks on the link itself: no hand-over, one wake-up in all.
//! - [`Input::Spin`]: the control thread polls the link: no wake-up at all, one core gone.
//!
//! RT: the measured threads.

use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use super::driver::{self, Driven, SENSOR_BYTES};
use crate::base::time::{Span, Stamp};
use crate::channel::port::{ChannelError, Endpoint, Publisher, Subscriber};
use crate::channel::topic::Topic;
use crate::config::checked::Thread;
use crate::msg::{BUSES, ImuSample, TickInput, TickOutput};
use crate::rt::clock;
use crate::rt::thread as scheduling;
use crate::rt::wake::Bell;

/// How a frame reaches the control thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// Through an I/O thread.
    Thread,
    /// The control thread blocks on the link.
    Inline,
    /// The control thread polls the link without pause.
    Spin,
}

/// Our chain could not start.
#[derive(Debug, thiserror::Error)]
pub enum OurChainError {
    /// A socket or thread failed.
    #[error("our chain: {0}")]
    Io(#[from] io::Error),
    /// A channel did not open.
    #[error(transparent)]
    Channel(#[from] ChannelError),
}

/// The step of the control thread: what went in → what goes out.
pub type Step = Box<dyn FnMut(&TickInput) -> TickOutput + Send>;

/// The running threads; they end when this is dropped.
#[derive(Debug)]
pub struct OurChain {
    into: PathBuf,
    out: UnixDatagram,
    stop: Arc<AtomicBool>,
    threads: Vec<JoinHandle<()>>,
}

impl OurChain {
    /// Starts the threads in a folder of their own.
    ///
    /// # Errors
    /// If a socket, channel or thread cannot be made.
    pub fn start(folder: &Path, input: Input, priority: u8, core: usize, step: Step) -> Result<Self, OurChainError> {
        let name = format!("{input:?}");
        let (into, back) = (folder.join(format!("{name}.in")), folder.join(format!("{name}.out")));
        let (link, out) = (UnixDatagram::bind(&into)?, UnixDatagram::bind(&back)?);
        let bus = UnixDatagram::unbound()?;
        bus.connect(&back)?;
        // A reader that never hears of the end would never end.
        link.set_read_timeout(Some(Duration::from_millis(100)))?;
        let stop = Arc::new(AtomicBool::new(false));
        let control = Thread { priority, core: Some(core), stack_bytes: 256 * 1024 };
        let walk = Walk { step, bus, index: 0 };
        let threads = match input {
            Input::Thread => with_io_thread(link, walk, control, &stop)?,
            Input::Inline | Input::Spin => {
                link.set_nonblocking(input == Input::Spin)?;
                vec![alone(link, walk, control, &stop)?]
            }
        };
        thread::sleep(Duration::from_millis(100));
        Ok(Self { into, out, stop, threads })
    }

    /// One window of frames through the chain.
    ///
    /// # Errors
    /// If a socket fails.
    pub fn window(&self, count: usize, period: Duration) -> io::Result<Driven> {
        driver::run(&self.into, &self.out, count, period)
    }
}

impl Drop for OurChain {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        for thread in self.threads.drain(..) {
            // A panic in there has been told by the hook.
            drop(thread.join());
        }
    }
}

/// What the control thread does with a frame: a tick, and its first command frame on the wire.
struct Walk {
    step: Step,
    bus: UnixDatagram,
    index: u64,
}

impl Walk {
    fn frame(&mut self, sample: ImuSample, sent_ns: i64, number: u64) {
        let now = clock::now();
        let (heard_until, imu_heard_until) = ([now; BUSES], now);
        let mut input = TickInput { index: self.index, now, heard_until, imu_heard_until, ..TickInput::default() };
        self.index += 1;
        input.imu.push(sample);
        let output = (self.step)(&input);
        let mut wire = [0; 16];
        if let Some(first) = output.send.first().and_then(|batch| batch.iter().next()) {
            wire[..4].copy_from_slice(&first.frame.id.to_ne_bytes());
            wire[8..].copy_from_slice(&first.frame.first_eight());
        }
        // A full socket is a lost frame, as on a bus; the driver sees it missing.
        drop(self.bus.send(&driver::reply(sent_ns, number, clock::now().0, wire)));
    }
}

fn sample(bytes: &[u8; SENSOR_BYTES]) -> (ImuSample, i64, u64) {
    let (sent_ns, number, state) = driver::parse_sensor(bytes);
    let imu = ImuSample {
        stamp: Stamp(sent_ns),
        has_attitude: true,
        euler_rad: [0.0, state[0], 0.0],
        rate_rad_s: [0.0, state[2], 0.0],
        ..ImuSample::default()
    };
    (imu, sent_ns, number)
}

fn alone(link: UnixDatagram, mut walk: Walk, config: Thread, stop: &Arc<AtomicBool>) -> io::Result<JoinHandle<()>> {
    let stop = stop.clone();
    thread::Builder::new().name("control".into()).spawn(move || {
        scheduling::enter(&config);
        let mut bytes = [0; SENSOR_BYTES];
        while !stop.load(Ordering::Relaxed) {
            if matches!(link.recv(&mut bytes), Ok(SENSOR_BYTES)) {
                let (imu, sent_ns, number) = sample(&bytes);
                walk.frame(imu, sent_ns, number);
            } else {
                std::hint::spin_loop();
            }
        }
    })
}

fn with_io_thread(
    link: UnixDatagram,
    mut walk: Walk,
    config: Thread,
    stop: &Arc<AtomicBool>,
) -> Result<Vec<JoinHandle<()>>, OurChainError> {
    let topic = Topic::<ImuSample>::new("bench-imu", 32, 1);
    let robot = format!("bench-chain-{}", std::process::id());
    let bell = Arc::new(Bell::default());
    let (control_bell, control_stop, io_stop) = (bell.clone(), stop.clone(), stop.clone());
    let inlet_robot = robot.clone();
    let control = thread::Builder::new().name("control".into()).spawn(move || {
        let Ok(mut inlet) = subscriber(&inlet_robot, &topic) else { return };
        scheduling::enter(&config);
        while !control_stop.load(Ordering::Relaxed) {
            let seen = control_bell.count();
            while let Some(imu) = inlet.receive() {
                walk.frame(imu, imu.stamp.0, u64::from(imu.device_ticks));
            }
            control_bell.wait(seen, clock::now() + Span::from_ms(100));
        }
    })?;
    let reader = thread::Builder::new().name("imu".into()).spawn(move || {
        let Ok(mut outlet) = publisher(&robot, &topic) else { return };
        scheduling::enter(&config);
        let mut bytes = [0; SENSOR_BYTES];
        while !io_stop.load(Ordering::Relaxed) {
            if matches!(link.recv(&mut bytes), Ok(SENSOR_BYTES)) {
                outlet.publish(&sample(&bytes).0);
                bell.ring();
            }
        }
    })?;
    Ok(vec![control, reader])
}

fn subscriber(robot: &str, topic: &Topic<ImuSample>) -> Result<Subscriber<ImuSample>, ChannelError> {
    Endpoint::join(robot)?.subscriber(topic)
}

fn publisher(robot: &str, topic: &Topic<ImuSample>) -> Result<Publisher<ImuSample>, ChannelError> {
    Endpoint::join(robot)?.publisher(topic)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_way_in_answers_each_frame() {
        for input in [Input::Thread, Input::Inline, Input::Spin] {
            let dir = tempfile::tempdir().unwrap();
            let step: Step = Box::new(|_| TickOutput::default());
            let chain = OurChain::start(dir.path(), input, 0, 0, step).unwrap();
            // Fewer than a socket holds: on a busy machine they come late, but they come.
            let driven = chain.window(8, Duration::from_millis(10)).unwrap();
            assert_eq!(driven.window.len(), 8, "{input:?}");
        }
    }
}
