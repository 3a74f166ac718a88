//! Commands: what a gate takes from the daemon.

use super::*;

const SOUND: CommandHeader = CommandHeader {
    epoch: EPOCH,
    tick: 6,
    stamp_ns: NOW - 1,
    state_stamp_ns: NOW - 1,
    valid_from_ns: NOW + 10,
    valid_until_ns: NOW + 10 + T,
    follows: 5,
    records: 1,
    checksum: 0,
};

/// What a gate that holds a command says to one more, and what it lets act then and later.
fn offered(header: CommandHeader, record: RobotCommand) -> (Result<(), Refusal>, [Command; 3]) {
    let mut gate = Gate::new(RobotId(3), Limits::default(), T);
    let before = CommandHeader {
        tick: 5,
        stamp_ns: NOW - T,
        state_stamp_ns: NOW - T,
        valid_from_ns: NOW - T,
        valid_until_ns: NOW,
        follows: 4,
        ..SOUND
    };
    let stop = CommandHeader { tick: 4, stamp_ns: NOW - 2 * T, valid_from_ns: NOW - 2 * T, ..before };
    let start = RobotCommand::stop(RobotId(3), StopReason::Start);
    gate.offer(&CommandHeader { valid_until_ns: NOW - T, ..stop }, &start, NOW - 2 * T).unwrap();
    gate.offer(&before, &go(2.0, 0.0), NOW - T).unwrap();
    let said = gate.offer(&header, &record, NOW - 1);
    assert_eq!(gate.refused(), u64::from(said.is_err()));
    (said, [NOW - 1, NOW + 10, u64::MAX].map(|now_ns| gate.input(now_ns)))
}

fn go(v_mps: f64, omega_radps: f64) -> RobotCommand {
    RobotCommand { id: 3, stop_reason: 0, v_mps, omega_radps }
}

const HELD: Command = Command { v_mps: 2.0, omega_radps: 0.0 };

/// A refused command changes nothing: the one before acts to its end.
fn judged(said: Result<(), Refusal>, inputs: [Command; 3], expected: Option<Refusal>) {
    assert_eq!(said, expected.map_or(Ok(()), Err));
    if expected.is_some() {
        assert_eq!(inputs, [HELD, Command::STOP, Command::STOP]);
    }
    assert_eq!(inputs[2], Command::STOP, "nothing acts for ever");
}

