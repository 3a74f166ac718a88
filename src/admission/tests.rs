use super::sequence::{FOLLOW_SAMPLES, GAP_MAX};
use super::*;
use crate::geometry::Vec2;
use crate::model::{Limits, RobotId, RobotSpec};
use proptest::prelude::*;

const T: u64 = 80_000_000;
const EPOCH: u64 = 77;
const A: u128 = 1;
const B: u128 = 2;

fn admission() -> Admission {
    admission_of(None)
}

/// Robot 9 may be a foreign one.
fn admission_of(foreign_speed_mps: Option<f64>) -> Admission {
    let robot = |id: u32| RobotSpec {
        id: RobotId(id),
        radius_m: 0.15,
        start: Pose::new(f64::from(id), 0.0, 0.0),
        goal_m: Vec2::new(0.0, 5.0),
        foreign_speed_mps: foreign_speed_mps.filter(|_| id == 9),
    };
    let scenario = Scenario {
        name: "two".into(),
        tolerance_m: 0.05,
        duration_s: 1.0,
        limits: Limits::default(),
        robots: vec![robot(3), robot(9)],
        obstacles: vec![],
    };
    Admission::new(&scenario, &SourceConfig::default(), T)
}

fn header(sequence: u64, stamp_ns: u64) -> ObservationHeader {
    ObservationHeader { epoch: EPOCH, sequence, stamp_ns, ..ObservationHeader::default() }
}

fn at(id: u32, x_m: f64) -> RobotObservation {
    RobotObservation { id, x_m, ..RobotObservation::default() }
}

/// Offers one record of writer A, sequence and time following from `n`.
fn offer(a: &mut Admission, n: u64, record: RobotObservation) {
    a.sample(A, &header(n, n * T), &[record], EPOCH, n * T);
}

#[test]
fn a_good_sample_is_a_pose_until_it_is_stale() {
    let mut a = admission();
    assert_eq!(a.pose(0, T), None);
    assert_eq!(a.last_pose(0), Some(Pose::new(3.0, 0.0, 0.0)));
    offer(&mut a, 1, RobotObservation { theta_rad: 7.0, ..at(3, 3.1) });
    let expected = Pose::new(3.1, 0.0, 7.0);
    assert_eq!(a.pose(0, T), Some((expected, T)));
    assert_eq!(a.pose(0, 3 * T), Some((expected, T)));
    assert_eq!(a.pose(0, 3 * T + 1), None);
    assert_eq!(a.last_pose(0), Some(expected));
    assert_eq!(a.pose(1, T), None);
    assert_eq!(a.rejections().total(), 0);
}

#[test]
fn each_bad_record_has_its_reason_and_leaves_the_others_alone() {
    let cases = [
        (at(3, f64::NAN), Rejection::NotFinite),
        (RobotObservation { y_m: f64::INFINITY, ..at(3, 3.0) }, Rejection::NotFinite),
        (RobotObservation { theta_rad: f64::NEG_INFINITY, ..at(3, 3.0) }, Rejection::NotFinite),
        (at(3, 1.1e4), Rejection::OutOfRange),
        (at(4, 3.0), Rejection::UnknownRobot),
    ];
    for (record, reason) in cases {
        let mut a = admission();
        a.sample(A, &header(1, T), &[record, at(9, 9.0)], EPOCH, T);
        assert_eq!(a.rejections().get(reason), 1, "{reason:?}");
        assert_eq!(a.rejections().total(), 1, "{reason:?}");
        assert_eq!(a.pose(0, T), None);
        assert!(a.pose(1, T).is_some());
    }
}

