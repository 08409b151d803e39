//! The robot in motion: as a figure of a page, whose script only moves lines of a drawing, from numbers in the page; and as
//! an animated SVG, for a document that runs no script. RT: no.

use super::plot::STYLE;
use serde_json::json;
use std::fmt::Write as _;

/// The robot at an instant.
#[derive(Clone, Copy, Debug)]
pub struct Pose {
    /// Time, s.
    pub t_s: f64,
    /// The inner pair stands, else the outer one.
    pub inner_stands: bool,
    /// Stance and swing leg from the vertical, rad; the stance leg leans forward below zero, the swing leg is ahead above.
    pub angles_rad: [f64; 2],
    /// Hip to the tip of the toe, stance and swing leg, m.
    pub lengths_m: [f64; 2],
    /// Place of the stance foot, m: forward, up.
    pub foot_m: [f64; 2],
}

/// Joints in the plane, m: forward, up.
struct Joints {
    hip_m: [f64; 2],
    inner_m: [f64; 2],
    outer_m: [f64; 2],
    body_rad: f64,
}

impl Pose {
    fn joints(&self) -> Joints {
        let ([stance_rad, swing_rad], [stance_m, swing_m]) = (self.angles_rad, self.lengths_m);
        let hip =
            [self.foot_m[0] - stance_m * libm::sin(stance_rad), self.foot_m[1] + stance_m * libm::cos(stance_rad)];
        let toe = [hip[0] + swing_m * libm::sin(swing_rad), hip[1] - swing_m * libm::cos(swing_rad)];
        let [inner, outer] = if self.inner_stands { [self.foot_m, toe] } else { [toe, self.foot_m] };
        Joints { hip_m: hip, inner_m: inner, outer_m: outer, body_rad: -0.5 * (stance_rad + swing_rad) }
    }

    fn row(&self) -> serde_json::Value {
        let Joints { hip_m: hip, inner_m: inner, outer_m: outer, body_rad } = self.joints();
        let numbers = [self.t_s, hip[0], hip[1], inner[0], inner[1], outer[0], outer[1], body_rad].map(round);
        json!([
            numbers[0],
            numbers[1],
            numbers[2],
            numbers[3],
            numbers[4],
            numbers[5],
            numbers[6],
            numbers[7],
            u8::from(self.inner_stands)
        ])
    }
}

/// Where the robot stood, m: forward, up, from behind; each place as it was first found.
fn footholds_m(poses: &[Pose]) -> Vec<[f64; 2]> {
    let mut feet: Vec<[f64; 2]> = poses.iter().map(|pose| pose.foot_m).collect();
    feet.sort_by(|a, b| a[0].total_cmp(&b[0]));
    feet.dedup_by(|a, b| (a[0] - b[0]).abs() < ONE_PLACE_M);
    feet
}

/// Height of the floor at a place, m: straight from foothold to foothold, level beyond them.
fn floor_m(footholds_m: &[[f64; 2]], at_m: f64) -> f64 {
    let after = footholds_m.partition_point(|[x, _]| *x <= at_m);
    match (footholds_m.get(after.wrapping_sub(1)), footholds_m.get(after)) {
        (Some([x0, y0]), Some([x1, y1])) => y0 + (y1 - y0) * (at_m - x0) / (x1 - x0),
        (Some([_, y]), None) | (None, Some([_, y])) => *y,
        (None, None) => 0.0,
    }
}

/// The figure. `periodic`: the end is the beginning, one step ahead.
#[must_use]
pub fn figure(poses: &[Pose], periodic: bool) -> String {
    let rows: Vec<_> = poses.iter().map(Pose::row).collect();
    let data = json!({"periodic": periodic, "rows": rows}).to_string();
    // A periodic motion walks on for ever: its floor moves by one mark at most.
    let floor = if periodic { floor_path(&[], [-AROUND_M, AROUND_M]) } else { floor_of(poses) };
    format!(
        "<figure><svg id=\"walk\" class=\"plot\" viewBox=\"{}\" role=\"img\" aria-label=\"the robot walks\">\
         <path id=\"floor\" stroke=\"var(--soft)\" fill=\"none\" d=\"{floor}\"/>\
         <line id=\"outer\" stroke=\"var(--refitted)\" stroke-width=\"6\" stroke-linecap=\"round\"/>\
         <line id=\"inner\" stroke=\"var(--explained)\" stroke-width=\"6\" stroke-linecap=\"round\"/>\
         <line id=\"body\" stroke=\"var(--ink)\" stroke-width=\"10\" stroke-linecap=\"round\"/>\
         <circle id=\"hip\" r=\"8\" fill=\"var(--ink)\"/>\
         <text id=\"clock\" x=\"16\" y=\"28\" font-size=\"14\" fill=\"var(--soft)\"></text></svg>\
         <figcaption>Real time; a click halts it. Inner leg <span style=\"color:var(--explained)\">━</span>, outer leg \
         <span style=\"color:var(--refitted)\">━</span>.</figcaption></figure>\
         <script type=\"application/json\" id=\"motion\">{data}</script><script>{}</script>",
        view_box(poses, 360.0),
        include_str!("animation.js")
    )
}