proptest! {
    #[test]
    fn an_input_is_within_the_limits_or_refused(v in number(), omega in number()) {
        let limits = Limits::default();
        let within = (0.0..=limits.v_max_mps).contains(&v) && omega.abs() <= 1.0;
        let (said, inputs) = offered(SOUND, go(v, omega));
        judged(said, inputs, (!within).then_some(Refusal::Input));
        if within {
            prop_assert_eq!(inputs[1], Command { v_mps: v, omega_radps: omega });
        }
    }

    #[test]
    fn a_command_is_for_this_robot_or_refused(id in half()) {
        let (said, inputs) = offered(SOUND, RobotCommand { id, ..go(1.0, 0.5) });
        judged(said, inputs, (id != 3).then_some(Refusal::WrongRobot));
    }

    #[test]
    fn a_reason_to_stop_comes_with_a_stop_or_is_refused(stop_reason in half()) {
        let (said, inputs) = offered(SOUND, RobotCommand { stop_reason, ..go(1.0, 0.5) });
        judged(said, inputs, (stop_reason != 0).then_some(Refusal::Input));
        let (said, inputs) = offered(SOUND, RobotCommand { stop_reason, ..go(0.0, 0.0) });
        judged(said, inputs, None);
    }

    #[test]
    fn a_run_is_not_older_and_a_tick_is_newer_or_refused(epoch in word(EPOCH), tick in word(5)) {
        let refused = if epoch < EPOCH {
            Some(Refusal::OldEpoch)
        } else {
            (epoch == EPOCH && tick <= 5).then_some(Refusal::OldTick)
        };
        let header = CommandHeader { epoch, tick, ..SOUND };
        let (said, inputs) = offered(header, go(0.0, 0.0));
        judged(said, inputs, refused);
        // Nobody moves by the first command of a run.
        let (said, inputs) = offered(header, go(1.0, 0.5));
        judged(said, inputs, refused.or((epoch > EPOCH).then_some(Refusal::OutOfStep)));
    }

    #[test]
    fn who_moves_holds_the_command_before_or_it_is_refused(follows in word(5)) {
        let header = CommandHeader { follows, ..SOUND };
        let (said, inputs) = offered(header, go(1.0, 0.5));
        judged(said, inputs, (follows != 5).then_some(Refusal::OutOfStep));
        // A stop is taken whatever was missed.
        let (said, inputs) = offered(header, go(0.0, 0.0));
        judged(said, inputs, None);
    }

    #[test]
    fn who_moves_was_told_before_the_time_or_it_is_refused(early_ns in 0..2 * T) {
        // Received at NOW - 1.
        let from = NOW - 1 + T - early_ns;
        let header = CommandHeader {
            stamp_ns: from.min(NOW - 1), state_stamp_ns: NOW - T, valid_from_ns: from, valid_until_ns: from + T, ..SOUND
        };
        let (said, inputs) = offered(header, go(1.0, 0.5));
        judged(said, inputs, (early_ns > T).then_some(Refusal::Late));
        let (said, inputs) = offered(header, go(0.0, 0.0));
        judged(said, inputs, None);
    }

    #[test]
    fn a_time_to_act_is_ahead_and_short_or_refused(from in word(NOW), until in prop_oneof![word(NOW), word(NOW + T)]) {
        let header = CommandHeader { valid_from_ns: from, valid_until_ns: until, ..SOUND };
        let refused = if until <= from || until - from > T {
            Some(Refusal::Validity)
        } else if until < NOW {
            Some(Refusal::Expired)
        } else if from < NOW - 1 {
            // It was to act before it was published.
            Some(Refusal::Validity)
        } else {
            (from > NOW - 1 + 2 * T).then_some(Refusal::Future)
        };
        let (said, inputs) = offered(header, go(1.0, 0.5));
        prop_assert_eq!(said, refused.map_or(Ok(()), Err));
        for (input, now_ns) in inputs.into_iter().zip([NOW - 1, NOW + 10, u64::MAX]) {
            let new = refused.is_none() && (from..until).contains(&now_ns);
            let one = if new { Command { v_mps: 1.0, omega_radps: 0.5 } } else { Command::STOP };
            // The command before acts until a newer one's time has come.
            let held = now_ns == NOW - 1 && (refused.is_some() || from > now_ns);
            prop_assert_eq!(input, if held { HELD } else { one }, "at {}", now_ns);
        }
    }

    #[test]
    fn stamps_are_in_their_order_or_refused(
        stamp_ns in prop_oneof![word(NOW), word(NOW + T)], state_stamp_ns in prop_oneof![word(NOW), word(NOW + T)],
    ) {
        let header = CommandHeader { stamp_ns, state_stamp_ns, ..SOUND };
        let in_order = state_stamp_ns <= stamp_ns && stamp_ns <= SOUND.valid_from_ns;
        let (said, inputs) = offered(header, go(1.0, 0.5));
        judged(said, inputs, (!in_order).then_some(Refusal::Validity));
        // A stop is refused only from a clock that is not ours.
        let (said, inputs) = offered(header, go(0.0, 0.0));
        judged(said, inputs, (stamp_ns > NOW - 1 + T).then_some(Refusal::Future));
    }

    #[test]
    fn what_the_channel_checks_has_no_effect(records in any::<u32>(), checksum in any::<u32>()) {
        let header = CommandHeader { records, checksum, ..SOUND };
        prop_assert_eq!(offered(header, go(1.0, 0.5)), offered(SOUND, go(1.0, 0.5)));
    }
}
