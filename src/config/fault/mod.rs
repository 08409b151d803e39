//! Faults to inject: what `sim.faults` and `--fault NAME@TIME[:ARGS]` say. RT: no.
//!
//! One text per fault: `bus_off@3s:bus=1,for=200ms`. The catalogue has the names, the arguments of each and their
//! defaults; whoever runs the robot does it.

mod catalogue;

pub use catalogue::{CATALOGUE, Device, Entry, FaultName, Place};

use super::checked::{DriveProtocol, Robot};
use super::robot::DRIVE_KEYS;
use crate::base::time::Span;
use crate::msg::{BUSES, Drive};

/// Names that are told when one is not known.
const NEAREST: usize = 3;

/// A fault with its time and arguments. What a fault does not use has its default.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Injection {
    /// Which.
    pub entry: &'static Entry,
    /// When, counted from switching on.
    pub at: Span,
    /// How long; `None` = it does not end by itself, or is over at once.
    pub lasts: Option<Span>,
    /// Which bus.
    pub bus: usize,
    /// Which drive.
    pub drive: Drive,
    /// Which kind of it; empty if there is one only.
    pub kind: &'static str,
    /// Share of frames, bytes or messages.
    pub share: f64,
    /// So late.
    pub late: Span,
    /// Once in this time.
    pub every: Span,
    /// Error code.
    pub code: u16,
}

impl Injection {
    /// Reads `NAME@TIME[:KEY=VALUE,...]`.
    ///
    /// # Errors
    /// What is wrong, by the name of the argument, with what is allowed.
    pub fn parse(text: &str) -> Result<Self, String> {
        let (head, arguments) = text.split_once(':').unwrap_or((text, ""));
        let (name, time) = head.split_once('@').ok_or("TIME is missing: expected NAME@TIME[:ARGS]")?;
        let entry = CATALOGUE.iter().find(|entry| entry.name == name).ok_or_else(|| unknown_name(name))?;
        let at = time_of(time).ok_or_else(|| format!("TIME: `{time}` is no time such as 3, 3s or 500ms"))?;
        let mut this = Self {
            entry,
            at,
            lasts: None,
            bus: 0,
            drive: Drive::Hip,
            kind: "",
            share: 0.0,
            late: Span::ZERO,
            every: Span::ZERO,
            code: 0,
        };
        for pair in pairs(entry.defaults).chain(pairs(arguments)) {
            this.set(pair)?;
        }
        Ok(this)
    }

    fn set(&mut self, pair: &str) -> Result<(), String> {
        let (key, value) = pair.split_once('=').ok_or_else(|| format!("`{pair}`: expected KEY=VALUE"))?;
        if !pairs(self.entry.defaults).any(|known| known.split_once('=').is_some_and(|(k, _)| k == key)) {
            return Err(unknown_key(self.entry, key));
        }
        let wrong = |allowed: &str| format!("argument {key}: `{value}` must be {allowed}");
        let time = || time_of(value).filter(|t| *t > Span::ZERO).ok_or_else(|| wrong("a time above 0 such as 200ms"));
        match key {
            "bus" => self.bus = value.parse().ok().filter(|b| *b < BUSES).ok_or_else(|| wrong("0 or 1"))?,
            "drive" => {
                self.drive = drive_of(value).ok_or_else(|| wrong(&format!("one of {}", DRIVE_KEYS.join(", "))))?
            }
            "kind" => {
                let found = self.entry.kinds.iter().find(|kind| **kind == value);
                self.kind = found.ok_or_else(|| wrong(&format!("one of {}", self.entry.kinds.join(", "))))?;
            }
            "share" => {
                let share = value.parse().ok().filter(|s| (0.0..=1.0).contains(s));
                self.share = share.ok_or_else(|| wrong("0 to 1"))?;
            }
            "code" => self.code = code_of(value).ok_or_else(|| wrong("1 to 65535, or hexadecimal such as 0x2310"))?,
            "late" => self.late = time()?,
            "every" => self.every = time()?,
            "for" if value == "ever" => self.lasts = None,
            "for" => self.lasts = Some(time()?),
            _ => return Err(unknown_key(self.entry, key)),
        }
        Ok(())
    }

