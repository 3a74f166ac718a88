use hdrhistogram::Histogram;
use hdrhistogram::errors::CreationError;
use serde::Serialize;

/// Longest time that is resolved, ns: ten seconds. Longer ones count as this.
const LONGEST_NS: u64 = 10_000_000_000;

/// Percentiles of a time, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Default)]
pub struct LatencyNs {
    /// How many were measured.
    pub count: u64,
    /// Median.
    pub p50: u64,
    /// 90th percentile.
    pub p90: u64,
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
    /// 99.99th percentile; the largest of fewer than ten thousand.
    pub p9999: u64,
    /// Largest.
    pub max: u64,
}

/// A bounded histogram of times to three significant digits. Recording does not allocate.
#[derive(Debug, Clone)]
pub struct LatencyHistogram {
    histogram: Histogram<u64>,
}

impl LatencyHistogram {
    /// An empty histogram.
    ///
    /// # Errors
    /// Never with the bounds used here; passed on rather than unwrapped.
    pub fn new() -> Result<Self, CreationError> {
        Ok(Self { histogram: Histogram::new_with_bounds(1, LONGEST_NS, 3)? })
    }

    /// Adds one time.
    pub fn record(&mut self, ns: u64) {
        self.histogram.saturating_record(ns.min(LONGEST_NS));
    }

    /// Adds the same time `count` times.
    pub fn record_many(&mut self, ns: u64, count: u64) {
        self.histogram.saturating_record_n(ns.min(LONGEST_NS), count);
    }

    /// The times that were recorded, ascending: the upper end of each of the histogram's steps, ns, and
    /// how many fell into it. [`LatencyHistogram::record_many`] of them all makes the same histogram.
    pub fn steps(&self) -> impl Iterator<Item = (u64, u64)> + '_ {
        let recorded = self.histogram.iter_recorded();
        // The topmost step ends beyond the largest time.
        recorded.map(|step| (step.value_iterated_to().min(LONGEST_NS), step.count_at_value()))
    }

    /// Adds all of another's times.
    pub fn merge(&mut self, other: &Self) {
        // Same bounds: adding cannot fail.
        let _ = self.histogram.add(&other.histogram);
    }

    /// What 99 % of the times were at most so far, ns; 0 without a record.
    pub fn p99(&self) -> u64 {
        self.histogram.value_at_quantile(0.99)
    }

    /// The longest time so far, ns; 0 without a record.
    pub fn max(&self) -> u64 {
        self.histogram.max()
    }

    /// The percentiles so far; all zero without a record.
    pub fn summary(&self) -> LatencyNs {
        let h = &self.histogram;
        LatencyNs {
            count: h.len(),
            p50: h.value_at_quantile(0.5),
            p90: h.value_at_quantile(0.9),
            p99: self.p99(),
            p999: h.value_at_quantile(0.999),
            p9999: h.value_at_quantile(0.9999),
            max: self.max(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_make_the_same_histogram_again() {
        let mut first = LatencyHistogram::new().unwrap();
        for k in 0..20_000_u64 {
            first.record(k * k);
        }
        first.record(u64::MAX);
        let mut second = LatencyHistogram::new().unwrap();
        first.steps().for_each(|(ns, count)| second.record_many(ns, count));
        assert_eq!(first.steps().map(|(_, count)| count).sum::<u64>(), 20_001);
        assert!(first.steps().eq(second.steps()));
        let (a, b) = (first.summary(), second.summary());
        assert_eq!((a.count, a.p50, a.p9999), (b.count, b.p50, b.p9999));
    }

    #[test]
    fn quantiles_are_nearest_ranks_to_three_digits() {
        let mut histogram = LatencyHistogram::new().unwrap();
        assert_eq!(histogram.summary(), LatencyNs::default());
        (1..=10_000).for_each(|ns| histogram.record(ns));
        let summary = histogram.summary();
        assert_eq!((summary.count, summary.max), (10_000, histogram.steps().last().unwrap().0));
        for (quantile, exact) in [
            (summary.p50, 5000.0),
            (summary.p90, 9000.0),
            (summary.p99, 9900.0),
            (summary.p999, 9990.0),
            (summary.p9999, 9999.0),
        ] {
            assert!((quantile as f64 / exact - 1.0).abs() < 1e-3, "{quantile} for {exact}");
        }
    }
}
