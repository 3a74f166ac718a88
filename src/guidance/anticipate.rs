//! Anticipation: candidate headings scored against the predicted motion of the neighbours.
//!
//! Everybody is assumed to turn to the heading it published, to hold it for `hold_s`, then to steer to its target. The
//! ego is rolled out the same way for every candidate (a heading and a share of the full speed), slowed by what the
//! hard rows would allow. The cost of a candidate is
//!
//!   time lost against the straight way + Σ_j worst closeness to j + deflection, change of heading, slowness,
//!
//! all in seconds. Right turns cost less than left ones, so that mirrored robots choose the same side. At most
//! 57 candidates x 16 steps x 16 neighbours; most candidates are given up early.

use super::Params;
use super::types::{Drive, Ego, Limits, Memory, NEIGHBOURS_MAX, Neighbour, ObstacleView};
use super::{bypass, roundabout};
use crate::geometry::{Vec2, rotate, unit, wrap};

/// Steps of the prediction.
const STEPS: usize = 16;
/// Candidate deflections, rad, counter-clockwise positive; near ones first, so that the rest is given up early.
const DEFLECTIONS_RAD: [f64; 19] = [
    0.0, -0.06, 0.06, -0.12, 0.12, -0.2, 0.2, -0.3, 0.3, -0.42, 0.42, -0.6, 0.6, -0.85, 0.85, -1.15, 1.15,
    -1.5, -1.9,
];
/// Candidate shares of the full speed.
const SPEEDS: [f64; 3] = [1.0, 0.6, 0.25];
/// Close enough to the target to end the prediction.
const LANDED_M: f64 = 0.05;
/// Closer than this to a static obstacle costs.
const OBSTACLE_MARGIN_M: f64 = 0.1;
/// Least share of `parked_margin_m` after long going around.
const PATIENCE_MIN: f64 = 0.05;
/// Neighbours farther than this do not slow the robot.
const STANDOFF_RANGE_M: f64 = 1.5;

/// The normal case: turn the target by the way around parked robots or by the roundabout, then choose the best candidate.
pub(super) fn drive(
    ego: &Ego,
    neighbours: &[Neighbour],
    obstacles: &[ObstacleView],
    queue_mps: Option<f64>,
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> Drive {
    memory.beta_rad = 0.0;
    let to_target = ego.target_m - ego.position_m;
    let around = bypass::rotation(ego, neighbours, limits, params, memory);
    let turn = if around == 0.0 { -roundabout::rotation(ego, neighbours, limits, params) } else { around };
    let (s, c) = libm::sincos(turn);
    memory.intent.target_m = ego.position_m + rotate(to_target, c, s);
    // The longer it takes to get past parked robots, the closer it may pass.
    let patience = (1.0 - memory.around.spent_s / params.squeeze_s).clamp(PATIENCE_MIN, 1.0);
    let scene = Scene::new(ego, memory.intent.target_m, neighbours, obstacles, limits, params, patience);
    let best = scene.best(memory.intent.heading_rad);

    let h = unit(ego.heading_rad);
    let mut v = limits.v_max_mps * best.share * align(h.dot(&unit(best.heading_rad)), params);
    v = v.min(arc_speed(h, to_target, to_target.norm(), limits, params));
    // Stop short of contact while not blocked, so that there is room left to slip aside.
    let calm = (1.0 - memory.progress.blocked_s / params.blocked_enter_s.max(limits.period_s)).max(0.0);
    for n in neighbours {
        let seen = n.seen_from(ego.position_m);
        let closing = -h.dot(&seen.normal);
        if seen.gap_m < STANDOFF_RANGE_M && closing > 1e-6 {
            v = v.min(params.row_rate * (seen.gap_m - params.standoff_m * calm).max(0.0) / closing);
        }
    }
    if let Some(q) = queue_mps
        && memory.progress.queued_s < params.queue_patience_s
    {
        v = v.min(q);
    }
    Drive { heading_rad: best.heading_rad, speed_cap_mps: v, intent_speed_mps: best.mean_speed_mps }
}

/// Speed share for the cosine of the heading error.
fn align(cos: f64, params: &Params) -> f64 {
    ((cos - params.align_cos) / (1.0 - params.align_cos)).clamp(0.0, 1.0)
}

/// Speed at which the arc of the largest turn rate still reaches the target instead of circling it.
fn arc_speed(h: Vec2, to: Vec2, left: f64, limits: &Limits, params: &Params) -> f64 {
    let sideways = h.perp(&to).abs();
    if sideways > 1e-9 {
        params.arc_gain * limits.omega_max_radps * left * left / (2.0 * sideways)
    } else {
        f64::INFINITY
    }
}

struct Best {
    heading_rad: f64,
    share: f64,
    mean_speed_mps: f64,
}

/// Predicted positions of one neighbour.
#[derive(Clone, Copy)]
struct Track {
    start: Vec2,
    points: [Vec2; STEPS],
    required_m: f64,
    margin_m: f64,
}

impl Track {
    /// Where the neighbour is when step `k` begins.
    fn before(&self, k: usize) -> Vec2 {
        if k == 0 { self.start } else { self.points[k - 1] }
    }
}

/// Everything that all candidates share.
struct Scene<'a> {
    ego: &'a Ego,
    target: Vec2,
    obstacles: &'a [ObstacleView],
    limits: &'a Limits,
    params: &'a Params,
    /// Cosine and sine of the largest turn in one step.
    turn: (f64, f64),
    tracks: [Track; NEIGHBOURS_MAX],
    count: usize,
}

