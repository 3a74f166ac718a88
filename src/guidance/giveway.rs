//! Giving way: the last resort against a deadlock of a few robots.
//!
//! A robot that stands in front of a blocked one of higher rank (lower number) leaves its way: it goes to a free spot
//! beside the other's path, and takes over that rank while it does, so that those behind it make room as well.
//! Ranks are ids, so that a finite group always has one robot nobody asks to move. Bounded: 16 directions x 3 lengths.

use super::Params;
use super::shown::{Lanes, Shown};
use super::types::{Drive, Ego, Limits, Memory, NEIGHBOURS_MAX, Neighbour, ObstacleView, Seen, Way};
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
/// More room than this is no better, and with less than this the spot, or the way to it, is taken.
const ROOM_M: f64 = 0.3;
const OVERLAP_M: f64 = -0.005;
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
        let needed = neighbours.within(GONE_M).any(|lane| {
            neighbours.at(lane).bearing().gap_m < GONE_M
                && !neighbours.is_parked(lane)
                && neighbours.who(lane).intent.rank == way.rank
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
    let bodies = Bodies::of(neighbours);
    let mut best = None;
    let mut best_score = f64::NEG_INFINITY;
    for k in 0..DIRECTIONS {
        let angle = f64::from(k) * core::f64::consts::TAU / f64::from(DIRECTIONS);
        let direction = unit(angle);
        if !leaves_contacts(ego, direction, neighbours, obstacles) {
            continue;
        }
        let turn = wrap(angle - ego.heading_rad).abs() / limits.omega_max_radps;
        for length in LENGTHS_M {
            let end = ego.position_m + direction * length;
            let from_m = other.position_m;
            let aside = (closest_point_on_segment(end, from_m, from_m + path) - end).norm() - required_m;
            let score =
                |room: f64| 3.0 * aside.min(0.4) + 0.5 * room.min(ROOM_M) - 0.15 * turn - 0.1 * length;
            // Even with all the room that counts it is not the best one.
            if score(ROOM_M) <= best_score {
                continue;
            }
            let mut room = f64::INFINITY;
            for part in [1.0, 0.5, 0.2] {
                let p = ego.position_m + direction * (length * part);
                for o in obstacles {
                    room = room.min(o.clearance(p).1);
                }
                room = bodies.room(p, room);
                if room < OVERLAP_M {
                    break;
                }
            }
            if room < OVERLAP_M {
                continue;
            }
            let score = score(room);
            if score > best_score {
                best_score = score;
                best = Some(end);
            }
        }
    }
    best
}

/// Where the neighbours are, side by side; infinitely far where there is none.
struct Bodies {
    x_m: Lanes,
    y_m: Lanes,
    /// Distances to keep, m.
    required: Lanes,
}

impl Bodies {
    fn of(neighbours: &Shown) -> Self {
        let nowhere = [f64::INFINITY; NEIGHBOURS_MAX];
        let mut bodies = Self { x_m: nowhere, y_m: nowhere, required: [0.0; NEIGHBOURS_MAX] };
        for n in neighbours.iter() {
            let position_m = neighbours.who(n.lane).position_m;
            (bodies.x_m[n.lane], bodies.y_m[n.lane]) = (position_m.x, position_m.y);
            bodies.required[n.lane] = n.required_m;
        }
        bodies
    }

    /// The least of `room` and what is free between `p` and each of them.
    fn room(&self, p: Vec2, room: f64) -> f64 {
        let mut rooms = [room; NEIGHBOURS_MAX];
        for (lane, least) in rooms.iter_mut().enumerate() {
            let (x, y) = (self.x_m[lane] - p.x, self.y_m[lane] - p.y);
            let left = (x * x + y * y).sqrt() - self.required[lane];
            *least = if left < *least { left } else { *least };
        }
        rooms.into_iter().fold(room, f64::min)
    }
}

/// Whether this direction moves away from everything the robot touches.
fn leaves_contacts(ego: &Ego, direction: Vec2, neighbours: &Shown, obstacles: &[ObstacleView]) -> bool {
    let free = |normal: Vec2, gap: f64| gap > CONTACT_M || direction.dot(&normal) > 0.02;
    obstacles.iter().all(|o| {
        let (normal, gap) = o.clearance(ego.position_m);
        free(normal, gap)
    }) && neighbours.within(CONTACT_M).all(|lane| {
        let seen = neighbours.at(lane).bearing();
        free(seen.normal, seen.gap_m)
    })
}

#[cfg(test)]
mod tests {
    use super::super::shown::with_all;
    use super::*;
    use crate::guidance::types::Intent;
    use crate::model::Obstacle;
    use proptest::prelude::*;

    /// The spot as the rule says it: all directions and lengths, one neighbour after the other.
    fn spot_by_rule(
        ego: &Ego,
        (other, required_m): (&Neighbour, f64),
        neighbours: &Shown,
        obstacles: &[ObstacleView],
        limits: &Limits,
    ) -> Option<Vec2> {
        let (path, from_m) = (ahead(other) * PATH_M, other.position_m);
        let mut best = (f64::NEG_INFINITY, None);
        for k in 0..DIRECTIONS {
            let angle = f64::from(k) * core::f64::consts::TAU / f64::from(DIRECTIONS);
            let direction = unit(angle);
            let blocked = |(normal, gap): (Vec2, f64)| gap <= CONTACT_M && direction.dot(&normal) <= 0.02;
            let seen = neighbours.iter().map(|n| (n.bearing().normal, n.bearing().gap_m));
            if obstacles.iter().map(|o| o.clearance(ego.position_m)).chain(seen).any(blocked) {
                continue;
            }
            for length in LENGTHS_M {
                let end = ego.position_m + direction * length;
                let mut room = f64::INFINITY;
                for part in [0.2, 0.5, 1.0] {
                    let p = ego.position_m + direction * (length * part);
                    let beside = obstacles.iter().map(|o| o.clearance(p).1);
                    let off = |n: Seen| (neighbours.who(n.lane).position_m - p).norm() - n.required_m;
                    room = beside.chain(neighbours.iter().map(off)).fold(room, f64::min);
                }
                let aside = (closest_point_on_segment(end, from_m, from_m + path) - end).norm() - required_m;
                let turn = wrap(angle - ego.heading_rad).abs() / limits.omega_max_radps;
                let score = 3.0 * aside.min(0.4) + 0.5 * room.min(0.3) - 0.15 * turn - 0.1 * length;
                if room >= -0.005 && score > best.0 {
                    best = (score, Some(end));
                }
            }
        }
        best.1
    }

    proptest! {
        /// What is left out does not win.
        #[test]
        fn the_spot_is_the_one_of_the_rule(
            robots in prop::collection::vec((-1.6..1.6f64, -1.6..1.6f64, -3.1..3.1f64, 0..4u32), 1..=16),
            circles in prop::collection::vec((-2.0..2.0f64, -2.0..2.0f64), 0..3),
            heading_rad in -3.1..3.1f64, required_m in 0.2..0.5f64,
        ) {
            let mut robots: Vec<Neighbour> = robots.into_iter().map(|(x, y, to_rad, rank)| {
                let position_m = Vec2::new(x, y);
                let intent = Intent { heading_rad: to_rad, rank, ..Intent::default() };
                Neighbour { position_m, target_m: position_m + 3.0 * unit(to_rad), intent, ..Neighbour::default() }
            }).collect();
            robots.sort_by(|a, b| a.position_m.norm().total_cmp(&b.position_m.norm()));
            let obstacles: Vec<ObstacleView> = circles.into_iter().map(|(x, y)| {
                let obstacle = Obstacle::Circle { centre_m: Vec2::new(x, y), radius_m: 0.2 };
                ObstacleView { obstacle, keep_m: 0.2 }
            }).collect();
            let ego = Ego {
                id: 7, position_m: Vec2::zeros(), heading_rad, target_m: Vec2::zeros(), beyond_m: 0.0,
                v_mps: 0.0, omega_radps: 0.0, arrived: false,
            };
            let limits = Limits { v_max_mps: 2.0, omega_max_radps: 1.0, period_s: 0.08 };
            with_all(ego.position_m, required_m, (&robots, true), |shown| {
                for n in &robots {
                    let spot = best_spot(&ego, (n, required_m), shown, &obstacles, &limits);
                    prop_assert_eq!(spot, spot_by_rule(&ego, (n, required_m), shown, &obstacles, &limits));
                }
                Ok(())
            })?;
        }
    }
}
