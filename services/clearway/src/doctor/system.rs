//! The kernel, its clock, its memory, and the machine under it.

use super::examination::Examination;
use super::finding::Finding;

/// Clocks that are read without calling the kernel.
const FAST_CLOCKS: [&str; 5] =
    ["tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page", "riscv_clocksource"];
/// Share of time taken by the host from which on it is worth a word.
const STOLEN_MAX: f64 = 0.001;

pub(super) fn findings(e: &Examination) -> Vec<Finding> {
    let mut found = vec![preemption(e), clock_source(e)];
    found.extend(timers(e));
    found.extend([machine(e), huge_pages(e), swap(e), load(e)]);
    found
}

fn preemption(e: &Examination) -> Finding {
    const NAME: &str = "preemption";
    const REMEDY: &str = "install a kernel with PREEMPT_RT (Debian: linux-image-rt-amd64; in mainline since \
                          6.12), or boot with preempt=full";
    let Some(version) = e.host.read("/proc/version") else { return Finding::unknown(NAME, "/proc/version") };
    if e.host.read("/sys/kernel/realtime").as_deref() == Some("1") || version.contains("PREEMPT_RT") {
        return Finding::ok(NAME, "PREEMPT_RT");
    }
    // The chosen model of a dynamic kernel is in brackets, where it may be read.
    let chosen = e
        .host
        .read("/sys/kernel/debug/sched/preempt")
        .and_then(|text| Some(text.split_once('(')?.1.split_once(')')?.0.to_owned()));
    let value = match (chosen, version.contains("PREEMPT")) {
        (Some(model), _) => format!("dynamic, {model}"),
        (None, true) if version.contains("PREEMPT_DYNAMIC") => "dynamic, model not readable".to_owned(),
        (None, true) => "preemptible".to_owned(),
        (None, false) => "none".to_owned(),
    };
    Finding::warn(
        NAME,
        value,
        "Without PREEMPT_RT there is no bound on how long the kernel delays a release.",
        REMEDY,
    )
}

fn clock_source(e: &Examination) -> Finding {
    const NAME: &str = "clock_source";
    match e.host.clock_source() {
        None => Finding::unknown(NAME, "/sys/devices/system/clocksource"),
        Some(source) if FAST_CLOCKS.contains(&source.as_str()) => Finding::ok(NAME, source),
        Some(source) => Finding::warn(
            NAME,
            source,
            "Each reading of the clock calls the kernel and takes a microsecond or more, several times a \
             period.",
            "boot with clocksource=tsc tsc=reliable where the processor has a constant one (`dmesg | grep \
             -i tsc` says why it was refused)",
        ),
    }
}

fn timers(e: &Examination) -> Option<Finding> {
    const NAME: &str = "timers";
    let step_ns = e.live.as_ref()?.timer_step_ns;
    Some(if step_ns <= 1 {
        Finding::ok(NAME, "of high resolution")
    } else {
        Finding::fail(
            NAME,
            format!("a step of {} µs", step_ns / 1000),
            "Sleeps end at the next tick only, so no period shorter than that can be kept.",
            "boot without highres=off, with a kernel that has CONFIG_HIGH_RES_TIMERS",
        )
    })
}

fn machine(e: &Examination) -> Finding {
    const NAME: &str = "machine";
    let Some(hypervisor) = e.host.hypervisor() else { return Finding::ok(NAME, "not a virtual one") };
    let stolen = e.host.stolen_share().unwrap_or(0.0);
    let kind = if hypervisor == "unnamed" { "virtual".to_owned() } else { format!("virtual, {hypervisor}") };
    Finding::warn(
        NAME,
        if stolen > STOLEN_MAX {
            format!("{kind}; {:.1} % of its time was taken away", stolen * 100.0)
        } else {
            kind
        },
        "Its host may stop it for milliseconds at any time, and nothing in here can prevent that.",
        "run on hardware of your own, or have the host pin the virtual CPUs to cores that nobody else uses",
    )
}

fn huge_pages(e: &Examination) -> Finding {
    const NAME: &str = "thp";
    let Some(text) = e.host.read("/sys/kernel/mm/transparent_hugepage/enabled") else {
        return Finding::ok(NAME, "not in this kernel");
    };
    let chosen = text.split_once('[').and_then(|(_, rest)| rest.split_once(']')).map_or("", |(mode, _)| mode);
    if chosen == "always" {
        Finding::warn(
            NAME,
            chosen,
            "The kernel joins pages to large ones behind a program's back and stops it meanwhile.",
            "echo madvise > /sys/kernel/mm/transparent_hugepage/enabled (at boot: \
             transparent_hugepage=madvise)",
        )
    } else {
        Finding::ok(NAME, chosen)
    }
}

fn swap(e: &Examination) -> Finding {
    const NAME: &str = "swap";
    let Some(text) = e.host.read("/proc/swaps") else { return Finding::ok(NAME, "none") };
    match text.lines().count().saturating_sub(1) {
        0 => Finding::ok(NAME, "none"),
        n => Finding::warn(
            NAME,
            format!("{n} in use"),
            "Readers and drivers whose memory is not locked may have to wait for the disk.",
            "swapoff -a, and take the lines out of /etc/fstab",
        ),
    }
}

fn load(e: &Examination) -> Finding {
    const NAME: &str = "load";
    let text = e.host.read("/proc/loadavg");
    let average = text.and_then(|text| text.split_whitespace().next()?.parse::<f64>().ok());
    let Some(average) = average else { return Finding::unknown(NAME, "/proc/loadavg") };
    let cpus = e.host.cpu_directories().len().max(1);
    if average > cpus as f64 {
        Finding::warn(
            NAME,
            format!("{average:.1} on {cpus} CPUs"),
            "Caches and memory are shared with all that work, whatever the priorities.",
            "see `top` for who it is, and measure when the machine is as it will be in use",
        )
    } else {
        Finding::ok(NAME, format!("{average:.1} on {cpus} CPUs"))
    }
}
