//! Observations: what drivers and localisation send.

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
    RobotObservation { id: state.id, holding: 0, x_m: state.x_m, y_m: state.y_m, theta_rad: state.theta_rad }
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
