use std::path::Path;

use clearway::attach::Status;
use clearway::channel::{Attached, Member};
use clearway::figures::LatencyHistogram;
use clearway::geometry::Vec2;
use clearway::model::{Obstacle, RobotId};
use clearway::wire::{
    AdminAnswer, CommandHeader, NO_ROBOT, RobotCommand, RobotState, RobotTelemetry, SolveStatus, StateHeader,
    StopReason, TelemetryHeader, admin_flags, state_flags, telemetry_flags,
};

use super::draw::Look;
use super::model::{Law, Model};
use super::robot::{Filter, Sort, listed};
use super::text::columns;
use super::view::{Key, Tab, View};
use super::{json, screen};

const S: u64 = 1_000_000_000;
const PLAIN: Look = Look { colour: false, ascii: false };

fn empty(now_ns: u64) -> Model {
    Model::new("default", LatencyHistogram::new().unwrap(), now_ns)
}

fn state(id: u32, count: u32) -> RobotState {
    let turn = f64::from(id) / f64::from(count) * std::f64::consts::TAU;
    RobotState {
        id,
        flags: state_flags::VALID,
        x_m: 4.0 * turn.cos(),
        y_m: 4.0 * turn.sin(),
        theta_rad: turn,
        v_mps: 1.25,
        goal_x_m: -5.0 * turn.cos(),
        goal_y_m: -5.0 * turn.sin(),
        radius_m: 0.15,
        ..RobotState::default()
    }
}

/// One period of `robots`, released at `at_ns`.
fn period(model: &mut Model, epoch: u64, tick: u64, at_ns: u64, robots: &[RobotState]) {
    let stopped = |id: u32| if id == 3 { StopReason::NoState as u32 } else { 0 };
    let telemetry: Vec<RobotTelemetry> = robots
        .iter()
        .map(|robot| RobotTelemetry {
            id: robot.id,
            stop_reason: stopped(robot.id),
            status: if stopped(robot.id) == 0 { SolveStatus::Verified } else { SolveStatus::NotSolved }
                as u32,
            flags: if robot.id == 5 { telemetry_flags::STALLED } else { 0 },
            solve_ns: 120 + 40 * u64::from(robot.id % 8),
            step_ns: 9_000,
            lyapunov_position_m2: 40.5,
            slack_position_m2: if robot.id == 7 { 0.75 } else { 0.0125 },
            slack_heading: 3e-5,
            clearance_m: 0.5,
            ..RobotTelemetry::default()
        })
        .collect();
    let header = TelemetryHeader {
        epoch,
        tick,
        release_ns: at_ns,
        release_lateness_ns: 13_000 + 100 * (tick % 7),
        state_publish_ns: 29_000,
        state_to_staged_ns: 74_000,
        state_to_command_ns: 84_000,
        fallback_commands: 1,
        ..TelemetryHeader::default()
    };
    model.telemetry(&header, &telemetry);
    let commands: Vec<RobotCommand> = robots
        .iter()
        .map(|robot| RobotCommand { id: robot.id, stop_reason: stopped(robot.id), ..RobotCommand::default() })
        .collect();
    let header = CommandHeader { epoch, tick: tick + 1, ..CommandHeader::default() };
    model.command(&header, &commands);
    seen(model, epoch, tick, at_ns, robots);
}

fn seen(model: &mut Model, epoch: u64, tick: u64, at_ns: u64, robots: &[RobotState]) {
    let header = StateHeader {
        epoch,
        tick,
        stamp_ns: at_ns,
        release_ns: at_ns,
        period_ns: 80_000_000,
        ..StateHeader::default()
    };
    model.state(&header, robots);
}

fn hold(robots: &mut [RobotState], flag: u32) {
    for robot in robots {
        robot.flags |= flag;
    }
}

fn fleet(count: u32) -> Vec<RobotState> {
    (0..count).map(|id| state(id, count)).collect()
}

