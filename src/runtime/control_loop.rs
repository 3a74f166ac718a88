use std::sync::Arc;

use super::board::Board;
use super::desk::Desk;
use super::event_count::{SPIN_LEAD_NS, Waiting};
use super::fallback::{answer, resting};
use super::room::Room;
use crate::channel::{ChannelError, Writer};
use crate::clock::Clock;
use crate::config::{Config, PublishAt, Wakeup};
use crate::disturbance::Remaining;
use crate::model::{Command, Limits, RobotId};
use crate::schedule::Schedule;
use crate::source::{Instant, StateSource};
use crate::telemetry::{PeriodRecord, Pool};
use crate::wire::{
    CommandHeader, RobotCommand, RobotIntent, RobotState, StateHeader, StopReason, TelemetryHeader,
    state_flags,
};

/// The loop: releases periods on an absolute schedule and publishes states and commands.
///
/// Period k, in this order (logical execution time):
///
/// 1. wake at `t_k`; if whole periods have passed, go on with the one whose time it is;
/// 2. ask the source for the poses at `t_k`, carry out what operators asked for, and publish **one**
///    state sample, which carries the commands committed for `[t_k, t_{k+1})`;
/// 3. wake the workers and sleep until they are done, at most to the deadline `t_{k+1} − margin`;
///    with [`PublishAt::Deadline`] always to the deadline;
/// 4. take what they staged and publish **one** command sample for `[t_{k+1}, t_{k+2})`; a robot
///    without a complete, admissible command gets a stop and the reason;
/// 5. with the period's duty done: take the memory of the next samples, and leave the record.
///
/// Commands that are ready only after `t_{k+1}` are thrown away: nobody knows what the robots did
/// meanwhile, and without a valid command they stand still.
pub(super) struct ControlLoop<C: Clock> {
    pub(super) clock: C,
    pub(super) schedule: Schedule,
    pub(super) epoch: u64,
    pub(super) tick_end: u64,
    pub(super) tolerance_m: f64,
    pub(super) limits: Limits,
    pub(super) states: Writer<RobotState>,
    pub(super) commands: Writer<RobotCommand>,
    pub(super) source: Box<dyn StateSource>,
    pub(super) board: Arc<Board>,
    pub(super) publish_at: PublishAt,
    pub(super) wakeup: Wakeup,
    pub(super) records: Arc<Pool<PeriodRecord>>,
    pub(super) desk: Arc<Desk>,
    pub(super) memory: LoopMemory,
}

/// What the loop remembers from period to period, all of it made before the first.
pub(super) struct LoopMemory {
    pub(super) states: Vec<RobotState>,
    pub(super) commands: Vec<RobotCommand>,
    /// What the robots mean to do with `commands`.
    pub(super) intents: Vec<RobotIntent>,
    /// Bits of [`state_flags`] that hold the whole fleet.
    pub(super) hold: u32,
    /// Requests that were refused here, after they had been found good.
    pub(super) refusals: u64,
    /// The period in which `commands` act, if they went out.
    committed: Option<u64>,
    /// Tick of the newest sample of commands that went out.
    sent: Option<u64>,
    /// What robots may still travel on earlier commands; `None` when the rows allow for nothing.
    pub(super) remaining: Option<Remaining>,
    /// What a new robot has to keep clear of.
    pub(super) room: Room,
    /// The first period that `remaining` does not know.
    counted_to: u64,
    send_failures: u64,
}

