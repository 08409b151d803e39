//! The page's chapters from the results. RT: no.

use super::results::{Group, Results};
use super::statistics::wilson;
use crate::report::experiment::{Chapter, Experiment};
use crate::report::plot::{Axis, Mark, Plot, Tone};
use crate::report::table::{Align, Table, number};
use std::collections::{BTreeMap, BTreeSet};

/// Axes that are abscissae of a plot, not names of its curves.
const FLOOR: &str = "sim.floor.half_width_m";
const IMPULSE: &str = "sim.random_pushes.impulse_ns";

/// Everything that the page shows. `leg_length_m`: for roughness in per cent of it.
#[must_use]
pub fn page(name: &str, results: &Results, leg_length_m: f64) -> Experiment {
    let chapters =
        [overview(results), passage(results, leg_length_m), pushes(results), causes(results), trust(results)];
    Experiment {
        name: name.to_owned(),
        headline: headline(results),
        chapters: chapters.into_iter().flatten().collect(),
        source: format!(
            "compass {} · experiment {} · the same file, seeds and version give the same runs. Steps are true changes of \
             stance in the simulated world; intervals are 95 %.",
            results.version,
            results.file_sha256.get(..12).unwrap_or_default()
        ),
    }
}

fn headline(results: &Results) -> String {
    let completed = results.groups.iter().map(|g| g.completed).sum::<u32>();
    let missing = results.planned - results.runs.len();
    let rest = if missing > 0 { format!(" {missing} planned runs are still to do.") } else { String::new() };
    let steps: u64 = results.groups.iter().map(|g| g.steps).sum();
    format!("{}: {completed} of {} runs completed. {steps} steps in all.{rest}", results.about, results.runs.len())
}

/// Labels of the axes, those in `but` left out.
fn name(group: &Group, but: &[&str]) -> String {
    let labels: Vec<String> = group
        .axes
        .iter()
        .filter(|(key, _)| !but.contains(&key.as_str()))
        .map(|(key, label)| {
            let short = key.rsplit('.').next().unwrap_or(key);
            if key == "control.controller" { label.clone() } else { format!("{short} {label}") }
        })
        .collect();
    if labels.is_empty() { group.controller.clone() } else { labels.join(", ") }
}

fn optional(value: Option<f64>) -> String {
    value.map(number).unwrap_or_default()
}

fn percent(x: f64) -> String {
    format!("{:.0}", 100.0 * x)
}

fn overview(results: &Results) -> Option<Chapter> {
    let right = Align::Right;
    let mut table = Table::new(&[
        ("", Align::Left),
        ("floor ± mm", right),
        ("runs", right),
        ("completed (95 %)", right),
        ("steps", right),
        ("steps per fall (95 %)", right),
        ("m/s", right),
        ("cost", right),
        ("peak Nm", right),
    ]);
    for g in &results.groups {
        table.push([
            name(g, &[FLOOR]),
            if g.floor_m > 0.0 { number(1e3 * g.floor_m) } else { String::new() },
            g.runs.to_string(),
            share(g.completed, g.runs),
            if g.steps > 0 { g.steps.to_string() } else { String::new() },
            if g.steps > 0 { told_passage(g) } else { String::new() },
            optional(g.mean_speed_m_s),
            optional(g.cost_of_transport),
            number(g.peak_torque_nm),
        ]);
    }
    let note =
        "Completed: all steps made, or on its feet for the whole time where no steps were asked for. Cost: positive \
                work of hip and toes over weight and distance."
            .to_owned();
    Some(Chapter { heading: "How it went".into(), note, plots: Vec::new(), table: table.without_empty_columns() })
}

fn told_passage(g: &Group) -> String {
    match (g.mean_steps_to_fall, g.steps_to_fall_high) {
        (Some(mean), Some(high)) => format!("{mean:.0} ({:.0} to {high:.0})", g.steps_to_fall_low),
        _ => format!("no fall (≥ {:.0})", g.steps_to_fall_low),
    }
}

/// A share of successes with its interval.
fn share(successes: u32, of: u32) -> String {
    let part = percent(f64::from(successes) / f64::from(of.max(1)));
    format!("{part} % ({})", wilson(successes, of).map(percent).join(" to "))
}

