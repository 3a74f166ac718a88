use serde::Serialize;

use super::link::Queue;
use super::{Link, Outgoing};
use crate::actuation::Refusal;
use crate::config::Config;
use crate::figures::Clearances;
use crate::geometry::{Pose, TimedArc, Vec2};
use crate::model::{RobotId, RobotSpec};
use crate::plant::Plant;
use crate::scenario::Scenario;
use crate::wire::{CommandHeader, RobotCommand, RobotState, StopReason, state_flags};

/// What became of the commands, all robots together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Commands {
    /// Commands that the robots' gates took.
    pub accepted: u64,
    /// Commands that had expired when they came.
    pub expired: u64,
    /// Commands that came after their time had begun, or after one that was missed: the robots stood.
    pub missed: u64,
    /// Commands that were refused for another reason: old, out of order, beyond the limits.
    pub refused: u64,
    /// Samples of commands that had changed in memory on their way, and were not looked at.
    pub corrupt: u64,
    /// Times that a robot's command expired and there was no other: it stopped.
    pub ran_out: u64,
}

/// One robot at the end.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct RobotReport {
    /// Its id.
    pub id: u32,
    /// Whether it is where it was to go.
    pub arrived: bool,
    /// True position, m.
    pub x_m: f64,
    /// True position, m.
    pub y_m: f64,
    /// True heading, rad.
    pub theta_rad: f64,
}

/// What the robots of one process did.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Name of the scenario.
    pub scenario: String,
    /// Each robot.
    pub robots: Vec<RobotReport>,
    /// How many of them are where they were to go.
    pub arrived: usize,
    /// Pairs of them, or of one and an obstacle, that came closer than they may; over continuous time
    /// and true positions.
    pub violations: usize,
    /// Minimum over continuous time of the distance beyond the required one, m; null when there is no
    /// pair.
    pub min_clearance_m: Option<f64>,
    /// What became of the commands.
    pub commands: Commands,
    /// Observations that went out.
    pub observations_sent: u64,
    /// Observations that the link lost.
    pub observations_lost: u64,
    /// Runs of the daemon that commands came from.
    pub epochs: u64,
}

/// The robots of one process.
#[derive(Debug, Clone)]
pub struct RemoteRobots {
    scenario: Scenario,
    period_ns: u64,
    other_period_ns: Option<u64>,
    plant: Plant,
    queue: Queue,
    goals_m: Vec<Vec2>,
    commanded: Vec<bool>,
    /// What they did since it was last asked for.
    motions: Vec<Vec<TimedArc>>,
    clearances: Clearances,
    commands: Commands,
    sent: u64,
    lost: u64,
    epoch: u64,
    epochs: u64,
    ended: Option<u64>,
}

impl RemoteRobots {
    /// The robots of `scenario`, a part of that of `config`, at rest at their starts at `now_ns`.
    ///
    /// They are disturbed as `config` says, and let no command hold for longer than its period.
    pub fn new(config: &Config, scenario: Scenario, link: Link, now_ns: u64) -> Self {
        let period_ns = config.timing.period_ns;
        let plant = Plant::new(&scenario, period_ns, now_ns).moved_by(config.source.plant).disturbed(
            &scenario,
            &config.disturbance,
            period_ns,
        );
        let robots = scenario.robots.len();
        let sender = scenario.robots.first().map_or(0, |robot| robot.id.0);
        Self {
            period_ns,
            other_period_ns: None,
            plant,
            queue: Queue::new(link, sender),
            goals_m: scenario.robots.iter().map(|robot| robot.goal_m).collect(),
            commanded: vec![false; robots],
            motions: vec![Vec::new(); robots],
            clearances: Clearances::new(&scenario),
            commands: Commands::default(),
            sent: 0,
            lost: 0,
            epoch: 0,
            epochs: 0,
            ended: None,
            scenario,
        }
    }

    /// Their names, in the scenario's order.
    pub fn ids(&self) -> impl Iterator<Item = RobotId> {
        self.scenario.robots.iter().map(|robot| robot.id)
    }

    /// Moves everybody on to `now_ns` with what was heard before.
    pub fn advance(&mut self, now_ns: u64) {
        let motions = &mut self.motions;
        self.plant.advance_with(now_ns, |index, motion| motions[index].push(motion));
        for (index, before) in self.commanded.iter_mut().enumerate() {
            let now = self.plant.is_commanded(index);
            self.commands.ran_out += u64::from(*before && !now);
            *before = now;
        }
    }

