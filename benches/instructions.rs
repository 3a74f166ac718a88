//! What callgrind counts: one case a run, its work in functions named `counted_…`.
//!
//! `.ci/instructions` runs each case and compares it with `benches/instructions.tsv`. Instructions are
//! counted rather than timed because they are the same on a busy machine and on an idle one.

use std::hint::black_box;
use std::process::ExitCode;

use clearway::config::{Config, Weights};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation;
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::scenario::Scenario;
use clearway::solver::{ExactSolver, Outcome, Solver};
use clearway::wire::RobotState;

/// What is counted for the solver: so many solves.
const SOLVES: u32 = 100;
/// What is counted for a fleet: so many periods in a row.
const PERIODS: u32 = 10;

/// Name, what it is, and the work.
type Case = (&'static str, &'static str, fn());

const CASES: [Case; 6] = [
    ("solve-0", "100 solves, no neighbours", || solver(0)),
    ("solve-3", "100 solves, 3 neighbours", || solver(3)),
    ("solve-7", "100 solves, 7 neighbours", || solver(7)),
    ("swap8", "10 periods of swap8 in the crossing", || fleet("swap8", 8)),
    ("circle-50", "10 periods of circle-50 in the middle", || fleet("circle-50", 25)),
    ("random-100", "10 periods of 100 robots on 900 m²", || fleet("random-100-7", 15)),
];

fn main() -> ExitCode {
    let wanted = std::env::args().skip(1).find(|argument| !argument.starts_with("--"));
    let Some(wanted) = wanted else {
        for (name, about, _) in CASES {
            println!("{name}\t{about}");
        }
        return ExitCode::SUCCESS;
    };
    let Some((_, _, work)) = CASES.into_iter().find(|(name, _, _)| *name == wanted) else {
        eprintln!("there is no case `{wanted}`; without an argument they are listed");
        return ExitCode::from(2);
    };
    work();
    ExitCode::SUCCESS
}

/// A robot on its way with `neighbours` bodies beside and before it, each nearer than the one before.
fn solver(neighbours: u8) {
    let t = 0.08;
    let mut programme = Programme::with_capacity(Weights::default(), 16);
    programme.position = Certificate { linear: -t * 4.0, curvature: t * t, decrease: 1.2 };
    programme.heading = Certificate { linear: t * 0.3, curvature: t * t, decrease: 0.02 };
    programme.v_mps = Interval { min: -1.0, max: 5.0 };
    programme.omega_radps = Interval { min: -1.0, max: 1.0 };
    for n in 0..neighbours {
        let row = Row { coefficient: t * (1.0 - 0.2 * f64::from(n)), bound: 0.3 / f64::from(n + 1) };
        assert!(programme.push_comfort(row));
        assert!(programme.push_safety(Row { bound: row.bound / 0.6, ..row }));
    }
    let mut solution = Solution::with_capacity(16);
    assert_eq!(ExactSolver.solve(&programme, &mut solution), Outcome::Solved);
    for _ in 0..SOLVES {
        counted_solve(black_box(&programme), black_box(&mut solution));
    }
}

#[inline(never)]
fn counted_solve(programme: &Programme, solution: &mut Solution) {
    black_box(ExactSolver.solve(programme, solution));
}

/// The control step of a whole fleet, `before` periods after the start.
fn fleet(scenario: &str, before: u32) {
    let scenario = Scenario::builtin(scenario).expect("a built-in scenario");
    let config = Config::new(scenario);
    let period_s = config.timing.period_s();
    let mut fleet = evaluation::initial_fleet(&config);
    let mut group = RobotGroup::new(&config, 0..fleet.len()).expect("a group of the whole fleet");
    let mut next = fleet.clone();
    for period in 0..before + PERIODS {
        next.copy_from_slice(&fleet);
        if period < before {
            step(&mut group, &fleet, &mut next);
        } else {
            counted_step(&mut group, &fleet, &mut next);
        }
        for (robot, new) in fleet.iter_mut().zip(&next) {
            robot.set_pose(config.source.plant.pose(&robot.arc(), period_s));
            robot.set_command(new.command());
            robot.intent = new.intent;
        }
    }
    let driving = fleet.iter().filter(|robot| robot.v_mps > 0.1).count();
    assert!(2 * driving > fleet.len(), "{driving} of {} robots drive: not the middle of a run", fleet.len());
}

#[inline(never)]
fn counted_step(group: &mut RobotGroup, fleet: &[RobotState], next: &mut [RobotState]) {
    step(group, black_box(fleet), black_box(next));
}

fn step(group: &mut RobotGroup, fleet: &[RobotState], next: &mut [RobotState]) {
    group.solve(fleet, Timing::LogicalExecutionTime, |index, decision| {
        next[index].set_command(decision.command.command());
        next[index].intent = decision.intent;
    });
}
