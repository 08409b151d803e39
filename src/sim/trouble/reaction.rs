//! What the robot does about a fault, measured: when it notices, when its motor is without torque, what it says, and what
//! brings it back. RT: no.

use crate::base::time::{Span, Stamp};
use crate::config::checked::Config;
use crate::config::fault::{Device, Injection};
use crate::msg::{Drive, Fault, FaultCode, FloorVerdict, LidarState, Mode, TickRecord};
use crate::sensor::mocap::MocapNews;
use crate::sim::lockstep::{Lockstep, LockstepError};

/// Less torque at the joint than this is none, Nm: a quantum of the drive's current.
pub(super) const NO_TORQUE_NM: f64 = 0.05;
/// After the fault is over it is looked at for so long.
const AFTERWARDS: Span = Span::from_ms(2500);
/// How it is while a fault lasts is looked at in the last of that time.
const LAST_SECOND: Span = Span::from_ms(1000);
/// So long without torque is safe.
const SAFE_FOR: Span = Span::from_ms(200);

/// What came of a fault.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Reaction {
    /// First fault told, and how long after the injection.
    pub detected: Option<(Fault, Span)>,
    /// Error code that the drive in question had then; 0 = none.
    pub drive_error: u16,
    /// From the injection to the last torque of the hip's motor before it stayed without.
    pub safe_after: Option<Span>,
    /// It was armed when the fault began.
    pub was_armed: bool,
    /// It is armed at the end.
    pub ends_armed: bool,
    /// Torque was allowed through although it was not armed, or after the fault.
    pub torque_unarmed: bool,
    /// Largest tilt of the legs while armed after the injection, rad.
    pub tilt_rad: f64,
    /// From the end of the fault to being armed again by a hand that lets go and presses.
    pub recovered_after: Option<Span>,
    /// What was told of a device that no torque hangs on, and how long after the injection.
    pub told: Option<(&'static str, Span)>,
    /// From the end of the fault to the first sound word of that device.
    pub sound_after: Option<Span>,
    /// Largest uncertainty of the terrain's part of the attitude, rad.
    pub terrain_sigma_rad: f64,
    /// What stood in the way at the end, as bits of fault codes.
    pub blockers: u64,
    /// How it is while a fault that lasts goes on.
    pub meanwhile: Option<Meanwhile>,
}

/// How a robot is that a person holds, and tries to arm again and again, while a fault does not end.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Meanwhile {
    /// In so many ticks of the last second it was armed.
    pub armed_ticks: u32,
    /// Of so many.
    pub ticks: u32,
    /// Error code of the drive in question; 0 = none.
    pub drive_error: u16,
    /// What stands in the way, as bits of fault codes.
    pub blockers: u64,
}

/// Runs the robot with this fault, once as it balances and once held by a hand, which stands for the person who sets it up
/// again.
///
/// # Errors
/// [`LockstepError`] when the robot cannot be built.
pub fn measure(config: &Config, injection: &Injection) -> Result<Reaction, LockstepError> {
    let mut config = config.clone();
    config.simulation.faults = vec![*injection];
    let mut reaction = watch(&mut Lockstep::new(&config)?, injection);
    if is_beside(injection.entry.device) {
        return Ok(reaction);
    }
    // A hand that never lets go.
    config.simulation.release_torque_nm = 1e6;
    config.simulation.release_after = Span::ZERO;
    reaction.meanwhile = meanwhile(&config, injection)?;
    let mut held = Lockstep::with_rearming_hand(&config)?;
    let end = Stamp::default() + over(injection);
    let mut faulted = false;
    while held.now() < end + AFTERWARDS && reaction.recovered_after.is_none() {
        // What is not noticed of a robot that is held is ended by letting go, as a person would who sees it.
        let lets_go = held.now() >= end && !faulted && reaction.detected.is_some();
        let status =
            if lets_go { held.step_with(|input| input.operator.dead_man = false).status } else { held.step().status };
        reaction.blockers = status.arm_blockers;
        faulted |= status.mode == Mode::Faulted;
        if held.now() > end && faulted && status.mode == Mode::Armed {
            reaction.recovered_after = Some(held.now().since(end));
        }
    }
    Ok(reaction)
}

