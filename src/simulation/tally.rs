//! The counters of daemon and gates, each with a name of its own.

use std::fmt;

use crate::actuation::Refusal;
use crate::admission::Rejection;
use crate::runtime::Counts;
use crate::wire::StopReason;

/// Something that is counted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Counter {
    /// An observation was refused.
    Rejected(Rejection),
    /// Samples that a writer numbered and that never came.
    Skipped,
    /// Writers whose first number had been wrong.
    Resynchronised,
    /// Robots whose pose froze.
    Frozen,
    SkippedPeriods,
    /// Periods without a complete command in time.
    Misses,
    SendFailures,
    LostRecords,
    Panics,
    Rests,
    /// Times that a worker fell silent.
    Silent,
    /// A robot was told to stop.
    Stop(StopReason),
    /// A gate refused a command.
    Gate(Refusal),
    /// A driver found a command sample corrupted.
    CorruptCommands,
    /// A worker found a state corrupted.
    CorruptStates,
    /// Operators' requests that were refused.
    Refused,
}

impl fmt::Display for Counter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Rejected(reason) => write!(f, "rejected_inputs.{}", reason.name()),
            Self::Skipped => f.write_str("rejected_inputs.skipped_samples"),
            Self::Resynchronised => f.write_str("rejected_inputs.resynchronised_writers"),
            Self::Frozen => f.write_str("rejected_inputs.frozen_robots"),
            Self::SkippedPeriods => f.write_str("skipped_periods"),
            Self::Misses => f.write_str("deadline_misses"),
            Self::SendFailures => f.write_str("send_failures"),
            Self::LostRecords => f.write_str("lost_records"),
            Self::Panics => f.write_str("worker_panics"),
            Self::Rests => f.write_str("worker_rests"),
            Self::Silent => f.write_str("workers_silent"),
            Self::Stop(reason) => write!(f, "stops.{}", reason.name()),
            Self::Gate(refusal) => write!(f, "gate.{refusal:?}"),
            Self::CorruptCommands => f.write_str("commands.corrupt"),
            Self::CorruptStates => f.write_str("corrupt_states"),
            Self::Refused => f.write_str("requests_refused"),
        }
    }
}

const REFUSALS: [Refusal; 9] = [
    Refusal::WrongRobot,
    Refusal::OldEpoch,
    Refusal::OldTick,
    Refusal::Expired,
    Refusal::Late,
    Refusal::OutOfStep,
    Refusal::Validity,
    Refusal::Input,
    Refusal::Future,
];

/// What the gates refused and the operator was refused: counted where it happens, over all runs.
#[derive(Debug, Clone, Default)]
pub(crate) struct Outside {
    gates: [u64; REFUSALS.len()],
    pub(crate) refused: u64,
    /// Samples that drivers found corrupted.
    pub(crate) corrupt: u64,
}

impl Outside {
    pub(crate) fn count(&mut self, refusal: Refusal) {
        if let Some(at) = REFUSALS.iter().position(|one| *one == refusal) {
            self.gates[at] += 1;
        }
    }
}

/// All counters at one time.
#[derive(Debug, Clone, Default)]
pub(crate) struct Tally(Vec<(Counter, u64)>);

impl Tally {
    /// Those of a daemon, of which `silenced` workers fell silent so far, and of what is around it.
    pub(crate) fn new(counts: &Counts, silenced: u64, outside: &Outside) -> Self {
        let mut all = Vec::with_capacity(48);
        all.extend(counts.rejections.iter().map(|(reason, n)| (Counter::Rejected(reason), n)));
        all.extend([
            (Counter::Skipped, counts.rejections.skipped_samples),
            (Counter::Resynchronised, counts.rejections.resynchronised_writers),
            (Counter::Frozen, counts.rejections.frozen_robots),
            (Counter::SkippedPeriods, counts.skipped_periods),
            (Counter::Misses, counts.deadline_misses),
            (Counter::SendFailures, counts.send_failures),
            (Counter::LostRecords, counts.lost_records),
            (Counter::Panics, counts.worker_panics),
            (Counter::Rests, counts.worker_rests),
            (Counter::Silent, silenced),
        ]);
        let stops = |reason: StopReason| counts.stops.get(reason.name()).copied().unwrap_or(0);
        all.extend(StopReason::ALL.into_iter().map(|reason| (Counter::Stop(reason), stops(reason))));
        all.extend(REFUSALS.into_iter().zip(outside.gates).map(|(refusal, n)| (Counter::Gate(refusal), n)));
        all.push((Counter::CorruptStates, counts.corrupt_states));
        all.push((Counter::CorruptCommands, outside.corrupt));
        all.push((Counter::Refused, outside.refused));
        Self(all)
    }

    /// The counters that moved since `before`, and by how much.
    pub(crate) fn moved<'a>(&'a self, before: &'a Self) -> impl Iterator<Item = (Counter, u64)> + 'a {
        let old = before.0.iter().map(|(_, n)| *n).chain(std::iter::repeat(0));
        self.0
            .iter()
            .zip(old)
            .filter(|((_, now), old)| now > old)
            .map(|((counter, now), old)| (*counter, now - old))
    }

    pub(crate) fn get(&self, counter: Counter) -> u64 {
        self.0.iter().find(|(one, _)| *one == counter).map_or(0, |(_, n)| *n)
    }
}
