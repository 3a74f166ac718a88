//! What a worker answers when its solver errs, and whom it does not drive at all.

use clearway::config::Config;
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation::initial_fleet;
use clearway::geometry::Vec2;
use clearway::model::{Command, Obstacle};
use clearway::programme::{Programme, Solution};
use clearway::scenario::Scenario;
use clearway::solver::{ExactSolver, Outcome, Solver};
use clearway::wire::{RobotState, RobotTelemetry, SolveStatus, StopReason, state_flags};

/// The exact solver, and what somebody makes of its answer.
struct Liar<F>(F);

impl<F: FnMut(&mut Solution) -> Outcome> Solver for Liar<F> {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        assert_eq!(ExactSolver.solve(programme, solution), Outcome::Solved);
        (self.0)(solution)
    }
}

fn config() -> Config {
    Config::new(Scenario::builtin("swap8").unwrap())
}

/// The telemetry of the fourth period, with everybody on the way; each stop stands still.
fn driven(lie: impl FnMut(&mut Solution) -> Outcome + 'static) -> Vec<RobotTelemetry> {
    let config = config();
    let mut fleet = initial_fleet(&config);
    let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    for _ in 0..3 {
        let mut next = fleet.clone();
        group.solve(&fleet, Timing::LogicalExecutionTime, |index, decision| {
            next[index].set_command(decision.command.command());
            next[index].intent = decision.intent;
        });
        for robot in &mut next {
            let end = robot.arc().pose(config.timing.period_s());
            robot.set_pose(end);
        }
        fleet = next;
    }
    let mut group = group.solved_by(Box::new(Liar(lie)));
    let mut all = Vec::new();
    group.solve(&fleet, Timing::LogicalExecutionTime, |_, decision| {
        let (command, told) = (decision.command, &decision.telemetry);
        assert_eq!((command.id, command.stop_reason), (told.id, told.stop_reason));
        assert_eq!((command.v_mps, command.omega_radps), (told.v_mps, told.omega_radps));
        assert!(command.stop_reason == 0 || command.command() == Command::STOP, "{command:?}");
        all.push(*told);
    });
    all
}

#[test]
fn a_solver_that_ends_without_a_solution_is_a_stop() {
    let failures: [fn(&mut Solution) -> Outcome; 3] =
        [|_| Outcome::NotConverged, |_| Outcome::IllPosed, |_| Outcome::TooLarge];
    for failure in failures {
        for told in driven(failure) {
            assert_eq!(
                (told.stop_reason, told.status),
                (StopReason::Solver as u32, SolveStatus::Failed as u32)
            );
        }
    }
}

#[test]
fn a_solution_that_is_not_one_is_a_stop() {
    let lies: [fn(&mut Solution); 12] = [
        |s| s.v_mps += 1e-3,
        |s| s.v_mps -= 1e-3,
        |s| s.v_mps = -s.v_mps,
        |s| s.v_mps = 50.0,
        |s| s.v_mps = f64::NAN,
        |s| s.v_mps = f64::INFINITY,
        |s| s.omega_radps += 1e-2,
        |s| s.omega_radps = f64::NAN,
        |s| s.omega_radps = f64::NEG_INFINITY,
        // The inputs are right, and nothing says so.
        |s| (s.dual_position, s.slack_position) = (0.0, 0.0),
        |s| s.dual_heading = -1.0,
        |s| s.slack_comfort.push(0.0),
    ];
    let honest = driven(|_| Outcome::Solved);
    assert!(honest.iter().all(|told| told.stop_reason == 0 && told.status == SolveStatus::Verified as u32));
    assert!(honest.iter().all(|told| told.v_mps > 0.1), "everybody is on the way");
    for (n, lie) in lies.into_iter().enumerate() {
        let told = driven(move |solution| {
            lie(solution);
            Outcome::Solved
        });
        for told in told {
            let expected = (StopReason::Unverified as u32, SolveStatus::Refused as u32);
            assert_eq!((told.stop_reason, told.status), expected, "lie {n}: {told:?}");
        }
    }
}

#[test]
fn a_solution_that_is_right_but_for_rounding_is_driven() {
    let told = driven(|solution| {
        solution.v_mps += 1e-9;
        Outcome::Solved
    });
    assert!(told.iter().all(|told| told.stop_reason == 0 && told.kkt_residual < 1e-6), "{told:?}");
}

