//! What must hold after every period, and what is kept to tell of a seed that fails.

use std::collections::VecDeque;

use super::active::Active;
use super::kind::Kind;
use super::oracle::{Digest, Keeps};
use super::plan::{Class, Options, Plan};
use super::tally::{Counter, Outside, Tally};
use crate::channel::memory::Message;
use crate::controller::{RobotGroup, Timing};
use crate::geometry::Vec2;
use crate::model::Command;
use crate::runtime::Counts;
use crate::wire::{RobotCheckpoint, RobotCommand, RobotState, StopReason, checkpoint_flags, state_flags};

/// States and commands that are remembered, to be put together.
const REMEMBERED: usize = 8;
/// Failures of one seed and invariant that are told; more would be their consequences.
const FAILURES_MAX: usize = 2;

/// Something that did not hold.
#[derive(Debug, Clone, PartialEq, Eq, serde::Serialize)]
pub struct Failure {
    /// Period, counted from the start of the world.
    pub period: u64,
    /// Index of the robot, where there is one.
    pub robot: Option<usize>,
    /// Which of the invariants: `a` to `e`, or `l` for everybody arrives in the end.
    pub invariant: char,
    /// What was found.
    pub values: String,
}

/// How a kind of fault showed over a seed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Shown {
    /// Which.
    pub kind: Kind,
    /// How often it was done.
    pub applied: u64,
    /// Whether the counter that tells of it moved.
    pub moved: bool,
    /// Periods until the last robot that it concerned was driven again.
    pub recovery: u64,
}

