//! Any value in any field of a record from shared memory, and what is promised for it: refused and counted,
//! wrapped, bounded, or without effect. Fields that the daemon only writes have no promise to keep.

use std::f64::consts::PI;

use clearway::actuation::{Gate, Refusal};
use clearway::admission::{Admission, Rejection};
use clearway::config::{Config, SourceConfig};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation::initial_fleet;
use clearway::geometry::wrap;
use clearway::model::{Command, Limits, RobotId};
use clearway::runtime::Rehearsal;
use clearway::scenario::Scenario;
use clearway::wire::{
    AdminCode, AdminKind, AdminRequest, AdminRobot, CommandHeader, Holding, ObservationHeader,
    RobotCheckpoint, RobotCommand, RobotIntent, RobotObservation, RobotState, StopReason, state_flags,
};
use proptest::prelude::*;

/// Any number that eight bytes can be, the odd ones often.
fn number() -> impl Strategy<Value = f64> {
    let odd = [
        f64::NAN,
        -f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        -5e-324,
        0.0,
        -0.0,
        1e-300,
        1e150,
        1e4,
        -1e4,
        PI,
        -PI,
    ];
    prop_oneof![
        prop::sample::select(odd.to_vec()),
        any::<u64>().prop_map(f64::from_bits),
        -1e5..1e5_f64,
        -9.0..9.0_f64
    ]
}

/// Any eight bytes, those around `at` and the ends often.
fn word(at: u64) -> impl Strategy<Value = u64> {
    let near = (0..6_u64).prop_map(move |n| at.wrapping_sub(3).wrapping_add(n));
    prop_oneof![
        near,
        prop::sample::select(vec![0, 1, u64::MAX / 2, u64::MAX / 2 + 1, u64::MAX]),
        any::<u64>()
    ]
}

/// Any four bytes, small ones often.
fn half() -> impl Strategy<Value = u32> {
    prop_oneof![0..16_u32, Just(u32::MAX), any::<u32>()]
}

const T: u64 = 80_000_000;
const EPOCH: u64 = 77;
const NOW: u64 = 10 * T;

mod observation {
    use super::*;

    const BEFORE: ObservationHeader =
        ObservationHeader { epoch: EPOCH, sequence: 1000, stamp_ns: NOW - T, records: 1, checksum: 0 };

    /// Robot 0 has been seen at its start, a period ago; what becomes of one more sample.
    fn after(header: ObservationHeader, record: RobotObservation) -> (Admission, RobotState) {
        let scenario = Scenario::builtin("swap8").unwrap();
        let start = RobotState::at_start(&scenario.robots[0]);
        let mut admission = Admission::new(&scenario, &SourceConfig::default(), T);
        admission.sample(1, &BEFORE, &[at(&start)], EPOCH, NOW - T);
        assert!(admission.pose(0, NOW - T).is_some());
        admission.sample(1, &header, &[record], EPOCH, NOW);
        (admission, start)
    }

    fn at(state: &RobotState) -> RobotObservation {
        RobotObservation {
            id: state.id,
            holding: 0,
            x_m: state.x_m,
            y_m: state.y_m,
            theta_rad: state.theta_rad,
        }
    }

    fn next() -> ObservationHeader {
        ObservationHeader { sequence: BEFORE.sequence + 1, stamp_ns: NOW, ..BEFORE }
    }

    fn here() -> RobotObservation {
        at(&RobotState::at_start(&Scenario::builtin("swap8").unwrap().robots[0]))
    }

    /// Refused for just this reason, and nothing believed that was not before; or believed.
    fn judged(admission: &Admission, refused: Option<Rejection>) {
        for (reason, count) in admission.rejections().iter() {
            assert_eq!(count, u64::from(refused == Some(reason)), "{reason:?}");
        }
        let stamp_ns = admission.last_good(0).map(|(_, stamp_ns)| stamp_ns);
        assert_eq!(stamp_ns == Some(BEFORE.stamp_ns), refused.is_some());
    }

