//! What the figures were measured on, and with what clock.

use super::quantiles::Quantiles;
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
        Self { cpu: cpu(), kernel: kernel(), clock_ns: Quantiles::of(readings) }
    }
}

/// Nanoseconds since `started`.
pub(crate) fn ns_since(started: Instant) -> f64 {
    started.elapsed().as_nanos() as f64
}

fn cpu() -> String {
    let info = std::fs::read_to_string("/proc/cpuinfo").unwrap_or_default();
    let name = info.lines().find(|line| line.starts_with("model name")).and_then(|line| line.split_once(':'));
    let name = name.map_or(std::env::consts::ARCH, |(_, name)| name.trim());
    let count = info.lines().filter(|line| line.starts_with("processor")).count();
    format!("{count} × {name}")
}

fn kernel() -> String {
    let release = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    format!("{} {}", std::env::consts::OS, release.trim())
}
