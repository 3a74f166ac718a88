use std::collections::BTreeMap;
use std::sync::atomic::Ordering;

use hdrhistogram::errors::CreationError;

use super::answers::Answered;
use super::board::Board;
use super::progress::Progress;
use crate::admission::Rejections;
use crate::figures::LatencyHistogram;
use crate::telemetry::PeriodRecord;
use crate::wire::{RobotCommand, RobotTelemetry, SolveStatus, StopReason, TelemetryHeader};

/// Everything about a run that is counted or timed.
#[derive(Debug, Clone)]
pub(super) struct Statistics {
    pub(super) robots: u64,
    pub(super) period_s: f64,
    pub(super) last: TelemetryHeader,
    pub(super) ticks: u64,
    pub(super) published: u64,
    pub(super) skipped_periods: u64,
    pub(super) deadline_misses: u64,
    pub(super) fallback_commands: u64,
    pub(super) stops: BTreeMap<&'static str, u64>,
    pub(super) release_lateness: LatencyHistogram,
    pub(super) state_publish: LatencyHistogram,
    pub(super) state_to_worker: LatencyHistogram,
    pub(super) state_to_staged: LatencyHistogram,
    pub(super) state_to_command: LatencyHistogram,
    pub(super) deadline_lateness: LatencyHistogram,
    pub(super) solve: LatencyHistogram,
    pub(super) step: LatencyHistogram,
    pub(super) rejections: Rejections,
    pub(super) send_failures: u64,
    pub(super) lost_records: u64,
    pub(super) worker_panics: u64,
    pub(super) admin_panics: u64,
    pub(super) corrupt_states: u64,
    pub(super) attach_failures: u64,
    logged: Logged,
}

/// What the log has told so far.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
struct Logged {
    misses: u64,
    fallbacks: u64,
    rejected: u64,
    frozen: u64,
    resynchronised: u64,
    lost: u64,
    discarded: u64,
    failures: u64,
    panics: u64,
    corrupt: u64,
    worker_rests: u64,
    unattached: u64,
}

impl Statistics {
    pub(super) fn new(robots: usize, period_s: f64) -> Result<Self, CreationError> {
        Ok(Self {
            robots: robots as u64,
            period_s,
            last: TelemetryHeader::default(),
            ticks: 0,
            published: 0,
            skipped_periods: 0,
            deadline_misses: 0,
            fallback_commands: 0,
            stops: BTreeMap::new(),
            release_lateness: LatencyHistogram::new()?,
            state_publish: LatencyHistogram::new()?,
            state_to_worker: LatencyHistogram::new()?,
            state_to_staged: LatencyHistogram::new()?,
            state_to_command: LatencyHistogram::new()?,
            deadline_lateness: LatencyHistogram::new()?,
            solve: LatencyHistogram::new()?,
            step: LatencyHistogram::new()?,
            rejections: Rejections::default(),
            send_failures: 0,
            lost_records: 0,
            worker_panics: 0,
            admin_panics: 0,
            corrupt_states: 0,
            attach_failures: 0,
            logged: Logged::default(),
        })
    }

    /// Adds one robot's solve.
    pub(super) fn add_solve(&mut self, robot: &RobotTelemetry) {
        if robot.status != SolveStatus::NotSolved as u32 {
            self.solve.record(robot.solve_ns);
            self.step.record(robot.step_ns);
        }
    }

    /// Adds a period and completes its header.
    pub(super) fn add_period(&mut self, period: &PeriodRecord, answer: Answered) -> TelemetryHeader {
        let mut header = period.header;
        let missing = self.count_stops(period);
        let driven = |c: &&RobotCommand| StopReason::from_code(c.stop_reason).is_none_or(|r| !r.is_wanted());
        let commanded = period.commands.iter().filter(driven).count() as u64;
        let stopped = if period.published { missing.stops } else { commanded };
        // The first skipped period was driven by commands that are counted where they were given; the
        // one that is recorded here was not, and takes its place.
        header.fallback_commands = stopped + header.skipped_periods * commanded;
        if answer.known as u64 == self.robots {
            header.state_to_staged_ns = answer.staged_ns;
            self.state_to_staged.record(answer.staged_ns);
        }
        self.ticks += 1;
        self.skipped_periods += header.skipped_periods;
        self.deadline_misses += header.skipped_periods + u64::from(missing.late || !period.published);
        self.fallback_commands += header.fallback_commands;
        self.release_lateness.record(header.release_lateness_ns);
        self.state_publish.record(header.state_publish_ns);
        if period.published {
            self.state_to_command.record(header.state_to_command_ns);
            self.published += 1;
        }
        self.deadline_lateness.record(header.deadline_lateness_ns);
        self.rejections = period.rejections;
        self.send_failures = period.send_failures;
        self.last = header;
        header
    }

