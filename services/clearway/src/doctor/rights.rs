//! What the kernel lets this process do.

use super::examination::Examination;
use super::finding::Finding;
use crate::host::Limit;

/// Room for the daemon's files and sockets, and its readers'.
const OPEN_FILES_MIN: u64 = 1024;

pub(super) fn findings(e: &Examination) -> Vec<Finding> {
    let mut found = vec![scheduling(e), memory_lock(e), open_files(e), throttling(e)];
    found.extend(group_budget(e));
    found.extend(quota(e));
    found.push(others(e));
    found
}

fn scheduling(e: &Examination) -> Finding {
    const NAME: &str = "scheduling";
    let priority = e.priority;
    let Some(limit) = e.host.limit("Max realtime priority") else {
        return Finding::unknown(NAME, "/proc/self/limits");
    };
    let within = limit == Limit::Unlimited || matches!(limit, Limit::AtMost(p) if p >= u64::from(priority));
    let granted = match &e.live {
        Some(live) => live.fifo.clone(),
        None if e.host.may_be_real_time() || within => Ok(()),
        None => Err(format!("the limit is {}", shown(limit))),
    };
    match granted {
        Ok(()) => Finding::ok(NAME, format!("SCHED_FIFO priority {priority} is granted")),
        Err(reason) => Finding::fail(
            NAME,
            format!("SCHED_FIFO priority {priority} is refused: {reason}"),
            "Without a real-time priority any other program can delay the loop by milliseconds.",
            format!(
                "systemd: LimitRTPRIO={priority} in the unit; login: `@realtime - rtprio {priority}` in \
                 /etc/security/limits.conf; container: --cap-add SYS_NICE or --ulimit rtprio={priority}"
            ),
        ),
    }
}

fn memory_lock(e: &Examination) -> Finding {
    const NAME: &str = "memlock";
    let Some(limit) = e.host.limit("Max locked memory") else {
        return Finding::unknown(NAME, "/proc/self/limits");
    };
    if e.host.may_lock_memory() {
        return Finding::ok(NAME, "any amount of memory may be locked (CAP_IPC_LOCK)");
    }
    match limit {
        Limit::Unlimited => Finding::ok(NAME, "any amount of memory may be locked"),
        Limit::AtMost(bytes) => Finding::fail(
            NAME,
            format!("at most {} KiB may be locked", bytes / 1024),
            "Memory that is not locked may have to come from the disk in the middle of a period.",
            "systemd: LimitMEMLOCK=infinity in the unit; login: `@realtime - memlock unlimited` in \
             /etc/security/limits.conf; container: --cap-add IPC_LOCK or --ulimit memlock=-1",
        ),
    }
}

fn open_files(e: &Examination) -> Finding {
    const NAME: &str = "open_files";
    match e.host.limit("Max open files") {
        None => Finding::unknown(NAME, "/proc/self/limits"),
        Some(Limit::AtMost(n)) if n < OPEN_FILES_MIN => Finding::warn(
            NAME,
            format!("at most {n}"),
            "Every reader of a channel costs a few; attaching fails when there are none left.",
            format!("`ulimit -n {OPEN_FILES_MIN}`, or LimitNOFILE={OPEN_FILES_MIN} in the unit"),
        ),
        Some(limit) => Finding::ok(NAME, format!("at most {}", shown(limit))),
    }
}

fn throttling(e: &Examination) -> Finding {
    const NAME: &str = "rt_throttling";
    const RUNTIME: &str = "/proc/sys/kernel/sched_rt_runtime_us";
    let number = |path: &str| e.host.read(path).and_then(|text| text.parse::<i64>().ok());
    let Some(runtime_us) = number(RUNTIME) else { return Finding::unknown(NAME, RUNTIME) };
    let period_us = number("/proc/sys/kernel/sched_rt_period_us").unwrap_or(1_000_000);
    match runtime_us {
        ..=-1 => Finding::ok(NAME, "off"),
        0 => Finding::fail(
            NAME,
            "real-time threads get no time at all (sched_rt_runtime_us = 0)",
            "The daemon's threads would never run.",
            "sysctl -w kernel.sched_rt_runtime_us=950000",
        ),
        _ if runtime_us >= period_us => Finding::ok(NAME, "off: the budget is the whole period"),
        _ => Finding::warn(
            NAME,
            format!("{} ms of every {} ms", runtime_us / 1000, period_us / 1000),
            "Real-time threads that have used that much, because they poll or overrun, stand still for \
             the rest. A loop that sleeps between its releases is not touched.",
            "sysctl -w kernel.sched_rt_runtime_us=-1 (it also takes away the way back into a machine that \
             a real-time thread has seized)",
        ),
    }
}

