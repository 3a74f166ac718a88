/// How a run is going.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Progress {
    /// Periods recorded so far; without any, the rest says nothing yet.
    pub ticks: u64,
    /// The period that was recorded last.
    pub tick: u64,
    /// Time simulated, s: ticks times the period.
    pub time_s: f64,
    /// Time since the start, s.
    pub wall_s: f64,
    /// Robots of the fleet now.
    pub robots: usize,
    /// Robots that have arrived.
    pub arrived: usize,
    /// Robots that have not made progress for more than a second, away from their goals.
    pub stalled: usize,
    /// Robots without a trusted state.
    pub unseen: usize,
    /// Whether the fleet is paused.
    pub paused: bool,
    /// Whether an operator stopped the fleet.
    pub stopped: bool,
    /// Periods that never ran.
    pub skipped_periods: u64,
    /// Smallest clearance between any two so far, over continuous time, m.
    pub min_clearance_m: f64,
    /// How late the last period was released, ns.
    pub release_lateness_ns: u64,
    /// The latest release so far, ns.
    pub release_lateness_max_ns: u64,
    /// 99 % of the solves took at most this, ns.
    pub solve_p99_ns: u64,
    /// Periods without a complete command in time.
    pub deadline_misses: u64,
    /// Stops in place of verified commands.
    pub fallback_commands: u64,
    /// Observations refused.
    pub rejected_inputs: u64,
    /// Records that telemetry lost.
    pub lost_records: u64,
    /// Workers that have not answered in time for two periods.
    pub workers_silent: usize,
    /// Times that a worker panicked.
    pub worker_panics: u64,
    /// Times that the thread which answers operators panicked; each lost a request.
    pub admin_panics: u64,
    /// Times that somebody who joined could not be connected: no file descriptors, or memory that could not
    /// be mapped.
    pub attach_failures: u64,
}
