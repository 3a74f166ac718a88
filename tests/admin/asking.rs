//! Status, configuration, and who can be asked.

use clearway::config::SourceKind;

use super::*;

#[test]
fn status_and_configuration_say_what_is() {
    let world = World::new("admin_status");
    let mut config = two(&world);
    config.timing.workers = Some(2);
    config.admin.capacity = 5;
    let expected = config.clone();
    let mut run = start(config);
    let _states = run.client.states().unwrap();
    let _also = run.client.states().unwrap();
    let _telemetry = run.client.telemetry().unwrap();
    let status = until(&mut run.client.states().unwrap(), |header, _| {
        (header.tick > 30).then(|| run.admin.status().unwrap())
    });
    let f = &status.figures;
    assert_eq!((f.capacity, f.robots, f.arrived, f.unseen, f.workers), (5, 2, 0, 0, 2));
    assert_eq!((f.period_ns, f.telemetry_readers, f.admin_clients), (T, 1, 1));
    assert!((2..=3).contains(&f.state_readers), "{f:?}");
    assert!(f.periods > 0 && f.tick > 0 && f.uptime_ns > 0 && f.min_clearance_m > 0.5, "{f:?}");
    assert!(!status.is_paused() && !status.is_stopped() && status.degraded.is_empty());
    let text = run.admin.configuration().unwrap();
    for line in ["period_us = 10000", "workers = 2", "capacity = 5", "scenario = \"two\"", "policy = \"off\""]
    {
        assert!(text.lines().any(|l| l == line), "{line} is not in\n{text}");
    }
    run.admin.set_goal(3, 9.0, 20.0).unwrap();
    let scenario = Scenario::parse(&run.admin.scenario().unwrap(), "answered.toml").unwrap();
    assert_eq!(scenario.obstacles, expected.scenario.obstacles);
    assert_eq!(scenario.robots[1].goal_m, Vec2::new(9.0, 20.0));
    assert_eq!(scenario.robots[0], expected.scenario.robots[0]);
}

/// A text longer than one answer comes in pieces, all of them of the moment at which it was begun.
#[test]
fn a_large_fleets_scenario_is_answered_in_pieces_of_one_moment() {
    let world = World::new("admin_long");
    let mut config = config(&world, Scenario::builtin("circle-200").unwrap(), 80_000_000);
    config.timing.workers = Some(1);
    let expected = config.scenario.clone();
    let mut run = start(config);
    assert_eq!(Scenario::parse(&run.admin.scenario().unwrap(), "answered.toml").unwrap(), expected);
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let port = node.admin().unwrap();
    let ask = |offset: usize| {
        let request = AdminRequest {
            expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
            kind: AdminKind::Scenario as u32,
            offset: offset as u64,
            ..AdminRequest::default()
        };
        answered(&port.ask(&request, &[]).unwrap())
    };
    let (first, mut text) = ask(0);
    assert!((text.len() as u64) < first.text_bytes);
    // The first robot and the last one move together.
    let (one, other) = (expected.robots[0].id.0, expected.robots[199].id.0);
    run.admin.set_goals(&[(one, 60.0, 60.0), (other, 70.0, 70.0)]).unwrap();
    while (text.len() as u64) < first.text_bytes {
        let (answer, piece) = ask(text.len());
        assert_eq!((answer.code, answer.text_bytes), (AdminCode::Done as u32, first.text_bytes));
        text.extend(piece);
    }
    let read = Scenario::parse(&String::from_utf8(text).unwrap(), "answered.toml").unwrap();
    assert_eq!(read, expected);
    let now = Scenario::parse(&run.admin.scenario().unwrap(), "answered.toml").unwrap();
    assert_eq!((now.robots[0].goal_m.x, now.robots[199].goal_m.x), (60.0, 70.0));
    // What nobody has begun cannot be gone on with.
    assert_eq!(ask(100).0.code, AdminCode::Busy as u32);
}

#[test]
fn nobody_is_asked_when_no_daemon_runs_and_nobody_waits_for_ever() {
    let world = World::new("admin_nobody");
    let error = Client::connect_at("default", &world.channel).unwrap_err();
    assert!(error.to_string().contains("no daemon runs"), "{error}");
    let mut run = start(two(&world));
    run.admin.status().unwrap();
    run.daemon.stop();
    run.daemon.join().unwrap();
    let mut admin = run.admin.with_timeout(Duration::from_millis(50));
    let error = admin.status().unwrap_err();
    assert!(matches!(error, AdminError::Timeout { .. } | AdminError::Channel(_)), "{error:?}");
    assert!(Client::connect_at("default", &world.channel).is_err());
}

/// A daemon that starts makes its channels one after the other.
#[test]
fn a_channel_that_a_starting_daemon_has_not_made_yet_is_waited_for() {
    let world = World::new("admin_starting");
    let transport = Transport::new("default", &world.channel).unwrap();
    let (began, beginning) = std::sync::mpsc::channel();
    let (found, finding) = std::sync::mpsc::channel();
    std::thread::scope(|scope| {
        scope.spawn(move || {
            let node = transport.attach("clearwayd").unwrap();
            let _states: clearway::channel::Writer<RobotState> = node.writer(1).unwrap();
            began.send(()).unwrap();
            std::thread::sleep(Duration::from_millis(60));
            let _server = node.admin_server(4).unwrap();
            finding.recv().unwrap();
        });
        beginning.recv().unwrap();
        let client = Client::wait_for_at("default", &world.channel, PATIENCE).unwrap();
        assert!(client.states().is_ok() && client.admin().is_ok());
        found.send(()).unwrap();
    });
}

/// A daemon that listens to observations, and one that does not.
#[test]
fn observations_are_published_where_somebody_listens() {
    let world = World::new("admin_observe");
    let mut config = two(&world);
    let run = start(config.clone());
    assert!(run.client.observations(1).is_err());
    drop(run);
    config.source.kind = SourceKind::Observation;
    let run = start(config);
    let mut publisher = run.client.observations(1).unwrap();
    let mut states = run.client.states().unwrap();
    until(&mut states, |header, robots| {
        let pose = Pose::new(0.5, 2.0, 0.25);
        publisher.publish(header.stamp_ns, &[(RobotId(3), pose)]).unwrap();
        assert!(publisher.publish(header.stamp_ns, &[]).is_err());
        let (mine, other) = (&robots[1], &robots[0]);
        (mine.has(state_flags::VALID) && mine.x_m >= 0.5 && !other.has(state_flags::VALID)).then_some(())
    });
}
