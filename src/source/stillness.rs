//! The alarm for poses that stay although their robots are told to drive.

use crate::geometry::Pose;

/// Samples in a row with the same pose, of a robot that is told to drive, before it counts as frozen.
const FROZEN_AFTER: u32 = 10;
/// What a robot must have been told to move between two samples for that, m.
const FROZEN_MOTION_M: f64 = 1e-3;

/// One robot's last sample, and how often it came again while the robot was told to drive.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Stillness {
    last: Option<(Pose, u64)>,
    again: u32,
}

impl Stillness {
    /// Takes the newest sample and where the robot should be by then; whether it has just frozen.
    pub(super) fn add(
        &mut self,
        pose: Pose,
        stamp_ns: u64,
        expected: impl FnOnce(Pose, u64) -> Pose,
    ) -> bool {
        let Some((last, last_ns)) = self.last.replace((pose, stamp_ns)) else { return false };
        if stamp_ns == last_ns {
            return false;
        }
        let told_m = (expected(last, last_ns).position_m - last.position_m).norm();
        if pose != last {
            self.again = 0;
        } else if told_m >= FROZEN_MOTION_M {
            self.again = self.again.saturating_add(1);
        }
        pose == last && told_m >= FROZEN_MOTION_M && self.again == FROZEN_AFTER
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_that_stays_although_the_robot_is_told_to_drive_is_an_alarm() {
        let ahead = |from: Pose, _| Pose::new(from.position_m.x + 0.1, 0.0, 0.0);
        let still = |from: Pose, _| from;
        let pose = Pose::new(1.0, 0.0, 0.0);
        let mut s = Stillness::default();
        // Nobody told it to move, or nothing new was said.
        assert!((0..50).all(|n| !s.add(pose, n, still)));
        assert!((0..50).all(|_| !s.add(pose, 49, ahead)));
        // One alarm, in the tenth sample.
        let alarms: Vec<u64> = (50..80).filter(|n| s.add(pose, *n, ahead)).collect();
        assert_eq!(alarms, [59]);
        // It moves again, and may freeze again.
        assert!(!s.add(Pose::new(1.1, 0.0, 0.0), 80, ahead));
        assert_eq!((81..100).filter(|n| s.add(pose, *n, ahead)).count(), 1);
    }
}
