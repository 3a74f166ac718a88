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

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::too_many_arguments, reason = "what a rule reads, and what it remembers")]

use super::Params;
use super::others::{Lanes, Others};
use super::predict::{Predictions, STEPS, Turn, align};
use super::types::{Drive, Ego, Limits, Memory, NEIGHBOURS_MAX, Neighbour, ObstacleView, Plan};
use super::{bypass, roundabout};
use crate::geometry::{Vec2, rotate, unit, wrap};

/// Candidate deflections, rad, counter-clockwise positive; near ones first, so that the rest is given up early.
const DEFLECTIONS_RAD: [f64; 19] = [
    0.0, -0.06, 0.06, -0.12, 0.12, -0.2, 0.2, -0.3, 0.3, -0.42, 0.42, -0.6, 0.6, -0.85, 0.85, -1.15, 1.15,
    -1.5, -1.9,
];
/// Candidate shares of the full speed.
const SPEEDS: [f64; 3] = [1.0, 0.6, 0.25];
/// Rounding that a bound of a cost is forgiven, s.
const ROUNDING_S: f64 = 1e-9;
/// Close enough to the target to end the prediction.
const LANDED_M: f64 = 0.05;
/// Closer than this to a static obstacle costs.
const OBSTACLE_MARGIN_M: f64 = 0.1;
/// Least share of `parked_margin_m` after long going around.
const PATIENCE_MIN: f64 = 0.05;
/// This near to its target a robot in a crowd decides every time.
const CROWD_TARGET_M: f64 = 2.0;
/// Times at which the robots of a crowd decide.
const PHASES: u32 = 16;
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
    predictions: &mut Predictions,
    memory: &mut Memory,
) -> Drive {
    memory.beta_rad = 0.0;
    let to_target = ego.target_m - ego.position_m;
    let around = bypass::rotation(ego, neighbours, limits, params, memory);
    if around != 0.0 || !holds(ego, neighbours, limits, params, memory) {
        let turn_rad =
            if around == 0.0 { -roundabout::rotation(ego, neighbours, limits, params) } else { around };
        let (s, c) = libm::sincos(turn_rad);
        memory.intent.target_m = ego.position_m + rotate(to_target, c, s);
        // The longer it takes to get past parked robots, the closer it may pass.
        let patience = (1.0 - memory.around.spent_s / params.squeeze_s).clamp(PATIENCE_MIN, 1.0);
        let target_m = memory.intent.target_m;
        let scene = Scene::new(ego, target_m, neighbours, obstacles, limits, params, predictions, patience);
        memory.plan = Plan { turn_rad, ..scene.best(memory.intent.heading_rad) };
    } else {
        let (s, c) = libm::sincos(memory.plan.turn_rad);
        memory.intent.target_m = ego.position_m + rotate(to_target, c, s);
    }
    let best = memory.plan;

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

/// Speed at which the arc of the largest turn rate still reaches the target instead of circling it.
fn arc_speed(h: Vec2, to: Vec2, left: f64, limits: &Limits, params: &Params) -> f64 {
    let sideways = h.perp(&to).abs();
    if sideways > 1e-9 {
        params.arc_gain * limits.omega_max_radps * left * left / (2.0 * sideways)
    } else {
        f64::INFINITY
    }
}

/// Whether a robot in a crowd keeps to what it decided. Nobody gets far there in a few periods, and who decides at
/// another time than those around it sees what they have decided.
fn holds(ego: &Ego, neighbours: &[Neighbour], limits: &Limits, params: &Params, memory: &mut Memory) -> bool {
    let near = |p: Vec2, m: f64| (p - ego.position_m).norm_squared() < m * m;
    let crowded = neighbours.get(NEIGHBOURS_MAX - 1).is_some_and(|n| near(n.position_m, params.crowd_m))
        && !near(ego.target_m, CROWD_TARGET_M);
    if !crowded {
        memory.crowded_s = 0.0;
        return false;
    }
    if memory.crowded_s == 0.0 {
        // Not all of a crowd at the same time.
        memory.crowded_s =
            limits.period_s + params.crowd_hold_s * f64::from(ego.id % PHASES) / f64::from(PHASES);
        return false;
    }
    memory.crowded_s += limits.period_s;
    let over = memory.crowded_s > params.crowd_hold_s + 0.5 * limits.period_s;
    if over {
        memory.crowded_s = limits.period_s;
    }
    !over
}

/// Everything that all candidates share.
struct Scene<'a> {
    ego: &'a Ego,
    target: Vec2,
    obstacles: &'a [ObstacleView],
    limits: &'a Limits,
    params: &'a Params,
    turn: Turn,
    others: Others,
}

