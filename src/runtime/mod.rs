//! The daemon: one loop thread, worker threads, and a thread that keeps house.
//!
//! ```text
//!             ┌───────────────── loop (SCHED_FIFO p) ─────────────────┐
//! source ───▶ │ t_k: state sample ──▶ wake          complete: collect │ ──▶ command sample
//!             └───────│────────────────│───────────────────▲──────────┘
//!              shared memory         futex      staged commands (atomics), futex
//!             ┌───────▼────────────────▼───────────────────│──────────┐
//!             │ workers (SCHED_FIFO p−1): each has a region of its own│
//!             └───────────────────────────────────────────────────────┘
//!                records through bounded queues ──▶ housekeeping ──▶ telemetry sample, figures, log
//! ```
//!
//! Logical execution time: commands computed in period k act in period k+1, whenever they were
//! ready, so that jitter never changes the closed loop. What is late is not used; robots without a
//! valid command stand still, which is safe in every state.
//!
//! Steady state, a period: the loop makes two allocations of 48 bytes (the loans of the next
//! samples, after the commands are out), the workers none; neither locks, formats or logs.

mod accelerated;
mod admin;
mod answers;
mod board;
mod changes;
mod control_loop;
mod counts;
mod daemon;
mod decider;
mod desk;
mod driven;
mod error;
mod event_count;
mod fallback;
mod findings;
mod forecast;
mod heartbeat;
mod housekeeping;
mod keeping;
mod loop_memory;
mod progress;
mod regions;
mod room;
mod spread;
mod staging;
mod starting;
mod statistics;
mod supervisor;
mod threads;
mod truth;
mod unthreaded;
mod watchdog;
mod worker;

pub use accelerated::Accelerated;
pub use admin::{Refusal, Rehearsal};
pub(crate) use counts::Counts;
pub use daemon::Daemon;
pub use decider::{Claims, Decider};
pub use error::DaemonError;
pub use event_count::{EventCount, SPIN_LEAD_NS, Waiting};
pub use keeping::JournalError;
pub use progress::Progress;
pub use staging::Staging;
pub use supervisor::{Supervisor, SupervisorError};
pub(crate) use unthreaded::{Crew, Outline, build};

/// When a run ends by itself.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Until {
    /// When every robot has arrived, or the scenario's time is up.
    Arrived,
    /// Only when it is asked to, or after the configured number of periods.
    Stopped,
}

#[cfg(test)]
mod tests;

#[cfg(test)]
#[path = "corruption/tests.rs"]
mod corruption;
