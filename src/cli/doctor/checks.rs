//! What is looked at, by reading /proc and /sys and by trying. RT: no.

use super::{Finding, Verdict};
use crate::bus::socketcan::link_report;
use crate::cli::imu_probe;
use crate::config::checked::{BusBackend, BusConfig, Config, Imu, Operator, Robot, SerialBackend, Thread};
use crate::record::storage;
use crate::rt::thread::{self, Awake, Missing};
use crate::sensor::operator::evdev::InputDevice;
use crate::sensor::operator::remote::read_secret;
use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

/// Lowest RLIMIT_MEMLOCK that holds the process, bytes, when it is not unlimited.
const MEMLOCK_ENOUGH: u64 = 256 << 20;
/// A longer queue keeps old commands for too long.
const LONGEST_CAN_QUEUE: u32 = 32;
/// Steal beyond this share of the time since boot is worth a warning.
const STEAL_SHARE: f64 = 0.01;

/// Bytes that a recording of the default configuration grows by in an hour: 2.0 MB/s, measured with `compass sim`.
const RECORDED_PER_HOUR: u64 = 7_300_000_000;
/// With fewer cores than this, giving the control thread one of its own leaves too little for the rest.
const CORES_TO_PIN: usize = 3;

/// Every check, in the order of importance.
pub(super) fn all(config: &Config, record: &Path) -> Vec<Finding> {
    let mut findings = vec![kernel(), fifo(config), cores(config), memlock(), throttling(), cpu_dma_latency()];
    findings.extend([governor(), isolation(config), clocksource(), swap(), huge_pages(), shared_memory(), steal()]);
    findings.extend([irq_affinity(config), disk(record)]);
    for (index, bus) in config.robot.buses.iter().enumerate() {
        if let BusBackend::SocketCan(name) = &bus.backend {
            findings.extend(can_link(index, name, bus));
        }
    }
    if let SerialBackend::Device(path) = &config.robot.imu.backend {
        findings.push(serial(path));
        findings.push(imu_answer(path, &config.robot.imu));
    }
    findings.extend(operator(&config.robot));
    findings
}

/// At which rate the IMU answers, if nobody else has its line.
fn imu_answer(path: &str, imu: &Imu) -> Finding {
    let what = format!("IMU: {path}");
    let Some(answers) = imu_probe::find(path, imu) else {
        let remedy = "power, cable, or another process has the line (a running robot); no rate and no protocol of ours";
        return Finding::new(Verdict::Warn, &what, "does not answer", remedy);
    };
    match imu_probe::complaint(imu, answers) {
        None => Finding::new(Verdict::Good, &what, format!("answers at {} bit/s", answers.0), ""),
        Some(found) => Finding::new(Verdict::Bad, &what, found, "write what it answers into robot.toml"),
    }
}

/// The dead-man's device or secret.
fn operator(robot: &Robot) -> Option<Finding> {
    let (what, result, remedy) = match &robot.operator {
        Operator::Simulated | Operator::Socket(_) => return None,
        Operator::Device(device) => (
            format!("dead-man: {}", device.path),
            InputDevice::with_key(Path::new(&device.path), device.key).and_then(|device| {
                let stick = robot.operator_speed.and_then(|speed| speed.stick);
                stick.map_or(Ok(()), |stick| device.require_stick(&stick))
            }),
            "plug it in; name it by /dev/input/by-id; SupplementaryGroups=input and DeviceAllow=char-input r",
        ),
        Operator::Remote(remote) => (
            format!("dead-man: {}", remote.listen),
            read_secret(Path::new(&remote.secret_file)).map(drop),
            "head -c 32 /dev/urandom | base64 > robot.operator.secret_file, chmod 640, the service's group",
        ),
    };
    Some(match result {
        Ok(()) => Finding::new(Verdict::Good, &what, "there", ""),
        Err(error) => Finding::new(Verdict::Bad, &what, error.to_string(), remedy),
    })
}

fn read(path: &str) -> Option<String> {
    Some(fs::read_to_string(path).ok()?.trim().to_owned())
}

