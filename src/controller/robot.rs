//! One robot's controller: its guidance memory, and its way from the states to a decision.

use super::check::held_back;
use super::shelf::{Found, PreparedRoute, RouteShelf};
use super::told::{shows, told};
use super::{Decision, Law, Workspace, bodies, printed, rows};
use crate::certificate::PositionCertificate;
use crate::config::Profile;
use crate::geometry::{Vec2, unit};
use crate::guidance::{
    self, Ego, Guidance, Intent, Listed, Memory, OBSTACLES_MAX, ObstacleView, Predictions, Route,
};
use crate::model::{Command, RobotId};
use crate::neighbours::Nearby;
use crate::programme::{Certificate, Interval};
use crate::solver::{Outcome, Solver, optimal_speed};
use crate::verify::Residuals;
use crate::wire::{
    RobotCheckpoint, RobotCommand, RobotIntent, RobotState, RobotTelemetry, SolveStatus, StopReason,
    checkpoint_flags, state_flags, telemetry_flags,
};
use rustix::time::{ClockId, clock_gettime};

/// A solution with a larger scaled KKT residual never becomes a command.
const KKT_TOLERANCE: f64 = 1e-6;

const NS_PER_S: u64 = 1_000_000_000;

/// Obstacles further than this are of no interest to the guidance, m.
const OBSTACLE_RANGE_M: f64 = 4.0;

/// Where the goal stands in the words of a checkpoint, behind those of the guidance.
const GOAL_WORDS: std::ops::Range<usize> = RobotCheckpoint::WORDS - 2..RobotCheckpoint::WORDS;

pub(super) struct RobotController {
    index: usize,
    id: RobotId,
    radius_m: f64,
    memory: Memory,
    route: Route,
    /// A route that it took before the state that tells its goal.
    early: Option<Box<PreparedRoute>>,
    goal_m: Vec2,
    views: Vec<ObstacleView>,
    near_views: Vec<ObstacleView>,
    last_intent: RobotIntent,
    /// Was inside the tolerance for certain, and has not been outside for certain since.
    settled: bool,
    /// How far to look for neighbours first, m.
    look_m: f64,
}

/// What a robot remembers, to be written where it is kept: what was written elsewhere first would wait there to be
/// copied.
pub struct Remembered<'a>(pub(super) &'a RobotController);

impl Remembered<'_> {
    /// Writes all of it.
    #[inline]
    pub fn write(&self, to: &mut RobotCheckpoint) {
        self.0.write(to);
    }

    /// All of it.
    pub fn checkpoint(&self) -> RobotCheckpoint {
        let mut checkpoint = RobotCheckpoint::default();
        self.write(&mut checkpoint);
        checkpoint
    }
}

/// What a robot is to do in this period, before the programme.
struct Aim {
    /// Reference of the position certificate, m.
    reference_m: Vec2,
    guidance: Guidance,
    /// Stay: inside the tolerance of the goal and not asked away.
    holding: bool,
}

/// No guidance: the goal itself at full speed.
fn straight(goal_m: Vec2, v_max_mps: f64) -> Guidance {
    Guidance {
        reference_m: goal_m,
        speed_cap_mps: v_max_mps,
        beta_rad: 0.0,
        intent: Intent::default(),
        stalled: false,
        leave_goal: false,
    }
}

/// Why a robot is not driven at all, whatever its state.
fn stands(own: &RobotState) -> Option<StopReason> {
    let reasons = [
        (state_flags::VACANT, StopReason::Vacant),
        (state_flags::FOREIGN, StopReason::Foreign),
        (state_flags::STOPPED, StopReason::Stopped),
        (state_flags::PAUSED, StopReason::Paused),
    ];
    reasons.into_iter().find(|(flag, _)| own.has(*flag)).map(|(_, reason)| reason)
}

impl RobotController {
    /// For the robot that `state` shows first, which may also be none.
    pub(super) fn new(law: &Law, state: &RobotState, index: usize) -> Self {
        let keep_m = law.limits.safety_margin_m + state.radius_m;
        let views: Vec<ObstacleView> =
            law.obstacles.iter().map(|&obstacle| ObstacleView { obstacle, keep_m }).collect();
        Self {
            index,
            id: state.robot(),
            radius_m: state.radius_m,
            memory: Memory::default(),
            route: if state.has(state_flags::VACANT) {
                Route::build(&[], state.goal_m())
            } else {
                Route::build(&views, state.goal_m())
            },
            early: None,
            goal_m: state.goal_m(),
            near_views: Vec::with_capacity(views.len()),
            views,
            last_intent: RobotIntent::default(),
            settled: false,
            look_m: 0.0,
        }
    }