#[test]
fn each_bad_header_has_its_reason() {
    let cases = [
        (ObservationHeader { epoch: EPOCH - 1, ..header(2, 5 * T) }, Rejection::Epoch),
        (header(2, 5 * T + 1), Rejection::Future),
        (header(2, 3 * T - 1), Rejection::Stale),
        (header(1, 5 * T), Rejection::Repeated),
        (header(0, 5 * T), Rejection::Reordered),
        (header(1 << 40, 5 * T), Rejection::Gap),
    ];
    for (bad, reason) in cases {
        let mut a = admission();
        a.sample(A, &header(1, 4 * T), &[at(3, 3.0)], EPOCH, 4 * T);
        a.sample(A, &bad, &[at(3, 3.1)], EPOCH, 5 * T);
        assert_eq!(a.rejections().get(reason), 1, "{reason:?}");
        assert_eq!(a.pose(0, 5 * T).map(|(_, stamp)| stamp), Some(4 * T));
    }
    let mut a = admission();
    a.sample(A, &header(1, T), &[at(3, 3.0); 3], EPOCH, T);
    assert_eq!(a.rejections().get(Rejection::Oversize), 1);
}

#[test]
fn gaps_are_counted_and_each_writer_has_its_own_sequence() {
    let mut a = admission();
    a.sample(A, &header(10, T), &[at(3, 3.0)], EPOCH, T);
    a.sample(B, &header(1, T), &[at(9, 9.0)], EPOCH, T);
    a.sample(A, &header(14, T), &[at(3, 3.0)], EPOCH, T);
    assert_eq!((a.rejections().total(), a.rejections().skipped_samples), (0, 3));
    // A writer that has not seen the run yet is heard.
    a.sample(B, &ObservationHeader { epoch: 0, ..header(2, 2 * T) }, &[at(9, 9.0)], EPOCH, 2 * T);
    assert_eq!(a.rejections().total(), 0);
}

#[test]
fn a_sequence_wraps_and_a_corrupted_number_locks_nobody_out() {
    let mut a = admission();
    for (n, sequence) in [u64::MAX - 1, u64::MAX, 0, 1].into_iter().enumerate() {
        let now = (n as u64 + 1) * T;
        a.sample(A, &header(sequence, now), &[at(3, 3.0)], EPOCH, now);
    }
    assert_eq!(a.rejections().total(), 0);
    a.sample(A, &header(1 << 50, 5 * T), &[at(3, 3.0)], EPOCH, 5 * T);
    a.sample(A, &header(2, 6 * T), &[at(3, 3.0)], EPOCH, 6 * T);
    assert_eq!((a.rejections().get(Rejection::Gap), a.rejections().total()), (1, 1));
    assert_eq!(a.pose(0, 6 * T).map(|(_, stamp)| stamp), Some(6 * T));
}

/// A first number that was wrong, and the right ones behind or far ahead of it.
#[test]
fn a_wrong_first_number_is_given_up_once_enough_others_follow_each_other() {
    for (first, reason) in [(1 << 40, Rejection::Reordered), (u64::MAX / 4 * 3, Rejection::Gap)] {
        let mut a = admission();
        a.sample(A, &header(first, T), &[at(3, 3.0)], EPOCH, T);
        // One of them is lost on the way.
        let numbers = [2, 3, 5, 6, 7, 8];
        for (n, sequence) in numbers.into_iter().enumerate() {
            let now = (n as u64 + 2) * T;
            a.sample(A, &header(sequence, now), &[at(3, 3.0)], EPOCH, now);
            let followed = n + 1 >= FOLLOW_SAMPLES as usize;
            assert_eq!(a.rejections().resynchronised_writers, u64::from(followed), "{n}");
            assert_eq!(a.last_good(0).map(|good| good.1), Some(if followed { now } else { T }), "{n}");
        }
        let refused = u64::from(FOLLOW_SAMPLES) - 1;
        assert_eq!((a.rejections().get(reason), a.rejections().total()), (refused, refused));
        // The wrong ones do not come back either.
        a.sample(A, &header(first + 1, 8 * T), &[at(3, 3.0)], EPOCH, 8 * T);
        assert_eq!(a.rejections().total(), refused + 1);
    }
}

