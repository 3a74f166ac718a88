use super::super::{Scenario, heading_toward};
use crate::geometry::{Pose, Vec2};
use crate::model::{Limits, Obstacle, RobotId, RobotSpec};

/// Radius of a robot of the paper, m.
pub(super) const RADIUS_M: f64 = 0.15;

/// A scenario under construction, with the paper's limits. Coordinates are (x, y) in m.
pub(super) struct Fleet(Scenario);

impl Fleet {
    pub(super) fn new(name: &str) -> Self {
        Self(Scenario {
            name: name.to_owned(),
            tolerance_m: Scenario::DEFAULT_TOLERANCE_M,
            duration_s: Scenario::DEFAULT_DURATION_S,
            limits: Limits::default(),
            robots: Vec::new(),
            obstacles: Vec::new(),
        })
    }

    /// Adds a robot with the next id, facing its goal.
    pub(super) fn robot(&mut self, start: (f64, f64), goal: (f64, f64)) {
        let (start_m, goal_m) = (Vec2::new(start.0, start.1), Vec2::new(goal.0, goal.1));
        let id = self.0.robots.last().map_or(0, |r| r.id.0 + 1);
        self.0.robots.push(RobotSpec {
            id: RobotId(id),
            radius_m: RADIUS_M,
            start: Pose { position_m: start_m, theta_rad: heading_toward(start_m, goal_m) },
            goal_m,
            foreign_speed_mps: None,
        });
    }

    /// Sets the time after which the run is given up, s.
    pub(super) fn give_up_after(&mut self, duration_s: f64) {
        self.0.duration_s = duration_s;
    }

    /// Sets the largest speed, m/s.
    pub(super) fn at_most(&mut self, v_max_mps: f64) {
        self.0.limits.v_max_mps = v_max_mps;
    }

    /// Replaces every robot's heading by what `theta_rad` gives, in order of id.
    pub(super) fn face(&mut self, mut theta_rad: impl FnMut() -> f64) {
        for robot in &mut self.0.robots {
            robot.start = Pose::new(robot.start.position_m.x, robot.start.position_m.y, theta_rad());
        }
    }

    /// Adds a wall.
    pub(super) fn wall(&mut self, from: (f64, f64), to: (f64, f64)) {
        let (from_m, to_m) = (Vec2::new(from.0, from.1), Vec2::new(to.0, to.1));
        self.0.obstacles.push(Obstacle::Segment { from_m, to_m });
    }

    /// Adds a round pillar.
    pub(super) fn pillar(&mut self, centre: (f64, f64), radius_m: f64) {
        self.0.obstacles.push(Obstacle::Circle { centre_m: Vec2::new(centre.0, centre.1), radius_m });
    }

    pub(super) fn finish(self) -> Scenario {
        self.0
    }
}
