use super::{Host, cpu_list, is_number};

/// A resource limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Limit {
    /// None.
    Unlimited,
    /// At most this, in the limit's own unit.
    AtMost(u64),
}

/// A real-time thread of some process.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct RealTimeThread {
    /// Name of the thread.
    pub(crate) name: String,
    /// Its id.
    pub(crate) tid: u32,
    /// Its priority.
    pub(crate) priority: u32,
}

/// A bit of the capability sets, as in `linux/capability.h`.
const CAP_IPC_LOCK: u32 = 14;
const CAP_SYS_NICE: u32 = 23;

impl Host {
    /// A soft limit of this process, by its name in `/proc/self/limits`.
    pub(crate) fn limit(&self, name: &str) -> Option<Limit> {
        let limits = self.read("/proc/self/limits")?;
        let line = limits.lines().find_map(|line| line.strip_prefix(name))?;
        match line.split_whitespace().next()? {
            "unlimited" => Some(Limit::Unlimited),
            number => number.parse().ok().map(Limit::AtMost),
        }
    }

    fn status(&self, key: &str) -> Option<String> {
        let status = self.read("/proc/self/status")?;
        let line = status.lines().find_map(|line| line.strip_prefix(key)?.strip_prefix(':'))?;
        Some(line.trim().to_owned())
    }

    fn has_capability(&self, bit: u32) -> bool {
        let mask = self.status("CapEff").and_then(|text| u64::from_str_radix(&text, 16).ok());
        mask.is_some_and(|mask| mask & (1 << bit) != 0)
    }

    /// Whether this process may use any real-time priority.
    pub(crate) fn may_be_real_time(&self) -> bool {
        self.has_capability(CAP_SYS_NICE)
    }

    /// Whether this process may lock any amount of memory.
    pub(crate) fn may_lock_memory(&self) -> bool {
        self.has_capability(CAP_IPC_LOCK)
    }

    /// CPUs that this process may use.
    pub(crate) fn allowed_cpus(&self) -> Option<Vec<usize>> {
        self.status("Cpus_allowed_list").map(|list| cpu_list(&list))
    }

    /// This process's control group below a hierarchy, as `/proc/self/cgroup` names it: `""` for the
    /// unified one.
    pub(crate) fn control_group(&self, controller: &str) -> Option<String> {
        let groups = self.read("/proc/self/cgroup")?;
        groups.lines().find_map(|line| {
            let mut parts = line.splitn(3, ':').skip(1);
            let (controllers, path) = (parts.next()?, parts.next()?);
            controllers.split(',').any(|name| name == controller).then(|| path.to_owned())
        })
    }

    /// Threads of other programs with a real-time priority of `least` or more. The kernel's own are
    /// left out.
    pub(crate) fn real_time_threads(&self, least: u32) -> Vec<RealTimeThread> {
        let mut found = Vec::new();
        for process in self.names("/proc").iter().filter(|name| is_number(name)) {
            let tasks = format!("/proc/{process}/task");
            for thread in self.names(&tasks).iter().filter(|name| is_number(name)) {
                let stat = self.read(&format!("{tasks}/{thread}/stat"));
                let entry = stat.and_then(|stat| real_time_thread(&stat));
                found.extend(entry.filter(|entry| entry.priority >= least));
            }
        }
        found
    }
}

/// `PF_KTHREAD` of `linux/sched.h`: a thread of the kernel.
const KERNEL_THREAD: u64 = 0x0020_0000;

/// Reads one line of `/proc/PID/stat`; fields as numbered in proc(5).
fn real_time_thread(stat: &str) -> Option<RealTimeThread> {
    // The name is in brackets and may contain some itself.
    let (head, tail) = (stat.split_once('(')?, stat.rsplit_once(')')?);
    let name = &head.1[..head.1.rfind(')')?];
    let fields: Vec<&str> = tail.1.split_whitespace().collect();
    // Field 3 is the first behind the name.
    let field = |number: usize| fields.get(number - 3).and_then(|text| text.parse::<u64>().ok());
    let (flags, priority, policy) = (field(9)?, field(40)?, field(41)?);
    let real_time = policy == 1 || policy == 2;
    (real_time && flags & KERNEL_THREAD == 0).then(|| RealTimeThread {
        name: name.to_owned(),
        tid: head.0.trim().parse().unwrap_or(0),
        priority: u32::try_from(priority).unwrap_or(0),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stat(name: &str, flags: u64, priority: u32, policy: u32) -> String {
        let zeros = |n: usize| "0 ".repeat(n);
        // state, ppid … tpgid (fields 3–8), flags (9), then up to 39, rt_priority (40), policy (41).
        format!("71 ({name}) S {}{flags} {}{priority} {policy} 0 0", zeros(5), zeros(30))
    }

    #[test]
    fn real_time_threads_are_told_from_others() {
        let audio = real_time_thread(&stat("audio (rt)", 0x40, 88, 1)).unwrap();
        assert_eq!((audio.name.as_str(), audio.tid, audio.priority), ("audio (rt)", 71, 88));
        assert_eq!(real_time_thread(&stat("migration/0", KERNEL_THREAD, 99, 1)), None);
        assert_eq!(real_time_thread(&stat("editor", 0x40, 0, 0)), None);
        assert_eq!(real_time_thread("torn"), None);
    }
}
