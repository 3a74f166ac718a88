//! Who of a row of cells is near, eight at a time where the processor can.

use crate::geometry::{Grid, Vec2};

/// Places that are looked at together.
pub(super) const WIDTH: usize = 8;

/// Robots that were found, as the cells gave them.
#[derive(Debug, Clone)]
pub(super) struct Found {
    /// The first `count` are of those found, and behind them there is always room for `WIDTH` more.
    places: Vec<u32>,
    squares_m2: Vec<f64>,
    count: usize,
}

/// What is looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Circle {
    pub(super) centre_m: Vec2,
    pub(super) radius_m: f64,
    /// Place of the robot that looks, and is not found.
    pub(super) own: u32,
}

impl Found {
    /// With room for `robots`, and for `least` numbers in any case.
    pub(super) fn with_capacity(robots: usize, least: usize) -> Self {
        let places = least.max(robots + WIDTH);
        Self { places: vec![0; places], squares_m2: vec![0.0; places], count: 0 }
    }

    /// Places in the cells of those found.
    pub(super) fn places(&self) -> &[u32] {
        &self.places[..self.count]
    }

    /// Their squared distances, m², and some numbers behind them.
    pub(super) fn squares_m2(&self) -> &[f64] {
        &self.squares_m2
    }

    /// Finds the others of the points of `grid` inside of `circle`, whose positions are `x_m` and `y_m` in its order.
    pub(super) fn look(&mut self, grid: &Grid, circle: Circle, x_m: &[f64], y_m: &[f64]) {
        self.count = 0;
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx512f")
            && std::arch::is_x86_feature_detected!("avx512vl")
            && std::arch::is_x86_feature_detected!("popcnt")
        {
            let Circle { centre_m, radius_m, own } = circle;
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { self.look_avx512(grid, (x_m, y_m), own, centre_m.x, centre_m.y, radius_m) };
        }
        grid.near(circle.centre_m, circle.radius_m, |row| {
            self.add_each(circle, row.start, &x_m[row.clone()], &y_m[row]);
        });
    }

    /// The circle comes number by number, in registers: read from memory as a whole it would wait for the writes
    /// before it.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,popcnt")]
    fn look_avx512(
        &mut self,
        grid: &Grid,
        (x_m, y_m): (&[f64], &[f64]),
        own: u32,
        here_x_m: f64,
        here_y_m: f64,
        radius_m: f64,
    ) {
        let circle = Circle { centre_m: Vec2::new(here_x_m, here_y_m), radius_m, own };
        grid.near(circle.centre_m, circle.radius_m, |row| {
            self.add_avx512(circle, row.start, &x_m[row.clone()], &y_m[row]);
        });
    }

    /// Adds those at the places from `first` on that are inside of `circle`.
    #[expect(clippy::cast_possible_truncation, reason = "a fleet has fewer than 2³² robots")]
    fn add_each(&mut self, circle: Circle, first: usize, x_m: &[f64], y_m: &[f64]) {
        let (mut count, radius_m2) = (self.count, circle.radius_m * circle.radius_m);
        for (at, (x_m, y_m)) in x_m.iter().zip(y_m).enumerate() {
            let (x_m, y_m) = (x_m - circle.centre_m.x, y_m - circle.centre_m.y);
            let square_m2 = x_m * x_m + y_m * y_m;
            // Written in any case and kept if it is near: nothing to guess for the processor.
            let place = (first + at) as u32;
            (self.places[count], self.squares_m2[count]) = (place, square_m2);
            count += usize::from(square_m2 <= radius_m2) & usize::from(place != circle.own);
        }
        self.count = count;
    }

