//! Random numbers that depend on what they are for and on nothing that was drawn before.

/// What a number is for.
#[derive(Debug, Clone, Copy)]
pub(super) enum Use {
    Radius,
    Bearing,
    Heading,
    Slip,
    Direction,
    Turn,
    Loss,
}

/// Whether the `number`-th of `writer`'s samples is lost, each with probability `share`.
pub fn is_lost(seed: u64, writer: u32, number: u64, share: f64) -> bool {
    uniform(seed, writer, number, Use::Loss) < share
}

/// A uniform number in [0, 1): the same for the same seed, robot, instant and use.
pub(super) fn uniform(seed: u64, robot: u32, instant: u64, of: Use) -> f64 {
    let key = [u64::from(robot), instant, of as u64];
    let hash = key.into_iter().fold(mix(seed), |hash, part| mix(hash ^ mix(part)));
    (hash >> 11) as f64 / (1u64 << 53) as f64
}

/// A uniform number in [−1, 1).
pub(super) fn symmetric(seed: u64, robot: u32, instant: u64, of: Use) -> f64 {
    2.0 * uniform(seed, robot, instant, of) - 1.0
}

/// One round of SplitMix64.
fn mix(x: u64) -> u64 {
    let mut z = x.wrapping_add(0x9e37_79b9_7f4a_7c15);
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_uniform_and_belong_to_their_key() {
        let n = 20_000;
        let draws: Vec<f64> = (0..n).map(|k| uniform(7, k % 5, u64::from(k / 5), Use::Slip)).collect();
        let mean = draws.iter().sum::<f64>() / f64::from(n);
        let variance = draws.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / f64::from(n);
        assert!((mean - 0.5).abs() < 0.01 && (variance - 1.0 / 12.0).abs() < 0.005, "{mean} {variance}");
        assert!(draws.iter().all(|x| (0.0..1.0).contains(x)));
        let lost = (0..n).filter(|k| is_lost(7, 2, u64::from(*k), 0.25)).count();
        assert!((4_800..5_200).contains(&lost), "{lost}");
        assert!((0..100).all(|k| !is_lost(7, 2, k, 0.0) && is_lost(7, 2, k, 1.0)));
        let one = uniform(7, 3, 11, Use::Slip);
        assert_eq!(one, uniform(7, 3, 11, Use::Slip));
        for other in [
            uniform(8, 3, 11, Use::Slip),
            uniform(7, 4, 11, Use::Slip),
            uniform(7, 3, 12, Use::Slip),
            uniform(7, 3, 11, Use::Turn),
        ] {
            assert_ne!(one, other);
        }
    }
}
