//! One worker's share of the control: from a fleet's states to verified commands.
//!
//! For each robot that it owns, a [`RobotGroup`] finds the neighbours, asks the guidance for a
//! reference and a speed cap, computes the certificates, fills the programme, solves it, verifies the
//! solution, checks the command once more against the bodies themselves, and returns a command or a
//! stop with its reason. Which robots share a group changes nothing: a robot's decision depends on the
//! common states and its own memory only.
//!
//! Reads a slice of [`RobotState`], one for each place of the fleet; writes one [`Decision`] a place.
//! Who stands in a place and where it is to go is read from the state as well, so that robots and goals
//! may change between two periods and the same states always give the same decisions. All memory is
//! allocated by [`RobotGroup::new`]; a solve with the exact solver allocates nothing and cannot panic on
//! data.

mod bodies;
mod check;
mod law;
pub mod printed;
mod robot;
mod robots;
mod rows;
mod seat;
mod shelf;
mod told;

pub(crate) use law::UNTRUSTED_PERIODS;
pub use robot::Remembered;
pub use robots::Robots;
pub use shelf::{PreparedRoute, RouteShelf, RouteWork};

use crate::audit::Recorder;
use crate::config::{Config, ControllerConfig, SolverKind};
use crate::document::names;
use crate::geometry::{Arcs, Pose};
use crate::guidance::{Listed, Predictions};
use crate::neighbours::{Neighbourhood, Surroundings};
use crate::programme::{Programme, Solution};
use crate::solver::{ClarabelSolver, ExactSolver, Outcome, Solver};
use crate::wire::{RobotCheckpoint, RobotCommand, RobotIntent, RobotState, RobotTelemetry};
use law::{Law, Survey};
use robot::RobotController;
use robots::TOGETHER;
use std::ops::Range;
use std::sync::Arc;

/// So many robots ahead of the one that decides, memory is asked for.
const AHEAD: usize = 2;

/// When a command acts, seen from the state that it answers.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Timing {
    /// The command answers the state of `t_k` and acts from `t_{k+1}`: it is computed for the state
    /// that the commands in force will have led to. What the daemon does.
    #[default]
    LogicalExecutionTime,
    /// The command acts at once at `t_k`, as in the paper. For reproducing figures.
    Ideal,
}

names!(Timing { LogicalExecutionTime => "let", Ideal => "ideal" });

/// What goes out for one robot.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Decision {
    /// A verified command, or a stop and its reason.
    pub command: RobotCommand,
    /// What the others are told that the robot means to do.
    pub intent: RobotIntent,
    /// How it came about.
    pub telemetry: RobotTelemetry,
}

/// Why a group could not be built.
#[derive(Debug, thiserror::Error)]
pub enum ControllerError {
    /// Clarabel refused its set-up.
    #[error("Clarabel could not be set up for {rows} rows: {reason}")]
    Clarabel {
        /// Rows of each kind that were asked for.
        rows: usize,
        /// Clarabel's own words.
        reason: String,
    },
    /// The range of owned robots does not fit the fleet.
    #[error("robots {first}..{end} are not all in a fleet of {robots}")]
    NoSuchRobot {
        /// First index asked for.
        first: usize,
        /// One past the last index asked for.
        end: usize,
        /// Size of the fleet.
        robots: usize,
    },
}

/// Rows of each kind that one robot's programme can have: each body one for each direction of travel.
pub fn rows_max(control: &ControllerConfig) -> usize {
    2 * control.max_neighbours
}

/// The solver of a group.
enum AnySolver {
    Exact(ExactSolver),
    Clarabel(Box<ClarabelSolver>),
    Other(Box<dyn Solver>),
}

impl Solver for AnySolver {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        match self {
            Self::Exact(solver) => solver.solve(programme, solution),
            Self::Clarabel(solver) => solver.solve(programme, solution),
            Self::Other(solver) => solver.solve(programme, solution),
        }
    }
}

/// Memory that the robots of a group use in turn.
struct Workspace {
    around: Surroundings,
    near: Neighbourhood,
    /// Those of them that the guidance is shown.
    listed: Listed,
    predictions: Predictions,
    /// Those whose rows can bind, and obstacles.
    bodies: Vec<bodies::Body>,
    programme: Programme,
    solution: Solution,
    solver: AnySolver,
    recorder: Option<Recorder>,
    shelf: Option<Arc<RouteShelf>>,
}

