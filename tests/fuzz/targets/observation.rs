use super::bytes::Bytes;
use clearway::admission::{Admission, Rejection};
use clearway::config::SourceConfig;
use clearway::geometry::{Pose, wrap};
use clearway::scenario::Scenario;
use clearway::wire::{ObservationHeader, RobotObservation};
use std::sync::LazyLock;

const EPOCH: u64 = 77;
const PERIOD_NS: u64 = 80_000_000;

static SCENARIO: LazyLock<Scenario> =
    LazyLock::new(|| Scenario::builtin("swap8").expect("a built-in scenario is sound"));

/// The memory of one sample at `now_ns`. The first byte says what is as it should be.
fn sample(bytes: &mut Bytes, now_ns: u64, sequence: u64) -> (u128, ObservationHeader, Vec<RobotObservation>) {
    let shape = bytes.u8();
    let writer = u128::from(shape & 1);
    let header = ObservationHeader {
        epoch: if shape & 2 == 0 { EPOCH } else { bytes.u64() },
        sequence: if shape & 4 == 0 { sequence } else { bytes.u64() },
        stamp_ns: if shape & 8 == 0 { now_ns } else { bytes.u64() },
        ..ObservationHeader::default()
    };
    let count = usize::from(bytes.u8()) % 10;
    let records = (0..count).map(|_| {
        let id = if shape & 16 == 0 { u32::from(bytes.u8() % 10) } else { bytes.u32() };
        let holding = if shape & 64 == 0 { 0 } else { bytes.u32() };
        let start = SCENARIO.robots.iter().find(|robot| robot.id.0 == id).map(|robot| robot.start);
        match start.filter(|_| shape & 32 == 0) {
            // Near where it stands.
            Some(start) => RobotObservation {
                id,
                holding,
                x_m: start.position_m.x + f64::from(bytes.u8()) / 256.0,
                y_m: start.position_m.y,
                theta_rad: f64::from(bytes.u8()),
            },
            None => {
                RobotObservation { id, holding, x_m: bytes.f64(), y_m: bytes.f64(), theta_rad: bytes.f64() }
            }
        }
    });
    (writer, header, records.collect())
}

/// Whatever stands in the memory of writers: a pose that is believed is finite, inside the arena, no older
/// than it may be and no further from the one before than the robot can have driven and turned; what is
/// refused is counted once.
pub fn observation(data: &[u8]) {
    let config = SourceConfig::default();
    let max_age_ns = config.max_age_or_default_ns(PERIOD_NS);
    let mut admission = Admission::new(&SCENARIO, &config, PERIOD_NS);
    let mut bytes = Bytes::new(data);
    let mut believed: Vec<Option<(Pose, u64)>> = vec![None; SCENARIO.robots.len()];
    let (mut n, mut offered) = (0, 0);
    while !bytes.is_empty() && n < 64 {
        n += 1;
        let now_ns = n * PERIOD_NS;
        let (writer, header, records) = sample(&mut bytes, now_ns, n);
        offered += 1.max(records.len() as u64);
        admission.sample(writer, &header, &records, EPOCH, now_ns);
        let sum: u64 = admission.rejections().iter().map(|(_, count)| count).sum();
        assert_eq!(sum, admission.rejections().total());
        assert!(sum <= offered, "{sum} refused of {offered}");
        for (index, last) in believed.iter_mut().enumerate() {
            let good = admission.last_good(index);
            assert!(good.is_some() || admission.holding(index) == 0, "held by who was never believed");
            // Who follows no run holds no command of ours.
            assert!(header.epoch != 0 || good == *last || admission.holding(index) <= 1, "{header:?}");
            assert_eq!(admission.last_pose(index), Some(good.map_or(SCENARIO.robots[index].start, |g| g.0)));
            if let Some((pose, stamp_ns)) = admission.pose(index, now_ns) {
                assert_eq!(good, Some((pose, stamp_ns)));
                assert!(pose.is_finite() && pose.position_m.amax() <= config.arena_m, "{pose:?}");
                assert!(pose.theta_rad.abs() <= std::f64::consts::PI, "{pose:?}");
                assert!(stamp_ns <= now_ns && now_ns - stamp_ns <= max_age_ns);
            }
            if let (Some((was, at_ns)), Some((is, stamp_ns))) = (*last, good) {
                assert!(stamp_ns >= at_ns, "back in time");
                let way_m =
                    SCENARIO.limits.speed_mps() * (stamp_ns - at_ns) as f64 * 1e-9 + config.jump_margin_m;
                // A robot that jumped, or stood twice in a sample, is believed again, wherever it is, once five
                // samples have followed: the last of them is believed, and the others count as jumps.
                let turn_rad = SCENARIO.limits.turn_rate_radps() * (stamp_ns - at_ns) as f64 * 1e-9
                    + config.turn_margin_rad;
                let jumped = (is.position_m - was.position_m).norm() > way_m
                    || wrap(is.theta_rad - was.theta_rad).abs() > turn_rad;
                let doubted = [Rejection::Jump, Rejection::DuplicateRobot];
                let doubts: u64 = doubted.iter().map(|reason| admission.rejections().get(*reason)).sum();
                assert!(!jumped || doubts >= 5, "{was:?} {is:?}");
            }
            *last = good;
        }
    }
}
