//! The candidates of one decision, scored side by side.
//!
//! [`WIDTH`] candidates go through the horizon together, a step at a time (`rollout`): one instruction works on several
//! of them, and a neighbour that none of them comes near in a step is passed over once for all. A candidate that can no
//! longer win ends; the others go on. The cost of a candidate does not depend on which others stand beside it, and of
//! equal costs the first wins, so neither the order nor the width of the registers changes a decision.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::too_many_arguments, reason = "what a rule reads")]

use super::Params;
use super::candidates::{Best, DEFLECTIONS_RAD, SPEEDS, biases, by_bias};
use super::lanes::{Row, WIDTH};
use super::others::Others;
use super::predict::{Predictions, STEPS, Turn};
use super::rollout::ROUNDING_S;
use super::types::{Ego, Limits, Neighbour, ObstacleView, Plan};
use crate::geometry::{Vec2, unit, wrap};

/// Everything that all candidates share.
pub(super) struct Scene<'a> {
    pub(super) ego: &'a Ego,
    pub(super) target: Vec2,
    pub(super) obstacles: &'a [ObstacleView],
    pub(super) limits: &'a Limits,
    pub(super) params: &'a Params,
    pub(super) turn: Turn,
    pub(super) others: Others,
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
        let seen = |n: &&Neighbour| (n.position_m - ego.position_m).norm().max(1e-6) <= params.range_m;
        let neighbours = &neighbours[..neighbours.iter().take_while(seen).count()];
        predictions.learn(neighbours, turn, params);
        for n in neighbours {
            let margin_m = if n.arrived { params.parked_margin_m * patience } else { params.prox_margin_m };
            let slow_m = n.required_distance_m + limits.v_max_mps / params.row_rate;
            scene.others.push(n.position_m, predictions.of(n.index), n.required_distance_m, margin_m, slow_m);
        }
        scene
    }

    /// The candidate of the lowest cost, the first of several.
    pub(super) fn best(&self, previous_rad: f64) -> Plan {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
            {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.best_avx512(previous_rad) };
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.best_avx2(previous_rad) };
            }
        }
        self.best_of_all(previous_rad)
    }

    /// [`best_of_all`](Self::best_of_all) for wider registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn best_avx512(&self, previous_rad: f64) -> Plan {
        self.best_of_all(previous_rad)
    }

    /// [`best_of_all`](Self::best_of_all) for wide registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn best_avx2(&self, previous_rad: f64) -> Plan {
        self.best_of_all(previous_rad)
    }

    #[inline(always)]
    fn best_of_all(&self, previous_rad: f64) -> Plan {
        let p = self.params;
        let to = self.target - self.ego.position_m;
        let (bearing, left) = (libm::atan2(to.y, to.x), to.norm());
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
        let biases = biases(bearing, previous_rad, p);
        let order = by_bias(&biases);
        let mut row = Row::empty();
        // Full speed first: it seldom pays to go slower, and what is slower need not even start then.
        for (j, share) in SPEEDS.into_iter().enumerate() {
            let behind = self.behind(share, left, STEPS);
            for i in order {
                let (rank, base) = (i * SPEEDS.len() + j, biases[i] + p.slow_weight * (1.0 - share));
                if base + behind - ROUNDING_S >= best.give_up(rank) {
                    continue;
                }
                let heading_rad = wrap(bearing + DEFLECTIONS_RAD[i]);
                row.push(rank, heading_rad, unit(heading_rad), share, base);
                if row.count == WIDTH {
                    self.run(&mut row, &mut best);
                }
            }
        }
        self.run(&mut row, &mut best);
        best.plan
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::anticipate::arc_speed;
    use crate::guidance::predict::align;
    use crate::guidance::rollout::LANDED_M;
    use crate::guidance::types::{Intent, NEIGHBOURS_MAX};
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
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                let half = unsafe { scene.best_avx2(previous_rad) };
                prop_assert_eq!(format!("{half:?}"), format!("{narrow:?}"));
            }
            prop_assert_eq!(format!("{wide:?}"), format!("{:?}", best_one_by_one(&scene, previous_rad)));
        }
    }
}