/// The robots that one worker owns, with their guidance memory and the worker's solver.
pub struct RobotGroup {
    law: Law,
    owned: Vec<RobotController>,
    /// The fleet's controllers, of which this group answers a region in each period; without them it
    /// answers `owned`.
    robots: Option<Arc<Robots>>,
    predicted: Vec<RobotState>,
    workspace: Workspace,
}

impl RobotGroup {
    /// Shows every verified solution to the shadow audit as well.
    #[must_use]
    pub fn audited_by(mut self, recorder: Recorder) -> Self {
        self.workspace.recorder = Some(recorder);
        self
    }

    /// Asks `solver` instead of the configured one. What it answers is verified like every solution.
    #[must_use]
    pub fn solved_by(mut self, solver: Box<dyn Solver>) -> Self {
        self.workspace.solver = AnySolver::Other(solver);
        self
    }

    /// Takes the routes to new goals from `shelf`. Without one, or when it has none, they are built in
    /// the period that needs them.
    #[must_use]
    pub fn with_routes(mut self, shelf: Arc<RouteShelf>) -> Self {
        self.workspace.shelf = Some(shelf);
        self
    }

    /// Builds the controllers of the places `owned`: the robots of the scenario, then free places.
    ///
    /// # Errors
    /// When Clarabel refuses its set-up or the range does not fit the fleet.
    pub fn new(config: &Config, owned: Range<usize>) -> Result<Self, ControllerError> {
        let scenario = &config.scenario;
        let robots = config.places();
        if owned.start > owned.end || owned.end > robots {
            return Err(ControllerError::NoSuchRobot { first: owned.start, end: owned.end, robots });
        }
        let control = config.controller;
        let rows = rows_max(&control);
        let solver = match control.solver {
            SolverKind::Exact => AnySolver::Exact(ExactSolver),
            SolverKind::Clarabel => {
                let built = ClarabelSolver::new(rows)
                    .map_err(|e| ControllerError::Clarabel { rows, reason: e.to_string() })?;
                AnySolver::Clarabel(Box::new(built))
            }
        };
        let law = Law::new(config);
        let bodies_max = law.bodies_max();
        let largest_m = scenario.robots.iter().map(|robot| robot.radius_m).fold(0.0, f64::max);
        let speed_mps = law.limits.speed_mps();
        // About as far as one looks.
        let cell_m = 2.0 * (law.limits.safety_margin_m + 2.0 * (largest_m + law.period_s * speed_mps));
        Ok(Self {
            owned: owned
                .map(|index| {
                    let state =
                        scenario.robots.get(index).map_or_else(RobotState::vacant, RobotState::at_start);
                    RobotController::new(&law, &state, index)
                })
                .collect(),
            law,
            robots: None,
            predicted: vec![RobotState::default(); robots],
            workspace: Workspace {
                around: Surroundings::with_capacity(robots, cell_m),
                near: Neighbourhood::with_capacity(robots),
                listed: Listed::default(),
                predictions: Predictions::for_robots(robots),
                bodies: Vec::with_capacity(bodies_max),
                programme: Programme::with_capacity(control.weights.at(config.timing.period_s()), rows),
                solution: Solution::with_capacity(rows),
                solver,
                recorder: None,
                shelf: None,
            },
        })
    }

    /// A group that owns nobody and answers regions of the fleet, with controllers that it shares with
    /// other groups. Those that were lost in a panic are made anew.
    ///
    /// # Errors
    /// When Clarabel refuses its set-up or `robots` are not those of `config`.
    pub fn among(config: &Config, robots: Arc<Robots>) -> Result<Self, ControllerError> {
        robots.fits(config.places())?;
        let group = Self::new(config, 0..0)?;
        robots.refill(&group.law, config);
        Ok(Self { robots: Some(robots), ..group })
    }

    /// Whether it answers regions and not the robots that it owns.
    pub fn is_regional(&self) -> bool {
        self.robots.is_some()
    }