fn good_if(good: bool, otherwise: Verdict) -> Verdict {
    if good { Verdict::Good } else { otherwise }
}

fn kernel() -> Finding {
    let version = read("/proc/sys/kernel/version").unwrap_or_else(|| "unknown".into());
    let real_time = version.contains("PREEMPT_RT") || read("/sys/kernel/realtime").as_deref() == Some("1");
    Finding::new(good_if(real_time, Verdict::Bad), "kernel", version, "install linux-image-rt-amd64 and boot it")
}

fn fifo(config: &Config) -> Finding {
    let wanted = threads(config).iter().map(|t| t.priority).max().unwrap_or(0);
    let asked = Thread { priority: wanted, core: None, stack_bytes: 64 * 1024 };
    // On a thread of its own, so that this one stays ordinary.
    let missing = std::thread::spawn(move || thread::enter(&asked)).join().unwrap_or(Missing::FIFO);
    let granted = missing == Missing::default();
    let found = if granted { format!("SCHED_FIFO {wanted} granted") } else { format!("SCHED_FIFO {wanted} refused") };
    Finding::new(good_if(granted, Verdict::Bad), "priority", found, "LimitRTPRIO=95 in the unit, or CAP_SYS_NICE")
}

fn threads(config: &Config) -> [Thread; 4] {
    let timing = &config.real_time;
    [timing.control, timing.bus[0], timing.bus[1], timing.imu]
}

fn cores(config: &Config) -> Finding {
    let there = core_affinity::get_core_ids().unwrap_or_default();
    let outside = threads(config).iter().filter_map(|t| t.core).find(|core| !there.iter().any(|c| c.id == *core));
    let (verdict, found) = match outside {
        Some(core) => (Verdict::Bad, format!("core {core} is not among the {} allowed ones", there.len())),
        None if there.len() < 2 => (Verdict::Warn, "one core for everything".into()),
        None => (Verdict::Good, format!("{} cores allowed", there.len())),
    };
    Finding::new(verdict, "cores", found, "change rt.threads.*.core, or CPUAffinity= of the unit")
}

fn memlock() -> Finding {
    let limits = read("/proc/self/limits").unwrap_or_default();
    let line = limits.lines().find(|line| line.starts_with("Max locked memory")).unwrap_or("");
    let soft = line.split_whitespace().nth(3).unwrap_or("0");
    let enough = soft == "unlimited" || soft.parse().is_ok_and(|bytes: u64| bytes >= MEMLOCK_ENOUGH) || may_lock();
    let found = format!("RLIMIT_MEMLOCK {soft}{}", if may_lock() { ", CAP_IPC_LOCK" } else { "" });
    Finding::new(good_if(enough, Verdict::Bad), "locked memory", found, "LimitMEMLOCK=infinity, or CAP_IPC_LOCK")
}

/// CAP_IPC_LOCK is bit 14 of the effective set.
fn may_lock() -> bool {
    let status = read("/proc/self/status").unwrap_or_default();
    let set = status.lines().find_map(|line| line.strip_prefix("CapEff:")).unwrap_or("0");
    u64::from_str_radix(set.trim(), 16).is_ok_and(|bits| bits & (1 << 14) != 0)
}

fn throttling() -> Finding {
    let runtime = read("/proc/sys/kernel/sched_rt_runtime_us").unwrap_or_else(|| "unknown".into());
    let remedy = "sysctl kernel.sched_rt_runtime_us=-1, only with a hardware watchdog: at 950000 a thread that spins \
                  loses 50 ms of each second";
    Finding::new(good_if(runtime == "-1", Verdict::Warn), "FIFO throttling", format!("{runtime} us per s"), remedy)
}

fn cpu_dma_latency() -> Finding {
    let granted = Awake::hold().is_some();
    let found = if granted { "may be held at 0" } else { "not writable" };
    let remedy = "DeviceAllow=/dev/cpu_dma_latency rw and a udev rule for the group";
    Finding::new(good_if(granted, Verdict::Warn), "cpu_dma_latency", found, remedy)
}

