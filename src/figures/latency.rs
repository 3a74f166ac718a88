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
    /// 99th percentile.
    pub p99: u64,
    /// 99.9th percentile.
    pub p999: u64,
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

    /// Adds all of another's times.
    pub fn merge(&mut self, other: &Self) {
        // Same bounds: adding cannot fail.
        let _ = self.histogram.add(&other.histogram);
    }

    /// The percentiles so far; all zero without a record.
    pub fn summary(&self) -> LatencyNs {
        let h = &self.histogram;
        LatencyNs {
            count: h.len(),
            p50: h.value_at_quantile(0.5),
            p99: h.value_at_quantile(0.99),
            p999: h.value_at_quantile(0.999),
            max: h.max(),
        }
    }
}
