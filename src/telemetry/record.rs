use crate::admission::Rejections;
use crate::wire::{RobotCheckpoint, RobotCommand, RobotState, RobotTelemetry, TelemetryHeader};

/// One period of the loop.
#[derive(Debug, Clone, Default)]
pub struct PeriodRecord {
    /// Its times and counts.
    pub header: TelemetryHeader,
    /// The state that was published, with the commands in force.
    pub states: Vec<RobotState>,
    /// The commands that were published, or would have been had they not been late.
    pub commands: Vec<RobotCommand>,
    /// Whether the commands went out before the period in which they act.
    pub published: bool,
    /// Samples that could not be sent to every reader so far.
    pub send_failures: u64,
    /// Observations refused so far.
    pub rejections: Rejections,
}

impl PeriodRecord {
    /// An empty record for `robots` robots.
    pub fn with_robots(robots: usize) -> Self {
        Self {
            states: vec![RobotState::default(); robots],
            commands: vec![RobotCommand::default(); robots],
            ..Self::default()
        }
    }
}

/// What one worker did in one period.
#[derive(Debug, Clone, Default)]
pub struct SolveRecord {
    /// The period whose state was answered.
    pub tick: u64,
    /// Index of the worker's first robot in the scenario.
    pub first: usize,
    /// From the state's stamp to the worker having it, ns.
    pub state_to_worker_ns: u64,
    /// From the state's stamp to the worker's last command being staged, ns.
    pub state_to_staged_ns: u64,
    /// One record for each of its robots.
    pub robots: Vec<RobotTelemetry>,
    /// What each of them remembered before.
    pub checkpoints: Vec<RobotCheckpoint>,
}

impl SolveRecord {
    /// An empty record for the worker of `robots` robots from index `first`.
    pub fn with_robots(first: usize, robots: usize) -> Self {
        Self {
            first,
            robots: vec![RobotTelemetry::default(); robots],
            checkpoints: vec![RobotCheckpoint::default(); robots],
            ..Self::default()
        }
    }
}
