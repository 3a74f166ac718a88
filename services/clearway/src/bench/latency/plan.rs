//! Who runs where, and how much is measured.

use std::time::Duration;

use clearway::config::{RealTimeConfig, RealTimePolicy, Wakeup};
use clearway::realtime::{Role, Seat, ThreadGrant, enter, usable_cpus};
use miette::{Result, miette};

/// How long each part measures unless samples are given.
const PART: Duration = Duration::from_secs(6);
/// Fewer samples than these say nothing.
const SAMPLES_MIN: u64 = 20;

/// Polls in vain after which a party lets others of its priority run: two programs that poll at the same
/// priority would otherwise keep each other from answering. An answer takes far fewer.
pub(super) const PATIENT_POLLS: u32 = 20_000;

/// Which CPU each party has.
#[derive(Debug, Clone)]
pub(super) struct Seats {
    /// The releasing thread's, and the daemon's loop's.
    pub(super) own: usize,
    /// The worker's, the answering process's and the load's.
    pub(super) other: Option<usize>,
    /// The reader's in another process: a third where there is one.
    pub(super) reader: Option<usize>,
}

impl Seats {
    /// On the CPUs that this process may use, the first one for the release unless another is named.
    pub(super) fn new(own: Option<usize>, reader: Option<usize>) -> Result<Self> {
        let usable = usable_cpus();
        let own = own
            .or_else(|| usable.first().copied())
            .ok_or_else(|| miette!("this process may not use any CPU that can be named"))?;
        let mut rest = usable.into_iter().rev().filter(|cpu| *cpu != own);
        let other = rest.next();
        Ok(Self { own, other, reader: reader.or_else(|| rest.next()).or(other) })
    }
}

/// What is asked of the kernel for a thread with `priority`.
pub(super) fn asked(priority: u8, wakeup: Wakeup) -> RealTimeConfig {
    RealTimeConfig { policy: RealTimePolicy::Prefer, priority, wakeup, ..RealTimeConfig::default() }
}

/// Makes the calling thread real-time on `cpu`, as the daemon's loop is.
pub(super) fn enter_real_time(priority: u8, cpu: Option<usize>) -> ThreadGrant {
    enter(Role::Loop, &asked(priority, Wakeup::Futex), Seat { cpu, alone: false })
}

/// Pins the calling thread and leaves its policy alone; what was refused.
pub(super) fn enter_ordinary(cpu: Option<usize>) -> Vec<String> {
    use rustix::thread::{CpuSet, sched_setaffinity};
    let Some(cpu) = cpu.filter(|cpu| *cpu < CpuSet::MAX_CPU) else { return Vec::new() };
    let mut only = CpuSet::new();
    only.set(cpu);
    sched_setaffinity(None, &only)
        .err()
        .map(|e| format!("the load is not pinned to CPU {cpu}: {e}"))
        .into_iter()
        .collect()
}

/// Samples of each part at a period, when none are given.
pub(super) fn samples(period_ns: u64) -> u64 {
    (u64::try_from(PART.as_nanos()).unwrap_or(u64::MAX) / period_ns.max(1)).max(SAMPLES_MIN)
}

/// How long `samples` periods take.
pub(super) fn duration(period_ns: u64, samples: u64) -> Duration {
    Duration::from_nanos(period_ns.saturating_mul(samples))
}
