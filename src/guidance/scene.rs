//! The candidates of one decision, scored side by side.
//!
//! [`WIDTH`] candidates go through the horizon together, a step at a time: one instruction works on several of them, and
//! a neighbour that none of them comes near in a step is passed over once for all. A candidate that can no longer win
//! ends; the others go on. The cost of a candidate does not depend on which others stand beside it, and of equal costs
//! the first wins, so neither the order nor the width of the registers changes a decision.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::too_many_arguments, reason = "what a rule reads")]
#![expect(clippy::needless_range_loop, reason = "a lane indexes several arrays")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::Params;
use super::others::{Area, Others, Which, least, most};
use super::predict::{Predictions, STEPS, Turn};
use super::types::{Ego, Limits, NEIGHBOURS_MAX, Neighbour, ObstacleView, Plan};
use crate::geometry::{Vec2, unit, wrap};

/// Candidates that go side by side.
const WIDTH: usize = 8;
/// One number for each of them.
type Wide = [f64; WIDTH];

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
/// Everything that all candidates share.
pub(super) struct Scene<'a> {
    ego: &'a Ego,
    target: Vec2,
    obstacles: &'a [ObstacleView],
    limits: &'a Limits,
    params: &'a Params,
    turn: Turn,
    others: Others,
}

impl<'a> Scene<'a> {
    pub(super) fn new(
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
    pub(super) fn best(&self, previous_rad: f64) -> Plan {
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
        let mut best = Best {
            cost: f64::INFINITY,
            rank: usize::MAX,
            plan: Plan {
                heading_rad: bearing,
                share: 1.0,
                mean_speed_mps: self.limits.v_max_mps,
                turn_rad: 0.0,
            },
        };
        // The old heading is often still the best: what it costs ends most of the others early.
        let change_rad = wrap(previous_rad - bearing);
        let off = |i: &usize| (DEFLECTIONS_RAD[*i] - change_rad).abs();
        let first = (0..DEFLECTIONS_RAD.len()).min_by(|a, b| off(a).total_cmp(&off(b)));
        let others = (0..DEFLECTIONS_RAD.len()).filter(|i| Some(*i) != first);
        let mut row = Row::empty();
        for i in first.into_iter().chain(others) {
            let deflection = DEFLECTIONS_RAD[i];
            let heading_rad = wrap(bearing + deflection);
            let side = if deflection > 0.0 { p.left_weight } else { p.right_weight };
            let bias = side * deflection.abs() + p.hysteresis_weight * wrap(heading_rad - previous_rad).abs();
            if bias >= best.give_up(i * SPEEDS.len()) {
                continue;
            }
            let direction = unit(heading_rad);
            for (j, share) in SPEEDS.into_iter().enumerate() {
                let (rank, base) = (i * SPEEDS.len() + j, bias + p.slow_weight * (1.0 - share));
                if base >= best.give_up(rank) {
                    continue;
                }
                row.push(rank, heading_rad, direction, share, base);
                if row.count == WIDTH {
                    self.run(&mut row, &mut best);
                }
            }
        }
        self.run(&mut row, &mut best);
        best.plan
    }

    /// Takes the candidates of a row through the horizon, and empties it.
    #[inline(always)]
    fn run(&self, row: &mut Row, best: &mut Best) {
        if row.count == 0 {
            return;
        }
        let params = self.params;
        let (v_max, dt) = (self.limits.v_max_mps, params.step_s);
        let start = self.ego.position_m;
        let heading = unit(self.ego.heading_rad);
        let left_at_start = (self.target - start).norm();
        let mut give_up = [f64::NEG_INFINITY; WIDTH];
        for lane in 0..row.count {
            give_up[lane] = best.give_up(row.rank[lane]);
        }
        for lane in row.count..WIDTH {
            row.repeat(0, lane);
        }
        let mut alive = (1u32 << row.count) - 1;
        row.count = 0;
        let mut at = Motion {
            x: [start.x; WIDTH],
            y: [start.y; WIDTH],
            hx: [heading.x; WIDTH],
            hy: [heading.y; WIDTH],
        };
        let mut left = [left_at_start; WIDTH];
        let (mut time, mut fade) = (0.0, 1.0);
        let mut path = [0.0; WIDTH];
        let mut worst = [[0.0; WIDTH]; NEIGHBOURS_MAX];
        for k in 0..STEPS {
            let mut v = self.turn(&mut at, &left, row, time < params.hold_s);
            self.slow(&mut v, &at, k);
            let mut scrape = [0.0; WIDTH];
            if !self.obstacles.is_empty() {
                for lane in 0..WIDTH {
                    let (p, h) = (Vec2::new(at.x[lane], at.y[lane]), Vec2::new(at.hx[lane], at.hy[lane]));
                    (v[lane], scrape[lane]) = self.beside_obstacles(v[lane], p, h);
                }
            }
            let mut next = at;
            for lane in 0..WIDTH {
                let travel = least(v[lane] * dt, left[lane]);
                next.x[lane] = at.x[lane] + at.hx[lane] * travel;
                next.y[lane] = at.y[lane] + at.hy[lane] * travel;
                path[lane] += travel;
            }
            let raised = self.closeness(&at, &next, k, fade, &mut worst);
            at = next;
            time += dt;
            // What is left of the horizon is driven at no more than the candidate's share.
            let steps_s = (STEPS - 1 - k) as f64 * dt;
            let (mut lost, mut bound) = ([0.0; WIDTH], [0.0; WIDTH]);
            for lane in 0..WIDTH {
                row.cost[lane] += raised[lane] + scrape[lane] * fade * dt;
                let (to_x, to_y) = (self.target.x - at.x[lane], self.target.y - at.y[lane]);
                left[lane] = (to_x * to_x + to_y * to_y).sqrt();
                // Time lost against the straight way never shrinks, so it bounds the final cost from below.
                lost[lane] = time + (left[lane] - left_at_start) / v_max;
                let share = row.share[lane];
                let slow = (1.0 - share) * steps_s;
                let rest = most(least(slow, (1.0 / share - 1.0) * (left[lane] - LANDED_M) / v_max), 0.0);
                bound[lane] = row.cost[lane] + lost[lane] + rest - ROUNDING_S;
            }
            fade -= params.prox_fade / STEPS as f64;
            let (mut beaten, mut landed) = (0, 0);
            for lane in 0..WIDTH {
                beaten |=
                    u32::from((row.cost[lane] >= give_up[lane]) | (bound[lane] >= give_up[lane])) << lane;
                landed |= u32::from(left[lane] < LANDED_M) << lane;
            }
            let last = if k + 1 == STEPS { alive } else { landed & alive };
            for lane in Which(last & !beaten) {
                let to = self.target - Vec2::new(at.x[lane], at.y[lane]);
                let h = Vec2::new(at.hx[lane], at.hy[lane]);
                let misaligned = if left[lane] < LANDED_M { 0.0 } else { 1.0 - h.dot(&to) / left[lane] };
                let cost = row.cost[lane] + (lost[lane] + params.turn_weight * misaligned);
                best.offer(cost, row.rank[lane], row.heading_rad[lane], row.share[lane], path[lane] / time);
            }
            let ended = alive & (beaten | last);
            if ended == 0 {
                continue;
            }
            alive &= !ended;
            if alive == 0 {
                return;
            }
            // Who has ended goes where another one goes, so that it is no work of its own.
            let with = alive.trailing_zeros() as usize;
            for lane in Which(ended) {
                row.repeat(with, lane);
                at.repeat(with, lane);
                left[lane] = left[with];
            }
        }
    }

    /// Turns the headings by one step; how fast the candidates may then go.
    #[inline(always)]
    fn turn(&self, at: &mut Motion, left: &Wide, row: &Row, hold: bool) -> Wide {
        let (limits, params) = (self.limits, self.params);
        let mut v = [0.0; WIDTH];
        for lane in 0..WIDTH {
            let (hx, hy) = (at.hx[lane], at.hy[lane]);
            let (to_x, to_y) = (self.target.x - at.x[lane], self.target.y - at.y[lane]);
            let steered = hold | (left[lane] < 1e-9);
            let aim_x = if steered { row.direction_x[lane] } else { to_x / left[lane] };
            let aim_y = if steered { row.direction_y[lane] } else { to_y / left[lane] };
            let near = hx * aim_x + hy * aim_y >= self.turn.cos;
            let sin = if hx * aim_y - hy * aim_x >= 0.0 { self.turn.sin } else { -self.turn.sin };
            let cos = self.turn.cos;
            let hx1 = if near { aim_x } else { hx * cos - hy * sin };
            let hy1 = if near { aim_y } else { hx * sin + hy * cos };
            (at.hx[lane], at.hy[lane]) = (hx1, hy1);
            let share = (hx1 * aim_x + hy1 * aim_y - params.align_cos) / (1.0 - params.align_cos);
            let fast = limits.v_max_mps * row.share[lane] * least(most(share, 0.0), 1.0);
            // As `arc_speed`.
            let sideways = (hx1 * to_y - hy1 * to_x).abs();
            let arc = params.arc_gain * limits.omega_max_radps * left[lane] * left[lane] / (2.0 * sideways);
            v[lane] = if (sideways > 1e-9) & (arc < fast) { arc } else { fast };
        }
        v
    }

    /// Slows down to the speed that the hard rows of the neighbours would leave.
    #[inline(always)]
    fn slow(&self, v: &mut Wide, at: &Motion, k: usize) {
        let rate = self.params.row_rate;
        for other in self.others.slowing(&at.area(), k) {
            let (place, required_m, slow_m2) =
                (self.others.at(k, other), self.others.required_m[other], self.others.slow_m2[other]);
            for lane in 0..WIDTH {
                let (x, y) = (at.x[lane] - place.x, at.y[lane] - place.y);
                let d2 = x * x + y * y;
                let d = most(d2.sqrt(), 1e-6);
                let closing = -(at.hx[lane] * x + at.hy[lane] * y) / d;
                let limit = rate * most(d - required_m, 0.0) / closing;
                // Stored whatever comes out: a conditional store would hold up the next neighbour's loads.
                let slows = (d2 <= slow_m2) & (closing > 0.0);
                v[lane] = least(if slows { limit } else { f64::INFINITY }, v[lane]);
            }
        }
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
    fn closeness(
        &self,
        at: &Motion,
        next: &Motion,
        k: usize,
        fade: f64,
        worst: &mut [Wide; NEIGHBOURS_MAX],
    ) -> Wide {
        let params = self.params;
        let mut raised = [0.0; WIDTH];
        for other in self.others.passing(&at.area(), &next.area(), k) {
            let (required_m, margin_m) = (self.others.required_m[other], self.others.margin_m[other]);
            let (before, after) = (self.others.at(k, other), self.others.at(k + 1, other));
            let reach_m2 = (required_m + margin_m) * (required_m + margin_m);
            let worst = &mut worst[other];
            for lane in 0..WIDTH {
                // Closest approach inside the step: at 10 m/s relative speed the samples alone would miss it.
                let (from_x, from_y) = (at.x[lane] - before.x, at.y[lane] - before.y);
                let change_x = next.x[lane] - after.x - from_x;
                let change_y = next.y[lane] - after.y - from_y;
                let c2 = change_x * change_x + change_y * change_y;
                let along = -(from_x * change_x + from_y * change_y) / c2;
                let s = if c2 > 1e-12 { least(most(along, 0.0), 1.0) } else { 0.0 };
                let (x, y) = (from_x + change_x * s, from_y + change_y * s);
                let d2 = x * x + y * y;
                let gap = d2.sqrt() - required_m;
                let share = 1.0 - gap / margin_m;
                let overlap = most(-gap, 0.0) / required_m;
                let penalty = fade * (params.prox_weight * share * share + params.overlap_weight * overlap);
                let highest = most(if d2 < reach_m2 { penalty } else { 0.0 }, worst[lane]);
                raised[lane] += highest - worst[lane];
                worst[lane] = highest;
            }
        }
        raised
    }
}

/// Where the candidates of a row are, and their headings.
#[derive(Clone, Copy)]
struct Motion {
    x: Wide,
    y: Wide,
    hx: Wide,
    hy: Wide,
}

impl Motion {
    #[inline(always)]
    fn area(&self) -> Area {
        let mut area = Area { min: Vec2::new(self.x[0], self.y[0]), max: Vec2::new(self.x[0], self.y[0]) };
        for lane in 1..WIDTH {
            area.min.x = least(area.min.x, self.x[lane]);
            area.min.y = least(area.min.y, self.y[lane]);
            area.max.x = most(area.max.x, self.x[lane]);
            area.max.y = most(area.max.y, self.y[lane]);
        }
        area
    }

    fn repeat(&mut self, from: usize, to: usize) {
        for wide in [&mut self.x, &mut self.y, &mut self.hx, &mut self.hy] {
            wide[to] = wide[from];
        }
    }
}

/// Candidates that go side by side, and what they have cost so far.
struct Row {
    count: usize,
    rank: [usize; WIDTH],
    heading_rad: Wide,
    direction_x: Wide,
    direction_y: Wide,
    share: Wide,
    cost: Wide,
}

impl Row {
    fn empty() -> Self {
        let none = [0.0; WIDTH];
        Self {
            count: 0,
            rank: [0; WIDTH],
            heading_rad: none,
            direction_x: none,
            direction_y: none,
            share: none,
            cost: none,
        }
    }

    fn push(&mut self, rank: usize, heading_rad: f64, direction: Vec2, share: f64, base: f64) {
        let lane = self.count;
        (self.rank[lane], self.heading_rad[lane]) = (rank, heading_rad);
        (self.direction_x[lane], self.direction_y[lane]) = (direction.x, direction.y);
        (self.share[lane], self.cost[lane]) = (share, base);
        self.count += 1;
    }

    /// Makes one lane do what another does.
    fn repeat(&mut self, from: usize, to: usize) {
        for wide in [&mut self.direction_x, &mut self.direction_y, &mut self.share] {
            wide[to] = wide[from];
        }
    }
}

/// The best candidate so far.
struct Best {
    cost: f64,
    /// Its place among all: of equal ones the first wins, in whatever order they are looked at.
    rank: usize,
    plan: Plan,
}

impl Best {
    /// The cost from which on the candidate of this place does not win.
    fn give_up(&self, rank: usize) -> f64 {
        if rank < self.rank { self.cost.next_up() } else { self.cost }
    }

    fn offer(&mut self, cost: f64, rank: usize, heading_rad: f64, share: f64, mean_speed_mps: f64) {
        if cost < self.give_up(rank) {
            *self = Self { cost, rank, plan: Plan { heading_rad, share, mean_speed_mps, turn_rad: 0.0 } };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::anticipate::arc_speed;
    use crate::guidance::predict::align;
    use crate::guidance::types::Intent;
    use proptest::prelude::*;

    /// The cost and the mean speed of one candidate, step by step as the rule says it.
    fn cost(scene: &Scene, direction: Vec2, share: f64, base: f64) -> (f64, f64) {
        let (params, limits) = (scene.params, scene.limits);
        let (v_max, dt) = (limits.v_max_mps, params.step_s);
        let mut p = scene.ego.position_m;
        let mut h = unit(scene.ego.heading_rad);
        let (mut cost, mut fade, mut left) = (base, 1.0, (scene.target - p).norm());
        let left_at_start = left;
        let (mut time, mut path, mut lost) = (0.0, 0.0, 0.0);
        let mut worst = [0.0f64; NEIGHBOURS_MAX];
        for k in 0..STEPS {
            let to = scene.target - p;
            let aim = if time < params.hold_s || left < 1e-9 { direction } else { to / left };
            h = scene.turn.toward(h, aim);
            let mut v =
                (v_max * share * align(h.dot(&aim), params)).min(arc_speed(h, to, left, limits, params));
            for other in 0..NEIGHBOURS_MAX {
                let offset = p - scene.others.at(k, other);
                let d = offset.norm().max(1e-6);
                let closing = -h.dot(&offset) / d;
                if offset.norm_squared() <= scene.others.slow_m2[other] && closing > 0.0 {
                    v = v.min(params.row_rate * (d - scene.others.required_m[other]).max(0.0) / closing);
                }
            }
            let (v, scrape) = scene.beside_obstacles(v, p, h);
            let travel = (v * dt).min(left);
            let next = p + h * travel;
            let mut raised = 0.0;
            for (other, worst) in worst.iter_mut().enumerate() {
                let (required_m, margin_m) = (scene.others.required_m[other], scene.others.margin_m[other]);
                let from = p - scene.others.at(k, other);
                let change = next - scene.others.at(k + 1, other) - from;
                let c2 = change.norm_squared();
                let s = if c2 > 1e-12 { (-from.dot(&change) / c2).clamp(0.0, 1.0) } else { 0.0 };
                let d2 = (from + change * s).norm_squared();
                if d2 >= (required_m + margin_m) * (required_m + margin_m) {
                    continue;
                }
                let gap = d2.sqrt() - required_m;
                let x = 1.0 - gap / margin_m;
                let overlap = (-gap).max(0.0) / required_m;
                let penalty = fade * (params.prox_weight * x * x + params.overlap_weight * overlap);
                raised += (penalty - *worst).max(0.0);
                *worst = worst.max(penalty);
            }
            cost += raised + scrape * fade * dt;
            p = next;
            path += travel;
            time += dt;
            fade -= params.prox_fade / STEPS as f64;
            left = (scene.target - p).norm();
            lost = time + (left - left_at_start) / v_max;
            if left < LANDED_M {
                break;
            }
        }
        let misaligned = if left < LANDED_M { 0.0 } else { 1.0 - h.dot(&(scene.target - p)) / left };
        cost += lost + params.turn_weight * misaligned;
        (cost, path / time)
    }

    /// All candidates one by one, none given up.
    fn best_one_by_one(scene: &Scene, previous_rad: f64) -> Plan {
        let p = scene.params;
        let to = scene.target - scene.ego.position_m;
        let bearing = libm::atan2(to.y, to.x);
        let (mut best, mut lowest) = (Plan::default(), f64::INFINITY);
        for deflection in DEFLECTIONS_RAD {
            let heading_rad = wrap(bearing + deflection);
            let side = if deflection > 0.0 { p.left_weight } else { p.right_weight };
            let bias = side * deflection.abs() + p.hysteresis_weight * wrap(heading_rad - previous_rad).abs();
            for share in SPEEDS {
                let base = bias + p.slow_weight * (1.0 - share);
                let (cost, mean_speed_mps) = cost(scene, unit(heading_rad), share, base);
                if cost < lowest {
                    lowest = cost;
                    best = Plan { heading_rad, share, mean_speed_mps, turn_rad: 0.0 };
                }
            }
        }
        best
    }

    proptest! {
        /// Neither wider registers, nor going side by side, nor ending early: the plans are the same to the bit.
        #[test]
        fn neither_width_nor_order_changes_a_bit(
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
            prop_assert_eq!(format!("{wide:?}"), format!("{:?}", best_one_by_one(&scene, previous_rad)));
        }
    }
}
