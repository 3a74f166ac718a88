//! Real-time set-up of threads and memory, and an honest account of what was granted.
//!
//! Asks the kernel for `SCHED_FIFO`, a CPU of its own, locked memory and the finest timer, as
//! [`RealTimeConfig`] says, and writes down in [`Achieved`] what it really got: a run whose
//! scheduling call was refused must never print its figures as if it had been granted. Every
//! refusal names what to change. Used at start-up only; it allocates and formats.

mod awake;
mod memory;
mod scheduler;

pub use awake::{Awake, stay_awake};
pub use memory::{lock_memory, prefault_stack};
pub use scheduler::{Role, ThreadGrant, enter, usable_cpus};

use serde::Serialize;

use crate::config::{RealTimeConfig, RealTimePolicy};

/// What was asked of the kernel and what came of it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Achieved {
    /// Scheduling policy of the loop thread: `fifo` or `other`.
    pub policy: &'static str,
    /// Its priority; 0 without a real-time policy.
    pub priority: i32,
    /// CPU of the loop thread and then of each worker; `null` where a thread is not pinned.
    pub cpus: Vec<Option<usize>>,
    /// Whether all memory, present and future, is locked.
    pub memory_locked: bool,
    /// Whether the CPUs are kept out of idle states that take time to leave.
    pub awake: bool,
    /// What was asked for and refused, why, and what to do about it.
    pub degraded: Vec<String>,
    /// Of these, that CPUs may sleep.
    #[serde(skip)]
    sleeping: Option<String>,
}

impl Default for Achieved {
    fn default() -> Self {
        Self {
            policy: "other",
            priority: 0,
            cpus: Vec::new(),
            memory_locked: false,
            awake: false,
            degraded: Vec::new(),
            sleeping: None,
        }
    }
}

impl Achieved {
    /// Adds a thread; the first is the loop's.
    pub fn add_thread(&mut self, grant: ThreadGrant) {
        if self.cpus.is_empty() {
            (self.policy, self.priority) = (grant.policy, grant.priority);
        }
        self.cpus.push(grant.cpu);
        // What is refused to one worker is refused to all.
        for refused in grant.refused {
            if !self.degraded.contains(&refused) {
                self.degraded.push(refused);
            }
        }
    }

    /// Takes the outcome of [`lock_memory`].
    pub fn add_memory(&mut self, outcome: Result<bool, String>) {
        match outcome {
            Ok(locked) => self.memory_locked = locked,
            Err(refused) => self.degraded.push(refused),
        }
    }

    /// Takes the outcome of [`stay_awake`]; what is to be held as long as the threads run.
    pub fn add_awake(&mut self, outcome: Result<Option<Awake>, String>) -> Option<Awake> {
        let held = outcome.unwrap_or_else(|refused| {
            self.sleeping = Some(refused.clone());
            self.degraded.push(refused);
            None
        });
        self.awake = held.is_some();
        held
    }

    /// Whether the run may go on under `policy`. CPUs that may sleep do not prevent it: they cost the time
    /// to wake up, which is bounded, and their device belongs to root on most machines.
    pub fn satisfies(&self, policy: RealTimePolicy) -> bool {
        let lacking = self.degraded.iter().any(|line| Some(line) != self.sleeping.as_ref());
        policy != RealTimePolicy::Require || !lacking
    }
}

/// Which CPU each thread gets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Placement {
    /// The loop thread's.
    pub loop_cpu: Option<usize>,
    /// The workers', one each.
    pub worker_cpus: Vec<Option<usize>>,
}

/// Where one thread runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Seat {
    /// The CPU that it is to be pinned to.
    pub cpu: Option<usize>,
    /// Whether no other of the daemon's real-time threads is.
    pub alone: bool,
}

impl Placement {
    /// The seat of a thread that is placed on `cpu`.
    pub fn seat(&self, cpu: Option<usize>) -> Seat {
        let placed = self.worker_cpus.iter().chain([&self.loop_cpu]);
        Seat { cpu, alone: cpu.is_some() && placed.filter(|&&other| other == cpu).count() == 1 }
    }

