//! Reads a recording: what it says of itself, then ticks. Torn files read up to the last whole tick. RT: no.

use super::log_file::{CLOCK, CONFIG, PROGRAM};
use super::scan::{Ending, Record, Scan};
use super::schema;
use super::stream::{Assembled, Assembly, Stream};
use crate::msg::TickRecord;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::{self, BufReader};
use std::path::{Path, PathBuf};

/// A recording cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum ReadError {
    /// The file itself.
    #[error("{path}: cannot be read")]
    Io {
        /// Which.
        path: PathBuf,
        /// Why.
        source: io::Error,
    },
    /// Something else.
    #[error("{path}: {what}")]
    Foreign {
        /// Which.
        path: PathBuf,
        /// What is wrong with it.
        what: String,
    },
}

/// What a recording says of itself.
#[derive(Clone, Debug, Default)]
pub struct About {
    /// Canonical text of the resolved configuration.
    pub config_text: Option<String>,
    /// Metadata by set and name.
    pub metadata: BTreeMap<String, BTreeMap<String, String>>,
}

impl About {
    /// A value of the program's metadata: `version`, `config_sha256`, `binary_sha256`.
    #[must_use]
    pub fn program(&self, name: &str) -> Option<&str> {
        self.metadata.get(PROGRAM)?.get(name).map(String::as_str)
    }

    /// Time of day of the first tick: tick time and UNIX time, ns.
    #[must_use]
    pub fn clock(&self) -> Option<(i64, i128)> {
        let clock = self.metadata.get(CLOCK)?;
        Some((clock.get("tick_ns")?.parse().ok()?, clock.get("unix_ns")?.parse().ok()?))
    }
}

/// A message on its way to whoever wants it.
#[derive(Clone, Copy, Debug)]
pub struct Message<'a> {
    /// Its stream.
    pub stream: Stream,
    /// Time of validity, ns.
    pub log_time_ns: u64,
    /// Low bits of the tick's number.
    pub sequence: u32,
    /// Encoded message.
    pub bytes: &'a [u8],
}

/// An open recording.
pub struct Reader {
    path: PathBuf,
    scan: Scan<BufReader<File>>,
    about: About,
    schemas: HashMap<u16, (String, Vec<u8>)>,
    channels: HashMap<u16, Stream>,
    assembly: Assembly,
    broken: u64,
}

impl Reader {
    /// Opens a file and checks that it is a recording at all.
    ///
    /// # Errors
    /// See [`ReadError`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let io = |source| ReadError::Io { path: path.to_owned(), source };
        let file = File::open(path).map_err(io)?;
        let scan =
            Scan::new(BufReader::with_capacity(1 << 20, file)).map_err(io)?.ok_or_else(|| ReadError::Foreign {
                path: path.to_owned(),
                what: "is no MCAP file (or cut within its first 8 bytes)".into(),
            })?;
        Ok(Self {
            path: path.to_owned(),
            scan,
            about: About::default(),
            schemas: HashMap::new(),
            channels: HashMap::new(),
            assembly: Assembly::default(),
            broken: 0,
        })
    }

    /// What was found so far; configuration and program stand before the first message.
    #[must_use]
    pub const fn about(&self) -> &About {
        &self.about
    }

    /// How the file ends, once nothing more comes.
    #[must_use]
    pub const fn ending(&self) -> Option<Ending> {
        self.scan.ending()
    }

    /// Ticks of which parts are missing.
    #[must_use]
    pub const fn broken_ticks(&self) -> u64 {
        self.broken
    }

    /// Hands each message to `see` until it says that it has what it wants, or the file ends.
    ///
    /// # Errors
    /// When the file cannot be read, or was written by a version with other messages.
    pub fn messages<T>(&mut self, mut see: impl FnMut(Message<'_>) -> Option<T>) -> Result<Option<T>, ReadError> {
        let Self { path, scan, about, schemas, channels, .. } = self;
        let io = |source| ReadError::Io { path: path.clone(), source };
        while let Some(record) = scan.next_record().map_err(io)? {
            match record {
                Record::Message { channel, sequence, log_time, data } => {
                    let Some(&stream) = channels.get(&channel) else { continue };
                    let message = Message { stream, log_time_ns: log_time, sequence, bytes: data };
                    if let Some(found) = see(message) {
                        return Ok(Some(found));
                    }
                }
                Record::Schema { id, name, text } => {
                    schemas.insert(id, (name.to_owned(), text.to_vec()));
                }
                Record::Channel { id, schema, topic, encoding } => {
                    if let Some(stream) = known_stream(topic, encoding, schemas.get(&schema))
                        .map_err(|what| ReadError::Foreign { path: path.clone(), what })?
                    {
                        channels.insert(id, stream);
                    }
                }
                Record::Attachment { name: CONFIG, data } => {
                    about.config_text = Some(String::from_utf8_lossy(data).into_owned());
                }
                Record::Metadata { name, entries } => {
                    let entries = entries.into_iter().map(|(k, v)| (k.to_owned(), v.to_owned()));
                    about.metadata.entry(name.to_owned()).or_default().extend(entries);
                }
                Record::Attachment { .. } | Record::DataEnd | Record::Other => {}
            }
        }
        Ok(None)
    }

    /// The next whole tick; `None` at the end.
    ///
    /// # Errors
    /// As for [`Self::messages`].
    pub fn next_tick(&mut self) -> Result<Option<Box<TickRecord>>, ReadError> {
        let mut assembly = std::mem::take(&mut self.assembly);
        let mut broken = 0;
        let tick = self.messages(|message| {
            let cut_short = message.stream == Stream::Tick && assembly.is_open();
            broken += u64::from(cut_short);
            match assembly.take(message.stream, message.bytes) {
                Assembled::Tick(tick) => Some(tick),
                Assembled::Pending => None,
                Assembled::Broken => {
                    // Counted once per tick: at its status, or when its head is no head.
                    broken += u64::from(matches!(message.stream, Stream::Status | Stream::Tick));
                    None
                }
            }
        });
        self.assembly = assembly;
        self.broken += broken;
        tick
    }
}

/// Our stream of that name, if the file means the same by it.
fn known_stream(topic: &str, encoding: &str, schema: Option<&(String, Vec<u8>)>) -> Result<Option<Stream>, String> {
    let Some(stream) = Stream::ALL.into_iter().find(|s| s.name() == topic) else { return Ok(None) };
    let ours = schema::ros2msg(stream.shape());
    match schema {
        Some((name, text)) if *name == schema::name(stream.shape()) && encoding == "cdr" => {
            if *text == ours.as_bytes() {
                return Ok(Some(stream));
            }
            let theirs = String::from_utf8_lossy(text);
            let other = first_difference(&theirs, &ours);
            Err(format!("`{topic}` was recorded by a version with another message: {other}"))
        }
        _ => Err(format!("`{topic}` is not what this program records")),
    }
}

/// The first line in which two definitions differ; comments count, as units stand there too.
fn first_difference(theirs: &str, ours: &str) -> String {
    let mut pairs = theirs.lines().zip(ours.lines());
    match pairs.find(|(a, b)| a != b) {
        Some((theirs, ours)) => format!("it says `{theirs}`, this version `{ours}`"),
        None => "one is longer than the other".into(),
    }
}
