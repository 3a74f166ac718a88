use crate::controller::{Decision, RobotGroup, Timing};
use crate::wire::{RobotCheckpoint, RobotState};

/// One worker's share of the controller: the robots it owns, with their workspaces and memory.
///
/// It is made in the worker's thread and never leaves it. `decide` must call `each` once for every
/// robot it owns, with the robot's index in the fleet; a robot it leaves out stops.
pub trait Decider {
    /// Answers the fleet's state at `t_k`, which carries the commands in force, with commands that
    /// act at `t_{k+1}`.
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision));

    /// Calls `each` with every robot's index in the fleet and what it remembers, so that a recording
    /// can be computed again. One that remembers nothing need not. Must not allocate.
    fn checkpoint(&self, each: &mut dyn FnMut(usize, RobotCheckpoint)) {
        let _ = each;
    }
}

impl Decider for RobotGroup {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        self.solve(fleet, Timing::LogicalExecutionTime, each);
    }

    fn checkpoint(&self, each: &mut dyn FnMut(usize, RobotCheckpoint)) {
        RobotGroup::checkpoint(self, each);
    }
}
