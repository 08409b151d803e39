//! Reads `rt` and `control`: threads, timing, controller and observer. RT: before arming only.

use super::checked::{
    Control, ControllerKind, FootPlacement, Input, Plan, RealTime, Recovery, Thread, Transverse, Trigger, Tvlqr,
    VirtualConstraint, Walk,
};
use super::reader::{Reader, range};
use crate::base::time::Span;
use crate::msg::Leg;

pub(super) const LEGS: &[(&str, Leg)] = &[("inner", Leg::Inner), ("outer", Leg::Outer)];

/// Of the flight recorder: 60 s at 1 kHz, a quarter of a gigabyte, which is locked.
const MOST_FLIGHT_TICKS: i64 = 60_000;

pub(super) fn real_time(r: &Reader<'_>) -> RealTime {
    const TRIGGERS: &[(&str, Trigger)] = &[("timer", Trigger::Timer), ("input", Trigger::Input)];
    const INPUTS: &[(&str, Input)] = &[("threads", Input::Threads), ("inline", Input::Inline), ("busy", Input::Busy)];
    let (control, buses, imu) = r.table("threads", |t| {
        (t.table("control", thread), [t.table("bus0", thread), t.table("bus1", thread)], t.table("imu", thread))
    });
    let timing = RealTime {
        period: r.span("period_us", 100.0, 1e6),
        trigger: r.choice("trigger", TRIGGERS, Trigger::Timer),
        input: r.choice("input", INPUTS, Input::Threads),
        input_deadline: r.span("input_deadline_us", 1.0, 1e6),
        control,
        bus: buses,
        imu,
        lock_memory: r.flag("lock_memory"),
        hold_cpu_awake: r.flag("hold_cpu_awake"),
        flight_recorder_ticks: r.integer("flight_recorder_ticks", 1, MOST_FLIGHT_TICKS, "ticks"),
    };
    // A period of 0 is the placeholder of one that was told already.
    if timing.period > Span::ZERO && timing.input_deadline >= timing.period {
        r.refuse("input_deadline_us", "must be less than period_us");
    }
    timing
}

fn thread(r: &Reader<'_>) -> Thread {
    let stack_kib: usize = r.integer("stack_kib", 64, 65_536, "KiB");
    Thread {
        priority: r.integer("priority", 0, 98, "1"),
        core: r.optional_integer("core", 0, 1023, "1"),
        stack_bytes: stack_kib * 1024,
    }
}

pub(super) fn control(r: &Reader<'_>) -> Control {
    const CONTROLLERS: &[(&str, ControllerKind)] = &[
        ("idle", ControllerKind::Idle),
        ("hold", ControllerKind::Hold),
        ("balance", ControllerKind::Balance),
        ("walk", ControllerKind::Walk),
        ("virtual_constraint", ControllerKind::VirtualConstraint),
        ("transverse", ControllerKind::Transverse),
        ("tvlqr", ControllerKind::Tvlqr),
        ("lqr_tree", ControllerKind::LqrTree),
    ];
    let controller = r.choice("controller", CONTROLLERS, ControllerKind::Idle);
    let walk_table = r.table("walk", walk);
    let recovers = controller == ControllerKind::LqrTree || controller.walks() && walk_table.recover;
    Control {
        controller,
        stance: r.choice("stance", LEGS, Leg::Inner),
        observer_epsilon_s: r.number("observer_epsilon_s", range(1e-3, 1.0, "s")),
        bias_time_s: r.number("bias_time_s", range(0.0, 1e4, "s")),
        bias_rejects_pushes: r.flag("bias_rejects_pushes"),
        attitude_time_s: r.number("attitude_time_s", range(0.01, 1e4, "s")),
        lqr_q: r.numbers("lqr_q", range(0.0, 1e9, "1")),
        lqr_r: r.number("lqr_r", range(1e-9, 1e9, "1")),
        touchdown_spring_m: r.number("touchdown_spring_m", range(0.0, 0.1, "m")),
        friction_compensation: r.number("friction_compensation", range(0.0, 2.0, "1")),
        hold_stiffness_nm_rad: r.number("hold_stiffness_nm_rad", range(0.0, 1e5, "Nm/rad")),
        hold_damping_nm_s_rad: r.number("hold_damping_nm_s_rad", range(0.0, 1e4, "Nm s/rad")),
        walk: walk_table,
        foot_placement: r.table("foot_placement", foot_placement),
        virtual_constraint: r.table("virtual_constraint", virtual_constraint),
        transverse: r.table("transverse", transverse),
        tvlqr: r.table("tvlqr", tvlqr),
        recovery: r.table("recovery", recovery),
        plan: plan(r, "plan", PLANS, controller.follows_plan()),
        tree: plan(r, "tree", TREES, recovers),
    }
}

