//! The robot in motion, as a figure of a page: the script only moves lines of a drawing, from numbers in the page. RT: no.

use serde_json::json;

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

impl Pose {
    fn row(&self) -> serde_json::Value {
        let ([stance_rad, swing_rad], [stance_m, swing_m]) = (self.angles_rad, self.lengths_m);
        let hip =
            [self.foot_m[0] - stance_m * libm::sin(stance_rad), self.foot_m[1] + stance_m * libm::cos(stance_rad)];
        let toe = [hip[0] + swing_m * libm::sin(swing_rad), hip[1] - swing_m * libm::cos(swing_rad)];
        let [inner, outer] = if self.inner_stands { [self.foot_m, toe] } else { [toe, self.foot_m] };
        let body_rad = -0.5 * (stance_rad + swing_rad);
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

/// The figure. `periodic`: the end is the beginning, one step ahead.
#[must_use]
pub fn figure(poses: &[Pose], periodic: bool) -> String {
    let rows: Vec<_> = poses.iter().map(Pose::row).collect();
    let data = json!({"periodic": periodic, "rows": rows}).to_string();
    format!(
        "<figure><svg id=\"walk\" class=\"plot\" viewBox=\"0 0 860 360\" role=\"img\" aria-label=\"the robot walks\">\
         <path id=\"floor\" stroke=\"var(--soft)\" fill=\"none\"/>\
         <line id=\"outer\" stroke=\"var(--refitted)\" stroke-width=\"6\" stroke-linecap=\"round\"/>\
         <line id=\"inner\" stroke=\"var(--explained)\" stroke-width=\"6\" stroke-linecap=\"round\"/>\
         <line id=\"body\" stroke=\"var(--ink)\" stroke-width=\"10\" stroke-linecap=\"round\"/>\
         <circle id=\"hip\" r=\"8\" fill=\"var(--ink)\"/>\
         <text id=\"clock\" x=\"16\" y=\"28\" font-size=\"14\" fill=\"var(--soft)\"></text></svg>\
         <figcaption>Real time; a click halts it. Inner leg <span style=\"color:var(--explained)\">━</span>, outer leg \
         <span style=\"color:var(--refitted)\">━</span>.</figcaption></figure>\
         <script type=\"application/json\" id=\"motion\">{data}</script><script>{}</script>",
        include_str!("animation.js")
    )
}

/// Tenths of a millimetre, a millisecond, a tenth of a milliradian: enough for a drawing.
fn round(x: f64) -> f64 {
    (x * 1e4).round() / 1e4
}

#[cfg(test)]
mod tests {
    use super::*;

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
