//! Random numbers of a seed: SplitMix64, the same on every machine and in every version.

use crate::scenario::SplitMix64;

#[derive(Debug, Clone)]
pub(crate) struct Random(SplitMix64);

impl Random {
    pub(crate) fn new(seed: u64) -> Self {
        // Neighbouring seeds begin far apart.
        let mut seeds = SplitMix64::new(seed ^ 0x5EED_C0DE_0000_0000);
        Self(SplitMix64::new(seeds.next()))
    }

    /// A stream of its own.
    pub(crate) fn branch(&mut self) -> Self {
        Self(SplitMix64::new(self.0.next()))
    }

    /// In `0..n`; 0 for none.
    pub(crate) fn below(&mut self, n: u64) -> u64 {
        // The upper bits; the bias below 2⁻³² does not matter here.
        let n = u128::from(n);
        u64::try_from((u128::from(self.0.next()) * n) >> 64).unwrap_or(0)
    }

    pub(crate) fn index(&mut self, n: usize) -> usize {
        usize::try_from(self.below(n as u64)).unwrap_or(0)
    }

    pub(crate) fn within(&mut self, (from, to): (u64, u64)) -> u64 {
        from + self.below(to - from + 1)
    }

    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        self.0.range(low, high)
    }

    pub(crate) fn one_in(&mut self, n: u64) -> bool {
        self.below(n) == 0
    }

    pub(crate) fn pick<'a, T>(&mut self, all: &'a [T]) -> Option<&'a T> {
        all.get(self.index(all.len()))
    }
}