/// Groups by the name of their curve, sorted along the abscissa.
fn curves<'a>(groups: &[&'a Group], but: &[&str], x: impl Fn(&Group) -> f64) -> Vec<(String, Vec<&'a Group>)> {
    let mut curves: BTreeMap<String, Vec<&Group>> = BTreeMap::new();
    for group in groups {
        curves.entry(name(group, but)).or_default().push(group);
    }
    for curve in curves.values_mut() {
        curve.sort_by(|a, b| x(a).total_cmp(&x(b)));
    }
    curves.into_iter().collect()
}

fn values(groups: &[&Group], x: impl Fn(&Group) -> f64) -> BTreeSet<u64> {
    groups.iter().map(|g| x(g).to_bits()).collect()
}

fn tone(k: usize) -> Tone {
    Tone::Series(u8::try_from(k % 6).unwrap_or(0))
}

/// Steps to a fall over the floor's roughness: in mm, and as a share of the leg.
fn passage(results: &Results, leg_length_m: f64) -> Option<Chapter> {
    let walked: Vec<&Group> = results.groups.iter().filter(|g| g.steps > 0).collect();
    if values(&walked, |g| g.floor_m).len() < 2 {
        return None;
    }
    let deviation = |g: &Group| 100.0 * g.floor_m / (libm::sqrt(3.0) * leg_length_m);
    let plots = vec![
        passage_plot(&walked, "uniform floor, ± mm", |g| 1e3 * g.floor_m),
        passage_plot(&walked, "σ = h/√3, % of the leg", deviation),
        success_plot(&walked),
    ];
    let note =
        "Steps to a fall (mean first-passage time) from all runs, those that ended without a fall counted as cut \
                short. Band: 95 %. Where nothing fell there is no estimate: an arrow stands at all the steps that were made, the \
                band begins at their third and has no upper end."
            .to_owned();
    Some(Chapter { heading: "Rough floor".into(), note, plots, table: Table::default() })
}

/// Estimates as lines. Where nothing fell the mean is not known: an arrow from all the steps made, joined to nothing.
fn passage_plot(groups: &[&Group], label: &str, x: impl Fn(&Group) -> f64 + Copy) -> Plot {
    let mut plot = Plot::new(Axis::linear(label), Axis::log("steps to a fall"));
    plot.height = 320.0;
    for (k, (name, curve)) in curves(groups, &[FLOOR], x).into_iter().enumerate() {
        let at: Vec<f64> = curve.iter().map(|g| x(g)).collect();
        let mean: Vec<f64> = curve.iter().map(|g| g.mean_steps_to_fall.unwrap_or(f64::NAN)).collect();
        let high = curve.iter().map(|g| g.steps_to_fall_high.unwrap_or(f64::INFINITY)).collect();
        let low = curve.iter().map(|g| g.steps_to_fall_low).collect();
        let unfallen = || curve.iter().filter(|g| g.mean_steps_to_fall.is_none());
        #[expect(clippy::cast_precision_loss, reason = "steps of some weeks")]
        let (least_at, least) = (unfallen().map(|g| x(g)).collect(), unfallen().map(|g| g.steps as f64).collect());
        plot.marks.push(Mark::Band { name: String::new(), tone: tone(k), x: at.clone(), low, high });
        plot = plot.line(&name, tone(k), &at, &mean);
        plot.marks.push(Mark::AtLeast { tone: tone(k), x: least_at, y: least });
    }
    plot
}

fn success_plot(groups: &[&Group]) -> Plot {
    let mut plot = Plot::new(Axis::linear("uniform floor, ± mm"), Axis::linear("completed, %").within(0.0, 100.0));
    let x = |g: &Group| 1e3 * g.floor_m;
    for (k, (name, curve)) in curves(groups, &[FLOOR], x).into_iter().enumerate() {
        let at: Vec<f64> = curve.iter().map(|g| x(g)).collect();
        let share: Vec<f64> = curve.iter().map(|g| 100.0 * f64::from(g.completed) / f64::from(g.runs.max(1))).collect();
        let end = |k: usize| curve.iter().map(|g| 100.0 * g.completed_interval[k]).collect();
        plot.marks.push(Mark::Band { name: String::new(), tone: tone(k), x: at.clone(), low: end(0), high: end(1) });
        plot = plot.line(&name, tone(k), &at, &share);
    }
    plot
}