/// The same as a file that stands alone, in real time over and over: the camera goes with the hip. At most
/// [`LONGEST_S`] from the first pose on.
#[must_use]
pub fn animated_svg(poses: &[Pose]) -> String {
    let start_s = poses.first().map_or(0.0, |pose| pose.t_s);
    let end_s = poses.last().map_or(0.0, |pose| pose.t_s).min(start_s + LONGEST_S);
    #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "some hundred frames")]
    let frames = ((end_s - start_s) * FRAMES_PER_S) as usize + 1;
    let mut shown = poses.iter().peekable();
    let mut joints = Vec::with_capacity(frames);
    for k in 0..frames {
        #[expect(clippy::cast_precision_loss, reason = "some hundred frames")]
        let t_s = start_s + k as f64 / FRAMES_PER_S;
        while shown.next_if(|pose| pose.t_s < t_s).is_some() {}
        joints.extend(shown.peek().map(|pose| pose.joints()));
    }
    let duration_s = (end_s - start_s).max(1.0 / FRAMES_PER_S);
    let animate = |attribute: &str, value: &dyn Fn(&Joints) -> f64| {
        let values: Vec<String> = joints.iter().map(|j| format!("{:.1}", value(j))).collect();
        format!(
            "<animate attributeName=\"{attribute}\" dur=\"{duration_s:.2}s\" repeatCount=\"indefinite\" values=\"{}\"/>",
            values.join(";")
        )
    };
    let (x, y) = (|at: f64, hip: f64| 430.0 + PIXELS_PER_M * (at - hip), |at: f64| 310.0 - PIXELS_PER_M * at);
    let line = |class: &str, width: u32, ends: [String; 3]| {
        format!(
            "<line x1=\"430\" stroke=\"var(--{class})\" stroke-width=\"{width}\" stroke-linecap=\"round\">{}</line>",
            ends.concat()
        )
    };
    let hip_y = |j: &Joints| y(j.hip_m[1]);
    let leg = |class: &str, foot: &dyn Fn(&Joints) -> [f64; 2]| {
        let to =
            [animate("y1", &hip_y), animate("x2", &|j| x(foot(j)[0], j.hip_m[0])), animate("y2", &|j| y(foot(j)[1]))];
        line(class, 6, to)
    };
    let body = [
        animate("y1", &hip_y),
        animate("x2", &|j| 430.0 + BODY_PIXELS * libm::sin(j.body_rad)),
        animate("y2", &|j| hip_y(j) - BODY_PIXELS * libm::cos(j.body_rad)),
    ];
    let floor = floor_of(poses);
    let shifts: Vec<String> = joints.iter().map(|j| format!("{:.1} 0", 430.0 - PIXELS_PER_M * j.hip_m[0])).collect();
    format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{}\" width=\"860\"><style>{STYLE}</style>\
         <rect y=\"-100%\" height=\"300%\" width=\"100%\" fill=\"var(--paper)\"/>\
         <path stroke=\"var(--soft)\" fill=\"none\" d=\"{floor}\"><animateTransform attributeName=\"transform\" type=\"translate\" \
         dur=\"{duration_s:.2}s\" repeatCount=\"indefinite\" values=\"{}\"/></path>{}{}{}\
         <circle cx=\"430\" r=\"8\" fill=\"var(--ink)\">{}</circle></svg>\n",
        view_box(poses, 340.0),
        shifts.join(";"),
        leg("refitted", &|j| j.outer_m),
        leg("explained", &|j| j.inner_m),
        line("ink", 10, body),
        animate("cy", &hip_y)
    )
}

/// What of the drawing is shown, so high on level floor: as much more as the robot climbs and descends.
fn view_box(poses: &[Pose], height: f64) -> String {
    let heights = poses.iter().map(|pose| pose.foot_m[1]);
    let (lowest_m, highest_m) = heights.fold((0.0, 0.0), |(low, high): (f64, f64), y| (low.min(y), high.max(y)));
    let above = 12.0 + PIXELS_PER_M * highest_m;
    format!("0 {:.0} 860 {:.0}", -above, height + PIXELS_PER_M * (highest_m - lowest_m))
}

/// The floor under all of a walk.
fn floor_of(poses: &[Pose]) -> String {
    let hips = poses.iter().map(|pose| pose.joints().hip_m[0]);
    let [least_m, most_m] = [hips.clone().fold(f64::INFINITY, f64::min), hips.fold(f64::NEG_INFINITY, f64::max)];
    floor_path(&footholds_m(poses), [least_m - AROUND_M, most_m + AROUND_M])
}

