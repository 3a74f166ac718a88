//! The predicted positions of a robot's neighbours side by side, so that all of them are looked at in one go.
//!
//! Few neighbours matter in any one step of a candidate. [`Others`] tells which, for all candidates at once, and some too
//! many rather than one too few; what they cost is then worked out for each.

#![expect(clippy::inline_always, reason = "compiled for the caller's registers only as a part of it")]

use super::predict::{Path, STEPS};
use super::types::NEIGHBOURS_MAX;
use crate::geometry::Vec2;

/// One number for each neighbour.
pub(super) type Lanes = [f64; NEIGHBOURS_MAX];

/// A lane without a neighbour is this far away, m: nothing reaches it.
const NOWHERE_M: f64 = 1e12;
/// Share by which a square is enlarged so that rounding cannot lose a neighbour.
pub(super) const ROUNDING: f64 = 1e-9;

/// Paths of the neighbours, and the distances at which they matter.
#[derive(Debug, Clone)]
pub(super) struct Others {
    /// Positions when each step begins, and at the end of the last, m.
    x_m: [Lanes; STEPS + 1],
    y_m: [Lanes; STEPS + 1],
    /// Distance to keep, m.
    pub(super) required_m: Lanes,
    /// Within this beyond it closeness costs, m.
    pub(super) margin_m: Lanes,
    /// Nearer than the root of this it slows others down, m².
    pub(super) slow_m2: Lanes,
    close_m2: Lanes,
    count: usize,
}

/// Lanes as the bits of a number, the first the lowest.
#[derive(Debug)]
pub(super) struct Which(pub(super) u32);

impl Iterator for Which {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        let first = self.0.trailing_zeros();
        self.0 &= self.0.wrapping_sub(1);
        (first < u32::BITS).then_some(first as usize)
    }
}

/// An upright rectangle, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Area {
    pub(super) min: Vec2,
    pub(super) max: Vec2,
}

/// The smaller one, as one instruction; of finite numbers what `f64::min` gives.
#[inline(always)]
pub(super) fn least(a: f64, b: f64) -> f64 {
    if a < b { a } else { b }
}

/// The larger one, as one instruction.
#[inline(always)]
pub(super) fn most(a: f64, b: f64) -> f64 {
    if a > b { a } else { b }
}

impl Others {
    pub(super) fn none() -> Self {
        Self {
            x_m: [[NOWHERE_M; NEIGHBOURS_MAX]; STEPS + 1],
            y_m: [[NOWHERE_M; NEIGHBOURS_MAX]; STEPS + 1],
            required_m: [0.0; NEIGHBOURS_MAX],
            margin_m: [0.0; NEIGHBOURS_MAX],
            slow_m2: [0.0; NEIGHBOURS_MAX],
            close_m2: [0.0; NEIGHBOURS_MAX],
            count: 0,
        }
    }

    /// Adds a neighbour; it slows down whoever is nearer than `slow_m`.
    pub(super) fn push(&mut self, start: Vec2, path: &Path, required_m: f64, margin_m: f64, slow_m: f64) {
        let lane = self.count;
        (self.x_m[0][lane], self.y_m[0][lane]) = (start.x, start.y);
        for k in 0..STEPS {
            (self.x_m[k + 1][lane], self.y_m[k + 1][lane]) = (path.x_m[k], path.y_m[k]);
        }
        (self.required_m[lane], self.margin_m[lane]) = (required_m, margin_m);
        let close_m = required_m + margin_m;
        self.slow_m2[lane] = slow_m * slow_m;
        self.close_m2[lane] = close_m * close_m * (1.0 + ROUNDING);
        self.count += 1;
    }

    /// Where the neighbour of a lane is when step `k` begins.
    #[inline(always)]
    pub(super) fn at(&self, k: usize, lane: usize) -> Vec2 {
        Vec2::new(self.x_m[k][lane], self.y_m[k][lane])
    }

