use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use super::staging::Staging;
use crate::wire::StopReason;

/// No period has been released yet.
const NOTHING: u64 = 0;
/// The run is over.
const OVER: u64 = u64::MAX;

/// What the loop, the workers and the supervisor share: a few words and the staged commands.
#[derive(Debug)]
pub(super) struct Board {
    /// One more than the tick that was released last.
    released: AtomicU64,
    /// Code of the reason to stop the run; 0 while it goes on.
    stop: AtomicU32,
    /// Commands on their way from the workers to the loop.
    pub(super) staging: Staging,
    /// Times that a worker panicked.
    pub(super) worker_panics: AtomicU64,
    /// Workers that panicked too often and stay down.
    pub(super) workers_lost: AtomicU64,
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
    pub(super) fn new(ids: Vec<u32>) -> Self {
        Self {
            released: AtomicU64::new(NOTHING),
            stop: AtomicU32::new(0),
            staging: Staging::new(ids),
            worker_panics: AtomicU64::new(0),
            workers_lost: AtomicU64::new(0),
        }
    }

    /// Lets the workers start on `tick`; everything written before is visible to them.
    pub(super) fn release(&self, tick: u64) {
        self.released.store(tick + 1, Ordering::Release);
    }

    /// Sends the workers home.
    pub(super) fn end(&self) {
        self.released.store(OVER, Ordering::Release);
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

    /// Asks the loop to publish a last stop command and to end. The first reason stays.
    pub(super) fn request_stop(&self, reason: StopReason) {
        let _ = self.stop.compare_exchange(0, reason as u32, Ordering::AcqRel, Ordering::Acquire);
    }

    /// Why the run is to end, if it is.
    pub(super) fn stop_requested(&self) -> Option<StopReason> {
        StopReason::from_code(self.stop.load(Ordering::Acquire))
    }
}
