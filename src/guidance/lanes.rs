//! Candidates that go side by side: one number of each in a wide register.
//!
//! Seen from where the robot is now, in single precision, as the neighbours (`others`).

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use super::others::{Area, least, most};

/// Candidates that go side by side.
pub(super) const WIDTH: usize = 16;
/// One number for each of them.
pub(super) type Wide = [f32; WIDTH];

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