    pub(super) fn index(&self) -> usize {
        self.index
    }

    /// Writes what it remembers, and on the way to which goal. Everything else that a decision depends on is in
    /// the states and in `Law`.
    #[inline]
    fn write(&self, to: &mut RobotCheckpoint) {
        let settled = if self.settled { checkpoint_flags::SETTLED } else { 0 };
        (to.id, to.flags) = (self.id.0, checkpoint_flags::ANSWERED | settled);
        guidance::checkpoint::write(&self.memory, &mut to.words);
        to.words[GOAL_WORDS].copy_from_slice(&[self.goal_m.x.to_bits(), self.goal_m.y.to_bits()]);
    }

    /// Goes back to what it remembered; whether `checkpoint` is one of its own. One of another robot, which
    /// stood here before or at the start, is of no use to it: it begins anew, as it did then.
    pub(super) fn restore(&mut self, checkpoint: &RobotCheckpoint) -> bool {
        let own = checkpoint.id == self.id.0;
        if own {
            let [x, y] =
                [GOAL_WORDS.start, GOAL_WORDS.start + 1].map(|w| f64::from_bits(checkpoint.words[w]));
            if self.goal_m != Vec2::new(x, y) {
                self.goal_m = Vec2::new(x, y);
                self.route = Route::build(&self.views, self.goal_m);
            }
            self.memory = guidance::checkpoint::memory(&checkpoint.words);
            self.settled = checkpoint.flags & checkpoint_flags::SETTLED != 0;
        } else {
            self.forget();
        }
        own
    }

    fn forget(&mut self) {
        (self.memory, self.last_intent) = (Memory::default(), RobotIntent::default());
        self.settled = false;
    }

    /// Takes in who stands here and where it is to go: with another robot or another goal everything
    /// that was remembered is void. Whether it could: not when the shelf is ahead of the state, which then
    /// is not the newest.
    pub(super) fn follow(&mut self, law: &Law, own: &RobotState, shelf: Option<&RouteShelf>) -> bool {
        let (goal_m, same_body) = (own.goal_m(), own.radius_m == self.radius_m);
        if own.robot() == self.id && same_body && goal_m == self.goal_m {
            return true;
        }
        let keep_m = law.limits.safety_margin_m + own.radius_m;
        let vacant = own.has(state_flags::VACANT);
        let found = match shelf.filter(|_| !vacant) {
            Some(shelf) => shelf.exchange(self.index, (keep_m, goal_m), &mut self.route, &mut self.early),
            None => Found::Nothing,
        };
        if found == Found::Newer {
            return false;
        }
        (self.id, self.radius_m, self.goal_m) = (own.robot(), own.radius_m, goal_m);
        self.forget();
        for view in &mut self.views {
            view.keep_m = keep_m;
        }
        if found == Found::Nothing && !vacant {
            self.route = Route::build(&self.views, goal_m);
        }
        true
    }

    /// The whole step for one period, begun at `clock`, which afterwards says when it ended. What is decided is written
    /// into `decision` part by part: what was written elsewhere first would wait there to be copied.
    pub(super) fn decide(
        &mut self,
        law: &Law,
        fleet: &[RobotState],
        work: &mut Workspace,
        clock: &mut u64,
        decision: &mut Decision,
    ) {
        let own = &fleet[self.index];
        let current = self.follow(law, own, work.shelf.as_deref());
        let telemetry = &mut decision.telemetry;
        *telemetry =
            RobotTelemetry { id: self.id.0, clearance_m: f64::INFINITY, ..RobotTelemetry::default() };
        let command = if let Some(reason) = stands(own) {
            RobotCommand::stop(self.id, reason)
        } else if !current {
            // The next state is out: nobody waits for an answer to this one any more.
            RobotCommand::stop(self.id, StopReason::Deadline)
        } else if !own.has(state_flags::VALID) {
            RobotCommand::stop(self.id, StopReason::NoState)
        } else if own.has(state_flags::OUT_OF_STEP) {
            RobotCommand::stop(self.id, StopReason::OutOfStep)
        } else {
            match self.solve(law, fleet, work, telemetry) {
                Ok(command) => RobotCommand::verified(self.id, command),
                Err(reason) => RobotCommand::stop(self.id, reason),
            }
        };
        telemetry.stop_reason = command.stop_reason;
        (telemetry.v_mps, telemetry.omega_radps) = (command.v_mps, command.omega_radps);
        let ended = now_ns();
        telemetry.step_ns = ended.saturating_sub(std::mem::replace(clock, ended));
        (decision.command, decision.intent) = (command, self.last_intent);
    }