/// Of every core: each has its own.
fn governor() -> Finding {
    let cores = fs::read_dir("/sys/devices/system/cpu").into_iter().flatten().flatten();
    let governors = cores.filter_map(|core| {
        let name = core.file_name().into_string().ok()?;
        let path = core.path().join("cpufreq/scaling_governor");
        Some((name.strip_prefix("cpu")?.parse().ok()?, read(path.to_str()?)?))
    });
    governor_verdict(&governors.collect())
}

/// Core → governor.
fn governor_verdict(governors: &BTreeMap<usize, String>) -> Finding {
    let slow = governors.iter().find(|(_, governor)| *governor != "performance");
    let (verdict, found) = match slow {
        None if governors.is_empty() => (Verdict::Good, "none (the firmware or the host decides)".into()),
        None => (Verdict::Good, "performance".into()),
        Some((core, governor)) => (Verdict::Warn, format!("{governor} on core {core}")),
    };
    Finding::new(verdict, "governor", found, "cpupower frequency-set -g performance")
}

fn isolation(config: &Config) -> Finding {
    isolation_verdict(&read("/proc/cmdline").unwrap_or_default(), config.real_time.control.core)
}

/// Which of the three keys of a kernel's command line keep others off the control thread's core.
fn isolation_verdict(line: &str, core: Option<usize>) -> Finding {
    let holds = |key: &&str| {
        let mut lists = line.split_whitespace().filter_map(|word| word.strip_prefix(*key)?.strip_prefix('='));
        // A core that is not set cannot be looked for.
        lists.next_back().is_some_and(|list| core.is_none_or(|core| is_in_list(list, core)))
    };
    let (there, missing): (Vec<&str>, Vec<&str>) =
        ["isolcpus", "nohz_full", "rcu_nocbs"].iter().partition(|k| holds(k));
    let n = core.map_or_else(|| "N".to_owned(), |core| core.to_string());
    let found = match core {
        Some(_) if missing.is_empty() => format!("core {n}, as the control thread wants"),
        Some(_) => format!("the control thread's core {n} is not in {}", missing.join(", ")),
        None => format!("{} of isolcpus, nohz_full, rcu_nocbs", there.len()),
    };
    let remedy = format!(
        "isolcpus=managed_irq,domain,{n} nohz_full={n} rcu_nocbs={n} on the kernel's command line, for the core of the \
         control thread"
    );
    Finding::new(good_if(missing.is_empty(), Verdict::Warn), "isolated cores", found, &remedy)
}

/// Whether a list of cores of the kernel holds one: `1`, `2-5`, `all`, separated by commas; flags such as `domain` are passed over.
fn is_in_list(list: &str, core: usize) -> bool {
    list.split(',').any(|part| {
        let range = part.split_once('-').unwrap_or((part, part));
        let ends = (range.0.parse::<usize>(), range.1.parse::<usize>());
        part == "all" || matches!(ends, (Ok(first), Ok(last)) if (first..=last).contains(&core))
    })
}

fn clocksource() -> Finding {
    let path = "/sys/devices/system/clocksource/clocksource0/current_clocksource";
    let source = read(path).unwrap_or_else(|| "unknown".into());
    let fast = source == "tsc" || source == "arch_sys_counter" || source == "kvm-clock";
    Finding::new(
        good_if(fast, Verdict::Warn),
        "clock source",
        source,
        "tsc=reliable, or look for why the kernel left it",
    )
}

fn swap() -> Finding {
    let lines = read("/proc/swaps").map_or(0, |text| text.lines().count().saturating_sub(1));
    let found = if lines == 0 { "off".to_owned() } else { format!("{lines} in use") };
    Finding::new(
        good_if(lines == 0, Verdict::Warn),
        "swap",
        found,
        "swapoff -a: locked memory stays, but the rest stalls",
    )
}

fn huge_pages() -> Finding {
    let modes = read("/sys/kernel/mm/transparent_hugepage/enabled").unwrap_or_else(|| "[never]".into());
    let remedy = "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled: merging pages stalls";
    Finding::new(good_if(!modes.contains("[always]"), Verdict::Warn), "huge pages", modes, remedy)
}

