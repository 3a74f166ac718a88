use std::num::NonZeroU64;
use std::ops::Range;
use std::path::Path;
use std::sync::mpsc::sync_channel;
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::Until;
use super::admin::{self, admin_thread};
use super::board::Board;
use super::decider::Decider;
use super::desk::Desk;
use super::error::DaemonError;
use super::findings::Findings;
use super::housekeeping::Housekeeper;
use super::keeping::{Keeper, Opened};
use super::progress::Progress;
use super::starting::{EndOnDrop, StopOnDrop, join_until, shares, spawn, wait};
use super::supervisor::Supervisor;
use super::threads::{
    Begin, Common, HELD_BESIDE, MakeSource, Outside, loop_thread, record_capacity, worker_thread,
};
use crate::audit::{self, Auditor, Recorder};
use crate::channel::Transport;
use crate::clock::{Clock, MonotonicClock, SlowedClock};
use crate::config::{Config, SolverKind};
use crate::controller::{ControllerError, RobotGroup, Robots, RouteShelf, rows_max};
use crate::realtime::{Achieved, Awake, Placement, lock_memory, stay_awake, usable_cpus};
use crate::report::Report;
use crate::solver::ClarabelSolver;
use crate::source::StateSource;
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{NO_ROBOT, StopReason, state_flags};

/// How long threads may take to come home at the end.
const PATIENCE: Duration = Duration::from_secs(2);

/// Readers that a channel has room for besides the workers, at least.
const READERS_BESIDE_WORKERS: usize = 8;

/// Solutions that wait for the audit at most.
const AUDIT_SLOTS: usize = 64;

/// The two sides of the shadow audit; `None` when it is off, or when Clarabel is the solver itself.
fn shadow_audit(config: &Config) -> Result<Option<(Recorder, Auditor<ClarabelSolver>)>, DaemonError> {
    let every = config.telemetry.audit_every;
    if every == 0 || config.controller.solver == SolverKind::Clarabel {
        return Ok(None);
    }
    let rows = rows_max(&config.controller);
    let solver = ClarabelSolver::new(rows)
        .map_err(|e| DaemonError::Controller { worker: "the audit".to_owned(), reason: e.to_string() })?;
    Ok(Some(audit::start(solver, rows, AUDIT_SLOTS, every)))
}

/// The number of a run: rises from run to run as long as the machine is up, and shared memory lasts no
/// longer; unlike the wall clock it cannot be set back. With a journal it rises over reboots as well.
fn epoch(journal: Option<&Opened>) -> u64 {
    MonotonicClock.now_ns().max(journal.map_or(0, |journal| journal.kept().epoch))
}

/// What the journal says of how the fleet was left.
fn begin(journal: Option<&Opened>) -> Begin {
    let Some(journal) = journal else { return Begin::default() };
    let bit = |holds, bit| if holds { bit } else { 0 };
    let kept = journal.kept();
    let hold = bit(kept.paused, state_flags::PAUSED) | bit(kept.stopped.is_some(), state_flags::STOPPED);
    Begin { hold, anywhere: journal.again() }
}

/// A running daemon. Dropping it ends the run and waits for its threads, but not for ever.
#[derive(Debug)]
pub struct Daemon {
    config: Arc<Config>,
    board: Arc<Board>,
    progress: Arc<Mutex<Progress>>,
    realtime: Achieved,
    loop_thread: Option<JoinHandle<Option<StopReason>>>,
    workers: Vec<JoinHandle<()>>,
    housekeeping: Option<JoinHandle<Option<Findings>>>,
    admin: Option<JoinHandle<()>>,
    /// Dropped last: what the others still change is kept as well.
    keeper: Option<Keeper>,
    _awake: Option<Awake>,
}

impl Daemon {
    /// Starts the fleet of `config`.
    ///
    /// # Errors
    /// Those of [`Daemon::start_with`].
    pub fn start(config: Config, until: Until) -> Result<Self, DaemonError> {
        Self::start_controlled(config, until, Outside::default())
    }

    /// [`start`](Self::start) for a supervisor that wants to hear how it goes: that the first commands
    /// are out, that the loop and all workers make their periods, that the run ends.
    ///
    /// # Errors
    /// Those of [`Daemon::start_with`].
    pub fn start_supervised(
        config: Config,
        until: Until,
        supervisor: Option<Supervisor>,
    ) -> Result<Self, DaemonError> {
        let supervisor = supervisor.map(Arc::new);
        Self::start_controlled(config, until, Outside { supervisor, ..Outside::default() })
    }