    fn solve(
        &mut self,
        law: &Law,
        fleet: &[RobotState],
        work: &mut Workspace,
        telemetry: &mut RobotTelemetry,
    ) -> Result<Command, StopReason> {
        let own = &fleet[self.index];
        let sight = law.sight(own.radius_m);
        let near = work.near.gather(&work.around, fleet, self.index, sight, self.look_m);
        // A little more than was needed this time.
        self.look_m = near.get(sight.nearest - 1).map_or(f64::INFINITY, |last| 1.06 * last.distance_m);
        for &stranger in &law.strangers {
            let range_m = law.sight_of_m(own.radius_m, stranger, &fleet[stranger]);
            work.near.add(fleet, self.index, stranger, range_m);
        }
        let near = work.near.list();
        telemetry.clearance_m = clearance(law, fleet, self.index, near);
        let aim =
            self.aim(law, fleet, (near, work.around.robots()), (&mut work.listed, &mut work.predictions));
        Self::note(law, &aim, telemetry);

        let ahead = unit(own.theta_rad);
        let binding = bodies::binding(law, near, sight.all_m);
        let bodies = match law.control.profile {
            Profile::Paper => &[],
            Profile::Certified | Profile::Exponential => {
                let found =
                    bodies::gather(law, fleet, self.index, binding, (law.bodies_max(), &mut work.bodies));
                found.ok_or(StopReason::Crowded)?
            }
        };
        let programme = &mut work.programme;
        programme.clear_rows();
        programme.omega_radps = Interval { min: law.limits.omega_min_radps, max: law.limits.omega_max_radps };
        let cap = if aim.holding { 0.0 } else { aim.guidance.speed_cap_mps.clamp(0.0, law.limits.v_max_mps) };
        programme.v_mps = Interval { min: law.limits.v_min_mps.max(-cap), max: cap };
        (programme.position, programme.heading) = Self::certificates(law, own, ahead, &aim, telemetry);

        if law.control.profile == Profile::Paper {
            let limit = printed::speed_limit(law, fleet, self.index, near, optimal_speed(programme));
            programme.v_mps.max = limit.ok_or(StopReason::Solver)?;
        } else if !rows::fill(law, ahead, bodies, programme) {
            return Err(StopReason::Crowded);
        }
        telemetry.safety_rows = u32::try_from(programme.safety.len()).unwrap_or(u32::MAX);

        let started = now_ns();
        let outcome = work.solver.solve(programme, &mut work.solution);
        telemetry.solve_ns = now_ns().saturating_sub(started);
        if outcome != Outcome::Solved {
            telemetry.status = SolveStatus::Failed as u32;
            return Err(StopReason::Solver);
        }
        let solution = &work.solution;
        let residual = Residuals::of(programme, solution).max();
        telemetry.kkt_residual = residual;
        telemetry.slack_position_m2 = solution.slack_position;
        telemetry.slack_heading = solution.slack_heading;
        telemetry.slack_comfort_m = solution.slack_comfort.iter().sum();
        let active = solution.dual_safety.iter().chain(&solution.dual_comfort).chain(&solution.dual_v);
        telemetry.active_rows = u32::try_from(active.filter(|d| **d > 0.0).count()).unwrap_or(u32::MAX);

        let mut command = Command {
            v_mps: solution.v_mps.clamp(programme.v_mps.min, programme.v_mps.max),
            omega_radps: solution.omega_radps.clamp(programme.omega_radps.min, programme.omega_radps.max),
        };
        let safe = if law.control.profile == Profile::Paper {
            law.limits.admits(command)
        } else {
            // An interior point solution may stand on the wrong side of a row by its tolerance.
            held_back(law, (own.pose(), ahead), bodies, &mut command)
        };
        let close = (command.v_mps - solution.v_mps).abs() <= KKT_TOLERANCE * (1.0 + solution.v_mps.abs());
        if !safe || !close || residual > KKT_TOLERANCE {
            telemetry.status = SolveStatus::Refused as u32;
            return Err(StopReason::Unverified);
        }
        telemetry.status = SolveStatus::Verified as u32;
        if let Some(recorder) = &mut work.recorder {
            recorder.offer(programme, solution);
        }
        Ok(command)
    }