fn shared_memory() -> Finding {
    let folder = Path::new("/dev/shm");
    // Mode bits do not tell a mount that is read-only.
    let (there, found) = match storage::is_read_only(folder) {
        Ok(false) if folder.is_dir() => (true, "/dev/shm is there"),
        Ok(true) => (false, "/dev/shm is mounted read-only"),
        _ => (false, "/dev/shm is missing"),
    };
    let remedy = "mount -t tmpfs tmpfs /dev/shm, or mount -o remount,rw /dev/shm";
    Finding::new(good_if(there, Verdict::Bad), "shared memory", found, remedy)
}

fn steal() -> Finding {
    let text = read("/proc/stat").unwrap_or_default();
    let share = steal_share(text.lines().next().unwrap_or(""));
    let remedy = "a virtual machine whose host takes time away: use a real one, or give it cores of its own";
    Finding::new(good_if(share <= STEAL_SHARE, Verdict::Warn), "stolen time", format!("{:.2} %", share * 100.0), remedy)
}

/// Share of stolen time in the line `cpu user nice system idle iowait irq softirq steal ...`.
fn steal_share(line: &str) -> f64 {
    let times: Vec<f64> = line.split_whitespace().skip(1).filter_map(|word| word.parse().ok()).collect();
    let total: f64 = times.iter().take(8).sum();
    times.get(7).map_or(0.0, |steal| if total > 0.0 { steal / total } else { 0.0 })
}

fn irq_affinity(config: &Config) -> Finding {
    let Some(core) = config.real_time.control.core else {
        return unpinned(core_affinity::get_core_ids().map_or(1, |cores| cores.len()));
    };
    let default = read("/proc/irq/default_smp_affinity").unwrap_or_default();
    irq_verdict(core, &default, &irqs_there())
}

/// Interrupts that exist, and the cores that they go to.
fn irqs_there() -> BTreeMap<u32, String> {
    let folders = fs::read_dir("/proc/irq").into_iter().flatten().flatten();
    let irqs = folders.filter_map(|folder| {
        let path = folder.path().join("effective_affinity_list");
        Some((folder.file_name().to_str()?.parse().ok()?, read(path.to_str()?)?))
    });
    irqs.collect()
}

/// By the mask of new interrupts, and by the lists of cores of those that are there (number → list).
fn irq_verdict(core: usize, default: &str, irqs: &BTreeMap<u32, String>) -> Finding {
    let mask = default.replace(',', "");
    let default_away = u128::from_str_radix(&mask, 16).is_ok_and(|mask| mask & (1 << core.min(127)) == 0);
    let on_core: Vec<String> =
        irqs.iter().filter(|(_, list)| is_in_list(list, core)).map(|(irq, _)| irq.to_string()).collect();
    let found = if on_core.is_empty() {
        format!("default mask {default}, control on core {core}")
    } else {
        format!("control on core {core}, where interrupts {} go too", on_core.join(", "))
    };
    let remedy = "irqaffinity= without that core on the command line; for one that is there: its cores into \
                  /proc/irq/NUMBER/smp_affinity_list, and no irqbalance on that core";
    Finding::new(good_if(default_away && on_core.is_empty(), Verdict::Warn), "interrupts", found, remedy)
}

/// No core for the control thread: right where there is none to spare.
fn unpinned(cores: usize) -> Finding {
    let last = cores.saturating_sub(1);
    let remedy = format!(
        "set rt.threads.control.core = {last} in rt.toml, and keep interrupts and others off it: \
         isolcpus=managed_irq,domain,{last} irqaffinity=0 on the kernel's command line"
    );
    let found = format!("control on any of {cores} cores{}", if cores < CORES_TO_PIN { ", none to spare" } else { "" });
    Finding::new(good_if(cores < CORES_TO_PIN, Verdict::Warn), "interrupts", found, &remedy)
}

