use super::*;
use proptest::prelude::*;

fn header(epoch: u64, tick: u64) -> CommandHeader {
    CommandHeader {
        epoch,
        tick,
        valid_from_ns: tick * 100,
        valid_until_ns: (tick + 1) * 100,
        follows: tick.saturating_sub(1),
        ..CommandHeader::default()
    }
}

/// A stop that acts from the beginning of `tick`, after which commands may move the robot.
fn held(g: &mut Gate, epoch: u64, tick: u64) {
    let stop = RobotCommand::stop(RobotId(3), StopReason::Start);
    let header = CommandHeader { valid_until_ns: tick * 100 + 1, ..header(epoch, tick) };
    g.offer(&header, &stop, 0).unwrap();
}

fn go(v_mps: f64) -> RobotCommand {
    RobotCommand::verified(RobotId(3), Command { v_mps, omega_radps: 0.0 })
}

/// One that holds the stop of tick 4 of epoch 1.
fn gate() -> Gate {
    let mut g = Gate::new(RobotId(3), Limits::default(), 1_000);
    held(&mut g, 1, 4);
    g
}

#[test]
fn acts_inside_its_validity_and_stops_outside() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    for (now, v) in [(420, 0.0), (499, 0.0), (500, 2.0), (599, 2.0), (600, 0.0), (10_000, 0.0)] {
        assert_eq!((g.input(now).v_mps, g.is_commanded(now)), (v, v > 0.0), "at {now}");
    }
}

#[test]
fn the_next_command_waits_for_its_time() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    assert_eq!(g.input(510).v_mps, 2.0);
    g.offer(&header(1, 6), &go(3.0), 580).unwrap();
    assert_eq!(g.input(599).v_mps, 2.0);
    assert_eq!(g.next_change_ns(599), Some(600));
    assert_eq!(g.input(600).v_mps, 3.0);
    assert_eq!(g.input(700).v_mps, 0.0);
}

#[test]
fn a_stop_that_acts_at_once_wins() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    g.offer(&header(1, 6), &go(2.0), 520).unwrap();
    let now = CommandHeader { valid_from_ns: 530, valid_until_ns: 800, ..header(1, 7) };
    g.offer(&now, &RobotCommand::stop(RobotId(3), StopReason::Operator), 530).unwrap();
    assert_eq!(g.input(530), Command::STOP);
    assert_eq!(g.input(610), Command::STOP);
}

#[test]
fn every_refusal() {
    let mut g = gate();
    held(&mut g, 2, 4);
    g.offer(&header(2, 5), &go(2.0), 420).unwrap();
    let other = RobotCommand { id: 4, ..go(1.0) };
    let backwards = CommandHeader { valid_until_ns: 1, ..header(2, 6) };
    let forever = CommandHeader { valid_until_ns: u64::MAX, ..header(2, 6) };
    let stamped = |state_stamp_ns, stamp_ns| CommandHeader { stamp_ns, state_stamp_ns, ..header(2, 6) };
    let later = |ns| CommandHeader { valid_from_ns: ns, valid_until_ns: ns + 100, ..header(2, 6) };
    let reason = RobotCommand { stop_reason: StopReason::Operator as u32, ..go(1.0) };
    let cases = [
        (g.offer(&stamped(401, 400), &go(1.0), 420), Refusal::Validity),
        (g.offer(&stamped(601, 601), &go(1.0), 620), Refusal::Validity),
        (g.offer(&header(2, 6), &go(1.0), 601), Refusal::Late),
        (g.offer(&header(2, 7), &go(1.0), 601), Refusal::OutOfStep),
        (g.offer(&header(3, 6), &go(1.0), 420), Refusal::OutOfStep),
        (g.offer(&CommandHeader { stamp_ns: 1421, ..later(1500) }, &go(1.0), 420), Refusal::Future),
        (g.offer(&later(2421), &go(1.0), 420), Refusal::Future),
        (g.offer(&later(u64::MAX - 100), &go(1.0), 420), Refusal::Future),
        (g.offer(&header(2, 6), &reason, 420), Refusal::Input),
        (g.offer(&header(2, 6), &go(f64::INFINITY), 420), Refusal::Input),
        (g.offer(&header(2, 6), &go(-0.1), 420), Refusal::Input),
        (g.offer(&header(2, 6), &other, 420), Refusal::WrongRobot),
        (g.offer(&header(1, 9), &go(1.0), 420), Refusal::OldEpoch),
        (g.offer(&header(2, 5), &go(1.0), 420), Refusal::OldTick),
        (g.offer(&header(2, 4), &go(1.0), 420), Refusal::OldTick),
        (g.offer(&backwards, &go(1.0), 420), Refusal::Validity),
        (g.offer(&forever, &go(1.0), 420), Refusal::Validity),
        (g.offer(&header(2, 6), &go(1.0), 700), Refusal::Expired),
        (g.offer(&header(2, 6), &go(f64::NAN), 420), Refusal::Input),
        (g.offer(&header(2, 6), &go(5.1), 420), Refusal::Input),
    ];
    for (got, expected) in cases {
        assert_eq!(got, Err(expected));
    }
    assert_eq!(g.refused(), 20);
    assert_eq!(g.input(550).v_mps, 2.0);
}

