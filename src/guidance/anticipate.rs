//! Anticipation: candidate headings scored against the predicted motion of the neighbours.
//!
//! Everybody is assumed to turn to the heading it published, hold it for `hold_s`, then steer to its target.
//! The ego is rolled out the same way for every candidate, slowed by the rate the safety row will allow, and the
//! candidate with the least predicted time plus proximity cost wins. Right turns cost less than left ones, so that
//! mirrored robots break the tie to the same side.

use super::params::Params;
use super::types::*;
use nalgebra::Vector2;

/// Steps of the prediction.
pub const STEPS: usize = 16;
/// Candidate deflections, rad, counter-clockwise positive.
const DEFLECTIONS_RAD: [f64; 19] = [
    0.0, -0.06, 0.06, -0.12, 0.12, -0.2, 0.2, -0.3, 0.3, -0.42, 0.42, -0.6, 0.6, -0.85, 0.85, -1.15, 1.15,
    -1.5, -1.9,
];
/// Close enough to the target to end the prediction.
const LANDED_M: f64 = 0.05;
const SPEEDS: [f64; 3] = [1.0, 0.6, 0.25];

/// The winner.
pub struct Choice {
    pub heading_rad: f64,
    pub speed_factor: f64,
    pub mean_speed_mps: f64,
}

struct Track {
    start: Vector2<f64>,
    points: [Vector2<f64>; STEPS],
    required: f64,
    margin: f64,
}

impl Track {
    /// Where the neighbour is when step `k` begins.
    fn before(&self, k: usize) -> Vector2<f64> {
        if k == 0 { self.start } else { self.points[k - 1] }
    }
}

fn align(c: f64, params: &Params) -> f64 {
    ((c - params.align_cos) / (1.0 - params.align_cos)).clamp(0.0, 1.0)
}

/// `h` turned toward the unit vector `to`, by no more than the angle with this cosine and sine.
fn turn(h: Vector2<f64>, to: Vector2<f64>, cos: f64, sin: f64) -> Vector2<f64> {
    if h.dot(&to) >= cos {
        to
    } else if cross(h, to) >= 0.0 {
        rotate(h, cos, sin)
    } else {
        rotate(h, cos, -sin)
    }
}

pub fn choose(
    ego: &Ego,
    neighbours: &[Neighbour],
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    previous_rad: f64,
) -> Choice {
    let dt = params.step_s;
    let (sin, cos) = libm::sincos(limits.omega_max_radps * dt);
    let mut tracks: [Track; NEIGHBOURS_MAX] = core::array::from_fn(|_| Track {
        start: Vector2::new(0.0, 0.0),
        points: [Vector2::new(0.0, 0.0); STEPS],
        required: 0.0,
        margin: 0.0,
    });
    let mut count = 0;
    for n in neighbours.iter().take(NEIGHBOURS_MAX) {
        if (n.position_m - ego.position_m).norm_squared() > params.range_m * params.range_m {
            break;
        }
        let track = &mut tracks[count];
        track.start = n.position_m;
        track.required = n.required_distance_m;
        track.margin = if n.arrived { params.parked_margin_m } else { params.prox_margin_m };
        predict(n, limits, params, cos, sin, &mut track.points);
        count += 1;
    }
    let tracks = &tracks[..count];

    let to_target = ego.target_m - ego.position_m;
    let bearing = libm::atan2(to_target.y, to_target.x);
    let heading = unit(ego.heading_rad);
    let mut best = Choice { heading_rad: bearing, speed_factor: 1.0, mean_speed_mps: limits.v_max_mps };
    let mut best_cost = f64::INFINITY;
    for deflection in DEFLECTIONS_RAD {
        let candidate = bearing + deflection;
        let bias = if deflection > 0.0 { params.left_weight } else { params.right_weight } * deflection.abs()
            + params.hysteresis_weight * wrap(candidate - previous_rad).abs();
        let direction = unit(candidate);
        for factor in SPEEDS {
            let base = bias + params.slow_weight * (1.0 - factor);
            let (cost, mean) = roll(
                ego, heading, direction, factor, tracks, obstacles, limits, params, cos, sin, base, best_cost,
            );
            if cost < best_cost {
                best_cost = cost;
                best = Choice { heading_rad: wrap(candidate), speed_factor: factor, mean_speed_mps: mean };
            }
        }
    }
    best
}

