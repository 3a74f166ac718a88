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

mod check;
pub mod printed;
mod robot;
mod robots;
mod rows;
mod seat;
mod shelf;
mod told;

pub use robots::Robots;
pub use shelf::{PreparedRoute, RouteShelf, RouteWork};

use crate::audit::Recorder;
use crate::certificate::barrier::activation_m;
use crate::certificate::robust::{Margin, Reach};
use crate::certificate::{Decrease, HeadingLaw};
use crate::config::{Config, ControllerConfig, Profile, SolverKind};
use crate::document::names;
use crate::geometry::{Arcs, Pose, Way};
use crate::guidance::{self, Listed, Predictions};
use crate::model::{Disturbance, Limits, Obstacle};
use crate::neighbours::{Neighbourhood, Sight, Surroundings};
use crate::programme::{Programme, Solution};
use crate::solver::{ClarabelSolver, ExactSolver, Outcome, Solver};
use crate::wire::{RobotCheckpoint, RobotCommand, RobotIntent, RobotState, RobotTelemetry, state_flags};
use robot::RobotController;
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
#[derive(Debug, Clone, Copy, PartialEq)]
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

/// Other robots, and the ways on which they may stand, that one robot looks at for rows; more than any crowd has
/// within their reach, and with more the robot stops.
const BODIES_MAX: usize = 512;

/// Rows of each kind that one robot's programme can have: each body one for each direction of travel.
pub fn rows_max(control: &ControllerConfig) -> usize {
    2 * control.max_neighbours
}

/// Everything that is the same for all robots of a fleet.
#[derive(Debug, Clone)]
struct Law {
    control: ControllerConfig,
    limits: Limits,
    /// What the certificates ask for.
    decrease: Decrease,
    heading: HeadingLaw,
    guidance: guidance::Params,
    period_s: f64,
    /// From a state to the instant at which its answer acts, s.
    ahead_s: f64,
    tolerance_m: f64,
    obstacles: Vec<Obstacle>,
    /// Speed bound of each robot of the fleet that is not ours.
    foreign_speed_mps: Vec<Option<f64>>,
    /// The bounds on the disturbances that are allowed for; `None` when there are none.
    bounds: Option<Disturbance>,
    /// What they make of the rows, with this period's timing.
    margin: Option<Margin>,
    /// Age from which on an observation is not trusted, s.
    max_age_s: f64,
    /// Time for which a foreign robot moves while a command of ours may, from its state on, s.
    foreign_s: f64,
    /// How far a robot of ours without a trusted state may be from where it is taken to be, m: at least,
    /// and what disturbances add.
    untrusted_m: f64,
    lost_m: f64,
    /// Largest radius of the fleet, m, and how far at most a robot of ours may be from where it is seen,
    /// m: of this period's states.
    largest_radius_m: f64,
    unknown_m: f64,
    /// How far the largest look.
    largest_sight: Sight,
    /// Length of the longest way on which one of ours may stand, m; `None` when none may.
    longest_way_m: Option<f64>,
    /// Indices of the robots that everybody looks at however far: those that are not ours, and one of
    /// ours that may be anywhere. What is not known of these few would have all look at the whole fleet.
    strangers: Vec<usize>,
}

impl Law {
    fn new(config: &Config) -> Self {
        let (scenario, robots) = (&config.scenario, config.places());
        let (decrease, period_s) = (Decrease::of(&config.controller), config.timing.period_s());
        Self {
            control: config.controller,
            limits: scenario.limits,
            decrease,
            heading: HeadingLaw::new(period_s, scenario.limits.turn_rate_radps(), decrease),
            guidance: config.guidance,
            period_s,
            ahead_s: 0.0,
            tolerance_m: scenario.tolerance_m,
            obstacles: scenario.obstacles.clone(),
            bounds: (!config.robust.is_none()).then_some(config.robust),
            margin: None,
            max_age_s: config.source.max_age_or_default_ns(config.timing.period_ns) as f64 * 1e-9,
            foreign_s: 0.0,
            untrusted_m: 0.0,
            lost_m: 0.0,
            largest_radius_m: 0.0,
            unknown_m: 0.0,
            largest_sight: Sight { all_m: 0.0, nearest_m: 0.0, nearest: 0 },
            longest_way_m: None,
            strangers: Vec::with_capacity(robots),
            foreign_speed_mps: (0..robots)
                .map(|index| scenario.robots.get(index).and_then(|robot| robot.foreign_speed_mps))
                .collect(),
        }
    }

