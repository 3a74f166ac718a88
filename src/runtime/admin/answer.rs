use std::time::Duration;

use super::Shared;
use crate::channel::Attached;
use crate::config::SourceKind;
use crate::journal::StoppedBy;
use crate::runtime::keeping::{Condition, Journal};
use crate::runtime::{Progress, Until};
use crate::wire::{AdminAnswer, AdminCode, AdminRequest, admin_flags, state_flags};

/// What became of the requests so far.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Tally {
    pub(super) done: u64,
    pub(super) refused: u64,
    pub(super) busy: u64,
}

/// What every answer tells about the daemon.
pub(super) struct Facts<'a> {
    pub(super) progress: Progress,
    /// Bits of [`state_flags`] that hold the fleet.
    pub(super) hold: u32,
    pub(super) robots: usize,
    pub(super) capacity: usize,
    pub(super) attached: Attached,
    pub(super) uptime: Duration,
    pub(super) tally: Tally,
    /// When the answer is given, ns.
    pub(super) now_ns: u64,
    pub(super) worker_panics: u64,
    /// Times that the thread which answers panicked.
    pub(super) admin_panics: u64,
    /// Times that somebody who joined could not be connected.
    pub(super) attach_failures: u64,
    pub(super) shared: &'a Shared,
}

impl Facts<'_> {
    /// What falls short, a line each.
    pub(super) fn degraded(&self) -> Vec<String> {
        let mut lines = self.shared.realtime.degraded.clone();
        if self.admin_panics > 0 {
            lines.push(format!(
                "the thread that answers operators panicked, times: {}; requests were lost, look at the log",
                self.admin_panics
            ));
        }
        if self.attach_failures > 0 {
            lines.push(format!(
                "somebody who joined could not be connected, times: {}; file descriptors may be short (LimitNOFILE)",
                self.attach_failures
            ));
        }
        lines
    }

    pub(super) fn answer(
        &self,
        request: &AdminRequest,
        code: AdminCode,
        robot: u32,
        acts_from_tick: u64,
        text_bytes: usize,
    ) -> AdminAnswer {
        let (progress, config, attached) = (&self.progress, &self.shared.config, &self.attached);
        AdminAnswer {
            ticket: request.ticket,
            epoch: self.shared.epoch,
            stamp_ns: self.now_ns,
            acts_from_tick,
            code: code as u32,
            kind: request.kind,
            robot,
            flags: self.flags(),
            text_bytes: text_bytes as u64,
            tick: progress.tick,
            period_ns: config.timing.period_ns,
            uptime_ns: u64::try_from(self.uptime.as_nanos()).unwrap_or(u64::MAX),
            periods: progress.ticks,
            deadline_misses: progress.deadline_misses,
            skipped_periods: progress.skipped_periods,
            fallback_commands: progress.fallback_commands,
            rejected_inputs: progress.rejected_inputs,
            lost_records: progress.lost_records,
            worker_panics: self.worker_panics,
            release_lateness_max_ns: progress.release_lateness_max_ns,
            solve_p99_ns: progress.solve_p99_ns,
            min_clearance_m: progress.min_clearance_m,
            requests_done: self.tally.done,
            requests_refused: self.tally.refused,
            requests_busy: self.tally.busy,
            capacity: count(self.capacity),
            robots: count(self.robots),
            arrived: count(progress.arrived),
            stalled: count(progress.stalled),
            unseen: count(progress.unseen),
            workers: count(self.shared.workers),
            workers_silent: count(progress.workers_silent),
            degraded: count(self.degraded().len()),
            // The workers read the states as well.
            state_readers: count(attached.state_readers.saturating_sub(self.shared.workers)),
            command_readers: count(attached.command_readers),
            telemetry_readers: count(attached.telemetry_readers),
            observation_writers: count(attached.observation_writers),
            admin_clients: count(attached.admin_clients),
            restarts: count(self.journal().map_or(0, |journal| journal.restarts)),
        }
    }

    fn journal(&self) -> Option<Condition> {
        self.shared.journal.as_ref().map(Journal::condition)
    }

    fn flags(&self) -> u32 {
        let journal = self.journal();
        let stopped_by = |by| journal.is_some_and(|journal| journal.stopped == Some(by));
        let realtime = &self.shared.realtime;
        let observed = self.shared.config.source.kind == SourceKind::Observation;
        [
            (self.hold & state_flags::PAUSED != 0, admin_flags::PAUSED),
            (self.hold & state_flags::STOPPED != 0, admin_flags::STOPPED),
            (!self.degraded().is_empty(), admin_flags::DEGRADED),
            (realtime.memory_locked, admin_flags::MEMORY_LOCKED),
            (observed, admin_flags::OBSERVED),
            (self.shared.until == Until::Arrived, admin_flags::ENDS_ON_ARRIVAL),
            (self.shared.board.resting() > 0, admin_flags::WORKER_RESTING),
            (journal.is_some(), admin_flags::JOURNAL),
            (journal.is_some_and(|journal| journal.failing), admin_flags::JOURNAL_FAILING),
            (stopped_by(StoppedBy::Restarts), admin_flags::STOPPED_BY_RESTARTS),
            (stopped_by(StoppedBy::Journal), admin_flags::STOPPED_BY_JOURNAL),
        ]
        .into_iter()
        .filter(|(holds, _)| *holds)
        .fold(0, |flags, (_, flag)| flags | flag)
    }
}

fn count(n: usize) -> u32 {
    u32::try_from(n).unwrap_or(u32::MAX)
}