impl LoopMemory {
    pub(super) fn new(states: Vec<RobotState>) -> Self {
        let first = |s: &RobotState| {
            let vacant = s.has(state_flags::VACANT);
            RobotCommand::stop(s.robot(), if vacant { StopReason::Vacant } else { StopReason::Start })
        };
        let commands = states.iter().map(first).collect();
        let intents = vec![RobotIntent::default(); states.len()];
        Self {
            states,
            commands,
            intents,
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

/// Skipped periods that are counted one by one.
const SILENT_PERIODS_MAX: u64 = 256;

impl<C: Clock> ControlLoop<C> {
    /// Runs until a stop is asked for or the last period is over; returns why.
    pub(super) fn run(&mut self) -> StopReason {
        self.publish_start();
        let mut planned = self.schedule.first_tick();
        loop {
            self.wait_for_release(self.schedule.release_ns(planned));
            let woken_ns = self.clock.now_ns();
            let tick = self.schedule.resume(planned, woken_ns);
            let reason = self.board.stop_requested();
            if let Some(reason) = reason.or((tick >= self.tick_end).then_some(StopReason::Finished)) {
                self.publish_stop(tick, reason);
                self.board.end();
                return reason;
            }
            self.period(tick, tick - planned, woken_ns);
            planned = tick + 1;
        }
    }

    /// Sleeps until `release_ns`; the last microseconds it spins, if it may.
    fn wait_for_release(&self, release_ns: u64) {
        if self.wakeup != Wakeup::Spin {
            return self.clock.sleep_until(release_ns);
        }
        self.clock.sleep_until(release_ns.saturating_sub(SPIN_LEAD_NS));
        self.clock.spin_until(release_ns);
    }

    fn period(&mut self, tick: u64, skipped_periods: u64, woken_ns: u64) {
        let (header, on_time) = self.duty(tick, skipped_periods, woken_ns);
        self.prepare();
        self.record(&header, on_time);
    }

    /// Steps 2 to 4, and what the record says of them: its head, and whether the commands went out.
    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    fn duty(&mut self, tick: u64, skipped_periods: u64, woken_ns: u64) -> (TelemetryHeader, bool) {
        let release_ns = self.schedule.release_ns(tick);
        self.observe(tick, Instant { epoch: self.epoch, release_ns, now_ns: woken_ns });
        self.publish_states(tick, release_ns, woken_ns);
        self.board.release(tick);
        let published_ns = self.clock.now_ns();

        let deadline_ns = self.schedule.deadline_ns(tick);
        self.wait_for_workers(tick, deadline_ns);
        self.collect(tick);
        let on_time = self.publish_commands(tick, woken_ns);
        let answered_ns = self.clock.now_ns();

        let header = TelemetryHeader {
            epoch: self.epoch,
            tick,
            release_ns,
            release_lateness_ns: woken_ns.saturating_sub(release_ns),
            state_publish_ns: published_ns.saturating_sub(woken_ns),
            state_to_staged_ns: 0,
            state_to_command_ns: answered_ns.saturating_sub(woken_ns),
            deadline_lateness_ns: answered_ns.saturating_sub(deadline_ns),
            skipped_periods,
            fallback_commands: 0,
            lost_records: self.records.lost(),
            ..TelemetryHeader::default()
        };
        (header, on_time)
    }

    /// Returns at the deadline, or when every worker is done if that is what is waited for.
    fn wait_for_workers(&self, tick: u64, deadline_ns: u64) {
        match self.publish_at {
            PublishAt::Deadline => self.clock.sleep_until(deadline_ns),
            PublishAt::Complete => loop {
                let count = self.board.completions.count();
                if self.board.complete(tick) || self.clock.now_ns() >= deadline_ns {
                    break;
                }
                let waiting = Waiting::new(self.wakeup, 0, 0);
                self.board.completions.wait(&self.clock, waiting, count, deadline_ns);
            },
        }
    }

    /// The state at `t_k`: poses from the source, and the commands that are really in force.
    fn observe(&mut self, tick: u64, instant: Instant) {
        let memory = &mut self.memory;
        let in_force = memory.committed == Some(tick);
        let answers = memory.commands.iter().zip(&memory.intents);
        for (state, (command, intent)) in memory.states.iter_mut().zip(answers) {
            state.set_command(if in_force { command.command() } else { Command::STOP });
            state.intent = if in_force { *intent } else { resting(intent) };
        }
        self.source.observe(instant, &self.clock, &mut memory.states);
        // Who is added has to keep clear of what others still travel.
        self.memory.count_travel(tick);
        self.carry_out(tick, instant.now_ns);
        let held = self.memory.hold;
        for state in &mut self.memory.states {
            let arrived = (state.position_m() - state.goal_m()).norm() <= self.tolerance_m;
            let there = arrived && state.has(state_flags::VALID);
            state.flags &= !(state_flags::ARRIVED | state_flags::PAUSED | state_flags::STOPPED);
            state.flags |= if there { state_flags::ARRIVED } else { 0 };
            state.flags |= if state.has(state_flags::VACANT) { 0 } else { held };
        }
    }

    fn publish_states(&mut self, tick: u64, release_ns: u64, stamp_ns: u64) {
        let header = StateHeader {
            epoch: self.epoch,
            tick,
            stamp_ns,
            release_ns,
            period_ns: self.schedule.period_ns(),
            ..StateHeader::default()
        };
        let states = &self.memory.states;
        let sent = self.states.publish(|head, robots| {
            *head = header;
            robots.copy_from_slice(states);
        });
        self.memory.send_failures += u64::from(sent.is_err());
    }

    /// Takes what is staged for `tick`; what is not there or not admissible becomes a stop.
    fn collect(&mut self, tick: u64) {
        let (memory, corrupt) = (&mut self.memory, self.board.is_corrupt(tick));
        let missing = if corrupt { StopReason::Corrupt } else { StopReason::Deadline };
        let struck = self.board.is_struck(tick);
        let answers = memory.commands.iter_mut().zip(&mut memory.intents);
        for (index, (state, (command, intent))) in memory.states.iter().zip(answers).enumerate() {
            let staged = self.board.staging.take(index, tick).filter(|_| !struck);
            (*command, *intent) = answer(state, staged, missing, &self.limits, intent);
        }
    }

    /// Publishes the commands that act in the period after `tick`, unless that has begun; whether they
    /// went out.
    fn publish_commands(&mut self, tick: u64, state_stamp_ns: u64) -> bool {
        let stamp_ns = self.clock.now_ns();
        let valid_from_ns = self.schedule.release_ns(tick + 1);
        if stamp_ns >= valid_from_ns {
            self.memory.committed = None;
            return false;
        }
        self.send_commands(&CommandHeader {
            epoch: self.epoch,
            tick: tick + 1,
            stamp_ns,
            state_stamp_ns,
            valid_from_ns,
            valid_until_ns: self.schedule.release_ns(tick + 2),
            ..CommandHeader::default()
        })
    }

    /// The command of the first period: stand still until the first state is answered.
    fn publish_start(&mut self) {
        let first = self.schedule.first_tick();
        let stamp_ns = self.clock.now_ns();
        self.send_commands(&CommandHeader {
            epoch: self.epoch,
            tick: first,
            stamp_ns,
            state_stamp_ns: stamp_ns,
            valid_from_ns: self.schedule.release_ns(first),
            valid_until_ns: self.schedule.release_ns(first + 1),
            ..CommandHeader::default()
        });
        self.prepare();
    }

    /// A last command that acts at once and stops everybody.
    fn publish_stop(&mut self, tick: u64, reason: StopReason) {
        for command in &mut self.memory.commands {
            if command.stop_reason != StopReason::Vacant as u32 {
                *command = RobotCommand::stop(RobotId(command.id), reason);
            }
        }
        let stamp_ns = self.clock.now_ns();
        self.send_commands(&CommandHeader {
            epoch: self.epoch,
            tick: tick.saturating_add(1),
            stamp_ns,
            state_stamp_ns: stamp_ns,
            valid_from_ns: stamp_ns,
            valid_until_ns: stamp_ns.saturating_add(self.schedule.period_ns()),
            ..CommandHeader::default()
        });
    }

    /// Sends the commands; whether they went out.
    fn send_commands(&mut self, header: &CommandHeader) -> bool {
        let memory = &mut self.memory;
        let header = &CommandHeader { follows: memory.sent.unwrap_or(header.tick), ..*header };
        let commands = &memory.commands;
        let sent = self.commands.publish(|head, robots| {
            *head = *header;
            robots.copy_from_slice(commands);
        });
        memory.send_failures += u64::from(sent.is_err());
        if let Err(ChannelError::NotLoaned { .. }) = sent {
            memory.committed = None;
            return false;
        }
        // A reader that could not be reached leaves the others theirs.
        memory.committed = Some(header.tick);
        memory.sent = Some(header.tick);
        self.source.commit(header, commands, header.stamp_ns);
        true
    }

    /// Takes the memory of the next samples: the two allocations of a period.
    fn prepare(&mut self) {
        for ready in [self.states.prepare(), self.commands.prepare()] {
            self.memory.send_failures += u64::from(ready.is_err());
        }
    }

    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    fn record(&self, header: &TelemetryHeader, published: bool) {
        let memory = &self.memory;
        self.records.write(|record| {
            record.header = *header;
            record.states.copy_from_slice(&memory.states);
            record.commands.copy_from_slice(&memory.commands);
            record.published = published;
            record.send_failures = memory.send_failures;
            record.rejections = self.source.rejections();
        });
    }
}
