use hdrhistogram::Histogram;
use serde::Serialize;

/// Longest time that is told apart, ns: a minute. What is longer counts as it.
const LONGEST_NS: u64 = 60_000_000_000;

/// The figures of a distribution of times, ns.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Quantiles {
    /// Half of the samples are at most this.
    pub p50: u64,
    /// 99 % of them.
    pub p99: u64,
    /// 99.9 % of them.
    pub p999: u64,
    /// All of them, exactly.
    pub max: u64,
}

/// Times, counted in bins of 0.1 %; bounded, allocated once.
#[derive(Debug, Clone)]
pub struct Distribution {
    histogram: Option<Histogram<u64>>,
    max_ns: u64,
}

impl Default for Distribution {
    fn default() -> Self {
        Self::new()
    }
}

impl Distribution {
    /// No samples.
    pub fn new() -> Self {
        // The bounds are constants that the histogram accepts; a test holds it to that.
        Self { histogram: Histogram::new_with_bounds(1, LONGEST_NS, 3).ok(), max_ns: 0 }
    }

    /// Adds a sample. Does not allocate; about 10 ns.
    pub fn record(&mut self, ns: u64) {
        if let Some(histogram) = &mut self.histogram {
            histogram.saturating_record(ns);
        }
        self.max_ns = self.max_ns.max(ns);
    }

    /// Number of samples.
    pub fn count(&self) -> u64 {
        self.histogram.as_ref().map_or(0, Histogram::len)
    }

    /// The figures; all 0 without samples.
    pub fn quantiles(&self) -> Quantiles {
        let at = |q| self.histogram.as_ref().map_or(0, |h| h.value_at_quantile(q)).min(self.max_ns);
        Quantiles { p50: at(0.5), p99: at(0.99), p999: at(0.999), max: self.max_ns }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_of_a_thousand() {
        let mut d = Distribution::new();
        assert_eq!(d.quantiles(), Quantiles::default());
        for ns in 1..=1000 {
            d.record(ns);
        }
        assert_eq!(d.quantiles(), Quantiles { p50: 500, p99: 990, p999: 999, max: 1000 });
        d.record(u64::MAX);
        assert_eq!((d.count(), d.quantiles().max), (1001, u64::MAX));
        d.record(0);
        assert_eq!(d.count(), 1002);
    }
}