    /// Starts the fleet of `config` with states from a source that `make` builds, in the loop's thread,
    /// given the time of the first period in ns.
    ///
    /// # Errors
    /// Those of [`Daemon::start_with`].
    pub fn start_from<F>(config: Config, until: Until, make: F) -> Result<Self, DaemonError>
    where
        F: Fn(&Config, u64) -> Box<dyn StateSource> + Send + Sync + 'static,
    {
        Self::start_controlled(config, until, Outside { source: Some(Arc::new(make)), ..Outside::default() })
    }

    /// [`start_from`](Self::start_from) with time passing `slowdown` times slower, for the loop, the
    /// workers and every stamp: what a period takes beyond its end can then be measured. Operators'
    /// requests do not expire as they should.
    ///
    /// # Errors
    /// Those of [`Daemon::start_with`].
    pub fn start_slowed<F>(
        config: Config,
        until: Until,
        slowdown: NonZeroU64,
        make: F,
    ) -> Result<Self, DaemonError>
    where
        F: Fn(&Config, u64) -> Box<dyn StateSource> + Send + Sync + 'static,
    {
        let (source, clock) = (Some(Arc::new(make) as MakeSource), SlowedClock::new(slowdown));
        Self::start_controlled(config, until, Outside { source, clock, ..Outside::default() })
    }

    pub(super) fn start_controlled(
        config: Config,
        until: Until,
        outside: Outside,
    ) -> Result<Self, DaemonError> {
        let (config, journal) = Opened::open(config, until)?;
        let for_workers = config.clone();
        let (recorder, auditor) = match shadow_audit(&config)? {
            Some((recorder, auditor)) => (Some(recorder), Some(auditor)),
            None => (None, None),
        };
        let shelf = Arc::new(RouteShelf::new(config.places()));
        let routes = Arc::clone(&shelf);
        let robots = Arc::new(Robots::new(&config));
        Self::start_audited((config, journal), until, outside, auditor, shelf, move |_| {
            let group = RobotGroup::among(&for_workers, Arc::clone(&robots))?;
            let group = group.with_routes(Arc::clone(&routes));
            Ok::<_, ControllerError>(match &recorder {
                Some(recorder) => group.audited_by(recorder.clone()),
                None => group,
            })
        })
    }

    /// Starts the fleet of `config` with controllers that `make` builds, one for each worker's
    /// range of robots, in the worker's thread. Returns when the first period is scheduled.
    ///
    /// # Errors
    /// [`DaemonError`]: the fleet has another owner, a real-time call was refused under `require`,
    /// a channel, a controller or a thread could not be made. Nothing is left running.
    pub fn start_with<D, E, F>(config: Config, until: Until, make: F) -> Result<Self, DaemonError>
    where
        D: Decider,
        E: std::fmt::Display,
        F: Fn(Range<usize>) -> Result<D, E> + Send + Sync + 'static,
    {
        let (config, journal) = Opened::open(config, until)?;
        let shelf = Arc::new(RouteShelf::new(config.places()));
        Self::start_audited((config, journal), until, Outside::default(), None, shelf, make)
    }

    pub(super) fn start_audited<D, E, F>(
        (mut config, journal): (Config, Option<Opened>),
        until: Until,
        outside: Outside,
        auditor: Option<Auditor<ClarabelSolver>>,
        shelf: Arc<RouteShelf>,
        make: F,
    ) -> Result<Self, DaemonError>
    where
        D: Decider,
        E: std::fmt::Display,
        F: Fn(Range<usize>) -> Result<D, E> + Send + Sync + 'static,
    {
        let mut realtime = Achieved::default();
        realtime.add_memory(lock_memory(&config.realtime));
        let awake = realtime.add_awake(stay_awake(&config.realtime));
        let robots = config.scenario.robots.len();
        let places = config.places();
        let placement = Placement::new(&config.realtime, config.timing.workers, robots, &usable_cpus());
        // However many workers there are, others find a place beside them.
        let readers = &mut config.channel.max_readers;
        *readers = (*readers).max(placement.worker_cpus.len() + READERS_BESIDE_WORKERS);
        let config = Arc::new(config);
        let mut ids: Vec<u32> = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
        ids.resize(places, NO_ROBOT);
        let board = Arc::new(Board::new(ids, placement.worker_cpus.len(), config.realtime.wakeup));
        let transport = Transport::new(&config.fleet, &config.channel)?;
        let removed = transport.mend()?;
        if removed > 0 {
            tracing::warn!(removed, "the channels could not be used as they were left and are made anew");
        }
        // What a dead daemon left is removed by now, and does not count as taken.
        transport.check_room(places, config.admin.max_clients)?;
        let common = Common {
            transport,
            config: Arc::clone(&config),
            board: Arc::clone(&board),
            desk: Arc::new(Desk::new(admin::desk_size(&config)).with_shelf(shelf)),
            epoch: epoch(journal.as_ref()),
            begin: begin(journal.as_ref()),
            clock: outside.clock,
            source: outside.source,
            supervisor: outside.supervisor,
        };
        let mut daemon = Self {
            config,
            board,
            progress: Arc::new(Mutex::new(Progress { robots, ..Progress::default() })),
            realtime,
            loop_thread: None,
            workers: Vec::new(),
            housekeeping: None,
            admin: None,
            keeper: None,
            _awake: awake,
        };
        daemon.spawn_all(&common, journal, until, &placement, auditor, make)?;
        Ok(daemon)
    }

