//! The predicted positions of a robot's neighbours side by side, so that all of them are looked at in one go.
//!
//! Seen from where the robot is now, in single precision: what is 10 m away is known to a micrometre.
//!
//! Few neighbours matter in any one step of a candidate. [`Others`] tells which, for all candidates at once, and some too
//! many rather than one too few; what they cost is then worked out for each.

#![expect(clippy::inline_always, reason = "compiled for the caller's registers only as a part of it")]

use super::Params;
use super::lanes::{Area, Which, bits, columns, least, most, single};
use super::predict::{Path, STEPS};
use super::shown::Shown;
use super::types::NEIGHBOURS_MAX;

/// One number for each neighbour.
pub(super) type Lanes = [f32; NEIGHBOURS_MAX];

/// A lane without a neighbour is this far away, m: nothing reaches it.
const NOWHERE_M: f32 = 1e12;
/// Share by which a square is enlarged so that rounding cannot lose a neighbour.
const ROUNDING: f32 = 1e-4;

/// Paths of the neighbours, and the distances at which they matter.
#[derive(Debug, Clone)]
// Each row of lanes in a line of the cache.
#[repr(C, align(64))]
pub(super) struct Others {
    /// Positions when each step begins, and at the end of the last, m.
    x_m: [Lanes; STEPS + 1],
    y_m: [Lanes; STEPS + 1],
    /// Distance to keep, m.
    pub(super) required_m: Lanes,
    /// One over the distance beyond it within which closeness costs, 1/m.
    pub(super) per_margin: Lanes,
    /// What overlap costs, s/m.
    pub(super) overlap_s: Lanes,
    /// Nearer than the root of this it slows others down, m².
    pub(super) slow_m2: Lanes,
    close_m2: Lanes,
    count: usize,
}

impl Others {
    #[inline(always)]
    pub(super) fn none() -> Self {
        Self {
            x_m: [[NOWHERE_M; NEIGHBOURS_MAX]; STEPS + 1],
            y_m: [[NOWHERE_M; NEIGHBOURS_MAX]; STEPS + 1],
            required_m: [0.0; NEIGHBOURS_MAX],
            per_margin: [0.0; NEIGHBOURS_MAX],
            overlap_s: [0.0; NEIGHBOURS_MAX],
            slow_m2: [0.0; NEIGHBOURS_MAX],
            close_m2: [0.0; NEIGHBOURS_MAX],
            count: 0,
        }
    }

    /// The first `count` of the neighbours begin where they stand. `parked_margin_m`: within how much beyond the distance
    /// to keep closeness to one that has arrived costs; `slow_m`: from how much beyond it on they slow others down.
    #[inline(always)]
    pub(super) fn place(
        &mut self,
        neighbours: &Shown,
        count: usize,
        (parked_margin_m, slow_m): (f64, f64),
        params: &Params,
    ) {
        let listed = neighbours.lanes();
        let (parked, margins_m) =
            (neighbours.parked().0, [params.prox_margin_m, parked_margin_m].map(single));
        let overlap_s = single(params.overlap_weight);
        self.count = count;
        for lane in 0..NEIGHBOURS_MAX {
            let there = lane < count;
            let (x_m, y_m) = (single(-listed.x_m[lane]), single(-listed.y_m[lane]));
            self.x_m[0][lane] = if there { x_m } else { NOWHERE_M };
            self.y_m[0][lane] = if there { y_m } else { NOWHERE_M };
            let (required_m, slow_m) =
                (single(listed.required_m[lane]), single(listed.required_m[lane] + slow_m));
            let margin_m = if parked & (1 << lane) == 0 { margins_m[0] } else { margins_m[1] };
            let close_m = required_m + margin_m;
            self.required_m[lane] = if there { required_m } else { 0.0 };
            // Nowhere, closeness costs nothing.
            self.per_margin[lane] = 1.0 / margin_m;
            self.overlap_s[lane] = if there { overlap_s / required_m } else { 0.0 };
            self.slow_m2[lane] = if there { slow_m * slow_m } else { 0.0 };
            self.close_m2[lane] = if there { close_m * close_m * (1.0 + ROUNDING) } else { 0.0 };
        }
    }