    /// Decides in period `tick` for the robots in the `parts` of the fleet in spatial order, which are asked for
    /// until none is left: cell by cell, the smaller index first. The order is that of the states alone, and so
    /// are the decisions, whoever makes them. `remember` hears what each robot remembered, then `each` what it decided; while
    /// they do, nobody else can decide for this robot. For groups [`among`](Self::among) others.
    pub fn solve_parts(
        &mut self,
        (tick, mut parts): (u64, impl FnMut() -> Option<Range<usize>>),
        fleet: &[RobotState],
        timing: Timing,
        mut remember: impl FnMut(usize, &Remembered),
        mut each: impl FnMut(usize, &Decision),
    ) {
        let Some(robots) = self.robots.clone() else { return };
        if !self.prepare(fleet, timing) {
            return;
        }
        // One robot's step begins where that of the one before ended.
        let (mut clock, mut decision) = (robot::now_ns(), Decision::default());
        let together = |part: Range<usize>| {
            part.clone().step_by(TOGETHER).map(move |first| first..part.end.min(first + TOGETHER))
        };
        for few in std::iter::from_fn(&mut parts).flat_map(together) {
            let Some(indices) = self.workspace.around.order().get(few.clone()) else { return };
            for (at, held) in few.zip(robots.hold(indices)) {
                let later = |ahead: usize| self.workspace.around.order().get(at + ahead);
                if let Some(&index) = later(TOGETHER) {
                    robots.expect_seat(index as usize);
                }
                if let Some(&index) = later(AHEAD) {
                    robots.expect(index as usize);
                }
                let Some(held) = held else { continue };
                held.answer(tick, |robot| {
                    remember(robot.index(), &Remembered(robot));
                    robot.decide(&self.law, &self.predicted, &mut self.workspace, &mut clock, &mut decision);
                    each(robot.index(), &decision);
                });
            }
        }
    }

    /// Calls `each` with every owned robot's index in the fleet and what it remembers.
    pub fn checkpoint(&self, each: &mut dyn FnMut(usize, &Remembered)) {
        for robot in &self.owned {
            each(robot.index(), &Remembered(robot));
        }
    }

    /// Puts the robot that `state` shows into the place `index`; whether the place is owned here. For a
    /// robot that joined during a run, before [`restore`](Self::restore).
    pub fn seat(&mut self, index: usize, state: &RobotState) -> bool {
        let robot = self.owned.iter_mut().find(|robot| robot.index() == index);
        robot.map(|robot| robot.follow(&self.law, state, None)).is_some()
    }

    /// Makes robot `index` of the fleet remember what it did at `checkpoint`; whether it is owned here
    /// and has that id. Of another robot, which stood there before, or at the start where a controller was
    /// made anew after a panic, it remembers nothing.
    pub fn restore(&mut self, index: usize, checkpoint: &RobotCheckpoint) -> bool {
        let robot = self.owned.iter_mut().find(|robot| robot.index() == index);
        robot.is_some_and(|robot| robot.restore(checkpoint))
    }

    /// As [`restore`](Self::restore), for an answer to period `tick` that nobody is to act on; of a group
    /// [`among`](Self::among) others as long as the robot has answered no later one.
    pub fn undo(&mut self, index: usize, tick: u64, before: &RobotCheckpoint) {
        match &self.robots {
            Some(robots) => robots.undo(index, tick, |robot| _ = robot.restore(before)),
            None => _ = self.restore(index, before),
        }
    }

    /// Decides for every owned robot; calls `each` with its index in the fleet.
    ///
    /// `fleet` are the states of `t_k` with the commands in force, one for each place: the robots of the
    /// scenario in its order, then the places beyond. A slice of another length decides nothing.
    pub fn solve(&mut self, fleet: &[RobotState], timing: Timing, mut each: impl FnMut(usize, &Decision)) {
        self.solve_watched(fleet, timing, |index, decision, _| each(index, decision));
    }

    /// [`solve`](Self::solve) that also shows the programme behind each decision; stale where the
    /// telemetry's status is `NotSolved`.
    pub fn solve_watched(
        &mut self,
        fleet: &[RobotState],
        timing: Timing,
        mut each: impl FnMut(usize, &Decision, &Programme),
    ) {
        if !self.prepare(fleet, timing) {
            return;
        }
        let (mut clock, mut decision) = (robot::now_ns(), Decision::default());
        for robot in &mut self.owned {
            robot.decide(&self.law, &self.predicted, &mut self.workspace, &mut clock, &mut decision);
            each(robot.index(), &decision, &self.workspace.programme);
        }
    }

