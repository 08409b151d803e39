//! `--fault list`, `--fault table`: the catalogue of faults, and what the robot does about each. `--soak`. RT: no.

use super::{Outcome, progress};
use crate::base::time::Span;
use crate::config::checked::Config;
use crate::config::fault::CATALOGUE;
use crate::msg::DRIVES;
use crate::sim::trouble::{soak, table};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use std::io::{self, Write};

/// Prints the catalogue, or the table of reactions, if that is what was asked for.
pub(super) fn is_listed(faults: &[String]) -> anyhow::Result<bool> {
    let asked = |word: &str| faults.iter().any(|fault| fault == word);
    if asked("list") {
        print(&mut io::stdout().lock())?;
    }
    if asked("table") {
        write!(io::stdout().lock(), "{}", table::markdown()?)?;
    }
    Ok(asked("list") || asked("table"))
}

/// Runs so often with random faults, seeds from 1 on, and tells whether the invariants held.
pub(super) fn soak(config: &Config, runs: u64, length: Span) -> anyhow::Result<Outcome> {
    let bar = progress::bar(runs, "runs");
    let results: Vec<(u64, soak::Soaked)> = (1..=runs)
        .into_par_iter()
        .map(|seed| {
            let soaked = soak::run(config, seed, length)?;
            bar.inc(1);
            Ok((seed, soaked))
        })
        .collect::<anyhow::Result<_>>()?;
    bar.finish_and_clear();
    let mut out = io::stdout().lock();
    let sum = |of: fn(&soak::Soaked) -> u64| results.iter().map(|(_, run)| of(run)).sum::<u64>();
    writeln!(out, "runs       {runs} of {} s, {} ticks", length.as_s(), sum(|r| r.ticks))?;
    writeln!(out, "injected   {} faults", sum(|r| r.faults.len() as u64))?;
    writeln!(out, "armed      {} times, {} ticks", sum(|r| u64::from(r.armings)), sum(|r| r.armed_ticks))?;
    writeln!(out, "latched    {} faults", sum(|r| u64::from(r.latched)))?;
    let oldest = |drives: std::ops::Range<usize>| {
        let of = |run: &soak::Soaked| run.waited[drives.clone()].iter().map(|waited| waited.longest).max();
        results.iter().filter_map(|(_, run)| of(run)).max().unwrap_or_default().as_s() * 1e3
    };
    writeln!(
        out,
        "oldest     command taken from the wire by an enabled drive: hip {:.2} ms, toe {:.2} ms",
        oldest(0..1),
        oldest(1..DRIVES)
    )?;
    let breaches: Vec<_> = results.iter().filter_map(|(seed, run)| Some((seed, run, run.breach.as_ref()?))).collect();
    writeln!(out, "breaches   {}", breaches.len())?;
    for (seed, run, (at, breach)) in breaches.iter().take(10) {
        let faults: Vec<String> = run.faults.iter().map(crate::config::fault::Injection::text).collect();
        writeln!(out, "  seed {seed} at {:.3} s: {breach}; {}", at.as_s(), faults.join(" "))?;
    }
    Ok(if breaches.is_empty() { Outcome::Fine } else { Outcome::Finding })
}

/// Name, places, arguments with their defaults, what happens.
fn print(out: &mut impl Write) -> io::Result<()> {
    for entry in CATALOGUE {
        let places: Vec<&str> = entry.places.iter().map(|place| place.name()).collect();
        let arguments = if entry.defaults.is_empty() { "-" } else { entry.defaults };
        write!(out, "{:22} {:11} {:46} {}", entry.name, places.join(","), arguments, entry.what)?;
        if entry.kinds.len() > 1 {
            write!(out, " (kind: {})", entry.kinds.join(", "))?;
        }
        writeln!(out)?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_fault_has_a_line_with_its_places() {
        let mut text = Vec::new();
        print(&mut text).unwrap();
        let text = String::from_utf8(text).unwrap();
        assert_eq!(text.lines().count(), 64);
        for (line, entry) in text.lines().zip(CATALOGUE) {
            let mut words = line.split_whitespace();
            assert_eq!(words.next(), Some(entry.name));
            let places = words.next().unwrap();
            assert!(places.split(',').all(|place| ["sim", "plant", "guest"].contains(&place)), "{line}");
        }
    }
}
