//! Publish and subscribe without waiting.
//!
//! RT: no. Nothing waits, but each message costs some small allocations inside iceoryx2; see [`super::ring`].
#![expect(unsafe_code, reason = "statvfs")]

use super::topic::Topic;
use crate::msg::Element;
use iceoryx2::node::NodeBuilder;
use iceoryx2::port::publisher::Publisher as Port;
use iceoryx2::port::subscriber::Subscriber as Inlet;
use iceoryx2::prelude::{
    BackpressureStrategy, CallbackProgression, Config, PortFactory as _, Service as _, SignalHandlingMode,
    ZeroCopySend, ipc,
};
use iceoryx2::service::ServiceDetails;
use std::ffi::CString;
use std::fmt::{Debug, Display};
use std::mem::MaybeUninit;
use std::os::unix::ffi::OsStrExt;
use std::path::Path;

/// A channel could not be opened.
#[derive(Debug, thiserror::Error)]
#[error("channel {what}: {why}")]
pub struct ChannelError {
    what: String,
    why: String,
}

impl ChannelError {
    fn new(what: &str, why: impl Display) -> Self {
        Self { what: what.to_owned(), why: why.to_string() }
    }
}

/// What can travel: a message of plain bytes with a known shape.
pub trait Payload: Element + ZeroCopySend + Debug + Default + 'static {}
impl<T: Element + ZeroCopySend + Debug + Default + 'static> Payload for T {}

/// Counts what a publisher sent, so that a reader can count what it missed.
#[derive(Clone, Copy, Debug, Default, ZeroCopySend)]
#[repr(C)]
pub struct Sequence(u64);

/// One thread's access to the channels of one robot.
pub struct Endpoint {
    node: iceoryx2::node::Node<ipc::Service>,
    robot: String,
}

impl Endpoint {
    /// Joins the channels of `robot`. What processes left behind that died without saying goodbye (kill -9) is removed.
    ///
    /// # Errors
    /// When shared memory cannot be used.
    pub fn join(robot: &str) -> Result<Self, ChannelError> {
        let node = NodeBuilder::new()
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| ChannelError::new(robot, e))?;
        let _cleaned = node.try_cleanup_dead_nodes();
        Ok(Self { node, robot: robot.to_owned() })
    }

    fn service<T: Payload>(&self, topic: &Topic<T>) -> Result<Service<T>, ChannelError> {
        let name = topic.service_name(&self.robot);
        let fail = |e: &dyn Display| ChannelError::new(&name, e);
        self.node
            .service_builder(&name.as_str().try_into().map_err(|e| fail(&e))?)
            .publish_subscribe::<T>()
            .user_header::<Sequence>()
            .enable_safe_overflow(true)
            .history_size(0)
            .subscriber_max_buffer_size(topic.buffer)
            .subscriber_max_borrowed_samples(2)
            .max_subscribers(topic.subscribers)
            .max_publishers(2)
            .open_or_create()
            .map_err(|e| fail(&e))
    }

    /// Opens the sending end.
    ///
    /// # Errors
    /// When the service is incompatible or full.
    pub fn publisher<T: Payload>(&self, topic: &Topic<T>) -> Result<Publisher<T>, ChannelError> {
        let free = free_bytes(Path::new(SHARED_MEMORY)).unwrap_or(u64::MAX);
        check_room(topic.name(), free, needed_bytes(topic))?;
        let port = self
            .service(topic)?
            .publisher_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .max_loaned_samples(1)
            .create()
            .map_err(|e| ChannelError::new(topic.name(), e))?;
        Ok(Publisher { port, sent: 0, refused: 0 })
    }

    /// Opens a receiving end. It sees what is published from now on.
    ///
    /// # Errors
    /// When the service is incompatible or full.
    pub fn subscriber<T: Payload>(&self, topic: &Topic<T>) -> Result<Subscriber<T>, ChannelError> {
        let inlet =
            self.service(topic)?.subscriber_builder().create().map_err(|e| ChannelError::new(topic.name(), e))?;
        Ok(Subscriber { inlet, expected: None, missed: 0 })
    }

    /// Opens a receiving end of what somebody else offers, and makes nothing if nobody does.
    ///
    /// # Errors
    /// When nobody offers it, or there is no room for another reader.
    pub fn listener<T: Payload>(&self, topic: &Topic<T>) -> Result<Listener<T>, ChannelError> {
        let name = topic.service_name(&self.robot);
        let fail = |e: &dyn Display| ChannelError::new(&name, e);
        let service = self
            .node
            .service_builder(&name.as_str().try_into().map_err(|e| fail(&e))?)
            .publish_subscribe::<T>()
            .user_header::<Sequence>()
            .open()
            .map_err(|e| fail(&e))?;
        let inlet = service.subscriber_builder().create().map_err(|e| fail(&e))?;
        Ok(Listener { service, subscriber: Subscriber { inlet, expected: None, missed: 0 } })
    }

    /// Removes what processes left behind that died without saying goodbye.
    pub fn forget_the_dead(&self) {
        let _cleaned = self.node.try_cleanup_dead_nodes();
    }
}

