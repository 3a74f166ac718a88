//! A row of candidates on its way through the horizon, a step at a time.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(
    clippy::large_types_passed_by_value,
    reason = "of what is lent, a step could not be kept in registers"
)]
#![expect(clippy::needless_range_loop, reason = "a lane indexes several arrays")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::candidates::Best;
use super::lanes::{Area, Motion, Row, WIDTH, Ways, Which, Wide, bits, least, most, single};
use super::predict::STEPS;
use super::scene::Scene;
use super::types::NEIGHBOURS_MAX;
use crate::geometry::Vec2;

/// Close enough to the target to end the prediction.
pub(super) const LANDED_M: f32 = 0.05;
/// Closer than this to a static obstacle costs.
const OBSTACLE_MARGIN_M: f64 = 0.1;
/// Nearer than this to the target the bearing of it is rounding.
pub(super) const ON_TARGET_M: f32 = 1e-6;

impl Scene<'_> {
    /// The least that a candidate still loses in so many steps, `left` m from the target, s; `slower` is one less than
    /// one over its share of the full speed.
    #[inline(always)]
    pub(super) fn behind(&self, share: f32, slower: f32, left: f32, steps: usize) -> f32 {
        let slow = (1.0 - share) * (steps as f32 * self.scale.step_s);
        most(least(slow, slower * (left - LANDED_M) * self.scale.per_v_max), 0.0)
    }

    /// Takes the candidates of a row through the horizon, and empties it.
    #[inline(always)]
    pub(super) fn run(&self, row: &mut Row, best: &mut Best) {
        if row.count == 0 {
            return;
        }
        let scale = &self.scale;
        let mut give_up = [f32::NEG_INFINITY; WIDTH];
        for lane in 0..row.count {
            give_up[lane] = best.give_up(row.rank[lane]);
        }
        // Lanes without a candidate go along, as do those whose candidate has ended; nobody looks where they are.
        let mut alive = (1u32 << row.count) - 1;
        let ways = row.ways;
        let mut cost = row.cost;
        row.count = 0;
        let mut at = Motion {
            x: [0.0; WIDTH],
            y: [0.0; WIDTH],
            hx: [self.heading.0; WIDTH],
            hy: [self.heading.1; WIDTH],
            left: [self.left_m; WIDTH],
            path: [0.0; WIDTH],
        };
        let mut area = Area { min_x: 0.0, min_y: 0.0, max_x: 0.0, max_y: 0.0 };
        let (mut time, mut fade, mut faded) = (0.0, 1.0, 1.0);
        let mut worst = Worst([[0.0; WIDTH]; NEIGHBOURS_MAX]);
        let (mut start, mut passing, mut scrape) = (at, Which(0), [0.0; WIDTH]);
        // A step is judged when the next has been begun: where that leads does not wait for what this costs.
        for k in 0..=STEPS {
            let (here, passed, scraped) = (at, passing, scrape);
            passing = Which(0);
            if k < STEPS {
                let mut v = self.turn(&mut at, &ways, time < scale.hold_s);
                v = self.slow(v, &at, &area, k);
                if !self.obstacles.is_empty() {
                    (v, scrape) = self.scraped(alive, v, at);
                }
                for lane in 0..WIDTH {
                    let travel = least(v[lane] * scale.step_s, at.left[lane]);
                    at.x[lane] += at.hx[lane] * travel;
                    at.y[lane] += at.hy[lane] * travel;
                    at.path[lane] += travel;
                    let (to_x, to_y) = (self.to.0 - at.x[lane], self.to.1 - at.y[lane]);
                    at.left[lane] = (to_x * to_x + to_y * to_y).sqrt();
                }
                let to = Area::around(&at.x, &at.y, alive);
                passing = self.others.passing(&area, &to, k);
                area = to;
            }
            if k > 0 {
                let raised = self.closeness(passed, &start, &here, k - 1, faded, &mut worst);
                let (mut lost, mut beaten, mut landed) = ([0.0; WIDTH], [false; WIDTH], [false; WIDTH]);
                for lane in 0..WIDTH {
                    cost[lane] += raised[lane] + scraped[lane] * (faded * scale.step_s);
                    let left = here.left[lane];
                    // Time lost against the straight way never shrinks, so it bounds the final cost from below.
                    lost[lane] = time + (left - self.left_m) * scale.per_v_max;
                    // What is left of the horizon is driven at no more than the candidate's share.
                    let rest = self.behind(ways.share[lane], ways.slower[lane], left, STEPS - k);
                    beaten[lane] = cost[lane] + lost[lane] + rest - self.forgiven_s >= give_up[lane];
                    landed[lane] = left < LANDED_M;
                }
                let beaten = bits(beaten) & alive;
                let last = if k == STEPS { alive } else { bits(landed) & alive };
                if last & !beaten != 0 {
                    *best = self.offered(last & !beaten, &here, [&cost, &lost], &row.rank, time, *best);
                }
                alive &= !(beaten | last);
                if alive == 0 {
                    return;
                }
            }
            start = here;
            (faded, fade) = (fade, fade - scale.fade);
            time += scale.step_s;
        }
    }

    /// The best of these candidates, which have come to their end, and of those before.
    #[cold]
    #[inline(never)]
    fn offered(
        &self,
        lanes: u32,
        at: &Motion,
        [cost, lost]: [&Wide; 2],
        rank: &[usize; WIDTH],
        time: f32,
        mut best: Best,
    ) -> Best {
        let (mut whole, mut mean_mps) = ([0.0; WIDTH], [0.0; WIDTH]);
        for lane in 0..WIDTH {
            let (to_x, to_y) = (self.to.0 - at.x[lane], self.to.1 - at.y[lane]);
            let misaligned = 1.0 - (at.hx[lane] * to_x + at.hy[lane] * to_y) / at.left[lane];
            let misaligned = if at.left[lane] < LANDED_M { 0.0 } else { misaligned };
            whole[lane] = cost[lane] + (lost[lane] + self.scale.turn_s * misaligned);
            mean_mps[lane] = at.path[lane] / time;
        }
        // Nearly always one; which of them it is cannot be foreseen.
        let mut lowest = f32::INFINITY;
        for lane in 0..WIDTH {
            whole[lane] = if lanes & (1 << lane) == 0 { f32::INFINITY } else { whole[lane] };
            lowest = least(whole[lane], lowest);
        }
        for lane in Which(bits(whole.map(|cost| cost == lowest)) & lanes) {
            best.offer(whole[lane], rank[lane], mean_mps[lane]);
        }
        best
    }

    /// How fast these candidates may still go beside the static obstacles, and what being close to those costs.
    #[cold]
    #[inline(never)]
    fn scraped(&self, lanes: u32, mut v: Wide, at: Motion) -> (Wide, Wide) {
        let mut scrape = [0.0; WIDTH];
        for lane in Which(lanes) {
            let p = self.ego.position_m + Vec2::new(f64::from(at.x[lane]), f64::from(at.y[lane]));
            let h = Vec2::new(f64::from(at.hx[lane]), f64::from(at.hy[lane]));
            (v[lane], scrape[lane]) = self.beside_obstacles(v[lane], p, h);
        }
        (v, scrape)
    }

    /// Turns the headings by one step; how fast the candidates may then go.
    #[inline(always)]
    fn turn(&self, at: &mut Motion, ways: &Ways, hold: bool) -> Wide {
        let (scale, cos) = (&self.scale, self.turn.cos);
        let mut v = [0.0; WIDTH];
        for lane in 0..WIDTH {
            let (hx, hy) = (at.hx[lane], at.hy[lane]);
            let (to_x, to_y) = (self.to.0 - at.x[lane], self.to.1 - at.y[lane]);
            let steered = hold | (at.left[lane] < ON_TARGET_M);
            let per_m = 1.0 / at.left[lane];
            let aim_x = if steered { ways.direction_x[lane] } else { to_x * per_m };
            let aim_y = if steered { ways.direction_y[lane] } else { to_y * per_m };
            let near = hx * aim_x + hy * aim_y >= cos;
            let sin = if hx * aim_y - hy * aim_x >= 0.0 { self.turn.sin } else { -self.turn.sin };
            let hx1 = if near { aim_x } else { hx * cos - hy * sin };
            let hy1 = if near { aim_y } else { hx * sin + hy * cos };
            (at.hx[lane], at.hy[lane]) = (hx1, hy1);
            let share = (hx1 * aim_x + hy1 * aim_y - scale.align_cos) * scale.per_align;
            let fast = scale.v_max_mps * ways.share[lane] * least(most(share, 0.0), 1.0);
            // As `arc_speed`. Straight ahead it is infinite, and on the target no number.
            let arc = scale.arc_radps * at.left[lane] * at.left[lane] / (hx1 * to_y - hy1 * to_x).abs();
            v[lane] = least(arc, fast);
        }
        v
    }

    /// Slows down to the speed that the hard rows of the neighbours would leave.
    #[inline(always)]
    fn slow(&self, mut v: Wide, at: &Motion, area: &Area, k: usize) -> Wide {
        for other in self.others.slowing(area, k) {
            let (place_x, place_y) = self.others.at(k, other);
            let (required_m, slow_m2) = (self.others.required_m[other], self.others.slow_m2[other]);
            for lane in 0..WIDTH {
                let (x, y) = (at.x[lane] - place_x, at.y[lane] - place_y);
                let d2 = x * x + y * y;
                let d = most(d2.sqrt(), 1e-6);
                let closing = -(at.hx[lane] * x + at.hy[lane] * y);
                let limit = self.scale.row_rate * most(d - required_m, 0.0) * d / closing;
                // Stored whatever comes out: a conditional store would hold up the next neighbour's loads.
                let slows = (d2 <= slow_m2) & (closing > 0.0);
                v[lane] = least(if slows { limit } else { f32::INFINITY }, v[lane]);
            }
        }
        v
    }

    /// Speed that the hard rows of the static obstacles would leave, and the cost rate of being close to
    /// them.
    pub(super) fn beside_obstacles(&self, v: f32, p: Vec2, h: Vec2) -> (f32, f32) {
        let (mut v, mut scrape) = (f64::from(v), 0.0);
        for o in self.obstacles {
            let (normal, gap) = o.clearance(p);
            let closing = -h.dot(&normal);
            if closing > 0.0 {
                v = v.min(2.0 * self.params.row_rate * gap.max(0.0) / closing);
            }
            scrape += (1.0 - gap / OBSTACLE_MARGIN_M).max(0.0);
        }
        (single(v), single(self.params.prox_weight * scrape))
    }

    /// By how much the step raises the worst closeness to each neighbour.
    #[inline(always)]
    fn closeness(
        &self,
        passing: Which,
        at: &Motion,
        next: &Motion,
        k: usize,
        fade: f32,
        worst: &mut Worst,
    ) -> Wide {
        let near_s = fade * self.scale.near_s;
        let mut raised = [0.0; WIDTH];
        for other in passing {
            let (required_m, per_margin) = (self.others.required_m[other], self.others.per_margin[other]);
            let overlap_s = fade * self.others.overlap_s[other];
            let ((x0, y0), (x1, y1)) = (self.others.at(k, other), self.others.at(k + 1, other));
            let worst = &mut worst.0[other];
            for lane in 0..WIDTH {
                // Closest approach inside the step: at 10 m/s relative speed the samples alone would miss it.
                let (from_x, from_y) = (at.x[lane] - x0, at.y[lane] - y0);
                let change_x = next.x[lane] - x1 - from_x;
                let change_y = next.y[lane] - y1 - from_y;
                let c2 = change_x * change_x + change_y * change_y;
                // No number for who does not move: 0.
                let along = (from_x * change_x + from_y * change_y) / c2;
                let s = most(least(along, 0.0), -1.0);
                let (x, y) = (from_x - change_x * s, from_y - change_y * s);
                let gap = (x * x + y * y).sqrt() - required_m;
                let share = most(1.0 - gap * per_margin, 0.0);
                let penalty = near_s * share * share - overlap_s * least(gap, 0.0);
                // None is less than zero, so their order is that of their bits.
                let highest = f32::from_bits(penalty.to_bits().max(worst[lane].to_bits()));
                raised[lane] += highest - worst[lane];
                worst[lane] = highest;
            }
        }
        raised
    }
}

/// The worst closeness of each candidate to each neighbour so far, each row of lanes in a line of the cache.
#[repr(align(64))]
struct Worst([Wide; NEIGHBOURS_MAX]);
