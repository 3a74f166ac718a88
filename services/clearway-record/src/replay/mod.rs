//! Computes every recorded period again and compares the commands bit by bit.
//!
//! A period needs its state, what the controllers remembered before it (`checkpoint`), the
//! configuration, and the commands that went out. So each period stands for itself: a recording may
//! begin in the middle of a run and have gaps. What time or a person decided, and not the controller, is
//! counted by its reason and not compared.

mod compare;
mod window;

pub use compare::{Difference, Field, Value};

use crate::convert::{Checkpoint, Command, State};
use crate::reading::Piece;
use clearway::config::Config;
use clearway::controller::{ControllerError, RobotGroup, Timing};
use clearway::model::RobotSpec;
use clearway::wire::{RobotCommand, RobotState, StopReason, checkpoint_flags, state_flags};
use compare::{compare, expected};
use miette::Diagnostic;
use serde::Serialize;
use std::collections::BTreeMap;
use thiserror::Error;
use window::{Entry, Window};

/// Why a recording could not be computed again.
#[derive(Debug, Error, Diagnostic)]
pub enum ReplayError {
    /// Nobody says how the controllers were set.
    #[error("the recording holds no configuration")]
    #[diagnostic(help(
        "give the one that the daemon ran with: --config FILE, --scenario FILE|NAME, --set KEY=VALUE"
    ))]
    NoConfiguration,

    /// The configuration is another fleet's.
    #[error("the configuration does not fit the recording: {reason}")]
    #[diagnostic(help(
        "give the one that the daemon ran with: --config FILE, --scenario FILE|NAME, --set KEY=VALUE"
    ))]
    OtherFleet {
        /// What does not fit.
        reason: String,
    },

    /// The controllers could not be built.
    #[error(transparent)]
    Controller(#[from] ControllerError),
}

/// What came out.
#[derive(Debug, Clone, Default, PartialEq, Serialize)]
pub struct Outcome {
    /// Runs of the daemon in the recording.
    pub epochs: u64,
    /// Periods whose state was recorded.
    pub periods: u64,
    /// Periods in which at least one command was compared.
    pub compared_periods: u64,
    /// Commands compared.
    pub compared_commands: u64,
    /// Of these, the ones with a difference.
    pub different_commands: u64,
    /// The first difference.
    pub first_difference: Option<Difference>,
    /// Commands that no controller decided, by the reason that was recorded.
    pub not_decided: BTreeMap<&'static str, u64>,
    /// Periods that were not compared because their commands were too late to go out.
    pub too_late: u64,
    /// Periods that were not compared because their commands are not in the recording.
    pub without_commands: u64,
    /// Periods with robots that were not compared because what they remembered is not in the recording.
    pub without_memory: u64,
    /// Commands whose state is not in the recording.
    pub without_state: u64,
    /// Ticks between the first and the last that are not in the recording, skipped ones among them.
    pub missing_ticks: u64,
    /// Of these, the periods that the daemon skipped.
    pub skipped_periods: u64,
}

impl Outcome {
    /// Whether commands were compared and none differed.
    pub fn is_equal(&self) -> bool {
        self.compared_commands > 0 && self.different_commands == 0
    }
}

/// A replay under way.
pub struct Replay {
    config: Config,
    group: RobotGroup,
    /// The tick after which the group's memory is that of the daemon's controllers.
    follows: Option<(u64, u64)>,
    window: Window,
    last: Option<(u64, u64)>,
    outcome: Outcome,
    commands: Vec<RobotCommand>,
    /// Whether the fleet of this run was seen and fits.
    seated: bool,
}

impl Replay {
    /// With the controllers that `config` describes.
    ///
    /// # Errors
    /// [`ReplayError::Controller`].
    pub fn new(config: Config) -> Result<Self, ReplayError> {
        Ok(Self {
            group: group(&config)?,
            config,
            follows: None,
            window: Window::default(),
            last: None,
            outcome: Outcome::default(),
            commands: Vec::new(),
            seated: false,
        })
    }

    /// Goes on with another configuration, as at the start of another run.
    ///
    /// # Errors
    /// [`ReplayError::Controller`].
    pub fn configure(&mut self, config: Config) -> Result<(), ReplayError> {
        self.settle()?;
        self.group = group(&config)?;
        self.config = config;
        self.follows = None;
        self.seated = false;
        Ok(())
    }

