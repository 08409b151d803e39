use super::*;
use crate::report::findings::{
    Diagnosis, Estimate, Figure, Law, Member, Missing, ParameterLine, Place, Ranked, Rejected, Trace,
};

/// A pendulum that stops dead, as made by hand.
fn findings() -> Findings {
    let t_s: Vec<f64> = (0..8000).map(|i| f64::from(i) * 1e-3).collect();
    let swing = |decay: f64, lost: f64| -> Vec<f64> {
        t_s.iter().map(|t| (1.2 * libm::exp(-decay * t) - lost * t).max(0.0) * libm::cos(7.0 * t)).collect()
    };
    let trace = Trace {
        recording: "steps.csv".into(),
        use_: "heldout".into(),
        channel: "q1_rad".into(),
        unit: "rad",
        measured: swing(0.02, 0.16),
        given: swing(0.05, 0.0),
        refitted: swing(0.25, 0.0),
        explained: swing(0.021, 0.159),
        t_s,
    };
    let figure = Figure {
        recording: "steps.csv".into(),
        use_: "heldout".into(),
        channel: "q1_rad".into(),
        nrmse_given: 0.52,
        nrmse_refitted: 0.358,
        nrmse_explained: 0.064,
    };
    let rate: Vec<f64> = (0..81).map(|i| f64::from(i) * 0.1 - 4.0).collect();
    let law = |offset: f64| rate.iter().map(|r| 0.0012 * r + (0.0062 + offset).copysign(*r)).collect::<Vec<f64>>();
    let place = |from_s, to_s, share| Place {
        recording: "steps.csv".into(),
        channel: "q1_rad".into(),
        from_s,
        to_s,
        share,
        phase: None,
        region: Some("abs(q1_rate) < 0.3".into()),
        band_hz: None,
    };
    let member = Member {
        effect: "coulomb_friction".into(),
        at: "q1".into(),
        weight: 0.98,
        parameters: [("coulomb".to_owned(), Estimate::normal(0.00616, 0.00004))].into(),
    };
    let ranked = |effect: &str, explained, gain, chosen| Ranked {
        effect: effect.into(),
        at: "q1".into(),
        explained,
        gain,
        chosen,
    };
    let line = |name: &str, given, refitted, value, std| ParameterLine {
        name: name.into(),
        given,
        refitted,
        explained: Estimate::normal(value, std),
        at_bound: false,
    };
    Findings {
        rig: "inner leg on its pivot".into(),
        headline: "The joint has Coulomb friction of 0.0062 Nm that the simulation lacks: the swing loses the same \
                   amplitude every period and stops dead."
            .into(),
        traces: vec![trace],
        laws: vec![Law {
            title: "Friction at q1 over rate".into(),
            x_label: "rate of q1, rad/s".into(),
            y_label: "friction, Nm".into(),
            y: law(0.0),
            low: law(-0.0004),
            high: law(0.0004),
            x: rate,
        }],
        ranking: vec![
            ranked("coulomb_friction", 0.97, 15_230.0, true),
            ranked("load_friction", 0.81, 11_020.0, false),
            ranked("quadratic_drag", 0.08, 310.0, false),
        ],
        parameters: vec![
            line("inertia_kg_m2", 0.00432, 0.00447, 0.00431, 0.00001),
            line("coulomb_friction@q1.coulomb", f64::NAN, f64::NAN, 0.00616, 0.00004),
        ],
        undetermined: vec!["gain and inertia together: hang a known weight on the leg".into()],
        warnings: vec!["free_swing.csv: 3 empty cells in q1_rad, left out".into()],
        diagnosis: Diagnosis {
            schema: 1,
            verdict: Verdict::Explained,
            places: vec![place(4.4, 5.8, 0.41), place(6.2, 8.0, 0.3)],
            missing: vec![Missing { one_of: vec![member], sentence: String::new() }],
            seen: Vec::new(),
            rejected: vec![Rejected {
                effect: "load_friction".into(),
                at: "q1".into(),
                why: "coefficient falls to zero once Coulomb friction is there (gain 0.3)".into(),
            }],
            next_experiment: None,
            fit: vec![figure],
            seconds: 4.2,
            seed: 0,
        },
    }
}

