//! Robots that join and leave.

use super::*;

fn spec(id: u32, start: (f64, f64), goal: (f64, f64)) -> RobotSpec {
    RobotSpec {
        id: RobotId(id),
        radius_m: 0.2,
        start: Pose::new(start.0, start.1, 0.0),
        goal_m: Vec2::new(goal.0, goal.1),
        foreign_speed_mps: None,
    }
}

#[test]
fn a_robot_joins_drives_and_leaves() {
    let world = World::new("admin_join");
    let mut config = two(&world);
    config.admin.capacity = 3;
    let mut run = start(config);
    let (mut states, mut commands) = (run.client.states().unwrap(), run.client.commands().unwrap());
    until(&mut states, |_, robots| {
        assert_eq!((robots.len(), robots[2].id), (3, NO_ROBOT));
        assert!(robots[2].has(state_flags::VACANT));
        Some(())
    });
    assert_eq!(refused(run.admin.add_robot(&spec(3, (0.0, 8.0), (4.0, 8.0)))).0, AdminCode::TakenId);
    assert_eq!(refused(run.admin.add_robot(&spec(9, (10.0, 9.0), (4.0, 8.0)))).0, AdminCode::InsideObstacle);
    let done = run.admin.add_robot(&spec(9, (0.0, 8.0), (4.0, 8.0))).unwrap();
    until(&mut states, |header, robots| {
        assert_eq!(robots[2].id == 9, header.tick + 1 >= done.acts_from_tick);
        (robots[2].id == 9).then(|| {
            assert!(robots[2].has(state_flags::VALID));
            assert_eq!((robots[2].x_m, robots[2].v_mps, robots[2].radius_m), (0.0, 0.0, 0.2));
        })
    });
    assert_eq!(refused(run.admin.add_robot(&spec(10, (0.0, 20.0), (4.0, 20.0)))).0, AdminCode::Full);
    until(&mut states, |_, robots| robots[2].has(state_flags::ARRIVED).then_some(()));
    // It can be sent elsewhere like any other.
    run.admin.set_goal(9, 1.0, 8.0).unwrap();
    until(&mut states, |_, robots| {
        (robots[2].has(state_flags::ARRIVED) && robots[2].x_m < 1.1).then_some(())
    });
    assert_eq!(run.admin.status().unwrap().figures.robots, 3);

    let done = run.admin.remove_robot(9).unwrap();
    assert_eq!(reasons(&mut commands, done.acts_from_tick)[2], StopReason::Vacant as u32);
    assert_eq!(refused(run.admin.remove_robot(9)).0, AdminCode::UnknownRobot);
    assert_eq!(run.admin.status().unwrap().figures.robots, 2);
    // The place is free for another one, or for the same again.
    run.admin.add_robot(&spec(9, (0.0, 20.0), (2.0, 20.0))).unwrap();
    until(&mut states, |_, robots| {
        (robots[2].has(state_flags::ARRIVED) && robots[2].y_m > 19.0).then_some(())
    });
    run.daemon.stop();
    let report = run.daemon.join().unwrap();
    assert_eq!((report.control.violations, report.control.robots), (0, 3), "{report:?}");
}

#[test]
fn a_robot_is_not_put_in_front_of_another() {
    let world = World::new("admin_close");
    let mut config = config(&world, lanes(1, 0.0), T);
    config.admin.capacity = 2;
    let mut run = start(config);
    // Both radii and the margin: half a metre.
    let close = run.admin.add_robot(&spec(5, (0.49, 0.0), (3.0, 0.0)));
    assert_eq!(refused(close), (AdminCode::TooClose, Some(0)));
    // The refusal leaves no trace: the place is still free.
    run.admin.add_robot(&spec(5, (0.51, 0.0), (3.0, 0.0))).unwrap();
}

/// What a robot still travels on commands that its wheels have not followed yet counts: a new one never
/// stands in its way.
#[test]
fn a_robot_is_not_put_in_front_of_one_that_lags() {
    let world = World::new("admin_lag");
    let mut config = config(&world, lanes(1, 400.0), T);
    config.admin.capacity = 2;
    config.source.arena_m = 1000.0;
    config.robust.lag_s = 0.1;
    config.robust.delay_s = 0.05;
    config.disturbance.amplitude = config.robust;
    config.disturbance.pattern = clearway::config::Pattern::Adversarial;
    let mut run = start(config);
    let mut states = run.client.states().unwrap();
    let (mut added, mut refusals) = (0, 0);
    while added < 6 {
        // Again and again in front of it, at full speed, each time a little farther away.
        let x_m = until(&mut states, |_, robots| (robots[0].v_mps > 4.0).then_some(robots[0].x_m));
        for step in 0..40 {
            let at_m = x_m + 0.4 + 0.1 * f64::from(step);
            match run.admin.add_robot(&spec(9, (at_m, 0.0), (at_m, 50.0))) {
                Ok(done) => {
                    until(&mut states, |header, _| (header.tick > done.acts_from_tick + 3).then_some(()));
                    added += 1;
                    run.admin.remove_robot(9).unwrap();
                    break;
                }
                refusal => {
                    assert_eq!(refused(refusal).0, AdminCode::TooClose);
                    refusals += 1;
                }
            }
        }
    }
    assert!(refusals > 0);
    run.daemon.stop();
    let report = run.daemon.join().unwrap();
    assert_eq!(report.control.violations, 0, "{report:?}");
}