/// Room for recordings in a folder, or where it would be made.
fn disk(folder: &Path) -> Finding {
    let there = folder.ancestors().find(|path| path.is_dir()).unwrap_or(Path::new("."));
    let what = "disk for recordings";
    match storage::free_bytes(there) {
        Ok(free) => disk_verdict(what, free, folder),
        Err(error) => {
            let found = format!("{}: {error}", folder.display());
            Finding::new(Verdict::Bad, what, found, "make the folder, or name another by --record DIR")
        }
    }
}

#[expect(clippy::cast_precision_loss, reason = "told with one digit")]
fn disk_verdict(what: &str, free: u64, folder: &Path) -> Finding {
    let hours = free as f64 / RECORDED_PER_HOUR as f64;
    let verdict = match free {
        _ if free < RECORDED_PER_HOUR / 10 => Verdict::Bad,
        _ if free < RECORDED_PER_HOUR => Verdict::Warn,
        _ => Verdict::Good,
    };
    let found = format!("{:.1} GB free at {}, {hours:.1} h of recording", free as f64 * 1e-9, folder.display());
    Finding::new(verdict, what, found, "delete old recordings, or record to another disk: --record DIR")
}

fn can_link(index: usize, name: &str, bus: &BusConfig) -> Vec<Finding> {
    let what = format!("bus {index}: {name}");
    let BusConfig { bitrate, data_bitrate, .. } = *bus;
    let fd = data_bitrate.map_or_else(String::new, |data| format!(" dbitrate {data} fd on"));
    let set_up = format!("ip link set {name} up type can bitrate {bitrate}{fd} restart-ms 100 berr-reporting on");
    let Ok(link) = link_report::inspect(name) else {
        return vec![Finding::new(Verdict::Bad, &what, "no such interface", &set_up)];
    };
    let up = if link.is_up { "up" } else { "down" };
    let rate = link.bitrate.map_or_else(|| "no bit rate (virtual)".to_owned(), |rate| format!("{rate} bit/s"));
    let right_rate = link.bitrate.is_none_or(|rate| rate == bitrate);
    let restarts = link.restart_ms.is_none_or(|ms| ms > 0);
    let after = link.restart_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms} ms"));
    let queue = link.tx_queue_len.unwrap_or(0);
    let may = link_report::may_change_links();
    let changes = if may { "may be taken down and up" } else { "may not be taken down and up" };
    let shorten = format!("ip link set {name} txqueuelen 10: a long queue keeps old commands");
    let capability = "CAP_NET_ADMIN (AmbientCapabilities= of the unit)";
    let carries_fd = link.mtu.is_none_or(|mtu| mtu >= link_report::FD_MTU);
    let frames = if carries_fd { "carries CAN-FD" } else { "carries classic frames only" };
    let mut findings = vec![
        Finding::new(good_if(link.is_up && right_rate, Verdict::Bad), &what, format!("{up}, {rate}"), &set_up),
        Finding::new(good_if(restarts, Verdict::Bad), &what, format!("restart after bus-off {after}"), &set_up),
        Finding::new(good_if(queue <= LONGEST_CAN_QUEUE, Verdict::Warn), &what, format!("queue {queue}"), &shorten),
        Finding::new(good_if(may, Verdict::Bad), &what, changes, capability),
    ];
    if data_bitrate.is_some() {
        findings.push(Finding::new(good_if(carries_fd, Verdict::Bad), &what, frames, &set_up));
    }
    findings
}

