//! Where the fleet's states come from: the plant inside the daemon, or the `observation` channel.
//!
//! Reads the period's start and the commands that are in force, writes the poses at `t_k` and their
//! validity. Both sources answer for exactly `t_k`: an observation made a little earlier or later is
//! carried along the arcs of the commands that were in force between. So is the last good pose of a
//! robot that is not heard any more: it went on driving until it was told to stop, or has stopped on the
//! way, and its pose is the middle of that way, with half its length as uncertainty. A foreign robot
//! takes no commands; its pose stays where it was seen, with how far it may have come since. World
//! frame, metres, radians, `CLOCK_MONOTONIC` ns. Neither allocates after it is made.

mod held;
mod observed;
mod stillness;

pub use observed::Observed;

use crate::admission::Rejections;
use crate::clock::Clock;
use crate::geometry::Pose;
use crate::model::{RobotId, RobotSpec};
use crate::plant::Plant;
use crate::wire::{CommandHeader, NO_ROBOT, RobotCommand, RobotState, state_flags};

/// The instant whose state is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instant {
    /// Which run of the daemon.
    pub epoch: u64,
    /// `t_k`, ns.
    pub release_ns: u64,
    /// Now: `t_k` and what the wake-up was late, ns.
    pub now_ns: u64,
}

/// A source of states.
pub trait StateSource {
    /// Writes the poses of all robots at `t_k` and their uncertainty, one for each place, and sets or
    /// clears [`state_flags::VALID`]; leaves everything else, and free places. `clock` tells the time that
    /// has come since `instant`.
    fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]);

    /// Whether it knows where every robot is without being told.
    fn knows_all(&self) -> bool;

    /// A robot takes the `index`-th place, at rest at its start.
    fn admit(&mut self, index: usize, robot: &RobotSpec);

    /// The robot in the `index`-th place is taken away.
    fn dismiss(&mut self, index: usize);

    /// Learns which commands were published at `now_ns`. What it is asked for next is a state at or after the time
    /// from which they act.
    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64);

    /// What was refused so far.
    fn rejections(&self) -> Rejections;
}

fn set_pose(state: &mut RobotState, pose: Pose, uncertainty_m: f64, valid: bool) {
    state.set_pose(pose);
    state.uncertainty_m = uncertainty_m;
    state.flags = if valid { state.flags | state_flags::VALID } else { state.flags & !state_flags::VALID };
}

impl StateSource for Plant {
    fn observe(&mut self, instant: Instant, _: &dyn Clock, states: &mut [RobotState]) {
        self.advance(instant.release_ns);
        for (index, state) in states.iter_mut().enumerate() {
            if let Some(pose) = self.seen(index).filter(|_| !state.has(state_flags::VACANT)) {
                set_pose(state, pose, 0.0, true);
            }
        }
    }

    fn knows_all(&self) -> bool {
        true
    }

    fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.place(index, robot.id, robot.start);
    }

    fn dismiss(&mut self, index: usize) {
        self.place(index, RobotId(NO_ROBOT), Pose::default());
    }

    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
        // How they move until these commands act is known by now, and nobody waits for it here.
        self.command_and_advance(header, commands, now_ns, header.valid_from_ns);
    }

    fn rejections(&self) -> Rejections {
        Rejections::default()
    }
}
