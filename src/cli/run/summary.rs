//! The end of a run in a few lines. RT: no.

use super::sinks::Closed;
use crate::base::time::Stamp;
use crate::config::checked::Limits;
use crate::msg::{Fault, TickRecord};
use crate::rt::process::Summary;
use crate::rt::stats::Percentiles;
use std::io::{self, Write};

/// Writes it.
pub(super) fn write(out: &mut impl Write, summary: &Summary, limits: &Limits, closed: &Closed) -> io::Result<()> {
    let last = &summary.observed.last;
    writeln!(out, "ticks       {}, {} periods skipped", last.status.ticks, last.status.overruns)?;
    if summary.observed.panicked {
        writeln!(out, "relay       ended by a panic: what stands here is what it saw until then")?;
    }
    if last.estimate.steps > 0 {
        writeln!(out, "steps       {}, as the estimator saw them", last.estimate.steps)?;
    }
    write_times(out, "wake-up", &summary.observed.stats.wake.percentiles())?;
    write_times(out, "step", &summary.observed.stats.step.percentiles())?;
    let began = summary.observed.began.unwrap_or_default();
    write_faults(out, last.status.faults, &summary.observed.faults, began)?;
    write_drops(out, summary, last)?;
    match (summary.allocations, summary.page_faults) {
        (Some(allocations), Some(faults)) => {
            writeln!(out, "after arming {allocations} allocations, {faults} page faults in the real-time threads")?;
        }
        _ => writeln!(out, "after arming nothing to count: the robot was never armed")?,
    }
    if let Some(blocker) = &summary.observed.held_back.by() {
        writeln!(out, "not armed   {}", limits.told_at_arming(blocker))?;
    }
    for text in summary.missing.in_words() {
        writeln!(out, "not granted {text}")?;
    }
    for notice in &closed.notices {
        writeln!(out, "note        {notice}")?;
    }
    if let Some((path, status)) = &closed.recorded {
        let before = match status.files {
            0 | 1 => String::new(),
            files => format!(" and {} before it", files - 1),
        };
        let (file, written, lost) = (path.display(), status.written, status.dropped);
        writeln!(out, "recorded    {file}{before}: {written} ticks, {lost} lost")?;
    }
    Ok(())
}

fn write_times(out: &mut impl Write, name: &str, p: &Percentiles) -> io::Result<()> {
    let us = [p.p50, p.p90, p.p99, p.p999, p.max].map(|span| span.as_us());
    let [p50, p90, p99, p999, max] = us;
    writeln!(out, "{name:<12}p50 {p50:.1}, p90 {p90:.1}, p99 {p99:.1}, p99.9 {p999:.1}, max {max:.1} us")
}

/// Those beyond the first ones are only counted; that the switch was let go or the program asked to stop is no fault.
fn write_faults(out: &mut impl Write, count: u32, first: &[Fault], began: Stamp) -> io::Result<()> {
    let ordinary = first.iter().filter(|fault| fault.code.is_ordinary_end());
    for Fault { code, stamp, .. } in ordinary.clone() {
        writeln!(out, "ended       {} at {:.3} s", code.name(), stamp.since(began).as_s())?;
    }
    let faults = count.saturating_sub(u32::try_from(ordinary.count()).unwrap_or(0));
    if faults == 0 {
        return writeln!(out, "faults      none");
    }
    writeln!(out, "faults      {faults}")?;
    for fault in first.iter().filter(|fault| !fault.code.is_ordinary_end()) {
        writeln!(out, "            {fault} at {:.3} s", fault.stamp.since(began).as_s())?;
    }
    Ok(())
}

fn write_drops(out: &mut impl Write, summary: &Summary, last: &TickRecord) -> io::Result<()> {
    let [bus0, bus1] = last.input.received.each_ref().map(|batch| batch.dropped);
    writeln!(
        out,
        "lost        frames {bus0} and {bus1}, IMU messages {}, frames refused {}, ticks to the relay {}",
        last.input.imu.dropped, summary.refused_frames, summary.observed.missed
    )
}
