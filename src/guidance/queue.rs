//! Queueing at an opening: who is nearer to the same waypoint goes first, the others keep a gap.
//!
//! Without it everybody pushes to the opening and nobody has room left to turn.

use super::Params;
use super::shown::Shown;
use super::types::Ego;
use crate::geometry::unit;

/// Two waypoints nearer than this are the same opening.
const SAME_PLACE_M: f64 = 0.6;
/// Distances to it that differ by less than this are equal; the id decides.
const EQUAL_M: f64 = 0.05;
/// Those farther ahead, or more to the side, do not matter.
const AHEAD_M: f64 = 1.5;
const CLOSING_MIN: f64 = 0.3;

/// Speed that keeps the gap to those ahead, or `None` when nobody is.
pub(super) fn speed_cap(ego: &Ego, neighbours: &Shown, params: &Params) -> Option<f64> {
    // The target is the goal: no opening ahead.
    if ego.beyond_m <= 0.0 {
        return None;
    }
    let h = unit(ego.heading_rad);
    let mine = (ego.target_m - ego.position_m).norm();
    let mut cap: Option<f64> = None;
    for n in neighbours.iter() {
        let (who, theirs) = (neighbours.who(n.lane), neighbours.towards_target(n.lane).norm());
        if who.arrived || (who.target_m - ego.target_m).norm() > SAME_PLACE_M {
            continue;
        }
        let ahead = theirs + EQUAL_M < mine || (theirs <= mine + EQUAL_M && who.id < ego.id);
        let seen = n.bearing();
        let closing = -h.dot(&seen.normal);
        if !ahead || seen.gap_m > AHEAD_M || closing < CLOSING_MIN {
            continue;
        }
        let v = params.row_rate * (seen.gap_m - params.queue_gap_m).max(0.0) / closing;
        cap = Some(cap.map_or(v, |c| c.min(v)));
    }
    cap
}