    /// Takes the next piece of the recording.
    ///
    /// # Errors
    /// [`ReplayError::OtherFleet`].
    pub fn take(&mut self, piece: Piece) -> Result<(), ReplayError> {
        match piece {
            Piece::State(s) => {
                if !self.seated {
                    self.seat(&s)?;
                }
                let (epoch, tick) = (s.header.epoch, s.header.tick);
                self.window.entry(epoch, tick).state = Some(s);
            }
            Piece::Checkpoint(s) => {
                let (epoch, tick) = (s.header.epoch, s.header.tick);
                self.window.entry(epoch, tick).checkpoint = Some(s);
            }
            // Commands act one period after the state that they answer; the first answers none.
            Piece::Command(s) => {
                let epoch = s.header.epoch;
                match s.header.tick.checked_sub(1) {
                    Some(tick) => self.window.entry(epoch, tick).command = Some(s),
                    None => self.undecided(&s),
                }
            }
            _ => return Ok(()),
        }
        while let Some((epoch, tick, entry)) = self.window.ready() {
            self.period(epoch, tick, &entry)?;
        }
        Ok(())
    }

    /// How far it came, with what is at hand.
    pub fn outcome(&self) -> &Outcome {
        &self.outcome
    }

    /// The end of the recording.
    ///
    /// # Errors
    /// As [`Replay::take`].
    pub fn finish(mut self) -> Result<Outcome, ReplayError> {
        self.settle()?;
        Ok(self.outcome)
    }

    fn settle(&mut self) -> Result<(), ReplayError> {
        while let Some((epoch, tick, entry)) = self.window.oldest() {
            self.period(epoch, tick, &entry)?;
        }
        Ok(())
    }

    /// Checks that the configuration is this fleet's, and puts its robots into the places where the
    /// first state shows them: robots may have come and gone before.
    fn seat(&mut self, state: &State) -> Result<(), ReplayError> {
        let other = |reason| Err(ReplayError::OtherFleet { reason });
        let scenario = &self.config.scenario;
        let (wanted, places) = (scenario.robots.len(), state.robots.len());
        if wanted > places {
            return other(format!("it has {wanted} robots, the recording room for {places}"));
        }
        let period_ns = self.config.timing.period_ns;
        if period_ns != state.header.period_ns {
            return other(format!(
                "its period is {} µs, the recording's {} µs",
                period_ns / 1000,
                state.header.period_ns / 1000
            ));
        }
        let known = |robot: &RobotState| scenario.robots.iter().find(|spec| spec.id == robot.robot());
        for robot in state.robots.iter().filter(|robot| !robot.has(state_flags::VACANT)) {
            let foreign = robot.has(state_flags::FOREIGN);
            let fits = match known(robot) {
                Some(spec) => spec.foreign_speed_mps.is_some() == foreign,
                // One that was added later; a foreign one never is.
                None => !foreign && self.config.places() > wanted,
            };
            if !fits {
                return other(format!("it knows robot {} differently or not at all", robot.id));
            }
        }
        let seat = |robot: &RobotState| {
            known(robot).copied().unwrap_or(RobotSpec {
                id: robot.robot(),
                radius_m: robot.radius_m,
                start: robot.pose(),
                goal_m: robot.goal_m(),
                foreign_speed_mps: None,
            })
        };
        self.config.scenario.robots = state.robots.iter().map(seat).collect();
        self.group = group(&self.config)?;
        self.seated = true;
        Ok(())
    }

    /// Counts commands that nobody computed.
    fn undecided(&mut self, command: &Command) {
        let there = command.robots.iter().filter(|r| r.stop_reason != StopReason::Vacant as u32);
        for robot in there {
            *self.outcome.not_decided.entry(reason(robot.stop_reason)).or_default() += 1;
        }
    }

    /// One period with what there is of it.
    fn period(&mut self, epoch: u64, tick: u64, entry: &Entry) -> Result<(), ReplayError> {
        let Some(state) = &entry.state else {
            if let Some(command) = &entry.command {
                if command.robots.iter().all(is_nobodys) {
                    self.undecided(command);
                } else {
                    self.outcome.without_state += 1;
                }
            }
            return Ok(());
        };
        self.count(epoch, tick, entry.checkpoint.as_ref());
        if tick == 0 && self.follows.is_none_or(|(known, _)| known != epoch) {
            // Before the first period nobody remembers anything.
            self.group = group(&self.config)?;
            self.follows = Some((epoch, 0));
        }
        let remembered = self.restore(epoch, state, entry.checkpoint.as_ref());
        if !remembered.iter().any(|known| *known) {
            self.follows = None;
            self.not_compared(entry);
            return Ok(());
        }
        let commands = &mut self.commands;
        commands.clear();
        self.group.solve(&state.robots, Timing::LogicalExecutionTime, |_, decision| {
            commands.push(decision.command);
        });
        let next = tick.checked_add(1).filter(|_| remembered.iter().all(|known| *known));
        self.follows = next.map(|next| (epoch, next));
        let Some(sent) = &entry.command else {
            self.not_compared(entry);
            return Ok(());
        };
        self.compare(epoch, tick, state, sent, &remembered);
        Ok(())
    }

