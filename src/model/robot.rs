use crate::geometry::{Pose, Vec2};

/// The name of a robot, unique in its fleet; a fleet's ids may have gaps.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct RobotId(pub u32);

impl std::fmt::Display for RobotId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        self.0.fmt(f)
    }
}

/// What is known of a robot before it moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RobotSpec {
    /// Its name.
    pub id: RobotId,
    /// Radius of the disc that covers its body, m.
    pub radius_m: f64,
    /// Pose at the start.
    pub start: Pose,
    /// Where it is to arrive, m; for a foreign robot where it stands at the start.
    pub goal_m: Vec2,
    /// `None`: one of ours. Otherwise it is only observed, takes no commands, and moves at most this
    /// fast, m/s.
    pub foreign_speed_mps: Option<f64>,
}
