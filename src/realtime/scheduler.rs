use std::num::NonZeroU64;

use rustix::thread::{CpuSet, sched_getaffinity, set_current_timer_slack};

use super::{Seat, prefault_stack};
use crate::config::{RealTimeConfig, RealTimePolicy, Wakeup};

/// What a thread does, which decides its priority and the words in messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Releases periods and publishes.
    Loop,
    /// Solves; runs one below the loop.
    Worker(usize),
    /// Moves robots that another process controls; runs two below that one's loop.
    Robots,
}

impl Role {
    fn priority(self, config: &RealTimeConfig) -> i32 {
        match self {
            Self::Loop => i32::from(config.priority),
            Self::Worker(_) => i32::from(config.priority.saturating_sub(1).max(1)),
            Self::Robots => i32::from(config.priority.saturating_sub(2).max(1)),
        }
    }
}

impl std::fmt::Display for Role {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Loop => f.write_str("the loop thread"),
            Self::Worker(index) => write!(f, "worker {index}"),
            Self::Robots => f.write_str("the robots' thread"),
        }
    }
}

/// What one thread got.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThreadGrant {
    /// `fifo` or `other`, as the kernel reports it.
    pub policy: &'static str,
    /// The real-time priority; 0 without.
    pub priority: i32,
    /// The one CPU it runs on, when it is pinned.
    pub cpu: Option<usize>,
    /// How it may wait.
    pub wakeup: Wakeup,
    /// What was asked for and refused, with what to do about it.
    pub refused: Vec<String>,
}

/// CPU numbers this process may run on, ascending.
///
/// Asked of the kernel: `core_affinity::get_core_ids` counts from the CPUs it sees, which hides
/// isolated ones and shifts the numbers behind them.
pub fn usable_cpus() -> Vec<usize> {
    sched_getaffinity(None)
        .map(|set| (0..CpuSet::MAX_CPU).filter(|&cpu| set.is_set(cpu)).collect())
        .unwrap_or_default()
}

/// Makes the calling thread what `role` asks for, on `seat`.
pub fn enter(role: Role, config: &RealTimeConfig, seat: Seat) -> ThreadGrant {
    // Who cannot be alone on a CPU must not keep it busy while waiting.
    let wakeup = if config.wakeup == Wakeup::Spin { Wakeup::Futex } else { config.wakeup };
    let mut grant = ThreadGrant { policy: "other", priority: 0, cpu: None, wakeup, refused: Vec::new() };
    if config.policy == RealTimePolicy::Off {
        return grant;
    }
    prefault_stack();
    // Without it a sleep of an ordinary thread ends up to 50 µs late; real-time ones have none.
    if let Err(e) = set_current_timer_slack(NonZeroU64::new(1)) {
        grant.refused.push(format!("timer slack of {role} not set: {e}"));
    }
    if let Some(cpu) = seat.cpu {
        if core_affinity::set_for_current(core_affinity::CoreId { id: cpu }) && usable_cpus() == [cpu] {
            grant.cpu = Some(cpu);
        } else {
            grant.refused.push(format!(
                "{role} is not pinned to CPU {cpu}: it is not one this process may use; choose from \
                 those that `taskset -p $$` shows, or widen the cpuset"
            ));
        }
    }
    if grant.cpu.is_some() && seat.alone {
        grant.wakeup = config.wakeup;
    } else if config.wakeup == Wakeup::Spin {
        grant.refused.push(format!(
            "{role} does not spin: it would keep others from the CPU that it shares; give it one of its \
             own with loop_cpu and worker_cpus, or set wakeup = \"futex\""
        ));
    }
    let priority = role.priority(config);
    match set_fifo(priority) {
        Ok(()) => (grant.policy, grant.priority) = ("fifo", priority),
        Err(e) => grant.refused.push(format!(
            "{} without SCHED_FIFO priority {priority}: {e}; grant CAP_SYS_NICE, or raise the \
             limit (`ulimit -r {priority}`, LimitRTPRIO={priority} in the unit, rtprio in limits.conf)",
            match role {
                Role::Loop => "the loop thread runs",
                Role::Worker(_) => "workers run",
                Role::Robots => "the robots' thread runs",
            },
        )),
    }
    grant
}

