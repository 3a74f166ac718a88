//! The places of a few numbers in their order, by comparing each with all of them at once.
//!
//! For some dozens of numbers this is several times as fast as sorting them one by one: there is nothing to guess, and
//! one instruction makes several comparisons.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

/// Most numbers that are ranked.
pub(super) const RANKED_MAX: usize = 32;
/// One number for each of those that are ranked.
pub(super) type Lanes = [f64; RANKED_MAX];

/// The same numbers, near enough to tell which is the smaller one. Those that are so near to each other that
/// they become equal have the same rank.
type Keys = [f32; RANKED_MAX];

/// Numbers that are counted before it is asked whether there are more.
const STEP: usize = 8;

/// Numbers with their ranks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Ranked {
    pub(super) numbers: Lanes,
    counts: Keys,
}

/// From here to twice as far, floating-point numbers are the integers, and their last bits say which.
const INTEGERS: f32 = (1_u32 << 23) as f32;

impl Ranked {
    /// How many of the numbers are smaller than number `k` by more than what their keys are rounded by.
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
#[expect(clippy::cast_possible_truncation, reason = "rounded, and never into another order")]
fn roots_of_all(numbers: &Lanes, count: usize) -> Ranked {
    let (mut roots, mut keys) = ([0.0; RANKED_MAX], [0.0; RANKED_MAX]);
    for lane in 0..RANKED_MAX {
        roots[lane] = numbers[lane].sqrt();
        // Of the root: squares that are not equal may have roots that are. Who is not ranked is before nobody.
        keys[lane] = if lane < count { roots[lane] as f32 } else { f32::INFINITY };
    }
    // Counted in floating point: such sums are not to be regrouped, so that all lanes take one step together.
    let mut counts = [INTEGERS; RANKED_MAX];
    // In whole steps, of which there are as many nearly every time.
    for k in 0..count.next_multiple_of(STEP).min(RANKED_MAX) {
        let other = keys[k];
        for lane in 0..RANKED_MAX {
            counts[lane] += if other < keys[lane] { 1.0 } else { 0.0 };
        }
    }
    Ranked { numbers: roots, counts }
}

#[cfg(test)]
#[expect(clippy::cast_possible_truncation, reason = "the keys")]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The roots are those of the numbers, and the ranks their places after sorting, the first of them for
        /// those that are equal or nearly so; whatever the width of the registers.
        #[test]
        fn ranks_are_places(
            squares in prop::collection::vec(
                prop_oneof![0.0..9.0f64, Just(4.0), Just(4.0f64.next_up()), Just(0.0), Just(1e300), 0.0..1e-300f64],
                0..=RANKED_MAX,
            ),
        ) {
            let count = squares.len();
            let mut numbers = [7.0; RANKED_MAX];
            numbers[..count].copy_from_slice(&squares);
            let mut sorted: Vec<f32> = squares.iter().map(|square| *square as f32).collect();
            sorted.sort_by(f32::total_cmp);
            let ranked = roots_of_all(&numbers, count);
            for (k, square) in squares.iter().enumerate() {
                prop_assert_eq!(ranked.numbers[k], square.sqrt());
                prop_assert_eq!(sorted.iter().position(|key| *key == *square as f32), Some(ranked.rank(k)));
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