#[test]
fn old_samples_are_never_followed_however_many_they_are() {
    // As they were sent: of a time before the newest that was taken.
    let mut a = admission();
    offer(&mut a, 100, at(3, 3.0));
    for n in 0..50 {
        a.sample(A, &header(n, 99 * T + n), &[at(3, 3.0)], EPOCH, 100 * T);
    }
    // The same one again and again, numbers in no order, and times that do not rise.
    for n in 0..50 {
        a.sample(A, &header(5, 100 * T + 1 + n), &[at(3, 3.0)], EPOCH, 101 * T);
        a.sample(A, &header(60 - n, 101 * T), &[at(3, 3.0)], EPOCH, 101 * T);
    }
    // Four that follow each other are not enough, nor is one more after a sample in order.
    for n in 1..FOLLOW_SAMPLES {
        let n = u64::from(n);
        a.sample(A, &header(10 + n, 101 * T + n), &[at(3, 3.0)], EPOCH, 102 * T);
    }
    a.sample(A, &header(101, 102 * T), &[at(3, 3.0)], EPOCH, 102 * T);
    assert_eq!(a.last_good(0).map(|good| good.1), Some(102 * T));
    a.sample(A, &header(15, 103 * T), &[at(3, 3.0)], EPOCH, 103 * T);
    assert_eq!((a.rejections().resynchronised_writers, a.rejections().get(Rejection::Gap)), (0, 0));
    assert_eq!(a.last_good(0).map(|good| good.1), Some(102 * T));
}

#[test]
fn one_writer_speaks_for_a_robot_until_it_falls_silent() {
    let mut a = admission();
    a.sample(A, &header(1, T), &[at(3, 3.0)], EPOCH, T);
    a.sample(B, &header(1, 2 * T), &[at(3, 3.2)], EPOCH, 2 * T);
    assert_eq!(a.rejections().get(Rejection::ForeignWriter), 1);
    assert_eq!(a.last_pose(0), Some(Pose::new(3.0, 0.0, 0.0)));
    a.sample(B, &header(2, 4 * T), &[at(3, 3.2)], EPOCH, 4 * T);
    assert_eq!(a.last_pose(0), Some(Pose::new(3.2, 0.0, 0.0)));
}

#[test]
fn a_robot_that_stands_twice_in_a_sample_is_believed_neither_time() {
    let mut a = admission();
    offer(&mut a, 1, at(3, 3.0));
    a.sample(A, &header(2, 2 * T), &[at(3, 3.0), at(3, 3.1)], EPOCH, 2 * T);
    assert_eq!(a.rejections().get(Rejection::DuplicateRobot), 1);
    assert_eq!(a.pose(0, 2 * T), None);
}

#[test]
fn a_jump_is_in_quarantine_until_enough_samples_agree() {
    let mut a = admission();
    offer(&mut a, 1, at(3, 3.0));
    // 5 m/s for 80 ms and 0.25 m of margin: 0.65 m.
    offer(&mut a, 2, at(3, 3.64));
    assert_eq!(a.rejections().total(), 0);
    offer(&mut a, 3, at(3, 4.30));
    assert_eq!(a.rejections().get(Rejection::Jump), 1);
    assert_eq!((a.pose(0, 3 * T), a.last_pose(0)), (None, Some(Pose::new(3.64, 0.0, 0.0))));
    // Four agree, one jumps again, and the count starts over.
    for (n, x) in (4..9).zip([4.3, 4.3, 4.3, 4.3, 7.0]) {
        offer(&mut a, n, at(3, x));
        assert_eq!(a.pose(0, n * T), None);
    }
    for n in 9..13 {
        offer(&mut a, n, at(3, 7.0));
        assert_eq!(a.pose(0, n * T), None, "sample {n}");
    }
    offer(&mut a, 13, at(3, 7.0));
    assert_eq!(a.pose(0, 13 * T), Some((Pose::new(7.0, 0.0, 0.0), 13 * T)));
    assert_eq!(a.rejections().get(Rejection::Jump), 10);
}

#[test]
fn a_foreign_robot_jumps_by_its_own_speed() {
    for (speed_mps, accepted) in [(20.0, true), (1.0, false)] {
        let mut a = admission_of(Some(speed_mps));
        offer(&mut a, 1, at(9, 9.0));
        // 1.85 m at 20 m/s, 0.33 m at 1 m/s.
        offer(&mut a, 2, at(9, 10.8));
        assert_eq!(a.pose(1, 2 * T).is_some(), accepted);
        let last = if accepted { (Pose::new(10.8, 0.0, 0.0), 2 * T) } else { (Pose::new(9.0, 0.0, 0.0), T) };
        assert_eq!(a.last_good(1), Some(last));
    }
}

