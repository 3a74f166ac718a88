//! Others on the channels: who writes what is not his, who is of yesterday, who reads and does not give back.

mod support;

use std::time::Duration;

use clearway::attach::Client;
use clearway::channel::{ChannelError, CommandReader, Reader, Transport, Writer};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::ChannelConfig;
use clearway::scenario::Scenario;
use clearway::wire::{RobotCommand, RobotObservation, RobotState, StopReason};
use rustix::process::Signal;
use support::{
    Listener, Process, World, clearance, client, daemon, file, plant, report, text, trajectory, until,
    until_driven, within,
};

const ENDLESS: &str = "schema = 1\nscenario = \"swap8\"\n";
const FAST: &str = "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 10_000\n";

fn transport(world: &World) -> Transport {
    Transport::new("default", &world.channel).unwrap()
}

#[test]
fn a_second_writer_of_commands_is_refused_and_one_that_was_first_is_named() {
    let world = World::new("second_writer");
    let config = file(&world, "fleet.toml", FAST);
    let control = daemon(&world, &["--config", &config]);
    let reader = client(&world);
    Listener::new(&reader).until(|header, _| header.tick > 2);
    let stranger = transport(&world).visit("stranger").unwrap();
    for refused in [stranger.writer::<RobotCommand>(8).map(drop), stranger.writer::<RobotState>(8).map(drop)]
    {
        match refused {
            Err(ChannelError::Owned { owner: Some(owner), .. }) => {
                assert_eq!(owner.pid, i64::from(control.0.id()));
            }
            other => panic!("{other:?}"),
        }
    }
    let mut admin = until(|| reader.admin().ok()).with_timeout(Duration::from_secs(30));
    assert_eq!(admin.status().unwrap().figures.lost_records, 0);
    control.signal(Signal::TERM);
    control.succeed();
    drop((stranger, admin, reader));

    // While there is no daemon, the place is free: the next one does not start beside a stranger.
    let first = transport(&world).attach("stranger").unwrap();
    let held: Writer<RobotCommand> = first.writer(8).unwrap();
    let run = daemon(&world, &["--config", &config]).output();
    let said = text(&run.stderr);
    assert_eq!(run.status.code(), Some(3), "{said}");
    assert!(said.contains(&std::process::id().to_string()), "{said}");
    drop((held, first));
}

#[test]
fn commands_of_an_earlier_run_are_refused_and_counted_and_move_nobody() {
    let world = World::new("yesterday");
    let config = file(&world, "fleet.toml", ENDLESS);
    let robots = plant(&world, "all", &[]);
    let mut epochs = Vec::new();
    for way_m in [0.8, 1.6] {
        let control = daemon(&world, &["--config", &config]);
        let reader = client(&world);
        let mut listener = Listener::new(&reader);
        until_driven(&world, "all", 0, way_m);
        epochs.push(listener.listen().unwrap().0.epoch);
        drop((listener, reader));
        control.kill();
    }
    assert!(epochs[0] < epochs[1], "{epochs:?}");

    // Somebody takes the place of the daemon that was killed, and speaks as the one before.
    let node = transport(&world).attach("masquerade").unwrap();
    let mut forged: Writer<RobotCommand> = until(|| node.writer(8).ok());
    let (mut sent, began_ns) = (0_u64, MonotonicClock.now_ns());
    let moved = || trajectory(&world, "all").iter().filter(|r| support::moves(r)).map(|r| r.to_ns).max();
    until(|| {
        let now_ns = MonotonicClock.now_ns();
        sent += 1;
        let published = forged.publish(|header, robots| {
            (header.epoch, header.tick, header.stamp_ns) = (epochs[0], 1_000_000 + sent, now_ns);
            (header.valid_from_ns, header.valid_until_ns) = (now_ns, now_ns + 80_000_000);
            for (id, robot) in (0..).zip(robots) {
                *robot = RobotCommand { id, v_mps: 5.0, ..RobotCommand::default() };
            }
        });
        published.unwrap();
        std::thread::sleep(Duration::from_millis(10));
        (sent >= 60).then_some(())
    });
    assert!(moved() < Some(began_ns + 160_000_000), "{:?} {began_ns}", moved());
    drop((forged, node));

    // The next daemon goes on from where they stand.
    let mut control = daemon(&world, &[]);
    let reader = client(&world);
    let mut listener = Listener::new(&reader);
    listener.while_running(&mut control);
    control.succeed();
    robots.signal(Signal::TERM);
    robots.succeed();
    let own = report(&world, "all");
    assert!(own["commands"]["refused"].as_u64() >= Some(8 * 30), "{own}");
    assert_eq!((own["epochs"].as_u64(), own["arrived"].as_u64()), (Some(3), Some(8)), "{own}");
    let (clearance_m, violations) =
        clearance(&Scenario::builtin("swap8").unwrap(), &trajectory(&world, "all"));
    assert_eq!(violations, 0, "{clearance_m} m");
}

