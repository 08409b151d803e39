//! The same inputs through the same tick once more. RT: no.
//!
//! A tick is a pure function of its input and of its own state, so a recording that begins with the first tick must
//! come out bit by bit. After a gap the state is unknown: what follows is counted as not compared, never passed over.

use super::reader::{ReadError, Reader};
use super::scan::Ending;
use super::schema;
use super::stream::{Stream, explode};
use crate::base::time::Stamp;
use crate::control::Controller;
use crate::msg::{Mode, TickRecord, Value};
use std::convert::Infallible;
use std::fmt;

/// Where recorded and replayed values part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Difference {
    /// Number of the tick.
    pub tick: u64,
    /// Its time.
    pub now: Stamp,
    /// Stream of the message.
    pub stream: Stream,
    /// Field, such as `drives[0].torque_permille`.
    pub field: String,
    /// As recorded.
    pub recorded: String,
    /// As replayed.
    pub replayed: String,
}

impl fmt::Display for Difference {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { tick, stream, field, recorded, replayed, .. } = self;
        write!(f, "tick {tick} ({:.6} s): {}.{field}: ", self.now.as_s(), stream.name())?;
        write!(f, "recorded {recorded}, replayed {replayed}")
    }
}

/// What a replay found.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Comparison {
    /// Ticks that came out alike.
    pub alike: u64,
    /// The first difference; nothing is compared after it.
    pub difference: Option<Difference>,
    /// Ticks that were not compared, because the state before them is unknown.
    pub not_compared: u64,
    /// Why not: the tick that was expected and the one that came.
    pub gap: Option<(u64, u64)>,
}

/// A replay under way. `S` takes a recorded tick and writes the replayed one over what it wrote last.
pub struct Replay<S> {
    reader: Reader,
    step: S,
    replayed: TickRecord,
    expected: Option<u64>,
    gap: Option<(u64, u64)>,
}

/// A tick as it was, and as it comes out now.
pub struct Pair<'a> {
    /// From the file.
    pub recorded: Box<TickRecord>,
    /// From the code.
    pub replayed: &'a TickRecord,
    /// False after a gap: the two need not agree.
    pub comparable: bool,
}

impl<S: FnMut(&TickRecord, &mut TickRecord)> Replay<S> {
    /// From the present place in the file, which should be its beginning.
    pub fn new(reader: Reader, step: S) -> Self {
        Self { reader, step, replayed: TickRecord::default(), expected: None, gap: None }
    }

    /// The next tick; `None` at the end.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub fn next_pair(&mut self) -> Result<Option<Pair<'_>>, ReadError> {
        let Some(recorded) = self.reader.next_tick()? else { return Ok(None) };
        let index = recorded.input.index;
        // The first tick of a process is 0 or 1, by whoever counts.
        let follows = self.expected.map_or(index <= 1, |expected| index == expected);
        if !follows && self.gap.is_none() {
            self.gap = Some((self.expected.unwrap_or(0), index));
        }
        self.expected = Some(index.saturating_add(1));
        (self.step)(&recorded, &mut self.replayed);
        Ok(Some(Pair { recorded, replayed: &self.replayed, comparable: self.gap.is_none() }))
    }

    /// Compares to the end, or to the first difference.
    ///
    /// # Errors
    /// When the recording cannot be read.
    pub fn compare(&mut self) -> Result<Comparison, ReadError> {
        let mut found = Comparison::default();
        while let Some(pair) = self.next_pair()? {
            if found.difference.is_some() || !pair.comparable {
                found.not_compared += 1;
                continue;
            }
            found.difference = first_difference(&pair.recorded, pair.replayed);
            found.alike += u64::from(found.difference.is_none());
        }
        found.gap = self.gap;
        Ok(found)
    }

    /// Ticks of which something was missing or damaged.
    #[must_use]
    pub fn broken_ticks(&self) -> u64 {
        self.reader.broken_ticks()
    }

    /// How the file ends, once nothing more comes.
    #[must_use]
    pub const fn ending(&self) -> Option<Ending> {
        self.reader.ending()
    }
}

