//! What a robot tells the others, and what they see of it.

#![expect(clippy::inline_always, reason = "most callers need a part only of what it tells")]

use super::Law;
use crate::geometry::{Vec2, bearing};
use crate::guidance::{Intent, Neighbour};
use crate::wire::{RobotIntent, RobotState};

/// An intent as it is told to the others.
pub(super) fn told(intent: &Intent, waypoint_m: Vec2) -> RobotIntent {
    RobotIntent {
        heading_rad: intent.heading_rad,
        speed_mps: intent.speed_mps,
        blocked_s: intent.blocked_s,
        target_x_m: intent.target_m.x,
        target_y_m: intent.target_m.y,
        waypoint_x_m: waypoint_m.x,
        waypoint_y_m: waypoint_m.y,
        rank: intent.rank,
        valid: 1,
    }
}

/// A robot as the guidance of the others sees it. Before its first intent it is taken to drive to its goal, and
/// a foreign one, of which nothing is known, to stand.
#[inline(always)]
pub(super) fn shows(law: &Law, robot: &RobotState, foreign: bool) -> Neighbour {
    let (position_m, goal_m) = (robot.position_m(), robot.goal_m());
    // Few have: a root is taken of those only that are about there.
    let off_m2 = (position_m - goal_m).norm_squared();
    let near_m2 = law.tolerance_m * law.tolerance_m * (1.0 + 1e-9);
    let arrived = foreign || off_m2 <= near_m2 && off_m2.sqrt() <= law.tolerance_m;
    let (intent, target_m) = if robot.intent.valid == 1 {
        let i = &robot.intent;
        let intent = Intent {
            heading_rad: i.heading_rad,
            speed_mps: i.speed_mps,
            blocked_s: i.blocked_s,
            target_m: Vec2::new(i.target_x_m, i.target_y_m),
            rank: i.rank,
        };
        (intent, Vec2::new(i.waypoint_x_m, i.waypoint_y_m))
    } else {
        let intent = Intent {
            heading_rad: bearing(goal_m - position_m),
            speed_mps: law.limits.v_max_mps,
            blocked_s: 0.0,
            target_m: goal_m,
            rank: robot.id,
        };
        (intent, goal_m)
    };
    Neighbour {
        position_m,
        target_m,
        radius_m: robot.radius_m,
        id: robot.id,
        arrived,
        intent,
        heading_rad: robot.theta_rad,
    }
}