#[test]
fn observations_of_a_stranger_and_of_another_run_are_refused_and_counted() {
    let world = World::new("stranger");
    let mut control = daemon(&world, &["--report", "daemon.json"]);
    let reader = client(&world);
    let mut listener = Listener::new(&reader);
    let robots = plant(&world, "all", &["--once"]);
    until_driven(&world, "all", 0, 0.3);
    let epoch = listener.listen().unwrap().0.epoch;
    let node = transport(&world).visit("stranger").unwrap();
    let mut forged: Writer<RobotObservation> = node.observer(8).unwrap();
    for sequence in 1..100 {
        let sent = forged.publish(|header, robots| {
            // Every second one of the run before.
            let epoch = epoch - sequence % 2;
            (header.epoch, header.sequence, header.stamp_ns) = (epoch, sequence, MonotonicClock.now_ns());
            for (id, robot) in (0..).zip(robots) {
                *robot = RobotObservation { id, x_m: 1.0, y_m: 1.0, ..RobotObservation::default() };
            }
        });
        sent.unwrap();
        listener.listen();
        std::thread::sleep(Duration::from_millis(5));
    }
    drop((forged, node));
    listener.while_running(&mut control);
    control.succeed();
    robots.succeed();
    let (daemon, own) = (report(&world, "daemon"), report(&world, "all"));
    let refused = &daemon["rejected_inputs"];
    assert!(refused["epoch"].as_u64() > Some(0) && refused["foreign_writer"].as_u64() > Some(0), "{refused}");
    assert_eq!((own["arrived"].as_u64(), own["violations"].as_u64()), (Some(8), Some(0)), "{own}");
    listener.assert_obeyed(&trajectory(&world, "all"));
}

#[test]
fn everybody_is_told_to_stop_when_the_only_source_of_states_is_killed() {
    let world = World::new("no_source");
    let config = file(&world, "fleet.toml", ENDLESS);
    let control = daemon(&world, &["--config", &config, "--report", "daemon.json"]);
    let reader = client(&world);
    let mut listener = Listener::new(&reader);
    let robots = plant(&world, "all", &[]);
    until_driven(&world, "all", 0, 0.8);
    robots.kill();
    let no_state = StopReason::NoState as u32;
    listener.until(|_, robots| robots.iter().all(|c| c.stop_reason == no_state));
    let from = listener.listen().unwrap().0.tick;
    listener.until(|header, _| header.tick > from + 10);
    let after = listener.heard.iter().filter(|(header, _)| header.tick >= from);
    assert!(after.flat_map(|(_, robots)| robots).all(|c| (c.v_mps, c.omega_radps) == (0.0, 0.0)));
    control.signal(Signal::TERM);
    control.succeed();
    let daemon = report(&world, "daemon");
    assert!(daemon["stops"]["no_state"].as_u64() >= Some(80), "{daemon}");
    assert_eq!(daemon["violations"].as_u64(), Some(0));
}

