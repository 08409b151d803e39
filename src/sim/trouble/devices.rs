//! What each fault does to the simulated devices. RT: no.

use super::Edge;
use super::wires::Stranger;
use crate::base::time::Stamp;
use crate::config::fault::{Device, FaultName, Injection};
use crate::msg::{BusHealth, Drive};
use crate::sim::plant::{HOST, Plant, STRANGER};

impl Plant {
    /// Something breaks, or is whole again.
    pub(in crate::sim) fn suffer(&mut self, now: Stamp, edge: &Edge) {
        let (fault, on) = match edge {
            Edge::Begin(fault) => (fault, true),
            Edge::End(fault) => (fault, false),
        };
        match fault.entry.device {
            Device::Bus => self.suffer_bus(now, fault, on),
            Device::Canopen | Device::Mit | Device::Odrive | Device::Moteus => self.suffer_drive(fault, on),
            Device::Imu => self.imu.suffer(now, fault, on),
            Device::Lidar => self.lidar.iter_mut().for_each(|lidar| lidar.suffer(fault, on)),
            Device::Mocap => self.mocap.iter_mut().for_each(|mocap| mocap.suffer(fault, on)),
            // Not the plant's.
            Device::Joystick | Device::Host => {}
        }
    }

    fn suffer_bus(&mut self, now: Stamp, fault: &Injection, on: bool) {
        let bus = fault.bus;
        match fault.entry.fault {
            FaultName::BusOff => self.set_dead(bus, if on { BusHealth::Off } else { BusHealth::Active }),
            FaultName::LinkDown => self.set_dead(bus, if on { BusHealth::Down } else { BusHealth::Active }),
            FaultName::NoAcknowledge => {
                self.wires[bus].set_silent(now, on);
                self.hosts[bus].set_health(if on { BusHealth::Passive } else { BusHealth::Active });
            }
            FaultName::QueueFull => self.hosts[bus].is_full = on,
            FaultName::FrameErrors => self.hosts[bus].spoil(on.then_some(fault)),
            FaultName::ForeignTraffic => {
                let node = self.first_node(bus);
                self.set_stranger(bus, on.then(|| Stranger::talker(now, fault, node)));
            }
            FaultName::BusLoad => self.set_stranger(bus, on.then(|| Stranger::load(now, fault))),
            FaultName::WrongLength => self.drive_mut(fault.drive).defects_mut().short_answers = on,
            FaultName::StaleQueue => self.cut_power(now, bus, on),
            _ => {}
        }
    }

    /// The controller's end is off or down: what it has queued is gone.
    fn set_dead(&mut self, bus: usize, health: BusHealth) {
        self.wires[bus].flush(HOST);
        self.hosts[bus].set_health(health);
    }

    fn set_stranger(&mut self, bus: usize, stranger: Option<Stranger>) {
        self.wires[bus].flush(STRANGER);
        self.strangers[bus] = stranger;
    }

    /// The drives lose their power, so nobody acknowledges; they have booted when the cable is back.
    fn cut_power(&mut self, now: Stamp, bus: usize, on: bool) {
        self.wires[bus].set_silent(now, on);
        for drive in Drive::ALL.iter().filter(|_| on) {
            if self.bus_of[*drive as usize] == bus {
                self.reboot_drive(*drive);
            }
        }
        self.hosts[bus].set_health(if on { BusHealth::Passive } else { BusHealth::Active });
    }

    fn suffer_drive(&mut self, fault: &Injection, on: bool) {
        let drive = fault.drive;
        let defects = self.drive_mut(drive).defects_mut();
        match fault.entry.fault {
            FaultName::HeartbeatStops => defects.no_heartbeat = on,
            FaultName::ObjectServer => defects.server = if on { fault.kind } else { "" },
            FaultName::RefusesTorqueMode => defects.no_torque_mode = on,
            FaultName::MappingLost => defects.mapping_lost = if on { fault.kind } else { "" },
            FaultName::TwoNodes => defects.twice = on,
            FaultName::MitWrongId => defects.wrong_number = on,
            FaultName::MitReplyLength => defects.short_answers = on,
            FaultName::MitPositionWrap => defects.wraps = on,
            FaultName::MitWrongRanges => defects.wrong_ranges = if on { fault.kind } else { "" },
            FaultName::OdriveDialect => defects.other_dialect = on,
            FaultName::OdriveNoEncoder => defects.no_encoder = on,
            FaultName::MoteusNotSet => defects.no_position = on,
            FaultName::MoteusNoReply => defects.no_answer = on,
            FaultName::MoteusReadError => defects.read_errors = on,
            FaultName::StatuswordStuck => self.drive_mut(drive).stick(on, fault.kind == "no_power"),
            FaultName::Emergency | FaultName::OdriveError | FaultName::MoteusFault if on => {
                self.fail_drive(drive, fault.code);
            }
            FaultName::OdriveWatchdog | FaultName::MoteusTimedOut if on => self.drive_mut(drive).time_out(),
            FaultName::MitEnterKick if on => self.drive_mut(drive).hold_full_torque(),
            _ => {}
        }
        if on && reboots(fault.entry.fault) {
            self.reboot_drive(drive);
        }
    }
}

/// Faults that show only when the drive is set up again.
const fn reboots(fault: FaultName) -> bool {
    matches!(
        fault,
        FaultName::BootUp
            | FaultName::ObjectServer
            | FaultName::RefusesTorqueMode
            | FaultName::MitWrongRanges
            | FaultName::MitNoZero
            | FaultName::OdriveDialect
    )
}
