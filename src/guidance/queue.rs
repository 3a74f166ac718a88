//! Queueing at a narrow place: who is nearer to the same waypoint goes first, the others keep a gap.
//!
//! Without it everybody pushes to the opening and nobody has room left to turn.

use super::params::Params;
use super::types::*;

/// Two waypoints nearer than this are the same opening.
const SAME_PLACE_M: f64 = 0.6;

/// Speed cap that keeps the gap to those ahead, or `None` when nobody is.
pub fn speed_cap(ego: &Ego, neighbours: &[Neighbour], params: &Params) -> Option<f64> {
    // The target is the goal: no opening ahead.
    if ego.beyond_m <= 0.0 {
        return None;
    }
    let h = unit(ego.heading_rad);
    let mine = (ego.target_m - ego.position_m).norm();
    let mut cap: Option<f64> = None;
    for n in neighbours.iter().take(NEIGHBOURS_MAX) {
        if n.arrived || (n.target_m - ego.target_m).norm() > SAME_PLACE_M {
            continue;
        }
        let theirs = (n.target_m - n.position_m).norm();
        let ahead = theirs + 0.05 < mine || (theirs <= mine + 0.05 && n.id < ego.id);
        if !ahead {
            continue;
        }
        let offset = ego.position_m - n.position_m;
        let d = offset.norm().max(1e-6);
        let gap = d - n.required_distance_m;
        let closing = -h.dot(&offset) / d;
        if gap > 1.5 || closing < 0.3 {
            continue;
        }
        let v = params.row_rate * (gap - params.queue_gap_m).max(0.0) / closing;
        cap = Some(cap.map_or(v, |c| c.min(v)));
    }
    cap
}