/// Plans that are in the program: by name.
const PLANS: &[(&str, &str)] = &[
    ("gait_350mm_525mm_s", include_str!("../../config/plans/gait_350mm_525mm_s.plan")),
    ("rebalance_inner_300mm", include_str!("../../config/plans/rebalance_inner_300mm.plan")),
];

/// Trees that are in the program: by name.
const TREES: &[(&str, &str)] = &[("recovery", include_str!("../../config/plans/recovery.tree"))];

/// The plan of a controller that follows one: by name, by file, or, in a recording, its text.
fn plan(r: &Reader<'_>, key: &'static str, in_program: &[(&str, &str)], is_followed: bool) -> Plan {
    if !is_followed {
        // Not read, so not in the recording.
        return Plan { name: r.text(key), text: String::new() };
    }
    let typed = r.silent_text(key);
    let (name, text) = if typed.starts_with('{') {
        ("recorded plan".to_owned(), typed)
    } else if let Some((_, text)) = in_program.iter().find(|(name, _)| *name == typed) {
        (typed, (*text).to_owned())
    } else {
        match std::fs::read_to_string(&typed) {
            Ok(text) => (typed, text),
            Err(error) => {
                let known: Vec<&str> = in_program.iter().map(|(name, _)| *name).collect();
                r.refuse(key, &format!("cannot be read ({error}); in the program are: {}", known.join(", ")));
                (typed, String::new())
            }
        }
    };
    // Without line ends, which mean nothing in a plan: the canonical text has a line for each key.
    let text = text.replace(['\n', '\r'], "");
    r.note_text(key, &text);
    Plan { name, text }
}

fn virtual_constraint(r: &Reader<'_>) -> VirtualConstraint {
    VirtualConstraint {
        speed_m_s: r.number("speed_m_s", range(0.05, 2.0, "m/s")),
        angle_rad: r.number("angle_rad", range(0.02, 0.5, "rad")),
        angle_per_speed_s_m: r.number("angle_per_speed_s_m", range(0.0, 2.0, "rad s/m")),
        arrive_share: r.number("arrive_share", range(-0.5, 1.5, "1")),
        frozen_phase: r.number("frozen_phase", range(0.0, 1.0, "1")),
        bends: r.numbers("bends", range(-1.0, 1.0, "1")),
        retraction: r.number("retraction", range(0.0, 3.0, "rad/rad")),
        bandwidth_rad_s: r.number("bandwidth_rad_s", range(1.0, 60.0, "rad/s")),
        damping_ratio: r.number("damping_ratio", range(0.1, 3.0, "1")),
        toe_in_rad: r.number("toe_in_rad", range(-0.3, 0.3, "rad")),
        toe_out_share: r.number("toe_out_share", range(-1.0, 2.0, "1")),
        toe_in_m_rad: r.number("toe_in_m_rad", range(0.0, 5.0, "m/rad")),
        toe_out_m_rad: r.number("toe_out_m_rad", range(0.0, 5.0, "m/rad")),
        nudge_m: r.number("nudge_m", range(0.0, 0.1, "m")),
        nudge_phase: r.number("nudge_phase", range(0.01, 1.0, "1")),
        arch_m_rad: r.number("arch_m_rad", range(0.0, 1.0, "m/rad")),
    }
}

fn transverse(r: &Reader<'_>) -> Transverse {
    Transverse {
        join_cost: r.number("join_cost", range(0.0, 1e6, "1")),
        leave_cost: r.number("leave_cost", range(0.0, 1e6, "1")),
        least_energy: r.number("least_energy", range(-1.0, 1.0, "rad^2/s^2")),
        learning: r.number("learning", range(0.0, 1.0, "1")),
        fade_s: r.number("fade_s", range(1e-4, 1.0, "s")),
        toe_nominal_m: r.number("toe_nominal_m", range(0.0, 0.2, "m")),
        toe_reach_m: r.number("toe_reach_m", range(0.0, 0.2, "m")),
        toe_out_s: r.number("toe_out_s", range(0.0, 1.0, "s")),
        toe_out_rad: r.number("toe_out_rad", range(-0.5, 0.5, "rad")),
        toe_kept: r.number("toe_kept", range(0.0, 1.0, "1")),
        push_m: r.number("push_m", range(0.0, 0.2, "m")),
        push_per_energy_m_s2_rad2: r.number("push_per_energy_m_s2_rad2", range(0.0, 1.0, "m s^2/rad^2")),
        push_least_m: r.number("push_least_m", range(-0.2, 0.2, "m")),
        push_most_m: r.number("push_most_m", range(0.0, 0.2, "m")),
        push_rad: r.number("push_rad", range(-0.5, 0.5, "rad")),
    }
}

fn tvlqr(r: &Reader<'_>) -> Tvlqr {
    Tvlqr {
        fade_s: r.number("fade_s", range(1e-4, 1.0, "s")),
        toe_nominal_m: r.number("toe_nominal_m", range(0.0, 0.2, "m")),
        toe_reach_m: r.number("toe_reach_m", range(0.0, 0.2, "m")),
        toe_out_s: r.number("toe_out_s", range(0.0, 1.0, "s")),
    }
}

