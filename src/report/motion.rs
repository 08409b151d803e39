//! A planned motion as a page that stands alone: animation, phase portrait, torque, clearance, ground force. RT: no.

use super::animation::{Pose, figure as animation};
use super::page::document;
use super::plot::{Axis, Plot, Tone};
use super::table::escape;

/// The leg that stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stance {
    /// The inner pair.
    Inner,
    /// The outer pair.
    Outer,
}

/// One instant.
#[derive(Clone, Copy, Debug)]
pub struct Instant {
    /// Since the beginning, s.
    pub t_s: f64,
    /// Who stands.
    pub stance: Stance,
    /// `[θs, θw, θ̇s, θ̇w]`, rad and rad/s.
    pub state: [f64; 4],
    /// Net torque on the stance row, Nm.
    pub torque_nm: f64,
    /// The motor's, with friction compensation, Nm.
    pub motor_nm: f64,
    /// Swing foot above the floor, its toe drawn in as planned, m.
    pub clearance_m: f64,
    /// How far the swing toe is drawn in, m.
    pub drawn_in_m: f64,
    /// Horizontal over normal force of the stance foot.
    pub force_ratio: f64,
    /// Normal force of the stance foot, N.
    pub normal_n: f64,
    /// Place of the stance foot, m.
    pub foot_m: [f64; 2],
}

impl Instant {
    fn pose(&self, leg_m: f64) -> Pose {
        let [stance_rad, swing_rad, ..] = self.state;
        Pose {
            t_s: self.t_s,
            inner_stands: self.stance == Stance::Inner,
            angles_rad: [stance_rad, swing_rad],
            lengths_m: [leg_m, leg_m - self.drawn_in_m],
            foot_m: self.foot_m,
        }
    }
}

/// A motion.
#[derive(Clone, Debug)]
pub struct Motion {
    /// Heading.
    pub title: String,
    /// What made it.
    pub command: String,
    /// Leg length, m.
    pub leg_m: f64,
    /// The end is the beginning.
    pub periodic: bool,
    /// In order of time.
    pub instants: Vec<Instant>,
}

/// The page.
#[must_use]
pub fn page(motion: &Motion) -> String {
    let figure = |plot: &Plot, caption: &str| {
        format!("<figure>{}<figcaption>{}</figcaption></figure>", plot.to_svg(), escape(caption))
    };
    let t: Vec<f64> = motion.instants.iter().map(|i| i.t_s).collect();
    let of = |f: fn(&Instant) -> f64| motion.instants.iter().map(f).collect::<Vec<f64>>();
    let plot = |label: &str| Plot::new(Axis::linear("time, s"), Axis::linear(label));
    let torque = plot("torque, Nm").line("motor, friction compensated", Tone::Measured, &t, &of(|i| i.motor_nm)).line(
        "net",
        Tone::Explained,
        &t,
        &of(|i| i.torque_nm),
    );
    let clearance =
        plot("height, mm").line("swing foot, toe drawn in", Tone::Explained, &t, &of(|i| 1e3 * i.clearance_m)).line(
            "with the toe left out",
            Tone::Measured,
            &t,
            &of(|i| 1e3 * (i.clearance_m - i.drawn_in_m * libm::cos(i.state[1]))),
        );
    let force = plot("Fx / Fy").line("friction needed", Tone::Explained, &t, &of(|i| i.force_ratio));
    let normal = plot("normal force, N").line("stance foot", Tone::Explained, &t, &of(|i| i.normal_n));
    let body = [
        format!(
            "<header><div class=\"top\"><span><b>Compass</b> plan</span></div><h1>{}</h1></header>",
            escape(&motion.title)
        ),
        animation(&motion.instants.iter().map(|i| i.pose(motion.leg_m)).collect::<Vec<_>>(), motion.periodic),
        "<h2>Phase portrait</h2><p class=\"soft\">Each leg's rate over its angle; dots are touchdowns.</p>".to_owned(),
        portrait(motion),
        "<h2>Torque</h2>".to_owned(),
        figure(&torque, "Hip torque, + on the stance leg."),
        "<h2>Swing foot</h2>".to_owned(),
        figure(&clearance, "Height above level floor through the stance foot."),
        "<h2>Ground force</h2>".to_owned(),
        figure(&force, "Its size must stay below the floor's friction."),
        figure(&normal, "Must stay above zero."),
        format!("<footer>{}</footer>", escape(&motion.command)),
    ]
    .concat();
    document(&format!("Compass plan: {}", motion.title), &body)
}

/// Range of some numbers, not empty.
fn range(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let [low, high] = values.fold([f64::INFINITY, f64::NEG_INFINITY], |[a, b], x| [a.min(x), b.max(x)]);
    let margin = 0.06 * (high - low).max(1e-3);
    [low - margin, high + margin]
}

