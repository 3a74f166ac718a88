//! Giving way: the last resort against a deadlock of a few robots.
//!
//! A robot that stands in front of a blocked one of higher rank (lower number) leaves its way: it goes to a free spot
//! beside the other's path, and takes over that rank while it does, so that those behind it make room as well.
//! Ranks are ids, so that a finite group always has one robot nobody asks to move. Bounded: 16 directions x 3 lengths.

use super::params::Params;
use super::types::*;
use nalgebra::Vector2;

const DIRECTIONS: u32 = 16;
const LENGTHS_M: [f64; 3] = [0.5, 1.0, 1.8];
/// How much of the other's path must become free.
const PATH_M: f64 = 2.5;

/// Starts, continues or ends giving way; the spot to go to while it lasts.
pub fn spot(
    ego: &Ego,
    neighbours: &[Neighbour],
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> Option<Vector2<f64>> {
    if memory.give_way_s > 0.0 {
        memory.give_way_s -= limits.period_s;
        // Over as soon as the other is gone.
        let gone = !neighbours.iter().take(NEIGHBOURS_MAX).any(|n| {
            n.intent.rank == memory.rank
                && !n.arrived
                && (n.position_m - ego.position_m).norm() < n.required_distance_m + 2.0
        });
        if memory.give_way_s > 0.0 && !gone {
            return Some(memory.spot_m);
        }
        memory.give_way_s = 0.0;
        memory.rank = ego.id;
        memory.rest_s = params.give_way_rest_s;
        return None;
    }
    memory.rank = ego.id;
    memory.rest_s = (memory.rest_s - limits.period_s).max(0.0);
    if memory.rest_s > 0.0 {
        return None;
    }
    let mut chosen: Option<&Neighbour> = None;
    for n in neighbours.iter().take(NEIGHBOURS_MAX) {
        let wait = if ego.arrived { params.parked_wait_s } else { params.give_way_after_s };
        if n.arrived || n.intent.blocked_s < wait || (n.intent.rank >= ego.id && !ego.arrived) {
            continue;
        }
        let offset = ego.position_m - n.position_m;
        let d = offset.norm();
        if d > n.required_distance_m + params.give_way_reach_m {
            continue;
        }
        if offset.dot(&way(n)) < 0.0 {
            continue;
        }
        if chosen.is_none_or(|c| n.intent.rank < c.intent.rank) {
            chosen = Some(n);
        }
    }
    let other = chosen?;
    let spot = best_spot(ego, other, neighbours, obstacles, limits)?;
    memory.spot_m = spot;
    memory.give_way_s = params.give_way_s;
    memory.rank = other.intent.rank;
    Some(spot)
}

/// Where the other means to go: its spot while it gives way itself, otherwise its target.
fn way(n: &Neighbour) -> Vector2<f64> {
    let to = n.target_m - n.position_m;
    if n.intent.rank != n.id { unit(n.intent.heading_rad) } else { to.try_normalize(1e-9).unwrap_or(to) }
}

fn best_spot(
    ego: &Ego,
    other: &Neighbour,
    neighbours: &[Neighbour],
    obstacles: &[ObstacleView],
    limits: &Limits,
) -> Option<Vector2<f64>> {
    let path = way(other) * PATH_M;
    let mut best = None;
    let mut best_score = f64::NEG_INFINITY;
    for k in 0..DIRECTIONS {
        let angle = f64::from(k) * core::f64::consts::TAU / f64::from(DIRECTIONS);
        let direction = unit(angle);
        for length in LENGTHS_M {
            let end = ego.position_m + direction * length;
            let mut room = f64::INFINITY;
            for part in [0.2, 0.5, 1.0] {
                let p = ego.position_m + direction * (length * part);
                for o in obstacles.iter().take(OBSTACLES_MAX) {
                    room = room.min(o.clearance(p).1);
                }
                for n in neighbours.iter().take(NEIGHBOURS_MAX) {
                    room = room.min((n.position_m - p).norm() - n.required_distance_m);
                }
            }
            if room < -0.005 {
                continue;
            }
            let aside = (nearest_on_segment(other.position_m, other.position_m + path, end) - end).norm()
                - other.required_distance_m;
            let turn = wrap(angle - ego.heading_rad).abs() / limits.omega_max_radps;
            let score = 3.0 * aside.min(0.4) + 0.5 * room.min(0.3) - 0.15 * turn - 0.1 * length;
            if score > best_score {
                best_score = score;
                best = Some(end);
            }
        }
    }
    best
}