    /// What is common to the robots in this period; whether `fleet` is of the right length.
    fn prepare(&mut self, fleet: &[RobotState], timing: Timing) -> bool {
        if fleet.len() != self.predicted.len() {
            return false;
        }
        self.law.begin(timing);
        let mut survey = Survey::in_place_of(&mut self.law.strangers);
        let law = &self.law;
        let parts = self.predicted.chunks_mut(Arcs::COUNT).zip(fleet.chunks(Arcs::COUNT)).enumerate();
        self.workspace.around.build(parts.flat_map(|(part, (predicted, now))| {
            let mut arcs = Arcs::default();
            for (k, robot) in now.iter().enumerate() {
                survey.see(law, part * Arcs::COUNT + k, robot);
                (arcs.x_m[k], arcs.y_m[k], arcs.theta_rad[k]) = (robot.x_m, robot.y_m, robot.theta_rad);
                (arcs.v_mps[k], arcs.omega_radps[k]) = (robot.v_mps, robot.omega_radps);
            }
            if timing == Timing::LogicalExecutionTime {
                arcs.advance(law.period_s);
            }
            for (k, (predicted, now)) in predicted.iter_mut().zip(now).enumerate() {
                *predicted = *now;
                (predicted.x_m, predicted.y_m) = (arcs.x_m[k], arcs.y_m[k]);
                predicted.theta_rad = arcs.theta_rad[k];
                let lead_m = law.reach(now).lead_m;
                if lead_m > 0.0 {
                    // Robots are compared where they come to rest on the commands that are out.
                    let pose = predicted.pose();
                    predicted
                        .set_pose(Pose { position_m: pose.position_m + pose.heading() * lead_m, ..pose });
                }
            }
            &*predicted
        }));
        self.law.end(survey);
        self.workspace.predictions.begin();
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use crate::wire::state_flags;

    /// One robot that is not ours, far away and long unseen, is heeded by all, and makes none of them
    /// look farther for the others.
    #[test]
    fn a_stranger_is_heeded_from_afar_and_enlarges_nobodys_sight() {
        let mut scenario = Scenario::builtin("swap8").unwrap();
        scenario.robots[0].foreign_speed_mps = Some(0.5);
        let mut fleet: Vec<_> = scenario.robots.iter().map(RobotState::at_start).collect();
        for robot in &mut fleet {
            robot.flags |= state_flags::VALID;
        }
        (fleet[0].x_m, fleet[0].y_m) = (500.0, 0.0);
        let config = Config::new(scenario);
        let decide = |fleet: &[RobotState]| {
            let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
            let mut speeds = Vec::new();
            group.solve(fleet, Timing::default(), |_, decision| speeds.push(decision.command.v_mps));
            (group.law.sight(0.2).all_m, speeds.split_off(1))
        };
        let (sight_m, speeds) = decide(&fleet);
        assert!(speeds.iter().any(|v_mps| *v_mps > 0.0), "{speeds:?}");
        for uncertainty_m in [300.0, 600.0, f64::INFINITY] {
            fleet[0].uncertainty_m = uncertainty_m;
            let (unseen_m, stopped) = decide(&fleet);
            assert_eq!(unseen_m, sight_m);
            if uncertainty_m > 500.0 {
                assert!(stopped.iter().all(|v_mps| *v_mps == 0.0), "{uncertainty_m}: {stopped:?}");
            } else {
                assert_eq!(stopped, speeds);
            }
        }
        // So it is with one of ours that may be anywhere.
        (fleet[0].uncertainty_m, fleet[1].uncertainty_m) = (0.0, f64::INFINITY);
        fleet[1].flags &= !state_flags::VALID;
        let (unseen_m, stopped) = decide(&fleet);
        assert_eq!(unseen_m, sight_m);
        assert!(stopped.iter().all(|v_mps| *v_mps == 0.0), "{stopped:?}");
    }
}
