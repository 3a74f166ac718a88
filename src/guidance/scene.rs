//! The candidates of one decision, scored side by side.
//!
//! [`WIDTH`] candidates go through the horizon together, a step at a time (`rollout`): one instruction works on several
//! of them, and a neighbour that none of them comes near in a step is passed over once for all. A candidate that can no
//! longer win ends; the others go on. The cost of a candidate does not depend on which others stand beside it, and of
//! equal costs the first wins, so neither the order nor the width of the registers changes a decision.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use super::Params;
use super::candidates::{Best, DEFLECTIONS_RAD, SPEEDS, biases, directions};
use super::direction::unit;
use super::lanes::{Row, WIDTH, least, single};
use super::others::Others;
use super::predict::{Predictions, STEPS, Turn};
use super::rollout::ON_TARGET_M;
use super::shown::Shown;
use super::types::{Ego, Limits, ObstacleView, Plan};
use crate::geometry::{Vec2, bearing, wrap};

/// Share of the times that rounding may take off the bound of a cost; four times what it does.
const ROUNDING: f32 = 4e-6;

/// Everything that all candidates share; places are seen from the robot's, m.
pub(super) struct Scene<'a> {
    pub(super) ego: &'a Ego,
    pub(super) obstacles: &'a [ObstacleView],
    pub(super) params: &'a Params,
    /// Unit vector of the heading.
    pub(super) heading: (f32, f32),
    /// The target, and the distance to it.
    pub(super) to: (f32, f32),
    pub(super) left_m: f32,
    /// Rounding that a bound of a cost is forgiven, s.
    pub(super) forgiven_s: f32,
    pub(super) bearing_rad: f64,
    pub(super) turn: Turn,
    pub(super) scale: Scale,
    pub(super) others: &'a Others,
}

/// The parameters and the limits as a step uses them.
#[derive(Debug, Clone, Copy)]
pub(super) struct Scale {
    pub(super) v_max_mps: f32,
    pub(super) per_v_max: f32,
    pub(super) step_s: f32,
    pub(super) hold_s: f32,
    /// Speed share 0 here, and by how much it grows for each 1 of the cosine.
    pub(super) align_cos: f32,
    pub(super) per_align: f32,
    /// Half the turn rate at which arcs are driven.
    pub(super) arc_radps: f32,
    pub(super) row_rate: f32,
    /// What closeness costs, by how much that fades in a step, and what ending at a right angle does.
    pub(super) near_s: f32,
    pub(super) fade: f32,
    pub(super) turn_s: f32,
    pub(super) slow_s: f32,
}

impl Scale {
    fn new(limits: &Limits, params: &Params) -> Self {
        Self {
            v_max_mps: single(limits.v_max_mps),
            per_v_max: single(1.0 / limits.v_max_mps),
            step_s: single(params.step_s),
            hold_s: single(params.hold_s),
            align_cos: single(params.align_cos),
            per_align: single(1.0 / (1.0 - params.align_cos)),
            arc_radps: single(0.5 * params.arc_gain * limits.omega_max_radps),
            row_rate: single(params.row_rate),
            near_s: single(params.prox_weight),
            fade: single(params.prox_fade / STEPS as f64),
            turn_s: single(params.turn_weight),
            slow_s: single(params.slow_weight),
        }
    }
}

/// What a decision reads.
#[derive(Clone, Copy)]
pub(super) struct Asked<'a> {
    pub(super) ego: &'a Ego,
    pub(super) target_m: Vec2,
    pub(super) neighbours: &'a Shown<'a>,
    pub(super) obstacles: &'a [ObstacleView],
    pub(super) limits: &'a Limits,
    pub(super) params: &'a Params,
    pub(super) patience: f64,
    /// Heading that was steered to until now, rad.
    pub(super) previous_rad: f64,
}

impl Asked<'_> {
    /// The candidate of the lowest cost, the first of several.
    pub(super) fn best(&self, predictions: &mut Predictions) -> Plan {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
            {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.best_avx512(predictions) };
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.best_avx2(predictions) };
            }
        }
        self.best_of_all(predictions)
    }

    /// [`best_of_all`](Self::best_of_all) for wider registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn best_avx512(&self, predictions: &mut Predictions) -> Plan {
        self.best_of_all(predictions)
    }

    /// [`best_of_all`](Self::best_of_all) for wide registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn best_avx2(&self, predictions: &mut Predictions) -> Plan {
        self.best_of_all(predictions)
    }

    #[inline(always)]
    fn best_of_all(&self, predictions: &mut Predictions) -> Plan {
        let mut others = Others::none();
        Scene::new(self, predictions, &mut others).best(self.previous_rad)
    }
}