    /// Bodies that one robot looks at, at most.
    fn bodies_max(&self) -> usize {
        BODIES_MAX + self.obstacles.len()
    }

    /// Takes in what does not depend on the states of this period, before its robots are shown to a [`Survey`].
    fn begin(&mut self, timing: Timing) {
        let (ahead_s, foreign_periods) = match timing {
            Timing::LogicalExecutionTime => (self.period_s, 2.0),
            Timing::Ideal => (0.0, 1.0),
        };
        self.ahead_s = ahead_s;
        self.margin = self.bounds.map(|b| Margin::new(b, &self.limits, self.period_s, ahead_s));
        self.foreign_s = foreign_periods * self.period_s + self.margin.map_or(0.0, |m| m.rest_s());
        let silent_s = self.max_age_s + rows::UNTRUSTED_PERIODS * self.period_s;
        self.untrusted_m = rows::UNTRUSTED_PERIODS * self.period_s * self.limits.speed_mps();
        self.lost_m = self.margin.map_or(0.0, |m| m.lost_m(silent_s));
        self.strangers.clear();
    }

    /// Takes in what was seen of all robots.
    fn end(&mut self, survey: Survey) {
        let way_m = self.period_s * self.limits.speed_mps() * (1.0 + self.spread());
        self.strangers = survey.strangers;
        self.largest_radius_m = survey.largest_radius_m;
        self.longest_way_m = survey.longest_way_m;
        self.unknown_m = self.untrusted_m.max(survey.unseen_m + way_m) + self.lost_m;
        self.largest_sight = self.sight_of_radius(self.largest_radius_m);
    }

    /// Takes in what is the same for all robots in this period.
    #[cfg(test)]
    fn prepare(&mut self, fleet: &[RobotState], timing: Timing) {
        self.begin(timing);
        let mut survey = Survey::in_place_of(&mut self.strangers);
        for (index, robot) in fleet.iter().enumerate() {
            survey.see(self, index, robot);
        }
        self.end(survey);
    }

    /// κ of the commands; 0 without disturbances.
    fn spread(&self) -> f64 {
        self.margin.map_or(0.0, |margin| margin.spread())
    }

    /// How far a robot at rest may be from where it is seen, m.
    fn noise_m(&self) -> f64 {
        self.bounds.map_or(0.0, |bounds| bounds.position_m)
    }

    /// Where a robot may be around its predicted pose.
    fn reach(&self, robot: &RobotState) -> Reach {
        let Some(margin) = &self.margin else { return Reach::default() };
        if robot.has(state_flags::FOREIGN) {
            // It takes no commands: only where it was seen is in doubt.
            return Reach { error_m: margin.bounds().position_m, ..Reach::default() };
        }
        margin.reach(robot.uncertainty_m, robot.command())
    }

    /// Length of the way from where a robot was last seen to where the next command finds it, m.
    fn way_m(&self, robot: &RobotState) -> f64 {
        (robot.way_m + robot.v_mps.abs() * self.ahead_s).max(0.0) + self.reach(robot).lead_m
    }

    /// The way on which a predicted robot may stand.
    fn way(&self, predicted: &RobotState) -> Way {
        let length_m = self.way_m(predicted);
        Way { from_m: predicted.seen_m(), to_m: predicted.position_m(), length_m }
    }

    /// How far a robot that stands on its way may be from what is taken to be that way, m.
    fn stray_m(&self, robot: &RobotState) -> f64 {
        self.margin.map_or(0.0, |margin| {
            let reach = self.reach(robot);
            reach.lead_m + reach.extent_m() + margin.stray_m(self.way_m(robot), self.max_age_s + self.ahead_s)
        })
    }

    /// How far a robot of this radius looks for a stranger, m: to where its row can bind.
    fn sight_of_m(&self, radius_m: f64, index: usize, stranger: &RobotState) -> f64 {
        let moved_m = self.foreign_speed_mps[index].map_or(0.0, |speed_mps| self.foreign_s * speed_mps);
        let required = self.limits.safety_margin_m + radius_m + stranger.radius_m;
        self.rows_m(required + stranger.uncertainty_m + moved_m, 0.5)
    }