/// A step that takes everything from the recording but what the controller wants.
pub fn from_estimates(mut controller: Controller) -> impl FnMut(&TickRecord, &mut TickRecord) {
    let mut mode_before = Mode::Starting;
    move |recorded, replayed| {
        *replayed = *recorded;
        // As in the tick: until armed, each tick is a new beginning.
        if mode_before != Mode::Armed {
            controller.reset(recorded.input.now, &recorded.estimate);
        }
        replayed.wanted = controller.step(recorded.input.now, &recorded.estimate, &recorded.snapshot);
        replayed.control = *controller.state();
        mode_before = recorded.status.mode;
    }
}

/// The first output in which two ticks differ, in the order of the walk.
#[must_use]
pub fn first_difference(recorded: &TickRecord, replayed: &TickRecord) -> Option<Difference> {
    let (a, b) = (outputs(recorded), outputs(replayed));
    if a == b {
        return None;
    }
    let (stream, field, recorded_value, replayed_value) =
        Stream::ALL
            .into_iter()
            .filter(|stream| stream.is_output())
            .find_map(|stream| stream_difference(stream, &a, &b).map(|(f, x, y)| (stream, f, x, y)))?;
    let (tick, now) = (recorded.input.index, recorded.input.now);
    Some(Difference { tick, now, stream, field, recorded: recorded_value, replayed: replayed_value })
}

type Messages = Vec<(Stream, Vec<u8>)>;

/// Encoded output messages of a tick: equal bytes are equal bits, NaN included.
fn outputs(record: &TickRecord) -> Messages {
    let mut out = Vec::new();
    let Ok(()) = explode(record, &mut Vec::new(), |stream, _, bytes| {
        if stream.is_output() {
            out.push((stream, bytes.to_vec()));
        }
        Ok::<(), Infallible>(())
    });
    out
}

fn stream_difference(stream: Stream, a: &Messages, b: &Messages) -> Option<(String, String, String)> {
    let of = |all: &Messages| all.iter().filter(|(s, _)| *s == stream).map(|(_, m)| m.clone()).collect::<Vec<_>>();
    let (a, b) = (of(a), of(b));
    for (number, (x, y)) in a.iter().zip(&b).enumerate() {
        if x != y {
            let (field, x, y) = leaf_difference(stream, x, y)?;
            let prefix = if a.len() > 1 { format!("frame {number}: ") } else { String::new() };
            return Some((prefix + &field, x, y));
        }
    }
    (a.len() != b.len()).then(|| ("count".into(), a.len().to_string(), b.len().to_string()))
}

fn leaf_difference(stream: Stream, a: &[u8], b: &[u8]) -> Option<(String, String, String)> {
    let (a, b) = (schema::leaves(stream.shape(), a)?, schema::leaves(stream.shape(), b)?);
    let bits = |value| match value {
        Value::F64(x) => x.to_bits().to_string(),
        other => schema::show(other),
    };
    let ((path, x), (_, y)) = a.into_iter().zip(b).find(|((_, x), (_, y))| bits(*x) != bits(*y))?;
    Some((path, schema::show(x), schema::show(y)))
}

#[cfg(test)]
mod tests {
    use super::super::stream::tests::random_record;
    use super::*;

    #[test]
    fn equal_ticks_have_no_difference_even_with_nan() {
        let mut record = random_record(3);
        record.estimate.theta_stance_rad = f64::NAN;
        assert_eq!(first_difference(&record, &record.clone()), None);
    }

    #[test]
    fn one_changed_bit_is_named_by_tick_stream_field_and_values() {
        let mut record = random_record(4);
        record.input.index = 17;
        record.wanted.hip_torque_nm = 1.5;
        let mut other = record;
        other.wanted.hip_torque_nm = f64::from_bits(1.5f64.to_bits() + 1);
        let found = first_difference(&record, &other).unwrap();
        assert_eq!((found.tick, found.stream, found.field.as_str()), (17, Stream::Wanted, "hip_torque_nm"));
        assert_eq!((found.recorded.as_str(), found.replayed.as_str()), ("1.5", "1.5000000000000002"));
    }

    #[test]
    fn missing_frame_is_a_difference_in_the_count() {
        let mut record = random_record(5);
        record.output.send[0].count = 3;
        let mut other = record;
        other.output.send[0].count = 2;
        let found = first_difference(&record, &other).unwrap();
        assert_eq!((found.stream, found.field.as_str()), (Stream::Bus0Tx, "count"));
    }

    #[test]
    fn input_is_not_compared() {
        let record = random_record(6);
        let mut other = record;
        other.input.wake_latency.0 ^= 1;
        assert_eq!(first_difference(&record, &other), None);
    }
}
