//! What the figures were measured on, and with what clock.

use super::quantiles::Quantiles;
use clearway::report;
use serde::Serialize;
use std::time::Instant;

/// Readings of the clock that its own cost is taken from.
const CLOCK_READINGS: usize = 100_000;

/// The machine, for reports.
#[derive(Debug, Serialize)]
pub(crate) struct Machine {
    /// Number and name of the processors.
    pub(crate) cpu: String,
    /// Kernel and its release.
    pub(crate) kernel: String,
    /// Time between two readings of the clock with nothing between them: what every figure that
    /// times a single solve contains.
    pub(crate) clock_ns: Quantiles,
}

impl Machine {
    pub(crate) fn here() -> Self {
        let readings = (0..CLOCK_READINGS).map(|_| ns_since(Instant::now())).collect();
        Self { cpu: report::cpu(), kernel: report::kernel(), clock_ns: Quantiles::of(readings) }
    }
}

/// Nanoseconds since `started`.
pub(crate) fn ns_since(started: Instant) -> f64 {
    started.elapsed().as_nanos() as f64
}
