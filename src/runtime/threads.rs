use std::sync::Arc;
use std::sync::mpsc::{Receiver, SyncSender};
use std::time::Duration;

use super::Until;
use super::board::Board;
use super::control_loop::ControlLoop;
use super::decider::Decider;
use super::desk::Desk;
use super::error::DaemonError;
use super::loop_memory::LoopMemory;
use super::supervisor::Supervisor;
use super::worker::Worker;
use crate::channel::Transport;
use crate::clock::{Clock, SlowedClock};
use crate::config::{Config, SourceKind};
use crate::plant::Plant;
use crate::realtime::{Role, Seat, ThreadGrant, enter};
use crate::schedule::{Schedule, TICK_MAX};
use crate::source::{Observed, StateSource};
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{RobotCheckpoint, RobotCommand, RobotState, RobotTelemetry, StopReason};

/// Periods between the go and period 0, so that every thread is asleep when it starts.
const LEAD_PERIODS: u64 = 2;
/// At least this long, ns: whoever waits for the fleet has then found it, and sees it from period 0.
const LEAD_NS_MIN: u64 = 100_000_000;

/// How a thread tells that it is ready, or why it is not.
pub(super) type Ready = SyncSender<Result<ThreadGrant, DaemonError>>;

/// What every thread is given.
#[derive(Clone)]
pub(super) struct Common {
    pub(super) config: Arc<Config>,
    pub(super) transport: Transport,
    pub(super) board: Arc<Board>,
    pub(super) desk: Arc<Desk>,
    pub(super) epoch: u64,
    pub(super) begin: Begin,
    /// The loop's and the workers' time.
    pub(super) clock: SlowedClock,
    /// Makes another source than the configured one.
    pub(super) source: Option<MakeSource>,
    /// Who wants to hear how it goes.
    pub(super) supervisor: Option<Arc<Supervisor>>,
}

/// What of the run before is still so when a run begins.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Begin {
    /// Bits of [`crate::wire::state_flags`] that hold the fleet.
    pub(super) hold: u32,
    /// Robots may stand anywhere until they are seen.
    pub(super) anywhere: bool,
}

/// What a daemon is given from outside instead of what it would make itself.
#[derive(Clone, Default)]
pub(super) struct Outside {
    pub(super) source: Option<MakeSource>,
    pub(super) clock: SlowedClock,
    pub(super) supervisor: Option<Arc<Supervisor>>,
}

/// Makes the source of a daemon's states, given the time of the first period, ns.
pub(super) type MakeSource = Arc<dyn Fn(&Config, u64) -> Box<dyn StateSource> + Send + Sync>;

impl Common {
    fn places(&self) -> usize {
        self.config.places()
    }

    /// The first period that does not run any more.
    pub(super) fn tick_end(&self, until: Until) -> u64 {
        let timing = &self.config.timing;
        let time_up = match until {
            Until::Stopped => u64::MAX,
            // Saturates; a duration that long ends never.
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "checked to be positive"
            )]
            Until::Arrived => (self.config.scenario.duration_s / timing.period_s()).ceil() as u64,
        };
        timing.first_tick.saturating_add(timing.ticks.unwrap_or(time_up)).min(TICK_MAX)
    }

    /// States before the first period: at the starts, at rest, not valid; then the free places.
    pub(super) fn first_states(&self) -> Vec<RobotState> {
        let mut states: Vec<_> = self.config.scenario.robots.iter().map(RobotState::at_start).collect();
        states.resize_with(self.places(), RobotState::vacant);
        states
    }
}

/// The loop thread: makes its ports, says so, waits for the go, runs.
pub(super) fn loop_thread(
    common: &Common,
    until: Until,
    seat: Seat,
    records: Arc<Pool<PeriodRecord>>,
    ready: &Ready,
    go: &Receiver<()>,
) -> Option<StopReason> {
    let config = &common.config;
    let prepared = (|| {
        let node = common.transport.attach("clearwayd")?;
        // The state channel's only writer is the fleet's owner.
        let states = node.writer(common.places())?;
        let commands = node.writer(common.places())?;
        let observations = match config.source.kind {
            SourceKind::Plant => None,
            SourceKind::Observation => Some(node.reader_or_create(common.places())?),
        };
        Ok::<_, DaemonError>((states, commands, observations))
    })();
    let (states, commands, observations) = match prepared {
        Ok(ports) => ports,
        Err(e) => {
            let _ = ready.send(Err(e));
            return None;
        }
    };
    let grant = enter(Role::Loop, &config.realtime, seat);
    let wakeup = grant.wakeup;
    let _ = ready.send(Ok(grant));
    // Nobody sends when the start is called off.
    go.recv().ok()?;

    let clock = common.clock;
    let period_ns = config.timing.period_ns;
    let start_ns = clock.now_ns() + (LEAD_PERIODS * period_ns).max(LEAD_NS_MIN);
    let scenario = &config.scenario;
    let source: Box<dyn StateSource> = match (&common.source, observations) {
        (Some(make), _) => make(config, start_ns),
        (None, None) => {
            let plant = Plant::new(scenario, period_ns, start_ns).unreported().moved_by(config.source.plant);
            let plant = plant.disturbed(scenario, &config.disturbance, period_ns);
            Box::new(plant.with_places(common.places()))
        }
        (None, Some(reader)) => {
            let places = common.places();
            let observed = Observed::with_places(reader, scenario, &config.source, period_ns, places);
            let observed = observed.tolerating(&config.robust);
            Box::new(if common.begin.anywhere { observed.standing_anywhere() } else { observed })
        }
    };
    // The workers' memory is mapped now and not in period 0.
    let _ = (states.connect(), commands.connect());
    let mut control_loop = ControlLoop {
        clock,
        schedule: Schedule::new(start_ns, period_ns, config.timing.margin_ns())
            .numbered_from(config.timing.first_tick),
        epoch: common.epoch,
        tick_end: common.tick_end(until),
        tolerance_m: scenario.tolerance_m,
        limits: scenario.limits,
        states,
        commands,
        source,
        board: Arc::clone(&common.board),
        publish_at: config.timing.publish,
        wakeup,
        records,
        desk: Arc::clone(&common.desk),
        memory: LoopMemory::new(common.first_states()).allowing_for(config).held(common.begin.hold),
    };
    Some(control_loop.run())
}