#[test]
fn repeated_reordered_and_skipped_ticks_and_the_largest_one() {
    let mut g = Gate::new(RobotId(3), Limits::default(), 1_000);
    let at = |tick: u64| CommandHeader { tick, ..header(1, 5) };
    let stop = RobotCommand::stop(RobotId(3), StopReason::Start);
    let mut offer = |tick| g.offer(&at(tick), &stop, 420);
    // A stop is taken whatever was skipped.
    let ticks = [(0, true), (1, true), (1, false), (0, false), (7, true), (3, false), (7, false)];
    for (tick, taken) in ticks {
        assert_eq!(offer(tick), if taken { Ok(()) } else { Err(Refusal::OldTick) }, "tick {tick}");
    }
    // Ticks do not wrap: at the end of numbers the robot stops until there is a new epoch.
    assert_eq!(offer(u64::MAX), Ok(()));
    for tick in [u64::MAX, 0, 1] {
        assert_eq!(offer(tick), Err(Refusal::OldTick));
    }
    assert_eq!(g.offer(&CommandHeader { epoch: 2, ..at(0) }, &stop, 420), Ok(()));
}

#[test]
fn a_stop_is_taken_however_early_it_is_announced() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    let stop = RobotCommand::stop(RobotId(3), StopReason::Start);
    let early = CommandHeader { valid_from_ns: 50_000, valid_until_ns: 50_100, ..header(1, 6) };
    g.offer(&early, &stop, 430).unwrap();
    // What acts until then is what waited for it.
    assert_eq!((g.input(510).v_mps, g.input(50_050)), (2.0, Command::STOP));
}

/// A driver reads its clock and is held up before it looks at what has come.
#[test]
fn a_command_that_comes_while_the_one_before_still_waits_does_not_take_its_place() {
    for stop in [false, true] {
        let mut g = gate();
        g.offer(&header(1, 5), &go(1.0), 420).unwrap();
        let next = if stop { RobotCommand::stop(RobotId(3), StopReason::Deadline) } else { go(2.0) };
        g.offer(&header(1, 6), &next, 499).unwrap();
        assert_eq!(g.next_change_ns(499), Some(500));
        let driven = [510, 599, 600, 699].map(|now_ns| g.input(now_ns).v_mps);
        assert_eq!(driven, [1.0, 1.0, next.v_mps, next.v_mps]);
        assert_eq!(g.holding(699), Holding::Command { tick: 6 });
    }
}

#[test]
fn of_three_that_wait_none_is_dropped_while_the_robot_drives_on() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    g.offer(&header(1, 6), &go(1.0), 420).unwrap();
    let stop = RobotCommand::stop(RobotId(3), StopReason::Finished);
    g.offer(&header(1, 9), &stop, 430).unwrap();
    assert_eq!(
        (g.input(550), g.input(650), g.holding(650)),
        (Command::STOP, Command::STOP, Holding::Nothing)
    );
    // One that acts before what waits takes its place.
    let mut g = gate();
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    let now = CommandHeader { valid_from_ns: 450, ..header(1, 6) };
    g.offer(&now, &stop, 450).unwrap();
    assert_eq!((g.input(460), g.input(550)), (Command::STOP, Command::STOP));
    // So does one that acts at the same time, and nothing is behind it.
    let mut g = gate();
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    let same = CommandHeader { valid_until_ns: 540, ..header(1, 5) };
    g.offer(&CommandHeader { tick: 6, ..same }, &stop, 430).unwrap();
    assert_eq!(
        (g.input(510), g.next_change_ns(500), g.input(550)),
        (Command::STOP, Some(540), Command::STOP)
    );
    assert_eq!(g.holding(550), Holding::Command { tick: 5 });
}