impl<'a> Scene<'a> {
    fn new(
        ego: &'a Ego,
        target: Vec2,
        neighbours: &[Neighbour],
        obstacles: &'a [ObstacleView],
        limits: &'a Limits,
        params: &'a Params,
        patience: f64,
    ) -> Self {
        let zero = Vec2::new(0.0, 0.0);
        let (sin, cos) = libm::sincos(limits.omega_max_radps * params.step_s);
        let empty = Track { start: zero, points: [zero; STEPS], required_m: 0.0, margin_m: 0.0 };
        let mut scene = Self {
            ego,
            target,
            obstacles,
            limits,
            params,
            turn: (cos, sin),
            tracks: [empty; NEIGHBOURS_MAX],
            count: 0,
        };
        for n in neighbours {
            if n.seen_from(ego.position_m).distance_m > params.range_m {
                break;
            }
            let parked = params.parked_margin_m * patience;
            scene.tracks[scene.count] = Track {
                start: n.position_m,
                points: scene.predict(n),
                required_m: n.required_distance_m,
                margin_m: if n.arrived { parked } else { params.prox_margin_m },
            };
            scene.count += 1;
        }
        scene
    }

    /// `h` turned toward the unit vector `to` by at most one step.
    fn turned(&self, h: Vec2, to: Vec2) -> Vec2 {
        let (cos, sin) = self.turn;
        if h.dot(&to) >= cos {
            to
        } else if h.perp(&to) >= 0.0 {
            rotate(h, cos, sin)
        } else {
            rotate(h, cos, -sin)
        }
    }

    /// Turn to the published heading, hold it, then go to the target and stay there.
    fn predict(&self, n: &Neighbour) -> [Vec2; STEPS] {
        let mut points = [n.position_m; STEPS];
        if n.arrived {
            return points;
        }
        let dt = self.params.step_s;
        let published = unit(n.intent.heading_rad);
        let speed = n.intent.speed_mps.max(self.params.other_speed_min_mps);
        let (mut p, mut h, mut time) = (n.position_m, unit(n.heading_rad), 0.0);
        for point in &mut points {
            let to = n.intent.target_m - p;
            let left = to.norm();
            let aim = if time < self.params.hold_s || left < 1e-6 { published } else { to / left };
            h = self.turned(h, aim);
            p += h * (speed * align(h.dot(&aim), self.params) * dt).min(left);
            *point = p;
            time += dt;
        }
        points
    }

    fn best(&self, previous_rad: f64) -> Best {
        let p = self.params;
        let to = self.target - self.ego.position_m;
        let bearing = libm::atan2(to.y, to.x);
        let mut best = Best { heading_rad: bearing, share: 1.0, mean_speed_mps: self.limits.v_max_mps };
        let mut best_cost = f64::INFINITY;
        for deflection in DEFLECTIONS_RAD {
            let heading_rad = wrap(bearing + deflection);
            let side = if deflection > 0.0 { p.left_weight } else { p.right_weight };
            let bias = side * deflection.abs() + p.hysteresis_weight * wrap(heading_rad - previous_rad).abs();
            let direction = unit(heading_rad);
            for share in SPEEDS {
                let base = bias + p.slow_weight * (1.0 - share);
                if base >= best_cost {
                    continue;
                }
                if let Some((cost, mean_speed_mps)) = self.cost(direction, share, base, best_cost) {
                    best_cost = cost;
                    best = Best { heading_rad, share, mean_speed_mps };
                }
            }
        }
        best
    }