/// Kernels with `CONFIG_RT_GROUP_SCHED` give real-time threads of a group nothing unless told to.
fn group_budget(e: &Examination) -> Option<Finding> {
    const NAME: &str = "rt_group";
    let group = e.host.control_group("cpu")?;
    let file = format!("/sys/fs/cgroup/cpu{group}/cpu.rt_runtime_us").replace("//", "/");
    let runtime_us: i64 = e.host.read(&file)?.parse().ok()?;
    Some(if runtime_us == 0 {
        Finding::fail(
            NAME,
            "this control group has no time for real-time threads",
            "The kernel refuses SCHED_FIFO in a group whose cpu.rt_runtime_us is 0.",
            format!("echo 950000 > {file} (and in the groups above it), or run outside of the group"),
        )
    } else {
        Finding::ok(NAME, format!("{runtime_us} µs for the group's real-time threads"))
    })
}

/// A share of the processors that this process's group may not exceed.
fn quota(e: &Examination) -> Option<Finding> {
    const NAME: &str = "cpu_quota";
    let limited = unified_quota(e).or_else(|| {
        let group = e.host.control_group("cpu")?;
        let file = |name: &str| format!("/sys/fs/cgroup/cpu{group}/{name}").replace("//", "/");
        let read = |name: &str| e.host.read(&file(name))?.parse::<f64>().ok();
        Some((read("cpu.cfs_quota_us")?, read("cpu.cfs_period_us")?))
    });
    let (quota_us, period_us) = limited?;
    Some(if quota_us <= 0.0 {
        Finding::ok(NAME, "none")
    } else {
        Finding::warn(
            NAME,
            format!("{:.2} CPUs", quota_us / period_us.max(1.0)),
            "Ordinary threads of the group, housekeeping and readers among them, stand still when it is \
             used up.",
            "container: leave --cpus away and use --cpuset-cpus; systemd: CPUQuota= empty; Kubernetes: \
             whole CPUs with the static CPU manager",
        )
    })
}

/// The smallest quota of this process's groups under version 2; -1 for none.
fn unified_quota(e: &Examination) -> Option<(f64, f64)> {
    let mut group = e.host.control_group("")?;
    let mut smallest = None::<(f64, f64)>;
    loop {
        let file = format!("/sys/fs/cgroup{group}/cpu.max").replace("//", "/");
        if let Some(text) = e.host.read(&file) {
            let mut words = text.split_whitespace();
            let quota = words.next().and_then(|word| word.parse::<f64>().ok()).unwrap_or(-1.0);
            let period = words.next().and_then(|word| word.parse::<f64>().ok()).unwrap_or(100_000.0);
            let share = |(q, p): (f64, f64)| if q < 0.0 { f64::INFINITY } else { q / p };
            if smallest.is_none_or(|so_far| share((quota, period)) < share(so_far)) {
                smallest = Some((quota, period));
            }
        }
        match group.rfind('/') {
            Some(0) if group.len() > 1 => group.truncate(1),
            Some(at) if at > 0 => group.truncate(at),
            _ => return smallest,
        }
    }
}

fn others(e: &Examination) -> Finding {
    const NAME: &str = "other_real_time";
    let found = e.host.real_time_threads(u32::from(e.priority));
    match found.first() {
        None => {
            Finding::ok(NAME, format!("no thread of another program at priority {} or above", e.priority))
        }
        Some(first) => Finding::warn(
            NAME,
            format!(
                "{} threads, for instance {} ({}, priority {})",
                found.len(),
                first.name,
                first.tid,
                first.priority
            ),
            "They run before the loop, or keep it waiting when they share its CPU.",
            format!(
                "raise realtime.priority above {}, or move them with `taskset -p -c`",
                found.iter().map(|thread| thread.priority).max().unwrap_or(first.priority)
            ),
        ),
    }
}

fn shown(limit: Limit) -> String {
    match limit {
        Limit::Unlimited => "unlimited".to_owned(),
        Limit::AtMost(n) => n.to_string(),
    }
}