proptest! {
    /// Any header, any record, in any order: a robot moves only inside the validity of a command
    /// that was offered, as long as the longest hold at most, and soon after it was received.
    #[test]
    fn whatever_headers_say_no_command_acts_after_its_time(
        offers in prop::collection::vec((any::<[u64; 6]>(), any::<[u8; 6]>(), 0_u64..300, 0.1..5.0), 1..60),
    ) {
        const HOLD: u64 = 100;
        let mut g = Gate::new(RobotId(3), Limits::default(), HOLD);
        let mut now = 10_000_u64;
        let mut offered: Vec<(CommandHeader, Command, u64)> = Vec::new();
        let mut last = 0;
        for (words, kinds, step, v_mps) in offers {
            now += step;
            // Anything, or near what would do.
            let word = |n: usize, near: u64| if kinds[n] % 8 == 0 { words[n] } else { near };
            let near = |n: usize| now.wrapping_add(words[n] % 400).wrapping_sub(100);
            let from = word(4, near(4));
            let header = CommandHeader {
                epoch: word(0, 1 + words[0] % 2),
                tick: word(1, now),
                stamp_ns: word(2, near(2)),
                state_stamp_ns: word(3, near(3).min(near(2))),
                valid_from_ns: from,
                valid_until_ns: word(5, from.wrapping_add(words[5] % 120)),
                follows: if kinds[3] % 8 == 1 { words[3] } else { last },
                ..CommandHeader::default()
            };
            let stop = RobotCommand::stop(RobotId(3), StopReason::OutOfStep);
            let command = if kinds[1] % 4 == 1 { stop } else { go(v_mps) };
            let taken = g.offer(&header, &command, now).is_ok();
            last = if taken { header.tick } else { last };
            offered.push((header, command.command(), now));
            for ahead in [0, 1, 50, 99, 100, 250, 301, 10_000] {
                // A copy looks ahead: time must not run backwards.
                let (at, input) = (now + ahead, g.clone().input(now + ahead));
                let explains = |(h, c, received): &(CommandHeader, Command, u64)| {
                    *c == input
                        && (h.valid_from_ns..h.valid_until_ns).contains(&at)
                        && h.valid_until_ns - h.valid_from_ns <= HOLD
                        && at < received + 3 * HOLD
                };
                prop_assert!(input == Command::STOP || offered.iter().any(explains), "{input:?} at {at}");
            }
        }
    }
}

#[test]
fn a_new_epoch_starts_over() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    assert_eq!(g.input(550).v_mps, 2.0);
    held(&mut g, 2, 6);
    assert_eq!(g.input(560).v_mps, 0.0);
    g.offer(&CommandHeader { follows: 6, ..header(2, 7) }, &go(1.0), 570).unwrap();
    assert_eq!(g.input(700).v_mps, 1.0);
    assert_eq!(g.offer(&header(1, 99), &go(1.0), 700), Err(Refusal::OldEpoch));
}

#[test]
fn a_new_epoch_drops_what_the_old_one_left() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(2.0), 500).unwrap();
    g.offer(&header(1, 6), &go(3.0), 520).unwrap();
    assert_eq!(g.input(530).v_mps, 2.0);
    // The new run's first command is a stop; the old run's act no more.
    held(&mut g, 2, 7);
    let later = CommandHeader { epoch: 2, valid_from_ns: 800, valid_until_ns: 900, ..header(1, 8) };
    g.offer(&later, &go(1.0), 540).unwrap();
    for (now, v) in [(540, 0.0), (610, 0.0), (799, 0.0), (800, 1.0), (900, 0.0)] {
        assert_eq!((g.input(now).v_mps, g.is_commanded(now)), (v, v > 0.0), "at {now}");
    }
}

#[test]
fn it_is_as_large_as_it_says() {
    assert_eq!(size_of::<Gate>(), 208);
}

