//! A fleet whose states come from another writer over the `observation` channel.

mod support;

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use clearway::admission::Rejection;
use clearway::channel::{CommandReader, StateReader, Transport, Writer};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{Config, SourceKind};
use clearway::plant::Plant;
use clearway::runtime::{Daemon, Until};
use clearway::wire::{RobotCommand, RobotObservation, StopReason, state_flags};
use support::{World, config, lanes, straight};

const T: u64 = 20_000_000;

/// A plant in a thread of its own: moves as it is told, and tells where it is every 2 ms.
struct External {
    done: AtomicBool,
    /// 0: says the truth; 1: falls silent; 2: robot 0 has no finite position.
    mood: AtomicU32,
}

impl External {
    fn new() -> Self {
        Self { done: AtomicBool::new(false), mood: AtomicU32::new(0) }
    }

    fn run(&self, config: &Config) {
        let robots = config.scenario.robots.len();
        let node = Transport::new(&config.fleet, &config.channel).unwrap().attach("plant").unwrap();
        let mut observations: Writer<RobotObservation> = node.writer(robots).unwrap();
        let mut commands: CommandReader = node.reader_or_create(robots).unwrap();
        let mut plant = Plant::new(&config.scenario, T, MonotonicClock.now_ns());
        let (mut sequence, mut epoch) = (0, 0);
        while !self.done.load(Ordering::Relaxed) {
            let now_ns = MonotonicClock.now_ns();
            plant.advance(now_ns);
            while let Some(sample) = commands.next().unwrap() {
                epoch = sample.header().epoch;
                for (index, command) in sample.robots().iter().enumerate() {
                    // A late command is refused, and the robot stands: that is the gate's to decide.
                    let _ = plant.command(index, sample.header(), command, now_ns);
                }
            }
            let mood = self.mood.load(Ordering::Relaxed);
            if mood != 1 {
                sequence += 1;
                let sent = observations.publish(|header, records| {
                    (header.epoch, header.sequence, header.stamp_ns) = (epoch, sequence, now_ns);
                    for ((record, pose), spec) in
                        records.iter_mut().zip(plant.poses()).zip(&config.scenario.robots)
                    {
                        let x_m = if mood == 2 && spec.id.0 == 0 { f64::NAN } else { pose.position_m.x };
                        *record = RobotObservation {
                            id: spec.id.0,
                            reserved: 0,
                            x_m,
                            y_m: pose.position_m.y,
                            theta_rad: pose.theta_rad,
                        };
                    }
                });
                sent.unwrap();
            }
            std::thread::sleep(Duration::from_millis(2));
        }
    }
}

/// Runs `body` beside an external plant.
fn beside_a_plant(config: &Config, body: impl FnOnce(&External)) {
    struct Done<'a>(&'a External);
    impl Drop for Done<'_> {
        fn drop(&mut self) {
            self.0.done.store(true, Ordering::Relaxed);
        }
    }
    let external = External::new();
    std::thread::scope(|scope| {
        let _done = Done(&external);
        scope.spawn(|| external.run(config));
        body(&external);
    });
}

fn observed(world: &World, length_m: f64) -> Config {
    let mut config = config(world, lanes(2, length_m), T);
    config.source.kind = SourceKind::Observation;
    config
}

#[test]
fn an_external_plant_drives_to_its_goals() {
    let world = World::new("external");
    let config = observed(&world, 2.0);
    beside_a_plant(&config, |_| {
        let report = Daemon::start_with(config.clone(), Until::Arrived, straight(T)).unwrap().join().unwrap();
        assert_eq!((report.control.arrived, report.ended_by), (2, "finished"), "{report:?}");
        assert_eq!(report.rejected_inputs.get(Rejection::NotFinite), 0);
    });
}

/// The robots' stop reasons in the newest command, once `wanted` is what they are.
fn until_reasons(commands: &mut CommandReader, wanted: [u32; 2]) {
    loop {
        if let Some(sample) = commands.newest().unwrap() {
            let reasons = sample.robots().iter().map(|c: &RobotCommand| c.stop_reason);
            if reasons.eq(wanted) {
                return;
            }
        }
        std::thread::sleep(Duration::from_millis(2));
    }
}

#[test]
fn silence_and_nonsense_stop_the_robots_they_concern() {
    let world = World::new("silence");
    let config = observed(&world, 1000.0);
    let no_state = StopReason::NoState as u32;
    beside_a_plant(&config, |external| {
        let daemon = Daemon::start_with(config.clone(), Until::Stopped, straight(T)).unwrap();
        let node = Transport::new(&config.fleet, &config.channel).unwrap().attach("watcher").unwrap();
        let mut commands: CommandReader = node.reader().unwrap();
        until_reasons(&mut commands, [0, 0]);
        external.mood.store(1, Ordering::Relaxed);
        until_reasons(&mut commands, [no_state, no_state]);
        external.mood.store(0, Ordering::Relaxed);
        until_reasons(&mut commands, [0, 0]);
        external.mood.store(2, Ordering::Relaxed);
        until_reasons(&mut commands, [no_state, 0]);
        let mut states: StateReader = node.reader().unwrap();
        let flags = loop {
            if let Some(sample) = states.newest().unwrap() {
                break sample.robots().iter().map(|r| r.has(state_flags::VALID)).collect::<Vec<_>>();
            }
        };
        assert!(!flags[0]);
        external.mood.store(0, Ordering::Relaxed);
        until_reasons(&mut commands, [0, 0]);
        daemon.stop();
        let report = daemon.join().unwrap();
        assert!(report.rejected_inputs.get(Rejection::NotFinite) > 0);
        assert!(report.stops["no_state"] > 0 && report.fallback_commands > 0);
    });
}