    /// How far from a robot a row that keeps `required_m` and leaves this share of the gap can bind, m.
    fn rows_m(&self, required_m: f64, share: f64) -> f64 {
        let rate = self.control.gamma.min(self.control.comfort_gamma);
        let extent = self.margin.map_or(0.0, |margin| 2.0 * margin.extent_max_m());
        let speed_mps = self.limits.speed_mps() * (1.0 + self.spread());
        activation_m(required_m + extent, speed_mps, self.period_s, rate, share)
    }

    /// How far a robot of this radius looks: for every row that can bind, and for the guidance.
    #[inline]
    fn sight(&self, radius_m: f64) -> Sight {
        // Most often all are of one size.
        if radius_m == self.largest_radius_m { self.largest_sight } else { self.sight_of_radius(radius_m) }
    }

    fn sight_of_radius(&self, radius_m: f64) -> Sight {
        let required = self.limits.safety_margin_m + radius_m + self.largest_radius_m;
        let robots_m = self.rows_m(required + self.unknown_m, 0.5);
        let ways_m = self.longest_way_m.map_or(0.0, |way_m| {
            let stray_m = self.margin.map_or(0.0, |margin| {
                2.0 * margin.extent_max_m() + margin.stray_m(way_m, self.max_age_s + self.ahead_s)
            });
            // As far as its end may be from its nearest point, and its bow.
            self.rows_m(required + stray_m + 1.5 * way_m, 1.0)
        });
        let rows_m = robots_m.max(ways_m);
        let printed_m = (required * required + printed::ACTIVATION_M2).sqrt();
        let all_m = if self.control.profile == Profile::Paper { rows_m.max(printed_m) } else { rows_m };
        Sight { all_m, nearest_m: self.guidance.sight_m, nearest: guidance::NEIGHBOURS_MAX }
    }
}

/// What one look at all robots of a period finds.
#[derive(Debug, Default)]
struct Survey {
    strangers: Vec<usize>,
    largest_radius_m: f64,
    longest_way_m: Option<f64>,
    /// Largest uncertainty of those that are no strangers, m.
    unseen_m: f64,
    /// Somebody may be anywhere.
    nowhere: bool,
}

impl Survey {
    /// Of nobody yet, with the room of this list.
    fn in_place_of(strangers: &mut Vec<usize>) -> Self {
        Self { strangers: std::mem::take(strangers), ..Self::default() }
    }

    /// Looks at one robot.
    #[inline]
    fn see(&mut self, law: &Law, index: usize, robot: &RobotState) {
        if robot.has(state_flags::MAY_STAND) {
            let way_m = law.way_m(robot);
            self.longest_way_m = Some(self.longest_way_m.map_or(way_m, |longest_m| longest_m.max(way_m)));
        }
        self.largest_radius_m = self.largest_radius_m.max(robot.radius_m);
        if robot.has(state_flags::VACANT) {
            return;
        }
        let foreign = law.foreign_speed_mps[index].is_some();
        // One that may be anywhere stops all; a second one changes nothing.
        let first = !robot.uncertainty_m.is_finite() && !std::mem::replace(&mut self.nowhere, true);
        if foreign || first {
            self.strangers.push(index);
        } else if robot.uncertainty_m.is_finite() {
            self.unseen_m = self.unseen_m.max(robot.uncertainty_m);
        }
    }
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
    bodies: Vec<rows::Body>,
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
        mut remember: impl FnMut(usize, RobotCheckpoint),
        mut each: impl FnMut(usize, &Decision),
    ) {
        let Some(robots) = self.robots.clone() else { return };
        if !self.prepare(fleet, timing) {
            return;
        }
        // One robot's step begins where that of the one before ended.
        let mut clock = robot::now_ns();
        for at in std::iter::from_fn(&mut parts).flatten() {
            let order = self.workspace.around.order();
            let Some(&index) = order.get(at) else { return };
            if let Some(&later) = order.get(at + AHEAD) {
                robots.expect(later as usize);
            }
            robots.with(index as usize, tick, |robot| {
                remember(robot.index(), robot.checkpoint());
                let decision = robot.decide(&self.law, &self.predicted, &mut self.workspace, &mut clock);
                each(robot.index(), &decision);
            });
        }
    }

    /// Calls `each` with every owned robot's index in the fleet and what it remembers.
    pub fn checkpoint(&self, each: &mut dyn FnMut(usize, RobotCheckpoint)) {
        for robot in &self.owned {
            each(robot.index(), robot.checkpoint());
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
        let mut clock = robot::now_ns();
        for robot in &mut self.owned {
            let decision = robot.decide(&self.law, &self.predicted, &mut self.workspace, &mut clock);
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