    proptest! {
        #[test]
        fn a_position_is_in_the_arena_and_within_reach_or_refused(x in number(), y in number()) {
            let (admission, start) = after(next(), RobotObservation { x_m: x, y_m: y, ..here() });
            let arena_m = SourceConfig::default().arena_m;
            // 5 m/s for 80 ms, and the margin.
            let reach_m = 0.4 + SourceConfig::default().jump_margin_m;
            let refused = if !(x.is_finite() && y.is_finite()) {
                Some(Rejection::NotFinite)
            } else if x.abs() > arena_m || y.abs() > arena_m {
                Some(Rejection::OutOfRange)
            } else if (x - start.x_m).hypot(y - start.y_m) > reach_m {
                Some(Rejection::Jump)
            } else {
                None
            };
            judged(&admission, refused);
            if refused.is_none() {
                let pose = admission.pose(0, NOW).unwrap().0;
                prop_assert_eq!((pose.position_m.x.to_bits(), pose.position_m.y.to_bits()), (x.to_bits(), y.to_bits()));
            }
        }

        #[test]
        fn a_heading_is_wrapped_and_one_that_it_can_have_turned_to_or_refused(theta_rad in number()) {
            let (admission, start) = after(next(), RobotObservation { theta_rad, ..here() });
            // 1 rad/s for 80 ms, and the margin.
            let reach_rad = 0.08 + SourceConfig::default().turn_margin_rad;
            let refused = if !theta_rad.is_finite() {
                Some(Rejection::NotFinite)
            } else if wrap(wrap(theta_rad) - start.theta_rad).abs() > reach_rad {
                Some(Rejection::Jump)
            } else {
                None
            };
            judged(&admission, refused);
            if refused.is_none() {
                let pose = admission.pose(0, NOW).unwrap().0;
                prop_assert!(pose.theta_rad > -PI && pose.theta_rad <= PI, "{}", pose.theta_rad);
                // Beyond that the last bit of the heading is more than a small angle.
                let same = (pose.theta_rad - theta_rad).sin().abs() < 1e-9;
                prop_assert!(same || theta_rad.abs() > 1e6, "{theta_rad} became {}", pose.theta_rad);
            }
        }

        #[test]
        fn an_id_is_one_of_the_fleet_or_refused(id in half()) {
            let (admission, _) = after(next(), RobotObservation { id, ..here() });
            // At the start of robot 0, robots 1 to 7 are seen for the first time.
            prop_assert_eq!(admission.rejections().get(Rejection::UnknownRobot), u64::from(id > 7));
            prop_assert_eq!(admission.rejections().total(), u64::from(id > 7));
        }

        #[test]
        fn what_is_checked_by_the_channel_has_no_effect(records in any::<u32>(), checksum in any::<u32>()) {
            judged(&after(ObservationHeader { records, checksum, ..next() }, here()).0, None);
        }

        #[test]
        fn what_a_robot_holds_is_kept_with_its_pose_and_is_nothing_of_ours_from_who_follows_no_run(
            holding in half(), follows_none in any::<bool>(),
        ) {
            let header = ObservationHeader { epoch: if follows_none { 0 } else { EPOCH }, ..next() };
            let (admission, start) = after(header, RobotObservation { holding, ..here() });
            judged(&admission, None);
            let told = if follows_none && holding != 0 { Holding::Nothing.code() } else { holding };
            prop_assert_eq!(admission.holding(0), told);
            prop_assert_eq!(admission.pose(0, NOW).unwrap().0, start.pose());
        }

        #[test]
        fn an_epoch_is_ours_or_none_or_refused(epoch in word(EPOCH)) {
            let other = epoch != 0 && epoch != EPOCH;
            judged(&after(ObservationHeader { epoch, ..next() }, here()).0, other.then_some(Rejection::Epoch));
        }

        #[test]
        fn a_stamp_is_fresh_or_refused(stamp_ns in prop_oneof![word(NOW), word(NOW - 2 * T), word(BEFORE.stamp_ns)]) {
            let max_age_ns = SourceConfig::default().max_age_or_default_ns(T);
            let refused = if stamp_ns > NOW {
                Some(Rejection::Future)
            } else if NOW - stamp_ns > max_age_ns {
                Some(Rejection::Stale)
            } else {
                (stamp_ns < BEFORE.stamp_ns).then_some(Rejection::Reordered)
            };
            let (admission, _) = after(ObservationHeader { stamp_ns, ..next() }, here());
            // The same stamp with a later number is taken as well.
            if stamp_ns == BEFORE.stamp_ns {
                prop_assert_eq!(admission.rejections().total(), 0);
            } else {
                judged(&admission, refused);
            }
        }

        #[test]
        fn a_sequence_goes_on_or_is_refused(sequence in word(BEFORE.sequence)) {
            let (admission, _) = after(ObservationHeader { sequence, ..next() }, here());
            let ahead = sequence.wrapping_sub(BEFORE.sequence);
            let refused = match ahead {
                0 => Some(Rejection::Repeated),
                1..=3_000_000 => None,
                _ if ahead > u64::MAX / 2 => Some(Rejection::Reordered),
                _ => Some(Rejection::Gap),
            };
            judged(&admission, refused);
            let skipped = if refused.is_none() { ahead - 1 } else { 0 };
            prop_assert_eq!(admission.rejections().skipped_samples, skipped);
        }
    }
}