    /// Takes a sample of commands that came at `now_ns`: what is not known by then cannot have acted.
    pub fn hear(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
        self.advance(now_ns);
        let hold_ns = header.valid_until_ns.saturating_sub(header.valid_from_ns);
        self.other_period_ns = (hold_ns != self.period_ns).then_some(hold_ns);
        if header.epoch > self.epoch {
            (self.epoch, self.epochs, self.ended) = (header.epoch, self.epochs + 1, None);
            let motions = &mut self.motions;
            self.plant.align(header.valid_from_ns, |index, motion| motions[index].push(motion));
        }
        let mut last = true;
        for (index, robot) in self.scenario.robots.iter().enumerate() {
            let Some(command) = commands.iter().find(|command| command.id == robot.id.0) else { continue };
            match self.plant.command(index, header, command, now_ns) {
                Ok(()) => self.commands.accepted += 1,
                Err(Refusal::Expired) => self.commands.expired += 1,
                Err(Refusal::Late | Refusal::OutOfStep) => self.commands.missed += 1,
                Err(_) => self.commands.refused += 1,
            }
            let reason = StopReason::from_code(command.stop_reason);
            last &= matches!(reason, Some(StopReason::Finished | StopReason::Operator));
        }
        if last && header.epoch == self.epoch {
            self.ended = Some(header.valid_until_ns);
        }
    }

    /// Learns how many samples of commands so far were corrupted, and therefore not heard.
    pub fn not_heard(&mut self, corrupt: u64) {
        self.commands.corrupt = corrupt;
    }

    /// Learns where its robots are to go now.
    pub fn follow(&mut self, states: &[RobotState]) {
        for (goal_m, robot) in self.goals_m.iter_mut().zip(&self.scenario.robots) {
            let own = |state: &&RobotState| state.id == robot.id.0 && !state.has(state_flags::VACANT);
            if let Some(state) = states.iter().find(own) {
                *goal_m = state.goal_m();
            }
        }
    }

    /// Looks where everybody is; the link carries it.
    pub fn observe(&mut self) {
        let seen = |(index, robot): (usize, RobotId)| {
            (robot, self.plant.seen(index).unwrap_or_default(), self.plant.holding(index))
        };
        let poses = self.ids().enumerate().map(seen).collect();
        self.queue.push(self.plant.time_ns(), poses);
    }

    /// The next observation that leaves the link by `now_ns`, if there is one.
    pub fn outgoing(&mut self, now_ns: u64) -> Option<Outgoing> {
        let outgoing = self.queue.pop(now_ns)?;
        let lost = u64::from(outgoing == Outgoing::Lost);
        (self.sent, self.lost) = (self.sent + 1 - lost, self.lost + lost);
        Some(outgoing)
    }

    /// What each robot did since the last call, and adds it to the clearances.
    pub fn take_motions(&mut self) -> Vec<Vec<TimedArc>> {
        self.clearances.add(&self.motions);
        let fresh = vec![Vec::new(); self.motions.len()];
        std::mem::replace(&mut self.motions, fresh)
    }

    /// True pose of the `index`-th robot.
    pub fn pose(&self, index: usize) -> Option<Pose> {
        self.plant.pose(index)
    }

    /// Robots that have a command that acts.
    pub fn commanded(&self) -> usize {
        self.commanded.iter().filter(|commanded| **commanded).count()
    }

    /// The newest run of the daemon that commands came from; 0 before the first.
    pub fn epoch(&self) -> u64 {
        self.epoch
    }

    /// For how long the last command was to hold, ns, if that is not the period that is configured here.
    pub fn other_period_ns(&self) -> Option<u64> {
        self.other_period_ns
    }

    /// When the last command of a run that its daemon has ended expires, ns.
    pub fn run_ended_ns(&self) -> Option<u64> {
        self.ended
    }

    /// What they did so far; the clearances up to when the motions were taken.
    pub fn report(&self) -> Report {
        let robot = |(index, robot): (usize, &RobotSpec)| {
            let pose = self.plant.pose(index).unwrap_or_default();
            let (x_m, y_m, theta_rad) = (pose.position_m.x, pose.position_m.y, pose.theta_rad);
            let left_m = (pose.position_m - self.goals_m[index]).norm();
            let arrived = robot.foreign_speed_mps.is_none() && left_m <= self.scenario.tolerance_m;
            RobotReport { id: robot.id.0, arrived, x_m, y_m, theta_rad }
        };
        let robots: Vec<_> = self.scenario.robots.iter().enumerate().map(robot).collect();
        Report {
            scenario: self.scenario.name.clone(),
            arrived: robots.iter().filter(|robot| robot.arrived).count(),
            robots,
            violations: self.clearances.violations(),
            min_clearance_m: self.clearances.min_clearance_m(),
            commands: self.commands,
            observations_sent: self.sent,
            observations_lost: self.lost,
            epochs: self.epochs,
        }
    }
}