fn recovery(r: &Reader<'_>) -> Recovery {
    Recovery { tube_share: r.number("tube_share", range(0.0, 1.0, "1")), catch: r.flag("catch") }
}

fn walk(r: &Reader<'_>) -> Walk {
    let time = range(0.0, 1e6, "s");
    let speed = range(0.0, 2.0, "m/s");
    let speeds = r.pairs("speeds", time, speed);
    if !speeds.is_sorted_by(|a, b| a[0] < b[0]) {
        r.refuse("speeds", "must be in the order of their times");
    }
    Walk {
        speed_m_s: r.number("speed_m_s", speed),
        speeds,
        start_s: r.number("start_s", time),
        stop_s: r.optional_number("stop_s", time),
        recover: r.flag("recover"),
    }
}

fn foot_placement(r: &Reader<'_>) -> FootPlacement {
    FootPlacement {
        speed_m_s: r.number("speed_m_s", range(0.05, 2.0, "m/s")),
        aimed_m_s: r.number("aimed_m_s", range(0.05, 2.0, "m/s")),
        aimed_per_speed: r.number("aimed_per_speed", range(0.0, 10.0, "1")),
        angle_rad: r.number("angle_rad", range(0.02, 0.5, "rad")),
        angle_per_speed_s_m: r.number("angle_per_speed_s_m", range(0.0, 2.0, "rad s/m")),
        faster_per_way_1_s: r.number("faster_per_way_1_s", range(0.0, 2.0, "1/s")),
        least_angle_rad: r.number("least_angle_rad", range(0.0, 0.5, "rad")),
        most_angle_rad: r.number("most_angle_rad", range(0.0, 0.5, "rad")),
        placement_share: r.number("placement_share", range(0.0, 2.0, "1")),
        learning: r.number("learning", range(0.0, 1.0, "1")),
        first_gain: r.number("first_gain", range(-1.0, 1.0, "rad^2/s^2")),
        first_back_rad: r.number("first_back_rad", range(0.0, 0.5, "rad")),
        first_swing_s: r.number("first_swing_s", range(0.05, 2.0, "s")),
        first_angle_rad: r.number("first_angle_rad", range(0.0, 0.5, "rad")),
        lead_s: r.number("lead_s", range(0.0, 0.5, "s")),
        longest_swing_s: r.number("longest_swing_s", range(0.05, 2.0, "s")),
        slow_share: r.number("slow_share", range(0.0, 1.0, "1")),
        reach_per_energy: r.number("reach_per_energy", range(0.0, 20.0, "s^2/rad")),
        reach_most_rad: r.number("reach_most_rad", range(0.0, 0.6, "rad")),
        shortest_swing_s: r.number("shortest_swing_s", range(0.05, 2.0, "s")),
        frozen_s: r.number("frozen_s", range(0.0, 0.5, "s")),
        retraction_rad_s: r.number("retraction_rad_s", range(0.0, 2.0, "rad/s")),
        bandwidth_rad_s: r.number("bandwidth_rad_s", range(1.0, 60.0, "rad/s")),
        damping_ratio: r.number("damping_ratio", range(0.1, 3.0, "1")),
        toe_reach_m: r.number("toe_reach_m", range(0.0, 0.2, "m")),
        toe_least_m: r.number("toe_least_m", range(0.0, 0.2, "m")),
        toe_nominal_m: r.number("toe_nominal_m", range(0.0, 0.2, "m")),
        toe_bandwidth_rad_s: r.number("toe_bandwidth_rad_s", range(1.0, 100.0, "rad/s")),
        toe_kept: r.number("toe_kept", range(0.0, 1.0, "1")),
        toe_out_s: r.number("toe_out_s", range(0.0, 1.0, "s")),
        toe_out_rad: r.number("toe_out_rad", range(-0.5, 0.5, "rad")),
        toe_out_share: r.number("toe_out_share", range(0.0, 1.0, "1")),
        floor_share: r.number("floor_share", range(0.0, 2.0, "1")),
        floor_memory: r.number("floor_memory", range(0.0, 1.0, "1")),
        angle_per_slope: r.number("angle_per_slope", range(-5.0, 5.0, "1")),
        push_m: r.number("push_m", range(0.0, 0.2, "m")),
        push_per_speed_s: r.number("push_per_speed_s", range(-0.2, 0.2, "s")),
        push_least_m: r.number("push_least_m", range(-0.04, 0.04, "m")),
        push_most_m: r.number("push_most_m", range(0.0, 0.2, "m")),
        back_rad: r.number("back_rad", range(0.0, 0.5, "rad")),
        first_push_m: r.number("first_push_m", range(0.0, 0.2, "m")),
        push_rad: r.number("push_rad", range(-0.5, 0.5, "rad")),
    }
}