    /// Lays the paths of those added side by side, four by four.
    #[inline(always)]
    pub(super) fn lay<'p>(&mut self, path: impl Fn(usize) -> &'p Path) {
        for first in (0..self.count).step_by(4) {
            // Nobody is nowhere, whatever is added.
            let paths: [&Path; 4] = std::array::from_fn(|i| path((first + i).min(self.count - 1)));
            lay_four(&mut self.x_m, first, paths.map(|path| &path.x_m));
            lay_four(&mut self.y_m, first, paths.map(|path| &path.y_m));
        }
    }

    /// Where the neighbour of a lane is when step `k` begins.
    #[inline(always)]
    pub(super) fn at(&self, k: usize, lane: usize) -> (f32, f32) {
        (self.x_m[k][lane], self.y_m[k][lane])
    }

    /// Those that may slow a robot in `area` when step `k` begins: all that do, and some that do not.
    #[inline(always)]
    pub(super) fn slowing(&self, area: &Area, k: usize) -> Which {
        let (x, y) = (&self.x_m[k], &self.y_m[k]);
        let mut near = [false; NEIGHBOURS_MAX];
        for lane in 0..NEIGHBOURS_MAX {
            // Rounding keeps the order of numbers, so nobody in the area is nearer than its nearest point.
            let dx = most(most(area.min_x - x[lane], x[lane] - area.max_x), 0.0);
            let dy = most(most(area.min_y - y[lane], y[lane] - area.max_y), 0.0);
            near[lane] = dx * dx + dy * dy <= self.slow_m2[lane];
        }
        Which(bits(near))
    }

    /// Those that may come close to a robot that goes from somewhere in `from` to somewhere in `to` in step `k`: all that
    /// do, and some that do not.
    #[inline(always)]
    pub(super) fn passing(&self, from: &Area, to: &Area, k: usize) -> Which {
        let (x0, y0, x1, y1) = (&self.x_m[k], &self.y_m[k], &self.x_m[k + 1], &self.y_m[k + 1]);
        let mut near = [false; NEIGHBOURS_MAX];
        for lane in 0..NEIGHBOURS_MAX {
            // Seen from the neighbour, the way lies in the rectangle around both of its ends.
            let min_x = least(from.min_x - x0[lane], to.min_x - x1[lane]);
            let max_x = least(x0[lane] - from.max_x, x1[lane] - to.max_x);
            let min_y = least(from.min_y - y0[lane], to.min_y - y1[lane]);
            let max_y = least(y0[lane] - from.max_y, y1[lane] - to.max_y);
            let (dx, dy) = (most(most(min_x, max_x), 0.0), most(most(min_y, max_y), 0.0));
            near[lane] = dx * dx + dy * dy < self.close_m2[lane];
        }
        Which(bits(near))
    }
}

