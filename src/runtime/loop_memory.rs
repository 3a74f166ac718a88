use super::fallback::{Told, resting};
use super::room::Room;
use crate::config::Config;
use crate::disturbance::Remaining;
use crate::model::Command;
use crate::wire::{RobotCommand, RobotIntent, RobotState, StopReason, state_flags};

/// Skipped periods that are counted one by one.
const SILENT_PERIODS_MAX: u64 = 256;

/// Robots whose states stay in the nearest cache while they are copied and changed.
const BLOCK: usize = 64;

/// What the loop remembers from period to period, all of it made before the first.
pub(super) struct LoopMemory {
    /// With the commands and intents below from the end of the period on, as if they were sure to act.
    pub(super) states: Vec<RobotState>,
    pub(super) commands: Vec<RobotCommand>,
    /// What the robots mean to do with `commands`.
    pub(super) intents: Vec<RobotIntent>,
    /// The heads of the states that were published.
    pub(super) told: Vec<Told>,
    /// Bits of [`state_flags`] that hold the whole fleet.
    pub(super) hold: u32,
    /// Requests that were refused here, after they had been found good.
    pub(super) refusals: u64,
    /// The period in which `commands` act, if they went out.
    pub(super) committed: Option<u64>,
    /// Tick of the newest sample of commands that went out.
    pub(super) sent: Option<u64>,
    /// What robots may still travel on earlier commands; `None` when the rows allow for nothing.
    pub(super) remaining: Option<Remaining>,
    /// What a new robot has to keep clear of.
    pub(super) room: Room,
    /// The first period that `remaining` does not know.
    counted_to: u64,
    pub(super) send_failures: u64,
}

impl LoopMemory {
    pub(super) fn new(states: Vec<RobotState>) -> Self {
        let first = |s: &RobotState| {
            let vacant = s.has(state_flags::VACANT);
            RobotCommand::stop(s.robot(), if vacant { StopReason::Vacant } else { StopReason::Start })
        };
        let commands = states.iter().map(first).collect();
        let told = states.iter().map(Told::from).collect();
        let intents = vec![RobotIntent::default(); states.len()];
        Self {
            states,
            commands,
            intents,
            told,
            hold: 0,
            refusals: 0,
            committed: None,
            sent: None,
            remaining: None,
            room: Room::default(),
            counted_to: 0,
            send_failures: 0,
        }
    }

    /// With the fleet held from the first period on, by these bits of [`state_flags`].
    pub(super) fn held(self, hold: u32) -> Self {
        Self { hold, ..self }
    }

    /// Keeps count of what robots may still travel on commands that act late, within `bounds`.
    pub(super) fn allowing_for(self, config: &Config) -> Self {
        let (robots, bounds, period_s) = (self.states.len(), &config.robust, config.timing.period_s());
        let remaining = (!bounds.is_none()).then(|| Remaining::new(robots, bounds, period_s));
        Self { remaining, room: Room::new(config), ..self }
    }

    /// Copies the states as they are to `record`, where there is one, and lets them carry the commands and intents
    /// of the next period.
    pub(super) fn carry_on(&mut self, mut record: Option<&mut [RobotState]>) {
        let answers = self.commands.chunks(BLOCK).zip(self.intents.chunks(BLOCK));
        for (block, (states, (commands, intents))) in self.states.chunks_mut(BLOCK).zip(answers).enumerate() {
            let into = record.as_mut().and_then(|record| record.chunks_mut(BLOCK).nth(block));
            if let Some(into) = into {
                into.copy_from_slice(states);
            }
            for (state, (command, intent)) in states.iter_mut().zip(commands.iter().zip(intents)) {
                state.set_command(command.command());
                state.intent = *intent;
            }
        }
    }

    /// The commands did not go out: nobody has one.
    pub(super) fn stand(&mut self) {
        for (state, intent) in self.states.iter_mut().zip(&self.intents) {
            state.set_command(Command::STOP);
            state.intent = resting(intent);
        }
    }

    /// Tells the states what is left to travel at the start of `tick`, and counts the commands that
    /// they hold over it.
    pub(super) fn count_travel(&mut self, tick: u64) {
        let Some(remaining) = &mut self.remaining else { return };
        // Of the periods since the last one only the first can have had commands; nothing is left
        // after some dozens without.
        let first = self.counted_to.max(tick.saturating_sub(SILENT_PERIODS_MAX));
        for skipped in first..tick {
            for (index, command) in self.commands.iter().enumerate() {
                let held = self.committed == Some(skipped);
                remaining.hold(index, if held { command.command() } else { Command::STOP });
            }
        }
        for (index, state) in self.states.iter_mut().enumerate() {
            if !state.has(state_flags::FOREIGN) {
                // On top of how far one that is not heard may be from its pose.
                state.uncertainty_m += remaining.travel_m(index);
            }
            remaining.hold(index, state.command());
        }
        self.counted_to = tick + 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::RobotId;

    /// Blocks that are full, and a last one that is not: the record has the states of before, and each robot
    /// its own command afterwards.
    #[test]
    fn each_state_is_recorded_and_carries_its_own_command_on() {
        for robots in [1, BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK, 2 * BLOCK + 2] {
            let state = |n: usize| RobotState { x_m: n as f64, v_mps: -1.0, ..RobotState::default() };
            let before: Vec<RobotState> = (0..robots).map(state).collect();
            for recorded in [true, false] {
                let mut memory = LoopMemory::new(before.clone());
                for n in 0..robots {
                    let command = Command { v_mps: n as f64, omega_radps: -(n as f64) };
                    memory.commands[n] = RobotCommand::verified(RobotId(0), command);
                    memory.intents[n].speed_mps = n as f64 + 0.5;
                }
                let mut record = vec![RobotState::default(); robots];
                memory.carry_on(recorded.then_some(&mut record[..]));
                assert_eq!(record == before, recorded, "{robots}");
                for (n, state) in memory.states.iter().enumerate() {
                    let n = n as f64;
                    let carried = (state.x_m, state.v_mps, state.omega_radps, state.intent.speed_mps);
                    assert_eq!(carried, (n, n, -n, n + 0.5), "{robots}");
                }
                memory.stand();
                assert!(memory.states.iter().all(|state| state.command() == Command::STOP));
            }
        }
    }
}