#[test]
fn more_writers_than_are_remembered() {
    let mut a = admission();
    for writer in 0..200 {
        a.sample(writer, &header(1, T), &[at(4, 0.0)], EPOCH, T);
    }
    assert_eq!(a.writers.len(), WRITERS);
}

#[test]
fn the_edges_of_what_is_accepted_belong_to_it() {
    // As old as it may be, as far out as it may be, as far ahead as it may be.
    let arena_m = SourceConfig::default().arena_m;
    let mut a = admission_of(Some(1e12));
    a.sample(A, &header(1, T), &[at(9, arena_m)], EPOCH, 3 * T);
    assert_eq!(a.pose(1, 3 * T), Some((Pose::new(arena_m, 0.0, 0.0), T)));
    a.sample(A, &header(2, 2 * T), &[at(9, -arena_m)], EPOCH, 3 * T);
    assert_eq!((a.rejections().total(), a.last_good(1).map(|good| good.1)), (0, Some(2 * T)));
    a.sample(A, &header(2 + GAP_MAX, 3 * T), &[at(9, 0.0)], EPOCH, 3 * T);
    assert_eq!((a.rejections().total(), a.rejections().skipped_samples), (0, GAP_MAX - 1));
    a.sample(A, &header(3 + 2 * GAP_MAX, 3 * T), &[at(9, 0.0)], EPOCH, 3 * T);
    assert_eq!(a.rejections().get(Rejection::Gap), 1);
    // Half the numbers are ahead of the last one, the other half behind.
    a.sample(A, &header(2 + GAP_MAX + u64::MAX / 2, 3 * T), &[], EPOCH, 3 * T);
    assert_eq!((a.rejections().get(Rejection::Gap), a.rejections().get(Rejection::Reordered)), (2, 0));
    a.sample(A, &header(3 + GAP_MAX + u64::MAX / 2, 3 * T), &[], EPOCH, 3 * T);
    assert_eq!((a.rejections().get(Rejection::Gap), a.rejections().get(Rejection::Reordered)), (2, 1));
}

#[test]
fn the_writer_that_was_silent_the_longest_is_forgotten() {
    let mut a = admission();
    for writer in 0..WRITERS as u128 {
        a.sample(writer, &header(7, T), &[], EPOCH, T);
    }
    // All but the sixth are heard again, and one more comes.
    for writer in (0..WRITERS as u128).filter(|writer| *writer != 5) {
        a.sample(writer, &header(8, 2 * T), &[], EPOCH, 2 * T);
    }
    a.sample(1000, &header(1, 3 * T), &[], EPOCH, 3 * T);
    assert_eq!(a.rejections().total(), 0);
    for writer in (0..WRITERS as u128).filter(|writer| *writer != 5) {
        a.sample(writer, &header(8, 3 * T), &[], EPOCH, 3 * T);
    }
    assert_eq!(a.rejections().get(Rejection::Repeated), WRITERS as u64 - 1);
    a.sample(5, &header(7, 3 * T), &[], EPOCH, 3 * T);
    assert_eq!(a.rejections().total(), WRITERS as u64 - 1);
}

