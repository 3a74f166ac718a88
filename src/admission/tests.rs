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
                reserved: 0,
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