mod command {
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
}

mod admin {
    use super::*;

    fn fleet() -> Rehearsal {
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.admin.capacity = 9;
        Rehearsal::new(&config, EPOCH)
    }

    const SOUND: AdminRequest = AdminRequest {
        ticket: 1,
        expires_ns: NOW + 1,
        epoch: EPOCH,
        offset: 0,
        kind: AdminKind::SetGoals as u32,
        reserved: 0,
    };

    const NEW: AdminRobot = AdminRobot {
        id: 50,
        reserved: 0,
        goal_x_m: 30.0,
        goal_y_m: 30.0,
        start_x_m: 20.0,
        start_y_m: 20.0,
        start_theta_rad: 0.0,
        radius_m: 0.15,
    };

    /// What one request comes to: accepted, or refused with nothing changed.
    fn asked(request: AdminRequest, robots: &[AdminRobot]) -> Option<AdminCode> {
        let mut fleet = fleet();
        let (before, hold) = (fleet.scenario(), fleet.hold());
        let refusal = fleet.ask(&request, robots, NOW).err();
        if let Some(refusal) = &refusal {
            assert!(!refusal.text.is_empty() && refusal.text.len() < 300, "{refusal:?}");
            assert_eq!((fleet.scenario(), fleet.hold()), (before, hold));
        }
        refusal.map(|refusal| refusal.code)
    }

