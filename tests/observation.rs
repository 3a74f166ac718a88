//! A fleet whose states come from another writer over the `observation` channel.

mod support;

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use clearway::admission::Rejection;
use clearway::channel::{CommandReader, StateReader, Transport, Writer};
use clearway::clock::{Clock, MonotonicClock, VirtualClock};
use clearway::config::{Config, SourceKind};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation::initial_fleet;
use clearway::figures::Accumulator;
use clearway::geometry::{Pose, Vec2};
use clearway::model::Command;
use clearway::plant::Plant;
use clearway::runtime::{Daemon, Until};
use clearway::source::{Instant, Observed, StateSource};
use clearway::wire::{CommandHeader, RobotCommand, RobotObservation, StopReason, state_flags};
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
                    // The gate decides: after a command that comes late the robot stands until it is told that this is known.
                    let _ = plant.command(index, sample.header(), command, now_ns);
                }
            }
            let mood = self.mood.load(Ordering::Relaxed);
            if mood != 1 {
                sequence += 1;
                let sent = observations.publish(|header, records| {
                    (header.epoch, header.sequence, header.stamp_ns) = (epoch, sequence, now_ns);
                    let robots = plant.poses().zip(&config.scenario.robots).enumerate();
                    for (record, (index, (pose, spec))) in records.iter_mut().zip(robots) {
                        let x_m = if mood == 2 && spec.id.0 == 0 { f64::NAN } else { pose.position_m.x };
                        *record = RobotObservation {
                            id: spec.id.0,
                            holding: plant.holding(index).code(),
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

/// Two robots head-on, of which one falls silent after `last_heard`, and deaf unless it still `hears`: the
/// smallest clearance of the true plant over continuous time. Until then they tell what they hold, if that
/// is wanted.
fn clearance_with_a_silent_robot(
    world: &World,
    silent: usize,
    last_heard: u64,
    hears: bool,
    tells: bool,
) -> f64 {
    const T: u64 = 80_000_000;
    const START: u64 = 1_000_000_000;
    let mut config = config(world, lanes(2, 12.0), T);
    for (index, robot) in config.scenario.robots.iter_mut().enumerate() {
        let (from, to, heading) = [(-6.0, 6.0, 0.0), (6.0, -6.0, std::f64::consts::PI)][index];
        robot.start = Pose::new(from, 0.0, heading);
        robot.goal_m = Vec2::new(to, 0.0);
    }
    config.controller.guidance = false;
    config.source.kind = SourceKind::Observation;
    let node = Transport::new(&config.fleet, &config.channel).unwrap().attach("lockstep").unwrap();
    let mut observations: Writer<RobotObservation> = node.writer(2).unwrap();
    let mut source = Observed::new(node.reader().unwrap(), &config.scenario, &config.source, T);
    let mut plant = Plant::new(&config.scenario, T, START);
    let header = |tick: u64, release_ns| CommandHeader {
        epoch: 7,
        tick,
        stamp_ns: release_ns,
        state_stamp_ns: release_ns,
        valid_from_ns: START + tick * T,
        valid_until_ns: START + (tick + 1) * T,
        follows: tick.saturating_sub(1),
        ..CommandHeader::default()
    };
    let mut group = RobotGroup::new(&config, 0..2).unwrap();
    let mut figures = Accumulator::new(&config.scenario, config.timing.period_s());
    let (mut states, mut truth) = (initial_fleet(&config), initial_fleet(&config));
    let mut commands: Vec<RobotCommand> =
        truth.iter().map(|s| RobotCommand::stop(s.robot(), StopReason::Start)).collect();
    source.commit(&header(0, START), &commands, START);
    for (index, command) in commands.iter().enumerate() {
        plant.command(index, &header(0, START), command, START).unwrap();
    }
    for tick in 0..60_u64 {
        let release_ns = START + tick * T;
        plant.advance(release_ns);
        for ((state, pose), command) in truth.iter_mut().zip(plant.poses()).zip(&commands) {
            state.set_pose(pose);
            // Who is deaf stands, once the last command that it heard has expired.
            let told = hears || state.id != states[silent].id || tick <= last_heard + 1;
            state.set_command(if told { command.command() } else { Command::STOP });
        }
        figures.observe_period(tick, &truth);
        for (index, robot) in truth.iter().enumerate().filter(|(i, _)| *i != silent || tick <= last_heard) {
            let sent = observations.publish(|header, records| {
                (header.epoch, header.sequence, header.stamp_ns) = (7, 2 * tick + index as u64, release_ns);
                let (x_m, y_m, theta_rad) = (robot.x_m, robot.y_m, robot.theta_rad);
                let holding = if tells { plant.holding(index).code() } else { 0 };
                records[0] = RobotObservation { id: robot.id, holding, x_m, y_m, theta_rad };
                // The other record speaks for nobody.
                records[1].id = u32::MAX;
            });
            sent.unwrap();
        }
        for (state, command) in states.iter_mut().zip(&commands) {
            state.set_command(command.command());
        }
        let instant = Instant { epoch: 7, release_ns, now_ns: release_ns };
        source.observe(instant, &VirtualClock::new(release_ns), &mut states);
        assert_eq!(states[silent].has(state_flags::VALID), tick <= last_heard + 2);
        let mut next = commands.clone();
        group.solve(&states, Timing::LogicalExecutionTime, |index, decision| next[index] = decision.command);
        commands = next;
        let header = header(tick + 1, release_ns);
        source.commit(&header, &commands, release_ns);
        for (index, command) in commands.iter().enumerate() {
            if hears || index != silent || tick <= last_heard {
                plant.command(index, &header, command, release_ns).unwrap();
            }
        }
    }
    figures.min_clearance_m()
}

#[test]
fn a_robot_that_falls_silent_on_its_way_is_never_run_into() {
    let world = World::new("headon");
    for silent in [0, 1] {
        for last_heard in 4..20 {
            for (hears, tells) in [(true, true), (false, true), (true, false), (false, false)] {
                let clearance_m = clearance_with_a_silent_robot(&world, silent, last_heard, hears, tells);
                assert!(clearance_m >= -1e-9, "{silent} silent after {last_heard}: {clearance_m} m");
            }
        }
    }
}

#[test]
fn a_foreign_robot_may_be_as_far_as_it_can_have_driven_since_it_was_seen() {
    let world = World::new("foreign");
    let mut config = config(&world, lanes(2, 10.0), T);
    config.scenario.robots[1].foreign_speed_mps = Some(0.5);
    let node = Transport::new(&config.fleet, &config.channel).unwrap().attach("lockstep").unwrap();
    let mut observations: Writer<RobotObservation> = node.writer(2).unwrap();
    let mut source = Observed::new(node.reader().unwrap(), &config.scenario, &config.source, T);
    let mut states = initial_fleet(&config);
    let mut at = |source: &mut Observed, now_ns| {
        let instant = Instant { epoch: 7, release_ns: now_ns, now_ns };
        source.observe(instant, &VirtualClock::new(now_ns), &mut states);
        // Whatever it is told, a foreign robot does not do it.
        let drive = |s: &clearway::wire::RobotState| {
            RobotCommand::verified(s.robot(), Command { v_mps: 1.0, omega_radps: 0.0 })
        };
        let header =
            CommandHeader { valid_from_ns: now_ns, valid_until_ns: now_ns + T, ..CommandHeader::default() };
        let commands: Vec<RobotCommand> = states.iter().map(drive).collect();
        source.commit(&header, &commands, now_ns);
        states.clone()
    };
    let before = at(&mut source, 10 * T);
    assert_eq!(before.iter().map(|s| s.uncertainty_m).collect::<Vec<_>>(), [0.0, f64::INFINITY]);
    assert!(before.iter().all(|s| !s.has(state_flags::VALID)));
    observations
        .publish(|header, records| {
            (header.sequence, header.stamp_ns) = (1, 10 * T);
            for (record, robot) in records.iter_mut().zip(&before) {
                *record = RobotObservation { id: robot.id, y_m: robot.y_m, ..RobotObservation::default() };
            }
        })
        .unwrap();
    for periods in 0..40_u64 {
        let now = at(&mut source, (10 + periods) * T);
        assert!(now.iter().all(|s| s.has(state_flags::VALID) == (periods <= 2)));
        let driven_m = periods as f64 * T as f64 * 1e-9;
        let (ours, foreign) = (&now[0], &now[1]);
        // Who is not heard any more may have stopped anywhere on the way.
        let share = if periods <= 2 { 1.0 } else { 0.5 };
        assert!((ours.x_m - share * driven_m).abs() < 1e-9, "{periods}: {ours:?}");
        assert!((ours.uncertainty_m - (1.0 - share) * driven_m).abs() < 1e-9, "{periods}: {ours:?}");
        assert_eq!(foreign.x_m, 0.0);
        assert!((foreign.uncertainty_m - 0.5 * driven_m).abs() < 1e-9, "{periods}: {foreign:?}");
    }
}
