//! Workers that panic, hang or answer beyond the limits.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::rig::{Rig, Seen};
use super::support::{self, World, lanes, straight};
use super::{Fault, T};
use crate::config::PublishAt;
use crate::controller::Decision;
use crate::runtime::board::Board;
use crate::runtime::decider::Decider;
use crate::wire::{CommandHeader, RobotCommand, RobotIntent, RobotState, StateHeader, StopReason};

/// Does what [`support::Straight`] does, but for one period, in which it fails in its own way.
pub(super) struct Faulty {
    pub(super) inner: support::Straight,
    pub(super) periods: u64,
    pub(super) fault: Fault,
}

impl Decider for Faulty {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        (self.fault)(self.periods, &self.inner.owned);
        self.periods += 1;
        let intent = RobotIntent { speed_mps: 2.0, target_x_m: 9.0, valid: 1, ..RobotIntent::default() };
        self.inner.decide(fleet, &mut |index, decision| each(index, &Decision { intent, ..*decision }));
    }
}

fn reasons_of(seen: &Seen, robot: usize) -> Vec<u32> {
    seen.commands.iter().map(|(_, commands)| commands[robot].stop_reason).collect()
}

#[test]
fn a_worker_that_panics_stops_its_robots_for_one_period_and_is_built_anew() {
    panics_once(PublishAt::Complete);
    panics_once(PublishAt::Deadline);
}

fn panics_once(publish: PublishAt) {
    let world = World::new("panic");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 8);
    rig.config.timing.publish = publish;
    rig.ready = Box::new(|board, tick| {
        let other = board.staging.take(1, tick).is_some();
        let panicked = tick == 3 && board.worker_panics.load(Ordering::Relaxed) == 1;
        other && (panicked || board.staging.complete(tick))
    });
    let once = Arc::new(AtomicBool::new(true));
    let fault: Fault = Arc::new(move |period, owned| {
        if period == 3 && owned.start == 0 && once.swap(false, Ordering::Relaxed) {
            std::panic::resume_unwind(Box::new("a fault, injected"));
        }
    });
    let make = straight(T);
    let (seen, board) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    let (start, end, missed) =
        (StopReason::Start as u32, StopReason::Finished as u32, StopReason::Deadline as u32);
    assert_eq!(reasons_of(&seen, 0), [start, 0, 0, 0, missed, 0, 0, 0, 0, end]);
    assert_eq!(reasons_of(&seen, 1), [start, 0, 0, 0, 0, 0, 0, 0, 0, end]);
    // While it stands it keeps its plans, at speed 0, and nobody expects it to drive.
    let intents = |robot: usize| -> Vec<(u32, f64, f64)> {
        let of = |(_, robots): &(StateHeader, Vec<RobotState>)| {
            let intent = robots[robot].intent;
            (intent.valid, intent.speed_mps, intent.target_x_m)
        };
        seen.states.iter().map(of).collect()
    };
    let (none, drives, stands) = ((0, 0.0, 0.0), (1, 2.0, 9.0), (1, 0.0, 9.0));
    assert_eq!(intents(0), [none, drives, drives, drives, stands, drives, drives, drives]);
    assert_eq!(intents(1), [none, drives, drives, drives, drives, drives, drives, drives]);
    assert_eq!(board.worker_panics.load(Ordering::Relaxed), 1);
    assert_eq!(board.worker_rests.load(Ordering::Relaxed), 0);
}

#[test]
fn a_worker_that_panics_again_and_again_rests_before_it_tries_once_more() {
    let world = World::new("crashes");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 64);
    rig.ready = Box::new(Board::complete);
    // It fails in its first five periods, in each with another decider.
    let faults = AtomicU64::new(0);
    let fault: Fault = Arc::new(move |_, owned| {
        if owned.start == 0 && faults.fetch_add(1, Ordering::Relaxed) < 5 {
            std::panic::resume_unwind(Box::new("a fault, injected"));
        }
    });
    let make = straight(T);
    let (seen, board) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    // Four periods and a rest of 16, one more and a rest of 32; then it works.
    let reasons = reasons_of(&seen, 0);
    assert_eq!(reasons[1..54], [StopReason::Deadline as u32; 53]);
    assert_eq!(reasons[54..65], [0; 11]);
    assert_eq!(reasons_of(&seen, 1)[1..65], [0; 64]);
    assert_eq!(board.worker_panics.load(Ordering::Relaxed), 5);
    assert_eq!((board.worker_rests.load(Ordering::Relaxed), board.resting()), (2, 0));
}

#[test]
fn a_worker_that_hangs_stops_its_robots_and_its_late_answer_is_not_used() {
    hangs_for_a_while(PublishAt::Complete);
    hangs_for_a_while(PublishAt::Deadline);
}

fn hangs_for_a_while(publish: PublishAt) {
    let world = World::new("hangs");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 8);
    rig.config.timing.publish = publish;
    let release = Arc::new(Mutex::new(0_u64));
    let hold = Arc::clone(&release);
    // The hanging worker may go on once period 5 has been answered without it.
    rig.ready = Box::new(move |board, tick| {
        let other = board.staging.take(1, tick).is_some();
        if tick >= 6 {
            *release.lock().unwrap() = 6;
        }
        other && ((3..=5).contains(&tick) || board.staging.complete(tick))
    });
    let fault: Fault = Arc::new(move |period, owned| {
        while period == 3 && owned.start == 0 && *hold.lock().unwrap() < 6 {
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
    });
    let make = straight(T);
    let (seen, _) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    let (start, end, missed) =
        (StopReason::Start as u32, StopReason::Finished as u32, StopReason::Deadline as u32);
    assert_eq!(reasons_of(&seen, 0), [start, 0, 0, 0, missed, missed, missed, 0, 0, end]);
    // Nobody is waited for longer than to the deadline, and nobody who is done is waited for.
    let deadline_ns = |header: &CommandHeader| header.valid_from_ns - T / 10;
    let waited = seen.commands[1..9].iter().map(|(header, _)| header.stamp_ns == deadline_ns(header));
    let hangs = [false, false, false, true, true, true, false, false];
    assert_eq!(waited.collect::<Vec<_>>(), hangs.map(|hangs| hangs || publish == PublishAt::Deadline));
    assert_eq!(reasons_of(&seen, 1), [start, 0, 0, 0, 0, 0, 0, 0, 0, end]);
}

#[test]
fn a_command_beyond_the_limits_never_goes_out() {
    struct Reckless(Range<usize>);
    impl Decider for Reckless {
        fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
            for index in self.0.clone() {
                let v_mps = if index == 0 { 5.1 } else { f64::NAN };
                let command = RobotCommand { id: fleet[index].id, stop_reason: 0, v_mps, omega_radps: 0.0 };
                each(
                    index,
                    &Decision {
                        command,
                        intent: crate::wire::RobotIntent::default(),
                        telemetry: crate::wire::RobotTelemetry::default(),
                    },
                );
            }
        }
    }
    let world = World::new("reckless");
    let (seen, _) = Rig::new(&world, lanes(2, 50.0), 1, 4).run(Reckless);
    for (_, commands) in &seen.commands[1..5] {
        assert!(commands.iter().all(|c| c.stop_reason == StopReason::Unverified as u32));
        assert!(commands.iter().all(|c| (c.v_mps, c.omega_radps) == (0.0, 0.0)));
    }
}
