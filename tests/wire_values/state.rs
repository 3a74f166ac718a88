//! States and checkpoints: what a controller is given.

use super::*;

/// A state whose every field may be anything.
fn record() -> impl Strategy<Value = RobotState> {
    let intent = (number(), number(), number(), [number(), number(), number(), number()], half(), half())
        .prop_map(|(heading_rad, speed_mps, blocked_s, [tx, ty, wx, wy], rank, valid)| RobotIntent {
            heading_rad,
            speed_mps,
            blocked_s,
            target_x_m: tx,
            target_y_m: ty,
            waypoint_x_m: wx,
            waypoint_y_m: wy,
            rank,
            valid,
        });
    let body = (half(), half(), [number(), number(), number()], [number(), number()], [number(), number()]);
    let doubt = [number(), number(), number(), number()];
    (body, number(), doubt, intent).prop_map(
        |(
            (id, flags, [x_m, y_m, theta_rad], [v_mps, omega_radps], [gx, gy]),
            radius_m,
            [uncertainty_m, seen_x_m, seen_y_m, way_m],
            intent,
        )| {
            RobotState {
                id,
                flags,
                x_m,
                y_m,
                theta_rad,
                v_mps,
                omega_radps,
                goal_x_m: gx,
                goal_y_m: gy,
                radius_m,
                uncertainty_m,
                seen_x_m,
                seen_y_m,
                way_m,
                intent,
            }
        },
    )
}

/// One field of `from` in place of that of `into`.
fn blend(into: &mut RobotState, from: &RobotState, field: usize) {
    let (a, b) = (&mut into.intent, &from.intent);
    match field {
        0 => into.x_m = from.x_m,
        1 => into.y_m = from.y_m,
        2 => into.theta_rad = from.theta_rad,
        3 => into.v_mps = from.v_mps,
        4 => into.omega_radps = from.omega_radps,
        5 => into.goal_x_m = from.goal_x_m,
        6 => into.goal_y_m = from.goal_y_m,
        7 => into.radius_m = from.radius_m,
        8 => into.uncertainty_m = from.uncertainty_m,
        9 => into.flags = from.flags,
        10 => into.id = from.id,
        11 => a.heading_rad = b.heading_rad,
        12 => a.speed_mps = b.speed_mps,
        13 => a.blocked_s = b.blocked_s,
        14 => (a.target_x_m, a.target_y_m) = (b.target_x_m, b.target_y_m),
        15 => (a.waypoint_x_m, a.waypoint_y_m) = (b.waypoint_x_m, b.waypoint_y_m),
        16 => (a.rank, a.valid) = (b.rank, b.valid),
        17 => (into.seen_x_m, into.seen_y_m) = (from.seen_x_m, from.seen_y_m),
        18 => into.way_m = from.way_m,
        _ => *into = *from,
    }
}

/// Drives a fleet of which one record is replaced, for some periods; every command is a stop with a
/// reason or within the limits.
fn drives(record: &RobotState, field: usize, robot: usize, memory: Option<&RobotCheckpoint>) {
    let config = Config::new(Scenario::builtin("swap8").unwrap());
    let mut fleet = initial_fleet(&config);
    let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    for period in 0..4 {
        if period == 1
            && let Some(memory) = memory
        {
            let own = RobotCheckpoint { id: fleet[robot].id, ..*memory };
            group.restore(robot, &own);
        }
        let mut seen = fleet.clone();
        if period > 0 {
            blend(&mut seen[robot], record, field);
            // Of a way on which it may stand, it is read only then.
            seen[robot].flags |= if matches!(field, 17 | 18) { state_flags::MAY_STAND } else { 0 };
        }
        let mut next = fleet.clone();
        group.solve(&seen, Timing::LogicalExecutionTime, |index, decision| {
            let command = decision.command;
            let stop = command.stop_reason != 0 && command.command() == Command::STOP;
            let drive = command.stop_reason == 0 && config.scenario.limits.admits(command.command());
            assert!(stop || drive, "robot {index}: {command:?}");
            let stands = seen[index].is_held() || seen[index].has(state_flags::OUT_OF_STEP);
            let driven = seen[index].has(state_flags::VALID) && !stands;
            assert!(stop || driven, "robot {index}: {command:?}");
            next[index].set_command(command.command());
            next[index].intent = decision.intent;
        });
        for robot in &mut next {
            let end = robot.arc().pose(config.timing.period_s());
            robot.set_pose(end);
        }
        fleet = next;
    }
}

proptest! {
    /// The workers believe what they read from a state that has its checksum; whatever stands in it, they
    /// neither panic nor command what may not be commanded.
    #[test]
    fn whatever_a_state_says_nobody_panics_and_no_command_is_beyond_the_limits(
        record in record(), field in 0..22_usize, robot in 0..8_usize,
    ) {
        drives(&record, field, robot, None);
    }

    /// So with what a controller is told that it remembers.
    #[test]
    fn whatever_a_memory_says_nobody_panics_and_no_command_is_beyond_the_limits(
        words in prop::collection::vec(prop_oneof![word(0), number().prop_map(f64::to_bits)], RobotCheckpoint::WORDS),
        flags in half(), robot in 0..8_usize,
    ) {
        let words = words.try_into().unwrap();
        let memory = RobotCheckpoint { id: 0, flags, words };
        let config = Config::new(Scenario::builtin("swap8").unwrap());
        drives(&initial_fleet(&config)[robot], 0, robot, Some(&memory));
    }
}
