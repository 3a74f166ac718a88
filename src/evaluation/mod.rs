//! Closed loop under a virtual clock, as fast as the machine allows.
//!
//! The same controller as the daemon's, around the plant that `source.plant` names. Reads a [`Config`], writes one
//! [`Evaluation`]. Deterministic: everything but the measured times depends on the configuration
//! alone.

mod trace;
mod world;

pub use trace::{Contact, Other, Period, Sample, Trace, trace};

use crate::certificate::FiniteTime;
use crate::config::Config;
use crate::controller::{ControllerError, Decision, RobotGroup, Timing};
use crate::figures::{Accumulator, Arrival, ControlFigures, LatencyHistogram, LatencyNs};
use crate::model::{Command, RobotSpec};
use crate::programme::Programme;
use crate::wire::{RobotState, StopReason, state_flags};
use serde::Serialize;
use world::World;

/// The result of one closed-loop run: one object of the command `eval`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Evaluation {
    /// Name of the scenario.
    pub scenario: String,
    /// Name of the profile.
    pub profile: &'static str,
    /// Name of the solver.
    pub solver: &'static str,
    /// When commands acted.
    pub timing: &'static str,
    /// How the plant moved the robots.
    pub plant: &'static str,
    /// Robots that arrived within the closed-form bound (14) on the settling time, whatever the law.
    pub within_bound: usize,
    /// The same with the time for the first turn on the spot, which (14) does not know, taken off.
    pub within_bound_after_turn: usize,
    /// What the robots did.
    #[serde(flatten)]
    pub figures: ControlFigures,
    /// Robots that were told to stop by a fallback, summed over the periods.
    pub fallback_commands: u64,
    /// Time for the solver alone, ns.
    pub solve_ns: LatencyNs,
    /// Mean time for a robot's whole step, ns.
    pub step_ns_per_robot: u64,
    /// Time for the steps of all robots in one period, one after another on one core, ns.
    pub fleet_step_ns: LatencyNs,
}

impl Evaluation {
    /// Every robot arrived and no pair came closer than it may.
    pub fn passed(&self) -> bool {
        self.figures.arrived == self.figures.robots && self.figures.violations == 0
    }
}

/// Why a run could not start.
#[derive(Debug, thiserror::Error)]
pub enum EvaluationError {
    /// The controller could not be built.
    #[error(transparent)]
    Controller(#[from] ControllerError),
    /// A histogram could not be built.
    #[error("a histogram could not be set up: {0}")]
    Histogram(#[from] hdrhistogram::errors::CreationError),
}

/// The states at the start of a scenario, nobody moving.
pub fn initial_fleet(config: &Config) -> Vec<RobotState> {
    let observed = |robot: &RobotSpec| {
        let mut state = RobotState::at_start(robot);
        state.flags |= state_flags::VALID;
        state
    };
    let mut fleet: Vec<RobotState> = config.scenario.robots.iter().map(observed).collect();
    fleet.resize_with(config.places(), RobotState::vacant);
    fleet
}

/// How many arrived within (14) from V = ½d² at the start, and within it after the first turn.
///
/// (14) counts steps; under logical execution time the first of them begins one period late.
fn within_bound(config: &Config, timing: Timing, arrivals: impl Iterator<Item = Arrival>) -> (usize, usize) {
    let law = FiniteTime { c3: config.controller.c3, alpha: config.controller.alpha };
    let late = u64::from(timing == Timing::LogicalExecutionTime);
    arrivals.fold((0, 0), |(straight, turned), robot| {
        let steps = law.settling_bound(0.5 * robot.distance_m * robot.distance_m);
        let (Some(steps), Some(arrived_s)) = (steps, robot.arrived_s) else { return (straight, turned) };
        // Half a period: what begins on time does not depend on the last bit.
        let bound_s = ((steps + late) as f64 + 0.5) * config.timing.period_s();
        (
            straight + usize::from(arrived_s <= bound_s),
            turned + usize::from(arrived_s - robot.first_turn_s <= bound_s),
        )
    })
}

/// Runs `config.scenario` until everybody has arrived and stands, or its time is up.
///
/// `each` sees the states of every period with the commands that act over it.
///
/// # Errors
/// When the controller cannot be built.
pub fn run(
    config: &Config,
    timing: Timing,
    each: impl FnMut(u64, &[RobotState]),
) -> Result<Evaluation, EvaluationError> {
    run_watched(config, timing, each, |_, _| {})
}

/// [`run`] that also shows every decision with the programme behind it; the programme is stale where
/// the telemetry's status is `NotSolved`.
///
/// # Errors
/// As [`run`].
pub fn run_watched(
    config: &Config,
    timing: Timing,
    mut each: impl FnMut(u64, &[RobotState]),
    mut watch: impl FnMut(&Decision, &Programme),
) -> Result<Evaluation, EvaluationError> {
    let period_s = config.timing.period_s();
    let mut fleet = initial_fleet(config);
    let mut group = RobotGroup::new(config, 0..fleet.len())?;
    let plant = config.source.plant;
    let mut figures = Accumulator::new(&config.scenario, period_s).on_plant(plant);
    let mut solve_ns = LatencyHistogram::new()?;
    let mut fleet_step_ns = LatencyHistogram::new()?;
    let (mut step_ns, mut steps, mut fallback_commands) = (0u64, 0u64, 0u64);
    let mut next: Vec<RobotState> = fleet.clone();
    let mut world = World::new(config, &fleet);
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a checked, finite duration
    let limit = config.timing.ticks.unwrap_or((config.scenario.duration_s / period_s).ceil() as u64);

    for tick in 0..limit {
        world.show(tick, &mut fleet);
        next.copy_from_slice(&fleet);
        let step_ns_before = step_ns;
        group.solve_watched(&fleet, timing, |index, decision, programme| {
            watch(decision, programme);
            next[index].set_command(decision.command.command());
            next[index].intent = decision.intent;
            figures.observe_solve(&decision.telemetry);
            solve_ns.record(decision.telemetry.solve_ns);
            step_ns += decision.telemetry.step_ns;
            steps += 1;
            let reason = StopReason::from_code(decision.command.stop_reason);
            fallback_commands += u64::from(reason.is_some_and(|reason| !reason.is_wanted()));
        });
        fleet_step_ns.record(step_ns - step_ns_before);
        if timing == Timing::Ideal {
            fleet.copy_from_slice(&next);
        }
        let truth = world.truth(&fleet);
        figures.observe_progress(tick, truth);
        each(tick, truth);
        let standing = |robot: &RobotState| robot.command() == Command::STOP;
        if figures.all_arrived() && fleet.iter().chain(&next).all(standing) && world.at_rest() {
            // The robots stand: what is left of the period adds nothing but the places where they are.
            world.pass(&mut fleet, &mut figures);
            break;
        }
        // The period passes under the commands in force; then the new ones take over.
        world.pass(&mut fleet, &mut figures);
        for (robot, new) in fleet.iter_mut().zip(&next) {
            robot.set_command(new.command());
            robot.intent = new.intent;
        }
    }
    let (within_bound, within_bound_after_turn) = within_bound(config, timing, figures.arrivals());
    Ok(Evaluation {
        scenario: config.scenario.name.clone(),
        profile: config.controller.profile.name(),
        solver: config.controller.solver.name(),
        timing: timing.name(),
        plant: plant.name(),
        within_bound,
        within_bound_after_turn,
        figures: figures.finish(),
        fallback_commands,
        solve_ns: solve_ns.summary(),
        step_ns_per_robot: step_ns / steps.max(1),
        fleet_step_ns: fleet_step_ns.summary(),
    })
}
