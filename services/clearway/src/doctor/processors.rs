//! Who else uses the processors, and how fast they wake.

use super::examination::Examination;
use super::finding::Finding;
use crate::host::cpu_list;

const CPUS: &str = "/sys/devices/system/cpu";
/// Waking from an idle state that takes longer than this shows in the release lateness, µs.
const WAKE_UP_MAX_US: u64 = 20;

pub(super) fn findings(e: &Examination) -> Vec<Finding> {
    let mut found = vec![usable(e), isolated(e), tickless(e), governor(e), idle_states(e)];
    found.extend(siblings(e));
    found
}

/// The CPU that the loop is to have, and the others of this process, for remedies.
fn loop_cpu(e: &Examination) -> usize {
    let configured = e.config.as_ref().and_then(|config| config.realtime.loop_cpu);
    configured.or_else(|| e.host.allowed_cpus()?.last().copied()).unwrap_or(1)
}

fn usable(e: &Examination) -> Finding {
    const NAME: &str = "cpus";
    match e.host.allowed_cpus() {
        None => Finding::unknown(NAME, "/proc/self/status"),
        Some(cpus) if cpus.len() < 2 => Finding::warn(
            NAME,
            format!("this process may use {} CPU", cpus.len()),
            "The loop, its workers and everything else take turns on it.",
            "give it two at least: cpuset of the container, AllowedCPUs= or CPUAffinity= in the unit",
        ),
        Some(cpus) => Finding::ok(NAME, format!("this process may use {}", cpus.len())),
    }
}

fn isolated(e: &Examination) -> Finding {
    const NAME: &str = "isolated_cpus";
    let Some(list) = e.host.read(&format!("{CPUS}/isolated")) else {
        return Finding::unknown(NAME, "/sys/devices/system/cpu/isolated");
    };
    let cpus = cpu_list(&list);
    let of_loop = e.config.as_ref().and_then(|config| config.realtime.loop_cpu);
    if !cpus.is_empty() && of_loop.is_none_or(|cpu| cpus.contains(&cpu)) {
        return Finding::ok(NAME, list);
    }
    let cpu = loop_cpu(e);
    Finding::warn(
        NAME,
        if cpus.is_empty() { "none".to_owned() } else { format!("{list}; the loop's CPU {cpu} is not one") },
        "Interrupts and other programs run on the loop's CPU and delay its releases.",
        format!("boot with isolcpus=managed_irq,domain,{cpu} and set realtime.loop_cpu = {cpu}"),
    )
}

fn tickless(e: &Examination) -> Finding {
    const NAME: &str = "nohz_full";
    let list = e.host.read(&format!("{CPUS}/nohz_full")).unwrap_or_default();
    if cpu_list(&list).is_empty() {
        let cpu = loop_cpu(e);
        Finding::warn(
            NAME,
            "none",
            "The scheduler's tick interrupts a thread that computes or polls, a few microseconds each \
             time.",
            format!("boot with nohz_full={cpu} rcu_nocbs={cpu} (a kernel with CONFIG_NO_HZ_FULL)"),
        )
    } else {
        Finding::ok(NAME, list)
    }
}

fn governor(e: &Examination) -> Finding {
    const NAME: &str = "governor";
    let governors = e.host.governors();
    if governors.is_empty() {
        return Finding::ok(NAME, "the frequency is not this system's to choose");
    }
    if governors == ["performance"] {
        return Finding::ok(NAME, "performance");
    }
    Finding::warn(
        NAME,
        governors.join(", "),
        "The clock drops while the loop sleeps, and the first microseconds of each period are slow.",
        "cpupower frequency-set -g performance (at boot: the cpupower service or tuned's \
         latency-performance)",
    )
}

fn idle_states(e: &Examination) -> Finding {
    const NAME: &str = "idle_states";
    let mut deepest = None::<(u64, String)>;
    for cpu in e.host.cpu_directories() {
        for state in e.host.names(&format!("{cpu}/cpuidle")) {
            let read = |file: &str| e.host.read(&format!("{cpu}/cpuidle/{state}/{file}"));
            let off = read("disable").is_some_and(|text| text != "0");
            let Some(latency_us) = read("latency").and_then(|text| text.parse::<u64>().ok()) else {
                continue;
            };
            if !off && deepest.as_ref().is_none_or(|(us, _)| latency_us > *us) {
                deepest = Some((latency_us, read("name").unwrap_or(state)));
            }
        }
    }
    match deepest {
        None => Finding::ok(NAME, "none that this system chooses"),
        Some((us, name)) if us > WAKE_UP_MAX_US && keeps_awake(e) => {
            Finding::ok(NAME, format!("{name} takes {us} µs to leave; a daemon keeps the CPUs out of it"))
        }
        Some((us, name)) if us > WAKE_UP_MAX_US => Finding::warn(
            NAME,
            format!("{name} takes {us} µs to leave"),
            "A CPU that sleeps deeply between releases wakes that much later.",
            format!(
                "write access to /dev/cpu_dma_latency for the daemon (udev: KERNEL==\"cpu_dma_latency\", \
                 GROUP=\"realtime\", MODE=\"0660\"), cpupower idle-set -D {WAKE_UP_MAX_US}, or tuned's \
                 latency-performance profile"
            ),
        ),
        Some((us, name)) => Finding::ok(NAME, format!("the deepest, {name}, takes {us} µs to leave")),
    }
}

/// Whether the daemon will hold `/dev/cpu_dma_latency`.
fn keeps_awake(e: &Examination) -> bool {
    let asks = e.config.as_ref().is_none_or(|config| config.realtime.stay_awake);
    asks && e.live.as_ref().is_some_and(|live| live.may_stay_awake)
}

fn siblings(e: &Examination) -> Option<Finding> {
    const NAME: &str = "smt";
    let active = e.host.read(&format!("{CPUS}/smt/active"))?;
    Some(if active == "1" {
        Finding::warn(
            NAME,
            "on: two CPUs share a core",
            "Work on the sibling of the loop's CPU slows it down by up to a half.",
            "echo off > /sys/devices/system/cpu/smt/control, or keep the sibling free",
        )
    } else {
        Finding::ok(NAME, "off: every CPU has a core of its own")
    })
}
