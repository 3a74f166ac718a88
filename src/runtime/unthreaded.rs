//! The daemon without its threads: the same loop, workers, housekeeping and admin, which take turns.
//!
//! The loop runs on a clock of whoever drives it, and that clock lets the [`Crew`] have its turns while the
//! loop sleeps or waits. What runs is the daemon's own; only who calls it is not.

use std::sync::atomic::Ordering;
use std::sync::{Arc, Mutex, PoisonError};

use super::admin::{self, Admin};
use super::board::{Board, Released};
use super::control_loop::ControlLoop;
use super::decider::Decider;
use super::desk::Desk;
use super::error::DaemonError;
use super::findings::Findings;
use super::housekeeping::Housekeeper;
use super::loop_memory::LoopMemory;
use super::progress::Progress;
use super::starting::shares;
use super::statistics::Statistics;
use super::threads::{Begin, Common, HELD_BESIDE, record_capacity};
use super::worker::{Shift, Worker};
use super::{Counts, Until};
use crate::channel::memory::Queue;
use crate::channel::{Attachment, Transport};
use crate::clock::{Clock, SlowedClock};
use crate::config::{Config, PublishAt, SourceKind, Wakeup};
use crate::controller::RouteShelf;
use crate::realtime::{Achieved, Role};
use crate::report::Report;
use crate::schedule::Schedule;
use crate::source::{Observed, StateSource};
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{NO_ROBOT, RobotState, StopReason};

/// What a daemon is put together from.
pub(crate) struct Outline {
    pub(crate) config: Config,
    pub(crate) transport: Transport,
    pub(crate) workers: usize,
    pub(crate) epoch: u64,
    /// When the first period starts, ns.
    pub(crate) start_ns: u64,
    pub(crate) shelf: Arc<RouteShelf>,
}

/// The loop.
pub(crate) struct LoopHand<C: Clock>(ControlLoop<C>);

impl<C: Clock> LoopHand<C> {
    /// Runs until a stop is asked for or the last period is over; returns why.
    pub(crate) fn run(mut self) -> StopReason {
        self.0.run()
    }
}

/// A worker and what it keeps.
type Hand<C, D> = (Worker<C>, Shift<D>);

/// Everybody but the loop.
pub(crate) struct Crew<C: Clock, D> {
    pub(crate) node: Attachment,
    config: Arc<Config>,
    board: Arc<Board>,
    workers: Vec<Hand<C, D>>,
    make: Box<dyn Fn(usize) -> Option<D>>,
    housekeeper: Housekeeper,
    admin: Admin<C>,
    progress: Arc<Mutex<Progress>>,
}

