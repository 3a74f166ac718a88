//! Any period can be computed again from its state, the memories before it and the configuration.

mod support;

use std::collections::BTreeMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::time::{Duration, Instant};

use clearway::channel::{CheckpointReader, CommandReader, StateReader, Transport};
use clearway::config::{Config, SolverKind};
use clearway::controller::{RobotGroup, Robots, Timing};
use clearway::evaluation::initial_fleet;
use clearway::model::Command;
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use clearway::wire::{RobotCheckpoint, RobotCommand, RobotState, checkpoint_flags, state_flags};
use support::{World, config};

/// A command as bits.
fn bits(command: &RobotCommand) -> (u32, u32, u64, u64) {
    (command.id, command.stop_reason, command.v_mps.to_bits(), command.omega_radps.to_bits())
}

fn checkpoints(group: &RobotGroup) -> Vec<RobotCheckpoint> {
    let mut all = Vec::new();
    group.checkpoint(&mut |_, checkpoint| all.push(checkpoint.checkpoint()));
    all
}

fn solve(group: &mut RobotGroup, fleet: &[RobotState]) -> Vec<RobotCommand> {
    let mut commands = Vec::new();
    group.solve(fleet, Timing::LogicalExecutionTime, |_, decision| commands.push(decision.command));
    commands
}

/// One group drives; another, which has seen nothing or something else, is put in its place.
#[test]
fn a_group_that_is_restored_decides_and_remembers_the_same_bits() {
    for (scenario, solver) in [
        ("swap8", SolverKind::Exact),
        ("doorway-both-6", SolverKind::Exact),
        ("random-20-3", SolverKind::Exact),
        ("swap8", SolverKind::Clarabel),
    ] {
        let mut config = Config::new(Scenario::builtin(scenario).unwrap());
        config.controller.solver = solver;
        let mut fleet = initial_fleet(&config);
        let robots = fleet.len();
        let mut driving = RobotGroup::new(&config, 0..robots).unwrap();
        let mut again = RobotGroup::new(&config, 0..robots).unwrap();
        for tick in 0..120 {
            if tick == 40 {
                // An operator lets two robots swap their goals.
                let first = (fleet[0].goal_x_m, fleet[0].goal_y_m);
                (fleet[0].goal_x_m, fleet[0].goal_y_m) = (fleet[1].goal_x_m, fleet[1].goal_y_m);
                (fleet[1].goal_x_m, fleet[1].goal_y_m) = first;
            }
            let before = checkpoints(&driving);
            let mut next = fleet.clone();
            let mut commands = Vec::new();
            driving.solve(&fleet, Timing::LogicalExecutionTime, |index, decision| {
                next[index].set_command(decision.command.command());
                next[index].intent = decision.intent;
                commands.push(decision.command);
            });
            // Backwards and with gaps: nothing but the checkpoint may matter.
            if tick % 3 != 1 {
                assert!(before.iter().enumerate().all(|(index, one)| again.restore(index, one)));
                let repeated = solve(&mut again, &fleet);
                assert!(repeated.iter().map(bits).eq(commands.iter().map(bits)), "{scenario} {tick}");
                assert_eq!(checkpoints(&again), checkpoints(&driving), "{scenario} {tick}");
            }
            for (robot, new) in fleet.iter_mut().zip(&next) {
                robot.set_pose(robot.arc().pose(config.timing.period_s()));
                robot.set_command(new.command());
                robot.intent = new.intent;
            }
        }
    }
}

#[test]
fn a_checkpoint_belongs_to_its_robot() {
    let config = Config::new(Scenario::builtin("swap8").unwrap());
    let mut group = RobotGroup::new(&config, 2..5).unwrap();
    let own = checkpoints(&group);
    assert_eq!(own.len(), 3);
    assert!(own.iter().all(|one| one.flags == checkpoint_flags::ANSWERED));
    assert!(group.restore(2, &own[0]));
    assert!(!group.restore(3, &own[0]), "of another robot");
    assert!(!group.restore(1, &own[0]), "of another worker");
}

/// A robot that joined during the run, and whose controller a panic took along later: made anew it is one of
/// who stood in its place at the start, and the recorded memory is nobody's who is there.
#[test]
fn who_begins_anew_in_another_s_place_is_computed_again_as_well() {
    for panics in [15, 25, 35, 45] {
        for recorded in [true, false] {
            begins_anew(panics, recorded);
        }
    }
}

