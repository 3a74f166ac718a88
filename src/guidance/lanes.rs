//! Candidates that go side by side: one number of each in a wide register.
//!
//! Seen from where the robot is now, in single precision, as the neighbours (`others`).

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

/// Candidates that go side by side.
pub(super) const WIDTH: usize = 16;
/// One number for each of them.
pub(super) type Wide = [f32; WIDTH];

/// The lanes of which it holds as the bits of a number, the first the lowest.
#[inline(always)]
pub(super) fn bits(holds: [bool; WIDTH]) -> u32 {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m128i, _mm_movemask_epi8, _mm_setzero_si128, _mm_sub_epi8};
        let bytes: __m128i = bytemuck::cast(holds);
        // SAFETY: every such processor has SSE2.
        unsafe { _mm_movemask_epi8(_mm_sub_epi8(_mm_setzero_si128(), bytes)).cast_unsigned() }
    }
    #[cfg(not(target_arch = "x86_64"))]
    (0..WIDTH).fold(0, |bits, lane| bits | u32::from(holds[lane]) << lane)
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
    pub(super) min_x: f32,
    pub(super) min_y: f32,
    pub(super) max_x: f32,
    pub(super) max_y: f32,
}

/// In single precision.
#[inline(always)]
#[expect(clippy::cast_possible_truncation, reason = "to the nearest")]
pub(super) fn single(a: f64) -> f32 {
    a as f32
}

/// The smaller one, as one instruction; `b` where one of them is no number.
#[inline(always)]
pub(super) fn least(a: f32, b: f32) -> f32 {
    if a < b { a } else { b }
}

/// The larger one, as one instruction; `b` where one of them is no number.
#[inline(always)]
pub(super) fn most(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

impl Area {
    /// The least that holds the places of the lanes that are `alive`.
    #[inline(always)]
    pub(super) fn around(x: &Wide, y: &Wide, alive: u32) -> Self {
        let (mut low_x, mut low_y, mut high_x, mut high_y) = (*x, *y, *x, *y);
        for lane in 0..WIDTH {
            let gone = alive & (1 << lane) == 0;
            low_x[lane] = if gone { f32::INFINITY } else { x[lane] };
            low_y[lane] = if gone { f32::INFINITY } else { y[lane] };
            high_x[lane] = if gone { f32::NEG_INFINITY } else { x[lane] };
            high_y[lane] = if gone { f32::NEG_INFINITY } else { y[lane] };
        }
        #[cfg(target_arch = "x86_64")]
        {
            use std::arch::x86_64::{
                __m128, _mm_max_ps, _mm_min_ps, _mm_movehl_ps, _mm_unpackhi_ps, _mm_unpacklo_ps,
            };
            let [low_x, low_y, high_x, high_y]: [[__m128; 4]; 4] = [
                bytemuck::cast(low_x),
                bytemuck::cast(low_y),
                bytemuck::cast(high_x),
                bytemuck::cast(high_y),
            ];
            // SAFETY: every such processor has SSE.
            let (min, max) = unsafe {
                let low = |[a, b, c, d]: [__m128; 4]| _mm_min_ps(_mm_min_ps(a, b), _mm_min_ps(c, d));
                let high = |[a, b, c, d]: [__m128; 4]| _mm_max_ps(_mm_max_ps(a, b), _mm_max_ps(c, d));
                let ((min_x, min_y), (max_x, max_y)) =
                    ((low(low_x), low(low_y)), (high(high_x), high(high_y)));
                let min = _mm_min_ps(_mm_unpacklo_ps(min_x, min_y), _mm_unpackhi_ps(min_x, min_y));
                let max = _mm_max_ps(_mm_unpacklo_ps(max_x, max_y), _mm_unpackhi_ps(max_x, max_y));
                (_mm_min_ps(min, _mm_movehl_ps(min, min)), _mm_max_ps(max, _mm_movehl_ps(max, max)))
            };
            let ([min_x, min_y, ..], [max_x, max_y, ..]): ([f32; 4], [f32; 4]) =
                (bytemuck::cast(min), bytemuck::cast(max));
            Self { min_x, min_y, max_x, max_y }
        }
        #[cfg(not(target_arch = "x86_64"))]
        Self {
            min_x: low_x.iter().copied().fold(low_x[0], least),
            min_y: low_y.iter().copied().fold(low_y[0], least),
            max_x: high_x.iter().copied().fold(high_x[0], most),
            max_y: high_y.iter().copied().fold(high_y[0], most),
        }
    }
}

/// The columns of these rows.
#[inline(always)]
pub(super) fn columns(rows: [[f32; 4]; 4]) -> [[f32; 4]; 4] {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{__m128, _mm_movehl_ps, _mm_movelh_ps, _mm_unpackhi_ps, _mm_unpacklo_ps};
        let [a, b, c, d]: [__m128; 4] = bytemuck::cast(rows);
        // SAFETY: every such processor has SSE.
        let columns = unsafe {
            let (low, high) = (_mm_unpacklo_ps(a, b), _mm_unpackhi_ps(a, b));
            let (low_cd, high_cd) = (_mm_unpacklo_ps(c, d), _mm_unpackhi_ps(c, d));
            [
                _mm_movelh_ps(low, low_cd),
                _mm_movehl_ps(low_cd, low),
                _mm_movelh_ps(high, high_cd),
                _mm_movehl_ps(high_cd, high),
            ]
        };
        bytemuck::cast(columns)
    }
    #[cfg(not(target_arch = "x86_64"))]
    std::array::from_fn(|j| rows.map(|row| row[j]))
}

