//! Pause, stop and their end, and the order in which requests act.

use super::*;

#[test]
fn pause_holds_until_resumed_and_stop_until_cleared_and_resumed() {
    let world = World::new("admin_hold");
    let mut run = start(two(&world));
    let mut commands = run.client.commands().unwrap();
    let mut states = run.client.states().unwrap();
    assert_eq!(reasons(&mut commands, 5), [0, 0]);

    let paused = run.admin.pause().unwrap();
    assert_eq!(reasons(&mut commands, paused.acts_from_tick), [StopReason::Paused as u32; 2]);
    until(&mut states, |header, robots| {
        (header.tick >= paused.acts_from_tick).then(|| {
            assert!(robots.iter().all(|r| r.has(state_flags::PAUSED) && r.v_mps == 0.0));
        })
    });
    let resumed = run.admin.resume().unwrap();
    assert!(resumed.acts_from_tick > paused.acts_from_tick);
    assert_eq!(reasons(&mut commands, resumed.acts_from_tick), [0, 0]);

    let stopped = run.admin.stop().unwrap();
    assert_eq!(reasons(&mut commands, stopped.acts_from_tick), [StopReason::Stopped as u32; 2]);
    let status = run.admin.status().unwrap();
    assert!(status.is_stopped() && !status.is_paused());
    assert_eq!(refused(run.admin.resume()), (AdminCode::Stopped, None));
    // Goals may be set meanwhile; nobody moves.
    let set = run.admin.set_goal(0, 5.0, -3.0).unwrap();
    assert_eq!(reasons(&mut commands, set.acts_from_tick), [StopReason::Stopped as u32; 2]);
    let cleared = run.admin.clear().unwrap();
    assert_eq!(reasons(&mut commands, cleared.acts_from_tick), [StopReason::Paused as u32; 2]);
    let resumed = run.admin.resume().unwrap();
    assert_eq!(reasons(&mut commands, resumed.acts_from_tick), [0, 0]);
    until(&mut states, |_, robots| robots[0].has(state_flags::ARRIVED).then_some(()));
    run.daemon.stop();
    let report = run.daemon.join().unwrap();
    assert_eq!((report.control.violations, report.ended_by), (0, "operator"));
    // What an operator wants is no fallback.
    assert!(report.stops["paused"] > 0 && report.stops["stopped"] > 0, "{:?}", report.stops);
    assert!(report.fallback_commands <= report.stops.values().sum::<u64>() - report.stops["stopped"]);
}

/// Routes among many pillars take seconds to build; a stop does not wait for them.
#[test]
fn a_stop_overtakes_what_is_in_work() {
    let world = World::new("admin_overtakes");
    let mut scenario = lanes(8, 50.0);
    let pillar = |k: u32| Obstacle::Circle {
        centre_m: Vec2::new(5.0 + 4.0 * f64::from(k % 8), -3.0 - 3.0 * f64::from(k / 8)),
        radius_m: 1.0,
    };
    scenario.obstacles = (0..64).map(pillar).collect();
    let ids: Vec<_> = scenario.robots.iter().map(|robot| robot.id.0).collect();
    let mut run = start(config(&world, scenario, T));
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let port = node.admin().unwrap();
    let ask = |n: u32| {
        let goal = |k: &u32| AdminRobot {
            id: *k,
            goal_x_m: 60.0 + f64::from(n),
            goal_y_m: f64::from(*k),
            ..AdminRobot::default()
        };
        let request = AdminRequest {
            expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
            kind: AdminKind::SetGoals as u32,
            ..AdminRequest::default()
        };
        port.ask(&request, &ids.iter().map(goal).collect::<Vec<_>>()).unwrap()
    };
    let waiting: Vec<_> = (0..4).map(ask).collect();
    let stopped = run.admin.stop().unwrap();
    // The last of them is still in work, or came later.
    let last = waiting[3].answer().unwrap();
    assert!(last.is_none_or(|(answer, _)| answer.acts_from_tick > stopped.acts_from_tick));
    let (answer, _) = answered(&waiting[0]);
    assert_eq!(answer.code, AdminCode::Done as u32);
    run.daemon.stop();
    run.daemon.join().unwrap();
    let code = AdminCode::from_code(answered(&waiting[3]).0.code);
    assert!(matches!(code, Some(AdminCode::Done | AdminCode::Ending)), "{code:?}");
}

