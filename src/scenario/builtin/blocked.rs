//! Families with something in the way: parked robots, a wall with a door, pillars.

use super::fleet::Fleet;
use crate::scenario::Scenario;

/// Between the centres of a wall of parked robots, m: too narrow to pass.
pub(super) const PARKED_CLOSED_M: f64 = 0.7;
/// The same with room for one robot between two.
pub(super) const PARKED_OPEN_M: f64 = 1.5;

/// A line of `n` parked robots, and three robots from each side that want to cross it.
pub(super) fn parked_wall(name: &str, n: u32, spacing_m: f64) -> Scenario {
    let mut fleet = Fleet::new(name);
    for y in [-1.0, 0.0, 1.0] {
        fleet.robot((-4.0, y), (4.0, y));
        fleet.robot((4.0, y + 0.5), (-4.0, y + 0.5));
    }
    for k in 0..n {
        let y = (f64::from(k) - f64::from(n - 1) / 2.0) * spacing_m;
        fleet.robot((0.0, y), (0.0, y));
    }
    fleet.finish()
}

/// Width of a door used one way, m.
pub(super) const DOOR_ONE_WAY_M: f64 = 1.2;
/// Width of a door used both ways, m.
pub(super) const DOOR_BOTH_WAYS_M: f64 = 1.6;
/// The wall reaches this far from the door's middle, m.
const WALL_HALF_M: f64 = 6.0;

/// `n` robots in ranks of four and a wall along x = 0 with a gap at the origin.
pub(super) fn doorway(name: &str, n: u32, both_ways: bool, gap_m: f64) -> Scenario {
    let mut fleet = Fleet::new(name);
    for k in 0..n {
        let (column, y) = (f64::from(k / 4), f64::from(k % 4) - 1.5);
        let x = 4.0 + column;
        // Ranks are mirrored: who enters first also goes deepest.
        let far = 4.0 + f64::from((n - 1) / 4) - column;
        if both_ways && k % 2 == 1 {
            fleet.robot((x, y), (-far, y));
        } else {
            fleet.robot((-x, y), (far, y));
        }
    }
    // One at a time through the opening takes its time.
    fleet.give_up_after(Scenario::DEFAULT_DURATION_S + 5.0 * f64::from(n));
    fleet.wall((0.0, 0.5 * gap_m), (0.0, WALL_HALF_M));
    fleet.wall((0.0, -WALL_HALF_M), (0.0, -0.5 * gap_m));
    fleet.finish()
}

/// Distance between pillars, centre to centre, m.
const PILLAR_PITCH_M: f64 = 2.0;
/// Most robots: above it the ranks of neighbouring sides meet in the corners.
pub(super) const PILLARS_MAX: u32 = 36;
/// Radius of a pillar, m.
const PILLAR_RADIUS_M: f64 = 0.3;

/// `n` robots from all four sides across a 4 × 4 grid of pillars.
pub(super) fn pillars(name: &str, n: u32) -> Scenario {
    let mut fleet = Fleet::new(name);
    let rank = n.div_ceil(4);
    for k in 0..n {
        let offset = (f64::from(k / 4) - f64::from(rank - 1) / 2.0) * 1.2;
        match k % 4 {
            0 => fleet.robot((-6.0, offset), (6.0, offset)),
            1 => fleet.robot((6.0, offset + 0.6), (-6.0, offset + 0.6)),
            2 => fleet.robot((offset, -6.0), (offset, 6.0)),
            _ => fleet.robot((offset + 0.6, 6.0), (offset + 0.6, -6.0)),
        }
    }
    for column in 0..4 {
        for row in 0..4 {
            let at = |k: u8| (f64::from(k) - 1.5) * PILLAR_PITCH_M;
            fleet.pillar((at(column), at(row)), PILLAR_RADIUS_M);
        }
    }
    fleet.finish()
}