    /// [`add_each`](Self::add_each) with the same operations, eight at a time.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl,popcnt")]
    #[inline]
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_possible_wrap,
        reason = "a fleet has fewer than 2³² robots, and the bits are all that counts"
    )]
    fn add_avx512(&mut self, circle: Circle, first: usize, x_m: &[f64], y_m: &[f64]) {
        use std::arch::x86_64::{
            _CMP_LE_OQ, _mm256_add_epi32, _mm256_mask_cmpneq_epi32_mask, _mm256_maskz_compress_epi32,
            _mm256_set1_epi32, _mm256_setr_epi32, _mm256_storeu_si256, _mm512_add_pd,
            _mm512_mask_cmp_pd_mask, _mm512_maskz_compress_pd, _mm512_maskz_loadu_pd, _mm512_mul_pd,
            _mm512_set1_pd, _mm512_storeu_pd, _mm512_sub_pd,
        };
        let (here_x, here_y) = (_mm512_set1_pd(circle.centre_m.x), _mm512_set1_pd(circle.centre_m.y));
        let radius = _mm512_set1_pd(circle.radius_m * circle.radius_m);
        let own = _mm256_set1_epi32(circle.own as i32);
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let parts = x_m.chunks(WIDTH).zip(y_m.chunks(WIDTH));
        for ((x_m, y_m), at) in parts.zip((first..).step_by(WIDTH)) {
            let there = (1_u32 << x_m.len().min(y_m.len())) - 1;
            let there = there as u8;
            // SAFETY: only the lanes that are in both slices are read.
            let (x, y) = unsafe {
                (_mm512_maskz_loadu_pd(there, x_m.as_ptr()), _mm512_maskz_loadu_pd(there, y_m.as_ptr()))
            };
            let (x, y) = (_mm512_sub_pd(x, here_x), _mm512_sub_pd(y, here_y));
            let square = _mm512_add_pd(_mm512_mul_pd(x, x), _mm512_mul_pd(y, y));
            let places = _mm256_add_epi32(_mm256_set1_epi32(at as u32 as i32), lanes);
            let others = _mm256_mask_cmpneq_epi32_mask(there, places, own);
            let near = _mm512_mask_cmp_pd_mask::<_CMP_LE_OQ>(others, square, radius);
            let (places, square) =
                (_mm256_maskz_compress_epi32(near, places), _mm512_maskz_compress_pd(near, square));
            let room = self.count..self.count + WIDTH;
            let (to_places, to_squares) = (&mut self.places[room.clone()], &mut self.squares_m2[room]);
            // SAFETY: both have room for `WIDTH` numbers.
            unsafe {
                _mm256_storeu_si256(to_places.as_mut_ptr().cast(), places);
                _mm512_storeu_pd(to_squares.as_mut_ptr(), square);
            }
            self.count += near.count_ones() as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Eight at a time they are the same, in the same order, as one by one.
        #[test]
        fn eight_at_a_time_find_the_same(
            points in prop::collection::vec((prop_oneof![-3.0..3.0f64, Just(f64::NAN)], -3.0..3.0f64), 0..80),
            here_x_m in -1.0..1.0f64, here_y_m in -1.0..1.0f64, radius_m in prop_oneof![0.0..3.0f64, Just(f64::INFINITY)], own in 0..90u32,
        ) {
            let points: Vec<Vec2> = points.iter().map(|(x_m, y_m)| Vec2::new(*x_m, *y_m)).collect();
            let mut grid = Grid::with_capacity(points.len(), 0.9);
            grid.build(points.iter().copied());
            let (x_m, y_m): (Vec<f64>, Vec<f64>) =
                grid.order().iter().map(|at| points[*at as usize]).map(|p| (p.x, p.y)).unzip();
            let circle = Circle { centre_m: Vec2::new(here_x_m, here_y_m), radius_m, own };
            let (mut found, mut each) = (Found::with_capacity(points.len(), 0), Found::with_capacity(points.len(), 0));
            found.look(&grid, circle, &x_m, &y_m);
            grid.near(circle.centre_m, radius_m, |row| {
                each.add_each(circle, row.start, &x_m[row.clone()], &y_m[row]);
            });
            prop_assert_eq!(found.places(), each.places());
            prop_assert_eq!(&found.squares_m2()[..found.count], &each.squares_m2()[..each.count]);
            prop_assert!(!found.places().contains(&own));
        }
    }
}
