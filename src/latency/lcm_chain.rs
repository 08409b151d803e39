//! The rival of the control path: the thesis' architecture (chapter 3), three processes joined by LCM over UDP
//! multicast, built at run time from `bench/latency/lcm_chain.c` against Debian's liblcm. RT: no.

use std::fs;
use std::io;
use std::os::unix::net::UnixDatagram;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use std::thread;
use std::time::Duration;

use super::driver::{self, Driven};

const SOURCE: &str = include_str!("../../bench/latency/lcm_chain.c");

/// Why there is no figure of the rival.
#[derive(Debug, thiserror::Error)]
pub enum ChainError {
    /// A file or socket failed.
    #[error("LCM chain: {0}")]
    Io(#[from] io::Error),
    /// The C compiler or the library is missing.
    #[error("cannot build the LCM chain (Debian packages gcc, liblcm-dev): {0}")]
    Build(String),
    /// It was built and started but nothing came out.
    #[error(
        "the LCM chain answers nothing; is multicast on lo? (ip link set lo multicast on; ip route add 224.0.0.0/4 dev lo)"
    )]
    Silent,
}

/// The three processes; they end when this is dropped.
#[derive(Debug)]
pub struct LcmChain {
    processes: Vec<Child>,
    into: PathBuf,
    out: UnixDatagram,
}

impl LcmChain {
    /// Builds and starts the chain in a folder of its own.
    ///
    /// # Errors
    /// If it cannot be built or started, or answers nothing within a second.
    pub fn start(folder: &Path, priority: u8, core: usize) -> Result<Self, ChainError> {
        let program = build(folder)?;
        let (into, back) = (folder.join("sensor.sock"), folder.join("command.sock"));
        let out = UnixDatagram::bind(&back)?;
        let start = |role: &str, socket: &Path| {
            Command::new(&program)
                .args([role, &socket.to_string_lossy(), &priority.to_string(), &core.to_string()])
                .stdin(Stdio::null())
                .spawn()
        };
        let mut chain = Self { processes: Vec::new(), into, out };
        chain.processes.push(start("dispatch", &back)?);
        chain.processes.push(start("controller", Path::new("-"))?);
        chain.processes.push(start("sensor", &chain.into.clone())?);
        thread::sleep(Duration::from_millis(500));
        let warm = chain.window(200, Duration::from_millis(1))?;
        if warm.window.is_empty() { Err(ChainError::Silent) } else { Ok(chain) }
    }

    /// One window of frames through the chain.
    ///
    /// # Errors
    /// If a socket fails.
    pub fn window(&self, count: usize, period: Duration) -> Result<Driven, ChainError> {
        Ok(driver::run(&self.into, &self.out, count, period)?)
    }
}

impl Drop for LcmChain {
    fn drop(&mut self) {
        for process in &mut self.processes {
            // It may have ended by itself; either way it is gone afterwards.
            drop(process.kill());
            drop(process.wait());
        }
    }
}

fn build(folder: &Path) -> Result<PathBuf, ChainError> {
    let (source, program) = (folder.join("lcm_chain.c"), folder.join("lcm_chain"));
    fs::write(&source, SOURCE)?;
    let output = Command::new("cc").arg("-O2").arg("-o").arg(&program).arg(&source).arg("-llcm").output()?;
    if output.status.success() {
        Ok(program)
    } else {
        Err(ChainError::Build(String::from_utf8_lossy(&output.stderr).into_owned()))
    }
}