/// The floor from place to place, m, with marks 200 mm apart: it moves under the robot.
fn floor_path(footholds_m: &[[f64; 2]], [from_m, to_m]: [f64; 2]) -> String {
    let point = |at_m: f64| {
        let place = [PIXELS_PER_M * at_m, 310.0 - PIXELS_PER_M * floor_m(footholds_m, at_m)];
        format!("{:.0} {:.1}", place[0], place[1])
    };
    let mut path = String::new();
    if from_m.is_finite() && to_m.is_finite() {
        let _infallible = write!(path, "M{}", point(from_m));
        for [x, _] in footholds_m {
            let _infallible = write!(path, "L{}", point(*x));
        }
        let _infallible = write!(path, "L{}", point(to_m));
        #[expect(clippy::cast_possible_truncation, reason = "some metres")]
        for mark in (5.0 * from_m) as i64..=(5.0 * to_m) as i64 {
            #[expect(clippy::cast_precision_loss, reason = "some metres")]
            let at_m = mark as f64 / 5.0;
            let _infallible = write!(path, "M{}l-8 10", point(at_m));
        }
    }
    path
}

/// How far the floor is drawn before and behind the hip, m: more than half the drawing.
const AROUND_M: f64 = 2.0;

/// Footholds closer than this are one, m.
const ONE_PLACE_M: f64 = 1e-3;

/// Longest animation of a document, s; its frames in a second.
const LONGEST_S: f64 = 15.0;
const FRAMES_PER_S: f64 = 25.0;
/// Scale of its drawing, and the body's length in it.
const PIXELS_PER_M: f64 = 250.0;
const BODY_PIXELS: f64 = 45.0;

/// Tenths of a millimetre, a millisecond, a tenth of a milliradian: enough for a drawing.
fn round(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floor_goes_through_the_footholds_and_is_level_beyond_them() {
        let pose = |foot_m| Pose { t_s: 0.0, inner_stands: true, angles_rad: [0.0; 2], lengths_m: [1.0; 2], foot_m };
        let poses = [[0.0, 0.0], [0.0, 0.0], [0.4, 0.02], [0.8, -0.04]].map(pose);
        let feet = footholds_m(&poses);
        assert_eq!(feet, [[0.0, 0.0], [0.4, 0.02], [0.8, -0.04]], "each place once");
        for (at_m, height_m) in [(-1.0, 0.0), (0.0, 0.0), (0.2, 0.01), (0.6, -0.01), (0.8, -0.04), (3.0, -0.04)] {
            assert!((floor_m(&feet, at_m) - height_m).abs() < 1e-12, "at {at_m} m");
        }
        assert!(floor_m(&[], 1.0).abs() < 1e-12);
        assert!(animated_svg(&poses).contains("L100 305.0L200 320.0L"), "in the drawing");
        assert!(animated_svg(&poses).contains("viewBox=\"0 -17 860 355\""), "5 px up and 10 px down besides");
        assert!(figure(&poses, false).contains("L100 305.0L200 320.0L"), "in the page");
        assert!(figure(&poses, true).contains("d=\"M-500 310.0L500 310.0M"), "a periodic motion has a level floor");
    }

    #[test]
    fn animated_drawing_has_a_value_for_each_frame_and_keeps_the_hip_in_the_middle() {
        let pose = |k: u32| {
            let s = f64::from(k) / 100.0;
            let angles_rad = [0.2 - 0.4 * s, -0.2 + 0.4 * s];
            Pose { t_s: 3.0 + s, inner_stands: true, angles_rad, lengths_m: [1.0; 2], foot_m: [0.5, 0.0] }
        };
        let svg = animated_svg(&(0..=100).map(pose).collect::<Vec<_>>());
        let values: Vec<usize> =
            svg.split("values=\"").skip(1).map(|v| v.split('"').next().unwrap().split(';').count()).collect();
        assert_eq!(values, [26; 11], "1 s, 25 frames a second, both ends");
        // The inner foot begins .2 rad ahead of the hip, 250 px to a metre.
        let first = format!("values=\"{:.1};", 430.0 + 250.0 * 0.2_f64.sin());
        assert!(svg.contains(&first) && !svg.contains("NaN"), "{first}");
        assert!(!animated_svg(&[]).contains("NaN"));
    }

    #[test]
    fn feet_are_where_legs_and_hip_say() {
        let pose =
            Pose { t_s: 1.0, inner_stands: false, angles_rad: [-0.2, 0.2], lengths_m: [1.0, 1.0], foot_m: [3.0, 0.0] };
        let row: Vec<f64> = serde_json::from_value(pose.row()).unwrap();
        let step = 2.0 * 0.2_f64.sin();
        assert!((row[1] - 3.0 - 0.2_f64.sin()).abs() < 1e-4, "the hip is ahead of the foot: {row:?}");
        assert!((row[3] - 3.0 - step).abs() < 1e-4 && row[4].abs() < 1e-4, "the inner foot is a step ahead: {row:?}");
        assert!((row[5] - 3.0).abs() < 1e-4 && row[8].abs() < 1e-9);
    }
}
