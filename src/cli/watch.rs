//! `compass watch`: reading along with a running robot, from another process. RT: no.

mod source;

use super::config_args::ConfigArgs;
use super::run::duration;
use super::{Outcome, Run, UsageError};
use crate::msg::TickRecord;
use crate::record::json;
use crate::record::live::Message;
use crate::record::stream::{Stream, explode};
use crate::rt::stop::Stop;
use crate::telemetry::{self, Feed};
use anyhow::Context;
use source::Source;
use std::io::{self, Write};
use std::path::PathBuf;
use std::thread::sleep;
use std::time::{Duration, Instant};

/// Shows a running robot from another process, or prints its messages as JSON lines. Touches nothing.
#[derive(clap::Args)]
#[command(after_help = "\
Examples:
  compass watch                                      the view of the robot that this user runs
  compass watch --socket /run/compass/watch          of the service, for members of the group compass
  compass watch --stream estimate --stream status    messages as JSON lines, until Ctrl-C
  compass watch --stream bus0/rx --for 1s | jq -r .message.frame.id

The robot's own user reads its shared memory; the configuration for the view is then --config. Another user of the group
reads the socket of `compass run --watch-socket PATH`, and gets the configuration there. Whoever is too slow loses ticks,
never the robot.

Exit codes: 0 ended by the person or the time or with the run, 2 no such stream, 3 no robot there.")]
pub(crate) struct Args {
    #[command(flatten)]
    config: ConfigArgs,
    /// Name of the robot; may be left out where only one runs
    #[arg(long, value_name = "NAME", conflicts_with = "socket")]
    name: Option<String>,
    /// The socket of `compass run --watch-socket`, instead of shared memory
    #[arg(long, value_name = "PATH")]
    socket: Option<PathBuf>,
    /// Prints the messages of this stream, as they are called in recordings. May be given often; `all` is every one
    #[arg(long = "stream", value_name = "STREAM")]
    streams: Vec<String>,
    /// Ends after this time, such as 10s; without it with the run or on Ctrl-C
    #[arg(long = "for", value_name = "TIME", value_parser = duration)]
    watch_for: Option<Duration>,
}

impl Run for Args {
    fn run(self) -> anyhow::Result<Outcome> {
        let streams = parse_streams(&self.streams)?;
        let stop = Stop::on_signals().context("signal handlers")?;
        let (source, config) = match &self.socket {
            Some(path) => source::at_socket(path)?,
            None => (source::in_shared_memory(self.name.as_deref())?, None),
        };
        let end = self.watch_for.map(|time| Instant::now() + time);
        let mut watched = Watched { source, end, error: None, beside: Vec::new(), lines: String::new() };
        if streams.is_empty() {
            let config = config.map_or_else(|| self.config.load().map(|resolved| resolved.config), Ok)?;
            telemetry::run(&config, &mut watched, stop.flag())?;
        } else {
            print_lines(&mut watched, &streams, &stop)?;
        }
        watched.error.map_or(Ok(Outcome::Fine), Err)
    }
}

/// Streams by name.
fn parse_streams(names: &[String]) -> Result<Vec<Stream>, UsageError> {
    if names.iter().any(|name| name == "all") {
        return Ok(Stream::ALL.to_vec());
    }
    let find = |name: &String| {
        Stream::ALL.into_iter().find(|stream| stream.name() == name).ok_or_else(|| {
            let all = Stream::ALL.map(Stream::name);
            UsageError(format!("--stream {name}: there is none; there are all, {}", all.join(", ")))
        })
    };
    names.iter().map(find).collect()
}

/// A running robot as a feed.
struct Watched {
    source: Source,
    end: Option<Instant>,
    error: Option<anyhow::Error>,
    /// Streams beside the ticks that are printed, and their lines.
    beside: Vec<Stream>,
    lines: String,
}

impl Feed for Watched {
    fn poll(&mut self, each: &mut dyn FnMut(&TickRecord)) -> bool {
        let (wanted, lines) = (&self.beside, &mut self.lines);
        let mut beside = |(stream, valid_at, bytes): Message<'_>| {
            let written = !wanted.contains(&stream) || json::line(stream, valid_at, bytes, lines).is_some();
            debug_assert!(written, "our own message has our own shape");
        };
        let more = self.source.poll(each, &mut beside).unwrap_or_else(|error| {
            self.error = Some(error);
            false
        });
        more && self.end.is_none_or(|end| Instant::now() < end)
    }

    fn quit_means(&self) -> &'static str {
        "q: quit, the robot goes on"
    }
}

/// Wait when nothing is there: five ticks.
const PAUSE: Duration = Duration::from_millis(5);

/// One line for each message of these streams.
fn print_lines(watched: &mut Watched, streams: &[Stream], stop: &Stop) -> anyhow::Result<()> {
    let mut out = io::BufWriter::new(io::stdout().lock());
    let (mut buffer, mut text) = (Vec::new(), String::new());
    watched.beside = streams.iter().copied().filter(|stream| stream.is_beside()).collect();
    while !stop.is_requested() {
        let more = watched.poll(&mut |tick| put_lines(tick, streams, &mut buffer, &mut text));
        out.write_all(watched.lines.as_bytes())?;
        out.write_all(text.as_bytes())?;
        watched.lines.clear();
        text.clear();
        out.flush()?;
        if !more {
            break;
        }
        sleep(PAUSE);
    }
    Ok(())
}

/// Appends the lines of a tick.
fn put_lines(tick: &TickRecord, streams: &[Stream], buffer: &mut Vec<u8>, text: &mut String) {
    let written = explode(tick, buffer, |stream, valid_at, bytes| {
        if streams.contains(&stream) { json::line(stream, valid_at, bytes, text).ok_or(()) } else { Ok(()) }
    });
    debug_assert!(written.is_ok(), "our own message has our own shape");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_those_of_a_recording() {
        let names = |list: &[&str]| parse_streams(&list.iter().map(ToString::to_string).collect::<Vec<_>>());
        assert_eq!(names(&["estimate", "bus1/tx"]).unwrap(), [Stream::Estimate, Stream::Bus1Tx]);
        assert_eq!(names(&["all", "mocap"]).unwrap(), Stream::ALL);
        assert_eq!(names(&["recorder", "mocap"]).unwrap(), [Stream::Recorder, Stream::Mocap]);
        assert!(names(&["nonsense"]).unwrap_err().to_string().contains("snapshot"));
    }

    #[test]
    fn a_tick_gives_a_line_for_each_message_asked_for() {
        let (mut buffer, mut text) = (Vec::new(), String::new());
        put_lines(&TickRecord::default(), &[Stream::Status, Stream::Estimate], &mut buffer, &mut text);
        let streams: Vec<&str> = text.lines().map(|line| line.split('"').nth(3).unwrap()).collect();
        assert_eq!(streams, ["estimate", "status"]);
    }
}