#[test]
fn page_stands_alone() {
    let html = html(&findings());
    // The name space of SVG is the one address allowed.
    let fetched = html.replace("http://www.w3.org/2000/svg", "");
    for outside in ["http:", "https:", "<script", "src=", "@import"] {
        assert!(!fetched.contains(outside), "{outside}");
    }
    keep("report.html", &html);
}

#[test]
fn sentence_comes_before_any_figure() {
    let html = html(&findings());
    let sentence = html.find("stops dead").unwrap();
    assert!(sentence < html.find("<svg").unwrap());
}

#[test]
fn text_of_a_rig_cannot_break_the_page() {
    let mut findings = findings();
    findings.rig = "</title><b>x".into();
    findings.warnings = vec!["<i>".into()];
    let html = html(&findings);
    assert!(!html.contains("<b>x") && !html.contains("<i>"));
}

#[test]
fn nothing_missing_makes_a_page_too() {
    let mut findings = findings();
    findings.diagnosis.verdict = Verdict::Consistent;
    findings.diagnosis.missing.clear();
    findings.diagnosis.places.clear();
    findings.ranking.clear();
    findings.laws.clear();
    assert!(html(&findings).contains("to within their noise"));
}

/// For looking at: `COMPASS_PAGE_OUT=folder cargo test page`.
fn keep(name: &str, html: &str) {
    if let Ok(folder) = std::env::var("COMPASS_PAGE_OUT") {
        std::fs::write(std::path::Path::new(&folder).join(name), html).unwrap();
    }
}

/// A minute at 1 kHz with noise, a second channel, and two explanations.
fn undecided() -> Findings {
    let mut findings = findings();
    let noise = |i: usize| libm::sin(12.9898 * i as f64) * 43_758.547 % 1.0 * 0.03;
    let t_s: Vec<f64> = (0..60_000).map(|i| i as f64 * 1e-3).collect();
    let signal = |late: f64| -> Vec<f64> {
        t_s.iter().map(|t| libm::sin(0.4 * (t - late)) + 0.3 * libm::sin(0.13 * (t - late) * (t - late))).collect()
    };
    let measured: Vec<f64> = signal(0.06).iter().enumerate().map(|(i, v)| v + noise(i)).collect();
    let trace = |channel: &str| Trace {
        recording: "chirp.csv".into(),
        use_: "heldout".into(),
        channel: channel.into(),
        unit: "rad",
        t_s: t_s.clone(),
        measured: measured.clone(),
        given: signal(0.0),
        refitted: signal(0.01),
        explained: signal(0.06),
    };
    findings.traces = vec![trace("hip_rad"), trace("imu_inner_rad")];
    let figure = |channel: &str| Figure {
        recording: "chirp.csv".into(),
        use_: "heldout".into(),
        channel: channel.into(),
        nrmse_given: 0.31,
        nrmse_refitted: 0.24,
        nrmse_explained: 0.021,
    };
    let diagnosis = &mut findings.diagnosis;
    diagnosis.fit = vec![figure("hip_rad"), figure("imu_inner_rad")];
    diagnosis.verdict = Verdict::Ambiguous;
    diagnosis.places[0].recording = "chirp.csv".into();
    diagnosis.places[0].channel = "hip_rad".into();
    (diagnosis.places[0].from_s, diagnosis.places[0].to_s) = (41.0, 47.5);
    diagnosis.places[0].band_hz = Some([1.2, 3.4]);
    diagnosis.places.truncate(1);
    let mut twin = diagnosis.missing[0].one_of[0].clone();
    twin.effect = "sensor_delay".into();
    twin.weight = 0.48;
    diagnosis.missing[0].one_of.push(twin);
    diagnosis.missing[0].sentence =
        "The command or the reading of the hip comes 59 ms late; one sensor cannot say which.".into();
    diagnosis.next_experiment = Some(
        "Release the leg from rest with the drive off: a late command cannot matter there, a late sensor does.".into(),
    );
    findings.headline = "Something in the hip's loop is 59 ms late.".into();
    findings.laws.push(findings.laws[0].clone());
    findings
}

#[test]
fn a_set_tells_what_would_decide() {
    let html = html(&undecided());
    keep("undecided.html", &html);
    assert!(
        html.contains("What would decide") && html.contains("drive off") && html.len() < 1_000_000,
        "{}",
        html.len()
    );
}
