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
    /// From the state's stamp to the worker having it, ns.
    pub state_to_worker_ns: u64,
    /// From the state's stamp to the worker's last command being staged, ns.
    pub state_to_staged_ns: u64,
    /// Index in the fleet and record of each robot that it answered.
    pub robots: Vec<(usize, RobotTelemetry)>,
    /// What each of them remembered before.
    pub checkpoints: Vec<(usize, RobotCheckpoint)>,
}

impl SolveRecord {
    /// An empty record with room for `robots` robots.
    pub fn with_room(robots: usize) -> Self {
        let (mut robots, mut checkpoints) =
            (vec![Default::default(); robots], vec![Default::default(); robots]);
        // Touched once, so that no page of it is missing later.
        robots.clear();
        checkpoints.clear();
        Self { robots, checkpoints, ..Self::default() }
    }
}
