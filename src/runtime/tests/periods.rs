//! What a period publishes and when, with overruns and far from tick 0.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::faults::Faulty;
use super::rig::Rig;
use super::support::{World, config, lanes, straight};
use super::{Fault, START, T, group, swap8};
use crate::config::{Config, PublishAt, Wakeup};
use crate::controller::Timing;
use crate::scenario::Scenario;
use crate::schedule::TICK_MAX;
use crate::wire::StopReason;

/// The whole daemon across the places where numbers wrap, in virtual time.
#[test]
fn large_numbers_change_nothing() {
    use crate::runtime::Accelerated;
    const TICKS: u64 = 400;
    let run = |first_tick: u64, start_ns: u64| {
        let world = World::new("large");
        let mut config = config(&world, Scenario::builtin("head-on").unwrap(), T);
        config.timing.first_tick = first_tick;
        let run = Accelerated::run(config, TICKS, start_ns, |_| {}).unwrap();
        assert_eq!(run.report.inconsistencies(), Vec::<String>::new());
        assert_eq!(
            (run.refused, run.report.fallback_commands, run.report.rejected_inputs.total()),
            (0, 0, 0)
        );
        assert!(run.laps > 2);
        (run.report.ticks, run.commands, run.observations, run.laps, run.report.control)
    };
    let reference = run(0, START);
    assert_eq!((reference.0, reference.1, reference.2), (TICKS, TICKS + 2, TICKS + 1));
    for edge in [1_u64 << 32, 1 << 48, 1 << 53, 1 << 63] {
        assert_eq!(run(edge - TICKS / 2, START), reference);
        // The clock, too, passes the edge in the middle of the run.
        assert_eq!(run(edge - TICKS / 2, edge.saturating_sub(TICKS / 2 * T).max(START)), reference);
    }
    // The last numbers there are: the run ends by itself before them.
    assert_eq!(run(TICK_MAX - TICKS, START), reference);
    assert_eq!(run(TICK_MAX - TICKS / 2, START).0, TICKS / 2);
}

/// The order of logical execution time, to the bit.
#[test]
fn what_is_published_is_what_happens() {
    // Work takes no time here.
    published_is_what_happens(PublishAt::Complete, 0);
    published_is_what_happens(PublishAt::Deadline, T - T / 10);
}

fn published_is_what_happens(publish: PublishAt, after_release_ns: u64) {
    let world = World::new("let");
    let mut rig = Rig::new(&world, swap8(), 2, 25);
    rig.config.timing.publish = publish;
    let make = group(&rig.config);
    let (seen, _) = rig.run(make);
    let ticks: Vec<u64> = seen.states.iter().map(|(header, _)| header.tick).collect();
    assert_eq!(ticks, (0..25).collect::<Vec<_>>());
    for (k, (header, robots)) in seen.states.iter().enumerate() {
        let (command_header, commands) = &seen.commands[k];
        assert_eq!((command_header.tick, command_header.epoch), (header.tick, header.epoch));
        assert_eq!(command_header.valid_from_ns, header.release_ns);
        assert_eq!(command_header.valid_until_ns, header.release_ns + T);
        for (robot, command) in robots.iter().zip(commands) {
            // The command that acts over the period is the one that its state carries.
            assert_eq!((robot.id, robot.command()), (command.id, command.command()));
        }
        if let Some((_, next)) = seen.states.get(k + 1) {
            // It leads from this state to the next, and answers the one before.
            for (robot, next) in robots.iter().zip(next) {
                assert_eq!(robot.arc().pose(T as f64 * 1e-9), next.pose());
            }
            assert_eq!(seen.commands[k + 1].0.state_stamp_ns, header.stamp_ns);
            assert_eq!(seen.commands[k + 1].0.stamp_ns, header.release_ns + after_release_ns);
        }
    }
    let reasons = |k: usize| seen.commands[k].1.iter().map(|c| c.stop_reason).collect::<Vec<_>>();
    assert_eq!(reasons(0), [StopReason::Start as u32; 8]);
    assert_eq!(reasons(12), [0; 8]);
    assert_eq!(reasons(26), [StopReason::Finished as u32; 8]);
    assert_eq!(seen.commands.len(), 27);
}

