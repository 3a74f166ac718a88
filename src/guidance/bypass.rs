//! Way around parked robots: which side of a cluster to pass, and the direction of its edge.
//!
//! Parked robots too close together to pass between form one obstacle. When the straight way to the target hits such a
//! cluster, the robot steers for the tangent of one edge and keeps that side until the way is free. Bounded: O(n²) over
//! the neighbours given.

use super::Params;
use super::shown::Shown;
use super::types::{Ego, Limits, Memory, NEIGHBOURS_MAX, Seen};
use crate::geometry::{Vec2, wrap};
use core::f64::consts::PI;

/// Room beyond the required distance that the straight way needs.
const ROOM_M: f64 = 0.02;
/// Gaps tried after `squeeze_s`.
const SQUEEZE_GAP_M: f64 = 0.01;
/// A side is changed only when the other is shorter by this much, more after every change.
const SIDE_HYSTERESIS_M: f64 = 1.0;
/// The side is remembered this long after the straight way became free.
const SIDE_MEMORY_S: f64 = 1.0;

/// One edge of the cluster: the angle to steer for (from the target, counter-clockwise) and the way past it.
#[derive(Clone, Copy)]
struct Edge {
    angle_rad: f64,
    length_m: f64,
}

/// Angle from the target to the edge to steer for; 0 when the straight way is free.
pub(super) fn rotation(
    ego: &Ego,
    neighbours: &Shown,
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> f64 {
    let to_target = ego.target_m - ego.position_m;
    let around = &mut memory.around;
    let Some(first) = neighbours.parked().find(|lane| blocks(to_target, &neighbours.at(*lane))) else {
        around.free_s += limits.period_s;
        if around.free_s > SIDE_MEMORY_S {
            around.side = 0.0;
            around.changes = 0.0;
        }
        around.spent_s = (around.spent_s - 0.5 * limits.period_s).max(0.0);
        return 0.0;
    };
    around.free_s = 0.0;
    around.spent_s += limits.period_s;
    // Going round and round: the goal is enclosed.
    if around.spent_s > params.give_up_around_s {
        memory.ask_s = params.ask_s;
    }
    let pass_gap = if around.spent_s > params.squeeze_s { SQUEEZE_GAP_M } else { params.pass_gap_m };
    let bearing = libm::atan2(to_target.y, to_target.x);
    let (left, right) = edges(to_target, bearing, neighbours, first, pass_gap, params);

    // The turn itself costs time: a radian of it is worth as much as this much way.
    let per_radian = 0.5 * limits.v_max_mps / limits.omega_max_radps;
    let cost = |e: Edge| e.length_m + per_radian * wrap(bearing + e.angle_rad - ego.heading_rad).abs();
    let (left_m, right_m) = (cost(left) + params.bypass_left_m, cost(right));
    let shorter = if left_m < right_m { 1.0 } else { -1.0 };
    if around.side == 0.0 {
        around.side = shorter;
    } else if around.side != shorter
        && (left_m - right_m).abs() > SIDE_HYSTERESIS_M * (1.0 + 2.0 * around.changes)
    {
        around.side = shorter;
        around.changes += 1.0;
    }
    if around.side > 0.0 { left.angle_rad.clamp(0.0, PI) } else { right.angle_rad.clamp(-PI, 0.0) }
}

/// Left and right edge of the cluster that contains `first`.
fn edges(
    to_target: Vec2,
    bearing: f64,
    neighbours: &Shown,
    first: usize,
    pass_gap: f64,
    params: &Params,
) -> (Edge, Edge) {
    let mut angle = [f64::NAN; NEIGHBOURS_MAX];
    let mut queue = [0usize; NEIGHBOURS_MAX];
    let (mut head, mut tail) = (0, 1);
    queue[0] = first;
    let offset = -neighbours.at(first).apart_m;
    angle[first] = wrap(libm::atan2(offset.y, offset.x) - bearing);
    let mut left = Edge { angle_rad: f64::NEG_INFINITY, length_m: 0.0 };
    let mut right = Edge { angle_rad: f64::INFINITY, length_m: 0.0 };
    while head < tail {
        let a = queue[head];
        head += 1;
        let from = neighbours.at(a);
        let here = -from.apart_m;
        let d = here.norm().max(1e-6);
        let half = libm::asin(((from.required_m + params.bypass_room_m) / d).min(1.0));
        let length_m = d + (to_target - here).norm();
        if angle[a] + half > left.angle_rad {
            left = Edge { angle_rad: angle[a] + half, length_m };
        }
        if angle[a] - half < right.angle_rad {
            right = Edge { angle_rad: angle[a] - half, length_m };
        }
        for b in neighbours.parked() {
            if !angle[b].is_nan() {
                continue;
            }
            let other = neighbours.at(b);
            let there = -other.apart_m;
            let need = from.required_m + other.required_m;
            if (there - here).norm() < need + pass_gap {
                // Unwrapped along the cluster, so that a ring around the robot reads as more than a half turn.
                angle[b] = angle[a] + libm::atan2(here.perp(&there), here.dot(&there));
                queue[tail] = b;
                tail += 1;
            }
        }
    }
    (left, right)
}

/// Whether the straight way to the target comes too near to this parked robot.
fn blocks(to_target: Vec2, n: &Seen) -> bool {
    let offset = -n.apart_m;
    let s = (offset.dot(&to_target) / to_target.norm_squared().max(1e-12)).clamp(0.0, 1.0);
    let near = (to_target * s - offset).norm();
    // Neither the start nor the target can be farther away than it is.
    let needed = (n.required_m + ROOM_M).min((offset - to_target).norm() - 0.01).min(n.distance_m - 0.001);
    near < needed
}
