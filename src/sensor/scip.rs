//! Hokuyo SCIP 2: requests, and the lines of what a scanner says, over TCP or serial alike. Pure functions on bytes; who
//! asks what and when is [`super::lidar`]. RT: no, in an ordinary thread.
//!
//! A line is text and one check character; an empty line ends a reply. Values are written in characters of six bits, most
//! significant first; a row of values runs across lines.

use crate::base::time::Span;

/// Steps of the scan of a UTM-30LX: 270 degrees in steps of a quarter.
pub const STEPS: usize = 1081;
/// Longest line: 64 characters, check character, line end.
const MAX_LINE: usize = 66;
/// The scanner's clock has 24 bits of milliseconds.
const CLOCK_MASK: u32 = 0x00FF_FFFF;

/// The check character of a line.
#[must_use]
pub fn check(line: &[u8]) -> u8 {
    (line.iter().fold(0_u8, |sum, byte| sum.wrapping_add(*byte)) & 0x3F) + 0x30
}

/// A value in characters of six bits. `None` if one of them is no such character.
#[must_use]
pub fn decode(characters: &[u8]) -> Option<u32> {
    characters.iter().try_fold(0_u32, |value, c| {
        let six = c.checked_sub(0x30).filter(|six| *six < 0x40)?;
        value.checked_mul(64)?.checked_add(u32::from(six))
    })
}

/// A line without its check character; `None` if that is wrong. `KEY:value;c` has its check over `KEY:value`.
#[must_use]
pub fn checked(line: &[u8]) -> Option<&[u8]> {
    let (sum, body) = line.split_last()?;
    let short = body.strip_suffix(b";").unwrap_or(body);
    (check(short) == *sum || check(body) == *sum).then_some(short)
}

/// What a scanner tells of itself (reply to PP).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Parameters {
    /// Shorter distances are error codes, mm.
    pub nearest_mm: u32,
    /// Longest distance, mm.
    pub farthest_mm: u32,
    /// Steps of a whole turn.
    pub steps_per_turn: u32,
    /// First and last step that is measured.
    pub first: u32,
    /// See `first`.
    pub last: u32,
    /// Step that looks forward.
    pub front: u32,
    /// Turns per minute.
    pub turns_per_min: u32,
}

impl Parameters {
    /// Takes a line such as `DMIN:23`; others change nothing. False if the value is no number.
    pub fn take(&mut self, line: &[u8]) -> bool {
        let Some((key, value)) = line.split_at_checked(5) else { return true };
        let slot = match key {
            b"DMIN:" => &mut self.nearest_mm,
            b"DMAX:" => &mut self.farthest_mm,
            b"ARES:" => &mut self.steps_per_turn,
            b"AMIN:" => &mut self.first,
            b"AMAX:" => &mut self.last,
            b"AFRT:" => &mut self.front,
            b"SCAN:" => &mut self.turns_per_min,
            _ => return true,
        };
        let number = std::str::from_utf8(value).ok().and_then(|text| text.parse().ok());
        number.map(|number| *slot = number).is_some()
    }

    /// True if a scan of it can be read here.
    #[must_use]
    pub fn is_sound(&self) -> bool {
        let count = self.last.checked_sub(self.first).map(|n| n as usize + 1);
        count.is_some_and(|n| n <= STEPS)
            && self.steps_per_turn > 0
            && (self.first..=self.last).contains(&self.front)
            && self.turns_per_min > 0
            && self.nearest_mm < self.farthest_mm
    }

    /// Angle of a step, counter-clockwise from the front, rad.
    #[must_use]
    pub fn angle_rad(&self, step: u32) -> f64 {
        (f64::from(step) - f64::from(self.front)) * std::f64::consts::TAU / f64::from(self.steps_per_turn.max(1))
    }

    /// From the scan's stamp to the measurement of a step.
    #[must_use]
    pub fn delay(&self, step: u32) -> Span {
        let turn_s = 60.0 / f64::from(self.turns_per_min.max(1));
        Span::from_s(turn_s * f64::from(step) / f64::from(self.steps_per_turn.max(1)))
    }

    /// A distance, m; `None` for an error code or beyond the range: no return.
    #[must_use]
    pub fn distance_m(&self, value_mm: u32) -> Option<f64> {
        (self.nearest_mm..=self.farthest_mm).contains(&value_mm).then(|| f64::from(value_mm) * 1e-3)
    }
}

/// The whole scan as a stream for ever, three characters a step.
pub const STREAM: &[u8; 16] = b"MD0000108001000\n";
/// Stop.
pub const QUIT: &[u8; 3] = b"QT\n";
/// What it is.
pub const PARAMETERS: &[u8; 3] = b"PP\n";
/// Begin to adjust clocks.
pub const ENTER_ADJUSTING: &[u8; 4] = b"TM0\n";
/// What its clock shows; only while adjusting.
pub const CLOCK: &[u8; 4] = b"TM1\n";
/// Leave the adjusting of clocks, in which it refuses all else.
pub const LEAVE_ADJUSTING: &[u8; 4] = b"TM2\n";
/// Laser on.
pub const LASER_ON: &[u8; 3] = b"BM\n";

