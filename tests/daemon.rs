//! The daemon's threads over real shared memory, in one process.

mod support;

use clearway::attach::Client;
use clearway::channel::{ChannelError, CommandReader, StateReader, TelemetryReader, Transport};
use clearway::controller::Decision;
use clearway::runtime::{Daemon, DaemonError, Decider, Until};
use clearway::scenario::Scenario;
use clearway::schedule::TICK_MAX;
use clearway::wire::{RobotState, SolveStatus, StopReason, admin_flags, state_flags};
use support::process::until;
use support::{Straight, World, config, lanes, straight};

const T: u64 = 10_000_000;

#[test]
fn a_fleet_arrives_and_every_sample_is_seen() {
    let world = World::new("arrives");
    let mut config = config(&world, lanes(3, 1.0), T);
    config.timing.workers = Some(2);
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let daemon = Daemon::start_with(config, Until::Arrived, straight(T)).unwrap();
    let node = transport.attach("watcher").unwrap();
    let (mut states, mut commands): (StateReader, CommandReader) =
        (node.reader().unwrap(), node.reader().unwrap());
    let mut telemetry: TelemetryReader = node.reader().unwrap();
    let (mut state_ticks, mut command_ticks, mut periods) = (vec![], vec![], vec![]);
    let mut last_reasons = vec![];
    let mut over = false;
    while !over {
        over = daemon.is_finished();
        while let Some(sample) = states.next().unwrap() {
            assert_eq!(sample.robots().iter().map(|r| r.id).collect::<Vec<_>>(), [0, 3, 6]);
            assert!(sample.robots().iter().all(|r| r.has(state_flags::VALID)));
            state_ticks.push(sample.header().tick);
        }
        while let Some(sample) = commands.next().unwrap() {
            command_ticks.push(sample.header().tick);
            last_reasons = sample.robots().iter().map(|r| r.stop_reason).collect();
        }
        while let Some(sample) = telemetry.next().unwrap() {
            periods.push(sample.header().tick);
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let report = daemon.join().unwrap();
    assert!(report.success(), "{report:?}");
    assert_eq!((report.control.arrived, report.ended_by, report.workers), (3, "finished", 2));
    assert_eq!(last_reasons, [StopReason::Finished as u32; 3]);
    assert!(state_ticks.windows(2).all(|w| w[0] < w[1]) && !state_ticks.is_empty());
    assert!(command_ticks.windows(2).all(|w| w[0] < w[1]) && !command_ticks.is_empty());
    assert!(!periods.is_empty());
}

#[test]
fn telemetry_tells_how_every_period_went() {
    let world = World::new("telemetry");
    let mut config = config(&world, Scenario::builtin("swap8").unwrap(), 80_000_000);
    config.timing.ticks = Some(6);
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let node = transport.attach("watcher").unwrap();
    let mut telemetry: TelemetryReader = node.reader_or_create(8).unwrap();
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let mut ticks = Vec::new();
    loop {
        let over = daemon.is_finished();
        let Some(sample) = telemetry.next().unwrap() else {
            if over {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
            continue;
        };
        let header = *sample.header();
        ticks.push(header.tick);
        assert_eq!(sample.robots().iter().map(|r| r.id).collect::<Vec<_>>(), (0..8).collect::<Vec<_>>());
        if header.fallback_commands > 0 {
            continue;
        }
        assert!(header.state_to_staged_ns > 0 && header.state_to_command_ns > header.state_to_staged_ns);
        for robot in sample.robots() {
            assert_eq!((robot.status, robot.stop_reason), (SolveStatus::Verified as u32, 0));
            assert!(robot.solve_ns > 0 && robot.step_ns >= robot.solve_ns);
            // From V of nine metres and a half at full speed: a good twenty steps.
            assert!((15..40).contains(&robot.settling_steps), "{}", robot.settling_steps);
            assert!(robot.lyapunov_position_m2 > 10.0 && robot.clearance_m > 0.0);
        }
    }
    assert_eq!(ticks.len() as u64, daemon.join().unwrap().ticks);
}

/// Readers that do not read, or do not give back, hurt nobody but themselves.
#[test]
fn idle_and_hoarding_readers_do_not_hold_the_loop_up() {
    let world = World::new("hoard");
    let mut config = config(&world, lanes(2, 50.0), T);
    config.channel.depth = Some(8);
    config.timing.ticks = Some(60);
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let node = transport.attach("watcher").unwrap();
    let _idle: StateReader = node.reader_or_create(2).unwrap();
    let _idle_too: TelemetryReader = node.reader_or_create(2).unwrap();
    let mut hoarder: StateReader = node.reader_or_create(2).unwrap();
    let daemon = Daemon::start_with(config, Until::Stopped, straight(T)).unwrap();
    let mut hoard = Vec::new();
    let mut refusals = 0;
    while !daemon.is_finished() {
        match hoarder.next() {
            Ok(Some(sample)) => hoard.push(sample),
            Ok(None) => {}
            Err(e) => {
                assert!(e.to_string().contains("held"), "{e}");
                refusals += 1;
            }
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let report = daemon.join().unwrap();
    assert!(refusals > 0 && hoard.len() < 8);
    assert!(report.ticks > 0 && report.ticks <= 60);
    assert_eq!((report.send_failures, report.attach_failures), (0, 0));
    // What the hoarder holds is still what it was.
    assert!(hoard.windows(2).all(|w| w[0].header().tick < w[1].header().tick));
}

#[test]
fn a_second_daemon_is_refused_and_learns_who_owns_the_fleet() {
    let world = World::new("second");
    let first = Daemon::start_with(config(&world, lanes(1, 1.0), T), Until::Stopped, straight(T)).unwrap();
    let second = Daemon::start_with(config(&world, lanes(1, 1.0), T), Until::Stopped, straight(T));
    match second.map(drop) {
        Err(DaemonError::Channel(ChannelError::Owned { fleet, owner: Some(owner) })) => {
            assert_eq!(fleet, "default");
            assert_eq!(owner.pid, i64::from(std::process::id()));
            assert_eq!(owner.node, format!("clearwayd-default-{}", std::process::id()));
        }
        other => panic!("{other:?}"),
    }
    first.stop();
    assert_eq!(first.join().unwrap().ended_by, "operator");
}

/// The real daemon, over real time, across 2³² and to the last tick there is.
#[test]
fn a_run_may_begin_at_a_large_tick() {
    for (first_tick, ticks) in [((1 << 32) - 20, 40), ((1 << 63) - 20, 40), (TICK_MAX - 20, 20)] {
        let world = World::new("large");
        let mut config = config(&world, lanes(2, 1000.0), 5_000_000);
        (config.timing.first_tick, config.timing.ticks) = (first_tick, Some(40));
        let transport = Transport::new(&config.fleet, &config.channel).unwrap();
        let node = transport.attach("watcher").unwrap();
        let mut telemetry: TelemetryReader = node.reader_or_create(2).unwrap();
        let daemon = Daemon::start_with(config, Until::Stopped, straight(5_000_000)).unwrap();
        let mut seen = Vec::new();
        loop {
            let over = daemon.is_finished();
            while let Some(sample) = telemetry.next().unwrap() {
                seen.push(sample.header().tick);
            }
            if over {
                break;
            }
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
        let report = daemon.join().unwrap();
        assert_eq!(report.ended_by, "finished");
        assert_eq!(report.inconsistencies(), Vec::<String>::new());
        assert!(report.ticks + report.skipped_periods <= ticks && report.ticks > 10);
        assert_eq!(seen.len() as u64, report.ticks);
        assert!(seen.is_sorted() && seen.iter().all(|tick| (first_tick..first_tick + ticks).contains(tick)));
    }
}

#[test]
fn a_worker_that_rests_after_repeated_panics_is_told_of_and_the_others_go_on() {
    struct Broken(Straight);
    impl Decider for Broken {
        fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
            if self.0.owned.start == 0 {
                std::panic::resume_unwind(Box::new("a fault, injected"));
            }
            self.0.decide(fleet, each);
        }
    }
    let world = World::new("rests");
    let mut config = config(&world, lanes(2, 5000.0), T);
    config.timing.workers = Some(2);
    let make = straight(T);
    let daemon =
        Daemon::start_with(config.clone(), Until::Stopped, move |owned| make(owned).map(Broken)).unwrap();
    let client = Client::connect_at(&config.fleet, &world.channel).unwrap();
    let (mut admin, mut states) = (client.admin().unwrap(), client.states().unwrap());
    let status = until(|| {
        let status = admin.status().ok()?;
        status.figures.has(admin_flags::WORKER_RESTING).then_some(status)
    });
    assert!(status.figures.worker_panics >= 4, "{:?}", status.figures);
    let sample = until(|| states.next().unwrap().filter(|sample| sample.robots()[1].v_mps > 0.0));
    assert_eq!(sample.robots()[0].v_mps, 0.0);
    drop((sample, states, admin, client));
    daemon.stop();
    daemon.join().unwrap();
}