/// States, commands and memories that went out since the last look.
type Published<'a> =
    (&'a VecDeque<Message<RobotState>>, &'a [Message<RobotCommand>], &'a VecDeque<Message<RobotCheckpoint>>);

/// Looks at a run.
pub(crate) struct Judge {
    keeps: Keeps,
    twin: Option<RobotGroup>,
    states: VecDeque<Message<RobotState>>,
    commands: VecDeque<Message<RobotCommand>>,
    before: Tally,
    was_silent: u64,
    silenced: u64,
    failures: Vec<Failure>,
    pub(crate) shown: Vec<Shown>,
    pub(crate) digest: Digest,
    digest_apart: Digest,
    /// Digest of the robots that no fault concerns, after each command sample.
    pub(crate) apart: Vec<u64>,
    trace: bool,
    pub(crate) story: Vec<String>,
    stopped: Vec<u32>,
    pub(crate) sabotage: super::sabotage::Sabotage,
}

impl Judge {
    pub(crate) fn new(plan: &Plan, options: &Options) -> Self {
        let config = &plan.config;
        Self {
            keeps: Keeps {
                limits: config.scenario.limits,
                gamma: config.controller.gamma,
                period_s: config.timing.period_s(),
                obstacles: config.scenario.obstacles.clone(),
            },
            twin: RobotGroup::new(config, 0..config.places()).ok(),
            states: VecDeque::new(),
            commands: VecDeque::new(),
            before: Tally::default(),
            was_silent: 0,
            silenced: 0,
            failures: Vec::new(),
            shown: Vec::new(),
            digest: Digest::default(),
            digest_apart: Digest::default(),
            apart: Vec::new(),
            trace: options.trace,
            story: Vec::new(),
            stopped: vec![0; config.places()],
            sabotage: super::sabotage::Sabotage::new(options),
        }
    }

    pub(crate) fn failures(&self) -> &[Failure] {
        &self.failures
    }

    pub(crate) fn note(&mut self, text: impl FnOnce() -> String) {
        if self.trace {
            self.story.push(text());
        }
    }

    pub(crate) fn fail(&mut self, period: u64, robot: Option<usize>, invariant: char, values: String) {
        self.note(|| format!("period {period}: ({invariant}) does not hold: {values}"));
        let alike = self.failures.iter().filter(|failure| failure.invariant == invariant).count();
        if alike < FAILURES_MAX {
            self.failures.push(Failure { period, robot, invariant, values });
        }
    }

    /// A new daemon counts from zero.
    pub(crate) fn restart(&mut self, outside: &Outside) {
        (self.was_silent, self.silenced) = (0, 0);
        self.before = Tally::new(&Counts::default(), 0, outside);
    }

    /// What went out: (b), (d), (e) and the digest.
    pub(crate) fn published(
        &mut self,
        plan: &Plan,
        (states, commands, checkpoints): Published<'_>,
        active: &mut [Active],
        period_of: impl Fn(u64) -> u64,
        ending: bool,
    ) {
        remember(&mut self.states, states.iter());
        remember(&mut self.commands, commands.iter());
        for message in commands {
            let period = period_of(message.header.stamp_ns);
            self.command(plan, message, period, active, ending);
        }
        for message in checkpoints {
            self.compute_again(message, &period_of);
        }
    }

    fn command(
        &mut self,
        plan: &Plan,
        message: &Message<RobotCommand>,
        period: u64,
        active: &mut [Active],
        ending: bool,
    ) {
        let header = message.header;
        self.digest.add(header.tick);
        let answered = |state: &&Message<RobotState>| {
            state.header.epoch == header.epoch && state.header.tick + 1 == header.tick
        };
        let fleet = self.states.iter().rev().find(answered).map(|state| std::sync::Arc::clone(&state.robots));
        for (index, command) in message.robots.iter().enumerate() {
            self.digest.add_command(command);
            if plan.apart.contains(&index) {
                self.digest_apart.add(header.tick);
                self.digest_apart.add_command(command);
            }
            let objection = match &fleet {
                Some(fleet) => self.keeps.objection(fleet, index, command),
                None if command.stop_reason == 0 => Some("driven without a state".to_owned()),
                None => None,
            };
            if let Some(values) = objection {
                self.fail(period, Some(index), 'b', values);
            }
            if let Some(reason) = StopReason::from_code(command.stop_reason) {
                self.stop(index, reason, period, (active, plan.class), ending);
            }
            let before = std::mem::replace(&mut self.stopped[index], command.stop_reason);
            if before != command.stop_reason {
                let name = StopReason::from_code(command.stop_reason).map_or("driven", StopReason::name);
                self.note(|| format!("period {period}: robot {index}: {name}"));
            }
        }
        if !plan.apart.is_empty() && !ending {
            self.apart.push(self.digest_apart.0);
        }
    }

    /// A stop has to have its reason in a fault that acts, or has not had its time to recover.
    fn stop(
        &mut self,
        robot: usize,
        reason: StopReason,
        period: u64,
        (active, class): (&mut [Active], Class),
        ending: bool,
    ) {
        if matches!(reason, StopReason::Vacant | StopReason::Foreign)
            || ending && matches!(reason, StopReason::Operator | StopReason::Finished)
            || class == Class::Crowd && reason == StopReason::Crowded
        {
            return;
        }
        let mut explained = false;
        for one in active.iter_mut().filter(|one| one.acts_within(period) && one.touches(robot)) {
            if one.kind().promise().stops.contains(&reason) {
                one.stopped = Some(period);
                explained = true;
            }
        }
        if !explained {
            let values =
                format!("told to stop ({}) for no fault that acts or may still recover", reason.name());
            self.fail(period, Some(robot), 'd', values);
        }
    }

    /// (e): the same states and the same memory give the same commands to the bit, whatever went wrong around
    /// them.
    fn compute_again(&mut self, checkpoint: &Message<RobotCheckpoint>, period_of: &impl Fn(u64) -> u64) {
        let (epoch, tick) = (checkpoint.header.epoch, checkpoint.header.tick);
        let state = self.states.iter().find(|one| one.header.epoch == epoch && one.header.tick == tick);
        let command =
            self.commands.iter().find(|one| one.header.epoch == epoch && one.header.tick == tick + 1);
        let (Some(state), Some(command), Some(twin)) = (state, command, &mut self.twin) else { return };
        for (index, (known, robot)) in checkpoint.robots.iter().zip(state.robots.iter()).enumerate() {
            if known.flags & checkpoint_flags::ANSWERED != 0 {
                twin.seat(index, robot);
                twin.restore(index, known);
            }
        }
        let mut wrong = None;
        twin.solve(&state.robots, Timing::LogicalExecutionTime, |index, decision| {
            let (Some(went_out), Some(known)) = (command.robots.get(index), checkpoint.robots.get(index))
            else {
                return;
            };
            let same = went_out.v_mps.to_bits() == decision.command.v_mps.to_bits()
                && went_out.omega_radps.to_bits() == decision.command.omega_radps.to_bits();
            let answered = known.flags & checkpoint_flags::ANSWERED != 0;
            if went_out.stop_reason == 0 && answered && !same {
                wrong = Some((index, *went_out, decision.command));
            }
        });
        if let Some((index, went_out, again)) = wrong {
            let period = period_of(command.header.stamp_ns);
            let values = format!("went out as {went_out:?}, computed again it is {again:?}");
            self.fail(period, Some(index), 'e', values);
        }
    }

    /// (c): what a fault moves, it moves; nothing else moves.
    pub(crate) fn counted(
        &mut self,
        period: u64,
        counts: &Counts,
        outside: &Outside,
        lines: &[String],
        active: &mut [Active],
    ) {
        self.silenced += counts.workers_silent.saturating_sub(self.was_silent);
        self.was_silent = counts.workers_silent;
        let now = Tally::new(counts, self.silenced, outside);
        let before = std::mem::replace(&mut self.before, now);
        let moved: Vec<(Counter, u64)> = self.before.moved(&before).collect();
        for (counter, by) in moved {
            #[cfg(test)]
            if self.sabotage.hides_counters {
                continue;
            }
            let total = self.before.get(counter);
            self.note(|| format!("period {period}: {counter} +{by}, now {total}"));
            let mut explained = counter == Counter::Stop(StopReason::Crowded);
            for one in active
                .iter_mut()
                .filter(|one| one.acts_within(period) || one.acts_within(period.saturating_sub(1)))
            {
                let promise = one.kind().promise();
                let stop = matches!(counter, Counter::Stop(reason) if promise.stops.contains(&reason));
                explained |= stop || promise.counters.contains(&counter);
                one.moved |= promise.counters.first() == Some(&counter);
            }
            if !explained {
                self.fail(period, None, 'c', format!("{counter} moved by {by}, and no fault explains it"));
            }
        }
        for line in lines {
            self.note(|| format!("period {period}: log: {line}"));
            for one in active.iter_mut() {
                one.said |= one.kind().promise().says.is_some_and(|text| line.contains(text));
            }
        }
    }

    /// Faults whose time is over have shown what they had to.
    pub(crate) fn expire(&mut self, period: u64, active: &mut Vec<Active>) {
        let mut gone = Vec::new();
        active.retain(|one| {
            // One more period, for what is counted and logged after the fact.
            let over = one.until.saturating_add(1) < period;
            if over {
                gone.push(one.clone());
            }
            !over
        });
        for one in &gone {
            self.leave(period, one);
        }
    }

    /// What a fault has shown in the end.
    fn leave(&mut self, period: u64, one: &Active) {
        let promise = one.kind().promise();
        if one.kind() == Kind::Begin {
            return;
        }
        self.shown.push(Shown {
            kind: one.kind(),
            applied: one.applied,
            moved: one.moved,
            recovery: one.recovery(),
        });
        if one.applied == 0 || !one.armed || one.shadowed {
            return;
        }
        let named = promise.counters.first().filter(|_| promise.named);
        if let Some(counter) = named.filter(|_| !one.moved) {
            self.fail(period, None, 'c', format!("{} was done, and {counter} did not move", one.fault));
        }
        if let Some(text) = promise.says.filter(|_| promise.named && !one.said) {
            self.fail(period, None, 'c', format!("{} was done, and no log line says \"{text}\"", one.fault));
        }
    }

    /// Whether everybody who can has arrived and stands.
    pub(crate) fn settled(&self, plan: &Plan, goals_m: &[Vec2]) -> bool {
        self.away(plan, goals_m).next().is_none()
    }

    pub(crate) fn who_is_away(&self, plan: &Plan, goals_m: &[Vec2]) -> String {
        let names: Vec<String> = self.away(plan, goals_m).map(|index| index.to_string()).collect();
        format!("robots {} have not arrived", names.join(", "))
    }

    fn away<'a>(&'a self, plan: &'a Plan, goals_m: &'a [Vec2]) -> impl Iterator<Item = usize> + 'a {
        let excused = |index: usize| match plan.class {
            // Nobody promises that they get out of each other's way, or through the walls.
            // A foreign robot may stand in the way for ever.
            Class::Crowd | Class::Coincident | Class::Overlap | Class::Foreign => true,
            Class::Boxed => index == 0,
            _ => false,
        };
        let fleet = self.states.back();
        let away = move |index: &usize| {
            let Some(state) = fleet.and_then(|fleet| fleet.robots.get(*index)) else { return true };
            let off_m = (state.position_m() - goals_m[*index]).norm();
            !state.has(state_flags::VALID)
                || off_m > plan.config.scenario.tolerance_m
                || state.command() != Command::STOP
        };
        (0..goals_m.len()).filter(move |index| !excused(*index)).filter(away)
    }
}

fn remember<'a, R: crate::channel::Record>(
    known: &mut VecDeque<Message<R>>,
    new: impl Iterator<Item = &'a Message<R>>,
) {
    for message in new {
        if known.len() == REMEMBERED {
            known.pop_front();
        }
        known.push_back(message.clone());
    }
}