/// However the robots are shared out, and with no daemon at all: the same bits.
#[test]
fn workers_wake_ups_and_the_time_of_publishing_change_nothing() {
    let world = World::new("workers");
    let mut runs = Vec::new();
    for (workers, publish, wakeup) in [
        (1, PublishAt::Complete, Wakeup::Futex),
        (3, PublishAt::Complete, Wakeup::Futex),
        (8, PublishAt::Complete, Wakeup::Futex),
        (1, PublishAt::Complete, Wakeup::Spin),
        (3, PublishAt::Complete, Wakeup::Spin),
        (1, PublishAt::Complete, Wakeup::Channel),
        (3, PublishAt::Complete, Wakeup::Channel),
        (3, PublishAt::Deadline, Wakeup::Futex),
        (3, PublishAt::Deadline, Wakeup::Spin),
        (3, PublishAt::Deadline, Wakeup::Channel),
    ] {
        let mut rig = Rig::new(&world, swap8(), workers, 40);
        rig.config.timing.publish = publish;
        rig.config.realtime.wakeup = wakeup;
        let make = group(&rig.config);
        runs.push(rig.run(make).0.states);
    }
    assert_eq!(runs[0].len(), 40);
    assert!(runs.iter().all(|run| *run == runs[0]));

    let mut config = Config::new(swap8());
    config.timing.ticks = Some(40);
    let mut tick = 0;
    crate::evaluation::run(&config, Timing::LogicalExecutionTime, |_, fleet| {
        let Some((_, robots)) = runs[0].get(tick) else { return };
        for (robot, evaluated) in robots.iter().zip(fleet) {
            assert_eq!(
                (robot.pose(), robot.command()),
                (evaluated.pose(), evaluated.command()),
                "tick {tick}"
            );
        }
        tick += 1;
    })
    .unwrap();
    assert!(tick > 20);
}

/// The work of period 3 ends `tenths` tenths of a period after it: the ticks of the states, the ticks of
/// the commands, and whether anybody moved without a valid command.
fn overrun(tenths: u64, publish: PublishAt) -> (Vec<u64>, Vec<u64>) {
    let world = World::new("overrun");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 1, 3 + tenths / 10 + 5);
    rig.config.timing.publish = publish;
    let now_ns = Arc::clone(&rig.now_ns);
    let fault: Fault = Arc::new(move |period, _| {
        if period == 3 {
            now_ns.fetch_max(START + 4 * T + T / 10 * tenths, Ordering::AcqRel);
        }
    });
    let make = straight(T);
    let (seen, _) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    for pair in seen.states.windows(2) {
        let [(a, before), (b, after)] = pair else { unreachable!() };
        let driven_m = after[0].x_m - before[0].x_m;
        assert_eq!(driven_m, before[0].arc().position(T as f64 * 1e-9).x - before[0].x_m);
        // Whatever was ready too late is not used: the period after the overrun is a standstill.
        if a.tick == 3 {
            assert_eq!((before[0].v_mps > 0.0, after[0].v_mps), (true, 0.0));
        }
        assert!(b.stamp_ns >= b.release_ns && b.release_ns == START + b.tick * T);
    }
    let states = seen.states.iter().map(|(header, _)| header.tick);
    let commands = seen.commands.iter().map(|(header, _)| header.tick);
    (states.collect(), commands.collect())
}

#[test]
fn overruns_skip_whole_periods_and_discard_late_commands() {
    // The last command is the stop at the end; 4 is never published, because it was late.
    for publish in [PublishAt::Complete, PublishAt::Deadline] {
        let overrun = |tenths| overrun(tenths, publish);
        assert_eq!(overrun(5), (vec![0, 1, 2, 3, 4, 5, 6, 7], vec![0, 1, 2, 3, 5, 6, 7, 8, 9]));
        assert_eq!(overrun(15), (vec![0, 1, 2, 3, 5, 6, 7, 8], vec![0, 1, 2, 3, 6, 7, 8, 9, 10]));
        assert_eq!(overrun(32), (vec![0, 1, 2, 3, 7, 8, 9, 10], vec![0, 1, 2, 3, 8, 9, 10, 11, 12]));
        assert_eq!(overrun(200), (vec![0, 1, 2, 3, 24, 25, 26, 27], vec![0, 1, 2, 3, 25, 26, 27, 28, 29]));
    }
}
