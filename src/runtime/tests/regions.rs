//! Who answers which robot changes nothing.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};

use super::rig::{Ready, Rig, Seen};
use super::support::World;
use super::{group, regional, swap8};
use crate::config::PublishAt;
use crate::controller::{Decision, Remembered, RobotGroup};
use crate::runtime::board::Board;
use crate::runtime::decider::{Claims, Decider};
use crate::scenario::Scenario;
use crate::wire::RobotState;

/// Asks for other regions in every `every`-th period, empty ones among them, before its deadline comes.
fn restless(workers: usize, every: u64, places: usize) -> Ready {
    Box::new(move |board, tick| {
        if tick.is_multiple_of(every) {
            let round = usize::try_from(tick / every).unwrap();
            let mut cuts: Vec<_> = (1..workers).map(|w| (5 * round + 3 * w * w) % (places + 1)).collect();
            cuts.extend([0, places]);
            cuts.sort_unstable();
            board.regions.want(&cuts);
        }
        board.staging.complete(tick)
    })
}

/// However many workers, and whoever answers a robot in which period: the bits of fixed shares.
#[test]
fn regions_and_their_changes_change_nothing() {
    const TICKS: u64 = 60;
    let world = World::new("regions");
    let field = Scenario::builtin("random-20-1").unwrap();
    let rig = Rig::new(&world, field.clone(), 2, TICKS);
    let make = group(&rig.config);
    let fixed = rig.run(make).0.states;
    assert_eq!(fixed.len() as u64, TICKS);
    for (workers, every) in [(1, 1), (2, 1), (3, 1), (2, 7), (3, 7), (8, 2)] {
        let mut rig = Rig::new(&world, field.clone(), workers, TICKS);
        rig.config.timing.publish = PublishAt::Deadline;
        rig.ready = restless(workers, every, field.robots.len());
        let make = regional(&rig.config);
        let (seen, board) = rig.run(make);
        assert!(seen.states == fixed, "{workers} workers, other regions every {every} periods");
        assert!(board.regions.adopted() >= TICKS / every - 1);
    }
}

/// A regional group to which something happens: before it answers a period, and when it has answered a robot, whose
/// controller it still holds.
struct Troubled<B, A> {
    group: RobotGroup,
    before: B,
    answered: A,
}

impl<B: FnMut(), A: FnMut(u64, usize)> Decider for Troubled<B, A> {
    fn decide(&mut self, _: &[RobotState], _: &mut dyn FnMut(usize, &Decision)) {
        unreachable!("it is regional");
    }

    fn is_regional(&self) -> bool {
        true
    }

    fn decide_parts(
        &mut self,
        (tick, parts): (u64, Claims),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        (self.before)();
        self.group.decide_parts((tick, parts), fleet, remember, &mut |index, decision| {
            (self.answered)(tick, index);
            each(index, decision);
        });
    }
}

fn panic_counted(panics: &AtomicU64) -> ! {
    panics.fetch_add(1, Ordering::Relaxed);
    std::panic::resume_unwind(Box::new("a fault, injected"));
}

#[test]
fn a_robot_whose_controller_was_lost_in_a_panic_drives_on_with_a_new_one_in_any_region() {
    let world = World::new("lost");
    let mut rig = Rig::new(&world, swap8(), 2, 20);
    rig.config.timing.publish = PublishAt::Deadline;
    let restless = restless(2, 1, 8);
    rig.ready = Box::new(move |board, tick| restless(board, tick) || tick == 5 && board.complete(tick));
    let make = regional(&rig.config);
    let panics = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&panics);
    let (seen, board) = rig.run(move |owned| {
        let panics = Arc::clone(&counted);
        let answered = move |tick, index| {
            if (tick, index) == (5, 3) {
                panic_counted(&panics);
            }
        };
        Troubled { group: make(owned), before: || {}, answered }
    });
    assert_eq!((panics.load(Ordering::Relaxed), board.worker_panics.load(Ordering::Relaxed)), (1, 1));
    for robot in 0..8 {
        let stopped: Vec<_> = (1..21).filter(|k| seen.commands[*k].1[robot].stop_reason != 0).collect();
        // Period 5 is answered by the commands of period 6.
        assert!(
            if robot == 3 { stopped == [6] } else { stopped.is_empty() || stopped == [6] },
            "{stopped:?}"
        );
    }
}

/// One worker of three sleeps through the run: the others answer its robots, and nobody sees a difference.
#[test]
fn what_a_worker_does_not_come_to_the_others_answer() {
    const TICKS: u64 = 30;
    let world = World::new("held-up");
    let field = Scenario::builtin("random-20-1").unwrap();
    let rig = Rig::new(&world, field.clone(), 2, TICKS);
    let make = group(&rig.config);
    let fixed = rig.run(make).0;
    let mut rig = Rig::new(&world, field.clone(), 3, TICKS);
    rig.config.timing.publish = PublishAt::Deadline;
    let over = Arc::new(AtomicBool::new(false));
    let (last, held_up) = (Arc::clone(&over), Arc::clone(&over));
    rig.ready = Box::new(move |board, tick| {
        let complete = board.staging.complete(tick);
        last.fetch_or(complete && tick + 1 == TICKS, Ordering::AcqRel);
        complete
    });
    let make = regional(&rig.config);
    let seen = rig
        .run(move |owned| {
            let held = owned.contains(&0);
            let over = Arc::clone(&held_up);
            // Until the loop does not wait any more.
            let before = move || {
                while held && !over.load(Ordering::Acquire) {
                    std::thread::sleep(std::time::Duration::from_micros(50));
                }
            };
            Troubled { group: make(owned), before, answered: |_, _| {} }
        })
        .0;
    assert!(seen.states == fixed.states);
    let commands = |seen: &Seen| -> Vec<_> { seen.commands.iter().map(|(_, all)| all.clone()).collect() };
    assert_eq!(commands(&seen), commands(&fixed));
}

/// A robot at which every worker panics brings down its own, whoever is slow, and no other.
#[test]
fn a_robot_that_makes_workers_panic_brings_down_one_of_them() {
    for slow in [0, 1] {
        let world = World::new("haunted");
        // Nobody moves, and so nobody leaves its region.
        let mut scenario = swap8();
        for robot in &mut scenario.robots {
            robot.goal_m = robot.start.position_m;
        }
        let mut rig = Rig::new(&world, scenario, 2, 12);
        rig.config.timing.publish = PublishAt::Deadline;
        rig.ready = Box::new(Board::complete);
        let make = regional(&rig.config);
        let panics = [(); 2].map(|()| Arc::new(AtomicU64::new(0)));
        let counts = panics.clone();
        let (_, board) = rig.run(move |owned| {
            let worker = usize::from(!owned.contains(&0));
            let (group, panics) = (make(owned), Arc::clone(&counts[worker]));
            // So that the other is through before it.
            let before = move || {
                if worker == slow {
                    std::thread::sleep(std::time::Duration::from_millis(5));
                }
            };
            let answered = move |_, index| {
                if index == 3 {
                    panic_counted(&panics);
                }
            };
            Troubled { group, before, answered }
        });
        let panics = panics.map(|count| count.load(Ordering::Relaxed));
        let mut sorted = panics;
        sorted.sort_unstable();
        assert!(sorted[1] == 4 && sorted[0] <= 1, "worker {slow} is slow: {panics:?}");
        assert_eq!([board.rests(0), board.rests(1)], panics.map(|count| count == 4));
    }
}
