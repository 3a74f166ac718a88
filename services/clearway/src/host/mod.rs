//! What this machine is like: facts from `/proc` and `/sys`, read below a root directory.
//!
//! The root is `/` in use and a made-up tree in tests. A file that is not there is `None`: most of
//! them exist only where the kernel or the machine has the feature.

mod process;

pub(crate) use process::Limit;

use std::path::{Path, PathBuf};

/// Reads facts.
#[derive(Debug, Clone)]
pub(crate) struct Host {
    root: PathBuf,
}

impl Host {
    pub(crate) fn here() -> Self {
        Self::at(Path::new("/"))
    }

    pub(crate) fn at(root: &Path) -> Self {
        Self { root: root.to_owned() }
    }

    /// Where an absolute path is below the root.
    pub(crate) fn path(&self, path: &str) -> PathBuf {
        self.root.join(path.trim_start_matches('/'))
    }

    /// A file's text without white space around it.
    pub(crate) fn read(&self, path: &str) -> Option<String> {
        let text = std::fs::read_to_string(self.path(path)).ok()?;
        Some(text.trim().to_owned())
    }

    /// The names in a directory, sorted.
    pub(crate) fn names(&self, path: &str) -> Vec<String> {
        let Ok(entries) = std::fs::read_dir(self.path(path)) else { return Vec::new() };
        let mut names: Vec<String> =
            entries.flatten().map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
        names.sort();
        names
    }

    /// What the kernel reads `CLOCK_MONOTONIC` from.
    pub(crate) fn clock_source(&self) -> Option<String> {
        self.read("/sys/devices/system/clocksource/clocksource0/current_clocksource")
    }

    /// Whether this is a virtual machine, and of which kind where that can be told.
    pub(crate) fn hypervisor(&self) -> Option<String> {
        let kind = self.read("/sys/hypervisor/type");
        let product = self.read("/sys/class/dmi/id/product_name");
        let flagged = self.read("/proc/cpuinfo").is_some_and(|info| {
            let flags = info.lines().filter(|line| line.starts_with("flags") || line.starts_with("Features"));
            flags.flat_map(str::split_whitespace).any(|flag| flag == "hypervisor")
        });
        let virtual_product = product.filter(|name| {
            ["KVM", "VMware", "VirtualBox", "Virtual Machine", "QEMU", "Bochs", "HVM domU"]
                .iter()
                .any(|known| name.contains(known))
        });
        kind.or(virtual_product).or_else(|| flagged.then(|| "unnamed".to_owned()))
    }

    /// Share of processor time since boot that the host of a virtual machine gave to others.
    pub(crate) fn stolen_share(&self) -> Option<f64> {
        let stat = self.read("/proc/stat")?;
        let times: Vec<f64> =
            stat.lines().next()?.split_whitespace().skip(1).filter_map(|time| time.parse().ok()).collect();
        // user nice system idle iowait irq softirq steal; guest times are part of user's.
        let all: f64 = times.iter().take(8).sum();
        (all > 0.0).then(|| times.get(7).copied().unwrap_or(0.0) / all)
    }

    /// CPU frequency governors in use, each once.
    pub(crate) fn governors(&self) -> Vec<String> {
        let mut found: Vec<String> = self
            .cpu_directories()
            .iter()
            .filter_map(|cpu| self.read(&format!("{cpu}/cpufreq/scaling_governor")))
            .collect();
        found.sort();
        found.dedup();
        found
    }

    /// `/sys` directories of the CPUs.
    pub(crate) fn cpu_directories(&self) -> Vec<String> {
        const CPUS: &str = "/sys/devices/system/cpu";
        let is_cpu = |name: &String| name.strip_prefix("cpu").is_some_and(is_number);
        self.names(CPUS).into_iter().filter(is_cpu).map(|name| format!("{CPUS}/{name}")).collect()
    }
}

pub(crate) fn is_number(text: &str) -> bool {
    !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit())
}

/// CPU numbers of a list as the kernel writes it: `0-3,8`.
pub(crate) fn cpu_list(text: &str) -> Vec<usize> {
    let range = |part: &str| {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        Some(first.trim().parse::<usize>().ok()?..=last.trim().parse::<usize>().ok()?)
    };
    text.split(',').filter_map(range).flatten().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists_of_cpus() {
        assert_eq!(cpu_list("0-3,8"), [0, 1, 2, 3, 8]);
        assert_eq!(cpu_list("5"), [5]);
        assert!(cpu_list("").is_empty() && cpu_list("(null)").is_empty());
    }

    #[test]
    fn this_machine_can_be_read() {
        let host = Host::here();
        assert!(host.read("/proc/version").is_some_and(|text| text.contains("Linux")));
        assert!(host.stolen_share().is_some_and(|share| (0.0..1.0).contains(&share)));
        assert!(host.limit("Max open files").is_some());
        assert!(host.read("/no/such/file").is_none() && host.names("/no/such/place").is_empty());
    }
}
