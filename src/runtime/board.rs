use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};

use super::event_count::EventCount;
use super::regions::Regions;
use super::staging::Staging;
use crate::config::Wakeup;
use crate::wire::StopReason;

/// No period has been released yet.
const NOTHING: u64 = 0;
/// The run is over.
const OVER: u64 = u64::MAX;

/// Bits for the workers that are not done, beside the tick modulo 2⁴⁸.
const BUSY_BITS: u32 = 16;
const BUSY: u64 = (1 << BUSY_BITS) - 1;

/// What the loop, the workers and the supervisor share: a few words and the staged commands.
#[derive(Debug)]
pub(super) struct Board {
    /// One more than the tick that was released last.
    released: AtomicU64,
    /// Counts up when that changes.
    pub(super) releases: EventCount,
    /// That tick, shifted by [`BUSY_BITS`], and how many workers are not done with it.
    busy: AtomicU64,
    workers: u64,
    /// Counts up when no worker is busy any more.
    pub(super) completions: EventCount,
    /// Code of the reason to stop the run; 0 while it goes on.
    stop: AtomicU32,
    /// Commands on their way from the workers to the loop.
    pub(super) staging: Staging,
    /// Who answers which part of the fleet.
    pub(super) regions: Regions,
    /// One more than the tick whose state a worker found corrupted last.
    corrupt: AtomicU64,
    /// One more than the last tick whose state was corrupted while a worker answered it.
    struck: AtomicU64,
    /// States that a worker found corrupted.
    pub(super) corrupt_states: AtomicU64,
    /// Times that a worker panicked.
    pub(super) worker_panics: AtomicU64,
    /// Times that a worker began to rest because it panicked too often.
    pub(super) worker_rests: AtomicU64,
    /// Which workers rest now.
    resting: Vec<AtomicBool>,
    /// Times that the thread which answers operators panicked.
    pub(super) admin_panics: AtomicU64,
    /// Rounds that it has made.
    pub(super) admin_rounds: AtomicU64,
}

/// What a worker finds when it looks for work.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Released {
    /// No period after the one it knows.
    Nothing,
    /// This one is running.
    Tick(u64),
    /// The run is over.
    Over,
}

impl Board {
    /// For robots with these ids, and at most 65535 workers.
    pub(super) fn new(ids: Vec<u32>, workers: usize, wakeup: Wakeup) -> Self {
        Self {
            released: AtomicU64::new(NOTHING),
            releases: EventCount::new(wakeup, workers),
            busy: AtomicU64::new(0),
            workers: (workers as u64).min(BUSY),
            completions: EventCount::new(wakeup, 1),
            stop: AtomicU32::new(0),
            regions: Regions::new(ids.len(), workers),
            staging: Staging::new(ids),
            corrupt: AtomicU64::new(0),
            struck: AtomicU64::new(0),
            corrupt_states: AtomicU64::new(0),
            worker_panics: AtomicU64::new(0),
            worker_rests: AtomicU64::new(0),
            resting: (0..workers).map(|_| AtomicBool::new(false)).collect(),
            admin_panics: AtomicU64::new(0),
            admin_rounds: AtomicU64::new(0),
        }
    }

    /// Lets the workers start on `tick`; everything written before is visible to them.
    pub(super) fn release(&self, tick: u64) {
        self.regions.begin(tick);
        self.busy.store(tick << BUSY_BITS | self.workers, Ordering::Relaxed);
        self.released.store(tick + 1, Ordering::Release);
        self.releases.notify();
    }

    /// Sends the workers home.
    pub(super) fn end(&self) {
        self.released.store(OVER, Ordering::Release);
        self.releases.notify();
    }

    /// A worker is done with `tick`: it has staged what it has and stages nothing more. Once for each
    /// worker and tick; when another period runs by now, nobody waits for it any more.
    pub(super) fn done(&self, tick: u64) {
        let of_tick = |busy: u64| {
            let belongs = busy >> BUSY_BITS == tick << BUSY_BITS >> BUSY_BITS;
            (belongs && busy & BUSY > 0).then(|| busy - 1)
        };
        // Release: who sees the last worker done sees what all of them have staged.
        let before = self.busy.fetch_update(Ordering::AcqRel, Ordering::Relaxed, of_tick);
        if before.is_ok_and(|busy| busy & BUSY == 1) {
            self.completions.notify();
        }
    }

