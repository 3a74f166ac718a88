//! What the daemon keeps over its end, whatever ends it.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::path::{Path, PathBuf};
use std::time::Duration;

use clearway::attach::{AdminClient, AdminError, Client, Status};
use clearway::journal::{Kept, StoppedBy};
use clearway::wire::{AdminCode, admin_flags};
use rustix::process::Signal;
use support::World;
use support::process::{Process, file, text, until, within};

const FLEET: &str = "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 10_000\n";

fn journal(world: &World) -> PathBuf {
    world.channel.root.join("fleet.journal")
}

fn kept(world: &World) -> Kept {
    Kept::decode(&std::fs::read(journal(world)).unwrap()).unwrap()
}

fn daemon(world: &World, more: &[&str]) -> Process {
    let config = file(world, "fleet.toml", FLEET);
    let program = Path::new(env!("CARGO_BIN_EXE_clearwayd"));
    let mut command = within(world, program, &["--set", "realtime.policy=off", "--config", &config]);
    command.arg("--journal").arg(journal(world)).args(more);
    Process::start(command)
}

/// An operator of the run after `epoch`, once it answers; with its first status.
fn operator(world: &World, epoch: u64) -> (Client, AdminClient, Status) {
    until(|| {
        let client = Client::connect_at("default", &world.channel).ok()?;
        let mut admin = client.admin().ok()?.with_timeout(Duration::from_millis(200));
        // One that was killed may still be listed.
        let status = admin
            .status()
            .ok()
            .filter(|status| status.figures.epoch > epoch && status.figures.periods > 0)?;
        Some((client, admin.with_timeout(Duration::from_secs(20)), status))
    })
}

fn goal_of(admin: &mut AdminClient, id: u32) -> (f64, f64) {
    let scenario = clearway::scenario::Scenario::parse(&admin.scenario().unwrap(), "now.toml").unwrap();
    let goal_m = scenario.robots.iter().find(|robot| robot.id.0 == id).unwrap().goal_m;
    (goal_m.x, goal_m.y)
}

#[test]
fn goals_and_a_latched_stop_outlive_a_kill_and_an_orderly_end() {
    let world = World::new("kept");
    let first = daemon(&world, &[]);
    let (client, mut admin, status) = operator(&world, 0);
    assert!(status.figures.has(admin_flags::JOURNAL) && !status.is_stopped());
    admin.set_goals(&[(0, -6.5, 3.25), (1, -6.5, -3.25)]).unwrap();
    admin.remove_robot(7).unwrap();
    admin.stop().unwrap();
    // All three were answered: they are on the disk.
    first.kill();
    drop((admin, client));

    let second = daemon(&world, &[]);
    let (client, mut admin, again) = operator(&world, status.figures.epoch);
    assert!(again.is_stopped() && again.stopped_at_start().is_none());
    assert_eq!((again.figures.robots, again.figures.capacity, again.figures.restarts), (7, 8, 1));
    assert_eq!((goal_of(&mut admin, 0), goal_of(&mut admin, 1)), ((-6.5, 3.25), (-6.5, -3.25)));
    let mut states = client.states().unwrap();
    let sample = until(|| states.next().unwrap());
    assert!(
        sample.robots().iter().filter(|robot| robot.id != u32::MAX).all(clearway::wire::RobotState::is_held)
    );
    drop((sample, states));
    admin.clear().unwrap();
    second.signal(Signal::TERM);
    drop((admin, client));
    assert_eq!(second.output().status.code(), Some(0));
    let left = kept(&world);
    assert!(left.ended && left.paused && left.stopped.is_none() && left.restarts.at_ns.is_empty());

    let third = daemon(&world, &[]);
    let (client, mut admin, third_status) = operator(&world, again.figures.epoch);
    assert!(third_status.is_paused() && !third_status.is_stopped());
    assert_eq!(goal_of(&mut admin, 0), (-6.5, 3.25));
    admin.resume().unwrap();
    third.signal(Signal::TERM);
    drop((admin, client));
    let run = third.output();
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stderr).contains("was paused and still is"), "{}", text(&run.stderr));

    // Begun anew: as the scenario says, and the old one is still there.
    let fresh = daemon(&world, &["--fresh"]);
    let (client, mut admin, status) = operator(&world, third_status.figures.epoch);
    assert_eq!((status.figures.robots, status.is_paused()), (8, false));
    assert_ne!(goal_of(&mut admin, 0), (-6.5, 3.25));
    assert!(world.channel.root.join("fleet.journal.before-fresh-1").exists());
    drop((admin, client));
    fresh.signal(Signal::TERM);
    assert_eq!(fresh.output().status.code(), Some(0));
}

#[test]
fn a_daemon_that_keeps_crashing_comes_up_stopped_until_somebody_clears_it() {
    let world = World::new("crashes");
    let mut epoch = 0;
    let mut stopped = Vec::new();
    for _ in 0..5 {
        let process = daemon(&world, &[]);
        let (_client, _admin, status) = operator(&world, epoch);
        epoch = status.figures.epoch;
        stopped.push(status.stopped_at_start());
        process.kill();
    }
    // The third restart, and it stays so.
    assert_eq!(stopped, [None, None, None, Some(StoppedBy::Restarts), Some(StoppedBy::Restarts)]);
    let process = daemon(&world, &[]);
    let (client, mut admin, status) = operator(&world, epoch);
    assert!(status.is_stopped() && status.figures.restarts >= 3);
    assert!(matches!(admin.resume(), Err(AdminError::Refused { code: Some(AdminCode::Stopped), .. })));
    admin.clear().unwrap();
    admin.resume().unwrap();
    assert_eq!(admin.status().unwrap().figures.restarts, 0);
    drop((admin, client));
    process.kill();
    // Counted from the beginning again.
    let process = daemon(&world, &[]);
    let (client, admin, status) = operator(&world, status.figures.epoch);
    assert_eq!((status.is_stopped(), status.figures.restarts), (false, 1));
    drop((admin, client));
    process.signal(Signal::TERM);
    let run = process.output();
    assert!(text(&run.stderr).contains("did not end in order"), "{}", text(&run.stderr));
}