impl<'a> Scene<'a> {
    #[inline(always)]
    fn new(asked: &Asked<'a>, predictions: &mut Predictions, others: &'a mut Others) -> Self {
        let Asked { ego, target_m, neighbours, obstacles, limits, params, patience, .. } = *asked;
        let (turn, scale) = (predictions.turn(limits, params), Scale::new(limits, params));
        let count = neighbours.iter().take_while(|n| n.distance_m.max(1e-6) <= params.range_m).count();
        predictions.learn(neighbours, count, turn, params);
        let distances_m = (params.parked_margin_m * patience, limits.v_max_mps / params.row_rate);
        others.place(neighbours, count, distances_m, params);
        others.lay(|lane| predictions.of(neighbours, lane));
        let (to, heading) = (target_m - ego.position_m, unit(ego.heading_rad));
        let (x, y) = (single(to.x), single(to.y));
        let left_m = (x * x + y * y).sqrt();
        Self {
            ego,
            obstacles,
            params,
            heading: (single(heading.x), single(heading.y)),
            to: (x, y),
            left_m,
            forgiven_s: ROUNDING * (STEPS as f32 * scale.step_s + left_m * scale.per_v_max),
            bearing_rad: bearing(to),
            turn,
            scale,
            others,
        }
    }

    #[inline(always)]
    fn best(&self, previous_rad: f64) -> Plan {
        let mut best = Best { cost: f32::INFINITY, rank: usize::MAX, mean_speed_mps: self.scale.v_max_mps };
        let biases = biases(single(wrap(self.bearing_rad - previous_rad)), self.params);
        let (x, y) = self.ahead();
        let (direction_x, direction_y) = directions(x, y);
        // Full speed first: it seldom pays to go slower, and what is slower need not even start then. Nothing is known yet
        // that would keep one of the first row from starting.
        let mut row = Row::empty();
        for lane in 0..WIDTH {
            row.rank[lane] = lane * SPEEDS.len();
            (row.ways.direction_x[lane], row.ways.direction_y[lane]) = (direction_x[lane], direction_y[lane]);
            row.ways.share[lane] = SPEEDS[0];
            row.cost[lane] = biases[lane];
        }
        row.count = WIDTH;
        let (mut i, mut j) = (WIDTH, 0);
        let slower = SPEEDS.map(|share| 1.0 / share - 1.0);
        let behind: [f32; SPEEDS.len()] =
            std::array::from_fn(|j| self.behind(SPEEDS[j], slower[j], self.left_m, STEPS));
        let least_bias_s = biases.into_iter().fold(f32::INFINITY, least);
        while j < SPEEDS.len() {
            while row.count < WIDTH && j < SPEEDS.len() {
                let share = SPEEDS[j];
                let least_s = least_bias_s + self.scale.slow_s * (1.0 - share) + behind[j] - self.forgiven_s;
                if i == 0 && least_s > best.cost {
                    // Whichever way, this slow it does not win.
                    j += 1;
                    continue;
                }
                let (rank, base) = (i * SPEEDS.len() + j, biases[i] + self.scale.slow_s * (1.0 - share));
                if base + behind[j] - self.forgiven_s < best.give_up(rank) {
                    row.push(rank, (direction_x[i], direction_y[i]), (share, slower[j]), base);
                }
                i += 1;
                if i == DEFLECTIONS_RAD.len() {
                    (i, j) = (0, j + 1);
                }
            }
            // In one place only: it is long.
            self.run(&mut row, &mut best);
        }
        let (deflection, share) = (best.rank / SPEEDS.len(), best.rank % SPEEDS.len());
        Plan {
            heading_rad: wrap(self.bearing_rad + DEFLECTIONS_RAD.get(deflection).unwrap_or(&0.0)),
            share: f64::from(SPEEDS[share]),
            mean_speed_mps: f64::from(best.mean_speed_mps),
            turn_rad: 0.0,
        }
    }

