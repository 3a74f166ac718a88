//! Times of the loop: since this monitor attached, and of the last seconds.

use clearway::figures::{LatencyHistogram, LatencyNs};

/// Length of a slice of the recent window, ns.
const SLICE_NS: u64 = 2_000_000_000;
/// Slices of the recent window.
const SLICES: usize = 5;

/// Length of the recent window, s; it moves on by a slice at a time.
pub(crate) const RECENT_S: u64 = SLICE_NS * SLICES as u64 / 1_000_000_000;

/// One time of the loop.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    all: LatencyHistogram,
    /// Which slice of time each holds, and what was recorded in it.
    slices: [(u64, LatencyHistogram); SLICES],
    empty: LatencyHistogram,
}

impl Track {
    pub(crate) fn new(empty: &LatencyHistogram) -> Self {
        let slice = || (0, empty.clone());
        Self { all: empty.clone(), slices: std::array::from_fn(|_| slice()), empty: empty.clone() }
    }

    /// Adds what took `ns` in the period that was released at `at_ns`.
    pub(crate) fn record(&mut self, at_ns: u64, ns: u64) {
        let number = at_ns / SLICE_NS;
        let (of, histogram) = &mut self.slices[index(number)];
        if *of != number {
            *histogram = self.empty.clone();
            *of = number;
        }
        histogram.record(ns);
        self.all.record(ns);
    }

    /// Since the monitor attached to this run.
    pub(crate) fn all(&self) -> &LatencyHistogram {
        &self.all
    }

    /// The last [`RECENT_S`] seconds before `now_ns`.
    pub(crate) fn recent(&self, now_ns: u64) -> LatencyHistogram {
        let newest = now_ns / SLICE_NS;
        let mut recent = self.empty.clone();
        for (_, histogram) in self.slices.iter().filter(|(of, _)| of + SLICES as u64 > newest) {
            recent.merge(histogram);
        }
        recent
    }
}

#[expect(clippy::cast_possible_truncation, reason = "less than the number of slices")]
fn index(number: u64) -> usize {
    (number % SLICES as u64) as usize
}

/// The times of a period and of a robot's step.
#[derive(Debug, Clone)]
pub(crate) struct Times {
    tracks: [Track; Measure::ALL.len()],
}

/// What is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Measure {
    ReleaseLateness,
    StatePublish,
    StateToStaged,
    StateToCommand,
    Solve,
    Step,
}

impl Measure {
    pub(crate) const ALL: [Self; 6] = [
        Self::ReleaseLateness,
        Self::Solve,
        Self::StateToCommand,
        Self::Step,
        Self::StatePublish,
        Self::StateToStaged,
    ];

    /// Its name on the screen.
    pub(crate) fn title(self) -> &'static str {
        match self {
            Self::ReleaseLateness => "release lateness",
            Self::StatePublish => "state published",
            Self::StateToStaged => "state to staged",
            Self::StateToCommand => "state to command",
            Self::Solve => "solve",
            Self::Step => "robot's step",
        }
    }

    /// Its key in JSON, as in the daemon's report.
    pub(crate) fn key(self) -> &'static str {
        match self {
            Self::ReleaseLateness => "release_lateness_ns",
            Self::StatePublish => "state_publish_ns",
            Self::StateToStaged => "state_to_staged_ns",
            Self::StateToCommand => "state_to_command_ns",
            Self::Solve => "solve_ns",
            Self::Step => "step_ns",
        }
    }
}

impl Times {
    pub(crate) fn new(empty: &LatencyHistogram) -> Self {
        Self { tracks: std::array::from_fn(|_| Track::new(empty)) }
    }

    pub(crate) fn record(&mut self, what: Measure, at_ns: u64, ns: u64) {
        if let Some(at) = Measure::ALL.iter().position(|one| *one == what) {
            self.tracks[at].record(at_ns, ns);
        }
    }

    /// Every measure with its times.
    pub(crate) fn each(&self) -> impl Iterator<Item = (Measure, &Track)> {
        Measure::ALL.into_iter().zip(&self.tracks)
    }
}

/// How many times fell into each of `bins` equal steps of the logarithm from `from_ns` to `to_ns`; what
/// is outside counts in the first and in the last.
#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "clamped to the bins")]
pub(crate) fn distribution(histogram: &LatencyHistogram, bins: usize, from_ns: f64, to_ns: f64) -> Vec<u64> {
    let mut counts = vec![0; bins];
    let (low, high) = (from_ns.ln(), to_ns.ln());
    for (ns, count) in histogram.steps() {
        let share = (((ns.max(1)) as f64).ln() - low) / (high - low);
        let bin = ((share * bins as f64).max(0.0) as usize).min(bins.saturating_sub(1));
        if let Some(slot) = counts.get_mut(bin) {
            *slot += count;
        }
    }
    counts
}

/// Whether percentiles say anything.
pub(crate) fn known(summary: &LatencyNs) -> bool {
    summary.count > 0
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_recent_window_forgets_and_the_whole_does_not() {
        let empty = LatencyHistogram::new().unwrap();
        let mut track = Track::new(&empty);
        let s = 1_000_000_000;
        track.record(100 * s, 7_000_000);
        track.record(103 * s, 1_000);
        assert_eq!(track.recent(103 * s).summary().count, 2);
        track.record(111 * s, 2_000);
        let recent = track.recent(111 * s).summary();
        assert_eq!((recent.count, track.all().summary().count), (2, 3));
        assert!(recent.max < 3_000 && track.all().summary().max >= 7_000_000);
        // Nothing came for a while.
        assert_eq!(track.recent(200 * s).summary().count, 0);
    }

    #[test]
    fn every_time_falls_into_one_bin() {
        let mut histogram = LatencyHistogram::new().unwrap();
        for ns in [1, 150, 15_000, 1_500_000, 9_000_000_000] {
            histogram.record(ns);
        }
        let bins = distribution(&histogram, 6, 1e2, 1e8);
        assert_eq!(bins, [2, 0, 1, 0, 1, 1]);
        assert!(distribution(&histogram, 0, 1e2, 1e8).is_empty());
    }
}
