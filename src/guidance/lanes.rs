//! Candidates that go side by side: one number of each in a wide register.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use super::others::{Area, least, most};
use crate::geometry::Vec2;

/// Candidates that go side by side.
pub(super) const WIDTH: usize = 8;
/// One number for each of them.
pub(super) type Wide = [f64; WIDTH];

/// One of all the numbers: half of them against the other half, and so on.
#[inline(always)]
fn reduce(wide: &Wide, choose: impl Fn(f64, f64) -> f64) -> f64 {
    let four: [f64; WIDTH / 2] = std::array::from_fn(|i| choose(wide[i], wide[i + WIDTH / 2]));
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
    #[inline(always)]
    pub(super) fn area(&self) -> Area {
        Area {
            min: Vec2::new(reduce(&self.x, least), reduce(&self.y, least)),
            max: Vec2::new(reduce(&self.x, most), reduce(&self.y, most)),
        }
    }

    pub(super) fn repeat(&mut self, from: usize, to: usize) {
        for wide in [&mut self.x, &mut self.y, &mut self.hx, &mut self.hy] {
            wide[to] = wide[from];
        }
    }
}

/// Candidates that go side by side, and what they have cost so far.
pub(super) struct Row {
    pub(super) count: usize,
    pub(super) rank: [usize; WIDTH],
    pub(super) heading_rad: Wide,
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
            heading_rad: none,
            direction_x: none,
            direction_y: none,
            share: none,
            cost: none,
        }
    }

    pub(super) fn push(&mut self, rank: usize, heading_rad: f64, direction: Vec2, share: f64, base: f64) {
        let lane = self.count;
        (self.rank[lane], self.heading_rad[lane]) = (rank, heading_rad);
        (self.direction_x[lane], self.direction_y[lane]) = (direction.x, direction.y);
        (self.share[lane], self.cost[lane]) = (share, base);
        self.count += 1;
    }

    /// Makes one lane do what another does.
    pub(super) fn repeat(&mut self, from: usize, to: usize) {
        for wide in [&mut self.direction_x, &mut self.direction_y, &mut self.share] {
            wide[to] = wide[from];
        }
    }
}
