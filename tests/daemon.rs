//! The daemon's threads over real shared memory, in one process.

mod support;

use clearway::channel::{ChannelError, CommandReader, StateReader, TelemetryReader, Transport};
use clearway::runtime::{Daemon, DaemonError, Until};
use clearway::wire::{StopReason, state_flags};
use support::{World, config, lanes, straight};

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