fn status(epoch: u64) -> Status {
    let figures = AdminAnswer {
        epoch,
        tick: 99,
        period_ns: 80_000_000,
        uptime_ns: 3_725 * S,
        periods: 46_562,
        deadline_misses: 2,
        fallback_commands: 16,
        min_clearance_m: 0.0123,
        capacity: 20,
        robots: 20,
        workers: 2,
        state_readers: 2,
        requests_done: 14,
        flags: admin_flags::DEGRADED,
        ..AdminAnswer::default()
    };
    Status {
        figures,
        degraded: vec!["SCHED_FIFO 80 was refused for the loop: Operation not permitted".into()],
    }
}

/// A run of a hundred periods, watched from its start; and the time at its end.
fn watched(count: u32) -> (Model, u64) {
    let mut model = empty(S);
    model.attached = true;
    let mut robots = fleet(count);
    robots[1].flags |= state_flags::ARRIVED;
    robots[2].flags |= state_flags::FOREIGN;
    robots[3].flags = 0;
    let at = |tick: u64| 20 * S + tick * 80_000_000;
    for tick in 0..100 {
        period(&mut model, 17, tick, at(tick), &robots);
    }
    model.answered(Ok(status(17)));
    model.law = Some(Law {
        epoch: 17,
        profile: "certified".into(),
        solver: "exact".into(),
        policy: "prefer".into(),
        scenario: "circle-20".into(),
        obstacles: vec![Obstacle::Circle { centre_m: Vec2::new(0.0, 0.0), radius_m: 0.8 }],
    });
    model.ports = Some(Attached {
        state_readers: 4,
        command_readers: 1,
        telemetry_readers: 2,
        observation_writers: 0,
        admin_clients: 1,
    });
    let member = |process, executable: &str, role: &str| Member {
        process,
        executable: executable.into(),
        role: role.into(),
    };
    model.members = vec![
        member(4711, "clearwayd", "clearwayd"),
        member(4711, "clearwayd", "clearwayd-house"),
        member(4711, "clearwayd", "clearwayd-worker0"),
        member(4712, "clearway", "clearway-top"),
    ];
    (model, at(99) + 30_000_000)
}

fn drawn(size: (u16, u16), model: &Model, view: &mut View, look: Look, now_ns: u64) -> String {
    json::plain(screen(size, model, view, look, now_ns).into_iter())
}

/// Compares with the screen that is kept in `screens/`; `CLEARWAY_BLESS=1` keeps what is drawn now.
fn compare(name: &str, screen: &str) {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/top/screens").join(name);
    if std::env::var_os("CLEARWAY_BLESS").is_some() {
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, screen).unwrap();
    }
    let kept = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(screen, kept, "{}", path.display());
}

#[test]
fn eighty_by_twenty_four_shows_everything_whole() {
    let (model, now_ns) = watched(20);
    for (tab, name) in Tab::ALL.into_iter().zip(["overview", "robots", "timing", "attached"]) {
        let mut view = View { tab, ..View::default() };
        let screen = drawn((80, 24), &model, &mut view, PLAIN, now_ns);
        assert!(screen.lines().all(|line| columns(line) <= 80), "{screen}");
        compare(&format!("{name}.txt"), &screen);
    }
    let mut view = View { help: true, ..View::default() };
    let help = drawn((80, 24), &model, &mut view, PLAIN, now_ns);
    assert!(!help.contains('…'), "{help}");
    compare("help.txt", &help);

    let overview = drawn((80, 24), &model, &mut View::default(), PLAIN, now_ns);
    for whole in [
        "tick 99",
        "T 80.0 ms",
        "up 1 h 02 min",
        "epoch 17",
        "RUNNING",
        "20 robots",
        "1 arrived",
        "1 stalled",
        "1 unseen",
        "1 failing",
        "certified/exact",
        "DEGRADED",
        "no_state",
        "worst slack",
        "release lateness",
        "state to command",
        "100 ms",
        "missed 2",
        "fallbacks 16",
        "lost 0",
        "not read 0",
        "100 periods",
        "0.012 m",
        "state 2",
        "tel 2",
        "admin 1",
        "4 attached",
        "q quit",
    ] {
        assert!(overview.contains(whole), "{whole}: {overview}");
    }
}

