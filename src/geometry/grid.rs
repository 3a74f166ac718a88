use super::Vec2;
use std::ops::Range;

/// Points sorted into square cells, so that those near a place are found without looking at all.
///
/// The cells of the plane repeat like tiles: cell (i, j) and (i + side, j) share their memory. A grid
/// so needs memory for its points and not for the ground they stand on; points that only share a
/// cell's memory are told apart by their distance, which whoever asks has to look at anyway.
///
/// [`build`](Self::build) costs a few nanoseconds a point and does not allocate. The order of the
/// points depends on their positions and indices alone.
#[derive(Debug, Clone)]
pub struct Grid {
    cells_per_m: f64,
    /// Cells in each direction, a power of two, less one.
    mask: i64,
    /// Bits of the cells in one direction.
    bits: u32,
    /// Where each cell's points start in `order`, and the end.
    starts: Vec<u32>,
    /// Indices of the points, cell by cell, ascending within each.
    order: Vec<u32>,
    /// The cell of each point.
    cells: Vec<u32>,
}

impl Grid {
    /// An empty grid with room for `points` points and cells of `cell_m` metres.
    ///
    /// # Panics
    /// With 2³² points or more, or a cell that is not larger than 0.
    pub fn with_capacity(points: usize, cell_m: f64) -> Self {
        assert!(u32::try_from(points).is_ok() && cell_m > 0.0, "{points} points in cells of {cell_m} m");
        let mut bits = 1;
        while (1usize << (2 * bits)) < 2 * points {
            bits += 1;
        }
        Self {
            cells_per_m: 1.0 / cell_m,
            mask: (1 << bits) - 1,
            bits,
            starts: vec![0; (1 << (2 * bits)) + 1],
            order: Vec::with_capacity(points),
            cells: Vec::with_capacity(points),
        }
    }

    /// Number of the cell along one axis, before it is wrapped.
    #[allow(clippy::cast_possible_truncation)] // saturates, and what is not finite goes to 0
    fn along(&self, x_m: f64) -> i64 {
        let cells = x_m * self.cells_per_m;
        let towards_0 = cells as i64;
        // Its floor, without a call where the processor is not known to have an instruction for it.
        towards_0.saturating_sub(i64::from(towards_0 as f64 > cells))
    }

    /// Memory of the cell at (column, row).
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // masked to at most 32 bits
    fn slot(&self, column: i64, row: i64) -> u32 {
        (((row & self.mask) << self.bits) | (column & self.mask)) as u32
    }

    /// Sorts `points` in. Points that are not finite are somewhere.
    ///
    /// More points than the capacity would allocate.
    pub fn build(&mut self, points: impl Iterator<Item = Vec2>) {
        self.take(points);
        self.put(|_| {});
    }

    /// The first half of [`build`](Self::build): counts the points of each cell.
    #[inline]
    pub(crate) fn take(&mut self, points: impl Iterator<Item = Vec2>) {
        self.starts.fill(0);
        let mut cells = std::mem::take(&mut self.cells);
        cells.clear();
        for p in points {
            let cell = self.slot(self.along(p.x), self.along(p.y));
            cells.push(cell);
            self.starts[cell as usize + 1] += 1;
        }
        self.cells = cells;
    }

    /// The second half: puts them down, and tells the place of each in [`order`](Self::order), in the order in
    /// which they came.
    #[inline]
    pub(crate) fn put(&mut self, mut told: impl FnMut(usize)) {
        let mut before = 0;
        for start in &mut self.starts[1..] {
            // Shifted by one cell: each start moves on to the cell's end while its points are put down.
            (*start, before) = (before, before + *start);
        }
        self.order.resize(self.cells.len(), 0);
        for (index, cell) in (0u32..).zip(&self.cells) {
            let end = &mut self.starts[*cell as usize + 1];
            let place = *end as usize;
            self.order[place] = index;
            told(place);
            *end += 1;
        }
    }

    /// Indices of the points, cell by cell.
    pub fn order(&self) -> &[u32] {
        &self.order
    }