    /// As it would be typed, with all arguments.
    #[must_use]
    pub fn text(&self) -> String {
        #[expect(clippy::cast_precision_loss, reason = "a run of weeks has 2^53 ns")]
        let ms = |span: Span| format!("{}ms", span.0 as f64 / 1e6);
        let value = |key: &str| match key {
            "bus" => self.bus.to_string(),
            "drive" => DRIVE_KEYS[self.drive as usize].to_owned(),
            "kind" => self.kind.to_owned(),
            "share" => self.share.to_string(),
            "code" => format!("{:#06x}", self.code),
            "late" => ms(self.late),
            "every" => ms(self.every),
            _ => self.lasts.map_or_else(|| "ever".to_owned(), ms),
        };
        let keys = pairs(self.entry.defaults).filter_map(|pair| Some(pair.split_once('=')?.0));
        let arguments: Vec<String> = keys.map(|key| format!("{key}={}", value(key))).collect();
        let colon = if arguments.is_empty() { "" } else { ":" };
        format!("{}@{}{colon}{}", self.entry.name, ms(self.at), arguments.join(","))
    }

    /// Whether it can be injected there.
    ///
    /// # Errors
    /// Where it can.
    pub fn check_place(&self, place: Place) -> Result<(), String> {
        if self.entry.is_for(place) {
            return Ok(());
        }
        let all = [Place::Sim, Place::Run, Place::Plant, Place::Guest];
        let places: Vec<&str> = all.into_iter().filter(|at| self.entry.is_for(*at)).map(Place::name).collect();
        Err(format!("NAME: {} cannot be injected in {}, but in {}", self.entry.name, place.name(), places.join(", ")))
    }

    /// Whether this robot has what the fault is a fault of.
    ///
    /// # Errors
    /// What it has instead, and how it would get it.
    pub fn check(&self, robot: &Robot) -> Result<(), String> {
        let protocol = &robot.drives[self.drive as usize].protocol;
        let (key, name) = (DRIVE_KEYS[self.drive as usize], self.entry.name);
        let speaks = |what: &str, example: &str| {
            let is = protocol_name(protocol);
            Err(format!("argument drive: {name} is a fault of {what}, but {key} speaks {is}{example}"))
        };
        let needs = |what: &str| Err(format!("{name}: this robot has no {what}"));
        match (self.entry.device, protocol) {
            (Device::Canopen, DriveProtocol::Cia402(_))
            | (Device::Mit, DriveProtocol::Mit(_))
            | (Device::Odrive, DriveProtocol::Odrive(_))
            | (Device::Moteus, DriveProtocol::Moteus(_))
            | (Device::Bus | Device::Imu | Device::Joystick | Device::Host, _) => Ok(()),
            (Device::Canopen, _) => speaks("CANopen drives", ""),
            (Device::Mit, _) => speaks("MIT drives", "; see config/examples/mit.toml"),
            (Device::Odrive, _) => speaks("ODrives", "; see config/examples/odrive.toml"),
            (Device::Moteus, _) => speaks("moteus drives", "; see config/examples/moteus.toml"),
            (Device::Lidar, _) if robot.lidar.is_none() => {
                needs("lidar; give it one: robot.lidar, see config/examples/lidar.toml")
            }
            (Device::Mocap, _) if robot.mocap.is_none() => {
                needs("motion capture; give it some: robot.mocap, see config/examples/mocap.toml")
            }
            (Device::Lidar | Device::Mocap, _) => Ok(()),
        }
    }
}

const fn protocol_name(protocol: &DriveProtocol) -> &'static str {
    match protocol {
        DriveProtocol::Cia402(_) => "CiA 402",
        DriveProtocol::Mit(_) => "MIT",
        DriveProtocol::Odrive(_) => "ODrive CANSimple",
        DriveProtocol::Moteus(_) => "moteus",
    }
}

fn pairs(text: &str) -> impl Iterator<Item = &str> {
    text.split(',').map(str::trim).filter(|pair| !pair.is_empty())
}

fn drive_of(key: &str) -> Option<Drive> {
    Drive::ALL.iter().copied().find(|drive| DRIVE_KEYS[*drive as usize] == key)
}

fn code_of(text: &str) -> Option<u16> {
    let hex = text.strip_prefix("0x").map(|digits| u16::from_str_radix(digits, 16));
    hex.unwrap_or_else(|| text.parse()).ok().filter(|code| *code > 0)
}

/// Seconds, or with one of the units ms, s, min.
fn time_of(text: &str) -> Option<Span> {
    let units = [("ms", 1e-3), ("min", 60.0), ("s", 1.0), ("", 1.0)];
    let (number, factor) = units.iter().find_map(|(unit, factor)| Some((text.strip_suffix(unit)?, factor)))?;
    let seconds = number.parse::<f64>().ok()? * factor;
    (0.0..=1e6).contains(&seconds).then(|| Span::from_s(seconds))
}

