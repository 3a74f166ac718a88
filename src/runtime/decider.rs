use std::ops::Range;

use crate::controller::{Decision, Remembered, RobotGroup, Timing};
use crate::wire::{RobotCheckpoint, RobotState};

/// Hands out parts of the fleet, one after the other, while there are any.
pub type Claims<'a> = &'a mut dyn FnMut() -> Option<Range<usize>>;

/// One worker's share of the controller: the robots it owns, with their workspaces and memory.
///
/// It is made in the worker's thread and never leaves it. `decide` must call `each` once for every
/// robot it owns, with the robot's index in the fleet; a robot it leaves out stops.
pub trait Decider {
    /// Answers the fleet's state at `t_k`, which carries the commands in force, with commands that
    /// act at `t_{k+1}`.
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision));

    /// Whether it answers parts of the fleet, with [`decide_parts`](Self::decide_parts), and not
    /// always the robots that it was made for.
    fn is_regional(&self) -> bool {
        false
    }

    /// As [`decide`](Self::decide) and [`checkpoint`](Self::checkpoint), in period `tick` and for the
    /// robots in the `parts` of the fleet in spatial order, which are asked for until none is left.
    fn decide_parts(
        &mut self,
        (tick, parts): (u64, Claims),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        let _ = (tick, parts, fleet, remember, each);
    }

    /// Calls `each` with every robot's index in the fleet and what it remembers, so that a recording
    /// can be computed again. One that remembers nothing need not. Must not allocate.
    fn checkpoint(&self, each: &mut dyn FnMut(usize, &Remembered)) {
        let _ = each;
    }

    /// Makes the robot at `index` of the fleet remember again what it did `before` it answered period `tick`,
    /// whose state turned out to be corrupted. One that remembers nothing need not.
    fn undo(&mut self, index: usize, tick: u64, before: &RobotCheckpoint) {
        let _ = (index, tick, before);
    }
}

impl Decider for RobotGroup {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        self.solve(fleet, Timing::LogicalExecutionTime, each);
    }

    fn is_regional(&self) -> bool {
        RobotGroup::is_regional(self)
    }

    fn decide_parts(
        &mut self,
        (tick, parts): (u64, Claims),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        self.solve_parts((tick, parts), fleet, Timing::LogicalExecutionTime, remember, each);
    }

    fn checkpoint(&self, each: &mut dyn FnMut(usize, &Remembered)) {
        RobotGroup::checkpoint(self, each);
    }

    fn undo(&mut self, index: usize, tick: u64, before: &RobotCheckpoint) {
        RobotGroup::undo(self, index, tick, before);
    }
}