    /// Unit vector to the target.
    #[inline(always)]
    fn ahead(&self) -> (f32, f32) {
        let (x, y) = self.to;
        if self.left_m < ON_TARGET_M { (1.0, 0.0) } else { (x / self.left_m, y / self.left_m) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::rollout::LANDED_M;
    use crate::guidance::shown::with_all;
    use crate::guidance::types::{Intent, NEIGHBOURS_MAX, Neighbour};
    use crate::model::Obstacle;
    use proptest::prelude::*;

    fn norm((x, y): (f32, f32)) -> f32 {
        (x * x + y * y).sqrt()
    }

    fn dot(a: (f32, f32), b: (f32, f32)) -> f32 {
        a.0 * b.0 + a.1 * b.1
    }

    fn minus(a: (f32, f32), b: (f32, f32)) -> (f32, f32) {
        (a.0 - b.0, a.1 - b.1)
    }

    /// The cost and the mean speed of one candidate, step by step as the rule says it.
    fn cost(scene: &Scene, direction: (f32, f32), share: f32, base: f32) -> (f32, f32) {
        let scale = &scene.scale;
        let double = |(x, y): (f32, f32)| Vec2::new(f64::from(x), f64::from(y));
        let (mut p, mut h) = ((0.0, 0.0), scene.heading);
        let (mut cost, mut fade, mut left) = (base, 1.0, scene.left_m);
        let (mut time, mut path, mut lost) = (0.0, 0.0, 0.0);
        let mut worst = [0.0f32; NEIGHBOURS_MAX];
        for k in 0..STEPS {
            let to = minus(scene.to, p);
            let per_m = 1.0 / left;
            let steered = time < scale.hold_s || left < ON_TARGET_M;
            let aim = if steered { direction } else { (to.0 * per_m, to.1 * per_m) };
            h = scene.turn.toward(h, aim);
            let aligned = ((dot(h, aim) - scale.align_cos) * scale.per_align).clamp(0.0, 1.0);
            let arc = scale.arc_radps * left * left / (h.0 * to.1 - h.1 * to.0).abs();
            let mut v = (scale.v_max_mps * share * aligned).min(arc);
            for other in 0..NEIGHBOURS_MAX {
                let offset = minus(p, scene.others.at(k, other));
                let d = norm(offset).max(1e-6);
                let closing = -dot(h, offset);
                if dot(offset, offset) <= scene.others.slow_m2[other] && closing > 0.0 {
                    v = v.min(scale.row_rate * (d - scene.others.required_m[other]).max(0.0) * d / closing);
                }
            }
            let (v, scrape) = scene.beside_obstacles(v, scene.ego.position_m + double(p), double(h));
            let travel = (v * scale.step_s).min(left);
            let next = (p.0 + h.0 * travel, p.1 + h.1 * travel);
            let mut raised = 0.0;
            for (other, worst) in worst.iter_mut().enumerate() {
                let from = minus(p, scene.others.at(k, other));
                let change = minus(minus(next, scene.others.at(k + 1, other)), from);
                let c2 = dot(change, change);
                let s = if c2 > 0.0 { (-dot(from, change) / c2).clamp(0.0, 1.0) } else { 0.0 };
                let gap =
                    norm((from.0 + change.0 * s, from.1 + change.1 * s)) - scene.others.required_m[other];
                let share = (1.0 - gap * scene.others.per_margin[other]).max(0.0);
                let penalty = fade * scale.near_s * share * share
                    + fade * scene.others.overlap_s[other] * (-gap).max(0.0);
                raised += (penalty - *worst).max(0.0);
                *worst = worst.max(penalty);
            }
            cost += raised + scrape * (fade * scale.step_s);
            p = next;
            path += travel;
            time += scale.step_s;
            fade -= scale.fade;
            left = norm(minus(scene.to, p));
            lost = time + (left - scene.left_m) * scale.per_v_max;
            if left < LANDED_M {
                break;
            }
        }
        let misaligned = if left < LANDED_M { 0.0 } else { 1.0 - dot(h, minus(scene.to, p)) / left };
        cost += lost + scale.turn_s * misaligned;
        (cost, path / time)
    }

    /// All candidates one by one, none given up.
    fn best_one_by_one(scene: &Scene, previous_rad: f64) -> Plan {
        let biases = biases(single(wrap(scene.bearing_rad - previous_rad)), scene.params);
        let (x, y) = scene.ahead();
        let (direction_x, direction_y) = directions(x, y);
        let (mut best, mut lowest) = (Plan::default(), f32::INFINITY);
        for (i, deflection) in DEFLECTIONS_RAD.into_iter().enumerate() {
            for share in SPEEDS {
                let base = biases[i] + scene.scale.slow_s * (1.0 - share);
                let (cost, mean_speed_mps) = cost(scene, (direction_x[i], direction_y[i]), share, base);
                if cost < lowest {
                    lowest = cost;
                    best = Plan {
                        heading_rad: wrap(scene.bearing_rad + deflection),
                        share: f64::from(share),
                        mean_speed_mps: f64::from(mean_speed_mps),
                        turn_rad: 0.0,
                    };
                }
            }
        }
        best
    }

    /// In which corner of the field: rounding differs with the size of the numbers.
    const CORNERS_M: [f64; 3] = [0.0, 300.0, -20_000.0];

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(1000))]
        /// Neither wider registers, nor going side by side, nor ending early: the plans are the same to the bit. Among
        /// robots that drive, robots that have arrived, and discs and walls; with much patience and with little.
        #[test]
        fn neither_width_nor_order_changes_a_bit(
            places in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -3.1..3.1f64, 0..4u32), 0..=16),
            bodies in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -1.0..1.0f64, -1.0..1.0f64, 0..3u32), 0..=3),
            (heading_rad, previous_rad) in (-3.1..3.1f64, -3.1..3.1f64),
            (x, y, near) in (-9.0..9.0f64, -9.0..9.0f64, 0..4u32),
            (corner, v_max_mps) in (prop::sample::select(&CORNERS_M), prop::sample::select(vec![1.5, 5.0])),
            patience in prop_oneof![Just(1.0), 0.05..1.0f64],
        ) {
            let (limits, params) =
                (Limits { v_max_mps, omega_max_radps: 1.0, period_s: 0.08 }, Params::default());
            let here = Vec2::new(corner, 0.5 * corner);
            // Often so near that some land.
            let target_m = here + Vec2::new(x, y) * if near == 0 { 0.1 } else { 1.0 };
            let ego = Ego {
                id: 1, position_m: here, heading_rad, target_m, beyond_m: 0.0, v_mps: 1.0, omega_radps: 0.0,
                arrived: false,
            };
            let neighbours: Vec<Neighbour> = places.iter().map(|(x, y, heading_rad, kind)| {
                let position_m = here + Vec2::new(*x, *y);
                let target_m = position_m + unit(*heading_rad) * 5.0;
                let intent =
                    Intent { heading_rad: *heading_rad, speed_mps: 2.0, target_m, ..Intent::default() };
                Neighbour {
                    position_m, heading_rad: *heading_rad, target_m, intent,
                    arrived: *kind == 0, ..Neighbour::default()
                }
            }).collect();
            let obstacles: Vec<ObstacleView> = bodies.iter().map(|(x, y, dx, dy, kind)| {
                let centre_m = here + Vec2::new(*x, *y);
                let obstacle = match kind {
                    0 => Obstacle::Circle { centre_m, radius_m: dx.abs() },
                    1 => Obstacle::Circle { centre_m, radius_m: 0.0 },
                    _ => Obstacle::Segment { from_m: centre_m, to_m: centre_m + Vec2::new(*dx, *dy) },
                };
                ObstacleView { obstacle, keep_m: 0.25 }
            }).collect();
            let mut predictions = Predictions::for_robots(neighbours.len());
            predictions.begin();
            with_all(here, 0.45, (&neighbours, true), |shown| {
            let asked = Asked {
                ego: &ego, target_m, neighbours: shown, obstacles: &obstacles, limits: &limits,
                params: &params, patience, previous_rad,
            };
            let (wide, narrow) = (asked.best(&mut predictions), asked.best_of_all(&mut predictions));
            prop_assert_eq!(format!("{wide:?}"), format!("{narrow:?}"));
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                let half = unsafe { asked.best_avx2(&mut predictions) };
                prop_assert_eq!(format!("{half:?}"), format!("{narrow:?}"));
            }
            let mut others = Others::none();
            let scene = Scene::new(&asked, &mut predictions, &mut others);
            prop_assert_eq!(format!("{wide:?}"), format!("{:?}", best_one_by_one(&scene, previous_rad)));
            Ok(())
            })?;
        }
    }
}