/// A scan.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Scan {
    /// The scanner's clock at its start, ms; wraps after 4 h 39 min.
    pub time_ms: u32,
    /// Steps that are there.
    pub count: usize,
    /// Distances, mm, from the first step on.
    pub distances_mm: [u32; STEPS],
}

/// What a reply was.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// A scan; it can be looked at now.
    Scan,
    /// An acknowledge with this status: `00` is yes.
    Status([u8; 2]),
    /// Lines of information were handed over.
    Lines,
    /// A check or a length was wrong; the scan, if it was one, is lost.
    Damaged,
}

/// Where a reply is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Place {
    /// The echo of the request comes.
    Echo,
    Status,
    Time,
    Data,
    /// Lines of information.
    Lines,
    /// Something was wrong: on to the empty line.
    Lost,
}

/// Puts replies together from bytes that come in pieces of any size.
#[derive(Clone, Debug)]
pub struct Reader {
    line: [u8; MAX_LINE],
    length: usize,
    place: Place,
    streams: bool,
    status: [u8; 2],
    /// Characters of a value that was cut by the end of a line.
    half: [u8; 3],
    half_count: usize,
    scan: Scan,
}

impl Default for Reader {
    fn default() -> Self {
        Self {
            line: [0; MAX_LINE],
            length: 0,
            place: Place::Echo,
            streams: false,
            status: [0; 2],
            half: [0; 3],
            half_count: 0,
            scan: Scan { time_ms: 0, count: 0, distances_mm: [0; STEPS] },
        }
    }
}

impl Reader {
    /// The newest scan.
    #[must_use]
    pub const fn scan(&self) -> &Scan {
        &self.scan
    }

    /// Takes a byte; gives the reply that ends with it. `info` gets lines of information, checked.
    pub fn push(&mut self, byte: u8, info: impl FnMut(&[u8])) -> Option<Reply> {
        if byte != b'\n' {
            match self.line.get_mut(self.length) {
                Some(slot) => {
                    *slot = byte;
                    self.length += 1;
                }
                // No line is that long.
                None => self.place = Place::Lost,
            }
            return None;
        }
        let (line, length) = (self.line, std::mem::take(&mut self.length));
        let line = line.get(..length).unwrap_or(&[]);
        if line.is_empty() { self.end() } else { self.take_line(line, info) }
    }

    fn take_line(&mut self, line: &[u8], mut info: impl FnMut(&[u8])) -> Option<Reply> {
        self.place = match self.place {
            Place::Echo => {
                self.streams = matches!(line, [b'M', b'D', ..]);
                Place::Status
            }
            Place::Status => match checked(line) {
                Some(&[a, b]) => {
                    self.status = [a, b];
                    if [a, b] == *b"99" && self.streams { Place::Time } else { Place::Lines }
                }
                _ => Place::Lost,
            },
            // A semicolon is a character of a value here as well.
            Place::Time => match checked_data(line).filter(|time| time.len() == 4).and_then(decode) {
                Some(time) => {
                    (self.scan.time_ms, self.scan.count, self.half_count) = (time & CLOCK_MASK, 0, 0);
                    Place::Data
                }
                None => Place::Lost,
            },
            Place::Data => match checked_data(line) {
                Some(data) if data.iter().all(|c| self.take_character(*c)) => Place::Data,
                _ => Place::Lost,
            },
            Place::Lines => match checked(line) {
                Some(text) => {
                    info(text);
                    Place::Lines
                }
                None => Place::Lost,
            },
            Place::Lost => Place::Lost,
        };
        None
    }

    /// False for what is no character of a value, or one value too many.
    fn take_character(&mut self, character: u8) -> bool {
        let Some(slot) = self.half.get_mut(self.half_count) else { return false };
        *slot = character;
        self.half_count += 1;
        if self.half_count < self.half.len() {
            return true;
        }
        self.half_count = 0;
        match (decode(&self.half), self.scan.distances_mm.get_mut(self.scan.count)) {
            (Some(value), Some(slot)) => {
                *slot = value;
                self.scan.count += 1;
                true
            }
            _ => false,
        }
    }

    /// An empty line: the reply is over. One more after it, or before the first, is nothing.
    fn end(&mut self) -> Option<Reply> {
        match std::mem::replace(&mut self.place, Place::Echo) {
            Place::Echo => None,
            Place::Data if self.half_count == 0 && self.scan.count > 0 => Some(Reply::Scan),
            Place::Lines if self.streams || self.status != *b"00" => Some(Reply::Status(self.status)),
            Place::Lines => Some(Reply::Lines),
            Place::Status | Place::Time | Place::Data | Place::Lost => Some(Reply::Damaged),
        }
    }
}

/// A line of values: a semicolon is a character like others there.
fn checked_data(line: &[u8]) -> Option<&[u8]> {
    let (sum, body) = line.split_last()?;
    (check(body) == *sum).then_some(body)
}

#[cfg(test)]
mod tests;
