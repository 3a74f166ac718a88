use crate::document::names;
use crate::geometry::Integration;

/// When the commands of a period are published. They act from the start of the next one either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PublishAt {
    /// When every worker is done, and at the deadline at the latest.
    #[default]
    Complete,
    /// At the deadline.
    Deadline,
}

names!(PublishAt { Complete => "complete", Deadline => "deadline" });

/// Period, deadline and workers of the loop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimingConfig {
    /// Sampling period T, ns. Default 80 ms; at least 200 µs.
    pub period_ns: u64,
    /// The deadline is this long before the end of the period, ns. `None`: a quarter of the period, at
    /// most 2 ms.
    pub deadline_margin_ns: Option<u64>,
    /// When commands are published.
    pub publish: PublishAt,
    /// Number of the first period. Not a key: for runs that begin where numbers get large.
    pub first_tick: u64,
    /// Worker threads; `None`: as many as the robots and the usable cores allow.
    pub workers: Option<usize>,
    /// Stop after this many periods; `None`: when every robot has arrived or time is up (a built-in
    /// run), or at a signal (a configured run).
    pub ticks: Option<u64>,
}

impl Default for TimingConfig {
    fn default() -> Self {
        Self {
            period_ns: 80_000_000,
            deadline_margin_ns: None,
            publish: PublishAt::default(),
            first_tick: 0,
            workers: None,
            ticks: None,
        }
    }
}

impl TimingConfig {
    /// Sampling period T, s.
    pub fn period_s(&self) -> f64 {
        self.period_ns as f64 * 1e-9
    }

    /// The margin between the deadline and the end of the period, ns.
    pub fn margin_ns(&self) -> u64 {
        self.deadline_margin_ns.unwrap_or((self.period_ns / 4).min(2_000_000))
    }
}

/// What to do when the kernel refuses a real-time call.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum RealTimePolicy {
    /// Refuse to start and say why.
    Require,
    /// Ask, run without what was refused, and show it as DEGRADED.
    #[default]
    Prefer,
    /// Do not ask.
    Off,
}

names!(RealTimePolicy { Require => "require", Prefer => "prefer", Off => "off" });

/// How the real-time threads wait for each other. The results are the same to the bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Wakeup {
    /// Asleep in the kernel.
    #[default]
    Futex,
    /// Spinning from shortly before the other is expected, for a bounded time; otherwise asleep. Only on
    /// a CPU that no other thread of the daemon is pinned to.
    Spin,
    /// Asleep in a queue of crossbeam's, which takes a lock inside. To compare with.
    Channel,
}

names!(Wakeup { Futex => "futex", Spin => "spin", Channel => "channel" });

/// Scheduling, pinning and memory locking.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RealTimeConfig {
    /// What to do when a call is refused.
    pub policy: RealTimePolicy,
    /// `SCHED_FIFO` priority of the loop thread, 1–99; workers run one below.
    pub priority: u8,
    /// CPU number of the loop thread; `None`: the first usable one.
    pub loop_cpu: Option<usize>,
    /// CPU numbers of the workers, used in turn; empty: the usable ones from the last backwards.
    pub worker_cpus: Vec<usize>,
    /// Lock all memory, present and future.
    pub lock_memory: bool,
    /// Keep the CPUs out of idle states that take time to leave.
    pub stay_awake: bool,
    /// How the loop and the workers wait for each other.
    pub wakeup: Wakeup,
}

impl Default for RealTimeConfig {
    fn default() -> Self {
        Self {
            policy: RealTimePolicy::default(),
            priority: 80,
            loop_cpu: None,
            worker_cpus: Vec::new(),
            lock_memory: true,
            stay_awake: true,
            wakeup: Wakeup::default(),
        }
    }
}

/// Where the robots' states come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SourceKind {
    /// The exact plant inside the daemon.
    #[default]
    Plant,
    /// Other processes, over the `observation` channel.
    Observation,
}

names!(SourceKind { Plant => "plant", Observation => "observation" });

names!(Integration { Exact => "exact", Euler => "euler" });

/// The state source and what it accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SourceConfig {
    /// Which source.
    pub kind: SourceKind,
    /// How the plant moves the robots, in the daemon and in evaluations.
    pub plant: Integration,
    /// An observation older than this is stale and its robot is told to stop, ns. `None`: two
    /// periods.
    pub max_age_ns: Option<u64>,
    /// Coordinates beyond this distance from the origin are out of range, m.
    pub arena_m: f64,
    /// How much further than `v_max` allows a position may have moved since the last good one, m.
    pub jump_margin_m: f64,
    /// How much further than `ω_max` allows a heading may have turned since the last good one, rad. From π
    /// on: any heading is believed.
    pub turn_margin_rad: f64,
}

impl Default for SourceConfig {
    fn default() -> Self {
        Self {
            kind: SourceKind::default(),
            plant: Integration::default(),
            max_age_ns: None,
            arena_m: 1.0e4,
            jump_margin_m: 0.25,
            // In the two periods that an answer takes, 0.8 m at the paper's limits, a heading that is so far
            // off leads a robot astray by 0.2 m: no further than a position may be off.
            turn_margin_rad: 0.25,
        }
    }
}

impl SourceConfig {
    /// The age from which on an observation is stale, ns.
    pub fn max_age_or_default_ns(&self, period_ns: u64) -> u64 {
        self.max_age_ns.unwrap_or(2 * period_ns)
    }
}

/// Telemetry's queue and histograms.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct TelemetryConfig {
    /// Periods that the queue to the housekeeping thread can hold; what does not fit is counted.
    pub queue_periods: usize,
    /// One solve of each worker in this many is solved again by Clarabel, outside of the real-time
    /// threads; 0: none.
    pub audit_every: u32,
}

impl Default for TelemetryConfig {
    fn default() -> Self {
        Self { queue_periods: 64, audit_every: 64 }
    }
}