/// Survival over the impulse.
fn pushes(results: &Results) -> Option<Chapter> {
    let pushed: Vec<&Group> = results.groups.iter().filter(|g| g.pushes > 0).collect();
    if pushed.is_empty() {
        return None;
    }
    let right = Align::Right;
    let mut table = Table::new(&[
        ("", Align::Left),
        ("impulse N s", right),
        ("Δv m/s", right),
        ("pushes", right),
        ("survived (95 %)", right),
    ]);
    for g in &pushed {
        let [impulse, delta_v] = [g.impulse_ns, g.delta_v_m_s].map(optional);
        table.push([name(g, &[IMPULSE]), impulse, delta_v, g.pushes.to_string(), share(g.pushes_survived, g.pushes)]);
    }
    let delta_v = |g: &Group| g.delta_v_m_s.unwrap_or(0.0);
    // Nothing is drawn over an impulse that the seed draws.
    let known: Vec<&Group> = pushed.iter().copied().filter(|g| g.delta_v_m_s.is_some()).collect();
    let plots = if values(&known, delta_v).len() < 2 { Vec::new() } else { vec![survival_plot(&known)] };
    let note =
        "A push is survived if no fall follows within three seconds of it or while it still stumbles. Δv: impulse \
                over mass, + forwards; the standing foot takes part of it."
            .to_owned();
    Some(Chapter { heading: "Pushes".into(), note, plots, table: table.without_empty_columns() })
}

fn survival_plot(groups: &[&Group]) -> Plot {
    let mut plot =
        Plot::new(Axis::linear("Δv of the centre of mass, m/s"), Axis::linear("pushes survived, %").within(0.0, 100.0));
    let x = |g: &Group| g.delta_v_m_s.unwrap_or(0.0);
    for (k, (name, curve)) in curves(groups, &[IMPULSE], x).into_iter().enumerate() {
        let at: Vec<f64> = curve.iter().map(|g| x(g)).collect();
        let share: Vec<f64> =
            curve.iter().map(|g| 100.0 * f64::from(g.pushes_survived) / f64::from(g.pushes)).collect();
        let end = |k: usize| curve.iter().map(|g| 100.0 * wilson(g.pushes_survived, g.pushes)[k]).collect();
        plot.marks.push(Mark::Band { name: String::new(), tone: tone(k), x: at.clone(), low: end(0), high: end(1) });
        plot = plot.line(&name, tone(k), &at, &share);
    }
    plot
}

/// Which causes, how often: the table that says what to mend next.
fn causes(results: &Results) -> Option<Chapter> {
    let kinds: BTreeSet<&String> =
        results.groups.iter().flat_map(|g| g.ends.keys()).filter(|end| *end != "completed").collect();
    if kinds.is_empty() {
        return None;
    }
    let words: Vec<String> = kinds.iter().map(|kind| kind.replace('_', " ")).collect();
    let heading: Vec<(&str, Align)> =
        std::iter::once(("", Align::Left)).chain(words.iter().map(|k| (k.as_str(), Align::Right))).collect();
    let mut table = Table::new(&heading);
    for g in results.groups.iter().filter(|g| g.completed < g.runs) {
        let count = |kind: &&String| g.ends.get(*kind).map(ToString::to_string).unwrap_or_default();
        table.push(std::iter::once(name(g, &[])).chain(kinds.iter().map(count)));
    }
    let rules = "Runs by how they ended; the rules are in src/sim/outcome/fall.rs.".to_owned();
    let note = std::iter::once(rules).chain(results.not_armed()).collect::<Vec<_>>().join(" ");
    Some(Chapter { heading: "What went wrong".into(), note, plots: Vec::new(), table })
}

