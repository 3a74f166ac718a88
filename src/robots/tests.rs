use super::*;
use crate::config::Config;
use crate::figures::Clearances;
use crate::geometry::TimedArc;
use crate::model::{Command, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::{CommandHeader, Holding, RobotCommand, StopReason};

const T: u64 = 80_000_000;
const START: u64 = 1_000 * T;

fn robots(config: &Config, link: Link) -> RemoteRobots {
    RemoteRobots::new(config, config.scenario.clone(), link, START)
}

fn config() -> Config {
    Config::new(Scenario::builtin("swap8").unwrap())
}

fn header(epoch: u64, tick: u64, from_ns: u64) -> CommandHeader {
    CommandHeader {
        epoch,
        tick,
        valid_from_ns: from_ns,
        valid_until_ns: from_ns + T,
        follows: tick.saturating_sub(1),
        ..CommandHeader::default()
    }
}

/// Lets everybody hold the stop of tick 0 of `epoch`: what comes then may move them.
fn hold(fleet: &mut RemoteRobots, epoch: u64, now_ns: u64) {
    let stops: Vec<_> = fleet.ids().map(|id| RobotCommand::stop(id, StopReason::Start)).collect();
    fleet.hear(&header(epoch, 0, now_ns), &stops, now_ns);
}

fn drive(scenario: &Scenario, v_mps: f64) -> Vec<RobotCommand> {
    let command = |r: &RobotSpec| RobotCommand::verified(r.id, Command { v_mps, omega_radps: 0.0 });
    scenario.robots.iter().map(command).collect()
}

/// How far robot 0 drove in a run of one command, seen every `step_ns`.
fn driven_m(config: &Config, step_ns: u64) -> (f64, Vec<TimedArc>, Commands) {
    let mut fleet = robots(config, Link::default());
    let commands = drive(&config.scenario, 1.0);
    let (mut now_ns, mut told, mut pieces) = (START, false, vec![]);
    // In phase with what comes.
    hold(&mut fleet, 1, START + 12_345);
    while now_ns < START + 10 * T {
        fleet.advance(now_ns);
        if !told && now_ns >= START + T {
            fleet.hear(&header(1, 1, START + 2 * T + 12_345), &commands, now_ns);
            told = true;
        }
        pieces.extend(fleet.take_motions().swap_remove(0));
        now_ns += step_ns;
    }
    let start = config.scenario.robots[0].start.position_m;
    ((fleet.pose(0).unwrap().position_m - start).norm(), pieces, fleet.report().commands)
}

#[test]
fn a_command_acts_from_its_time_to_its_end_however_seldom_one_looks() {
    for step_ns in [T / 100, 1_234_567, T, 3 * T] {
        let (driven_m, pieces, commands) = driven_m(&config(), step_ns);
        assert!(pieces.windows(2).all(|pair| pair[0].to_ns == pair[1].from_ns));
        // Looked at once every three periods, the command comes when it has begun already.
        if step_ns == 3 * T {
            assert_eq!((driven_m, commands.accepted, commands.missed), (0.0, 8, 8));
            continue;
        }
        assert!((driven_m - T as f64 * 1e-9).abs() < 1e-9, "{step_ns}: {driven_m}");
        let moving: Vec<_> = pieces.iter().filter(|piece| piece.arc.v_mps != 0.0).collect();
        assert_eq!(moving[0].from_ns, START + 2 * T + 12_345);
        assert_eq!(moving[moving.len() - 1].to_ns, START + 3 * T + 12_345);
        assert_eq!((commands.accepted, commands.missed, commands.refused), (16, 0, 0));
    }
}

#[test]
fn disturbed_robots_keep_to_the_times_as_well() {
    let mut config = config();
    config.disturbance.amplitude.slip = 0.02;
    let (driven_m, pieces, _) = driven_m(&config, 2_000_000);
    assert!((driven_m - 0.08).abs() < 0.0017, "{driven_m}");
    let moving: Vec<_> = pieces.iter().filter(|piece| piece.arc.v_mps != 0.0).collect();
    assert_eq!(moving[0].from_ns, START + 2 * T + 12_345);
    assert_eq!(moving[moving.len() - 1].to_ns, START + 3 * T + 12_345);
}

#[test]
fn what_comes_too_late_is_counted_and_does_nothing() {
    let config = config();
    let mut fleet = robots(&config, Link::default());
    let commands = drive(&config.scenario, 1.0);
    hold(&mut fleet, 5, START);
    fleet.hear(&header(5, 1, START + T), &commands, START);
    fleet.advance(START + T + T / 2);
    assert_eq!(fleet.commanded(), 8);
    fleet.advance(START + 2 * T);
    assert_eq!((fleet.commanded(), fleet.report().commands.ran_out), (0, 8));
    let there = fleet.pose(0);
    fleet.hear(&header(5, 2, START + T), &commands, START + 3 * T);
    fleet.hear(&header(4, 9, START + 3 * T), &commands, START + 3 * T);
    fleet.advance(START + 9 * T);
    assert_eq!(fleet.pose(0), there);
    let counted = fleet.report().commands;
    assert_eq!((counted.accepted, counted.expired, counted.missed, counted.refused), (16, 8, 0, 8));
    // Another run of the daemon may drive them again, once they have held its stop.
    hold(&mut fleet, 6, START + 9 * T);
    fleet.hear(&header(6, 1, START + 10 * T), &commands, START + 9 * T);
    fleet.advance(START + 11 * T);
    assert_ne!(fleet.pose(0), there);
    assert_eq!((fleet.report().epochs, fleet.run_ended_ns(), fleet.other_period_ns()), (2, None, None));
    let end: Vec<_> =
        config.scenario.robots.iter().map(|r| RobotCommand::stop(r.id, StopReason::Finished)).collect();
    fleet.hear(&header(6, 2, START + 11 * T + 5), &end, START + 11 * T);
    assert_eq!(fleet.run_ended_ns(), Some(START + 12 * T + 5));
    let short = CommandHeader { valid_until_ns: START + 12 * T, ..header(6, 3, START + 12 * T - 7) };
    fleet.hear(&short, &commands, START + 11 * T);
    assert_eq!(fleet.other_period_ns(), Some(7));
}

#[test]
fn the_link_delays_and_loses_and_changes_nothing_else() {
    let config = config();
    let link = Link { delay_ns: 5, drop_out: 0.5, seed: 3 };
    let mut fleet = robots(&config, link);
    let mut lost = 0;
    for k in 1..=400 {
        let now_ns = START + 10 * k;
        fleet.advance(now_ns);
        fleet.observe();
        assert_eq!(fleet.outgoing(now_ns + 4), None);
        match fleet.outgoing(now_ns + 5).unwrap() {
            Outgoing::Lost => lost += 1,
            Outgoing::Sample(stamp_ns, poses) => {
                assert_eq!(stamp_ns, now_ns);
                let starts =
                    config.scenario.robots.iter().map(|robot| (robot.id, robot.start, Holding::Nothing));
                assert!(poses.into_iter().eq(starts));
            }
        }
        assert_eq!(fleet.outgoing(u64::MAX), None);
    }
    let report = fleet.report();
    assert!((150..250).contains(&lost), "{lost}");
    assert_eq!((report.observations_lost, report.observations_sent), (lost, 400 - lost));
}

/// Robots of two processes: what each wrote down, put together, is what one process would have seen.
#[test]
fn clearance_between_processes_follows_from_their_records() {
    let config = config();
    let commands = drive(&config.scenario, 3.0);
    let run = |part: std::ops::Range<usize>| {
        let robots = config.scenario.robots[part].to_vec();
        let scenario = Scenario { robots, ..config.scenario.clone() };
        let mut fleet = RemoteRobots::new(&config, scenario, Link::default(), START);
        let mut records = vec![];
        hold(&mut fleet, 1, START);
        for k in 1..21 {
            fleet.hear(&header(1, k, START + k * T), &commands, START + k * T);
            let ids: Vec<_> = fleet.ids().collect();
            for (id, pieces) in ids.into_iter().zip(fleet.take_motions()) {
                records.extend(pieces.iter().map(|piece| MotionRecord::new(id, piece)));
            }
        }
        assert!(fleet.take_motions().iter().all(Vec::is_empty));
        (records, fleet.report())
    };
    let (mut records, _) = run(0..3);
    records.extend(run(3..8).0);
    let mut clearances = Clearances::new(&config.scenario);
    clearances.add(&motions(&config.scenario, &records));
    let (_, together) = run(0..8);
    // Straight through the middle: they meet.
    assert!(together.violations > 0);
    assert_eq!(clearances.violations(), together.violations);
    assert!((clearances.min_clearance_m().unwrap() - together.min_clearance_m.unwrap()).abs() < 1e-9);
}