    fn count_stops(&mut self, period: &PeriodRecord) -> Missing {
        let mut missing = Missing { stops: 0, late: false };
        for command in period.commands.iter().filter(|command| command.stop_reason != 0) {
            let reason = StopReason::from_code(command.stop_reason);
            if matches!(reason, Some(StopReason::Foreign | StopReason::Vacant)) {
                continue;
            }
            *self.stops.entry(reason.map_or("unknown", StopReason::name)).or_default() += 1;
            missing.stops += u64::from(reason.is_none_or(|reason| !reason.is_wanted()));
            missing.late |= reason == Some(StopReason::Deadline);
        }
        missing
    }

    pub(super) fn fill(&self, progress: &mut Progress) {
        progress.ticks = self.ticks;
        progress.tick = self.last.tick;
        progress.release_lateness_ns = self.last.release_lateness_ns;
        progress.release_lateness_max_ns = self.release_lateness.max();
        progress.solve_p99_ns = self.solve.p99();
        progress.skipped_periods = self.skipped_periods;
        progress.deadline_misses = self.deadline_misses;
        progress.fallback_commands = self.fallback_commands;
        progress.rejected_inputs = self.rejections.total();
        progress.lost_records = self.lost_records;
    }

    /// One line for each kind of trouble that is new since the last call.
    pub(super) fn log_changes(&mut self, discarded: u64, unattached: u64, board: &Board) {
        let now = Logged {
            misses: self.deadline_misses,
            fallbacks: self.fallback_commands,
            rejected: self.rejections.total(),
            frozen: self.rejections.frozen_robots,
            resynchronised: self.rejections.resynchronised_writers,
            lost: self.lost_records,
            discarded,
            failures: self.send_failures,
            panics: board.worker_panics.load(Ordering::Relaxed),
            corrupt: board.corrupt_states.load(Ordering::Relaxed),
            worker_rests: board.worker_rests.load(Ordering::Relaxed),
            unattached,
        };
        let before = std::mem::replace(&mut self.logged, now);
        let tick = self.last.tick;
        let line = |new: u64, old: u64, text: &str| {
            if new > old {
                tracing::warn!(tick, new = new - old, total = new, "{text}");
            }
        };
        line(now.misses, before.misses, "periods without a complete command in time");
        line(now.fallbacks, before.fallbacks, "stops sent in place of verified commands");
        line(now.rejected, before.rejected, "observations refused");
        line(now.frozen, before.frozen, "robots whose pose does not change although they are told to drive");
        let followed = "observation writers whose first number had been wrong: followed anew";
        line(now.resynchronised, before.resynchronised, followed);
        line(now.lost, before.lost, "telemetry records lost: the housekeeping thread is too slow");
        line(now.discarded, before.discarded, "telemetry samples discarded: a reader is too slow");
        line(now.failures, before.failures, "samples that could not be loaned or sent to every reader");
        line(
            now.corrupt,
            before.corrupt,
            "states that changed in memory before a worker read them; who went without an answer stopped",
        );
        line(now.panics, before.panics, "worker panics; who went without an answer stopped");
        line(
            now.worker_rests,
            before.worker_rests,
            "workers that rest after repeated panics; their robots stand",
        );
        line(
            now.unattached,
            before.unattached,
            "connections that could not be made to who joined: no file descriptors left, or memory that cannot be mapped",
        );
    }
}

struct Missing {
    stops: u64,
    late: bool,
}