/// What the robot believed, and which law it used: nothing falls back silently.
fn trust(results: &Results) -> Option<Chapter> {
    let right = Align::Right;
    let mut table = Table::new(&[
        ("", Align::Left),
        ("missed", right),
        ("invented", right),
        ("wrong leg, ticks", right),
        ("torque on it, ms", right),
        ("off, rad", right),
        ("off, rad/s", right),
        ("laws", Align::Left),
    ]);
    for g in &results.groups {
        let runs = || results.runs.iter().filter(|r| r.axes == g.axes);
        let most = |x: fn(&super::trial_run::RunRecord) -> f64| number(runs().map(x).fold(0.0, f64::max));
        table.push([
            name(g, &[]),
            runs().map(|r| r.missed_touchdowns).sum::<u32>().to_string(),
            runs().map(|r| r.invented_touchdowns).sum::<u32>().to_string(),
            runs().map(|r| r.wrong_leg_ticks).sum::<u64>().to_string(),
            most(|r| r.longest_wrong_torque_ms),
            most(|r| r.worst_angle_error_rad),
            most(|r| r.worst_rate_error_rad_s),
            laws(runs()),
        ]);
    }
    let note =
        "Touchdowns as the estimator saw them against the true ones (60 ms), its largest errors while the leg was \
                right, and the law that ran in each armed tick."
            .to_owned();
    Some(Chapter { heading: "What the robot believed".into(), note, plots: Vec::new(), table })
}

fn laws<'a>(runs: impl Iterator<Item = &'a super::trial_run::RunRecord>) -> String {
    let mut sum: BTreeMap<&str, f64> = BTreeMap::new();
    let mut total = 0.0;
    for run in runs {
        for (law, share) in &run.law_share {
            *sum.entry(law).or_default() += share * run.time_s;
            total += share * run.time_s;
        }
    }
    let told = sum.iter().map(|(law, time)| format!("{law} {:.1} %", 100.0 * time / total.max(f64::MIN_POSITIVE)));
    told.collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::super::results::tests::run;
    use super::*;
    use crate::experiment::trial_run::Ended;
    use crate::report::page;
    use crate::sim::outcome::fall::Cause;

    /// Two controllers on four floors, and pushes.
    fn results() -> Results {
        let mut runs = Vec::new();
        for (controller, scale) in [("walk", 1.0), ("foot_placement", 0.3)] {
            for (floor_m, steps) in [(0.0, 1000), (0.01, 1000), (0.015, 600), (0.02, 150)] {
                for k in 0..8_u32 {
                    let steps = (f64::from(steps) * scale) as u32 + 7 * k;
                    let end = if steps >= 1000 { Ended::Completed } else { Ended::Fell(Cause::Scuff) };
                    let mut run = run(runs.len(), controller, floor_m, steps.min(1000), end);
                    run.impulse_ns = Some(200.0 * floor_m);
                    run.delta_v_m_s = Some(10.0 * floor_m);
                    run.pushes = 5;
                    runs.push(run);
                }
            }
        }
        Results::new("Test of the page", "0123456789abcdef", runs.len() + 2, runs)
    }

    #[test]
    fn where_nothing_fell_stands_an_arrow_and_no_estimate() {
        let results = results();
        let walked: Vec<&Group> = results.groups.iter().filter(|g| g.controller == "walk").collect();
        let plot = passage_plot(&walked, "mm", |g| 1e3 * g.floor_m);
        let [Mark::Band { high, .. }, Mark::Line { y, .. }, Mark::AtLeast { x, y: least, .. }] = &plot.marks[..] else {
            panic!("{:?}", plot.marks)
        };
        assert_eq!((x.as_slice(), least.as_slice()), (&[0.0, 10.0][..], &[8000.0, 8000.0][..]));
        assert!(high[..2].iter().all(|h| h.is_infinite()) && high[2..].iter().all(|h| h.is_finite()));
        assert!(y[..2].iter().all(|y| y.is_nan()) && y[2..].iter().all(|y| y.is_finite()));
    }

    #[test]
    fn page_stands_alone_and_tells_what_is_missing() {
        let html = page::experiment(&page("test.toml", &results(), 1.0));
        let fetched = html.replace("http://www.w3.org/2000/svg", "");
        assert!(["http:", "https:", "<script", "src=", "@import"].iter().all(|outside| !fetched.contains(outside)));
        assert!(html.contains("2 planned runs are still to do") && html.contains("no fall") && html.contains("scuff"));
        assert_eq!(html.matches("<figure>").count(), 4);
        if let Ok(folder) = std::env::var("COMPASS_PAGE_OUT") {
            std::fs::write(std::path::Path::new(&folder).join("experiment.html"), html).unwrap();
        }
    }
}
