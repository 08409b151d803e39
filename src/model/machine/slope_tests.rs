//! Laws of a floor with slopes.

use super::*;
use crate::model::rig::{Rig, Setup};
use crate::model::setting::{Number, Setting};

const WALKER: &str = "schema = 1\nmechanism = \"compass_gait\"\n[parameters]\nleg_length_m = 1.045\ntotal_mass_kg = 15.2\n\
    gravity_m_s2 = 9.81\nc1 = 0.1007\nc2 = 0.1434\nc3 = 0.000596\nc4 = 0.1151\nc5 = 0.1264\nc6 = 0.0026\n\
    [[actuator]]\njoint = \"hip\"\ncolumn = \"u\"\ngain = 1.0\n[[sensor]]\nmeasures = \"inner\"\ncolumn = \"y\"\n";

/// A walker on mean ground that falls by `slope_rad`, and on a profile that falls by `profile_rad` from there.
fn walker(slope_rad: f64, profile_rad: f64, friction: f64, start: &[f64; 4]) -> Machine<f64> {
    let effects = format!(
        "[[effect]]\neffect = \"foot_slip\"\nat = \"ground\"\nfriction = {friction:?}\n\
         [[effect]]\neffect = \"ground_slope\"\nat = \"ground\"\nslope = {slope_rad:?}\n"
    );
    let rig = Rig::parse(&format!("{WALKER}{effects}"), "test").unwrap();
    let mut m = Machine::new(&Setting::of(&rig, None, Some(Setup::Walk)), &|n: &Number| n.value, 1).unwrap();
    m.let_lift_off();
    m.let_stand_on_both();
    m.give_toes([0.0, 0.02]).unwrap();
    let far_m = 20.0;
    let profile = vec![[-far_m, far_m * libm::tan(profile_rad)], [far_m, -far_m * libm::tan(profile_rad)]];
    m.lay_floor(Floor { tip_radius_m: 0.02, profile, ..Floor::default() });
    m.reset(0.0, start);
    m
}

/// The same physics in two descriptions: ground that is tilted as a whole, and level ground with a slope on it.
#[test]
fn a_profile_that_falls_everywhere_is_tilted_ground() {
    // Standing, stepping, sliding and lying on both feet, downhill and uphill.
    let starts = [[0.12, -0.1, -0.9, 1.1], [-0.02, -0.3, -0.6, 2.5]];
    let (mut touchdowns, mut slides, mut both_feet, mut apart, mut compared) = (0, 0, 0, 0, 0);
    let mut most = [0.0_f64; 3];
    for (angle_rad, friction, start) in
        [0.06, -0.08].into_iter().flat_map(|a| [0.6, 0.15].map(|f| (a, f))).flat_map(|(a, f)| starts.map(|s| (a, f, s)))
    {
        let mut tilted = walker(angle_rad, 0.0, friction, &start);
        let mut sloped = walker(0.0, angle_rad, friction, &start);
        for k in 1..=700 {
            let t = f64::from(k) * 1e-3;
            let [a, b] = [&mut tilted, &mut sloped].map(|m| {
                m.command(0, 3.0 * libm::sin(9.0 * t), true);
                let ended = m.advance_to(t).is_err();
                (ended, m.stance(), m.contact(), m.touchdowns().0, m.second_foot_force().is_some())
            });
            // The second foot is noticed once it is so deep, along the normal in one and vertically in the other.
            apart += u32::from(a != b);
            compared += 1;
            slides += u32::from(matches!(a.2, Contact::Sliding(_)));
            both_feet += u32::from(a.4);
            for leg in 0..2 {
                most[0] = most[0].max((tilted.coordinate(leg) - sloped.coordinate(leg)).abs());
                most[1] = most[1].max((tilted.rate(leg) - sloped.rate(leg)).abs());
            }
            let ([along, normal], [x, y]) = (tilted.ground_force(), sloped.ground_force());
            let (sin, cos) = libm::sincos(angle_rad);
            // The slope falls forwards: its normal leans forwards.
            let turned = [x * cos - y * sin, y * cos + x * sin];
            if !a.4 && !b.4 && a == b {
                most[2] = most[2].max((along - turned[0]).abs()).max((normal - turned[1]).abs());
            }
            // How far it has come: along the slope, and its horizontal part.
            let ([far, _], [x, y]) = (tilted.foot_m(), sloped.foot_m());
            assert!((far * cos - x).abs() < 1e-4, "{t}: {far} {x}");
            // A second foot presses itself in by .4 mm before it becomes the one that stands.
            assert!((y + x * libm::tan(angle_rad)).abs() < 5e-4, "on the slope: {y}");
            if a.0 {
                break;
            }
        }
        touchdowns += tilted.touchdowns().0;
    }
    println!(
        "{touchdowns} touchdowns, {slides} ms of sliding, {both_feet} of {compared} ms on both feet, {apart} apart: {most:?}"
    );
    assert!(touchdowns >= 4 && slides > 50 && both_feet > 50 && apart * 100 < compared);
    // rad, rad/s, N. A stiff foot that is noticed .3 % deeper: 1e-3 rad/s. The slope left out of anything: .06 of it.
    assert!(most[0] < 1e-4 && most[1] < 2e-3 && most[2] < 0.5, "{most:?}");
}

#[test]
fn a_profile_is_straight_between_its_points_and_level_beyond_them() {
    let profile = vec![[0.5, 0.0], [2.5, 0.1], [3.0, 0.1], [4.0, -0.1]];
    let floor = Floor { terraces: vec![[2.0, 0.01]], tip_radius_m: 0.02, profile, ..Floor::default() };
    for (x, height, rise) in
        [(-9.0, 0.0, 0.0), (1.5, 0.05, 0.05), (2.75, 0.11, 0.0), (3.5, 0.01, -0.2), (9.0, -0.09, 0.0)]
    {
        let [touches_m, steep] = floor.contact(x);
        assert!((floor.point_height_m(x) - height).abs() < 1e-12 && (touches_m - height).abs() < 1e-12, "{x}");
        assert!((floor.rise(x) - rise).abs() < 1e-12 && (steep - rise).abs() < 1e-12, "{x}");
    }
    // At the edge of the terrace the rounding of the tip comes on top.
    let [_, steep] = floor.contact(1.99);
    assert!(steep > 0.3 && (floor.rise(1.99) - 0.05).abs() < 1e-12, "{steep}");
}