#[test]
fn ascii_says_the_same() {
    let (model, now_ns) = watched(20);
    let look = Look { ascii: true, ..PLAIN };
    for tab in Tab::ALL {
        let mut view = View { tab, ..View::default() };
        let screen = drawn((80, 24), &model, &mut view, look, now_ns);
        assert!(screen.is_ascii(), "{screen}");
        assert_eq!(
            screen.lines().count(),
            drawn((80, 24), &model, &mut View { tab, ..View::default() }, PLAIN, now_ns).lines().count()
        );
    }
}

#[test]
fn no_size_is_too_small_and_no_word_is_cut() {
    let (model, now_ns) = watched(20);
    let nothing = empty(S);
    let mut vocabulary = "more lines ".to_owned();
    for tab in Tab::ALL {
        for help in [false, true] {
            vocabulary +=
                &drawn((400, 100), &model, &mut View { tab, help, ..View::default() }, PLAIN, now_ns);
        }
    }
    for size in [(1, 1), (2, 3), (60, 15), (30, 5), (80, 1), (1, 80), (200, 60), (79, 23), (47, 24), (67, 40)]
    {
        for tab in Tab::ALL {
            for help in [false, true] {
                let mut view = View { tab, help, ..View::default() };
                drawn(size, &nothing, &mut view, PLAIN, now_ns);
                let screen = drawn(size, &model, &mut view, PLAIN, now_ns);
                // What is drawn here is drawn where there is room for everything.
                let words = screen.split_whitespace().filter(|word| word.chars().all(char::is_alphabetic));
                for word in words.filter(|word| word.len() > 1) {
                    let whole = vocabulary.split(|c: char| !c.is_alphabetic()).any(|known| known == word);
                    assert!(whole, "{word} at {size:?}: {screen}");
                }
            }
        }
    }
    let mut stopped_first = View { sort: Sort::Stopped, ..View::default() };
    let small = drawn((60, 15), &model, &mut stopped_first, PLAIN, now_ns);
    assert!(small.contains("state to command") && small.contains("q quit") && small.contains("no_state"));
    let large = drawn((200, 60), &model, &mut View::default(), PLAIN, now_ns);
    assert!(large.contains("clear m") && large.contains("robots 1-20 of 20"), "{large}");
}

#[test]
fn every_reason_to_stop_has_room() {
    let (mut model, now_ns) = watched(4);
    for reason in StopReason::ALL {
        let tick = 100 + u64::from(reason as u32);
        let header = CommandHeader { epoch: 17, tick, ..CommandHeader::default() };
        model.command(&header, &[0, 1, 2, 3].map(|id| RobotCommand::stop(RobotId(id), reason)));
        seen(&mut model, 17, tick, now_ns, &fleet(4));
        let screen = drawn((80, 24), &model, &mut View::default(), PLAIN, now_ns);
        let shown = if reason == StopReason::OutOfStep { "lost step" } else { reason.name() };
        assert!(screen.lines().any(|line| line.trim_end().ends_with(shown)), "{screen}");
        let value = json::object(&model, now_ns, 1.0);
        assert_eq!(value["robots"][0]["stop_reason"], reason.name());
    }
}

#[test]
fn an_operator_is_told_what_is_wrong() {
    let (mut model, now_ns) = watched(20);
    assert!(model.is_live(now_ns));
    let later_ns = now_ns + 2 * S;
    assert!(!model.is_live(later_ns));
    let screen = drawn((80, 24), &model, &mut View::default(), PLAIN, later_ns);
    assert!(screen.contains("SILENT") && screen.contains("no state for 2.0 s"), "{screen}");
    model.attached = false;
    let screen = drawn((80, 24), &model, &mut View::default(), PLAIN, later_ns);
    assert!(screen.contains("WAITING") && screen.contains("the daemon has ended"), "{screen}");

    let (mut model, now_ns) = watched(20);
    model.answered(Err("the daemon did not answer within 800 ms".into()));
    assert!(model.status.is_some(), "the last answer stays");
    assert!(model.alerts(now_ns)[0].starts_with("admin: the daemon did not answer"));

    let mut robots = fleet(4);
    hold(&mut robots, state_flags::PAUSED);
    period(&mut model, 17, 100, now_ns, &robots);
    assert_eq!(model.hold(), Some("PAUSED"));
    hold(&mut robots, state_flags::STOPPED);
    period(&mut model, 17, 101, now_ns, &robots);
    assert_eq!(model.hold(), Some("STOPPED"));
}

