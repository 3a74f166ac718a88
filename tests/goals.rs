//! Goals, pauses, joining and leaving at any moment: never closer than is safe, and nothing depends on
//! who prepared what.

use std::sync::Arc;

use clearway::config::Config;
use clearway::controller::{PreparedRoute, RobotGroup, RouteShelf, Timing};
use clearway::evaluation::initial_fleet;
use clearway::figures::Accumulator;
use clearway::geometry::Vec2;
use clearway::scenario::Scenario;
use clearway::wire::{RobotState, StopReason, state_flags};
use proptest::prelude::*;

/// What an operator does at a tick.
#[derive(Debug, Clone, Copy)]
enum Act {
    Goal { robot: usize, x_m: f64, y_m: f64 },
    Hold(u32),
    Remove { robot: usize },
}

fn act() -> impl Strategy<Value = Act> {
    prop_oneof![
        8 => (0..20usize, -8.0..8.0f64, -8.0..8.0f64)
            .prop_map(|(robot, x_m, y_m)| Act::Goal { robot, x_m, y_m }),
        1 => prop_oneof![Just(0), Just(state_flags::PAUSED), Just(state_flags::STOPPED)].prop_map(Act::Hold),
        1 => (0..20usize).prop_map(|robot| Act::Remove { robot }),
    ]
}

fn set_goal(fleet: &mut [RobotState], config: &Config, robot: usize, goal_m: Vec2) -> bool {
    let (robot, scenario) = (robot % fleet.len(), &config.scenario);
    let keep_m = fleet[robot].radius_m + scenario.limits.safety_margin_m;
    let free = scenario.obstacles.iter().all(|o| o.core_distance(goal_m) >= keep_m + o.reach_m());
    if free && !fleet[robot].has(state_flags::VACANT) {
        (fleet[robot].goal_x_m, fleet[robot].goal_y_m) = (goal_m.x, goal_m.y);
    }
    free
}

/// Drives `scenario` under `acts`; returns the commands of every period as bits, and the violations.
fn drive(scenario: &str, acts: &[(u64, Act)], prepared: bool) -> (Vec<(u64, u64)>, usize) {
    let config = Config::new(Scenario::builtin(scenario).unwrap());
    let mut fleet = initial_fleet(&config);
    let shelf = Arc::new(RouteShelf::new(fleet.len()));
    let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    if prepared {
        group = group.with_routes(Arc::clone(&shelf));
    }
    let period_s = config.timing.period_s();
    let mut figures = Accumulator::new(&config.scenario, period_s);
    let (mut bits, mut hold) = (Vec::new(), 0);
    for tick in 0..150 {
        for (_, act) in acts.iter().filter(|(at, _)| *at == tick) {
            match *act {
                Act::Goal { robot, x_m, y_m } => {
                    if set_goal(&mut fleet, &config, robot, Vec2::new(x_m, y_m)) && prepared {
                        let index = robot % fleet.len();
                        let (scenario, margin_m) = (&config.scenario, config.scenario.limits.safety_margin_m);
                        shelf.put(index, PreparedRoute::build(&scenario.obstacles, margin_m, &fleet[index]));
                    }
                }
                Act::Hold(flags) => hold = flags,
                Act::Remove { robot } => {
                    let robot = robot % fleet.len();
                    fleet[robot] = RobotState::vacant();
                }
            }
        }
        for state in &mut fleet {
            state.flags &= !(state_flags::PAUSED | state_flags::STOPPED);
            state.flags |= if state.has(state_flags::VACANT) { 0 } else { hold };
        }
        let mut next = fleet.clone();
        group.solve(&fleet, Timing::LogicalExecutionTime, |index, decision| {
            let reason = StopReason::from_code(decision.command.stop_reason);
            let vacant = fleet[index].has(state_flags::VACANT);
            assert_eq!(reason == Some(StopReason::Vacant), vacant);
            assert!(hold == 0 || vacant || decision.command.v_mps == 0.0 && reason.is_some());
            bits.push((decision.command.v_mps.to_bits(), decision.command.omega_radps.to_bits()));
            next[index].set_command(decision.command.command());
            next[index].intent = decision.intent;
        });
        figures.observe_period(tick, &fleet);
        for (robot, new) in fleet.iter_mut().zip(&next) {
            robot.set_pose(robot.arc().pose(period_s));
            robot.set_command(new.command());
            robot.intent = new.intent;
        }
    }
    (bits, figures.violations())
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn goals_at_any_moment_are_safe_and_prepared_routes_change_no_bit(
        scenario in prop_oneof![Just("swap8"), Just("pillars-8"), Just("random-20-3")],
        acts in prop::collection::vec((0..150u64, act()), 0..40),
    ) {
        let (bits, violations) = drive(scenario, &acts, true);
        prop_assert_eq!(violations, 0);
        prop_assert_eq!(bits, drive(scenario, &acts, false).0);
    }
}