    proptest! {
        #[test]
        fn a_goal_is_in_the_arena_or_refused(x in number(), y in number()) {
            let code = asked(SOUND, &[AdminRobot { goal_x_m: x, goal_y_m: y, ..AdminRobot::default() }]);
            let arena_m = SourceConfig::default().arena_m;
            if !(x.is_finite() && y.is_finite()) {
                prop_assert_eq!(code, Some(AdminCode::NotFinite));
            } else if x.hypot(y) > arena_m * (1.0 + 1e-12) {
                prop_assert_eq!(code, Some(AdminCode::OutsideArena));
            } else if x.hypot(y) < arena_m * (1.0 - 1e-12) {
                prop_assert!(matches!(code, None | Some(AdminCode::GoalTaken)), "{code:?}");
            }
        }

        #[test]
        fn a_new_robot_has_a_body_and_a_place_or_is_refused(
            radius_m in number(), start_theta_rad in number(), id in half(), start_x_m in number(),
        ) {
            let request = AdminRequest { kind: AdminKind::AddRobot as u32, ..SOUND };
            let ask = |record: AdminRobot| asked(request, &[record]);
            let sound = radius_m > 0.0 && radius_m <= 100.0;
            let code = ask(AdminRobot { radius_m, goal_x_m: 300.0, ..NEW });
            prop_assert_eq!(code, (!sound).then_some(AdminCode::BadRadius));
            let code = ask(AdminRobot { start_theta_rad, ..NEW });
            prop_assert_eq!(code, (!start_theta_rad.is_finite()).then_some(AdminCode::NotFinite));
            let code = ask(AdminRobot { id, ..NEW });
            prop_assert_eq!(code, (id < 8 || id == u32::MAX).then_some(AdminCode::TakenId));
            let code = ask(AdminRobot { start_x_m, ..NEW });
            let expected = if start_x_m.is_finite() {
                (start_x_m.hypot(20.0) > SourceConfig::default().arena_m).then_some(AdminCode::OutsideArena)
            } else {
                Some(AdminCode::NotFinite)
            };
            prop_assert_eq!(code, expected);
        }

        #[test]
        fn only_robots_of_the_fleet_are_spoken_of(id in half(), reserved in any::<u32>()) {
            let unknown = (id > 7).then_some(AdminCode::UnknownRobot);
            let record = AdminRobot { id, reserved, goal_x_m: 30.0, goal_y_m: 30.0, ..AdminRobot::default() };
            prop_assert_eq!(asked(SOUND, &[record]), unknown);
            let request = AdminRequest { kind: AdminKind::RemoveRobot as u32, ..SOUND };
            prop_assert_eq!(asked(request, &[record]), unknown);
        }

        #[test]
        fn an_expiry_an_epoch_and_a_kind_are_looked_at(expires_ns in prop_oneof![word(NOW), word(NOW + 60_000_000_000)], epoch in word(EPOCH), kind in half()) {
            let goal = [AdminRobot { goal_x_m: 30.0, ..AdminRobot::default() }];
            let expected = if expires_ns <= NOW {
                Some(AdminCode::Expired)
            } else {
                (expires_ns - NOW > 60_000_000_000).then_some(AdminCode::Malformed)
            };
            prop_assert_eq!(asked(AdminRequest { expires_ns, ..SOUND }, &goal), expected);
            let other = (epoch != 0 && epoch != EPOCH).then_some(AdminCode::OtherEpoch);
            prop_assert_eq!(asked(AdminRequest { epoch, ..SOUND }, &goal), other);
            // About robot 0: goals are set and it is removed; the rest takes no robot, or a sound new one.
            let expected = match AdminKind::from_code(kind) {
                Some(AdminKind::SetGoals | AdminKind::RemoveRobot) => None,
                Some(AdminKind::AddRobot) => Some(AdminCode::TakenId),
                _ => Some(AdminCode::Malformed),
            };
            prop_assert_eq!(asked(AdminRequest { kind, ..SOUND }, &goal), expected);
        }

        #[test]
        fn what_is_repeated_or_reserved_has_no_effect(ticket in any::<u64>(), offset in any::<u64>(), reserved in any::<u32>()) {
            let goal = [AdminRobot { reserved, goal_x_m: 30.0, ..AdminRobot::default() }];
            prop_assert_eq!(asked(AdminRequest { ticket, offset, reserved, ..SOUND }, &goal), None);
        }
    }
}

mod state {
    use super::*;

    /// A state whose every field may be anything.
    fn record() -> impl Strategy<Value = RobotState> {
        let intent = (number(), number(), number(), [number(), number(), number(), number()], half(), half())
            .prop_map(|(heading_rad, speed_mps, blocked_s, [tx, ty, wx, wy], rank, valid)| RobotIntent {
                heading_rad,
                speed_mps,
                blocked_s,
                target_x_m: tx,
                target_y_m: ty,
                waypoint_x_m: wx,
                waypoint_y_m: wy,
                rank,
                valid,
            });
        let body =
            (half(), half(), [number(), number(), number()], [number(), number()], [number(), number()]);
        let doubt = [number(), number(), number(), number()];
        (body, number(), doubt, intent).prop_map(
            |(
                (id, flags, [x_m, y_m, theta_rad], [v_mps, omega_radps], [gx, gy]),
                radius_m,
                [uncertainty_m, seen_x_m, seen_y_m, way_m],
                intent,
            )| {
                RobotState {
                    id,
                    flags,
                    x_m,
                    y_m,
                    theta_rad,
                    v_mps,
                    omega_radps,
                    goal_x_m: gx,
                    goal_y_m: gy,
                    radius_m,
                    uncertainty_m,
                    seen_x_m,
                    seen_y_m,
                    way_m,
                    intent,
                }
            },
        )
    }