/// What the journal has to tell an operator: drawn whole, gravest first, and with what to do about it.
#[test]
fn the_journal_s_alerts_are_drawn() {
    const RESTARTS: &str = "STOPPED: restarted after a crash 3 times; clear, then resume";
    const UNREADABLE: &str = "STOPPED: the journal could not be read; clear, then resume";
    const UNWRITABLE: &str = "the journal cannot be written: orders do not survive a restart";
    let (mut model, now_ns) = watched(20);
    let alerts = |model: &mut Model, flags: u32| {
        let mut told = status(17);
        told.figures.flags |= flags;
        told.figures.restarts = 3;
        model.answered(Ok(told));
        // The line of its own below the state of the fleet, as it stands on the screen.
        let screen = drawn((80, 24), model, &mut View::default(), PLAIN, now_ns);
        screen.lines().nth(2).unwrap().trim_end().to_owned()
    };
    let stopped = admin_flags::STOPPED | admin_flags::JOURNAL;
    for (flags, line) in [
        (stopped | admin_flags::STOPPED_BY_RESTARTS, RESTARTS),
        (stopped | admin_flags::STOPPED_BY_JOURNAL, UNREADABLE),
        (admin_flags::JOURNAL | admin_flags::JOURNAL_FAILING, UNWRITABLE),
    ] {
        assert!(alerts(&mut model, flags).starts_with(line), "{line}");
    }
    // Both: why it stands comes first, and where there is room the other stands beside it.
    let both = stopped | admin_flags::STOPPED_BY_JOURNAL | admin_flags::JOURNAL_FAILING;
    assert!(alerts(&mut model, both).starts_with(UNREADABLE));
    let wide = drawn((200, 24), &model, &mut View::default(), PLAIN, now_ns);
    assert!(wide.lines().nth(2).unwrap().contains(&format!("{UNREADABLE}  {UNWRITABLE}")), "{wide}");
    // Nothing of it once an operator has cleared the stop, or who stopped it was one.
    for flags in [admin_flags::JOURNAL | admin_flags::STOPPED_BY_RESTARTS, stopped] {
        let line = alerts(&mut model, flags);
        assert!(line.starts_with("DEGRADED"), "{line}");
    }
}

#[test]
fn a_restarted_daemon_is_a_new_run_and_the_old_one_is_not_listened_to() {
    let (mut model, now_ns) = watched(20);
    period(&mut model, 18, 0, now_ns, &fleet(8));
    assert!(model.status.is_none() && model.law.is_none());
    let run = model.run.as_ref().unwrap();
    assert_eq!((run.epoch, run.telemetry.samples, run.robots.len()), (18, 1, 8));
    period(&mut model, 17, 100, now_ns, &fleet(20));
    model.answered(Ok(status(17)));
    assert_eq!(model.run.as_ref().unwrap().epoch, 18);
    assert!(model.status.is_none());
    // The answer of a run that is about to be seen is kept.
    model.answered(Ok(status(19)));
    period(&mut model, 19, 0, now_ns, &fleet(8));
    assert!(model.status.is_some());
}

