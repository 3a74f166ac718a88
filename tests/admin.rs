//! Operators' requests to a daemon over real shared memory, in one process.

mod support;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use clearway::attach::{AdminClient, AdminError, Client, Subscriber};
use clearway::channel::{CommandReader, Transport};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{Config, SourceKind};
use clearway::geometry::{Pose, Vec2};
use clearway::model::{Obstacle, RobotId, RobotSpec};
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use clearway::wire::{
    AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, NO_ROBOT, RobotCommand, RobotState,
    StopReason, state_flags,
};
use support::{World, config, lanes};

const T: u64 = 10_000_000;

/// Far longer than any of this takes.
const PATIENCE: Duration = Duration::from_secs(30);

/// A daemon with real controllers, and a client of it.
struct Running {
    daemon: Daemon,
    client: Client,
    admin: AdminClient,
}

fn start(config: Config) -> Running {
    let channel = config.channel.clone();
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let client = Client::connect_at("default", &channel).unwrap();
    let admin = client.admin().unwrap().with_timeout(PATIENCE);
    Running { daemon, client, admin }
}

/// Two robots on lanes of fifty metres, a pillar beside them, an arena of a hundred metres.
fn two(world: &World) -> Config {
    let text = "schema = 1\nname = \"two\"\n\
        [[robot]]\nid = 0\nradius_m = 0.15\nstart = { x_m = 0, y_m = 0 }\ngoal = { x_m = 50, y_m = 0 }\n\
        [[robot]]\nid = 3\nradius_m = 0.15\nstart = { x_m = 0, y_m = 2 }\ngoal = { x_m = 50, y_m = 2 }\n\
        [[obstacle]]\ncircle = { x_m = 10, y_m = 10, radius_m = 1 }\n";
    let mut config = config(world, Scenario::parse(text, "two.toml").unwrap(), T);
    config.source.arena_m = 100.0;
    config
}

/// Reads on until `look` finds something.
fn until<R: clearway::channel::Record, F>(
    subscriber: &mut Subscriber<R>,
    mut look: impl FnMut(&R::Header, &[R]) -> Option<F>,
) -> F {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(sample) = subscriber.wait(PATIENCE).unwrap()
            && let Some(found) = look(sample.header(), sample.robots())
        {
            return found;
        }
    }
    panic!("nothing came");
}

fn refused(result: Result<impl std::fmt::Debug, AdminError>) -> (AdminCode, Option<u32>) {
    match result {
        Err(AdminError::Refused { code: Some(code), robot, text }) => {
            assert!(!text.is_empty());
            (code, robot)
        }
        other => panic!("{other:?}"),
    }
}

fn goal_of(state: &RobotState) -> (f64, f64) {
    (state.goal_x_m, state.goal_y_m)
}

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

/// The reasons for which the robots stop, in the commands of one tick.
fn reasons(run: &mut Subscriber<RobotCommand>, tick: u64) -> Vec<u32> {
    until(run, |header, robots| {
        (header.tick >= tick).then(|| robots.iter().map(|c| c.stop_reason).collect::<Vec<_>>())
    })
}

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

/// The answer to a request, and its text.
fn answered(waiting: &clearway::channel::Waiting) -> (AdminAnswer, Vec<u8>) {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(answer) = waiting.answer().unwrap() {
            return answer;
        }
        assert!(Instant::now() < end, "every request is answered");
        std::thread::sleep(Duration::from_micros(200));
    }
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

/// Two robots that are nothing to each other, two hundred metres apart.
fn strangers(world: &World) -> Config {
    let mut scenario = lanes(2, 50.0);
    scenario.robots[1].start = Pose::new(0.0, 200.0, 0.0);
    scenario.robots[1].goal_m = Vec2::new(50.0, 200.0);
    config(world, scenario, T)
}

/// Adds the first robot's commands, as bits, as long as none is missing or late.
fn read_on(commands: &mut CommandReader, seen: &mut Vec<(u64, u64)>, irregular: &mut bool) {
    while let Some(sample) = commands.next().unwrap() {
        let robot = sample.robots()[0];
        let (tick, regular) = (sample.header().tick, robot.stop_reason == 0);
        *irregular |= tick != seen.len() as u64 || !(regular || tick == 0);
        if !*irregular {
            seen.push((robot.v_mps.to_bits(), robot.omega_radps.to_bits()));
        }
    }
}

/// More than can be done: the rest is answered busy, no period takes more than its share, and a robot
/// that it does not concern gets the same commands to the bit.
#[test]
fn a_flood_is_answered_busy_and_changes_no_bit_of_a_robot_that_it_does_not_concern() {
    let run_beside = |name: &str, floods: bool| {
        let world = World::new(name);
        let config = strangers(&world);
        let per_period = config.admin.changes_per_period;
        let transport = Transport::new("default", &world.channel).unwrap();
        let node = transport.attach("test").unwrap();
        // There before the daemon is: no command is missed.
        let mut commands: CommandReader = node.reader_or_create(2).unwrap();
        let (mut seen, mut irregular) = (Vec::new(), false);
        let run = start(config);
        let (mut done, mut busy) = (BTreeMap::<u64, usize>::new(), 0);
        if floods {
            let ports: Vec<_> = (0..4).map(|_| node.admin().unwrap()).collect();
            for round in 0..40_u32 {
                read_on(&mut commands, &mut seen, &mut irregular);
                let mut waiting = Vec::new();
                for (port, n) in ports.iter().flat_map(|port| (0..8).map(move |n| (port, n))) {
                    let request = AdminRequest {
                        expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
                        kind: AdminKind::SetGoals as u32,
                        ..AdminRequest::default()
                    };
                    let y = 200.0 + f64::from(round % 5) + f64::from(n) * 0.1;
                    let robot = AdminRobot { id: 3, goal_x_m: 40.0, goal_y_m: y, ..AdminRobot::default() };
                    waiting.push(port.ask(&request, &[robot]).unwrap());
                }
                for one in waiting {
                    let end = Instant::now() + PATIENCE;
                    let answer = loop {
                        if let Some((answer, _)) = one.answer().unwrap() {
                            break answer;
                        }
                        assert!(Instant::now() < end, "every request is answered");
                        std::thread::sleep(Duration::from_micros(200));
                    };
                    match AdminCode::from_code(answer.code) {
                        Some(AdminCode::Done) => *done.entry(answer.acts_from_tick).or_default() += 1,
                        Some(AdminCode::Busy) => busy += 1,
                        other => panic!("{other:?}"),
                    }
                }
            }
            assert!(busy > 0 && !done.is_empty());
            assert_eq!(busy + done.values().sum::<usize>(), 40 * 32);
            assert!(done.values().all(|in_one_period| *in_one_period <= per_period), "{done:?}");
        }
        let end = Instant::now() + PATIENCE;
        while seen.len() < 60 && !irregular && Instant::now() < end {
            read_on(&mut commands, &mut seen, &mut irregular);
            std::thread::sleep(Duration::from_millis(1));
        }
        run.daemon.stop();
        assert_eq!(run.daemon.join().unwrap().control.violations, 0);
        seen
    };
    let (quiet, flooded) = (run_beside("admin_quiet", false), run_beside("admin_flooded", true));
    // On a machine that is too busy there is less to compare, but always the start.
    let both = quiet.len().min(flooded.len());
    assert!(both > 0);
    assert_eq!(quiet[..both], flooded[..both]);
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