    /// Places the loop and its workers on `usable` CPUs.
    ///
    /// The loop gets the first; the workers go from the last backwards and share only when there
    /// are more of them than CPUs. Sharing the loop's CPU is sound: the loop sleeps while they
    /// work, and outranks them when it wakes.
    ///
    /// `workers`: how many are wanted; `None` for as many as robots and CPUs allow.
    pub fn new(config: &RealTimeConfig, workers: Option<usize>, robots: usize, usable: &[usize]) -> Self {
        let candidates: Vec<usize> = if config.worker_cpus.is_empty() {
            usable.iter().rev().copied().collect()
        } else {
            config.worker_cpus.clone()
        };
        let count = workers.unwrap_or(candidates.len()).clamp(1, robots.max(1));
        if config.policy == RealTimePolicy::Off {
            return Self { loop_cpu: None, worker_cpus: vec![None; count] };
        }
        let worker_cpus = (0..count).map(|w| candidates.get(w % candidates.len().max(1)).copied()).collect();
        Self { loop_cpu: config.loop_cpu.or_else(|| usable.first().copied()), worker_cpus }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Wakeup;

    #[test]
    fn workers_fill_the_cpus_from_the_last_and_never_outnumber_the_robots() {
        let config = RealTimeConfig::default();
        let place = |workers, robots| Placement::new(&config, workers, robots, &[2, 3, 7]);
        assert_eq!(place(None, 8).loop_cpu, Some(2));
        assert_eq!(place(None, 8).worker_cpus, [Some(7), Some(3), Some(2)]);
        assert_eq!(place(None, 2).worker_cpus, [Some(7), Some(3)]);
        let three = place(None, 8);
        assert_eq!([2, 3, 7].map(|cpu| three.seat(Some(cpu)).alone), [false, true, true]);
        assert_eq!(three.seat(None), Seat { cpu: None, alone: false });
        assert_eq!(place(Some(4), 8).worker_cpus, [Some(7), Some(3), Some(2), Some(7)]);
        assert_eq!(place(Some(0), 0).worker_cpus, [Some(7)]);
        assert_eq!(Placement::new(&config, Some(2), 8, &[]).worker_cpus, [None, None]);
    }

    #[test]
    fn configured_cpus_come_first_and_off_pins_nothing() {
        let mut config =
            RealTimeConfig { loop_cpu: Some(5), worker_cpus: vec![6], ..RealTimeConfig::default() };
        let p = Placement::new(&config, Some(2), 8, &[0, 1]);
        assert_eq!((p.loop_cpu, p.worker_cpus), (Some(5), vec![Some(6), Some(6)]));
        config.policy = RealTimePolicy::Off;
        let p = Placement::new(&config, Some(2), 8, &[0, 1]);
        assert_eq!((p.loop_cpu, p.worker_cpus), (None, vec![None, None]));
    }

    #[test]
    fn a_refusal_fails_require_and_is_kept() {
        let mut achieved = Achieved::default();
        achieved.add_memory(Err("memory".into()));
        assert!(!achieved.satisfies(RealTimePolicy::Require));
        assert!(achieved.add_awake(Err("idle".into())).is_none() && !achieved.awake);
        achieved.add_thread(ThreadGrant {
            policy: "fifo",
            priority: 9,
            cpu: Some(1),
            wakeup: Wakeup::Futex,
            refused: vec!["x".into()],
        });
        assert_eq!((achieved.policy, achieved.priority), ("fifo", 9));
        assert_eq!(achieved.degraded, ["memory", "idle", "x"]);
        assert!(achieved.satisfies(RealTimePolicy::Prefer));
        assert!(!achieved.satisfies(RealTimePolicy::Require));
    }

    #[test]
    fn cpus_that_may_sleep_are_told_of_and_fail_nothing() {
        let mut achieved = Achieved::default();
        assert!(achieved.add_awake(Err("idle".into())).is_none());
        assert_eq!(achieved.degraded, ["idle"]);
        assert!(achieved.satisfies(RealTimePolicy::Require));
        achieved.degraded.push("something else".into());
        assert!(!achieved.satisfies(RealTimePolicy::Require));
    }
}
