//! A configuration, held against the host.

use clearway::config::{Config, RealTimePolicy};
use clearway::realtime::Placement;

use super::examination::Examination;
use super::finding::Finding;

/// Periods below this are not for a machine whose host may take its time away, ns.
const VIRTUAL_PERIOD_MIN_NS: u64 = 1_000_000;

pub(super) fn findings(e: &Examination) -> Vec<Finding> {
    let Some(config) = &e.config else { return Vec::new() };
    let mut found = vec![policy(config)];
    if config.realtime.policy != RealTimePolicy::Off {
        found.extend([cpus(e, config), priority(config), workers(e, config), period(e, config)]);
    }
    found
}

fn policy(config: &Config) -> Finding {
    const NAME: &str = "config_policy";
    let policy = config.realtime.policy;
    match policy {
        RealTimePolicy::Require => Finding::ok(NAME, "require"),
        RealTimePolicy::Prefer => {
            Finding::ok(NAME, "prefer: runs on, shown as DEGRADED, when something is refused")
        }
        RealTimePolicy::Off => Finding::warn(
            NAME,
            "off",
            "The daemon asks for no priority, CPU or locked memory.",
            "realtime.policy = \"require\" for robots that move",
        ),
    }
}

fn cpus(e: &Examination, config: &Config) -> Finding {
    const NAME: &str = "config_cpus";
    let Some(allowed) = e.host.allowed_cpus() else { return Finding::unknown(NAME, "/proc/self/status") };
    let named = config.realtime.loop_cpu.iter().chain(&config.realtime.worker_cpus);
    let absent: Vec<String> = named.filter(|cpu| !allowed.contains(cpu)).map(ToString::to_string).collect();
    if absent.is_empty() {
        Finding::ok(NAME, "every CPU it names may be used")
    } else {
        let shown: Vec<String> = allowed.iter().map(ToString::to_string).collect();
        Finding::fail(
            NAME,
            format!("CPU {} is not one that this process may use", absent.join(", ")),
            "The thread cannot be pinned there; under policy = \"require\" the daemon does not start.",
            format!("choose realtime.loop_cpu and realtime.worker_cpus from {}", shown.join(", ")),
        )
    }
}

fn priority(config: &Config) -> Finding {
    const NAME: &str = "config_priority";
    match config.realtime.priority {
        99 => Finding::warn(
            NAME,
            "99",
            "The kernel's own threads (migration, watchdog) run at 99 and must be able to interrupt.",
            "realtime.priority = 80",
        ),
        // Threads of interrupts under PREEMPT_RT.
        p @ ..=50 => Finding::warn(
            NAME,
            p.to_string(),
            "Under PREEMPT_RT the threads of interrupts run at 50 and come before the loop.",
            "realtime.priority = 80",
        ),
        p => Finding::ok(NAME, p.to_string()),
    }
}

fn workers(e: &Examination, config: &Config) -> Finding {
    const NAME: &str = "config_workers";
    let allowed = e.host.allowed_cpus().unwrap_or_default();
    let robots = config.scenario.robots.len();
    let placement = Placement::new(&config.realtime, config.timing.workers, robots, &allowed);
    let mut used: Vec<usize> = placement.worker_cpus.iter().flatten().copied().collect();
    let count = used.len();
    used.sort_unstable();
    used.dedup();
    if count > used.len() {
        Finding::warn(
            NAME,
            format!("{count} workers on {} CPUs", used.len()),
            "Workers that share a CPU take turns, and a period takes as long as both together.",
            format!("timing.workers = {}, or more CPUs in realtime.worker_cpus", used.len()),
        )
    } else if allowed.len() > 1 && placement.loop_cpu.is_some_and(|cpu| used == [cpu]) {
        Finding::warn(
            NAME,
            "the only worker shares the loop's CPU",
            "It waits while the loop publishes, and the other CPUs idle.",
            "realtime.worker_cpus = another CPU",
        )
    } else {
        Finding::ok(NAME, format!("{count}, each on a CPU of its own"))
    }
}

fn period(e: &Examination, config: &Config) -> Finding {
    const NAME: &str = "config_period";
    let period_ns = config.timing.period_ns;
    let value = format!("{} µs", period_ns / 1000);
    if period_ns < VIRTUAL_PERIOD_MIN_NS && e.host.hypervisor().is_some() {
        Finding::warn(
            NAME,
            value,
            "A virtual machine is stopped by its host for longer than that now and then.",
            format!(
                "clearway bench latency --period-us {}, and look at p99.9 before trusting it",
                period_ns / 1000
            ),
        )
    } else {
        Finding::ok(NAME, value)
    }
}
