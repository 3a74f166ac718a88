//! Right-hand rule: the robust way out when anticipation does not progress.
//!
//! x* = argmin ‖x − x_pref‖² subject to n·x ≥ −g/2 (d − ρ − m) for every neighbour (full g for a static obstacle).
//! When x* is shorter than η‖x_pref‖, x_pref is turned clockwise until it is not; the angle is remembered and decays.

use super::Params;
use super::shown::Shown;
use super::types::{Drive, Ego, Limits, NEIGHBOURS_MAX, OBSTACLES_MAX, ObstacleView};
use crate::geometry::{Vec2, bearing, rotate, sincos, unit, wrap};

const PLANES_MAX: usize = NEIGHBOURS_MAX + OBSTACLES_MAX;
/// One step of the clockwise search.
const STEP_RAD: f64 = 0.1;
/// Bounds the search whatever the parameters are.
const TURNS_MAX: u32 = 40;
/// What is farther away does not matter.
const RANGE_M: f64 = 6.0;
/// Outward part of the direction at contact.
const LEAN: f64 = 0.15;
/// Below this clearance the direction leans away from the neighbour.
const LEAN_M: f64 = 0.05;

#[derive(Clone, Copy)]
struct Plane {
    normal: Vec2,
    /// n·x ≥ offset, offset ≤ 0, so that x = 0 is always allowed.
    offset: f64,
}

/// Decides by the right-hand rule; `beta_rad` is the clockwise turn remembered.
pub(super) fn drive(
    ego: &Ego,
    neighbours: &Shown,
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    beta_rad: &mut f64,
) -> Drive {
    let mut planes = [Plane { normal: Vec2::new(1.0, 0.0), offset: 0.0 }; PLANES_MAX];
    let mut count = 0;
    for n in neighbours.iter() {
        let (offset, d) = (n.apart_m, n.distance_m);
        if !(1e-9..=RANGE_M).contains(&d) {
            continue;
        }
        let gap = d - n.required_m - params.plane_margin_m;
        planes[count] = Plane { normal: offset / d, offset: -(0.5 * params.plane_gain * gap).max(0.0) };
        count += 1;
    }
    for o in obstacles {
        let (normal, left) = o.clearance(ego.position_m);
        if left > RANGE_M {
            continue;
        }
        planes[count] =
            Plane { normal, offset: -(params.plane_gain * (left - 0.5 * params.plane_margin_m)).max(0.0) };
        count += 1;
    }
    let planes = &planes[..count];
    let to_target = ego.target_m - ego.position_m;
    let distance = to_target.norm();
    let speed = (distance / limits.period_s).min(limits.v_max_mps);
    let toward = if distance > 1e-9 { to_target / distance } else { unit(ego.heading_rad) };
    let mut beta = (*beta_rad - params.beta_decay_rad).max(0.0);
    let mut best = Vec2::new(0.0, 0.0);
    for _ in 0..TURNS_MAX {
        let (s, c) = sincos(-beta);
        let preferred = rotate(toward, c, s) * speed;
        best = project(planes, preferred);
        if best.norm() >= params.eta * speed || beta >= params.beta_max_rad {
            break;
        }
        beta += STEP_RAD;
    }
    let wanted = best.norm();
    let (s, c) = sincos(-beta);
    let direction = if wanted > 1e-6 { best / wanted } else { rotate(toward, c, s) };
    // Exactly tangential at contact is not motion: lean outward.
    let mut lean = Vec2::new(0.0, 0.0);
    for n in neighbours.iter() {
        let (offset, d) = (n.apart_m, n.distance_m);
        let gap = d - n.required_m;
        if d > 1e-9 && gap < LEAN_M {
            lean += offset * ((1.0 - gap / LEAN_M) / d);
        }
    }
    for o in obstacles {
        let (normal, gap) = o.clearance(ego.position_m);
        if gap < LEAN_M {
            lean += normal * (1.0 - gap / LEAN_M);
        }
    }
    let direction = (direction + lean * LEAN).try_normalize(1e-9).unwrap_or(direction);
    *beta_rad = beta;
    let heading_rad = bearing(direction);
    let e = wrap(heading_rad - ego.heading_rad).abs();
    Drive {
        heading_rad,
        direction: unit(heading_rad),
        speed_cap_mps: wanted * (1.0 - params.align_slope * e).max(0.0),
        intent_speed_mps: wanted,
    }
}

/// Nearest point to `x` inside every half-plane: incremental, exact, at most O(n²).
fn project(planes: &[Plane], x: Vec2) -> Vec2 {
    let mut best = x;
    for (i, plane) in planes.iter().enumerate() {
        if plane.normal.dot(&best) >= plane.offset - 1e-12 {
            continue;
        }
        let foot = x - plane.normal * (plane.normal.dot(&x) - plane.offset);
        let along = Vec2::new(-plane.normal.y, plane.normal.x);
        let (mut low, mut high) = (f64::NEG_INFINITY, f64::INFINITY);
        for other in &planes[..i] {
            let slope = other.normal.dot(&along);
            let need = other.offset - other.normal.dot(&foot);
            if slope > 1e-9 {
                low = low.max(need / slope);
            } else if slope < -1e-9 {
                high = high.min(need / slope);
            }
        }
        best = if low > high { Vec2::new(0.0, 0.0) } else { foot + along * 0f64.clamp(low, high) };
    }
    best
}