    fn count(&mut self, epoch: u64, tick: u64, checkpoint: Option<&Checkpoint>) {
        self.outcome.periods += 1;
        match self.last {
            Some((known, last)) if known == epoch => {
                let missing = tick.saturating_sub(last.saturating_add(1));
                self.outcome.missing_ticks += missing;
                let skipped = checkpoint.map_or(0, |c| c.header.skipped_periods);
                self.outcome.skipped_periods += skipped.min(missing);
            }
            _ => self.outcome.epochs += 1,
        }
        self.last = Some((epoch, tick));
    }

    /// Puts the controllers where they were before the period; which of them are.
    fn restore(&mut self, epoch: u64, state: &State, checkpoint: Option<&Checkpoint>) -> Vec<bool> {
        let follows = self.follows == Some((epoch, state.header.tick));
        let Some(checkpoint) = checkpoint else { return vec![follows; state.robots.len()] };
        let restore = |(index, robot): (usize, &RobotState)| {
            // Who has come this very period remembers nothing: its place was another's.
            self.group.seat(index, robot);
            checkpoint.robots.get(index).is_some_and(|memory| {
                self.group.restore(index, memory);
                memory.flags & checkpoint_flags::ANSWERED != 0
            })
        };
        state.robots.iter().enumerate().map(restore).collect()
    }

    fn not_compared(&mut self, entry: &Entry) {
        let late = entry.checkpoint.as_ref().is_some_and(|c| c.header.commands_published == 0);
        match &entry.command {
            None if late => self.outcome.too_late += 1,
            None => self.outcome.without_commands += 1,
            Some(command) if command.robots.iter().all(is_nobodys) => {
                self.undecided(command);
            }
            Some(_) => self.outcome.without_memory += 1,
        }
    }

    fn compare(&mut self, epoch: u64, tick: u64, state: &State, sent: &Command, remembered: &[bool]) {
        let (mut compared, mut forgotten) = (0, false);
        let limits = self.config.scenario.limits;
        for (index, recorded) in sent.robots.iter().enumerate() {
            let (Some(robot), Some(solved)) = (state.robots.get(index), self.commands.get(index)) else {
                continue;
            };
            if robot.has(state_flags::VACANT) && recorded.stop_reason == StopReason::Vacant as u32 {
                continue;
            }
            if is_outside(recorded.stop_reason) {
                *self.outcome.not_decided.entry(reason(recorded.stop_reason)).or_default() += 1;
                continue;
            }
            if !remembered[index] {
                forgotten = true;
                continue;
            }
            compared += 1;
            let solved = expected(robot, *solved, &limits);
            if let Some((field, recorded, solved)) = compare(recorded, &solved) {
                self.outcome.different_commands += 1;
                if self.outcome.first_difference.is_none() {
                    // The tick of the command sample, as it stands in the recording.
                    let (tick, robot) = (tick.saturating_add(1), robot.id);
                    self.outcome.first_difference =
                        Some(Difference { epoch, tick, robot, field, recorded, solved });
                }
            }
        }
        self.outcome.compared_commands += compared;
        self.outcome.compared_periods += u64::from(compared > 0);
        self.outcome.without_memory += u64::from(forgotten);
    }
}

fn group(config: &Config) -> Result<RobotGroup, ReplayError> {
    Ok(RobotGroup::new(config, 0..config.places())?)
}

/// Whether something else than the controller decided: the clock or a person.
fn is_outside(stop_reason: u32) -> bool {
    let outside = [StopReason::Start, StopReason::Deadline, StopReason::Operator, StopReason::Finished];
    StopReason::from_code(stop_reason).is_some_and(|reason| outside.contains(&reason))
}

fn reason(stop_reason: u32) -> &'static str {
    StopReason::from_code(stop_reason).map_or("unknown", StopReason::name)
}

/// Whether no controller had a say in it.
fn is_nobodys(command: &RobotCommand) -> bool {
    is_outside(command.stop_reason) || command.stop_reason == StopReason::Vacant as u32
}
