use super::statistics::Statistics;
use crate::audit::AuditReport;
use crate::config::Config;
use crate::figures::Accumulator;
use crate::realtime::Achieved;
use crate::report::{self, Report};
use crate::wire::StopReason;

/// What housekeeping knows at the end.
pub(super) struct Findings {
    pub(super) accumulator: Accumulator,
    pub(super) statistics: Statistics,
    pub(super) audit: Option<AuditReport>,
}

impl Findings {
    /// The report of a run that ended for `reason`, with `workers` workers of which `workers_hung` did
    /// not come home.
    pub(super) fn report(
        self,
        config: &Config,
        realtime: &Achieved,
        reason: StopReason,
        workers: usize,
        workers_hung: usize,
    ) -> Report {
        let Self { accumulator, statistics, audit } = self;
        Report {
            scenario: config.scenario.name.clone(),
            profile: config.controller.profile.name(),
            solver: config.controller.solver.name(),
            control: accumulator.finish(),
            ended_by: reason.name(),
            workers,
            period_ns: config.timing.period_ns,
            ticks: statistics.ticks,
            published_periods: statistics.published,
            skipped_periods: statistics.skipped_periods,
            deadline_misses: statistics.deadline_misses,
            fallback_commands: statistics.fallback_commands,
            stops: statistics.stops,
            release_lateness_ns: statistics.release_lateness.summary(),
            state_publish_ns: statistics.state_publish.summary(),
            state_to_worker_ns: statistics.state_to_worker.summary(),
            state_to_staged_ns: statistics.state_to_staged.summary(),
            state_to_command_ns: statistics.state_to_command.summary(),
            deadline_lateness_ns: statistics.deadline_lateness.summary(),
            solve_ns: statistics.solve.summary(),
            step_ns: statistics.step.summary(),
            realtime: realtime.clone(),
            rejected_inputs: statistics.rejections,
            audit,
            worker_panics: statistics.worker_panics,
            admin_panics: statistics.admin_panics,
            corrupt_states: statistics.corrupt_states,
            workers_hung,
            lost_records: statistics.lost_records,
            send_failures: statistics.send_failures,
            attach_failures: statistics.attach_failures,
            kernel: report::kernel(),
            cpu: report::cpu(),
        }
    }
}