/// Gives the calling thread `SCHED_FIFO` at `priority`, and checks that it took.
fn set_fifo(priority: i32) -> std::io::Result<()> {
    let param = libc::sched_param { sched_priority: priority };
    // Threads that this one might start must not inherit its priority.
    let policy = libc::SCHED_FIFO | libc::SCHED_RESET_ON_FORK;
    // SAFETY: `param` is a valid, initialised struct that the call only reads; id 0 is the caller.
    if unsafe { libc::sched_setscheduler(0, policy, &raw const param) } != 0 {
        return Err(std::io::Error::last_os_error());
    }
    // SAFETY: takes no pointer; id 0 is the caller.
    let now = unsafe { libc::sched_getscheduler(0) };
    if now & !libc::SCHED_RESET_ON_FORK == libc::SCHED_FIFO {
        Ok(())
    } else {
        Err(std::io::Error::other("the kernel accepted the call and kept another policy"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn there_is_a_cpu_to_run_on() {
        let cpus = usable_cpus();
        assert!(!cpus.is_empty() && cpus.is_sorted());
    }

    /// Whether it is granted depends on the machine; that it is told truly does not.
    #[test]
    fn what_is_not_granted_is_reported() {
        let cpu = usable_cpus()[0];
        let seat = Seat { cpu: Some(cpu), alone: true };
        let grant = std::thread::spawn(move || {
            let grant = enter(Role::Worker(2), &RealTimeConfig::default(), seat);
            assert_eq!(grant.cpu.is_some(), usable_cpus() == [cpu]);
            grant
        });
        let grant = grant.join().unwrap();
        assert_eq!(grant.policy == "fifo", grant.priority == 79);
        assert_eq!(grant.policy == "fifo" && grant.cpu.is_some(), grant.refused.is_empty());
    }

    #[test]
    fn a_cpu_that_does_not_exist_is_a_refusal() {
        let seat = Seat { cpu: Some(CpuSet::MAX_CPU - 1), alone: true };
        let grant = std::thread::spawn(move || enter(Role::Loop, &RealTimeConfig::default(), seat));
        let grant = grant.join().unwrap();
        assert_eq!(grant.cpu, None);
        assert!(grant.refused.iter().any(|r| r.contains("not pinned")), "{:?}", grant.refused);
    }

    #[test]
    fn only_who_is_pinned_alone_spins() {
        let config = RealTimeConfig { wakeup: Wakeup::Spin, ..RealTimeConfig::default() };
        let cpu = Some(usable_cpus()[0]);
        for (seat, granted) in [
            (Seat { cpu, alone: true }, Wakeup::Spin),
            (Seat { cpu, alone: false }, Wakeup::Futex),
            (Seat { cpu: None, alone: false }, Wakeup::Futex),
        ] {
            let config = config.clone();
            let grant = std::thread::spawn(move || enter(Role::Worker(0), &config, seat)).join().unwrap();
            assert_eq!(grant.wakeup, granted);
            let told = grant.refused.iter().any(|refused| refused.contains("does not spin"));
            assert_eq!(told, granted != Wakeup::Spin);
        }
    }

    #[test]
    fn off_asks_for_nothing() {
        let config = RealTimeConfig { policy: RealTimePolicy::Off, ..RealTimeConfig::default() };
        let grant =
            std::thread::spawn(move || enter(Role::Loop, &config, Seat { cpu: Some(0), alone: true }))
                .join()
                .unwrap();
        assert_eq!((grant.policy, grant.cpu, grant.refused.len()), ("other", None, 0));
    }
}