    fn spawn_all<D, E, F>(
        &mut self,
        common: &Common,
        journal: Option<Opened>,
        until: Until,
        placement: &Placement,
        auditor: Option<Auditor<ClarabelSolver>>,
        make: F,
    ) -> Result<(), DaemonError>
    where
        D: Decider,
        E: std::fmt::Display,
        F: Fn(Range<usize>) -> Result<D, E> + Send + Sync + 'static,
    {
        let config = Arc::clone(&self.config);
        let (robots, places) = (config.scenario.robots.len(), config.places());
        let capacity = record_capacity(&config);
        let periods = Arc::new(Pool::new(capacity, || PeriodRecord::with_robots(places)));
        let (go, going) = sync_channel(1);

        // One channel a thread: a thread that dies before it is ready closes its own.
        let (ready, readiness) = sync_channel(1);
        let thread = {
            let (common, periods) = (common.clone(), Arc::clone(&periods));
            let seat = placement.seat(placement.loop_cpu);
            spawn("clearway-loop", move || {
                let end = EndOnDrop(&common.board);
                let reason = loop_thread(&common, until, seat, periods, &ready, &going);
                drop(end);
                reason
            })?
        };
        self.loop_thread = Some(thread);
        // Before anybody else touches the fleet: this one tells whether it is ours.
        self.realtime.add_thread(wait(&readiness)?);

        let make = Arc::new(make);
        let mut solves = Vec::new();
        for (index, owned) in shares(robots, places, placement.worker_cpus.len()).enumerate() {
            let records = Arc::new(Pool::new(capacity + HELD_BESIDE, || {
                SolveRecord::with_room(owned.len().max(common.board.regions.room()))
            }));
            solves.push(Arc::clone(&records));
            let (common, make) = (common.clone(), Arc::clone(&make));
            let (ready, readiness) = sync_channel(1);
            let seat = placement.seat(placement.worker_cpus[index]);
            self.workers.push(spawn(&format!("clearway-w{index}"), move || {
                worker_thread(&common, index, owned, seat, records, &*make, &ready);
            })?);
            self.realtime.add_thread(wait(&readiness)?);
        }
        if !self.realtime.satisfies(config.realtime.policy) {
            return Err(DaemonError::RealTime { degraded: self.realtime.degraded.clone() });
        }
        self.spawn_housekeeping(common, until, periods, solves, auditor)?;
        self.keeper = journal.map(|journal| journal.keeper(common.epoch));
        self.spawn_admin(common, until)?;
        // Everybody has made its ports.
        common.transport.reserve(places, config.admin.max_clients)?;
        // The fleet is ours, and everything else has been had: a start that fails is no crash.
        self.keeper.as_mut().map_or(Ok(()), Keeper::begin)?;
        go.send(()).map_err(|_| DaemonError::Panicked { thread: "loop" })
    }

    fn spawn_admin(&mut self, common: &Common, until: Until) -> Result<(), DaemonError> {
        let shared = admin::Shared {
            config: Arc::clone(&common.config),
            board: Arc::clone(&common.board),
            desk: Arc::clone(&common.desk),
            progress: Arc::clone(&self.progress),
            realtime: self.realtime.clone(),
            workers: self.workers.len(),
            epoch: common.epoch,
            hold: common.begin.hold,
            journal: self.keeper.as_ref().map(Keeper::journal),
            until,
        };
        let (ready, readiness) = sync_channel(1);
        let transport = common.transport.clone();
        self.admin = Some(spawn("clearway-admin", move || admin_thread(&transport, shared, &ready))?);
        readiness.recv().map_err(|_| DaemonError::Panicked { thread: "admin" })?
    }

