//! Giving way: the last resort against a deadlock of a few robots.
//!
//! A robot that stands in front of a blocked one of higher rank (lower number) leaves its way: it goes to a free spot
//! beside the other's path, and takes over that rank while it does, so that those behind it make room as well.
//! Ranks are ids, so that a finite group always has one robot nobody asks to move. Bounded: 16 directions x 3 lengths.

use super::Params;
use super::shown::Shown;
use super::types::{Drive, Ego, Limits, Memory, Neighbour, ObstacleView, Seen, Way};
use crate::geometry::{Vec2, bearing, closest_point_on_segment, unit, wrap};

const DIRECTIONS: u32 = 16;
const LENGTHS_M: [f64; 3] = [0.5, 1.0, 1.8];
/// The other is gone when this far beyond the required distance.
const GONE_M: f64 = 2.0;
/// The spot is reached.
const REACHED_M: f64 = 0.05;
/// Share of the full speed used.
const SPEED_SHARE: f64 = 0.4;
/// Nearer than this is contact.
const CONTACT_M: f64 = 0.03;
/// How much of the other's path must become free.
const PATH_M: f64 = 2.5;

/// Starts, continues or ends giving way; the spot to go to while it lasts.
pub(super) fn spot(
    ego: &Ego,
    neighbours: &Shown,
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> Option<Vec2> {
    let way = &mut memory.way;
    if way.left_s > 0.0 {
        way.left_s -= limits.period_s;
        let needed = neighbours.iter().any(|n| {
            n.bearing().gap_m < GONE_M
                && !neighbours.is_parked(n.lane)
                && neighbours.who(n.lane).intent.rank == way.rank
        });
        if way.left_s > 0.0 && needed {
            return Some(way.spot_m);
        }
        *way = Way { left_s: 0.0, rest_s: params.give_way_rest_s, rank: ego.id, ..*way };
        return None;
    }
    way.rank = ego.id;
    way.rest_s = (way.rest_s - limits.period_s).max(0.0);
    if way.rest_s > 0.0 {
        return None;
    }
    let wait = if ego.arrived { params.parked_wait_s } else { params.give_way_after_s };
    let mut chosen: Option<(Neighbour, Seen)> = None;
    for lane in neighbours.waiting(wait) {
        let (n, seen) = (neighbours.who(lane), neighbours.at(lane));
        let rank = n.intent.rank;
        // A parked robot makes way for everybody, the others for higher ranks.
        if rank >= ego.id && !ego.arrived {
            continue;
        }
        let from = seen.bearing();
        if from.gap_m > params.give_way_reach_m || from.normal.dot(&ahead(&n)) < 0.0 {
            continue;
        }
        if chosen.is_none_or(|(c, _)| rank < c.intent.rank) {
            chosen = Some((n, seen));
        }
    }
    let (other, seen) = chosen?;
    let spot_m = best_spot(ego, (&other, seen.required_m), neighbours, obstacles, limits)?;
    *way = Way { left_s: params.give_way_s, rest_s: 0.0, rank: other.intent.rank, spot_m };
    Some(spot_m)
}

/// Straight to the spot, slowly, once it is ahead.
pub(super) fn drive(ego: &Ego, spot_m: Vec2, limits: &Limits) -> Drive {
    let to = spot_m - ego.position_m;
    let left = to.norm();
    let heading_rad = if left > REACHED_M { bearing(to) } else { ego.heading_rad };
    let e = wrap(heading_rad - ego.heading_rad).abs();
    let v = (left / limits.period_s).min(SPEED_SHARE * limits.v_max_mps) * (1.0 - 2.0 * e).max(0.0);
    Drive { heading_rad, direction: unit(heading_rad), speed_cap_mps: v, intent_speed_mps: v }
}

/// Where the other means to go: its spot while it gives way itself, otherwise its target.
fn ahead(n: &Neighbour) -> Vec2 {
    let to = n.target_m - n.position_m;
    if n.intent.rank == n.id { to.try_normalize(1e-9).unwrap_or(to) } else { unit(n.intent.heading_rad) }
}

fn best_spot(
    ego: &Ego,
    (other, required_m): (&Neighbour, f64),
    neighbours: &Shown,
    obstacles: &[ObstacleView],
    limits: &Limits,
) -> Option<Vec2> {
    let path = ahead(other) * PATH_M;
    let mut best = None;
    let mut best_score = f64::NEG_INFINITY;
    for k in 0..DIRECTIONS {
        let angle = f64::from(k) * core::f64::consts::TAU / f64::from(DIRECTIONS);
        let direction = unit(angle);
        if !leaves_contacts(ego, direction, neighbours, obstacles) {
            continue;
        }
        for length in LENGTHS_M {
            let end = ego.position_m + direction * length;
            let mut room = f64::INFINITY;
            for part in [0.2, 0.5, 1.0] {
                let p = ego.position_m + direction * (length * part);
                for o in obstacles {
                    room = room.min(o.clearance(p).1);
                }
                for n in neighbours.iter() {
                    room = room.min((neighbours.who(n.lane).position_m - p).norm() - n.required_m);
                }
            }
            if room < -0.005 {
                continue;
            }
            let from_m = other.position_m;
            let aside = (closest_point_on_segment(end, from_m, from_m + path) - end).norm() - required_m;
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

/// Whether this direction moves away from everything the robot touches.
fn leaves_contacts(ego: &Ego, direction: Vec2, neighbours: &Shown, obstacles: &[ObstacleView]) -> bool {
    let free = |normal: Vec2, gap: f64| gap > CONTACT_M || direction.dot(&normal) > 0.02;
    obstacles.iter().all(|o| {
        let (normal, gap) = o.clearance(ego.position_m);
        free(normal, gap)
    }) && neighbours.iter().all(|n| {
        let seen = n.bearing();
        free(seen.normal, seen.gap_m)
    })
}