#[test]
fn a_daemon_that_is_killed_again_and_again_is_cleaned_up_after() {
    let world = World::new("again");
    let config = file(&world, "fleet.toml", FAST);
    let mut files = Vec::new();
    let mut last_epoch = 0;
    for _ in 0..6 {
        let control = daemon(&world, &["--config", &config]);
        let epoch = until(|| {
            let client = Client::connect_at("default", &world.channel).ok()?;
            let mut commands = client.commands().ok()?;
            // One of its own, and not the last that the dead one left.
            let sample = commands.wait(Duration::from_secs(5)).ok()??;
            Some(sample.header().epoch).filter(|epoch| *epoch > last_epoch)
        });
        last_epoch = epoch;
        files.push(world.files().len());
        assert_eq!(
            transport(&world).census().unwrap().alive,
            transport(&world).members().unwrap().len() as u64
        );
        control.kill();
    }
    // The dead are still listed; as many files as after the first start, whoever is cleaned up in between.
    assert!(transport(&world).census().unwrap().dead > 0);
    assert!(files.iter().all(|count| *count <= files[0] + 2), "{files:?}");
    let control = daemon(&world, &["--config", &config]);
    let reader = client(&world);
    until(|| (transport(&world).census().unwrap().dead == 0).then_some(()));
    let mut admin = until(|| reader.admin().ok()).with_timeout(Duration::from_secs(30));
    let figures = admin.status().unwrap().figures;
    assert_eq!((figures.lost_records, figures.worker_panics), (0, 0));
    control.signal(Signal::TERM);
    control.succeed();
}

/// Not a test of its own: a reader that keeps what it reads until it is refused more, and goes on asking.
#[test]
fn hoarding_process() {
    if std::env::var_os("CLEARWAY_TEST_HOARD").is_none() {
        return;
    }
    let client = until(|| Client::connect_at("default", &ChannelConfig::default().with_environment()).ok());
    let (mut states, mut commands) = (client.states().unwrap(), client.commands().unwrap());
    let (mut held, mut orders, mut refused) = (Vec::new(), Vec::new(), 0);
    loop {
        match (states.next(), commands.next()) {
            (Ok(state), Ok(command)) => {
                held.extend(state);
                orders.extend(command);
            }
            _ => refused += 1,
        }
        if refused == 50 {
            println!("hoarding");
        }
        std::thread::sleep(Duration::from_millis(1));
    }
}

#[test]
fn readers_that_stand_still_or_give_nothing_back_hold_nobody_up() {
    let world = World::new("hoarders");
    let config = file(&world, "fleet.toml", FAST);
    let control =
        daemon(&world, &["--config", &config, "--set", "source.kind=plant", "--report", "daemon.json"]);
    let reader = client(&world);
    let node = transport(&world).visit("test").unwrap();
    let mut commands: CommandReader = until(|| node.reader().ok());
    let hoard = || {
        let mut command = within(
            &world,
            &std::env::current_exe().unwrap(),
            &["--exact", "hoarding_process", "--nocapture"],
        );
        command.env("CLEARWAY_TEST_HOARD", "1");
        Process::start(command)
    };
    let (mut hoarder, still) = (hoard(), hoard());
    let readers = || node.attached().command_readers;
    until(|| (readers() == 3).then_some(()));
    still.pause();
    let mut lines = std::io::BufReader::new(hoarder.0.stdout.take().unwrap());
    let mut said = String::new();
    while !said.contains("hoarding") {
        assert_ne!(std::io::BufRead::read_line(&mut lines, &mut said).unwrap(), 0, "{said}");
    }
    // Far more samples than any reader has room for.
    let newest = |commands: &mut Reader<RobotCommand>| commands.newest().unwrap().map(|s| s.header().tick);
    let from = until(|| newest(&mut commands));
    until(|| newest(&mut commands).filter(|tick| *tick > from + 200));
    let mut admin = until(|| reader.admin().ok()).with_timeout(Duration::from_secs(30));
    let figures = admin.status().unwrap().figures;
    assert_eq!((figures.lost_records, figures.worker_panics), (0, 0));
    still.kill();
    hoarder.kill();
    control.signal(Signal::TERM);
    control.succeed();
    let daemon = report(&world, "daemon");
    assert_eq!(
        (daemon["send_failures"].as_u64(), daemon["violations"].as_u64()),
        (Some(0), Some(0)),
        "{daemon}"
    );
}