    /// Asks the guidance.
    fn aim(
        &mut self,
        law: &Law,
        fleet: &[RobotState],
        (near, ground): (&[Nearby], &[u32]),
        (listed, predictions): (&mut Listed, &mut Predictions),
    ) -> Aim {
        let own = &fleet[self.index];
        let here = own.position_m();
        let doubt_m = law.noise_m();
        let off_m = (here - own.goal_m()).norm();
        // A robot that stands is where it was, whatever the noise says. One that still moves may leave.
        let stands = own.v_mps == 0.0 && own.uncertainty_m == 0.0;
        let inside = off_m <= law.tolerance_m - doubt_m;
        self.settled = stands && (inside || self.settled && off_m <= law.tolerance_m + doubt_m);
        let arrived = inside || self.settled;
        if !law.control.guidance || law.control.profile == Profile::Paper {
            return Aim {
                reference_m: self.goal_m,
                holding: arrived,
                guidance: straight(self.goal_m, law.limits.v_max_mps),
            };
        }
        let keep_m = law.limits.safety_margin_m + own.radius_m;
        // Every one that is not ours is a stranger.
        let strangers = !law.strangers.is_empty();
        let show =
            |index: usize| shows(law, &fleet[index], strangers && law.foreign_speed_mps[index].is_some());
        let shown = listed.list(here, (near, ground), &show, |radius_m| keep_m + radius_m + 2.0 * doubt_m);
        self.near_views.clear();
        self.near_views.extend(self.views.iter().filter(|o| o.clearance(here).1 < OBSTACLE_RANGE_M));
        self.near_views.sort_unstable_by(|a, b| a.clearance(here).1.total_cmp(&b.clearance(here).1));
        self.near_views.truncate(OBSTACLES_MAX);

        let (target_m, beyond_m) = self.route.target(here, &self.views);
        let ego = Ego {
            id: self.id.0,
            position_m: here,
            heading_rad: own.theta_rad,
            target_m,
            beyond_m,
            v_mps: own.v_mps,
            omega_radps: own.omega_radps,
            arrived,
        };
        let guidance = guidance::guide(
            &ego,
            &shown,
            &self.near_views,
            &law.guided,
            &law.guidance,
            predictions,
            &mut self.memory,
        );
        self.last_intent = told(&guidance.intent, target_m);
        Aim { reference_m: guidance.reference_m, holding: ego.arrived && !guidance.leave_goal, guidance }
    }

    /// The certificates (28) and (31) for the aim of a robot that heads along `ahead`.
    fn certificates(
        law: &Law,
        own: &RobotState,
        ahead: Vec2,
        aim: &Aim,
        telemetry: &mut RobotTelemetry,
    ) -> (Certificate, Certificate) {
        if aim.holding {
            // Inside the tolerance nothing is asked, and the heading is frozen: the bearing to the
            // goal is singular there.
            return (Certificate::default(), Certificate::default());
        }
        let offset = aim.reference_m - own.position_m();
        let distance_m = offset.norm();
        let along_m = offset.dot(&ahead);
        let p =
            PositionCertificate::new(along_m, distance_m, law.period_s, law.limits.v_max_mps, &law.decrease);
        // Of no direction, the one that has the angle 0.
        let towards = if distance_m > 0.0 { offset / distance_m } else { Vec2::x() };
        let error = Vec2::new(towards.dot(&ahead), towards.perp(&ahead));
        let h = match law.control.profile {
            Profile::Paper => law.heading.printed(error),
            Profile::Certified | Profile::Exponential => law.heading.certificate(error),
        };
        telemetry.lyapunov_position_m2 = p.lyapunov_m2;
        telemetry.decrease_position_m2 = p.decrease_m2;
        telemetry.lyapunov_heading = h.lyapunov;
        telemetry.decrease_heading = h.decrease;
        (
            Certificate { linear: p.linear, curvature: p.curvature, decrease: p.decrease_m2 },
            Certificate { linear: h.linear, curvature: h.curvature, decrease: h.decrease },
        )
    }

    fn note(law: &Law, aim: &Aim, telemetry: &mut RobotTelemetry) {
        let g = &aim.guidance;
        telemetry.reference_rotation_rad = g.beta_rad;
        telemetry.speed_cap_mps = g.speed_cap_mps.min(law.limits.v_max_mps);
        let bit = |on: bool, bit: u32| if on { bit } else { 0 };
        telemetry.flags = bit(g.stalled, telemetry_flags::STALLED)
            | bit(g.leave_goal, telemetry_flags::GIVING_WAY)
            | bit(aim.holding, telemetry_flags::HOLDING);
    }
}