/// A worker thread: makes its reader and its controller, says so, works until the end.
pub(super) fn worker_thread<D: Decider, E: std::fmt::Display>(
    common: &Common,
    index: usize,
    owned: std::ops::Range<usize>,
    seat: Seat,
    records: Arc<Pool<SolveRecord>>,
    make: &(impl Fn(std::ops::Range<usize>) -> Result<D, E> + ?Sized),
    ready: &Ready,
) {
    let prepared = (|| {
        let node = common.transport.attach(&format!("clearwayd-worker{index}"))?;
        let states = node.reader()?;
        let decider = make(owned.clone()).map_err(|e| DaemonError::Controller {
            worker: Role::Worker(index).to_string(),
            reason: e.to_string(),
        })?;
        Ok::<_, DaemonError>((states, decider))
    })();
    let (states, decider) = match prepared {
        Ok(prepared) => prepared,
        Err(e) => {
            let _ = ready.send(Err(e));
            return;
        }
    };
    let grant = enter(Role::Worker(index), &common.config.realtime, seat);
    let wakeup = grant.wakeup;
    let _ = ready.send(Ok(grant));
    let mut worker = Worker {
        index,
        wakeup,
        due_ns: 0,
        owned: owned.clone(),
        robots: common.places(),
        epoch: common.epoch,
        clock: common.clock,
        states,
        board: Arc::clone(&common.board),
        records,
    };
    worker.run(decider, || make(owned.clone()).ok());
}

/// Memory that the records of large fleets may take.
const RECORDS_BYTES: usize = 256 << 20;
/// Records that telemetry keeps however large the fleet is.
const RECORDS_MIN: usize = 6;
/// Periods beyond these that are held: the last one that was read, and of the workers the one that runs. They take
/// their records when it begins and the loop its own when it ends, and who has one shall have the others.
pub(super) const HELD_BESIDE: usize = 1;

/// What a place takes in each record: in the loop's, and in those of the workers, whose rooms together are
/// half as many again as the places.
const PLACE_BYTES: usize = {
    let solved = size_of::<(usize, RobotTelemetry)>() + size_of::<(usize, RobotCheckpoint)>();
    size_of::<RobotState>() + size_of::<RobotCommand>() + solved + solved / 2
};

/// Records that telemetry keeps: what is configured, and at least half a second's worth; of a large
/// fleet as many as fit into [`RECORDS_BYTES`].
pub(super) fn record_capacity(config: &Config) -> usize {
    let half_second = 500_000_000 / config.timing.period_ns.max(1);
    let wanted = config.telemetry.queue_periods.max(usize::try_from(half_second).unwrap_or(usize::MAX));
    let fit = (RECORDS_BYTES / (PLACE_BYTES * config.places().max(1))).saturating_sub(HELD_BESIDE);
    wanted.min(fit.max(RECORDS_MIN))
}

/// How long housekeeping sleeps between two looks at the records.
pub(super) fn poll_interval(config: &Config) -> Duration {
    Duration::from_nanos(config.timing.period_ns / 2)
        .clamp(Duration::from_millis(1), Duration::from_millis(20))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn records_of_every_place_fit_into_their_memory() {
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.telemetry.queue_periods = 65_536;
        for places in [8, 1000, 20_000, 131_072] {
            config.admin.capacity = places;
            assert_eq!(config.places(), places);
            let records = record_capacity(&config);
            // For every second place: three in the workers' rooms.
            let (period, solved) = (PeriodRecord::with_robots(2), SolveRecord::with_room(3));
            let two = size_of_val(&*period.states)
                + size_of_val(&*period.commands)
                + solved.robots.capacity() * size_of::<(usize, RobotTelemetry)>()
                + solved.checkpoints.capacity() * size_of::<(usize, RobotCheckpoint)>();
            let bytes = places / 2 * two;
            let fits = (records + HELD_BESIDE) * bytes <= RECORDS_BYTES;
            assert!(fits || records == RECORDS_MIN, "{places}: {records} of {bytes}");
            assert!(!fits || (records + HELD_BESIDE + 1) * bytes > RECORDS_BYTES, "{places}: room for more");
        }
    }
}