#[test]
fn the_next_change_is_always_ahead() {
    assert_eq!(Gate::new(RobotId(3), Limits::default(), 1_000).next_change_ns(0), None);
    let mut g = gate();
    assert_eq!(g.input(400), Command::STOP);
    g.offer(&header(1, 5), &go(2.0), 420).unwrap();
    assert_eq!(
        [420, 499, 500, 599, 600].map(|now| g.next_change_ns(now)),
        [Some(500), Some(500), Some(600), Some(600), None]
    );
    assert_eq!(g.input(500).v_mps, 2.0);
    assert_eq!([500, 599, 600].map(|now| g.next_change_ns(now)), [Some(600), Some(600), None]);
}

#[test]
fn a_command_holds_for_some_time_and_at_most_as_long_as_it_may() {
    let mut g = gate();
    let at = |from, until| CommandHeader { valid_from_ns: from, valid_until_ns: until, ..header(1, 5) };
    assert_eq!(g.offer(&at(500, 500), &go(2.0), 420), Err(Refusal::Validity));
    assert_eq!(g.offer(&at(500, 1501), &go(2.0), 420), Err(Refusal::Validity));
    assert_eq!(g.offer(&at(300, 420), &go(2.0), 420), Err(Refusal::Expired));
    g.offer(&at(500, 1500), &go(2.0), 420).unwrap();
    assert_eq!((g.input(1499).v_mps, g.input(1500).v_mps, g.refused()), (2.0, 0.0, 3));
}

#[test]
fn a_robot_that_missed_a_command_stands_until_it_has_held_a_stop() {
    let (mut g, stop) = (gate(), RobotCommand::stop(RobotId(3), StopReason::OutOfStep));
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    assert_eq!(g.holding(420), Holding::Command { tick: 5 });
    // Tick 6 is lost: 7 and 8 were computed for a robot that had driven it.
    assert_eq!(g.offer(&header(1, 7), &go(1.0), 620), Err(Refusal::OutOfStep));
    assert_eq!(g.offer(&header(1, 8), &go(1.0), 720), Err(Refusal::OutOfStep));
    assert_eq!((g.input(650), g.holding(720)), (Command::STOP, Holding::Command { tick: 5 }));
    // Until the stop acts nobody may rely on where it is.
    g.offer(&header(1, 9), &stop, 820).unwrap();
    assert_eq!((g.holding(820), g.holding(899)), (Holding::Nothing, Holding::Nothing));
    assert_eq!((g.input(910), g.holding(910)), (Command::STOP, Holding::Command { tick: 9 }));
    g.offer(&header(1, 10), &go(1.0), 920).unwrap();
    assert_eq!((g.input(1050).v_mps, g.holding(920)), (1.0, Holding::Command { tick: 10 }));
}

#[test]
fn a_command_that_comes_as_its_time_begins_is_followed_and_later_it_is_missed() {
    let mut g = gate();
    let published = CommandHeader { state_stamp_ns: 500, stamp_ns: 500, ..header(1, 5) };
    assert_eq!(g.clone().offer(&published, &go(1.0), 500), Ok(()));
    assert_eq!(g.offer(&header(1, 5), &go(1.0), 501), Err(Refusal::Late));
    assert_eq!(g.offer(&header(1, 6), &go(1.0), 510), Err(Refusal::OutOfStep));
    // However late, a stop is a stop.
    assert_eq!(g.offer(&header(1, 5), &go(0.0), 510), Ok(()));
}

#[test]
fn a_stop_out_of_turn_leaves_what_was_followed_and_one_of_a_new_run_nothing() {
    let (mut g, stop) = (gate(), RobotCommand::stop(RobotId(3), StopReason::Deadline));
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    g.offer(&header(1, 7), &stop, 620).unwrap();
    assert_eq!(g.holding(750), Holding::Command { tick: 5 });
    g.offer(&header(2, 9), &stop, 820).unwrap();
    assert_eq!(g.holding(950), Holding::Nothing);
    let next = CommandHeader { follows: 5, ..header(2, 10) };
    assert_eq!(g.offer(&next, &go(1.0), 920), Err(Refusal::OutOfStep));
}