    fn spawn_housekeeping(
        &mut self,
        common: &Common,
        until: Until,
        periods: Arc<Pool<PeriodRecord>>,
        solves: Vec<Arc<Pool<SolveRecord>>>,
        auditor: Option<Auditor<ClarabelSolver>>,
    ) -> Result<(), DaemonError> {
        let (common, progress) = (common.clone(), Arc::clone(&self.progress));
        let (ready, readiness) = sync_channel(1);
        let thread = spawn("clearway-house", move || {
            let housekeeper = match Housekeeper::new(&common, until, periods, solves, progress, auditor) {
                Ok(housekeeper) => housekeeper,
                Err(e) => {
                    let _ = ready.send(Err(e));
                    return None;
                }
            };
            let _ = ready.send(Ok(()));
            // The loop must not run on with nobody to notice that it is to end.
            let stop = StopOnDrop(&common.board);
            let findings = housekeeper.run();
            drop(stop);
            Some(findings)
        })?;
        self.housekeeping = Some(thread);
        readiness.recv().map_err(|_| DaemonError::Panicked { thread: "housekeeping" })??;
        Ok(())
    }

    /// What the kernel granted.
    pub fn realtime(&self) -> &Achieved {
        &self.realtime
    }

    /// The file in which this run is kept, if it is.
    pub fn journal(&self) -> Option<&Path> {
        self.keeper.as_ref().map(Keeper::path)
    }

    /// How the run is going, a few milliseconds ago.
    pub fn progress(&self) -> Progress {
        self.progress.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Asks the run to end with a last stop command, at the start of the next period.
    pub fn stop(&self) {
        self.board.request_stop(StopReason::Operator);
    }

    /// Whether the run is over.
    pub fn is_finished(&self) -> bool {
        self.housekeeping.as_ref().is_none_or(JoinHandle::is_finished)
    }

    /// Waits for the end of the run.
    ///
    /// # Errors
    /// [`DaemonError::Panicked`] when the loop or the housekeeping did.
    pub fn join(mut self) -> Result<Report, DaemonError> {
        let reason = self.loop_thread.take().map(JoinHandle::join);
        let findings = self.housekeeping.take().map(JoinHandle::join);
        let Some(Ok(Some(reason))) = reason else { return Err(DaemonError::Panicked { thread: "loop" }) };
        let Some(Ok(Some(findings))) = findings else {
            return Err(DaemonError::Panicked { thread: "housekeeping" });
        };
        let workers = self.workers.len();
        let hung = self.join_workers();
        self.join_admin();
        if let Some(keeper) = &mut self.keeper {
            keeper.end_in_order();
        }
        Ok(findings.report(&self.config, &self.realtime, reason, workers, hung))
    }

    /// Waits for the workers, and returns how many of them hang and have to be left behind.
    fn join_workers(&mut self) -> usize {
        let end = Instant::now() + PATIENCE;
        // A panic in a worker was caught and counted inside.
        self.workers.drain(..).filter_map(|worker| join_until(worker, end).err()).count()
    }

    /// Waits for the thread that answers operators; one that builds a route among many obstacles is left
    /// behind.
    fn join_admin(&mut self) {
        if let Some(thread) = self.admin.take() {
            match join_until(thread, Instant::now() + PATIENCE) {
                Ok(Ok(())) => {}
                Ok(Err(_)) => tracing::error!("the thread that answers operators panicked"),
                Err(_) => tracing::warn!("the thread that answers operators does not end"),
            }
        }
    }
}

impl Drop for Daemon {
    fn drop(&mut self) {
        self.stop();
        // Without housekeeping the loop was never told to go, and nobody else sends the workers home.
        if self.housekeeping.is_none() {
            self.board.end();
        }
        // Threads that are cut off by the end of the process leave their files in shared memory.
        let end = Instant::now() + PATIENCE;
        if let Some(thread) = self.loop_thread.take() {
            let _ = join_until(thread, end);
        }
        self.join_workers();
        self.join_admin();
        if let Some(thread) = self.housekeeping.take() {
            let _ = join_until(thread, end);
        }
    }
}
