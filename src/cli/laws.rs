//! Every law on the ground, for tests of the whole tick. RT: no.

use crate::msg::{LawName, Motion};

/// Keys of a run, and the law that must have chosen the torque in it at some time.
pub(super) type OnTheGround = (&'static [&'static str], LawName);

/// Long enough that each law has its turn, ms.
pub(super) const EACH_MS: usize = 6_000;

/// A walk that stops, rests and begins again: its keys, how long it takes, ms, and what it does then. The torque of its rest fades
/// after 6 s at the latest.
pub(super) const AGAIN: (&[&str], usize, Motion) =
    (&["control.controller=walk", "control.walk.speeds=[[2.5, 0.0], [6.0, 0.4]]"], 14_000, Motion::Lean);

/// All controllers. The tree needs a push out of the basin of balance.
pub(super) const ALL: [OnTheGround; 8] = [
    (&["control.controller=idle"], LawName::Idle),
    (&["control.controller=hold"], LawName::Hold),
    (&["control.controller=balance"], LawName::Balance),
    (&["control.controller=walk", "control.walk.stop_s=2.5"], LawName::FootPlacement),
    (&["control.controller=virtual_constraint"], LawName::VirtualConstraint),
    (&["control.controller=transverse"], LawName::Transverse),
    (&["control.controller=tvlqr", "control.plan=rebalance_inner_300mm"], LawName::Tvlqr),
    (
        &[
            "control.controller=lqr_tree",
            "control.recovery.tube_share=1.0",
            "control.recovery.catch=false",
            "sim.pushes=[{ time_s = 2.0, impulse_ns = 5.0 }]",
        ],
        LawName::Tree,
    ),
];

/// As `--set` has them.
pub(super) fn on_the_ground(keys: &[&str]) -> Vec<String> {
    ["sim.on_blocks=false"].iter().chain(keys).map(|key| (*key).to_owned()).collect()
}
