//! Wake-up latency by cyclictest of Debian's rt-tests: what everybody measures a real-time kernel with. RT: no.

use std::process::Command;

use super::window::Window;

/// Why there is no figure of the rival.
#[derive(Debug, thiserror::Error)]
pub enum CyclictestError {
    /// Not installed, or it could not start.
    #[error("cannot run cyclictest (Debian package rt-tests): {0}")]
    Run(#[from] std::io::Error),
    /// It ran and failed.
    #[error("cyclictest failed: {0}")]
    Failed(String),
}

/// One window: `loops` periods of `period_us` at a FIFO priority on a core.
///
/// # Errors
/// If the program is missing or fails, for example because FIFO is not allowed.
pub fn window(priority: u8, core: usize, period_us: u32, loops: u32) -> Result<Window, CyclictestError> {
    let output = Command::new("cyclictest")
        .args(["--mlockall", "--nsecs", "--verbose", "--quiet", "--threads=1"])
        .arg(format!("--priority={priority}"))
        .arg(format!("--affinity={core}"))
        .arg(format!("--interval={period_us}"))
        .arg(format!("--loops={loops}"))
        .output()?;
    if !output.status.success() {
        return Err(CyclictestError::Failed(String::from_utf8_lossy(&output.stderr).into_owned()));
    }
    Ok(parse(&String::from_utf8_lossy(&output.stdout)))
}

/// Lines of `--verbose --nsecs`: "thread: cycle: latency in ns".
fn parse(text: &str) -> Window {
    let sample = |line: &str| {
        let mut parts = line.split(':').map(str::trim);
        let (thread, cycle, latency) = (parts.next()?, parts.next()?, parts.next()?);
        let _: (u32, u64) = (thread.parse().ok()?, cycle.parse().ok()?);
        latency.parse::<f64>().ok().map(|ns| ns * 1e-3)
    };
    Window::new(text.lines().filter_map(sample).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn verbose_lines_are_read_and_all_else_is_passed_over() {
        let w = parse("Max CPUs = 2\n       0:       0:   12500\n       0:       1:    2500\nT: 0 ( 1) P:80\n");
        assert_eq!(w.samples_us(), [2.5, 12.5]);
    }
}