/// Turn to the published heading, hold it, then go to the target and stay there.
fn predict(
    n: &Neighbour,
    limits: &Limits,
    params: &Params,
    cos: f64,
    sin: f64,
    out: &mut [Vector2<f64>; STEPS],
) {
    if n.arrived {
        *out = [n.position_m; STEPS];
        return;
    }
    let dt = params.step_s;
    let mut p = n.position_m;
    let mut h = unit(n.heading_rad);
    let published = unit(n.intent.heading_rad);
    let speed = n.intent.speed_mps.max(params.other_speed_min);
    let mut time = 0.0;
    for point in out.iter_mut() {
        let to = n.intent.target_m - p;
        let d = to.norm();
        let aim = if time < params.hold_s || d < 1e-6 { published } else { to / d };
        h = turn(h, aim, cos, sin);
        let travel = (speed * align(h.dot(&aim), params) * dt).min(d);
        p += h * travel;
        *point = p;
        time += dt;
    }
    let _ = limits;
}

#[allow(clippy::too_many_arguments)]
fn roll(
    ego: &Ego,
    heading: Vector2<f64>,
    direction: Vector2<f64>,
    factor: f64,
    tracks: &[Track],
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    cos: f64,
    sin: f64,
    base: f64,
    give_up: f64,
) -> (f64, f64) {
    let dt = params.step_s;
    let mut p = ego.position_m;
    let mut h = heading;
    let mut cost = base;
    let mut time = 0.0;
    let mut fade = 1.0;
    let fade_step = params.prox_fade / STEPS as f64;
    let mut path = 0.0;
    let mut left = (ego.target_m - p).norm();
    let left_at_start = left;
    let mut lost = 0.0;
    let mut worst = [0.0f64; NEIGHBOURS_MAX];
    let slowed = limits.v_max_mps / params.row_rate;
    for k in 0..STEPS {
        let to = ego.target_m - p;
        let toward = if left > 1e-9 { to / left } else { direction };
        let aim = if time < params.hold_s { direction } else { toward };
        h = turn(h, aim, cos, sin);
        // Slower than the arc that would circle the target.
        let sideways = cross(h, toward).abs();
        let mut v = limits.v_max_mps * factor * align(h.dot(&aim), params);
        if sideways > 1e-6 {
            v = v.min(params.arc_gain * limits.omega_max_radps * left / (2.0 * sideways));
        }
        for t in tracks {
            let reach = t.required + slowed;
            let offset = p - t.before(k);
            let d2 = offset.norm_squared();
            if d2 > reach * reach {
                continue;
            }
            let d = d2.sqrt().max(1e-6);
            let closing = -h.dot(&offset) / d;
            if closing > 0.0 {
                v = v.min((params.row_rate * (d - t.required).max(0.0)) / closing);
            }
        }
        for o in obstacles.iter().take(OBSTACLES_MAX) {
            let (normal, gap) = o.clearance(p);
            let closing = -h.dot(&normal);
            if closing > 0.0 {
                v = v.min(2.0 * params.row_rate * gap.max(0.0) / closing);
            }
            if gap < 0.1 {
                cost += params.prox_weight * fade * dt * (0.1 - gap) * 10.0;
            }
        }
        let travel = (v * dt).min(left);
        let next = p + h * travel;
        for (j, t) in tracks.iter().enumerate() {
            // Closest approach inside the step: at 10 m/s relative speed the samples alone would miss it.
            let from = p - t.before(k);
            let change = next - t.points[k] - from;
            let c2 = change.norm_squared();
            let s = if c2 > 1e-12 { (-from.dot(&change) / c2).clamp(0.0, 1.0) } else { 0.0 };
            let d2 = (from + change * s).norm_squared();
            let reach = t.required + t.margin;
            if d2 >= reach * reach {
                continue;
            }
            let gap = d2.sqrt() - t.required;
            let x = 1.0 - gap / t.margin;
            let mut penalty = params.prox_weight * x * x;
            if gap < 0.0 {
                penalty -= params.overlap_weight * gap / t.required;
            }
            penalty *= fade;
            if penalty > worst[j] {
                cost += penalty - worst[j];
                worst[j] = penalty;
            }
        }
        if cost >= give_up {
            return (f64::INFINITY, 0.0);
        }
        p = next;
        path += travel;
        time += dt;
        fade -= fade_step;
        left = (ego.target_m - p).norm();
        // Time lost against the straight way never shrinks, so it bounds the final cost from below.
        lost = time + (left - left_at_start) / limits.v_max_mps;
        if cost + lost >= give_up {
            return (f64::INFINITY, 0.0);
        }
        if left < LANDED_M {
            break;
        }
    }
    let misaligned = if left < LANDED_M { 0.0 } else { 1.0 - h.dot(&(ego.target_m - p)) / left };
    cost += lost + params.turn_weight * misaligned;
    (cost, path / time)
}