    /// Cost and mean speed of a candidate, or `None` once the cost reaches `give_up`.
    fn cost(&self, direction: Vec2, share: f64, base: f64, give_up: f64) -> Option<(f64, f64)> {
        let params = self.params;
        let v_max = self.limits.v_max_mps;
        let dt = params.step_s;
        let mut p = self.ego.position_m;
        let mut h = unit(self.ego.heading_rad);
        let mut cost = base;
        let mut left = (self.target - p).norm();
        let left_at_start = left;
        let (mut time, mut path, mut lost) = (0.0, 0.0, 0.0);
        let mut fade = 1.0;
        let mut worst = [0.0f64; NEIGHBOURS_MAX];
        for k in 0..STEPS {
            let to = self.target - p;
            let aim = if time < params.hold_s || left < 1e-9 { direction } else { to / left };
            h = self.turned(h, aim);
            let v =
                (v_max * share * align(h.dot(&aim), params)).min(arc_speed(h, to, left, self.limits, params));
            let (v, scrape) = self.beside_obstacles(self.slowed(v, p, h, k), p, h);
            let travel = (v * dt).min(left);
            let next = p + h * travel;
            cost += self.closeness(p, next, k, fade, &mut worst) + scrape * fade * dt;
            if cost >= give_up {
                return None;
            }
            p = next;
            path += travel;
            time += dt;
            fade -= params.prox_fade / STEPS as f64;
            left = (self.target - p).norm();
            // Time lost against the straight way never shrinks, so it bounds the final cost from below.
            lost = time + (left - left_at_start) / v_max;
            if cost + lost >= give_up {
                return None;
            }
            if left < LANDED_M {
                break;
            }
        }
        let misaligned = if left < LANDED_M { 0.0 } else { 1.0 - h.dot(&(self.target - p)) / left };
        cost += lost + params.turn_weight * misaligned;
        (cost < give_up).then_some((cost, path / time))
    }

    /// Speed that the hard rows of the neighbours would leave.
    fn slowed(&self, mut v: f64, p: Vec2, h: Vec2, k: usize) -> f64 {
        let rate = self.params.row_rate;
        for t in &self.tracks[..self.count] {
            let offset = p - t.before(k);
            let reach = t.required_m + self.limits.v_max_mps / rate;
            let d2 = offset.norm_squared();
            if d2 > reach * reach {
                continue;
            }
            let d = d2.sqrt().max(1e-6);
            let closing = -h.dot(&offset) / d;
            if closing > 0.0 {
                v = v.min(rate * (d - t.required_m).max(0.0) / closing);
            }
        }
        v
    }

    /// Speed that the hard rows of the static obstacles would leave, and the cost rate of being close to
    /// them.
    fn beside_obstacles(&self, mut v: f64, p: Vec2, h: Vec2) -> (f64, f64) {
        let mut scrape = 0.0;
        for o in self.obstacles {
            let (normal, gap) = o.clearance(p);
            let closing = -h.dot(&normal);
            if closing > 0.0 {
                v = v.min(2.0 * self.params.row_rate * gap.max(0.0) / closing);
            }
            scrape += (1.0 - gap / OBSTACLE_MARGIN_M).max(0.0);
        }
        (v, self.params.prox_weight * scrape)
    }

    /// By how much the step raises the worst closeness to each neighbour.
    fn closeness(&self, p: Vec2, next: Vec2, k: usize, fade: f64, worst: &mut [f64]) -> f64 {
        let mut raised = 0.0;
        for (t, worst) in self.tracks[..self.count].iter().zip(worst) {
            // Closest approach inside the step: at 10 m/s relative speed the samples alone would miss it.
            let from = p - t.before(k);
            let change = next - t.points[k] - from;
            let c2 = change.norm_squared();
            let s = if c2 > 1e-12 { (-from.dot(&change) / c2).clamp(0.0, 1.0) } else { 0.0 };
            let d2 = (from + change * s).norm_squared();
            let reach = t.required_m + t.margin_m;
            if d2 >= reach * reach {
                continue;
            }
            let gap = d2.sqrt() - t.required_m;
            let x = 1.0 - gap / t.margin_m;
            let overlap = (-gap).max(0.0) / t.required_m;
            let penalty = fade * (self.params.prox_weight * x * x + self.params.overlap_weight * overlap);
            if penalty > *worst {
                raised += penalty - *worst;
                *worst = penalty;
            }
        }
        raised
    }
}
