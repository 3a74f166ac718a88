//! Way around parked robots: which side of a cluster to pass, and the direction of its edge.
//!
//! Parked robots too close together to pass between form one obstacle. When the straight way to the target hits such a
//! cluster, the robot steers to the tangent of its nearer edge and keeps that side until the way is free.
//! Bounded: O(n²) over at most `NEIGHBOURS_MAX` neighbours.

use super::params::Params;
use super::types::*;
use core::f64::consts::PI;
use nalgebra::Vector2;

/// Room beyond the required distance that the straight way needs.
const ROOM_M: f64 = 0.02;
/// A side is changed only when the other is shorter by this much, more after every change.
const SIDE_HYSTERESIS_M: f64 = 1.0;
/// The side is remembered this long after the straight way looked free.
const SIDE_MEMORY_S: f64 = 1.0;

/// Angle (counter-clockwise positive) from the target to the edge to steer for; 0 when the straight way is free.
pub fn rotation(
    ego: &Ego,
    neighbours: &[Neighbour],
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> f64 {
    let to_target = ego.target_m - ego.position_m;
    let left = to_target.norm();
    let n = neighbours.len().min(NEIGHBOURS_MAX);
    let neighbours = &neighbours[..n];
    let first = neighbours.iter().position(|x| x.arrived && hit(ego, to_target, left, x));
    let Some(first) = first else {
        memory.side_free_s += limits.period_s;
        if memory.side_free_s > SIDE_MEMORY_S {
            memory.side = 0.0;
            memory.side_changes = 0.0;
        }
        memory.around_s = (memory.around_s - 0.5 * limits.period_s).max(0.0);
        return 0.0;
    };
    memory.side_free_s = 0.0;
    memory.around_s += limits.period_s;
    // Going round and round: the goal is enclosed, so go straight and have the parked robots make way.
    if memory.around_s > params.give_up_around_s {
        memory.straight_s = params.straight_s;
    }
    // Long on the way: try the narrow gaps too.
    let pass_gap = if memory.around_s > params.squeeze_s { 0.01 } else { params.pass_gap_m };
    let bearing = libm::atan2(to_target.y, to_target.x);
    let mut angle = [f64::NAN; NEIGHBOURS_MAX];
    let mut queue = [0usize; NEIGHBOURS_MAX];
    let (mut head, mut tail) = (0, 1);
    queue[0] = first;
    let off = neighbours[first].position_m - ego.position_m;
    angle[first] = wrap(libm::atan2(off.y, off.x) - bearing);
    let (mut ccw, mut cw) = (f64::NEG_INFINITY, f64::INFINITY);
    let (mut ccw_m, mut cw_m) = (0.0, 0.0);
    while head < tail {
        let a = queue[head];
        head += 1;
        let here = neighbours[a].position_m - ego.position_m;
        let d = here.norm().max(1e-6);
        let half = libm::asin(((neighbours[a].required_distance_m + params.bypass_room_m) / d).min(1.0));
        let length = d + (to_target - here).norm();
        if angle[a] + half > ccw {
            (ccw, ccw_m) = (angle[a] + half, length);
        }
        if angle[a] - half < cw {
            (cw, cw_m) = (angle[a] - half, length);
        }
        for (b, other) in neighbours.iter().enumerate() {
            if !other.arrived || !angle[b].is_nan() {
                continue;
            }
            let there = other.position_m - ego.position_m;
            let between = (there - here).norm();
            let need = neighbours[a].required_distance_m + other.required_distance_m;
            if between < need + pass_gap {
                // Unwrapped along the cluster, so that a ring around the robot reads as more than a half turn.
                angle[b] = angle[a] + libm::atan2(cross(here, there), here.dot(&there));
                queue[tail] = b;
                tail += 1;
            }
        }
    }
    // The turn itself costs time: a radian of it is worth as much as this much way.
    let per_radian = 0.5 * limits.v_max_mps / limits.omega_max_radps;
    let heading = ego.heading_rad - bearing;
    let (left_m, right_m) = (
        ccw_m + per_radian * wrap(ccw - heading).abs() + params.bypass_left_m,
        cw_m + per_radian * wrap(cw - heading).abs(),
    );
    let shorter = if left_m < right_m { 1.0 } else { -1.0 };
    if memory.side == 0.0 {
        memory.side = shorter;
    } else if memory.side != shorter
        && (left_m - right_m).abs() > SIDE_HYSTERESIS_M * (1.0 + 2.0 * memory.side_changes)
    {
        memory.side = shorter;
        memory.side_changes += 1.0;
    }
    if memory.side > 0.0 { ccw.clamp(0.0, PI) } else { cw.clamp(-PI, 0.0) }
}

/// Whether the straight way to the target comes too near to this parked robot.
fn hit(ego: &Ego, to_target: Vector2<f64>, left: f64, n: &Neighbour) -> bool {
    let offset = n.position_m - ego.position_m;
    let s = (offset.dot(&to_target) / (left * left).max(1e-12)).clamp(0.0, 1.0);
    let near = (to_target * s - offset).norm();
    let allowed =
        (n.required_distance_m + ROOM_M).min((offset - to_target).norm() - 0.01).min(offset.norm() - 0.001);
    near < allowed
}