/// Puts a daemon that hears observations together. The loop runs on `loop_clock` and everybody else tells
/// the time by `clock`; `make` builds the decider of a worker, `wrap` may stand before the source.
///
/// # Errors
/// The reasons for which a channel or a controller cannot be made.
pub(crate) fn build<L: Clock, C: Clock + Clone, D: Decider>(
    outline: Outline,
    loop_clock: L,
    clock: &C,
    make: impl Fn(usize) -> Option<D> + 'static,
    wrap: impl FnOnce(Observed) -> Box<dyn StateSource>,
) -> Result<(LoopHand<L>, Crew<C, D>), DaemonError> {
    let Outline { mut config, transport, workers, epoch, start_ns, shelf } = outline;
    config.source.kind = SourceKind::Observation;
    config.timing.publish = PublishAt::Complete;
    // Places that nobody takes are part of every sample.
    let (robots, places) = (config.scenario.robots.len(), config.places());
    let mut ids: Vec<u32> = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
    ids.resize(places, NO_ROBOT);
    let board = Arc::new(Board::new(ids, workers, Wakeup::Futex));
    let config = Arc::new(config);
    let common = Common {
        config: Arc::clone(&config),
        transport,
        board: Arc::clone(&board),
        desk: Arc::new(Desk::new(admin::desk_size(&config)).with_shelf(shelf)),
        epoch,
        begin: Begin::default(),
        clock: SlowedClock::default(),
        source: None,
        supervisor: None,
    };
    let node = common.transport.attach("clearwayd")?;
    let (states, commands) = (node.writer(places)?, node.writer(places)?);
    let reader = node.reader_or_create(places)?;
    let capacity = record_capacity(&config);
    let periods = Arc::new(Pool::new(capacity, || PeriodRecord::with_robots(places)));
    let (mut hands, mut solves) = (Vec::new(), Vec::new());
    for (index, owned) in shares(robots, places, workers).enumerate() {
        let room = owned.len().max(board.regions.room());
        let records = Arc::new(Pool::new(capacity + HELD_BESIDE, || SolveRecord::with_room(room)));
        solves.push(Arc::clone(&records));
        let worker = Worker {
            index,
            wakeup: Wakeup::Futex,
            due_ns: 0,
            owned,
            robots: places,
            epoch,
            clock: clock.clone(),
            states: node.reader()?,
            board: Arc::clone(&board),
            records,
        };
        let decider = make(index).ok_or_else(|| DaemonError::Controller {
            worker: Role::Worker(index).to_string(),
            reason: "it could not be made".to_owned(),
        })?;
        hands.push((worker, Shift::new(decider)));
    }
    let progress = Arc::new(Mutex::new(Progress { robots, ..Progress::default() }));
    let (records, shown) = (Arc::clone(&periods), Arc::clone(&progress));
    let housekeeper = Housekeeper::new(&common, Until::Stopped, records, solves, shown, None)?;
    let shared = admin::Shared {
        config: Arc::clone(&config),
        board: Arc::clone(&board),
        desk: Arc::clone(&common.desk),
        progress: Arc::clone(&progress),
        realtime: Achieved::default(),
        workers,
        epoch,
        hold: common.begin.hold,
        journal: None,
        until: Until::Stopped,
    };
    let server = node.admin_server(config.admin.max_clients)?;
    let desk = common.transport.attach("clearwayd-admin")?;
    let admin = Admin::new(clock.clone(), desk, server, shared);
    let period_ns = config.timing.period_ns;
    let observed = Observed::with_places(reader, &config.scenario, &config.source, period_ns, places);
    let control_loop = ControlLoop {
        clock: loop_clock,
        schedule: Schedule::new(start_ns, period_ns, config.timing.margin_ns())
            .numbered_from(config.timing.first_tick),
        epoch,
        tick_end: common.tick_end(Until::Stopped),
        tolerance_m: config.scenario.tolerance_m,
        limits: config.scenario.limits,
        states,
        commands,
        source: wrap(observed.tolerating(&config.robust)),
        board: Arc::clone(&board),
        publish_at: PublishAt::Complete,
        wakeup: Wakeup::Futex,
        records: periods,
        desk: Arc::clone(&common.desk),
        memory: LoopMemory::new(common.first_states()).allowing_for(&config).held(common.begin.hold),
    };
    let crew =
        Crew { node, config, board, workers: hands, make: Box::new(make), housekeeper, admin, progress };
    Ok((LoopHand(control_loop), crew))
}

impl<C: Clock, D: Decider> Crew<C, D> {
    /// The period that was released last, while the run goes on.
    pub(crate) fn released(&self) -> Option<u64> {
        match self.board.released(None) {
            Released::Tick(tick) => Some(tick),
            Released::Nothing | Released::Over => None,
        }
    }

    /// Lets a worker work through the period that runs, if it is a new one.
    pub(crate) fn work(&mut self, worker: usize) {
        let make = &self.make;
        if let Some((hand, shift)) = self.workers.get_mut(worker) {
            hand.turn(shift, || make(worker));
        }
    }

    /// Whether somebody answered robot `index` in period `tick`.
    pub(crate) fn has_answer(&self, index: usize, tick: u64) -> bool {
        self.board.staging.take(index, tick).is_some()
    }

    /// What waits for a worker on `state`, where that is in memory.
    pub(crate) fn states(&self, worker: usize) -> Option<&Arc<Queue<RobotState>>> {
        self.workers.get(worker)?.0.states.queue()
    }

    /// Keeps house: reads what was left, and says what is new.
    pub(crate) fn keep_house(&mut self) {
        self.housekeeper.round();
        self.housekeeper.say();
    }

    /// Answers operators.
    pub(crate) fn answer(&mut self) {
        self.admin.round(false);
    }

    /// Asks for a last stop.
    pub(crate) fn stop(&self) {
        self.board.request_stop(StopReason::Operator);
    }

    /// How the run is going.
    pub(crate) fn progress(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Everything that is counted.
    pub(crate) fn counts(&self) -> Counts {
        let statistics: &Statistics = self.housekeeper.statistics();
        Counts {
            rejections: statistics.rejections,
            stops: statistics.stops.clone(),
            skipped_periods: statistics.skipped_periods,
            deadline_misses: statistics.deadline_misses,
            fallback_commands: statistics.fallback_commands,
            send_failures: statistics.send_failures,
            lost_records: statistics.lost_records,
            worker_panics: self.board.worker_panics.load(Ordering::Relaxed),
            worker_rests: self.board.worker_rests.load(Ordering::Relaxed),
            corrupt_states: self.board.corrupt_states.load(Ordering::Relaxed),
            workers_silent: self.progress().workers_silent as u64,
        }
    }

    /// The report of a run that ended for `reason`.
    pub(crate) fn report(self, reason: StopReason) -> Report {
        let findings: Findings = self.housekeeper.run();
        findings.report(&self.config, &Achieved::default(), reason, self.workers.len(), 0)
    }
}