#[test]
fn whoever_is_not_to_be_driven_is_told_why_and_nothing_is_solved() {
    use state_flags::{ARRIVED, FOREIGN, PAUSED, STOPPED, VACANT, VALID};
    let cases = [
        (VALID | VACANT | FOREIGN | STOPPED | PAUSED, StopReason::Vacant),
        (VALID | FOREIGN | STOPPED | PAUSED, StopReason::Foreign),
        (VALID | STOPPED | PAUSED, StopReason::Stopped),
        (STOPPED, StopReason::Stopped),
        (VALID | PAUSED, StopReason::Paused),
        (0, StopReason::NoState),
        (ARRIVED, StopReason::NoState),
    ];
    let config = config();
    for (flags, reason) in cases {
        let mut fleet: Vec<RobotState> = initial_fleet(&config);
        fleet[2].flags = flags;
        let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
        group.solve(&fleet, Timing::LogicalExecutionTime, |index, decision| {
            let (command, told) = (decision.command, &decision.telemetry);
            assert_eq!((command.id, told.id), (fleet[index].id, fleet[index].id));
            if index == 2 {
                assert_eq!((command.stop_reason, command.command()), (reason as u32, Command::STOP));
                assert_eq!((told.status, told.clearance_m), (SolveStatus::NotSolved as u32, f64::INFINITY));
            } else {
                assert_eq!(command.stop_reason, 0, "robot {index}");
            }
        });
    }
}

#[test]
fn active_rows_are_those_with_a_multiplier() {
    let config = config();
    let mut fleet = initial_fleet(&config);
    let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    let mut told_apart = false;
    // Up to where all of them meet.
    for _ in 0..25 {
        let mut next = fleet.clone();
        group.solve_watched(&fleet, Timing::LogicalExecutionTime, |index, decision, programme| {
            let mut solution = Solution::with_capacity(programme.capacity());
            assert_eq!(ExactSolver.solve(programme, &mut solution), Outcome::Solved);
            let rows = [&solution.dual_safety[..], &solution.dual_comfort, &solution.dual_v].concat();
            let active = rows.iter().filter(|dual| **dual > 0.0).count();
            assert_eq!(decision.telemetry.active_rows as usize, active, "of {}", rows.len());
            told_apart |= rows.len() != 2 * active;
            next[index].set_command(decision.command.command());
            next[index].intent = decision.intent;
        });
        for robot in &mut next {
            let end = robot.arc().pose(config.timing.period_s());
            robot.set_pose(end);
        }
        fleet = next;
    }
    assert!(told_apart, "as many are active as are not");
}

/// A robot between four walls, with its goal outside of them: no command decreases its certificate by what
/// is asked for.
#[test]
fn a_certificate_that_cannot_be_met_tells_its_slack() {
    let box_of = |half_m: f64| {
        let mut config = config();
        config.scenario.robots.truncate(1);
        let at = config.scenario.robots[0].start.position_m;
        let corner = |x: f64, y: f64| at + Vec2::new(half_m * x, half_m * y);
        let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
        config.scenario.obstacles =
            (0..4).map(|i| Obstacle::Segment { from_m: corners[i], to_m: corners[(i + 1) % 4] }).collect();
        let mut fleet = initial_fleet(&config);
        let mut group = RobotGroup::new(&config, 0..1).unwrap();
        let mut told = Vec::new();
        for _ in 0..60 {
            let mut next = fleet.clone();
            group.solve_watched(&fleet, Timing::LogicalExecutionTime, |index, decision, programme| {
                assert_eq!(decision.command.stop_reason, 0, "{decision:?}");
                next[index].set_command(decision.command.command());
                next[index].intent = decision.intent;
                // What the certificate falls short of, by the programme alone.
                let c = &programme.position;
                let v = decision.command.v_mps;
                let short = (c.linear * v + 0.5 * c.curvature * v * v + c.decrease).max(0.0);
                told.push((decision.telemetry.slack_position_m2, short, c.decrease));
            });
            for robot in &mut next {
                let end = robot.arc().pose(config.timing.period_s());
                robot.set_pose(end);
            }
            fleet = next;
        }
        told
    };
    // Walls that it can only touch: in the end all of the decrease that is asked for is missing.
    let inside = box_of(0.4);
    for (slack_m2, short_m2, decrease_m2) in &inside[30..] {
        assert!(*decrease_m2 > 0.1, "{decrease_m2}");
        assert!((slack_m2 - short_m2).abs() <= 1e-9 * decrease_m2, "{slack_m2} for {short_m2}");
        assert!(*slack_m2 >= 0.99 * decrease_m2, "{slack_m2} of {decrease_m2}");
    }
    // Walls that are far away take nothing.
    assert!(box_of(100.0)[10..20].iter().all(|(slack_m2, ..)| *slack_m2 < 1e-9));
}