/// The requests of one moment: whatever they were carried out in, the last one counts.
#[test]
fn a_stop_that_comes_last_leaves_the_fleet_stopped() {
    let world = World::new("admin_last_stop");
    let run = start(two(&world));
    let mut states = run.client.states().unwrap();
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let ports: Vec<_> = (0..2).map(|_| node.admin().unwrap()).collect();
    for _ in 0..20 {
        let kinds = [AdminKind::Stop, AdminKind::Clear, AdminKind::Resume, AdminKind::Stop];
        let ask = |(n, kind): (usize, AdminKind)| {
            let request = AdminRequest {
                expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
                kind: kind as u32,
                ..AdminRequest::default()
            };
            ports[n / 2].ask(&request, &[]).unwrap()
        };
        let waiting: Vec<_> = kinds.into_iter().enumerate().map(ask).collect();
        let answered = |one: &_| {
            let one: &clearway::channel::Waiting = one;
            let end = Instant::now() + PATIENCE;
            while Instant::now() < end {
                if let Some((answer, _)) = one.answer().unwrap() {
                    return (AdminCode::from_code(answer.code).unwrap(), answer.acts_from_tick);
                }
                std::thread::sleep(Duration::from_micros(200));
            }
            panic!("every request is answered");
        };
        let answers: Vec<_> = waiting.iter().map(answered).collect();
        let last = answers.iter().map(|(_, tick)| *tick).max().unwrap();
        assert_eq!(answers[3].0, AdminCode::Done);
        until(&mut states, |header, robots| {
            (header.tick >= last).then(|| assert!(robots.iter().all(|one| one.has(state_flags::STOPPED))))
        });
    }
}

#[test]
fn a_request_that_has_expired_or_never_does_is_not_carried_out() {
    let world = World::new("admin_expired");
    let run = start(two(&world));
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let port = node.admin().unwrap();
    let ask = |request: AdminRequest| {
        let robot = AdminRobot { id: 0, goal_x_m: 1.0, goal_y_m: 20.0, ..AdminRobot::default() };
        let waiting =
            port.ask(&AdminRequest { kind: request.kind, ticket: 77, ..request }, &[robot]).unwrap();
        let end = Instant::now() + PATIENCE;
        loop {
            if let Some((answer, text)) = waiting.answer().unwrap() {
                assert_eq!((answer.ticket, answer.text_bytes), (77, text.len() as u64));
                return AdminCode::from_code(answer.code).unwrap();
            }
            assert!(Instant::now() < end);
            std::thread::sleep(Duration::from_micros(200));
        }
    };
    let goals = AdminRequest { kind: AdminKind::SetGoals as u32, ..AdminRequest::default() };
    let now_ns = MonotonicClock.now_ns();
    assert_eq!(ask(AdminRequest { expires_ns: now_ns - 1, ..goals }), AdminCode::Expired);
    assert_eq!(ask(AdminRequest { expires_ns: 0, ..goals }), AdminCode::Expired);
    assert_eq!(ask(AdminRequest { expires_ns: u64::MAX, ..goals }), AdminCode::Malformed);
    let soon = AdminRequest { expires_ns: now_ns + 30_000_000_000, ..goals };
    assert_eq!(ask(AdminRequest { epoch: 1, ..soon }), AdminCode::OtherEpoch);
    assert_eq!(ask(AdminRequest { kind: 99, ..soon }), AdminCode::Malformed);
    assert_eq!(ask(AdminRequest { kind: AdminKind::Pause as u32, ..soon }), AdminCode::Malformed);
    until(&mut run.client.states().unwrap(), |_, robots| {
        assert_eq!(goal_of(&robots[0]), (50.0, 0.0));
        Some(())
    });
    assert_eq!(ask(soon), AdminCode::Done);
}