/// Rate over angle of the two legs: loops, which the plots over time cannot draw.
fn portrait(motion: &Motion) -> String {
    const W: f64 = 860.0;
    const H: f64 = 380.0;
    const EDGE: f64 = 56.0;
    // By leg, not by role: (angle, rate) of inner and outer.
    let of = |leg: Stance| {
        motion.instants.iter().map(move |i| {
            let role = usize::from(i.stance != leg);
            (i.state[role], i.state[role + 2], i.stance)
        })
    };
    let both = || of(Stance::Inner).chain(of(Stance::Outer));
    let ([x0, x1], [y0, y1]) = (range(both().map(|p| p.0)), range(both().map(|p| p.1)));
    let place = |x: f64, y: f64| {
        (EDGE + (x - x0) / (x1 - x0) * (W - EDGE - 16.0), H - 40.0 - (y - y0) / (y1 - y0) * (H - 60.0))
    };
    let mut out = format!("<figure><svg class=\"plot\" viewBox=\"0 0 {W} {H}\" role=\"img\">");
    let (zero_x, zero_y) = (place(0.0, 0.0).0, place(0.0, 0.0).1);
    if (EDGE..W).contains(&zero_x) {
        out += &format!("<path d=\"M{zero_x:.1} 20V{:.1}\" stroke=\"var(--faint)\"/>", H - 40.0);
    }
    if (20.0..H - 40.0).contains(&zero_y) {
        out += &format!("<path d=\"M{EDGE} {zero_y:.1}H{:.1}\" stroke=\"var(--faint)\"/>", W - 16.0);
    }
    for (leg, class, name) in [(Stance::Inner, "--explained", "inner leg"), (Stance::Outer, "--refitted", "outer leg")]
    {
        let mut points: Vec<_> = of(leg).collect();
        // Where the end is the beginning its touchdown closes the loop.
        points.extend(points.first().copied().filter(|_| motion.periodic));
        let line: String = points.iter().map(|p| place(p.0, p.1)).map(|(x, y)| format!("{x:.1},{y:.1} ")).collect();
        let dash = if leg == Stance::Inner { "" } else { " stroke-dasharray=\"7 3\"" };
        out += &format!("<polyline points=\"{line}\" fill=\"none\" stroke=\"var({class})\" stroke-width=\"2\"{dash}/>");
        for pair in points.windows(2).filter(|pair| pair[0].2 != pair[1].2) {
            for p in pair {
                let (x, y) = place(p.0, p.1);
                out += &format!("<circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"4\" fill=\"var({class})\"/>");
            }
        }
        let y = if leg == Stance::Inner { 34 } else { 54 };
        out += &format!(
            "<path d=\"M{0:.1} {1}h26\" stroke=\"var({class})\" stroke-width=\"2\"{dash}/>\
             <text x=\"{2:.1}\" y=\"{y}\" fill=\"var(--ink)\" font-size=\"13\">{name}</text>",
            W - 150.0,
            y - 4,
            W - 116.0
        );
    }
    out += &labels([W, H, EDGE], [[x0, x1], [y0, y1]]);
    out + "</svg></figure>"
}

/// The ends of both axes and their names.
fn labels([width, height, edge]: [f64; 3], [[x0, x1], [y0, y1]]: [[f64; 2]; 2]) -> String {
    let mut out = String::new();
    for (x, y, text, anchor) in [
        (edge, height - 22.0, format!("{x0:.2}"), "start"),
        (width - 16.0, height - 22.0, format!("{x1:.2}"), "end"),
        (width / 2.0, height - 6.0, "angle, rad".to_owned(), "middle"),
        (edge - 6.0, height - 40.0, format!("{y0:.1}"), "end"),
        (edge - 6.0, 28.0, format!("{y1:.1}"), "end"),
    ] {
        out += &format!(
            "<text x=\"{x:.0}\" y=\"{y:.0}\" fill=\"var(--soft)\" font-size=\"13\" text-anchor=\"{anchor}\">{text}</text>"
        );
    }
    out += &format!(
        "<text transform=\"translate(14 {:.0}) rotate(-90)\" fill=\"var(--soft)\" font-size=\"13\" text-anchor=\"middle\">rate, rad/s</text>",
        height / 2.0
    );
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn page_stands_alone_and_has_every_drawing() {
        let instant = |k: u32| Instant {
            t_s: 0.1 * f64::from(k),
            stance: if k < 5 { Stance::Inner } else { Stance::Outer },
            state: [0.2 - 0.04 * f64::from(k), -0.2 + 0.04 * f64::from(k), -0.4, 0.4],
            torque_nm: 1.0,
            motor_nm: 2.0,
            clearance_m: 0.02,
            drawn_in_m: 0.01,
            force_ratio: 0.1,
            normal_n: 140.0,
            foot_m: [0.0, 0.0],
        };
        let motion = Motion {
            title: "gait <x>".into(),
            command: "compass plan gait".into(),
            leg_m: 1.0,
            periodic: true,
            instants: (0..10).map(instant).collect(),
        };
        let html = page(&motion);
        assert!(html.contains("gait &lt;x&gt;") && !html.contains("http://") || html.contains("www.w3.org"));
        assert_eq!(html.matches("class=\"plot\"").count(), 6, "animation, portrait, torque, clearance, two of force");
        assert!(!html.contains("src=") && !html.contains("NaN"));
        let dots = |periodic: bool| portrait(&Motion { periodic, ..motion.clone() }).matches("<circle").count();
        assert_eq!((dots(false), dots(true)), (4, 8), "two touchdowns of a gait, each with the jump of both legs");
    }
}