/// A receiving end that knows whether anybody speaks.
#[derive(Debug)]
pub struct Listener<T: Payload> {
    service: Service<T>,
    subscriber: Subscriber<T>,
}

impl<T: Payload> Listener<T> {
    /// The oldest message that waits, if any. Never waits.
    pub fn receive(&mut self) -> Option<T> {
        self.subscriber.receive()
    }

    /// False when the last publisher has gone.
    #[must_use]
    pub fn has_publisher(&self) -> bool {
        self.service.dynamic_config().number_of_publishers() > 0
    }
}

/// Where iceoryx2 puts what it shares.
const SHARED_MEMORY: &str = "/dev/shm";

/// Bytes of shared memory that a publisher takes: what may wait for all subscribers and what they may hold, and some for
/// the queues beside it.
fn needed_bytes<T>(topic: &Topic<T>) -> u64 {
    const BESIDE: usize = 1 << 20;
    ((topic.buffer + 3) * topic.subscribers * (size_of::<T>() + size_of::<Sequence>()) + BESIDE) as u64
}

/// A file system without room gives the memory and kills whoever touches it (SIGBUS), so this is looked at before.
fn check_room(what: &str, free: u64, needed: u64) -> Result<(), ChannelError> {
    if free >= needed {
        return Ok(());
    }
    let mib = |bytes: u64| bytes.div_ceil(1 << 20);
    let why = format!(
        "{SHARED_MEMORY} has {} MiB of room and {} are needed: remove what fills it, or mount it larger",
        free >> 20,
        mib(needed)
    );
    Err(ChannelError::new(what, why))
}

/// Bytes that may still be written to the file system of this folder.
fn free_bytes(folder: &Path) -> Option<u64> {
    let path = CString::new(folder.as_os_str().as_bytes()).ok()?;
    let mut stat = MaybeUninit::<libc::statvfs>::zeroed();
    // SAFETY: `path` ends with a NUL, `stat` has room for the one structure that is written.
    if unsafe { libc::statvfs(path.as_ptr(), stat.as_mut_ptr()) } != 0 {
        return None;
    }
    // SAFETY: all-zero bytes are a valid statvfs, and the call has filled it in.
    let stat = unsafe { stat.assume_init() };
    Some(stat.f_bavail.saturating_mul(stat.f_frsize))
}

/// What a process finds that wants to read a topic of somebody else.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Found {
    /// Robots that offer it.
    pub robots: Vec<String>,
    /// Robots that offer it with other fields: another build.
    pub other_builds: Vec<String>,
}

/// Which robots of this user offer the topic.
///
/// # Errors
/// When shared memory cannot be looked at.
pub fn robots_with<T: Payload>(topic: &Topic<T>) -> Result<Found, ChannelError> {
    let mut found = Found::default();
    let middle = format!("/{}/", topic.name());
    let each = |service: ServiceDetails<ipc::Service>| {
        let name = service.static_details.name().as_str();
        if let Some((robot, _)) = name.strip_prefix("compass/").and_then(|rest| rest.rsplit_once(&middle)) {
            let same = topic.service_name(robot) == name;
            let list = if same { &mut found.robots } else { &mut found.other_builds };
            list.push(robot.to_owned());
        }
        CallbackProgression::Continue
    };
    ipc::Service::list(Config::global_config(), each).map_err(|e| ChannelError::new(topic.name(), e))?;
    found.robots.sort();
    found.other_builds.sort();
    Ok(found)
}

type Service<T> = iceoryx2::service::port_factory::publish_subscribe::PortFactory<ipc::Service, T, Sequence>;

/// The sending end.
#[derive(Debug)]
pub struct Publisher<T: Payload> {
    port: Port<ipc::Service, T, Sequence>,
    sent: u64,
    refused: u64,
}

impl<T: Payload> Publisher<T> {
    /// Copies the message into shared memory and hands it over. Never waits; what cannot be sent is counted.
    pub fn publish(&mut self, message: &T) {
        let Ok(mut sample) = self.port.loan_uninit() else {
            self.refused += 1;
            return;
        };
        *sample.user_header_mut() = Sequence(self.sent);
        self.sent += 1;
        if sample.write_payload(*message).send().is_err() {
            self.refused += 1;
        }
    }

    /// Messages that could not be handed over.
    #[must_use]
    pub const fn refused(&self) -> u64 {
        self.refused
    }
}

/// The receiving end.
#[derive(Debug)]
pub struct Subscriber<T: Payload> {
    inlet: Inlet<ipc::Service, T, Sequence>,
    expected: Option<u64>,
    missed: u64,
}

impl<T: Payload> Subscriber<T> {
    /// The oldest message that waits, if any. Never waits.
    pub fn receive(&mut self) -> Option<T> {
        let sample = self.inlet.receive().ok().flatten()?;
        let sequence = sample.user_header().0;
        self.missed += sequence.saturating_sub(self.expected.unwrap_or(sequence));
        self.expected = Some(sequence + 1);
        Some(*sample)
    }

    /// Messages lost because this end was too slow.
    #[must_use]
    pub const fn missed(&self) -> u64 {
        self.missed
    }
}

#[cfg(test)]
mod tests;