/// The rows of `paths`, from where the four lanes from `first` on begin, as columns.
#[inline(always)]
fn lay_four(out_m: &mut [Lanes; STEPS + 1], first: usize, paths: [&[f32; STEPS]; 4]) {
    let start: [f32; 4] = std::array::from_fn(|i| out_m[0][first + i]);
    for k in (0..STEPS).step_by(4) {
        let rows = std::array::from_fn(|i| std::array::from_fn(|j| start[i] + paths[i][k + j]));
        for (j, column) in columns(rows).iter().enumerate() {
            out_m[k + 1 + j][first..first + 4].copy_from_slice(column);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::guidance::shown::with_all;
    use crate::guidance::types::Neighbour;
    use proptest::prelude::*;

    proptest! {
        /// Each lane holds the numbers of its neighbour, and those beyond the last are nowhere.
        #[test]
        fn each_lane_holds_what_its_neighbour_needs(
            places in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, any::<bool>()), 0..=16),
            required_m in 0.2..1.0f64, parked_margin_m in 0.01..1.0f64, slow_m in 0.1..1.0f64, left_out in 0..4usize,
        ) {
            let params = Params::default();
            let neighbours: Vec<Neighbour> = places.iter().map(|(x, y, arrived)| {
                Neighbour { position_m: Vec2::new(*x, *y), arrived: *arrived, ..Neighbour::default() }
            }).collect();
            let count = neighbours.len().saturating_sub(left_out);
            let mut others = Others::none();
            with_all(Vec2::zeros(), required_m, (&neighbours, true), |shown| {
                others.place(shown, count, (parked_margin_m, slow_m), &params);
            });
            for (lane, n) in neighbours.iter().enumerate().take(count) {
                let margin_m = single(if n.arrived { parked_margin_m } else { params.prox_margin_m });
                let (required, slow) = (single(required_m), single(required_m + slow_m));
                let close = required + margin_m;
                prop_assert_eq!(others.at(0, lane), (single(n.position_m.x), single(n.position_m.y)));
                prop_assert_eq!((others.required_m[lane], others.per_margin[lane]), (required, 1.0 / margin_m));
                prop_assert_eq!(others.overlap_s[lane], single(params.overlap_weight) / required);
                prop_assert_eq!(others.slow_m2[lane], slow * slow);
                prop_assert_eq!(others.close_m2[lane], close * close * (1.0 + ROUNDING));
            }
            for lane in count..NEIGHBOURS_MAX {
                prop_assert_eq!(others.at(0, lane), (NOWHERE_M, NOWHERE_M));
                prop_assert_eq!((others.slow_m2[lane], others.close_m2[lane]), (0.0, 0.0));
                prop_assert!(NOWHERE_M * others.per_margin[lane] > 1.0);
            }
        }

        /// Nobody who matters is left out, and the lanes are those of the neighbours.
        #[test]
        fn all_who_matter_are_named(
            starts in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -1.0..1.0f64, -1.0..1.0f64), 0..=16),
            x in -2.0..2.0f32, y in -2.0..2.0f32, dx in -0.8..0.8f32, dy in -0.8..0.8f32, k in 0..STEPS,
            width in 0.0..1.0f32,
        ) {
            let (required_m, slow_m) = (0.45f32, 0.87f32);
            let params = Params::default();
            let margin_m = single(params.prox_margin_m);
            let mut others = Others::none();
            let count = starts.len();
            let (mut paths, mut neighbours) = (Vec::new(), Vec::new());
            for (x, y, vx, vy) in starts {
                paths.push(Path {
                    x_m: std::array::from_fn(|k| single(vx * (0.16 * (k + 1) as f64))),
                    y_m: std::array::from_fn(|k| single(vy * (0.16 * (k + 1) as f64))),
                });
                neighbours.push(Neighbour { position_m: Vec2::new(x, y), ..Neighbour::default() });
            }
            with_all(Vec2::zeros(), 0.45, (&neighbours, true), |shown| {
                others.place(shown, count, (params.parked_margin_m, 0.42), &params);
            });
            others.lay(|lane| &paths[lane]);
            for (lane, path) in paths.iter().enumerate() {
                let (x, y) = others.at(0, lane);
                prop_assert_eq!(others.at(k + 1, lane), (x + path.x_m[k], y + path.y_m[k]));
            }
            let (p, next) = ((x, y), (x + dx, y + dy));
            // An area with the beginning in one of its corners.
            let area = |p: (f32, f32), width: f32| {
                Area { min_x: p.0, min_y: p.1, max_x: p.0 + width, max_y: p.1 + width }
            };
            let slowing: Vec<usize> = others.slowing(&area(p, width), k).collect();
            let from = |p: (f32, f32), k: usize, lane: usize| (p.0 - others.at(k, lane).0, p.1 - others.at(k, lane).1);
            let near = |lane: &usize| {
                let (x, y) = from(p, k, *lane);
                x * x + y * y <= slow_m * slow_m
            };
            let all_slowing = (0..count).filter(near).collect::<Vec<_>>();
            prop_assert!(slowing.is_sorted() && all_slowing.iter().all(|lane| slowing.contains(lane)));
            // In a single point nobody is named without reason.
            prop_assert_eq!(others.slowing(&area(p, 0.0), k).collect::<Vec<_>>(), all_slowing);
            let passing: Vec<usize> = others.passing(&area(p, width), &area(next, width), k).collect();
            prop_assert!(passing.is_sorted() && passing.iter().all(|lane| *lane < count));
            for lane in 0..count {
                let wide = |(x, y): (f32, f32)| Vec2::new(f64::from(x), f64::from(y));
                let (from, to) = (wide(from(p, k, lane)), wide(from(next, k + 1, lane)));
                let apart = crate::geometry::closest_point_on_segment(Vec2::zeros(), from, to).norm();
                let close_m = f64::from(required_m + margin_m);
                prop_assert!(apart >= close_m || passing.contains(&lane), "{lane} {apart}");
            }
        }
    }
}
