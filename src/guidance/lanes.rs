//! Candidates that go side by side: one number of each in a wide register.
//!
//! Seen from where the robot is now, in single precision, as the neighbours (`others`).

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use super::others::{Area, least, most};

/// Candidates that go side by side.
pub(super) const WIDTH: usize = 16;
/// One number for each of them.
pub(super) type Wide = [f32; WIDTH];

/// Cosine and sine of an angle in [−π, π], 1e-7 off at most: polynomials about the nearest quarter turn, the
/// coefficients as in Cephes (`sinf`, `cosf`), and no branch.
#[inline(always)]
pub(super) fn direction(angle_rad: f32) -> (f32, f32) {
    // Adding it leaves whole numbers.
    const WHOLE: f32 = 12_582_912.0;
    // π/2 as a short number and the rest.
    const QUARTER: (f32, f32) = (1.570_312_5, 4.838_267_9e-4);
    let quarters = (angle_rad * core::f32::consts::FRAC_2_PI + WHOLE) - WHOLE;
    let a = (angle_rad - quarters * QUARTER.0) - quarters * QUARTER.1;
    let a2 = a * a;
    let sin = a + a * a2 * (-1.666_665_5e-1 + a2 * (8.332_161e-3 - a2 * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * a2 + a2 * a2 * (4.166_664_6e-2 + a2 * (-1.388_731_6e-3 + a2 * 2.443_315_7e-5));
    let across = quarters.abs() == 1.0;
    let back = if quarters.abs() == 2.0 { -1.0 } else { 1.0 };
    (if across { -quarters * sin } else { back * cos }, if across { quarters * cos } else { back * sin })
}

/// One of all the numbers: half of them against the other half, and so on.
#[inline(always)]
fn reduce(wide: &Wide, choose: impl Fn(f32, f32) -> f32) -> f32 {
    let eight: [f32; WIDTH / 2] = std::array::from_fn(|i| choose(wide[i], wide[i + WIDTH / 2]));
    let four: [f32; WIDTH / 4] = std::array::from_fn(|i| choose(eight[i], eight[i + WIDTH / 4]));
    choose(choose(four[0], four[2]), choose(four[1], four[3]))
}

/// Where the candidates of a row are, and their headings.
#[derive(Clone, Copy)]
pub(super) struct Motion {
    pub(super) x: Wide,
    pub(super) y: Wide,
    pub(super) hx: Wide,
    pub(super) hy: Wide,
}

impl Motion {
    /// Where those are that go on: the others have infinity in `gone`, these 0.
    #[inline(always)]
    pub(super) fn area(&self, gone: &Wide) -> Area {
        let add = |wide: &Wide| std::array::from_fn(|lane| wide[lane] + gone[lane]);
        let take = |wide: &Wide| std::array::from_fn(|lane| wide[lane] - gone[lane]);
        Area {
            min_x: reduce(&add(&self.x), least),
            min_y: reduce(&add(&self.y), least),
            max_x: reduce(&take(&self.x), most),
            max_y: reduce(&take(&self.y), most),
        }
    }
}

/// Candidates that go side by side, and what they have cost so far.
pub(super) struct Row {
    pub(super) count: usize,
    pub(super) rank: [usize; WIDTH],
    pub(super) direction_x: Wide,
    pub(super) direction_y: Wide,
    pub(super) share: Wide,
    pub(super) cost: Wide,
}

impl Row {
    pub(super) fn empty() -> Self {
        let none = [0.0; WIDTH];
        Self {
            count: 0,
            rank: [0; WIDTH],
            direction_x: none,
            direction_y: none,
            share: [1.0; WIDTH],
            cost: none,
        }
    }

    pub(super) fn push(&mut self, rank: usize, (x, y): (f32, f32), share: f32, base: f32) {
        let lane = self.count;
        self.rank[lane] = rank;
        (self.direction_x[lane], self.direction_y[lane]) = (x, y);
        (self.share[lane], self.cost[lane]) = (share, base);
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::super::others::single;
    use super::*;

    #[test]
    fn directions_are_those_of_the_library_to_a_millionth_of_a_tenth() {
        for i in -100_000..=100_000 {
            let angle_rad = single(std::f64::consts::PI * f64::from(i) / 100_000.0);
            let (cos, sin) = direction(angle_rad);
            let (exact_sin, exact_cos) = libm::sincos(f64::from(angle_rad));
            let off = (f64::from(cos) - exact_cos).abs().max((f64::from(sin) - exact_sin).abs());
            assert!(off < 1e-7, "{angle_rad}: {off}");
        }
    }
}
