//! The places of a few numbers in their order, by comparing each with all of them at once.
//!
//! For some dozens of numbers this is several times as fast as sorting them one by one: there is nothing to guess, and
//! one instruction makes several comparisons.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

/// Most numbers that are ranked.
pub(super) const RANKED_MAX: usize = 32;
/// Numbers that are compared at once.
const WIDTH: usize = 8;

/// One number for each of those that are ranked.
pub(super) type Lanes = [f64; RANKED_MAX];

/// How many of the first `count` pairs (`first`, `second`) come before each of them.
pub(super) fn ranks(first: &Lanes, second: &Lanes, count: usize) -> [usize; RANKED_MAX] {
    #[cfg(target_arch = "x86_64")]
    {
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { ranks_avx512(first, second, count) };
        }
        if std::arch::is_x86_feature_detected!("avx2") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { ranks_avx2(first, second, count) };
        }
    }
    ranks_of_all(first, second, count)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx512f,avx512vl")]
fn ranks_avx512(first: &Lanes, second: &Lanes, count: usize) -> [usize; RANKED_MAX] {
    ranks_of_all(first, second, count)
}

#[cfg(target_arch = "x86_64")]
#[target_feature(enable = "avx2")]
fn ranks_avx2(first: &Lanes, second: &Lanes, count: usize) -> [usize; RANKED_MAX] {
    ranks_of_all(first, second, count)
}

#[inline(always)]
fn ranks_of_all(first: &Lanes, second: &Lanes, count: usize) -> [usize; RANKED_MAX] {
    let count = count.min(RANKED_MAX);
    let mut ranks = [0; RANKED_MAX];
    let parts = ranks.chunks_exact_mut(WIDTH).zip(first.chunks_exact(WIDTH).zip(second.chunks_exact(WIDTH)));
    for (ranks, (mine, my_second)) in parts.take(count.div_ceil(WIDTH)) {
        let mut before = [0; WIDTH];
        for (other, other_second) in first[..count].iter().zip(second) {
            for lane in 0..WIDTH {
                let tied = (*other == mine[lane]) & (*other_second < my_second[lane]);
                before[lane] += usize::from((*other < mine[lane]) | tied);
            }
        }
        ranks.copy_from_slice(&before);
    }
    ranks
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// The ranks are the places after sorting, whatever the width of the registers.
        #[test]
        fn ranks_are_places(pairs in prop::collection::vec((0..6u32, 0..1000u32), 0..=RANKED_MAX)) {
            // Many of the first are equal, none of the second are.
            let pairs: Vec<(f64, f64)> = (0u32..).zip(pairs)
                .map(|(k, (a, b))| (f64::from(a) * 0.5, f64::from(b * 32 + k)))
                .collect();
            let (mut first, mut second) = ([7.0; RANKED_MAX], [0.0; RANKED_MAX]);
            for (k, (a, b)) in pairs.iter().enumerate() {
                (first[k], second[k]) = (*a, *b);
            }
            let mut sorted = pairs.clone();
            sorted.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
            let narrow = ranks_of_all(&first, &second, pairs.len());
            for (pair, rank) in pairs.iter().zip(narrow) {
                prop_assert_eq!(&sorted[rank], pair);
            }
            prop_assert_eq!(&ranks(&first, &second, pairs.len())[..pairs.len()], &narrow[..pairs.len()]);
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                let half = unsafe { ranks_avx2(&first, &second, pairs.len()) };
                prop_assert_eq!(&half[..pairs.len()], &narrow[..pairs.len()]);
            }
        }
    }
}
