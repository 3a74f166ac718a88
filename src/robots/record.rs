use serde::{Deserialize, Serialize};

use crate::geometry::{Arc, Pose, TimedArc};
use crate::model::RobotId;
use crate::scenario::Scenario;

/// One line of a trajectory: the arc that a robot drove between two instants.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct MotionRecord {
    /// Id of the robot.
    pub id: u32,
    /// From when, `CLOCK_MONOTONIC` ns.
    pub from_ns: u64,
    /// Until when, `CLOCK_MONOTONIC` ns.
    pub to_ns: u64,
    /// Position at the start, m.
    pub x_m: f64,
    /// Position at the start, m.
    pub y_m: f64,
    /// Direction of the motion at the start, rad: the heading, unless the wheels slip.
    pub theta_rad: f64,
    /// Speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s.
    pub omega_radps: f64,
}

impl MotionRecord {
    /// The record of robot `id`'s motion.
    pub fn new(id: RobotId, motion: &TimedArc) -> Self {
        let TimedArc { from_ns, to_ns, arc: Arc { start, v_mps, omega_radps } } = *motion;
        let Pose { position_m, theta_rad } = start;
        Self { id: id.0, from_ns, to_ns, x_m: position_m.x, y_m: position_m.y, theta_rad, v_mps, omega_radps }
    }

    /// The motion.
    pub fn motion(&self) -> TimedArc {
        let start = Pose::new(self.x_m, self.y_m, self.theta_rad);
        let arc = Arc { start, v_mps: self.v_mps, omega_radps: self.omega_radps };
        TimedArc { from_ns: self.from_ns, to_ns: self.to_ns, arc }
    }
}

/// The motions of each robot of `scenario` in the order of time, from the records of any number of
/// processes: what [`Clearances::add`](crate::figures::Clearances::add) takes.
pub fn motions(scenario: &Scenario, records: &[MotionRecord]) -> Vec<Vec<TimedArc>> {
    let of = |id: u32| {
        let mut own: Vec<_> = records.iter().filter(|r| r.id == id).map(MotionRecord::motion).collect();
        own.sort_by_key(|motion| motion.from_ns);
        own
    };
    scenario.robots.iter().map(|robot| of(robot.id.0)).collect()
}
