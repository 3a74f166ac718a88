//! New goals.

use super::*;

#[test]
fn a_goal_acts_from_the_tick_that_the_answer_names() {
    let world = World::new("admin_goal");
    let mut run = start(two(&world));
    let mut states = run.client.states().unwrap();
    let done = run.admin.set_goal(3, 2.0, 30.0).unwrap();
    // The state of the tick before is the first to show it.
    let (before, at) = until(&mut states, |header, robots| {
        let changed = goal_of(&robots[1]) == (2.0, 30.0);
        assert_eq!(changed, header.tick + 1 >= done.acts_from_tick, "{}", header.tick);
        (header.tick + 1 == done.acts_from_tick).then_some((header.epoch, goal_of(&robots[0])))
    });
    assert_eq!((before, at), (done.epoch, (50.0, 0.0)));
    // It drives there.
    until(&mut states, |_, robots| (robots[1].y_m > 8.0).then_some(()));
    // Both at once, or none.
    run.admin.set_goals(&[(0, 2.0, 30.0), (3, 50.0, 0.0)]).unwrap();
    until(&mut states, |_, robots| {
        let goals = (goal_of(&robots[0]), goal_of(&robots[1]));
        assert!([((50.0, 0.0), (2.0, 30.0)), ((2.0, 30.0), (50.0, 0.0))].contains(&goals));
        (goals.0 == (2.0, 30.0)).then_some(())
    });
    run.daemon.stop();
    let report = run.daemon.join().unwrap();
    assert_eq!((report.control.violations, report.lost_records), (0, 0), "{report:?}");
}

#[test]
fn a_goal_that_cannot_be_is_refused_with_the_reason_and_the_last_one_is_kept() {
    let world = World::new("admin_refuse");
    let mut run = start(two(&world));
    for (goal, code) in [
        ((f64::NAN, 0.0), AdminCode::NotFinite),
        ((0.0, f64::NEG_INFINITY), AdminCode::NotFinite),
        ((99.0, 99.0), AdminCode::OutsideArena),
        ((10.0, 10.0), AdminCode::InsideObstacle),
        ((10.0, 11.2), AdminCode::InsideObstacle),
        ((50.0, 2.1), AdminCode::GoalTaken),
    ] {
        assert_eq!(refused(run.admin.set_goal(0, goal.0, goal.1)), (code, Some(0)), "{goal:?}");
    }
    assert_eq!(refused(run.admin.set_goal(7, 1.0, 1.0)), (AdminCode::UnknownRobot, Some(7)));
    assert_eq!(refused(run.admin.set_goals(&[])), (AdminCode::Malformed, None));
    // A good one beside a bad one is not taken either.
    assert_eq!(
        refused(run.admin.set_goals(&[(3, 1.0, 20.0), (0, f64::NAN, 0.0)])),
        (AdminCode::NotFinite, Some(0))
    );
    let status = run.admin.status().unwrap();
    assert_eq!((status.figures.requests_refused, status.figures.requests_done), (9, 1));
    let mut states = run.client.states().unwrap();
    until(&mut states, |_, robots| {
        assert_eq!((goal_of(&robots[0]), goal_of(&robots[1])), ((50.0, 0.0), (50.0, 2.0)));
        Some(())
    });
}