fn unknown_name(name: &str) -> String {
    let mut near: Vec<(usize, &str)> =
        CATALOGUE.iter().map(|entry| (strsim::damerau_levenshtein(entry.name, name), entry.name)).collect();
    near.sort_unstable();
    let near: Vec<&str> = near.iter().take(NEAREST).map(|(_, name)| *name).collect();
    format!("NAME: no fault is called `{name}`; nearest: {} (`compass sim --fault list` has all)", near.join(", "))
}

fn unknown_key(entry: &Entry, key: &str) -> String {
    let known: Vec<&str> = pairs(entry.defaults).filter_map(|pair| Some(pair.split_once('=')?.0)).collect();
    let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
    format!("argument {key}: {} has no such argument; it has {known}", entry.name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_are_sixty_four_faults_with_different_names_and_sound_defaults() {
        assert_eq!(CATALOGUE.len(), 64);
        for (k, entry) in CATALOGUE.iter().enumerate() {
            assert!(!entry.places.is_empty() && !entry.what.is_empty(), "{}", entry.name);
            assert!(CATALOGUE[..k].iter().all(|other| other.name != entry.name), "{}", entry.name);
            let read = Injection::parse(&format!("{}@3", entry.name)).unwrap();
            assert_eq!(read.kind, entry.kinds.first().copied().unwrap_or(""), "{}", entry.name);
            assert_eq!(Injection::parse(&read.text()).unwrap(), read, "{}", entry.name);
        }
    }

    #[test]
    fn every_device_of_the_section_has_as_many_faults_as_it_lists() {
        use Device::*;
        let counts = [Bus, Canopen, Mit, Odrive, Moteus, Imu, Lidar, Mocap, Joystick, Host]
            .map(|device| CATALOGUE.iter().filter(|entry| entry.device == device).count());
        assert_eq!(counts, [9, 8, 6, 4, 5, 7, 7, 7, 5, 6]);
    }

    #[test]
    fn what_is_typed_is_understood() {
        let read = Injection::parse("frame_errors@2.5s:kind=late,bus=1,share=0.1,late=6ms,for=2min").unwrap();
        assert_eq!((read.entry.fault, read.at, read.kind), (FaultName::FrameErrors, Span::from_ms(2500), "late"));
        assert_eq!((read.bus, read.late, read.lasts), (1, Span::from_ms(6), Some(Span::from_ms(120_000))));
        assert!((read.share - 0.1).abs() < 1e-12);
        let read = Injection::parse("emergency@0:drive=outer_toe_b,code=0x4210").unwrap();
        assert_eq!((read.drive, read.code, read.lasts), (Drive::OuterToeB, 0x4210, None));
        assert_eq!(Injection::parse("bus_off@500ms:for=ever").unwrap().lasts, None);
    }

    #[test]
    fn what_is_wrong_is_told_by_the_name_of_the_argument() {
        for (text, told) in [
            ("bus_of@3", "nearest: bus_off"),
            ("bus_off", "TIME is missing"),
            ("bus_off@soon", "TIME: `soon`"),
            ("bus_off@-1", "TIME: `-1`"),
            ("bus_off@3:bus=2", "argument bus: `2` must be 0 or 1"),
            ("bus_off@3:drive=hip", "argument drive: bus_off has no such argument; it has bus, for"),
            ("imu_timer_wrap@3:for=1", "it has none"),
            ("emergency@3:drive=knee", "argument drive: `knee` must be one of hip"),
            ("emergency@3:code=0", "argument code"),
            ("frame_errors@3:share=1.5", "argument share: `1.5` must be 0 to 1"),
            ("frame_errors@3:share=nan", "argument share"),
            ("frame_errors@3:kind=eaten", "argument kind: `eaten` must be one of lost"),
            ("frame_errors@3:for=0", "argument for"),
            ("frame_errors@3:lost", "expected KEY=VALUE"),
        ] {
            let error = Injection::parse(text).unwrap_err();
            assert!(error.contains(told), "{text}: {error}");
        }
    }

    #[test]
    fn a_fault_of_a_drive_that_the_robot_does_not_have_is_refused() {
        let robot = crate::config::load(None, &[]).unwrap().config.robot;
        let check = |text: &str| Injection::parse(text).unwrap().check(&robot);
        assert_eq!(check("emergency@3"), Ok(()));
        let error = check("mit_wrong_id@3").unwrap_err();
        assert!(error.contains("argument drive") && error.contains("hip speaks CiA 402"), "{error}");
        assert!(check("lidar_split@3").is_err_and(|error| error.contains("no lidar")));
    }
}