fn serial(path: &str) -> Finding {
    let what = format!("IMU: {path}");
    if !Path::new(path).exists() {
        return Finding::new(Verdict::Bad, &what, "no such device", "plug it in; a udev rule gives it a lasting name");
    }
    let device = fs::canonicalize(path).ok().and_then(|p| Some(p.file_name()?.to_string_lossy().into_owned()));
    let timer = device.and_then(|name| read(&format!("/sys/bus/usb-serial/devices/{name}/latency_timer")));
    match timer.and_then(|text| text.parse::<u32>().ok()) {
        None => Finding::new(Verdict::Good, &what, "no latency timer", ""),
        Some(ms) => {
            let remedy = "echo 1 > /sys/bus/usb-serial/devices/NAME/latency_timer, or setserial NAME low_latency";
            Finding::new(good_if(ms <= 1, Verdict::Bad), &what, format!("latency timer {ms} ms"), remedy)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config;

    #[test]
    fn stolen_time_is_the_eighth_number() {
        assert!((steal_share("cpu  10 0 10 70 0 0 0 10 0 0") - 0.1).abs() < 1e-12);
        assert!(steal_share("").abs() < 1e-12);
    }

    #[test]
    fn disk_with_room_for_an_hour_is_good_for_six_minutes_bad() {
        let verdict = |free| disk_verdict("disk", free, Path::new(".")).verdict;
        assert_eq!(
            [700_000_000, 3_000_000_000, 8_000_000_000].map(verdict),
            [Verdict::Bad, Verdict::Warn, Verdict::Good]
        );
        assert!(storage::free_bytes(Path::new(".")).is_ok_and(|free| free > 0));
        assert!(storage::free_bytes(Path::new("no/such/folder")).is_err());
        assert!(storage::is_read_only(Path::new("no/such/folder")).is_err());
    }

    #[test]
    fn isolated_is_a_core_that_all_three_keys_name() {
        let verdict = |line, core| isolation_verdict(line, core).verdict;
        let line = "quiet isolcpus=managed_irq,domain,2-3 nohz_full=2,3 rcu_nocbs=all";
        assert_eq!(
            [Some(3), Some(1), None].map(|core| verdict(line, core)),
            [Verdict::Good, Verdict::Warn, Verdict::Good]
        );
        assert!(isolation_verdict(line, Some(1)).found.contains("core 1 is not in isolcpus, nohz_full"));
        assert_eq!(verdict("isolcpus=3 nohz_full=3", Some(3)), Verdict::Warn);
        assert_eq!(verdict("isolcpus=domain,12 nohz_full=12 rcu_nocbs=12", Some(1)), Verdict::Warn, "12 is not 1");
    }

    #[test]
    fn one_core_that_saves_power_is_enough_to_warn() {
        let governors = |last: &str| BTreeMap::from([(0, "performance".to_owned()), (3, last.to_owned())]);
        assert_eq!(governor_verdict(&governors("performance")).verdict, Verdict::Good);
        let found = governor_verdict(&governors("powersave"));
        assert_eq!((found.verdict, found.found.as_str()), (Verdict::Warn, "powersave on core 3"));
    }

    #[test]
    fn an_interrupt_on_the_control_threads_core_is_told_though_the_default_mask_is_right() {
        let irqs = |cores: &str| BTreeMap::from([(24, "0".to_owned()), (31, cores.to_owned())]);
        assert_eq!(irq_verdict(3, "00000000,00000007", &irqs("0-2")).verdict, Verdict::Good);
        let found = irq_verdict(3, "7", &irqs("0,3"));
        assert_eq!(found.verdict, Verdict::Warn);
        assert!(found.found.ends_with("interrupts 31 go too"), "{}", found.found);
        assert_eq!(irq_verdict(3, "f", &irqs("0-2")).verdict, Verdict::Warn, "new ones would go there");
    }

    #[test]
    fn a_control_thread_without_a_core_is_right_where_none_is_to_spare() {
        assert_eq!(unpinned(2).verdict, Verdict::Good);
        assert!(unpinned(4).remedy.contains("core = 3"));
    }

    #[test]
    fn whatever_is_not_good_has_a_remedy() {
        let mut config = config::load(None, &[]).unwrap().config;
        config.robot.buses[0].backend = BusBackend::SocketCan("nosuchcan".into());
        config.robot.imu.backend = SerialBackend::Device("/dev/nosuchtty".into());
        let findings = all(&config, Path::new("no/such/folder"));
        assert!(findings.iter().all(|f| (f.verdict == Verdict::Good) == f.remedy.is_empty()), "{findings:#?}");
        assert_eq!(findings.iter().filter(|f| f.found.starts_with("no such")).count(), 2);
    }
}
