//! A row of candidates on its way through the horizon, a step at a time.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::needless_range_loop, reason = "a lane indexes several arrays")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::candidates::Best;
use super::lanes::{Motion, Row, WIDTH, Wide};
use super::others::{Area, Which, least, most};
use super::predict::STEPS;
use super::scene::Scene;
use super::types::NEIGHBOURS_MAX;
use crate::geometry::{Vec2, unit};

/// Rounding that a bound of a cost is forgiven, s.
pub(super) const ROUNDING_S: f64 = 1e-9;
/// Close enough to the target to end the prediction.
pub(super) const LANDED_M: f64 = 0.05;
/// Closer than this to a static obstacle costs.
const OBSTACLE_MARGIN_M: f64 = 0.1;

impl Scene<'_> {
    /// The least that a candidate of this share still loses in so many steps, `left` m from the target, s.
    #[inline(always)]
    pub(super) fn behind(&self, share: f64, left: f64, steps: usize) -> f64 {
        let slow = (1.0 - share) * (steps as f64 * self.params.step_s);
        most(least(slow, (1.0 / share - 1.0) * (left - LANDED_M) / self.limits.v_max_mps), 0.0)
    }

    /// Takes the candidates of a row through the horizon, and empties it.
    #[inline(always)]
    pub(super) fn run(&self, row: &mut Row, best: &mut Best) {
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
        let mut area = at.area();
        let mut left = [left_at_start; WIDTH];
        let (mut time, mut fade) = (0.0, 1.0);
        let mut path = [0.0; WIDTH];
        let mut worst = [[0.0; WIDTH]; NEIGHBOURS_MAX];
        for k in 0..STEPS {
            let mut v = self.turn(&mut at, &left, row, time < params.hold_s);
            self.slow(&mut v, &at, &area, k);
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
            let next_area = next.area();
            let raised = self.closeness((&at, &area), (&next, &next_area), k, fade, &mut worst);
            (at, area) = (next, next_area);
            time += dt;
            let (mut lost, mut bound) = ([0.0; WIDTH], [0.0; WIDTH]);
            for lane in 0..WIDTH {
                row.cost[lane] += raised[lane] + scrape[lane] * fade * dt;
                let (to_x, to_y) = (self.target.x - at.x[lane], self.target.y - at.y[lane]);
                left[lane] = (to_x * to_x + to_y * to_y).sqrt();
                // Time lost against the straight way never shrinks, so it bounds the final cost from below.
                lost[lane] = time + (left[lane] - left_at_start) / v_max;
                // What is left of the horizon is driven at no more than the candidate's share.
                let rest = self.behind(row.share[lane], left[lane], STEPS - 1 - k);
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
            area = at.area();
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
    fn slow(&self, v: &mut Wide, at: &Motion, area: &Area, k: usize) {
        let rate = self.params.row_rate;
        for other in self.others.slowing(area, k) {
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
    pub(super) fn beside_obstacles(&self, mut v: f64, p: Vec2, h: Vec2) -> (f64, f64) {
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
        (at, area): (&Motion, &Area),
        (next, next_area): (&Motion, &Area),
        k: usize,
        fade: f64,
        worst: &mut [Wide; NEIGHBOURS_MAX],
    ) -> Wide {
        let params = self.params;
        let mut raised = [0.0; WIDTH];
        for other in self.others.passing(area, next_area, k) {
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