#[test]
fn a_robot_that_joins_is_seen_in_its_place_and_one_that_leaves_is_unknown() {
    let new = |id, x| RobotSpec {
        id: RobotId(id),
        radius_m: 0.15,
        start: Pose::new(x, 1.0, 0.5),
        goal_m: Vec2::new(0.0, 5.0),
        foreign_speed_mps: None,
    };
    let mut a = admission().with_places(4);
    assert_eq!((a.last_pose(3), a.last_pose(4)), (Some(Pose::default()), None));
    offer(&mut a, 1, at(3, 3.0));
    for (place, id) in [(3, 1), (2, 6)] {
        a.admit(place, &new(id, f64::from(id)));
        assert_eq!(a.last_pose(place), Some(Pose::new(f64::from(id), 1.0, 0.5)));
        assert_eq!((a.last_good(place), a.pose(place, T)), (None, None));
    }
    // Ids stay in order, whatever the order of the places.
    let records = [at(9, 9.0), at(6, 6.1), at(3, 3.1), at(1, 1.1)];
    a.sample(A, &header(2, 2 * T), &records, EPOCH, 2 * T);
    assert_eq!(a.rejections().total(), 0);
    let seen: Vec<_> = (0..4).map(|place| a.pose(place, 2 * T).map(|(pose, _)| pose.position_m.x)).collect();
    assert_eq!(seen, [Some(3.1), Some(9.0), Some(6.1), Some(1.1)]);

    a.dismiss(0);
    assert_eq!((a.pose(0, 2 * T), a.last_pose(0)), (None, Some(Pose::default())));
    offer(&mut a, 3, at(3, 3.1));
    assert_eq!(a.rejections().get(Rejection::UnknownRobot), 1);
    // The others are seen as before, also the one that takes the place.
    a.admit(0, &new(5, 5.0));
    a.sample(A, &header(4, 4 * T), &[at(1, 1.1), at(5, 5.0), at(6, 6.1), at(9, 9.0)], EPOCH, 4 * T);
    assert_eq!(a.rejections().total(), 1);
    assert!((0..4).all(|place| a.pose(place, 4 * T).is_some()));
    // Someone else in a place begins anew: what was seen there before says nothing.
    a.admit(0, &new(3, 40.0));
    offer(&mut a, 5, at(3, 40.0));
    assert_eq!((a.rejections().total(), a.pose(0, 5 * T).map(|(_, stamp)| stamp)), (1, Some(5 * T)));
}

#[test]
fn noise_and_slip_explain_that_much_more_way() {
    // 5 m/s for 80 ms and 0.25 m: 0.65 m. A tenth of slip adds 0.04 m, noise at both ends 0.06 m.
    let bounds = Disturbance { position_m: 0.03, slip: 0.1, ..Disturbance::NONE };
    for (way_m, accepted) in [(0.66, true), (0.749, true), (0.751, false)] {
        let mut known = admission().tolerating(&bounds);
        let mut joined = admission().with_places(3).tolerating(&bounds);
        let robot = RobotSpec {
            id: RobotId(20),
            radius_m: 0.15,
            start: Pose::default(),
            goal_m: Vec2::zeros(),
            foreign_speed_mps: None,
        };
        joined.admit(2, &robot);
        for (a, id, place) in [(&mut known, 3, 0), (&mut joined, 20, 2)] {
            offer(a, 1, at(id, 3.0));
            offer(a, 2, at(id, 3.0 + way_m));
            assert_eq!(a.pose(place, 2 * T).is_some(), accepted, "{way_m} m, robot {id}");
        }
    }
}

fn facing(id: u32, theta_rad: f64) -> RobotObservation {
    RobotObservation { theta_rad, ..at(id, 3.0) }
}

#[test]
fn a_heading_that_turned_further_than_it_can_is_in_quarantine_like_a_jump() {
    // 1 rad/s for 80 ms and 0.25 rad: 0.33 rad, to either side and over the wrap.
    for (before_rad, turned_rad, believed) in [
        (0.0, 0.329, true),
        (0.0, 0.331, false),
        (0.0, -0.329, true),
        (0.0, -0.331, false),
        (3.1, 0.329, true),
        (3.1, 0.331, false),
        (-3.1, -0.329, true),
        (-3.1, -0.331, false),
        (1.0, PI, false),
        (1.0, 4.0 * PI, true),
    ] {
        let mut a = admission();
        offer(&mut a, 1, facing(3, before_rad));
        offer(&mut a, 2, facing(3, before_rad + turned_rad));
        assert_eq!(a.pose(0, 2 * T).is_some(), believed, "{before_rad} {turned_rad}");
        assert_eq!(a.rejections().get(Rejection::Jump), u64::from(!believed));
    }
    // Believed again when as many agree as after a jump of the position.
    let mut a = admission();
    offer(&mut a, 1, facing(3, 0.0));
    for n in 2..7 {
        offer(&mut a, n, facing(3, 2.0));
        assert_eq!(a.pose(0, n * T), None, "{n}");
    }
    offer(&mut a, 7, facing(3, 2.0));
    assert_eq!(a.pose(0, 7 * T).map(|(pose, _)| pose.theta_rad), Some(2.0));
    assert_eq!((a.rejections().get(Rejection::Jump), a.rejections().total()), (5, 5));
    // Who was not seen for long enough can have any heading: (π − 0.25) rad at 1 rad/s take 36.2 periods.
    for (periods, believed) in [(36, false), (37, true)] {
        let mut a = admission();
        offer(&mut a, 1, facing(3, 0.0));
        offer(&mut a, 1 + periods, facing(3, PI));
        assert_eq!(a.rejections().get(Rejection::Jump), u64::from(!believed));
    }
}

