//! What the loop does at the start of a period about the requests that wait for it.

use super::control_loop::ControlLoop;
use super::desk::{Batch, Change, Outcome};
use crate::clock::Clock;
use crate::model::{Command, RobotSpec};
use crate::wire::{RobotCommand, RobotIntent, RobotState, StopReason, state_flags};

impl<C: Clock> ControlLoop<C> {
    /// Carries out what waits, at most as much as the desk holds. The poses are those of `t_k`; nothing
    /// is allocated or freed.
    pub(super) fn carry_out(&mut self, tick: u64, now_ns: u64) {
        for _ in 0..self.desk.todo.capacity() {
            // Without a place to give it back to it stays where it is.
            if self.desk.done.is_full() {
                return;
            }
            let Some(mut batch) = self.desk.todo.pop() else { return };
            batch.outcome = self.outcome(&mut batch, tick, now_ns);
            self.memory.refusals +=
                u64::from(matches!(batch.outcome, Outcome::Expired | Outcome::TooClose { .. }));
            let _ = self.desk.done.push(batch);
        }
    }

    fn outcome(&mut self, batch: &mut Batch, tick: u64, now_ns: u64) -> Outcome {
        let independent = batch.changes.iter().all(|change| matches!(change, Change::Hold { .. }));
        if now_ns >= batch.expires_ns {
            return Outcome::Expired;
        }
        if !independent && batch.refusals_known != self.memory.refusals {
            return Outcome::Outdated;
        }
        for change in &batch.changes {
            if let Change::Add { robot, margin_m, .. } = change
                && let Some(id) = self.too_close(robot, *margin_m)
            {
                return Outcome::TooClose { id };
            }
        }
        for change in &batch.changes {
            self.change(change);
        }
        // Before the state that tells the goals: no worker ever has to build a route.
        if let Some(shelf) = &self.desk.shelf {
            for (place, route) in &mut batch.routes {
                *route = route.take().and_then(|route| shelf.place(*place, route));
            }
        }
        Outcome::Done { tick }
    }

    /// A robot that may come closer to a new one than it may, before it knows of it: the commands that
    /// act over this period are out already.
    fn too_close(&self, robot: &RobotSpec, margin_m: f64) -> Option<u32> {
        let mut others = self.memory.states.iter().filter(|state| !state.has(state_flags::VACANT));
        let reaches = |other: &&RobotState| {
            let apart_m = (other.position_m() - robot.start.position_m).norm();
            apart_m < margin_m + robot.radius_m + other.radius_m + self.memory.room.way_m(other)
        };
        others.find(reaches).map(|other| other.id)
    }

    fn change(&mut self, change: &Change) {
        let memory = &mut self.memory;
        match *change {
            Change::Goal { place, goal_m } => {
                if let Some(state) = memory.states.get_mut(place) {
                    (state.goal_x_m, state.goal_y_m) = (goal_m.x, goal_m.y);
                }
            }
            Change::Hold { set, clear } => memory.hold = memory.hold & !clear | set,
            Change::Add { place, robot, .. } => {
                // The plant knows where its robots are; others have to be seen first.
                let flags = if self.source.knows_all() { state_flags::VALID } else { 0 };
                let state = RobotState::at_start(&robot);
                memory.replace(place, RobotState { flags: state.flags | flags, ..state }, StopReason::Start);
                self.source.admit(place, &robot);
            }
            Change::Remove { place } => {
                memory.replace(place, RobotState::vacant(), StopReason::Vacant);
                self.source.dismiss(place);
            }
        }
    }
}

impl super::loop_memory::LoopMemory {
    /// Puts somebody else, at rest, or nobody into a place.
    pub(super) fn replace(&mut self, place: usize, mut state: RobotState, reason: StopReason) {
        let (Some(slot), Some(command), Some(intent)) =
            (self.states.get_mut(place), self.commands.get_mut(place), self.intents.get_mut(place))
        else {
            return;
        };
        if let Some(remaining) = &mut self.remaining {
            remaining.reset(place);
        }
        state.set_command(Command::STOP);
        *command = RobotCommand::stop(state.robot(), reason);
        (*slot, *intent) = (state, RobotIntent::default());
    }
}
