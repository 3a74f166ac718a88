use std::sync::Arc;

use super::board::Board;
use super::desk::Desk;
use super::event_count::{SPIN_LEAD_NS, Waiting};
use super::fallback::{Told, answer};
use super::loop_memory::LoopMemory;
use crate::channel::{ChannelError, Writer};
use crate::clock::Clock;
use crate::config::{PublishAt, Wakeup};
use crate::model::{Limits, RobotId};
use crate::schedule::Schedule;
use crate::source::{Instant, StateSource};
use crate::telemetry::{PeriodRecord, Pool};
use crate::wire::{
    CommandHeader, RobotCommand, RobotState, StateHeader, StopReason, TelemetryHeader, state_flags,
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
/// 5. with the period's duty done: tell the source, take the memory of the next samples, leave the record, and
///    let the states carry what was sent.
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
        let (header, sent) = self.duty(tick, skipped_periods, woken_ns);
        if let Some(sent) = &sent {
            self.commit(sent);
        }
        self.prepare();
        self.record(&header, sent.is_some());
    }

    /// Steps 2 to 4; what the record says of them, and the head of the commands if they went out.
    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    fn duty(
        &mut self,
        tick: u64,
        skipped_periods: u64,
        woken_ns: u64,
    ) -> (TelemetryHeader, Option<CommandHeader>) {
        let release_ns = self.schedule.release_ns(tick);
        self.observe(tick, Instant { epoch: self.epoch, release_ns, now_ns: woken_ns });
        self.publish_states(tick, release_ns, woken_ns);
        self.board.release(tick);
        let published_ns = self.clock.now_ns();

        let deadline_ns = self.schedule.deadline_ns(tick);
        self.wait_for_workers(tick, deadline_ns);
        self.collect(tick);
        let sent = self.publish_commands(tick, woken_ns);
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
        (header, sent)
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
        if self.memory.committed != Some(tick) {
            self.memory.stand();
        }
        self.source.observe(instant, &self.clock, &mut self.memory.states);
        // Who is added has to keep clear of what others still travel.
        self.memory.count_travel(tick);
        self.carry_out(tick, instant.now_ns);
    }

    /// Says of every robot whether it has arrived and is held, and publishes the state.
    fn publish_states(&mut self, tick: u64, release_ns: u64, stamp_ns: u64) {
        let header = StateHeader {
            epoch: self.epoch,
            tick,
            stamp_ns,
            release_ns,
            period_ns: self.schedule.period_ns(),
            ..StateHeader::default()
        };
        let (tolerance_m, held) = (self.tolerance_m, self.memory.hold);
        let LoopMemory { states, told, .. } = &mut self.memory;
        let sent = self.states.publish_in_blocks(&header, |first, block| {
            let own = states.iter_mut().skip(first).zip(told.iter_mut().skip(first));
            for (record, (state, told)) in block.iter_mut().zip(own) {
                mark(state, tolerance_m, held);
                *record = *state;
                *told = Told::from(&*state);
            }
        });
        if let Err(ChannelError::NotLoaned { .. }) = sent {
            for (state, told) in states.iter_mut().zip(told) {
                mark(state, tolerance_m, held);
                *told = Told::from(&*state);
            }
        }
        self.memory.send_failures += u64::from(sent.is_err());
    }

    /// Takes what is staged for `tick`; what is not there or not admissible becomes a stop.
    fn collect(&mut self, tick: u64) {
        let (memory, corrupt) = (&mut self.memory, self.board.is_corrupt(tick));
        let missing = if corrupt { StopReason::Corrupt } else { StopReason::Deadline };
        let struck = self.board.is_struck(tick);
        let answers = memory.commands.iter_mut().zip(&mut memory.intents);
        for (index, (told, (command, intent))) in memory.told.iter().zip(answers).enumerate() {
            self.board.staging.expect(index + COLLECT_AHEAD);
            let staged = self.board.staging.take(index, tick).filter(|_| !struck);
            (*command, *intent) = answer(*told, staged, missing, &self.limits, intent);
        }
    }

    /// Publishes the commands that act in the period after `tick`, unless that has begun; their head if they
    /// went out.
    fn publish_commands(&mut self, tick: u64, state_stamp_ns: u64) -> Option<CommandHeader> {
        let stamp_ns = self.clock.now_ns();
        let valid_from_ns = self.schedule.release_ns(tick + 1);
        if stamp_ns >= valid_from_ns {
            self.memory.committed = None;
            return None;
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
        let sent = self.send_commands(&CommandHeader {
            epoch: self.epoch,
            tick: first,
            stamp_ns,
            state_stamp_ns: stamp_ns,
            valid_from_ns: self.schedule.release_ns(first),
            valid_until_ns: self.schedule.release_ns(first + 1),
            ..CommandHeader::default()
        });
        if let Some(sent) = &sent {
            self.commit(sent);
        }
        self.prepare();
        self.memory.carry_on(None);
    }

    /// A last command that acts at once and stops everybody.
    fn publish_stop(&mut self, tick: u64, reason: StopReason) {
        for command in &mut self.memory.commands {
            if command.stop_reason != StopReason::Vacant as u32 {
                *command = RobotCommand::stop(RobotId(command.id), reason);
            }
        }
        let stamp_ns = self.clock.now_ns();
        let sent = self.send_commands(&CommandHeader {
            epoch: self.epoch,
            tick: tick.saturating_add(1),
            stamp_ns,
            state_stamp_ns: stamp_ns,
            valid_from_ns: stamp_ns,
            valid_until_ns: stamp_ns.saturating_add(self.schedule.period_ns()),
            ..CommandHeader::default()
        });
        if let Some(sent) = &sent {
            self.commit(sent);
        }
    }

    /// Sends the commands; their head if they went out.
    fn send_commands(&mut self, header: &CommandHeader) -> Option<CommandHeader> {
        let memory = &mut self.memory;
        let header = CommandHeader { follows: memory.sent.unwrap_or(header.tick), ..*header };
        let commands = &memory.commands;
        let sent = self.commands.publish_in_blocks(&header, |first, block| {
            for (record, command) in block.iter_mut().zip(commands.iter().skip(first)) {
                *record = *command;
            }
        });
        memory.send_failures += u64::from(sent.is_err());
        if let Err(ChannelError::NotLoaned { .. }) = sent {
            memory.committed = None;
            return None;
        }
        // A reader that could not be reached leaves the others theirs.
        memory.committed = Some(header.tick);
        memory.sent = Some(header.tick);
        Some(header)
    }

    /// Tells the source what went out.
    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    fn commit(&mut self, sent: &CommandHeader) {
        self.source.commit(sent, &self.memory.commands, sent.stamp_ns);
    }

    /// Takes the memory of the next samples: the two allocations of a period.
    fn prepare(&mut self) {
        for ready in [self.states.prepare(), self.commands.prepare()] {
            self.memory.send_failures += u64::from(ready.is_err());
        }
    }

    #[cfg_attr(clearway_rtsan, sanitize(realtime = "nonblocking"))]
    fn record(&mut self, header: &TelemetryHeader, published: bool) {
        let (memory, rejections) = (&mut self.memory, self.source.rejections());
        let recorded = self.records.write(|record| {
            record.header = *header;
            record.commands.copy_from_slice(&memory.commands);
            record.published = published;
            record.send_failures = memory.send_failures;
            record.rejections = rejections;
            memory.carry_on(Some(&mut record.states));
        });
        if !recorded {
            self.memory.carry_on(None);
        }
    }
}

/// Answers that are asked for ahead of the one that is taken.
const COLLECT_AHEAD: usize = 16;

/// Says whether a robot has arrived, and is `held`.
#[inline]
fn mark(state: &mut RobotState, tolerance_m: f64, held: u32) {
    let arrived = (state.position_m() - state.goal_m()).norm() <= tolerance_m;
    let there = arrived && state.has(state_flags::VALID);
    state.flags &= !(state_flags::ARRIVED | state_flags::PAUSED | state_flags::STOPPED);
    state.flags |= if there { state_flags::ARRIVED } else { 0 };
    state.flags |= if state.has(state_flags::VACANT) { 0 } else { held };
}
