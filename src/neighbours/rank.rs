//! The places of a few numbers in their order, by comparing each with all of them at once.
//!
//! For some dozens of numbers this is several times as fast as sorting them one by one: there is nothing to guess, and
//! one instruction makes several comparisons.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

/// Most numbers that are ranked.
pub(super) const RANKED_MAX: usize = 32;
/// One number for each of those that are ranked.
pub(super) type Lanes = [f64; RANKED_MAX];

/// Numbers with their ranks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ranked {
    pub(super) numbers: Lanes,
    counts: Lanes,
}

/// From here to twice as far, floating-point numbers are the integers, and their last bits say which.
const INTEGERS: f64 = (1_u64 << 52) as f64;

impl Ranked {
    /// How many of the numbers are smaller than number `k`.
    #[expect(clippy::cast_possible_truncation, reason = "no more than 32")]
    #[inline(always)]
    pub(super) fn rank(&self, k: usize) -> usize {
        self.counts[k].to_bits() as usize % (2 * RANKED_MAX)
    }
}

/// The roots of the numbers, of which the first `count` are ranked.
pub(super) fn roots(numbers: &Lanes, count: usize) -> Ranked {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { roots_avx512(numbers, count) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { roots_avx2(numbers, count) };
        }
    }
    roots_of_all(numbers, count)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl")]
fn roots_avx512(numbers: &Lanes, count: usize) -> Ranked {
    roots_of_all(numbers, count)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn roots_avx2(numbers: &Lanes, count: usize) -> Ranked {
    roots_of_all(numbers, count)
}

#[inline(always)]
fn roots_of_all(numbers: &Lanes, count: usize) -> Ranked {
    let mut roots = [0.0; RANKED_MAX];
    for (root, number) in roots.iter_mut().zip(numbers) {
        *root = number.sqrt();
    }
    // Counted in floating point: such sums are not to be regrouped, so that all lanes take one step together.
    let mut counts = [INTEGERS; RANKED_MAX];
    for k in 0..count.min(RANKED_MAX) {
        let other = roots[k];
        for lane in 0..RANKED_MAX {
            counts[lane] += if other < roots[lane] { 1.0 } else { 0.0 };
        }
    }
    Ranked { numbers: roots, counts }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The roots are those of the numbers, and the ranks their places after sorting, the first of them for
        /// equal ones; whatever the width of the registers.
        #[test]
        fn ranks_are_places(squares in prop::collection::vec(prop_oneof![0.0..9.0f64, Just(4.0)], 0..=RANKED_MAX)) {
            let count = squares.len();
            let mut numbers = [7.0; RANKED_MAX];
            numbers[..count].copy_from_slice(&squares);
            let mut sorted: Vec<f64> = squares.iter().map(|square| square.sqrt()).collect();
            sorted.sort_by(f64::total_cmp);
            let ranked = roots_of_all(&numbers, count);
            for (k, square) in squares.iter().enumerate() {
                prop_assert_eq!(ranked.numbers[k], square.sqrt());
                prop_assert_eq!(sorted.iter().position(|root| *root == square.sqrt()), Some(ranked.rank(k)));
            }
            prop_assert_eq!(roots(&numbers, count), ranked);
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                prop_assert_eq!(unsafe { roots_avx2(&numbers, count) }, ranked);
            }
        }
    }
}
