//! The view has a thread of its own: stdout may be blocked, full or closed, and neither the robot nor the closing of its
//! recording waits for it. RT: no.

use super::sinks::Archive;
use crate::channel::port::{Endpoint, Subscriber};
use crate::channel::topic;
use crate::config::checked::{Config, Thread};
use crate::msg::{RecorderStatus, TickRecord};
use crate::rt::process::{Progress, Running};
use crate::rt::stop::Stop;
use crate::rt::thread::Missing;
use crate::sensor::operator::Refused;
use crate::telemetry::{self, Side, ThreadLine};
use std::io::{self, Write};
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, Sender};
use std::thread::Builder;
use std::time::Duration;

/// So long the end of a run waits for a stdout that is slow.
const PATIENCE: Duration = Duration::from_secs(2);

/// What the view is made of.
pub(super) struct Parts<'a> {
    pub(super) config: &'a Config,
    pub(super) robot: &'a str,
    pub(super) running: &'a Running,
    pub(super) archive: &'a Arc<Archive>,
    pub(super) refused: Refused,
    pub(super) stop: &'a Stop,
}

/// A running view.
pub(super) struct View {
    last_words: Sender<String>,
    over: Receiver<()>,
}

impl View {
    /// Starts the thread; it shows the run until the loop has ended.
    pub(super) fn start(parts: &Parts<'_>) -> io::Result<Self> {
        let (last_words, words) = mpsc::channel::<String>();
        let (done, over) = mpsc::channel();
        let (config, robot, stop) = (parts.config.clone(), parts.robot.to_owned(), parts.stop.clone());
        let missing = parts.running.missing();
        let about = About {
            progress: parts.running.progress(),
            archive: Arc::clone(parts.archive),
            threads: thread_lines(&config, missing),
            notices: notices(&config, &robot, missing),
            refused: parts.refused.clone(),
            refused_told: 0,
        };
        let body = move || {
            if let Err(error) = show(&config, &robot, about, &stop) {
                // Nobody to tell is fine: the robot goes on without any view.
                drop(writeln!(io::stderr(), "compass: the view ended ({error:#}); the robot goes on without it"));
            }
            if let Ok(words) = words.recv()
                && io::stdout().write_all(words.as_bytes()).and_then(|()| io::stdout().flush()).is_err()
            {
                drop(io::stderr().write_all(words.as_bytes()));
            }
            // Whoever waited has lost patience.
            done.send(()).ok();
        };
        Builder::new().name("view".into()).spawn(body)?;
        Ok(Self { last_words, over })
    }

    /// Has the last words written; gives up on a stdout that nobody reads.
    pub(super) fn finish(self, words: String) {
        // An error means that the thread has ended already.
        drop(self.last_words.send(words));
        self.over.recv_timeout(PATIENCE).ok();
    }
}

fn show(config: &Config, robot: &str, about: About, stop: &Stop) -> anyhow::Result<()> {
    let channels = Endpoint::join(robot)?;
    let mut watched = Watched { ticks: channels.subscriber(&topic::TICK)?, about };
    Ok(telemetry::run(config, &mut watched, stop.flag())?)
}

/// What a person should know at the start.
fn notices(config: &Config, robot: &str, missing: Missing) -> Vec<String> {
    let mut notices: Vec<String> = missing.in_words().map(|text| format!("not granted: {text}")).collect();
    if missing.needed() != Missing::default() {
        notices.push(if config.robot.is_simulated() {
            "no real time: fine for a simulated robot, a real one would not be armed".into()
        } else {
            "NO REAL TIME: the robot will NOT be armed; `compass doctor` says what to do".into()
        });
    }
    notices.push(format!("channels of robot `{robot}`; recordings and views of other processes attach there"));
    notices
}

fn thread_lines(config: &Config, missing: Missing) -> Vec<ThreadLine> {
    let timing = &config.real_time;
    let [bus0, bus1] = &timing.bus;
    let all = [("control", &timing.control), ("bus0", bus0), ("bus1", bus1), ("imu", &timing.imu)];
    all.into_iter().map(|(name, thread)| thread_line(name, thread, missing)).collect()
}

fn thread_line(name: &str, thread: &Thread, missing: Missing) -> ThreadLine {
    let refused = |bit: Missing| missing.0 & bit.0 != 0;
    let policy = match thread.priority {
        0 => "ordinary".to_owned(),
        _ if refused(Missing::FIFO) => "FIFO refused".to_owned(),
        priority => format!("FIFO {priority}"),
    };
    let core = thread.core.map_or_else(|| "any core".to_owned(), |core| format!("core {core}"));
    let good = !refused(Missing::FIFO) && !refused(Missing::CORE);
    ThreadLine { name: name.to_owned(), detail: format!("{policy}, {core}"), good }
}

/// What does not come through the channel.
struct About {
    progress: Arc<Progress>,
    archive: Arc<Archive>,
    threads: Vec<ThreadLine>,
    notices: Vec<String>,
    refused: Refused,
    refused_told: u32,
}

impl About {
    /// A second hand on the switch, told when it begins and at every hundredth of its datagrams.
    fn tell_refusals(&mut self) {
        let (count, text) = in_words(&self.refused);
        if count > 0 && (self.refused_told == 0 || count - self.refused_told >= 100) {
            self.refused_told = count;
            self.notices.push(text);
        }
    }
}

/// How many things were refused so far, and what to tell a person of them.
fn in_words(refused: &Refused) -> (u32, String) {
    match refused {
        Refused::Nothing => (0, String::new()),
        Refused::Senders(refusals) => {
            let (count, process) = refusals.newest();
            (count, format!("a second sender for the dead-man switch is refused: process {process}, {count} times"))
        }
        Refused::Datagrams(refused) => {
            let [malformed, forged, second, stick] = refused.counts();
            let text = format!(
                "refused at the dead-man's port so far: {forged} datagrams not authentic, {malformed} malformed, \
                 {second} of a second hand, {stick} of a stick (robot.operator.speed is not configured)"
            );
            (malformed.saturating_add(forged).saturating_add(second).saturating_add(stick), text)
        }
    }
}

/// The running loop as the terminal sees it: through the same channel as any other process.
struct Watched {
    ticks: Subscriber<TickRecord>,
    about: About,
}

impl telemetry::Feed for Watched {
    fn poll(&mut self, each: &mut dyn FnMut(&TickRecord)) -> bool {
        let more = !self.about.progress.has_ended();
        while let Some(record) = self.ticks.receive() {
            each(&record);
        }
        more
    }

    fn quit_means(&self) -> &'static str {
        "q: stop and quit"
    }

    fn side(&mut self) -> Side {
        let about = &mut self.about;
        about.tell_refusals();
        let mut notices = std::mem::take(&mut about.notices);
        notices.extend(about.archive.take_notices());
        let recorder: RecorderStatus = about.archive.status().unwrap_or_default();
        Side { recorder, threads: about.threads.clone(), notices }
    }
}
