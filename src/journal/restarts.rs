use std::path::Path;

use rustix::time::{ClockId, clock_gettime};

/// A moment in the life of a machine that no setting of a clock moves.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Moment {
    /// Which boot of the machine; empty where it does not tell.
    pub boot: String,
    /// Since then, also while it slept, ns.
    pub ns: u64,
}

impl Moment {
    /// Now.
    pub fn now() -> Self {
        let boot = std::fs::read_to_string(Path::new("/proc/sys/kernel/random/boot_id"));
        let at = clock_gettime(ClockId::Boottime);
        let s = u64::try_from(at.tv_sec).unwrap_or(0);
        let ns = s.saturating_mul(1_000_000_000).saturating_add(u64::try_from(at.tv_nsec).unwrap_or(0));
        Self { boot: boot.map(|boot| boot.trim().to_owned()).unwrap_or_default(), ns }
    }
}

/// When a daemon was started after a run that did not end in order.
///
/// Those of another boot of the machine do not count: what a reboot did not mend takes longer to show.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Restarts {
    /// The boot that the moments are of.
    pub boot: String,
    /// The moments, ns since then, oldest first.
    pub at_ns: Vec<u64>,
}

impl Restarts {
    /// Adds one and forgets those that are more than `within_ns` ago; how many there are now.
    pub fn add(&mut self, now: &Moment, within_ns: u64) -> usize {
        if self.boot != now.boot {
            (self.boot, self.at_ns) = (now.boot.clone(), Vec::new());
        }
        // One in the future is taken for a recent one.
        self.at_ns.retain(|at_ns| now.ns.saturating_sub(*at_ns) <= within_ns);
        self.at_ns.push(now.ns);
        self.at_ns.len()
    }

    /// Forgets all of them.
    pub fn reset(&mut self) {
        self.at_ns.clear();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_restarts_of_this_boot_and_within_the_time_count() {
        let at = |boot: &str, ns| Moment { boot: boot.to_owned(), ns };
        let mut restarts = Restarts::default();
        let counts = [5, 60, 65, 66, 200].map(|ns| restarts.add(&at("a", ns), 60));
        assert_eq!(counts, [1, 2, 3, 3, 1]);
        assert_eq!(restarts.add(&at("a", 100), 60), 2, "a clock that went back forgives nothing");
        assert_eq!(restarts.add(&at("b", 101), 60), 1);
        restarts.reset();
        assert_eq!(restarts.add(&at("b", 102), 60), 1);
    }

    #[test]
    fn the_machine_tells_its_boot_and_time_goes_on() {
        let (before, after) = (Moment::now(), Moment::now());
        assert!(before.boot == after.boot && before.ns <= after.ns && after.ns > 0);
    }
}