    /// One field of `from` in place of that of `into`.
    fn blend(into: &mut RobotState, from: &RobotState, field: usize) {
        let (a, b) = (&mut into.intent, &from.intent);
        match field {
            0 => into.x_m = from.x_m,
            1 => into.y_m = from.y_m,
            2 => into.theta_rad = from.theta_rad,
            3 => into.v_mps = from.v_mps,
            4 => into.omega_radps = from.omega_radps,
            5 => into.goal_x_m = from.goal_x_m,
            6 => into.goal_y_m = from.goal_y_m,
            7 => into.radius_m = from.radius_m,
            8 => into.uncertainty_m = from.uncertainty_m,
            9 => into.flags = from.flags,
            10 => into.id = from.id,
            11 => a.heading_rad = b.heading_rad,
            12 => a.speed_mps = b.speed_mps,
            13 => a.blocked_s = b.blocked_s,
            14 => (a.target_x_m, a.target_y_m) = (b.target_x_m, b.target_y_m),
            15 => (a.waypoint_x_m, a.waypoint_y_m) = (b.waypoint_x_m, b.waypoint_y_m),
            16 => (a.rank, a.valid) = (b.rank, b.valid),
            17 => (into.seen_x_m, into.seen_y_m) = (from.seen_x_m, from.seen_y_m),
            18 => into.way_m = from.way_m,
            _ => *into = *from,
        }
    }

    /// Drives a fleet of which one record is replaced, for some periods; every command is a stop with a
    /// reason or within the limits.
    fn drives(record: &RobotState, field: usize, robot: usize, memory: Option<&RobotCheckpoint>) {
        let config = Config::new(Scenario::builtin("swap8").unwrap());
        let mut fleet = initial_fleet(&config);
        let mut group = RobotGroup::new(&config, 0..fleet.len()).unwrap();
        for period in 0..4 {
            if period == 1
                && let Some(memory) = memory
            {
                let own = RobotCheckpoint { id: fleet[robot].id, ..*memory };
                group.restore(robot, &own);
            }
            let mut seen = fleet.clone();
            if period > 0 {
                blend(&mut seen[robot], record, field);
                // Of a way on which it may stand, it is read only then.
                seen[robot].flags |= if matches!(field, 17 | 18) { state_flags::MAY_STAND } else { 0 };
            }
            let mut next = fleet.clone();
            group.solve(&seen, Timing::LogicalExecutionTime, |index, decision| {
                let command = decision.command;
                let stop = command.stop_reason != 0 && command.command() == Command::STOP;
                let drive = command.stop_reason == 0 && config.scenario.limits.admits(command.command());
                assert!(stop || drive, "robot {index}: {command:?}");
                let stands = seen[index].is_held() || seen[index].has(state_flags::OUT_OF_STEP);
                let driven = seen[index].has(state_flags::VALID) && !stands;
                assert!(stop || driven, "robot {index}: {command:?}");
                next[index].set_command(command.command());
                next[index].intent = decision.intent;
            });
            for robot in &mut next {
                let end = robot.arc().pose(config.timing.period_s());
                robot.set_pose(end);
            }
            fleet = next;
        }
    }

    proptest! {
        /// The workers believe what they read from a state that has its checksum; whatever stands in it, they
        /// neither panic nor command what may not be commanded.
        #[test]
        fn whatever_a_state_says_nobody_panics_and_no_command_is_beyond_the_limits(
            record in record(), field in 0..22_usize, robot in 0..8_usize,
        ) {
            drives(&record, field, robot, None);
        }

        /// So with what a controller is told that it remembers.
        #[test]
        fn whatever_a_memory_says_nobody_panics_and_no_command_is_beyond_the_limits(
            words in prop::collection::vec(prop_oneof![word(0), number().prop_map(f64::to_bits)], RobotCheckpoint::WORDS),
            flags in half(), robot in 0..8_usize,
        ) {
            let words = words.try_into().unwrap();
            let memory = RobotCheckpoint { id: 0, flags, words };
            let config = Config::new(Scenario::builtin("swap8").unwrap());
            drives(&initial_fleet(&config)[robot], 0, robot, Some(&memory));
        }
    }
}
