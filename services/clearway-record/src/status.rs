//! How a recording goes: what both of its threads count, and what people are told of it.

use crate::gaps::{Gaps, Recorded};
use serde::Serialize;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError};

/// Something that people want to know when it happens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// Samples come.
    Attached {
        /// Which run of the daemon.
        epoch: u64,
    },
    /// The daemon's run is over.
    RunOver {
        /// Which run.
        epoch: u64,
    },
    /// The next file was begun.
    Rotated {
        /// Its name.
        path: PathBuf,
    },
    /// An old file was deleted, because only so many are kept.
    Deleted {
        /// Its name.
        path: PathBuf,
    },
    /// The disk takes no more; the file was ended.
    DiskFull {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
        /// Whether the file could be ended with its index.
        whole: bool,
    },
    /// There is room again, and a next file.
    Resumed {
        /// Its name.
        path: PathBuf,
        /// Messages that were not recorded meanwhile.
        unrecorded: u64,
    },
}

/// One run of the daemon as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RunCounts {
    /// Which run.
    pub epoch: u64,
    /// Whether its end was seen.
    pub over: bool,
    /// Periods that the daemon skipped.
    pub skipped_periods: u64,
    /// Each channel.
    pub channels: Vec<ChannelCounts>,
}

/// One channel in one run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ChannelCounts {
    /// Which.
    pub channel: Recorded,
    /// First and last tick.
    pub ticks: Option<(u64, u64)>,
    /// Samples taken from shared memory.
    pub received: u64,
    /// Samples that were published and not received.
    pub missed: u64,
}

/// How a recording goes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Status {
    /// The runs, oldest first; of a long recording the newest.
    pub runs: Vec<RunCounts>,
    /// Runs before those.
    pub earlier_runs: u64,
    /// Samples missed in those.
    pub earlier_missed: u64,
    /// Samples that were dropped because the writer was too slow.
    pub dropped: u64,
    /// Samples that had changed in memory on their way, and are left out; counted as missed as well.
    pub corrupt: u64,
    /// Messages that came while the disk was full.
    pub unrecorded: u64,
    /// Whether messages are being written.
    pub recording: bool,
    /// Bytes written.
    pub bytes: u64,
    /// The files that are there.
    pub files: Vec<PathBuf>,
}

impl Status {
    /// Samples that were missed in all runs.
    pub fn missed(&self) -> u64 {
        let now = self.runs.iter().flat_map(|run| &run.channels).map(|channel| channel.missed);
        self.earlier_missed + now.sum::<u64>()
    }

    /// Whether everything that was published since it began is in the files.
    pub fn is_complete(&self) -> bool {
        self.missed() + self.dropped + self.corrupt + self.unrecorded == 0 && self.recording
    }
}

/// Runs whose counts are kept.
const RUNS_MAX: usize = 64;

#[derive(Debug, Default)]
pub(crate) struct Counts {
    pub(crate) runs: Vec<(u64, Gaps, bool)>,
    pub(crate) earlier: u64,
    pub(crate) earlier_missed: u64,
    pub(crate) recording: bool,
    pub(crate) unrecorded: u64,
    pub(crate) bytes: u64,
    pub(crate) files: Vec<PathBuf>,
}

/// What both threads and the caller see.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    pub(crate) stop: AtomicBool,
    pub(crate) queued_bytes: AtomicUsize,
    pub(crate) dropped: [AtomicU64; 4],
    pub(crate) corrupt: AtomicU64,
    counts: Mutex<Counts>,
}

impl Shared {
    pub(crate) fn counts(&self) -> std::sync::MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where a run stands.
    pub(crate) fn publish(&self, epoch: u64, gaps: Gaps, over: bool) {
        let mut counts = self.counts();
        match counts.runs.last_mut() {
            Some(last) if last.0 == epoch => *last = (epoch, gaps, over),
            _ => counts.runs.push((epoch, gaps, over)),
        }
        if counts.runs.len() > RUNS_MAX {
            let (_, gaps, over) = counts.runs.remove(0);
            counts.earlier += 1;
            counts.earlier_missed += Recorded::ALL.map(|c| gaps.missed(c, over)).iter().sum::<u64>();
        }
    }

    fn dropped(&self) -> u64 {
        self.dropped.iter().map(|n| n.load(Ordering::Relaxed)).sum()
    }

    pub(crate) fn status(&self) -> Status {
        let counts = self.counts();
        let channel = |gaps: &Gaps, channel: Recorded, over: bool| ChannelCounts {
            channel,
            ticks: gaps.range(channel),
            received: gaps.received(channel),
            missed: gaps.missed(channel, over),
        };
        let run = |(epoch, gaps, over): &(u64, Gaps, bool)| RunCounts {
            epoch: *epoch,
            over: *over,
            skipped_periods: gaps.skipped_periods(),
            channels: Recorded::ALL.map(|c| channel(gaps, c, *over)).to_vec(),
        };
        Status {
            runs: counts.runs.iter().map(run).collect(),
            earlier_runs: counts.earlier,
            earlier_missed: counts.earlier_missed,
            dropped: self.dropped(),
            corrupt: self.corrupt.load(Ordering::Relaxed),
            unrecorded: counts.unrecorded,
            recording: counts.recording,
            bytes: counts.bytes,
            files: counts.files.clone(),
        }
    }
}