    /// Those that may slow a robot in `area` when step `k` begins: all that do, and some that do not.
    #[inline(always)]
    pub(super) fn slowing(&self, area: &Area, k: usize) -> Which {
        let (x, y) = (&self.x_m[k], &self.y_m[k]);
        let mut which = 0;
        for lane in 0..NEIGHBOURS_MAX {
            // Rounding keeps the order of numbers, so nobody in the area is nearer than its nearest point.
            let dx = most(most(area.min.x - x[lane], x[lane] - area.max.x), 0.0);
            let dy = most(most(area.min.y - y[lane], y[lane] - area.max.y), 0.0);
            which |= u32::from(dx * dx + dy * dy <= self.slow_m2[lane]) << lane;
        }
        Which(which)
    }

    /// Those that may come close to a robot that goes from somewhere in `from` to somewhere in `to` in step `k`: all
    /// that do, and some that do not.
    #[inline(always)]
    pub(super) fn passing(&self, from: &Area, to: &Area, k: usize) -> Which {
        let (x0, y0, x1, y1) = (&self.x_m[k], &self.y_m[k], &self.x_m[k + 1], &self.y_m[k + 1]);
        let mut which = 0;
        for lane in 0..NEIGHBOURS_MAX {
            // Seen from the neighbour, the way lies in the rectangle around both of its ends.
            let min_x = least(from.min.x - x0[lane], to.min.x - x1[lane]);
            let max_x = most(from.max.x - x0[lane], to.max.x - x1[lane]);
            let min_y = least(from.min.y - y0[lane], to.min.y - y1[lane]);
            let max_y = most(from.max.y - y0[lane], to.max.y - y1[lane]);
            let (dx, dy) = (most(most(min_x, -max_x), 0.0), most(most(min_y, -max_y), 0.0));
            which |= u32::from(dx * dx + dy * dy < self.close_m2[lane]) << lane;
        }
        Which(which)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Nobody who matters is left out, and the lanes are those of the neighbours.
        #[test]
        fn all_who_matter_are_named(
            starts in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -1.0..1.0f64, -1.0..1.0f64), 0..=16),
            x in -2.0..2.0f64, y in -2.0..2.0f64, dx in -0.8..0.8f64, dy in -0.8..0.8f64, k in 0..STEPS,
            width in 0.0..1.0f64,
        ) {
            let (required_m, margin_m, slow_m) = (0.45, 0.388, 0.87);
            let mut others = Others::none();
            let mut paths = Vec::new();
            for (x, y, vx, vy) in starts {
                let start = Vec2::new(x, y);
                let path = Path {
                    x_m: std::array::from_fn(|k| x + vx * (0.16 * (k + 1) as f64)),
                    y_m: std::array::from_fn(|k| y + vy * (0.16 * (k + 1) as f64)),
                };
                others.push(start, &path, required_m, margin_m, slow_m);
                paths.push((start, path));
            }
            let (p, next) = (Vec2::new(x, y), Vec2::new(x + dx, y + dy));
            let end = |path: &Path, k: usize| Vec2::new(path.x_m[k], path.y_m[k]);
            let before = |(start, path): &(Vec2, Path)| if k == 0 { *start } else { end(path, k - 1) };
            // An area around each end, with the end in one of its corners.
            let area = |p: Vec2| Area { min: p, max: p + Vec2::new(width, width) };
            let slowing: Vec<usize> = others.slowing(&area(p), k).collect();
            let near = |lane: &usize| (p - before(&paths[*lane])).norm_squared() <= slow_m * slow_m;
            let all_slowing = (0..paths.len()).filter(near).collect::<Vec<_>>();
            prop_assert!(slowing.is_sorted() && all_slowing.iter().all(|lane| slowing.contains(lane)));
            // In a single point nobody is named without reason.
            let point = Area { min: p, max: p };
            prop_assert_eq!(others.slowing(&point, k).collect::<Vec<_>>(), all_slowing);
            let passing: Vec<usize> = others.passing(&area(p), &area(next), k).collect();
            prop_assert!(passing.is_sorted() && passing.iter().all(|lane| *lane < paths.len()));
            for (lane, path) in paths.iter().enumerate() {
                let (from, to) = (p - before(path), next - end(&path.1, k));
                let apart = crate::geometry::closest_point_on_segment(Vec2::zeros(), from, to).norm();
                prop_assert!(apart >= required_m + margin_m || passing.contains(&lane), "{lane} {apart}");
            }
        }
    }
}