impl<'a> Scene<'a> {
    fn new(
        ego: &'a Ego,
        target: Vec2,
        neighbours: &[Neighbour],
        obstacles: &'a [ObstacleView],
        limits: &'a Limits,
        params: &'a Params,
        predictions: &mut Predictions,
        patience: f64,
    ) -> Self {
        let turn = Turn::new(limits, params);
        let mut scene = Self { ego, target, obstacles, limits, params, turn, others: Others::none() };
        for n in neighbours {
            if n.seen_from(ego.position_m).distance_m > params.range_m {
                break;
            }
            let margin_m = if n.arrived { params.parked_margin_m * patience } else { params.prox_margin_m };
            let slow_m = n.required_distance_m + limits.v_max_mps / params.row_rate;
            let path = predictions.of(n, limits, params);
            scene.others.push(n.position_m, path, n.required_distance_m, margin_m, slow_m);
        }
        scene
    }

    /// The candidate of the lowest cost, the first of several.
    fn best(&self, previous_rad: f64) -> Plan {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { self.best_avx2(previous_rad) };
        }
        self.best_of_all(previous_rad)
    }

    /// [`best_of_all`](Self::best_of_all) for wider registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn best_avx2(&self, previous_rad: f64) -> Plan {
        self.best_of_all(previous_rad)
    }

    #[inline(always)]
    fn best_of_all(&self, previous_rad: f64) -> Plan {
        let p = self.params;
        let to = self.target - self.ego.position_m;
        let bearing = libm::atan2(to.y, to.x);
        let mut best =
            Plan { heading_rad: bearing, share: 1.0, mean_speed_mps: self.limits.v_max_mps, turn_rad: 0.0 };
        let (mut best_cost, mut best_index) = (f64::INFINITY, usize::MAX);
        // The old heading is often still the best: what it costs ends most of the others early.
        let change_rad = wrap(previous_rad - bearing);
        let off = |i: &usize| (DEFLECTIONS_RAD[*i] - change_rad).abs();
        let first = (0..DEFLECTIONS_RAD.len()).min_by(|a, b| off(a).total_cmp(&off(b)));
        for i in first.into_iter().chain(0..DEFLECTIONS_RAD.len()) {
            let deflection = DEFLECTIONS_RAD[i];
            let heading_rad = wrap(bearing + deflection);
            let side = if deflection > 0.0 { p.left_weight } else { p.right_weight };
            let bias = side * deflection.abs() + p.hysteresis_weight * wrap(heading_rad - previous_rad).abs();
            // Of equal ones the first wins, in whatever order they are looked at.
            let give_up = |cost: f64, index: usize| if i < index { cost.next_up() } else { cost };
            if bias >= give_up(best_cost, best_index) {
                continue;
            }
            let direction = unit(heading_rad);
            for share in SPEEDS {
                let base = bias + p.slow_weight * (1.0 - share);
                let give_up = give_up(best_cost, best_index);
                if base >= give_up {
                    continue;
                }
                if let Some((cost, mean_speed_mps)) = self.cost(direction, share, base, give_up) {
                    (best_cost, best_index) = (cost, i);
                    best = Plan { heading_rad, share, mean_speed_mps, turn_rad: 0.0 };
                }
            }
        }
        best
    }

    /// Cost and mean speed of a candidate, or `None` once the cost reaches `give_up`.
    #[inline(always)]
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
            h = self.turn.toward(h, aim);
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
            // What is left of the horizon is driven at no more than this share.
            let slow = (1.0 - share) * (STEPS - 1 - k) as f64 * dt;
            let rest = slow.min((1.0 / share - 1.0) * (left - LANDED_M) / v_max).max(0.0);
            if cost + lost + rest - ROUNDING_S >= give_up {
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
    #[inline(always)]
    fn slowed(&self, mut v: f64, p: Vec2, h: Vec2, k: usize) -> f64 {
        let rate = self.params.row_rate;
        for lane in self.others.slowing(p, k) {
            let offset = p - self.others.at(k, lane);
            let d = offset.norm_squared().sqrt().max(1e-6);
            let closing = -h.dot(&offset) / d;
            if closing > 0.0 {
                v = v.min(rate * (d - self.others.required_m[lane]).max(0.0) / closing);
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
    #[inline(always)]
    fn closeness(&self, p: Vec2, next: Vec2, k: usize, fade: f64, worst: &mut Lanes) -> f64 {
        let mut raised = 0.0;
        for lane in self.others.passing(p, next, k) {
            let (required_m, margin_m) = (self.others.required_m[lane], self.others.margin_m[lane]);
            // Closest approach inside the step: at 10 m/s relative speed the samples alone would miss it.
            let from = p - self.others.at(k, lane);
            let change = next - self.others.at(k + 1, lane) - from;
            let c2 = change.norm_squared();
            let s = if c2 > 1e-12 { (-from.dot(&change) / c2).clamp(0.0, 1.0) } else { 0.0 };
            let d2 = (from + change * s).norm_squared();
            let reach = required_m + margin_m;
            if d2 >= reach * reach {
                continue;
            }
            let gap = d2.sqrt() - required_m;
            let x = 1.0 - gap / margin_m;
            let overlap = (-gap).max(0.0) / required_m;
            let penalty = fade * (self.params.prox_weight * x * x + self.params.overlap_weight * overlap);
            if penalty > worst[lane] {
                raised += penalty - worst[lane];
                worst[lane] = penalty;
            }
        }
        raised
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::types::Intent;
    use proptest::prelude::*;

    proptest! {
        /// Wider registers do the same operations: the plans are the same to the bit.
        #[test]
        fn the_instruction_set_changes_no_bit(
            places in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -3.1..3.1f64), 1..=16),
            heading_rad in -3.1..3.1f64, previous_rad in -3.1..3.1f64, x in -9.0..9.0f64, y in -9.0..9.0f64,
        ) {
            let (limits, params) =
                (Limits { v_max_mps: 5.0, omega_max_radps: 1.0, period_s: 0.08 }, Params::default());
            let target_m = Vec2::new(x, y);
            let ego = Ego {
                id: 1, position_m: Vec2::zeros(), heading_rad, target_m, beyond_m: 0.0, v_mps: 1.0,
                omega_radps: 0.0, arrived: false,
            };
            let neighbours: Vec<Neighbour> = places.iter().enumerate().map(|(index, (x, y, heading_rad))| {
                let position_m = Vec2::new(*x, *y);
                let target_m = position_m + unit(*heading_rad) * 5.0;
                let intent =
                    Intent { heading_rad: *heading_rad, speed_mps: 2.0, target_m, ..Intent::default() };
                Neighbour {
                    index, position_m, heading_rad: *heading_rad, target_m, required_distance_m: 0.45, intent,
                    ..Neighbour::default()
                }
            }).collect();
            let mut predictions = Predictions::for_robots(neighbours.len());
            predictions.begin();
            let scene =
                Scene::new(&ego, target_m, &neighbours, &[], &limits, &params, &mut predictions, 1.0);
            let (wide, narrow) = (scene.best(previous_rad), scene.best_of_all(previous_rad));
            prop_assert_eq!(format!("{wide:?}"), format!("{narrow:?}"));
        }
    }
}
