//! Where a running robot is found: in shared memory of the same user, or at a socket for the group. RT: no.

use crate::channel::port::{Endpoint, Listener, robots_with};
use crate::channel::topic;
use crate::config::{self, checked::Config};
use crate::msg::{MocapSample, RecorderStatus, TickRecord};
use crate::record::cdr::encode;
use crate::record::live::{LiveReader, Message};
use crate::record::stream::Stream;
use anyhow::{Context, bail};
use std::path::Path;
use std::time::{Duration, Instant};

/// Where the service of `systemd/compass.service` has its socket.
const SERVICE_SOCKET: &str = "/run/compass/watch";
/// A robot that says nothing for so long is looked after: its process may have been killed.
const SILENCE: Duration = Duration::from_secs(1);

/// What stands beside the ticks, as far as the robot offers it.
pub(super) struct BesideTicks {
    recorder: Option<Listener<RecorderStatus>>,
    poses: Option<Listener<MocapSample>>,
    buffer: Vec<u8>,
}

impl BesideTicks {
    fn join(channels: &Endpoint) -> Self {
        let (recorder, poses) = (channels.listener(&topic::RECORDER).ok(), channels.listener(&topic::MOCAP).ok());
        Self { recorder, poses, buffer: Vec::new() }
    }

    fn poll(&mut self, each: &mut dyn FnMut(Message<'_>)) {
        while let Some(status) = self.recorder.as_mut().and_then(Listener::receive) {
            encode(&status, &mut self.buffer);
            each((Stream::Recorder, status.stamp, &self.buffer));
        }
        while let Some(pose) = self.poses.as_mut().and_then(Listener::receive) {
            encode(&pose, &mut self.buffer);
            each((Stream::Mocap, pose.stamp, &self.buffer));
        }
    }
}

/// Ticks of a running robot.
pub(super) enum Source {
    Memory { channels: Endpoint, ticks: Listener<TickRecord>, beside: Box<BesideTicks>, heard: Instant },
    Socket(LiveReader),
}

/// The robot of this name, or the only one.
pub(super) fn in_shared_memory(name: Option<&str>) -> anyhow::Result<Source> {
    let found = robots_with(&topic::TICK).with_context(|| {
        format!("the channels here belong to another user; as a member of its group: --socket {SERVICE_SOCKET}")
    })?;
    let name = match (name, found.robots.as_slice()) {
        (Some(name), _) => name,
        (None, [only]) => only,
        (None, []) => {
            if let [other, ..] = found.other_builds.as_slice() {
                bail!("robot `{other}` is run by another build of compass, whose ticks have other fields")
            }
            bail!("no robot of this user runs here; as another user of its group: --socket {SERVICE_SOCKET}")
        }
        (None, several) => bail!("several robots run here, choose by --name: {}", several.join(", ")),
    };
    let channels = Endpoint::join(name)?;
    let ticks = channels.listener(&topic::TICK).with_context(|| format!("no robot `{name}` can be read here"))?;
    if !ticks.has_publisher() {
        bail!("robot `{name}` does not run (any more)");
    }
    let beside = Box::new(BesideTicks::join(&channels));
    Ok(Source::Memory { channels, ticks, beside, heard: Instant::now() })
}

/// The robot at this socket, and its configuration.
pub(super) fn at_socket(path: &Path) -> anyhow::Result<(Source, Option<Config>)> {
    let reader = LiveReader::connect(path).with_context(|| path.display().to_string())?;
    let resolved = config::from_canonical(reader.config_text(), &[]).context("the configuration told at the socket")?;
    Ok((Source::Socket(reader), Some(resolved.config)))
}

impl Source {
    /// Hands over the ticks that came, and what stands beside them, without waiting. False at the end of the run.
    pub(super) fn poll(
        &mut self,
        each: &mut dyn FnMut(&TickRecord),
        beside: &mut dyn FnMut(Message<'_>),
    ) -> anyhow::Result<bool> {
        match self {
            Self::Socket(reader) => Ok(reader.poll(each, beside)?),
            Self::Memory { channels, ticks, beside: others, heard } => {
                others.poll(beside);
                while let Some(tick) = ticks.receive() {
                    *heard = Instant::now();
                    each(&tick);
                }
                if heard.elapsed() > SILENCE {
                    *heard = Instant::now();
                    channels.forget_the_dead();
                }
                Ok(ticks.has_publisher())
            }
        }
    }
}