#[test]
fn what_was_not_read_is_counted_and_what_never_ran_is_not() {
    let mut model = empty(S);
    let robots = fleet(2);
    let mut telemetry = |tick, skipped, lost| {
        let header = TelemetryHeader {
            epoch: 1,
            tick,
            skipped_periods: skipped,
            lost_records: lost,
            ..TelemetryHeader::default()
        };
        model.telemetry(&header, &[]);
    };
    // Nobody watched before tick 10.
    telemetry(10, 4, 1);
    telemetry(11, 0, 0);
    // 12 and 13 never ran, 14 was lost by the daemon, 15 and 16 by this monitor.
    telemetry(17, 2, 1);
    let run = model.run.as_ref().unwrap();
    let c = &run.counters;
    assert_eq!((c.skipped, c.lost_records, c.dropped, run.telemetry.samples), (2, 1, 2, 3));
    let state = |tick| StateHeader { epoch: 1, tick, ..StateHeader::default() };
    for tick in [10, 11, 14, 16] {
        model.state(&state(tick), &robots);
    }
    // Three ticks are missing, two of them never ran.
    assert_eq!(model.run.as_ref().unwrap().overwritten(), 1);
}

#[test]
fn a_thousand_robots_scroll_sort_and_filter() {
    let mut model = empty(S);
    model.attached = true;
    let mut robots = fleet(1000);
    robots[3].flags = 0;
    robots[999].flags |= state_flags::VACANT;
    robots[999].id = NO_ROBOT;
    for tick in 0..2 {
        period(&mut model, 1, tick, 20 * S + tick, &robots);
    }
    let run = model.run.as_ref().unwrap();
    let ids = |sort, filter| listed(&run.robots, sort, filter).iter().map(|r| r.state.id).collect::<Vec<_>>();
    assert_eq!((ids(Sort::Slack, Filter::All).len(), ids(Sort::Slack, Filter::All)[0]), (999, 7));
    assert_eq!(ids(Sort::Stopped, Filter::All)[..3], [3, 5, 0]);
    assert_eq!(ids(Sort::Id, Filter::Standing), [3, 5]);
    assert_eq!(ids(Sort::Solve, Filter::All)[0], 7);

    let mut view = View { tab: Tab::Robots, sort: Sort::Id, ..View::default() };
    let shown = |view: &mut View, keys: &[Key]| {
        for key in keys {
            view.press(*key);
        }
        drawn((80, 24), &model, view, PLAIN, 20 * S)
    };
    assert!(shown(&mut view, &[]).contains("robots 1-18 of 999"));
    assert!(shown(&mut view, &[Key::Last]).contains("robots 982-999 of 999"));
    assert!(shown(&mut view, &[Key::PageUp, Key::Up]).contains("robots 980-997 of 999"));
    assert!(shown(&mut view, &[Key::First]).contains("robots 1-18 of 999"));
    assert!(shown(&mut view, &[Key::Filter, Key::Filter, Key::PageDown]).contains("robots 1-2 of 2"));
    assert!(shown(&mut view, &[Key::Filter, Key::Tab(2)]).contains("since attached"));
}

#[test]
fn a_script_gets_the_same_figures() {
    let (model, now_ns) = watched(20);
    let value = json::object(&model, now_ns, 8.0);
    assert_eq!((&value["epoch"], &value["tick"], &value["live"]), (&17.into(), &99.into(), &true.into()));
    assert_eq!(value["robots"].as_array().unwrap().len(), 20);
    assert_eq!(
        (&value["robots"][3]["stop_reason"], &value["robots"][7]["slack_position_m2"]),
        (&"no_state".into(), &0.75.into())
    );
    assert_eq!(
        (&value["window"]["telemetry"], &value["window"]["fallback_commands"]),
        (&100.into(), &100.into())
    );
    assert_eq!(value["window"]["solve_ns"]["count"], 1900);
    assert_eq!(value["window"]["release_lateness_ns"]["count"], 100);
    assert_eq!((&value["daemon"]["deadline_misses"], &value["profile"]), (&2.into(), &"certified".into()));
    assert_eq!(
        (&value["attached"]["state_readers"], &value["members"][3]["role"]),
        (&4.into(), &"clearway-top".into())
    );

    let nothing = json::object(&empty(S), S, 1.0);
    assert!(nothing["epoch"].is_null() && nothing["robots"].is_null() && nothing["daemon"].is_null());
    assert_eq!(nothing["live"], false);
}