#[test]
fn noise_and_the_error_of_the_turn_rate_explain_that_much_more_turn() {
    // 0.33 rad; noise at both ends adds 0.06 rad, half a radian a second more 0.04 rad.
    let bounds = Disturbance { heading_rad: 0.03, turn_rate_radps: 0.5, ..Disturbance::NONE };
    for (turned_rad, believed) in [(0.34, true), (0.429, true), (0.431, false)] {
        let mut a = admission().tolerating(&bounds);
        offer(&mut a, 1, facing(3, 0.0));
        offer(&mut a, 2, facing(3, turned_rad));
        assert_eq!(a.pose(0, 2 * T).is_some(), believed, "{turned_rad}");
    }
    // A foreign robot may turn as it likes, from one sample to the next at the same time.
    let mut a = admission_of(Some(0.5));
    a.sample(A, &header(1, T), &[facing(9, 0.0)], EPOCH, T);
    a.sample(A, &header(2, T), &[facing(9, PI)], EPOCH, T);
    assert_eq!(a.rejections().total(), 0);
}

#[test]
fn every_reason_has_its_own_name_and_count() {
    let mut a = admission();
    for (n, reason) in Rejection::ALL.into_iter().enumerate() {
        (0..=n).for_each(|_| a.refuse(reason));
    }
    let counts: Vec<u64> = a.rejections().iter().map(|(_, count)| count).collect();
    assert_eq!(counts, (1..=Rejection::ALL.len() as u64).collect::<Vec<_>>());
    assert_eq!(a.rejections().total(), counts.iter().sum::<u64>());
    let json = serde_json::to_value(a.rejections()).unwrap();
    let object = json.as_object().unwrap();
    assert_eq!(object.len(), Rejection::ALL.len() + 3);
    for (reason, count) in a.rejections().iter() {
        assert_eq!(object[reason.name()], count, "{reason:?}");
    }
    assert_eq!((object["skipped_samples"].as_u64(), object["frozen_robots"].as_u64()), (Some(0), Some(0)));
    // What readers of reports look for.
    assert_eq!((Rejection::NotFinite.name(), Rejection::Jump.name()), ("not_finite", "jump"));
}

proptest! {
    /// Any bit pattern in any field: never a panic, never a pose that is not finite and in range.
    #[test]
    fn arbitrary_memory_never_gets_through(words in prop::collection::vec(any::<[u64; 7]>(), 1..40)) {
        let mut a = admission();
        for (n, w) in words.iter().enumerate() {
            let now = (n as u64 + 1) * T;
            let head = ObservationHeader {
                epoch: if w[0] % 2 == 0 { EPOCH } else { w[0] },
                sequence: if w[1] % 2 == 0 { n as u64 } else { w[1] },
                stamp_ns: if w[2] % 2 == 0 { now } else { w[2] },
                ..ObservationHeader::default()
            };
            let record = RobotObservation {
                id: if w[3] % 2 == 0 { 3 } else { u32::try_from(w[3] >> 32).unwrap() },
                holding: 0,
                x_m: f64::from_bits(w[4]),
                y_m: f64::from_bits(w[5]),
                theta_rad: f64::from_bits(w[6]),
            };
            a.sample(A, &head, &[record], EPOCH, now);
            if let Some((pose, stamp)) = a.pose(0, now) {
                prop_assert!(pose.is_finite() && stamp <= now);
                prop_assert!(pose.position_m.amax() <= 1e4);
                prop_assert!(pose.theta_rad.abs() <= std::f64::consts::PI);
            }
        }
    }
}
