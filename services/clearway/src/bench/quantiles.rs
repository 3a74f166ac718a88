//! Quantiles of measured times.

use serde::Serialize;

/// Quantiles by nearest rank: each is a time that was measured.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Quantiles {
    /// Median.
    pub(crate) p50: f64,
    /// 99th percentile.
    pub(crate) p99: f64,
    /// 99.9th percentile; the largest of fewer than a thousand.
    pub(crate) p999: f64,
    /// Largest.
    pub(crate) max: f64,
}

impl Quantiles {
    /// Of `times`; all 0 without one.
    pub(crate) fn of(mut times: Vec<f64>) -> Self {
        times.sort_unstable_by(f64::total_cmp);
        let at = |per_mille: usize| {
            // The smallest time that this share of all times does not exceed.
            let rank = (times.len() * per_mille).div_ceil(1000);
            times.get(rank.saturating_sub(1)).copied().unwrap_or(0.0)
        };
        Self { p50: at(500), p99: at(990), p999: at(999), max: at(1000) }
    }
}

#[cfg(test)]
mod tests {
    use super::Quantiles;

    #[test]
    fn quantiles_are_nearest_ranks() {
        let q = Quantiles::of((1..=2000).rev().map(f64::from).collect());
        assert_eq!(q, Quantiles { p50: 1000.0, p99: 1980.0, p999: 1998.0, max: 2000.0 });
        assert_eq!(Quantiles::of(vec![7.0]).p999, 7.0);
        assert_eq!(Quantiles::of(Vec::new()).max, 0.0);
    }
}