/// min over the others of d − ρ at this instant, m.
fn clearance(law: &Law, fleet: &[RobotState], me: usize, near: &[Nearby]) -> f64 {
    let own = &fleet[me];
    let left =
        |n: &Nearby, radius_m: f64| n.distance_m - law.limits.safety_margin_m - own.radius_m - radius_m;
    let mut least_m = f64::INFINITY;
    for n in near {
        // Nearest first: from here on not even the largest robot leaves less.
        if left(n, law.largest_radius_m) >= least_m {
            break;
        }
        let left_m = left(n, fleet[n.index].radius_m);
        least_m = if left_m < least_m { left_m } else { least_m };
    }
    least_m
}

/// The monotonic clock, read through the vDSO without a system call, ns.
pub(super) fn now_ns() -> u64 {
    let now = clock_gettime(ClockId::Monotonic);
    now.tv_sec.unsigned_abs() * NS_PER_S + now.tv_nsec.unsigned_abs()
}

#[cfg(test)]
mod tests {
    use super::{Law, Nearby, clearance};
    use crate::config::Config;
    use crate::controller::{RobotGroup, Timing};
    use crate::evaluation::initial_fleet;
    use crate::neighbours::NO_PLACE;
    use crate::scenario::Scenario;
    use crate::wire::telemetry_flags;

    /// The look that ends early finds what a look at everybody finds.
    #[test]
    fn clearance_is_the_least_of_all_whatever_the_radii() {
        let config = Config::new(Scenario::builtin("swap8").unwrap());
        let mut law = Law::new(&config);
        let mut fleet = initial_fleet(&config);
        // The nearest is the smallest one, and the largest is not the last.
        for (k, radii_m) in
            [[0.1, 0.2, 0.3, 0.35], [0.3, 0.1, 0.1, 0.2], [0.2, 0.2, 0.2, 0.2]].iter().enumerate()
        {
            for (robot, radius_m) in fleet[1..].iter_mut().zip(radii_m) {
                robot.radius_m = *radius_m;
            }
            law.prepare(&fleet, Timing::default());
            let away_m = [0.7, 0.75, 0.9 - 0.02 * k as f64, 0.91];
            let near = [1, 2, 3, 4].map(|index| Nearby {
                distance_m: away_m[index - 1],
                id: 0,
                index,
                place: NO_PLACE,
            });
            let left = near.map(|n| {
                n.distance_m - law.limits.safety_margin_m - fleet[0].radius_m - fleet[n.index].radius_m
            });
            assert_eq!(
                clearance(&law, &fleet, 0, &near),
                left.into_iter().fold(f64::INFINITY, f64::min),
                "{k}"
            );
        }
        assert_eq!(clearance(&law, &fleet, 0, &[]), f64::INFINITY);
    }

    /// Noise may carry a robot that stands out of the tolerance, where it stays; its own way may not.
    #[test]
    fn a_robot_settles_only_once_it_stands() {
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.robust.position_m = 0.02;
        // Seen at these distances from its goal, one after the other, at these speeds: does it hold?
        let holds = |seen: [(f64, f64); 2]| {
            let mut group = RobotGroup::new(&config, 0..1).unwrap();
            let mut fleet = initial_fleet(&config);
            seen.map(|(off_m, v_mps)| {
                (fleet[0].x_m, fleet[0].y_m) = (fleet[0].goal_x_m - off_m, fleet[0].goal_y_m);
                (fleet[0].theta_rad, fleet[0].v_mps) = (0.0, v_mps);
                let mut held = false;
                group.solve(&fleet, Timing::Ideal, |_, decision| {
                    held = decision.telemetry.flags & telemetry_flags::HOLDING != 0;
                });
                held
            })
        };
        // The tolerance is 5 cm: less the doubt 3 cm, with it 7 cm.
        assert_eq!(holds([(0.02, 0.0), (0.06, 0.0)]), [true, true]);
        assert_eq!(holds([(0.04, 0.0), (0.06, 0.0)]), [false, false]);
        assert_eq!(holds([(0.02, 0.0), (0.08, 0.0)]), [true, false]);
        // On its way through: it has to come back.
        assert_eq!(holds([(0.02, 0.5), (0.06, 0.0)]), [true, false]);
    }
}
