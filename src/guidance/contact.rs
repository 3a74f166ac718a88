//! Contact: a heading into something that is touched is no motion, so it is made tangential and slightly outward.

use super::types::{Drive, Ego, ObstacleView, Seen};
use crate::geometry::{Vec2, bearing};

/// Outward part of the direction at contact.
const LEAN: f64 = 0.08;
/// Clearance that allows heading straight in.
const CREEP_M: f64 = 0.05;

/// Heading, and its unit vector, that the hard rows of these neighbours and obstacles let pass at creeping speed.
pub(super) fn slide(
    ego: &Ego,
    drive: &Drive,
    neighbours: impl Iterator<Item = Seen>,
    obstacles: &[ObstacleView],
) -> (f64, Vec2) {
    let mut direction = drive.direction;
    let mut changed = false;
    let mut touch = |normal: Vec2, gap: f64| {
        let floor = LEAN - gap.max(0.0) / CREEP_M;
        if floor < -1.0 || direction.dot(&normal) >= floor {
            return;
        }
        // Clockwise around what is touched unless the heading clearly says otherwise.
        let along = Vec2::new(normal.y, -normal.x);
        let side = if direction.dot(&along) >= -1e-6 { 1.0 } else { -1.0 };
        direction = along * (side * (1.0 - floor * floor).sqrt()) + normal * floor;
        changed = true;
    };
    for n in neighbours {
        let seen = n.bearing();
        touch(seen.normal, seen.gap_m);
    }
    for o in obstacles {
        let (normal, gap) = o.clearance(ego.position_m);
        touch(normal, gap);
    }
    (if changed { bearing(direction) } else { drive.heading_rad }, direction)
}
