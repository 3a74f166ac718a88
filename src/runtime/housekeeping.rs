use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use super::Until;
use super::answers::Answers;
use super::board::{Board, Released};
use super::driven::Driven;
use super::error::DaemonError;
use super::findings::Findings;
use super::forecast::Forecast;
use super::heartbeat::Heartbeat;
use super::progress::Progress;
use super::spread::{publish, publish_checkpoint};
use super::statistics::Statistics;
use super::threads::{Common, poll_interval};
use super::truth::Truth;
use super::watchdog::Change;
use crate::audit::Auditor;
use crate::channel::{Attachment, Writer};
use crate::figures::Accumulator;
use crate::model::Command;
use crate::solver::ClarabelSolver;
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{RobotCheckpoint, RobotTelemetry, StopReason, TelemetryHeader, state_flags};

/// How often dead processes are cleaned up and changes are logged.
const CHORES_EVERY: Duration = Duration::from_secs(1);

/// Periods whose work is compared before the workers' regions are changed.
const REBALANCE_PERIODS: u64 = 16;

/// Solutions that the audit looks at in one round: a few hundred microseconds of Clarabel.
const AUDITS_A_ROUND: usize = 8;

/// The thread that may allocate, format and wait: it turns records into figures, samples on
/// `telemetry` and log lines.
pub(super) struct Housekeeper {
    node: Attachment,
    telemetry: Writer<RobotTelemetry>,
    checkpoints: Writer<RobotCheckpoint>,
    periods: Arc<Pool<PeriodRecord>>,
    solves: Vec<Arc<Pool<SolveRecord>>>,
    board: Arc<Board>,
    accumulator: Accumulator,
    driven: Driven,
    truth: Truth,
    answers: Answers,
    statistics: Statistics,
    fleet: Fleet,
    progress: Arc<Mutex<Progress>>,
    until: Until,
    /// Every robot has arrived and stands, now and in the next period.
    settled: bool,
    forecast: Forecast,
    poll: Duration,
    started: Instant,
    first_tick: u64,
    heartbeat: Heartbeat,
    auditor: Option<Auditor<ClarabelSolver>>,
}

impl Housekeeper {
    /// Makes what it needs: a place in shared memory, its channels, room for the figures.
    ///
    /// # Errors
    /// The reasons for which one of them cannot be made.
    pub(super) fn new(
        common: &Common,
        until: Until,
        periods: Arc<Pool<PeriodRecord>>,
        solves: Vec<Arc<Pool<SolveRecord>>>,
        progress: Arc<Mutex<Progress>>,
        auditor: Option<Auditor<ClarabelSolver>>,
    ) -> Result<Self, DaemonError> {
        let config = &common.config;
        let robots = config.places();
        let period_s = config.timing.period_s();
        let node = common.transport.attach("clearwayd-house")?;
        Ok(Self {
            telemetry: node.writer(robots)?,
            checkpoints: node.writer(robots)?,
            node,
            periods,
            answers: Answers::new(solves.len()),
            solves,
            board: Arc::clone(&common.board),
            accumulator: Accumulator::with_places(&config.scenario, robots, period_s)
                .on_plant(config.source.plant),
            driven: Driven::with_robots(robots, period_s),
            truth: Truth::new(config),
            statistics: Statistics::new(robots, period_s)?,
            fleet: Fleet::default(),
            progress,
            until,
            settled: false,
            forecast: Forecast::new(config),
            poll: poll_interval(config),
            started: Instant::now(),
            first_tick: config.timing.first_tick,
            heartbeat: Heartbeat::new(
                common.supervisor.clone(),
                Duration::from_nanos(config.timing.period_ns),
            ),
            auditor,
        })
    }

    /// Keeps house until the loop has ended and everything it left is read.
    pub(super) fn run(mut self) -> Findings {
        let mut chores_due = self.started + CHORES_EVERY;
        loop {
            // Looked at first: what was left before the end is then read in the round.
            let over = self.board.released(None) == Released::Over;
            self.round();
            self.beat(over);
            if over && let Some(auditor) = &mut self.auditor {
                auditor.audit(usize::MAX);
            }
            if self.until == Until::Arrived && self.settled {
                self.board.request_stop(StopReason::Finished);
            }
            if over {
                self.say();
                self.statistics.worker_panics = self.board.worker_panics.load(Ordering::Relaxed);
                self.statistics.admin_panics = self.board.admin_panics.load(Ordering::Relaxed);
                self.statistics.attach_failures = self.node.attach_failures();
                self.statistics.corrupt_states = self.board.corrupt_states.load(Ordering::Relaxed);
                let audit = self.auditor.as_ref().map(Auditor::report);
                return Findings { accumulator: self.accumulator, statistics: self.statistics, audit };
            }
            if Instant::now() >= chores_due {
                chores_due += CHORES_EVERY;
                self.chores();
            }
            std::thread::sleep(self.poll);
        }
    }

    /// Reads what has been left, and shows how the run is going.
    pub(super) fn round(&mut self) {
        self.drain();
        if let Some(auditor) = &mut self.auditor {
            auditor.audit(AUDITS_A_ROUND);
        }
        self.statistics.lost_records = self.lost();
        self.rebalance();
        self.show();
    }