    /// A worker found the state of `tick` corrupted and answers nothing. Before it is [done](Self::done).
    pub(super) fn found_corrupt(&self, tick: u64) {
        self.corrupt.fetch_max(tick.saturating_add(1), Ordering::Relaxed);
        self.corrupt_states.fetch_add(1, Ordering::Relaxed);
    }

    /// Whether a worker that is done with `tick` found its state corrupted.
    pub(super) fn is_corrupt(&self, tick: u64) -> bool {
        self.corrupt.load(Ordering::Relaxed) == tick.saturating_add(1)
    }

    /// A worker found the state of `tick` corrupted after it had staged what follows from it. Before it is
    /// [done](Self::done).
    pub(super) fn found_struck(&self, tick: u64) {
        self.struck.fetch_max(tick.saturating_add(1), Ordering::Relaxed);
        self.found_corrupt(tick);
    }

    /// Whether nothing that is staged for `tick` can be relied on: all workers read the same memory, and those
    /// who found it intact may have looked before.
    pub(super) fn is_struck(&self, tick: u64) -> bool {
        self.struck.load(Ordering::Relaxed) == tick.saturating_add(1)
    }

    /// Whether every worker is done with `tick`, which was released last.
    pub(super) fn complete(&self, tick: u64) -> bool {
        self.busy.load(Ordering::Acquire) == tick << BUSY_BITS
    }

    /// The period that runs, when it is not `known`.
    pub(super) fn released(&self, known: Option<u64>) -> Released {
        match self.released.load(Ordering::Acquire) {
            NOTHING => Released::Nothing,
            OVER => Released::Over,
            next if known == Some(next - 1) => Released::Nothing,
            next => Released::Tick(next - 1),
        }
    }

    /// A worker begins to rest, or ends it.
    pub(super) fn rest(&self, worker: usize, rests: bool) {
        self.worker_rests.fetch_add(u64::from(rests), Ordering::Relaxed);
        if let Some(resting) = self.resting.get(worker) {
            resting.store(rests, Ordering::Relaxed);
        }
    }

    /// Whether a worker rests.
    pub(super) fn rests(&self, worker: usize) -> bool {
        self.resting.get(worker).is_some_and(|resting| resting.load(Ordering::Relaxed))
    }

    /// How many workers rest.
    pub(super) fn resting(&self) -> usize {
        self.resting.iter().filter(|resting| resting.load(Ordering::Relaxed)).count()
    }

    /// Asks the loop to publish a last stop command and to end. The first reason stays.
    pub(super) fn request_stop(&self, reason: StopReason) {
        let _ = self.stop.compare_exchange(0, reason as u32, Ordering::AcqRel, Ordering::Acquire);
    }

    /// Why the run is to end, if it is.
    pub(super) fn stop_requested(&self) -> Option<StopReason> {
        StopReason::from_code(self.stop.load(Ordering::Acquire))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_period_is_complete_when_every_worker_is_done_with_it() {
        let board = Board::new(vec![0], 2, Wakeup::Futex);
        // The last one is far beyond what is kept of a tick, and the largest that can be released.
        for tick in [0, 1, 2, (1 << 32) - 1, 1 << 32, (1 << 48) - 1, 1 << 48, u64::MAX - 2] {
            board.release(tick);
            assert_eq!(board.released(None), Released::Tick(tick));
            assert_eq!(board.released(Some(tick)), Released::Nothing);
            assert!(!board.complete(tick));
            // Somebody is late with an earlier period.
            board.done(tick.wrapping_sub(1));
            board.done(tick);
            assert!(!board.complete(tick));
            let count = board.completions.count();
            board.done(tick);
            assert!(board.complete(tick));
            assert_eq!(board.completions.count(), count + 1);
        }
        board.end();
        assert_eq!(board.released(Some(u64::MAX - 2)), Released::Over);
    }
}
