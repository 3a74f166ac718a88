//! The predicted positions of a robot's neighbours side by side, so that all of them are looked at in one go.
//!
//! Few neighbours matter in any one step of a candidate. [`Others`] tells which, for all at once and a little too many
//! rather than too few; what they cost is then worked out one by one.

#![expect(clippy::inline_always, reason = "compiled for the caller's registers only as a part of it")]

use super::predict::{Path, STEPS};
use super::types::NEIGHBOURS_MAX;
use crate::geometry::Vec2;

/// One number for each neighbour.
pub(super) type Lanes = [f64; NEIGHBOURS_MAX];

/// A lane without a neighbour is this far away, m: nothing reaches it.
const NOWHERE_M: f64 = 1e12;
/// Share by which a square is enlarged so that rounding cannot lose a neighbour.
const ROUNDING: f64 = 1e-9;

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
    slow_m2: Lanes,
    close_m2: Lanes,
    count: usize,
}

/// Neighbours as the bits of a number, the first the lowest.
#[derive(Debug)]
pub(super) struct Which(u32);

impl Iterator for Which {
    type Item = usize;

    fn next(&mut self) -> Option<usize> {
        let first = self.0.trailing_zeros();
        self.0 &= self.0.wrapping_sub(1);
        (first < u32::BITS).then_some(first as usize)
    }
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
        for (k, point) in std::iter::once(&start).chain(path).enumerate() {
            (self.x_m[k][lane], self.y_m[k][lane]) = (point.x, point.y);
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

    /// Those that slow a robot at `p` when step `k` begins: to the bit those within their distance.
    #[inline(always)]
    pub(super) fn slowing(&self, p: Vec2, k: usize) -> Which {
        let (x, y) = (&self.x_m[k], &self.y_m[k]);
        let mut which = 0;
        for lane in 0..NEIGHBOURS_MAX {
            let (dx, dy) = (p.x - x[lane], p.y - y[lane]);
            which |= u32::from(dx * dx + dy * dy <= self.slow_m2[lane]) << lane;
        }
        Which(which)
    }

    /// Those that may come close to a robot that goes from `p` to `next` in step `k`: all that do, and sometimes one
    /// that does not by a hair.
    #[inline(always)]
    #[expect(clippy::needless_bitwise_bool, reason = "a branch would be taken lane by lane")]
    pub(super) fn passing(&self, p: Vec2, next: Vec2, k: usize) -> Which {
        let (x0, y0, x1, y1) = (&self.x_m[k], &self.y_m[k], &self.x_m[k + 1], &self.y_m[k + 1]);
        let mut which = 0;
        for lane in 0..NEIGHBOURS_MAX {
            let (from_x, from_y) = (p.x - x0[lane], p.y - y0[lane]);
            let (to_x, to_y) = (next.x - x1[lane], next.y - y1[lane]);
            let (change_x, change_y) = (to_x - from_x, to_y - from_y);
            let from_m2 = from_x * from_x + from_y * from_y;
            let to_m2 = to_x * to_x + to_y * to_y;
            let change_m2 = change_x * change_x + change_y * change_y;
            let along = -(from_x * change_x + from_y * change_y);
            let across = from_x * change_y - from_y * change_x;
            let reach_m2 = self.close_m2[lane];
            // At one of the ends, or where the straight line between them passes.
            let ends = (from_m2 < reach_m2) | (to_m2 < reach_m2);
            let between = (along > 0.0) & (along < change_m2) & (across * across < reach_m2 * change_m2);
            which |= u32::from(ends | between) << lane;
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
        ) {
            let (required_m, margin_m, slow_m) = (0.45, 0.388, 0.87);
            let mut others = Others::none();
            let mut paths = Vec::new();
            for (x, y, vx, vy) in starts {
                let start = Vec2::new(x, y);
                let path: Path = std::array::from_fn(|k| start + Vec2::new(vx, vy) * (0.16 * (k + 1) as f64));
                others.push(start, &path, required_m, margin_m, slow_m);
                paths.push((start, path));
            }
            let (p, next) = (Vec2::new(x, y), Vec2::new(x + dx, y + dy));
            let before = |(start, path): &(Vec2, Path)| if k == 0 { *start } else { path[k - 1] };
            let slowing: Vec<usize> = others.slowing(p, k).collect();
            let near = |lane: &usize| (p - before(&paths[*lane])).norm_squared() <= slow_m * slow_m;
            prop_assert_eq!(slowing, (0..paths.len()).filter(near).collect::<Vec<_>>());
            let passing: Vec<usize> = others.passing(p, next, k).collect();
            prop_assert!(passing.is_sorted() && passing.iter().all(|lane| *lane < paths.len()));
            for (lane, path) in paths.iter().enumerate() {
                let (from, to) = (p - before(path), next - path.1[k]);
                let apart = crate::geometry::closest_point_on_segment(Vec2::zeros(), from, to).norm();
                prop_assert!(apart >= required_m + margin_m || passing.contains(&lane), "{lane} {apart}");
            }
        }
    }
}