    fn drain(&mut self) {
        let Self {
            periods,
            solves,
            accumulator,
            answers,
            statistics,
            telemetry,
            checkpoints,
            settled,
            forecast,
            auditor,
            driven,
            fleet,
            truth,
            first_tick,
            heartbeat,
            ..
        } = self;
        // Figures count time from the start of the run.
        let since_start = |tick: u64| tick.saturating_sub(*first_tick);
        let audit = auditor.as_ref().map(Auditor::report).unwrap_or_default();
        let mut more = true;
        while more {
            more = periods
                .read(|period| {
                    let tick = period.header.tick;
                    // A worker that was in time left its record before the loop left this one.
                    answers.drain(solves, accumulator, statistics);
                    answers.watchdog.period_over(tick, |change| tell(tick, change));
                    heartbeat.period_over(period.published);
                    let header = TelemetryHeader {
                        audited: audit.audited,
                        audit_disagreed: audit.disagreed,
                        audit_max_input_gap: audit.max_input_gap,
                        ..statistics.add_period(period, answers.answered(tick))
                    };
                    if let Some((skipped, states)) = driven.unrecorded(period) {
                        truth.observe(accumulator, since_start(skipped), states);
                    }
                    truth.observe(accumulator, since_start(tick), &period.states);
                    *fleet = Fleet::of(period, answers.stalled(tick));
                    *settled = accumulator.all_arrived() && stands(period);
                    publish(telemetry, &header, period, answers, forecast);
                    publish_checkpoint(checkpoints, period, answers);
                    driven.remember(period);
                    answers.put_away(solves, tick);
                })
                .is_some();
        }
        answers.drain(solves, accumulator, statistics);
    }

    /// Tells the supervisor that everything goes its way, if it does.
    fn beat(&mut self, over: bool) {
        if over || self.board.stop_requested().is_some() {
            return self.heartbeat.stopping();
        }
        // One that rests is known of, and a restart would not make it work sooner.
        let answered = self.answers.watchdog.all_answered(|worker| self.board.rests(worker));
        self.heartbeat.operators_heard(self.board.admin_rounds.load(Ordering::Relaxed));
        let progress = &self.progress;
        self.heartbeat.beat(answered, || {
            let progress = progress.lock().unwrap_or_else(PoisonError::into_inner);
            let held = match (progress.stopped, progress.paused) {
                (true, _) => "STOPPED, ",
                (false, true) => "PAUSED, ",
                (false, false) => "",
            };
            format!(
                "{held}{} of {} robots arrived, tick {}",
                progress.arrived, progress.robots, progress.tick
            )
        });
    }

    /// Asks for other regions when the workers answer more or less than theirs. The commands never depend on it.
    fn rebalance(&mut self) {
        let workers = self.solves.len();
        if workers < 2 || self.answers.records < REBALANCE_PERIODS * workers as u64 {
            return;
        }
        if let Some(cuts) = self.board.regions.balanced(&self.answers.answered) {
            self.board.regions.want(&cuts);
        }
        self.answers.answered.fill(0);
        self.answers.records = 0;
    }

    fn lost(&self) -> u64 {
        self.periods.lost() + self.solves.iter().map(|pool| pool.lost()).sum::<u64>()
    }

    fn show(&mut self) {
        let mut progress = self.progress.lock().unwrap_or_else(PoisonError::into_inner);
        self.statistics.fill(&mut progress);
        let since_start = progress.tick.saturating_sub(self.first_tick);
        progress.wall_s = self.started.elapsed().as_secs_f64();
        progress.arrived = self.accumulator.arrived();
        if self.statistics.ticks > 0 {
            progress.robots = self.fleet.robots;
            (progress.stalled, progress.unseen) = (self.fleet.stalled, self.fleet.unseen);
            (progress.paused, progress.stopped) = (self.fleet.paused, self.fleet.stopped);
        }
        progress.min_clearance_m = self.accumulator.min_clearance_m();
        progress.time_s = (since_start + 1) as f64 * self.statistics.period_s;
        progress.workers_silent = self.answers.watchdog.silent();
        progress.worker_panics = self.board.worker_panics.load(Ordering::Relaxed);
        progress.admin_panics = self.board.admin_panics.load(Ordering::Relaxed);
        progress.attach_failures = self.node.attach_failures();
    }

    fn chores(&mut self) {
        let cleaned = self.node.clean_up();
        if cleaned.removed + cleaned.failed > 0 {
            tracing::info!(
                removed = cleaned.removed,
                failed = cleaned.failed,
                "cleaned up after dead processes"
            );
        }
        self.say();
    }

    /// Everything that was counted and timed so far.
    pub(super) fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Logs what is new since the last time.
    pub(super) fn say(&mut self) {
        let (discarded, unattached) = (self.telemetry.discarded(), self.node.attach_failures());
        self.statistics.log_changes(discarded, unattached, &self.board);
    }
}

/// Who is how in the period that was recorded last.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Fleet {
    robots: usize,
    stalled: usize,
    unseen: usize,
    paused: bool,
    stopped: bool,
}

impl Fleet {
    fn of(period: &PeriodRecord, stalled: impl Iterator<Item = usize>) -> Self {
        let stalled = stalled.filter_map(|index| period.states.get(index));
        let away =
            stalled.filter(|state| !state.has(state_flags::VACANT) && !state.has(state_flags::ARRIVED));
        let stalled = away.count();
        let mut fleet = Self { stalled, ..Self::default() };
        for state in period.states.iter().filter(|state| !state.has(state_flags::VACANT)) {
            fleet.robots += 1;
            fleet.unseen += usize::from(!state.has(state_flags::VALID));
            fleet.paused |= state.has(state_flags::PAUSED);
            fleet.stopped |= state.has(state_flags::STOPPED);
        }
        fleet
    }
}

fn tell(tick: u64, change: Change) {
    match change {
        Change::FellSilent(worker) => {
            tracing::error!(tick, worker, "a worker does not answer in time; its robots stand still");
        }
        Change::Returned(worker) => tracing::info!(tick, worker, "a worker answers again"),
    }
}

fn stands(period: &PeriodRecord) -> bool {
    period.states.iter().all(|state| state.command() == Command::STOP)
        && period.commands.iter().all(|command| command.command() == Command::STOP)
}