/// The same fault without an end, and a hand that presses again whenever it can.
fn meanwhile(config: &Config, injection: &Injection) -> Result<Option<Meanwhile>, LockstepError> {
    if injection.lasts.is_none() {
        return Ok(None);
    }
    let mut config = config.clone();
    config.simulation.faults = vec![Injection { lasts: None, ..*injection }];
    let mut held = Lockstep::with_rearming_hand(&config)?;
    let mut meanwhile = Meanwhile::default();
    let end = Stamp::default() + injection.at + AFTERWARDS;
    while held.now() < end {
        let at = held.now();
        let record = held.step();
        if end.since(at) <= LAST_SECOND {
            meanwhile.ticks += 1;
            meanwhile.armed_ticks += u32::from(record.status.mode == Mode::Armed);
        }
        meanwhile.drive_error =
            record.feedback.drives.get(injection.drive as usize).map_or(0, |drive| drive.error_code);
        meanwhile.blockers = record.status.arm_blockers;
    }
    Ok(Some(meanwhile))
}

/// No torque hangs on it: the robot goes on without.
const fn is_beside(device: Device) -> bool {
    matches!(device, Device::Lidar | Device::Mocap)
}

/// When the fault is over; at once if it does not last.
fn over(injection: &Injection) -> Span {
    Span(injection.at.0 + injection.lasts.unwrap_or(Span::ZERO).0)
}

fn watch(lockstep: &mut Lockstep, injection: &Injection) -> Reaction {
    let start = Stamp::default() + injection.at;
    let end = Stamp::default() + over(injection) + AFTERWARDS;
    let mut reaction = Reaction::default();
    let mut torque_seen = start;
    let mut damaged = 0;
    while lockstep.now() < end {
        let record = *lockstep.step();
        let (at, mode) = (record.input.now, record.status.mode);
        if at < start {
            reaction.was_armed = mode == Mode::Armed;
            damaged = damaged.max(record.input.lidar.damaged);
            continue;
        }
        note(&mut reaction, injection, &record, at.since(start));
        let since_end = at.since(Stamp::default() + over(injection));
        note_lidar(&mut reaction, &record, damaged, [at.since(start), since_end]);
        note_mocap(&mut reaction, lockstep.mocap_news(), [at.since(start), since_end]);
        let plant = lockstep.plant();
        if mode == Mode::Armed {
            let reading = plant.reading();
            reaction.tilt_rad = reading.leg_angle_rad.iter().fold(reaction.tilt_rad, |most, a| most.max(a.abs()));
        }
        if plant.hip_torque_nm().abs() > NO_TORQUE_NM {
            torque_seen = at;
        }
        reaction.ends_armed = mode == Mode::Armed;
    }
    if lockstep.now().since(torque_seen) >= SAFE_FOR {
        reaction.safe_after = Some(torque_seen.since(start));
    }
    reaction
}

/// What the lidar said; `times`: since the fault's beginning, since its end.
fn note_lidar(reaction: &mut Reaction, record: &TickRecord, damaged: u32, times: [Span; 2]) {
    let [since_start, since_end] = times;
    let word = &record.input.lidar;
    reaction.terrain_sigma_rad = reaction.terrain_sigma_rad.max(record.terrain.zero_sigma_rad);
    if word.state.is_trouble() {
        reaction.told.get_or_insert((word.state.name(), since_start));
    } else if word.damaged > damaged {
        reaction.told.get_or_insert(("damaged scans", since_start));
    }
    let sound = word.state == LidarState::Streaming && word.verdict == FloorVerdict::Found;
    if sound && reaction.told.is_some() && since_end > Span::ZERO {
        reaction.sound_after.get_or_insert(since_end);
    }
}

/// The same of motion capture.
fn note_mocap(reaction: &mut Reaction, news: Option<MocapNews>, times: [Span; 2]) {
    let [since_start, since_end] = times;
    match news {
        Some(MocapNews::Trouble(trouble)) => {
            reaction.told.get_or_insert((trouble.name(), since_start));
            reaction.sound_after = None;
        }
        Some(MocapNews::Sound) if reaction.told.is_some() => {
            reaction.sound_after.get_or_insert(since_end);
        }
        _ => {}
    }
}

fn note(reaction: &mut Reaction, injection: &Injection, record: &TickRecord, after: Span) {
    let status = &record.status;
    if status.mode == Mode::Faulted && reaction.detected.is_none() {
        reaction.detected = Some((status.first_fault, after));
        let drive = usize::from(status.first_fault.index);
        let of_drive = matches!(
            status.first_fault.code,
            FaultCode::DriveFault | FaultCode::DriveNotEnabled | FaultCode::DriveStale
        );
        let drive = if of_drive { drive } else { injection.drive as usize };
        reaction.drive_error = record.feedback.drives.get(drive).map_or(0, |drive| drive.error_code);
    }
    let unarmed = status.mode != Mode::Armed;
    let hip = &record.drives.drives[Drive::Hip as usize];
    reaction.torque_unarmed |= unarmed && (record.allowed.hip_torque_nm != 0.0 || hip.torque_permille != 0);
}
