//! How well a located interval covers the true one: intersection over union of times. RT: no.

use super::answer::Place;
use super::truth::Interval;

/// Sorted, disjoint pieces of a union of spans.
fn merged(mut spans: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    spans.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut pieces: Vec<(f64, f64)> = Vec::new();
    for (from, to) in spans {
        match pieces.last_mut() {
            Some(last) if from <= last.1 => last.1 = last.1.max(to),
            _ => pieces.push((from, to)),
        }
    }
    pieces
}

fn length(pieces: &[(f64, f64)]) -> f64 {
    pieces.iter().map(|(from, to)| to - from).sum()
}

fn overlap(a: &[(f64, f64)], b: &[(f64, f64)]) -> f64 {
    a.iter().flat_map(|x| b.iter().map(move |y| (x.1.min(y.1) - x.0.max(y.0)).max(0.0))).sum()
}

/// Intersection and union of two sets of spans, s.
fn shared_and_joint(truth: Vec<(f64, f64)>, found: Vec<(f64, f64)>) -> (f64, f64) {
    let (truth, found) = (merged(truth), merged(found));
    let shared = overlap(&truth, &found);
    (shared, length(&truth) + length(&found) - shared)
}

fn iou_over(truth: &[Interval], places: &[&Place]) -> f64 {
    let mut recordings: Vec<&str> = truth.iter().map(|i| i.recording.as_str()).collect();
    recordings.extend(places.iter().map(|p| p.recording.as_str()));
    recordings.sort_unstable();
    recordings.dedup();
    let (mut shared, mut joint) = (0.0, 0.0);
    for recording in recordings {
        let true_spans = truth.iter().filter(|i| i.recording == recording).map(|i| (i.from_s, i.to_s)).collect();
        let found = places.iter().filter(|p| p.recording == recording).map(|p| (p.from_s, p.to_s)).collect();
        let (s, j) = shared_and_joint(true_spans, found);
        shared += s;
        joint += j;
    }
    if joint > 0.0 { shared / joint } else { 0.0 }
}

/// Time of the true intervals that `where` found, over the time of both together.
///
/// The truth counts in the recordings that `where` speaks of (a place is named once, not repeated for every recording),
/// and the best of the channels counts: a lost count lives in one sensor, what else is missing may live in another.
pub fn time_iou(truth: &[Interval], places: &[Place]) -> f64 {
    let told: Vec<Interval> =
        truth.iter().filter(|i| places.iter().any(|p| p.recording == i.recording)).cloned().collect();
    if told.is_empty() {
        return 0.0;
    }
    let one_channel =
        |channel: &str| iou_over(&told, &places.iter().filter(|p| p.channel == channel).collect::<Vec<_>>());
    let everywhere = iou_over(&told, &places.iter().collect::<Vec<_>>());
    places.iter().map(|p| one_channel(&p.channel)).fold(everywhere, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn place(recording: &str, channel: &str, from_s: f64, to_s: f64) -> Place {
        Place { recording: recording.into(), channel: channel.into(), from_s, to_s, share: 1.0 }
    }

    fn truth(from_s: f64, to_s: f64) -> Interval {
        Interval { recording: "a".into(), from_s, to_s }
    }

    #[test]
    fn half_covered_interval_scores_one_half() {
        assert!((time_iou(&[truth(0.0, 2.0)], &[place("a", "q", 0.0, 1.0)]) - 0.5).abs() < 1e-12);
    }

    #[test]
    fn an_interval_told_of_two_channels_counts_once() {
        let places = [place("a", "q", 0.0, 2.0), place("a", "r", 0.0, 2.0)];
        assert!((time_iou(&[truth(0.0, 2.0)], &places) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn claiming_everything_is_punished() {
        assert!((time_iou(&[truth(1.0, 1.5)], &[place("a", "q", 0.0, 5.0)]) - 0.1).abs() < 1e-12);
        assert!(time_iou(&[truth(1.0, 1.5)], &[place("b", "q", 1.0, 1.5)]).abs() < 1e-12);
    }
}
