use crate::wire::{RobotCommand, RobotState, RobotTelemetry};

/// What one robot is to do in the next period, and how that was found.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Decision {
    /// A verified command, or a stop with its reason.
    pub command: RobotCommand,
    /// How it was found.
    pub telemetry: RobotTelemetry,
}

/// One worker's share of the controller: the robots it owns, with their workspaces and memory.
///
/// It is made in the worker's thread and never leaves it. `decide` must call `each` once for every
/// robot it owns, with the robot's index in the fleet; a robot it leaves out stops.
pub trait Decider {
    /// Answers the fleet's state at `t_k`, which carries the commands in force, with commands that
    /// act at `t_{k+1}`.
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision));
}