#[test]
fn a_damaged_journal_stops_the_fleet_and_is_kept_aside() {
    let world = World::new("damaged");
    file(&world, "fleet.journal", "# clearway-journal 1 12 0\nfleet = ");
    let process = daemon(&world, &[]);
    // Above any time since a start of the machine.
    let (client, admin, status) = operator(&world, 1 << 60);
    assert_eq!(status.stopped_at_start(), Some(StoppedBy::Journal));
    assert_eq!(std::fs::read(world.channel.root.join("fleet.journal.damaged-1")).unwrap().len(), 34);
    assert_eq!(kept(&world).stopped, Some(StoppedBy::Journal));
    drop((admin, client));
    process.signal(Signal::TERM);
    let run = process.output();
    let said = text(&run.stderr);
    assert!(said.contains("fleet.journal: it is torn") && said.contains("clearway resume"), "{said}");
}

#[test]
fn a_journal_of_another_fleet_is_left_alone_and_one_of_another_scenario_keeps_the_stop() {
    let world = World::new("others");
    let scenario = clearway::scenario::Scenario::builtin("circle-5").unwrap();
    let night = Kept::new("night", &scenario).encode();
    file(&world, "fleet.journal", &night);
    let run = daemon(&world, &[]).output();
    assert_eq!(run.status.code(), Some(2), "{}", text(&run.stderr));
    assert!(text(&run.stderr).contains("`night`"), "{}", text(&run.stderr));
    assert_eq!(std::fs::read_to_string(journal(&world)).unwrap(), night);
    let run = daemon(&world, &["--fresh"]).output();
    assert_eq!(run.status.code(), Some(2), "{}", text(&run.stderr));
    assert_eq!(std::fs::read_to_string(journal(&world)).unwrap(), night);

    let mut other = Kept::new("default", &scenario);
    (other.stopped, other.ended, other.epoch) = (Some(StoppedBy::Operator), true, 1 << 60);
    file(&world, "fleet.journal", &other.encode());
    let process = daemon(&world, &[]);
    // The epoch rises over those of an earlier boot as well.
    let (client, admin, status) = operator(&world, 1 << 60);
    assert_eq!((status.is_stopped(), status.figures.robots), (true, 8));
    assert!(world.channel.root.join("fleet.journal.other-scenario-1").exists());
    drop((admin, client));
    process.signal(Signal::TERM);
    assert_eq!(process.output().status.code(), Some(0));
}

#[test]
fn what_cannot_be_kept_is_in_force_and_not_answered_done() {
    let world = World::new("unkept");
    let process = daemon(&world, &[]);
    let (client, mut admin, _) = operator(&world, 0);
    // Nothing can be written beside the journal.
    let in_the_way = world.channel.root.join("fleet.journal.new");
    std::fs::create_dir(&in_the_way).unwrap();
    let refused = admin.stop().unwrap_err();
    assert_eq!(refused.code(), Some(AdminCode::NotKept), "{refused}");
    let status = admin.status().unwrap();
    assert!(status.is_stopped() && status.figures.has(admin_flags::JOURNAL_FAILING));
    assert_eq!(kept(&world).stopped, None);
    std::fs::remove_dir(&in_the_way).unwrap();
    // It tries again by itself.
    until(|| (!admin.status().unwrap().figures.has(admin_flags::JOURNAL_FAILING)).then_some(()));
    assert_eq!(kept(&world).stopped, Some(StoppedBy::Operator));
    admin.set_goal(0, -6.5, 3.25).unwrap();
    drop((admin, client));
    process.signal(Signal::TERM);
    assert!(text(&process.output().stderr).contains("cannot be written"));
}

#[test]
fn a_supervisor_says_where_the_journal_lives_and_a_single_run_has_none() {
    let world = World::new("state");
    let config = file(&world, "fleet.toml", FLEET);
    let program = Path::new(env!("CARGO_BIN_EXE_clearwayd"));
    let run = |arguments: &[&str]| {
        let mut command = within(&world, program, &["--set", "realtime.policy=off", "--ticks", "3"]);
        let command = {
            command.args(arguments).env("STATE_DIRECTORY", &world.channel.root);
            command
        };
        Process::start(command).output()
    };
    run(&[]);
    assert!(!world.channel.root.join("default.journal").exists());
    let alone = run(&["--journal", "x"]);
    assert_eq!(alone.status.code(), Some(2), "{}", text(&alone.stderr));
    let said = text(&run(&["--config", &config]).stderr);
    assert!(said.contains("journal    ") && said.contains("default.journal"), "{said}");
    let left = std::fs::read(world.channel.root.join("default.journal")).unwrap();
    assert!(Kept::decode(&left).unwrap().ended);
    let nowhere = run(&["--config", &config, "--journal", "/no/such/directory/x"]);
    assert_eq!(nowhere.status.code(), Some(5), "{}", text(&nowhere.stderr));
    assert!(text(&nowhere.stderr).contains("/no/such/directory"), "{}", text(&nowhere.stderr));
}