/// With a panic in period `panics`, of which a checkpoint may be recorded: without memories.
fn begins_anew(panics: u64, recorded: bool) {
    const JOINS: u64 = 10;
    let mut config = Config::new(Scenario::builtin("swap8").unwrap());
    let joined = config.scenario.robots.pop().unwrap();
    config.admin.capacity = 8;
    let place = config.scenario.robots.len();
    let mut fleet = initial_fleet(&config);
    let robots = Arc::new(Robots::new(&config));
    let mut driving = RobotGroup::among(&config, Arc::clone(&robots)).unwrap();
    let mut again = RobotGroup::new(&config, 0..fleet.len()).unwrap();
    let mut compared = 0;
    for tick in 0..100 {
        if tick == JOINS {
            fleet[place] = RobotState::at_start(&joined);
            fleet[place].flags |= state_flags::VALID;
        }
        let (mut memories, mut commands) = (BTreeMap::new(), BTreeMap::new());
        let mut next = fleet.clone();
        let worked = catch_unwind(AssertUnwindSafe(|| {
            let mut all = std::iter::once(0..fleet.len());
            driving.solve_parts(
                (tick, || all.next()),
                &fleet,
                Timing::LogicalExecutionTime,
                |index, memory| _ = memories.insert(index, memory.checkpoint()),
                |index, decision| {
                    if tick == panics && index == place {
                        std::panic::resume_unwind(Box::new("a fault, injected"));
                    }
                    next[index].set_command(decision.command.command());
                    next[index].intent = decision.intent;
                    commands.insert(index, decision.command);
                },
            );
        }));
        assert_eq!(worked.is_err(), tick == panics);
        if worked.is_err() {
            // The record of the period is lost with it, and whose command is missing stands.
            memories.clear();
            driving = RobotGroup::among(&config, Arc::clone(&robots)).unwrap();
        }
        for (index, robot) in fleet.iter().enumerate() {
            again.seat(index, robot);
            let id = robot.id;
            let unanswered = RobotCheckpoint { id, ..RobotCheckpoint::default() };
            if recorded || tick != panics {
                again.restore(index, memories.get(&index).unwrap_or(&unanswered));
            }
        }
        for (index, command) in solve(&mut again, &fleet).iter().enumerate() {
            if memories.contains_key(&index) {
                assert_eq!(
                    bits(command),
                    bits(&commands[&index]),
                    "tick {tick}, place {index}, panic in {panics}, recorded {recorded}"
                );
                compared += u64::from(index == place && command.stop_reason == 0);
            }
        }
        for (robot, new) in fleet.iter_mut().zip(&next) {
            robot.set_pose(robot.arc().pose(config.timing.period_s()));
            let answered = tick != panics;
            robot.set_command(if answered { new.command() } else { Command::STOP });
            robot.intent = new.intent;
        }
    }
    assert_eq!(compared, 100 - JOINS - 1);
}

/// The daemon tells what is needed, for every period, and with it the same commands come out.
#[test]
fn what_the_daemon_publishes_is_enough_to_compute_its_commands_again() {
    let world = World::new("checkpoint");
    let mut config = config(&world, Scenario::builtin("swap8").unwrap(), 5_000_000);
    config.timing.workers = Some(3);
    config.timing.ticks = Some(150);
    let robots = config.scenario.robots.len();
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let node = transport.attach("test").unwrap();
    let mut states: StateReader = node.reader_or_create(robots).unwrap();
    let mut commands: CommandReader = node.reader_or_create(robots).unwrap();
    let mut memories: CheckpointReader = node.reader_or_create(robots).unwrap();

    let daemon = Daemon::start(config.clone(), Until::Stopped).unwrap();
    let (mut seen_states, mut seen_commands) = (BTreeMap::new(), BTreeMap::new());
    let mut seen_memories = BTreeMap::new();
    let end = Instant::now() + Duration::from_secs(120);
    let mut over = false;
    while !over && Instant::now() < end {
        over = daemon.is_finished();
        while let Some(sample) = states.next().unwrap() {
            seen_states.insert(sample.header().tick, sample.robots().to_vec());
        }
        while let Some(sample) = commands.next().unwrap() {
            seen_commands.insert(sample.header().tick, sample.robots().to_vec());
        }
        while let Some(sample) = memories.next().unwrap() {
            seen_memories.insert(sample.header().tick, (*sample.header(), sample.robots().to_vec()));
        }
        std::thread::sleep(Duration::from_micros(500));
    }
    let report = daemon.join().unwrap();
    assert!(over);
    let ticks: Vec<u64> = seen_states.keys().copied().collect();
    assert_eq!(ticks.len() as u64, report.ticks);
    assert_eq!(seen_memories.keys().copied().collect::<Vec<_>>(), ticks);

    // From the last period to the first, with one controller that never saw them in order.
    let mut group = RobotGroup::new(&config, 0..robots).unwrap();
    let mut compared = 0;
    for (tick, fleet) in seen_states.iter().rev() {
        let (header, memory) = &seen_memories[tick];
        let Some(sent) = seen_commands.get(&(tick + 1)).filter(|_| header.commands_published == 1) else {
            continue;
        };
        for (index, one) in memory.iter().enumerate() {
            group.restore(index, one);
        }
        for (index, command) in solve(&mut group, fleet).iter().enumerate() {
            if memory[index].flags == checkpoint_flags::ANSWERED && sent[index].stop_reason == 0 {
                assert_eq!(bits(command), bits(&sent[index]), "tick {tick}");
                compared += 1;
            }
        }
    }
    assert!(compared > 0);
    let answered: u64 = seen_memories.values().map(|(header, _)| header.commands_published).sum();
    assert!(report.deadline_misses > 0 || answered == report.ticks);
}