    /// Calls `each` with ranges of [`order`](Self::order) that together hold every point within
    /// `reach_m` of `p`, none of them twice, and some that are farther.
    #[inline(always)]
    #[expect(clippy::inline_always, reason = "compiled for wider registers as a part of its caller")]
    pub fn near(&self, p: Vec2, reach_m: f64, mut each: impl FnMut(Range<usize>)) {
        let span = |x: f64| {
            let (low, high) = (self.along(x - reach_m), self.along(x + reach_m));
            // A full turn holds every cell.
            (low, high.min(low.saturating_add(self.mask)))
        };
        let ((left, right), (bottom, top)) = (span(p.x), span(p.y));
        let (left, right) = (left & self.mask, right & self.mask);
        // Rows that go on at their beginning are two parts.
        let (whole, halves) = ([(left, right); 1], [(0, right), (left, self.mask)]);
        let parts = if left <= right { &whole[..] } else { &halves };
        for row in bottom..=top {
            for &(left, right) in parts {
                let (first, last) = (self.slot(left, row) as usize, self.slot(right, row) as usize);
                let range = self.starts[first] as usize..self.starts[last + 1] as usize;
                if !range.is_empty() {
                    each(range);
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn found(grid: &Grid, points: &[Vec2], p: Vec2, reach_m: f64) -> Vec<u32> {
        let mut found = Vec::new();
        grid.near(p, reach_m, |range| found.extend_from_slice(&grid.order()[range]));
        let all = found.len();
        found.sort_unstable();
        found.dedup();
        assert_eq!(found.len(), all, "a point came twice");
        found.retain(|i| (points[*i as usize] - p).norm() <= reach_m);
        found
    }

    proptest! {
        /// The grid finds what a look at every point finds, also far outside and across its seams.
        #[test]
        fn finds_what_brute_force_finds(
            points in prop::collection::vec((-30.0..30.0f64, -30.0..30.0f64), 0..200),
            far in prop::collection::vec((-1e5..1e5f64, -1e5..1e5f64), 0..4),
            cell in 0.3..5.0f64, reach in 0.0..20.0f64, x in -35.0..35.0f64, y in -35.0..35.0f64,
        ) {
            let points: Vec<Vec2> = points.into_iter().chain(far).map(|(x, y)| Vec2::new(x, y)).collect();
            let mut grid = Grid::with_capacity(points.len(), cell);
            // Twice: the first build leaves nothing behind.
            grid.build(points.iter().map(|p| p * 0.5));
            grid.build(points.iter().copied());
            for p in points.iter().copied().chain([Vec2::new(x, y)]) {
                let brute: Vec<u32> =
                    (0u32..).zip(&points).filter(|(_, q)| (*q - p).norm() <= reach).map(|(i, _)| i).collect();
                prop_assert_eq!(found(&grid, &points, p, reach), brute);
            }
        }
    }

    #[test]
    fn order_is_by_cell_and_then_by_index() {
        let points = [(0.5, 0.5), (7.5, 0.5), (0.6, 0.6), (0.5, 1.5), (1.5, 0.5)];
        let mut grid = Grid::with_capacity(points.len(), 1.0);
        grid.build(points.iter().map(|(x, y)| Vec2::new(*x, *y)));
        // Four cells a side: 7.5 shares the memory of 3.5.
        assert_eq!(grid.order(), [0, 2, 4, 1, 3]);
    }

    #[test]
    fn among_100_000_points_nobody_near_is_missed() {
        // Crowded here and sparse there, farther than the cells' memory reaches before it repeats.
        let mut random = 1_u64;
        let mut next = || {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            (random >> 11) as f64 / (1_u64 << 53) as f64
        };
        let points: Vec<Vec2> = (0..100_000)
            .map(|_| {
                let (angle, radius_m) = (std::f64::consts::TAU * next(), 2000.0 * next() * next());
                Vec2::new(radius_m * angle.cos(), radius_m * angle.sin())
            })
            .collect();
        let mut grid = Grid::with_capacity(points.len(), 0.7);
        grid.build(points.iter().copied());
        let mut seen = vec![false; points.len()];
        grid.order().iter().for_each(|index| seen[*index as usize] = true);
        assert!(seen.iter().all(|seen| *seen));
        for p in points.iter().step_by(997) {
            for reach_m in [0.5, 3.0] {
                let near = |i: &u32| (points[*i as usize] - p).norm() <= reach_m;
                let all: Vec<u32> = (0..100_000).filter(near).collect();
                assert_eq!(found(&grid, &points, *p, reach_m), all);
            }
        }
    }

    #[test]
    fn what_is_not_finite_does_no_harm() {
        let points = [Vec2::new(f64::NAN, 1.0), Vec2::new(f64::INFINITY, f64::NEG_INFINITY), Vec2::zeros()];
        let mut grid = Grid::with_capacity(points.len(), 1.0);
        grid.build(points.into_iter());
        assert_eq!(found(&grid, &points, Vec2::zeros(), 1.0), [2]);
        assert!(found(&grid, &points, Vec2::new(f64::NAN, f64::INFINITY), f64::INFINITY).is_empty());
    }
}
