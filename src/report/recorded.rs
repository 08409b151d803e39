//! A recorded run as a page that stands alone: the robot in motion, and what controller and drives did. RT: no.

use super::animation::{Pose, figure as animation};
use super::page::document;
use super::plot::{Axis, Plot, Tone};
use super::table::escape;

/// Signals over time, all of one length.
#[derive(Clone, Debug, Default)]
pub struct Signals {
    /// Time since the first tick, s.
    pub t_s: Vec<f64>,
    /// Inner and outer leg from the vertical, rad.
    pub leg_rad: [Vec<f64>; 2],
    /// Torque that was allowed at the hip, Nm, + on the inner leg.
    pub hip_torque_nm: Vec<f64>,
    /// Lengths of an inner and an outer toe, m.
    pub toe_m: [Vec<f64>; 2],
}

/// A run.
#[derive(Clone, Debug, Default)]
pub struct Recorded {
    /// Name of the recording.
    pub name: String,
    /// What happened, in a sentence.
    pub headline: String,
    /// `[time, speed]` of each step, s and m/s.
    pub steps: Vec<[f64; 2]>,
    /// The robot while it was armed.
    pub poses: Vec<Pose>,
    /// Everything.
    pub signals: Signals,
}

/// The page.
#[must_use]
pub fn page(run: &Recorded) -> String {
    let figure = |plot: &Plot, caption: &str| {
        format!("<figure>{}<figcaption>{}</figcaption></figure>", plot.to_svg(), escape(caption))
    };
    let s = &run.signals;
    let plot = |label: &str| Plot::new(Axis::linear("time, s"), Axis::linear(label));
    let [inner, outer] = &s.leg_rad;
    let legs = plot("angle, rad").line("inner leg", Tone::Explained, &s.t_s, inner).line(
        "outer leg",
        Tone::Refitted,
        &s.t_s,
        outer,
    );
    let torque = plot("torque, Nm").line("hip", Tone::Measured, &s.t_s, &s.hip_torque_nm);
    let millimetres = |lengths: &[f64]| lengths.iter().map(|m| 1e3 * m).collect::<Vec<_>>();
    let toes = plot("length, mm").line("inner toes", Tone::Explained, &s.t_s, &millimetres(&s.toe_m[0])).line(
        "outer toes",
        Tone::Refitted,
        &s.t_s,
        &millimetres(&s.toe_m[1]),
    );
    let (times, speeds): (Vec<f64>, Vec<f64>) = run.steps.iter().map(|[t, v]| (*t, *v)).unzip();
    let speed = plot("speed, m/s").line("each step", Tone::Explained, &times, &speeds);
    let mut body = vec![
        format!(
            "<header><div class=\"top\"><span><b>Compass</b> recording</span></div><h1>{}</h1><p>{}</p></header>",
            escape(&run.name),
            escape(&run.headline)
        ),
        if run.poses.is_empty() { String::new() } else { animation(&run.poses, false) },
        "<h2>Legs</h2>".to_owned(),
        figure(
            &legs,
            "From the vertical, as estimated. A leg that stands goes down through zero as the robot walks over it.",
        ),
        "<h2>Hip torque</h2>".to_owned(),
        figure(&torque, "As safety let it pass to the drive, + on the inner leg."),
        "<h2>Toes</h2>".to_owned(),
        figure(&toes, "As the drives report them; the longer one of each leg."),
    ];
    if run.steps.len() > 1 {
        body.push("<h2>Speed</h2>".to_owned());
        body.push(figure(&speed, "Step length over the time between touchdowns, as the estimator saw them."));
    }
    document(&format!("Compass recording: {}", run.name), &body.concat())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_stands_alone_and_leaves_out_what_was_not_there() {
        let signals = Signals {
            t_s: vec![0.0, 1.0],
            leg_rad: [vec![0.1, 0.0], vec![-0.1, 0.0]],
            hip_torque_nm: vec![0.0, 5.0],
            toe_m: [vec![0.03, 0.03], vec![0.01, 0.01]],
        };
        let still = Recorded { name: "a<b>.mcap".into(), signals, ..Recorded::default() };
        let html = page(&still);
        assert!(html.contains("a&lt;b&gt;.mcap") && !html.contains("id=\"walk\"") && !html.contains("NaN"));
        assert_eq!(html.matches("class=\"plot\"").count(), 3);
        let pose = Pose { t_s: 0.0, inner_stands: true, angles_rad: [0.0; 2], lengths_m: [1.0; 2], foot_m: [0.0; 2] };
        let walked = Recorded { poses: vec![pose; 3], steps: vec![[1.0, 0.5], [1.6, 0.5]], ..still };
        assert_eq!(page(&walked).matches("class=\"plot\"").count(), 5);
    }
}
