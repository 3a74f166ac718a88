use std::sync::Arc;
use std::time::{Duration, Instant};

use super::supervisor::Supervisor;

/// Periods without a record after which the loop hangs, or is kept from running.
const SILENT_PERIODS: u32 = 3;
/// What this thread may sleep and be late in addition.
const SLACK: Duration = Duration::from_millis(50);
/// Between two lines about how it goes.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// What the supervisor is told: that the first commands are out, then twice in every time that it gives us
/// that the loop and all workers made their last period, and that the run ends. Nothing while one of them
/// hangs: it then ends this process and starts another.
#[derive(Debug)]
pub(super) struct Heartbeat {
    supervisor: Option<Arc<Supervisor>>,
    /// The loop hangs when it leaves no record for this long.
    patience: Duration,
    recorded: Option<Instant>,
    /// The commands of a period were published.
    commanded: bool,
    ready: bool,
    stopping: bool,
    due: Instant,
    status_due: Instant,
}

impl Heartbeat {
    pub(super) fn new(supervisor: Option<Arc<Supervisor>>, period: Duration) -> Self {
        let now = Instant::now();
        Self {
            supervisor,
            patience: SILENT_PERIODS * period + SLACK,
            recorded: None,
            commanded: false,
            ready: false,
            stopping: false,
            due: now,
            status_due: now,
        }
    }

    /// The loop has left the record of a period, and `published` its commands or not.
    pub(super) fn period_over(&mut self, published: bool) {
        self.recorded = Some(Instant::now());
        self.commanded |= published;
    }

    /// Says what is due, if the workers have `answered` the last period and the loop goes on.
    pub(super) fn beat(&mut self, answered: bool, status: impl FnOnce() -> String) {
        let Some(supervisor) = self.supervisor.clone().filter(|_| self.commanded) else { return };
        let now = Instant::now();
        if !self.ready {
            self.ready = supervisor.tell("READY=1\n");
        }
        if now >= self.status_due && supervisor.tell(&format!("STATUS={}\n", status())) {
            self.status_due = now + STATUS_EVERY;
        }
        let goes_on = self.recorded.is_some_and(|at| at.elapsed() < self.patience);
        // What is due stays due until all is well again, or there is room for it.
        if let Some(within) = supervisor.watchdog()
            && now >= self.due
            && goes_on
            && answered
            && supervisor.tell("WATCHDOG=1\n")
        {
            self.due = now + within / 2;
        }
    }

    /// Says that the run ends.
    pub(super) fn stopping(&mut self) {
        if let Some(supervisor) = &self.supervisor
            && !self.stopping
        {
            self.stopping = supervisor.tell("STOPPING=1\n");
        }
    }
}