#[test]
fn commands_follow_each_other_over_periods_that_the_daemon_skipped() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    let after = CommandHeader { follows: 5, ..header(1, 9) };
    assert_eq!(g.offer(&after, &go(2.0), 820), Ok(()));
    assert_eq!((g.input(750), g.input(950).v_mps), (Command::STOP, 2.0));
}

#[test]
fn a_robot_that_stopped_by_itself_follows_nothing_until_it_has_held_a_stop() {
    let mut g = gate();
    g.offer(&header(1, 5), &go(1.0), 420).unwrap();
    g.offer(&header(1, 6), &go(1.0), 520).unwrap();
    g.halt();
    assert_eq!(
        (g.input(550), g.input(650), g.holding(650)),
        (Command::STOP, Command::STOP, Holding::Nothing)
    );
    assert_eq!(g.offer(&header(1, 7), &go(1.0), 620), Err(Refusal::OutOfStep));
    // Stops for other reasons come from a daemon that takes it to be elsewhere.
    for (tick, reason) in [(8, StopReason::Deadline), (9, StopReason::NoState), (10, StopReason::Start)] {
        g.offer(&header(1, tick), &RobotCommand::stop(RobotId(3), reason), tick * 100 - 80).unwrap();
        let next = g.clone().offer(&header(1, tick + 1), &go(1.0), tick * 100 + 20);
        assert_eq!((next, g.holding(tick * 100)), (Err(Refusal::OutOfStep), Holding::Nothing));
    }
    g.offer(&header(1, 11), &RobotCommand::stop(RobotId(3), StopReason::OutOfStep), 1020).unwrap();
    g.offer(&header(1, 12), &go(1.0), 1120).unwrap();
    assert_eq!((g.holding(1099), g.input(1250).v_mps), (Holding::Nothing, 1.0));
    assert_eq!(g.holding(1250), Holding::Command { tick: 12 });
}

#[test]
fn a_robot_of_which_nobody_tells_what_it_holds_follows_whatever_comes() {
    let mut g = Gate::new(RobotId(3), Limits::default(), 1_000).unreported();
    g.offer(&header(1, 5), &go(1.0), 550).unwrap();
    assert_eq!(g.input(550).v_mps, 1.0);
    g.offer(&header(1, 9), &go(2.0), 820).unwrap();
    assert_eq!((g.input(950).v_mps, g.holding(950)), (2.0, Holding::Untold));
    // Not even after something from which others begin anew.
    held(&mut g, 2, 10);
    assert_eq!(g.holding(1_050), Holding::Untold);
}

#[test]
fn who_joins_a_run_that_goes_on_waits_until_the_daemon_knows() {
    let (mut g, stop) =
        (Gate::new(RobotId(3), Limits::default(), 1_000), |reason| RobotCommand::stop(RobotId(3), reason));
    g.offer(&header(1, 5), &stop(StopReason::Deadline), 420).unwrap();
    assert_eq!(
        (g.offer(&header(1, 6), &go(1.0), 520), g.holding(520)),
        (Err(Refusal::OutOfStep), Holding::Nothing)
    );
    g.offer(&header(1, 7), &stop(StopReason::OutOfStep), 620).unwrap();
    assert_eq!((g.holding(699), g.holding(700)), (Holding::Nothing, Holding::Command { tick: 7 }));
    assert_eq!(g.offer(&header(1, 8), &go(1.0), 720), Ok(()));
}

#[test]
fn as_far_ahead_as_a_clock_may_be_read_early_and_no_further() {
    // Published up to 1000 ns after now, and to act up to 1000 ns after that.
    let ahead = |stamp_ns, from| CommandHeader {
        stamp_ns,
        state_stamp_ns: stamp_ns,
        valid_from_ns: from,
        valid_until_ns: from + 100,
        ..header(1, 5)
    };
    assert_eq!(gate().offer(&ahead(1420, 2420), &go(1.0), 420), Ok(()));
    assert_eq!(gate().offer(&ahead(1421, 2420), &go(1.0), 420), Err(Refusal::Future));
    assert_eq!(gate().offer(&ahead(1420, 2421), &go(1.0), 420), Err(Refusal::Future));
    // Announced however early, a stop is a stop.
    assert_eq!(gate().offer(&ahead(1420, 9000), &go(0.0), 420), Ok(()));
}