/// Where the candidates of a row are, their headings, and how far it is from there to the target.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Motion {
    pub(super) x: Wide,
    pub(super) y: Wide,
    pub(super) hx: Wide,
    pub(super) hy: Wide,
    pub(super) left: Wide,
    pub(super) path: Wide,
}

/// What tells candidates from each other.
#[derive(Clone, Copy)]
#[repr(align(64))]
pub(super) struct Ways {
    pub(super) direction_x: Wide,
    pub(super) direction_y: Wide,
    /// Of the full speed, and one less than one over it.
    pub(super) share: Wide,
    pub(super) slower: Wide,
}

/// Candidates that go side by side, and what they have cost so far.
pub(super) struct Row {
    pub(super) count: usize,
    pub(super) rank: [usize; WIDTH],
    pub(super) ways: Ways,
    pub(super) cost: Wide,
}

impl Row {
    pub(super) fn empty() -> Self {
        let none = [0.0; WIDTH];
        let ways = Ways { direction_x: none, direction_y: none, share: none, slower: none };
        Self { count: 0, rank: [0; WIDTH], ways, cost: none }
    }

    pub(super) fn push(&mut self, rank: usize, (x, y): (f32, f32), (share, slower): (f32, f32), base: f32) {
        let lane = self.count;
        self.rank[lane] = rank;
        (self.ways.direction_x[lane], self.ways.direction_y[lane]) = (x, y);
        (self.ways.share[lane], self.ways.slower[lane]) = (share, slower);
        self.cost[lane] = base;
        self.count += 1;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// What is done with all lanes at once comes out as lane by lane.
        #[test]
        fn all_lanes_at_once_are_as_one_by_one(
            x in prop::array::uniform16(-3.0..3.0f32),
            y in prop::array::uniform16(-3.0..3.0f32),
            holds in prop::array::uniform16(any::<bool>()),
        ) {
            let alive = bits(holds);
            prop_assert_eq!(Which(alive).collect::<Vec<_>>(), (0..WIDTH).filter(|lane| holds[*lane]).collect::<Vec<_>>());
            let rows: [[f32; 4]; 4] = bytemuck::cast(x);
            let turned: [[f32; 4]; 4] = std::array::from_fn(|j| rows.map(|row| row[j]));
            prop_assert_eq!(columns(rows), turned);
            let area = Area::around(&x, &y, alive);
            let ends = |wide: &Wide| {
                let those = || Which(alive).map(|lane| wide[lane]);
                (those().fold(f32::INFINITY, least), those().fold(f32::NEG_INFINITY, most))
            };
            prop_assert_eq!(((area.min_x, area.max_x), (area.min_y, area.max_y)), (ends(&x), ends(&y)));
        }
    }
}
