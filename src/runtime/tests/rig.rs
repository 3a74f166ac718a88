//! A loop and its workers, each in a thread of its own, under a clock that waits for them.

use std::ops::Range;
use std::sync::Arc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use super::support::{World, config};
use super::{START, T};
use crate::channel::{Attachment, CommandReader, StateReader, Transport};
use crate::clock::{Clock, SlowedClock};
use crate::config::Config;
use crate::plant::Plant;
use crate::runtime::board::{Board, Released};
use crate::runtime::control_loop::ControlLoop;
use crate::runtime::decider::Decider;
use crate::runtime::desk::Desk;
use crate::runtime::loop_memory::LoopMemory;
use crate::runtime::threads::{Begin, Common};
use crate::runtime::worker::Worker;
use crate::scenario::Scenario;
use crate::schedule::Schedule;
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{CommandHeader, RobotCommand, RobotState, StateHeader, StopReason};

/// Whether the deadline of a tick may come.
pub(super) type Ready = Box<dyn Fn(&Board, u64) -> bool + Send + Sync>;

/// A clock whose deadline comes when the workers are done, and the next period when the reader has seen this
/// one; work takes no time unless somebody lets it pass.
#[derive(Clone)]
pub(super) struct Lockstep(Arc<LockstepState>);

pub(super) struct LockstepState {
    now_ns: Arc<AtomicU64>,
    schedule: Schedule,
    board: Arc<Board>,
    ready: Ready,
    /// Periods that the reader has seen the state of.
    seen: Arc<AtomicU64>,
}

impl Lockstep {
    /// Lets what is left of `tick` pass up to its deadline, once that may come.
    fn pass_deadline(&self, tick: u64, wake_ns: u64) {
        while !(self.0.ready)(&self.0.board, tick) {
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
        self.0.now_ns.fetch_max(wake_ns, Ordering::AcqRel);
    }

    /// Periods that take no time would otherwise be over before a reader that has to wait for a CPU has taken
    /// the first of them, and it would miss what its queue does not hold.
    fn wait_for_the_reader(&self, tick: u64) {
        while self.0.seen.load(Ordering::Acquire) <= tick {
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
    }
}

impl Clock for Lockstep {
    fn now_ns(&self) -> u64 {
        self.0.now_ns.load(Ordering::Acquire)
    }

    fn sleep_until(&self, wake_ns: u64) {
        match self.0.board.released(None) {
            Released::Tick(tick) if wake_ns == self.0.schedule.deadline_ns(tick) => {
                self.pass_deadline(tick, wake_ns);
            }
            released => {
                if let Released::Tick(tick) = released {
                    self.wait_for_the_reader(tick);
                }
                self.0.now_ns.fetch_max(wake_ns, Ordering::AcqRel);
            }
        }
    }

    fn spin_until(&self, wake_ns: u64) {
        self.sleep_until(wake_ns);
    }

    /// The loop waits for its workers. The deadline comes when it may and they are not done.
    fn wait(&self, _: &AtomicU32, _: u32, wake_ns: u64) {
        let Released::Tick(tick) = self.0.board.released(None) else { return };
        while !self.0.board.complete(tick) {
            if (self.0.ready)(&self.0.board, tick) && !self.0.board.staging.complete(tick) {
                return self.pass_deadline(tick, wake_ns);
            }
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
    }
}

/// What a reader saw of a run.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Seen {
    pub(super) states: Vec<(StateHeader, Vec<RobotState>)>,
    pub(super) commands: Vec<(CommandHeader, Vec<RobotCommand>)>,
}

pub(super) struct Rig {
    pub(super) config: Config,
    pub(super) ticks: u64,
    pub(super) now_ns: Arc<AtomicU64>,
    pub(super) ready: Ready,
}

impl Rig {
    pub(super) fn new(world: &World, scenario: Scenario, workers: usize, ticks: u64) -> Self {
        let mut config = config(world, scenario, T);
        config.timing.workers = Some(workers);
        config.timing.deadline_margin_ns = Some(T / 10);
        let ready = Box::new(|board: &Board, tick| board.staging.complete(tick));
        Self { config, ticks, now_ns: Arc::new(AtomicU64::new(START - T)), ready }
    }

    /// Runs with one thread a worker and the loop in this one.
    pub(super) fn run<D: Decider>(
        self,
        make: impl Fn(Range<usize>) -> D + Send + Sync,
    ) -> (Seen, Arc<Board>) {
        let Self { config, ticks, now_ns, ready } = self;
        let robots = config.scenario.robots.len();
        let workers = config.timing.workers.unwrap_or(1);
        let wakeup = config.realtime.wakeup;
        let ids = config.scenario.robots.iter().map(|r| r.id.0).collect();
        let board = Arc::new(Board::new(ids, workers, config.realtime.wakeup));
        let transport = Transport::new(&config.fleet, &config.channel).unwrap();
        let node = transport.attach("test").unwrap();
        let (states, commands) = (node.writer(robots).unwrap(), node.writer(robots).unwrap());
        let schedule = Schedule::new(START, T, T / 10);
        let common = Common {
            source: None,
            supervisor: None,
            config: Arc::new(config.clone()),
            transport: transport.clone(),
            board: Arc::clone(&board),
            desk: Arc::new(Desk::new(4)),
            epoch: 7,
            begin: Begin::default(),
            clock: SlowedClock::default(),
        };
        let periods_seen = Arc::new(AtomicU64::new(0));
        let seen = Arc::clone(&periods_seen);
        let state = LockstepState { now_ns, schedule, board: Arc::clone(&board), ready, seen };
        let clock = Lockstep(Arc::new(state));
        let (watching, watched) = std::sync::mpsc::channel();
        std::thread::scope(|scope| {
            for w in 0..workers {
                let (transport, board, make) = (transport.clone(), Arc::clone(&board), &make);
                let (ready, readiness) = std::sync::mpsc::channel();
                let owned = w * robots / workers..(w + 1) * robots / workers;
                scope.spawn(move || {
                    let mut worker = Worker {
                        index: w,
                        wakeup,
                        due_ns: 0,
                        robots,
                        epoch: 7,
                        clock: SlowedClock::default(),
                        states: transport.attach("worker").unwrap().reader().unwrap(),
                        board,
                        records: Arc::new(Pool::new(4, || SolveRecord::with_room(robots))),
                        owned: owned.clone(),
                    };
                    ready.send(()).unwrap();
                    worker.run(make(owned.clone()), || Some(make(owned.clone())));
                });
                readiness.recv().unwrap();
            }
            let watcher = {
                let (board, transport) = (Arc::clone(&board), transport.clone());
                let node = move || transport.attach("watcher").unwrap();
                scope.spawn(move || watch(&node(), &board, &watching, &periods_seen))
            };
            watched.recv().unwrap();
            let mut control_loop = ControlLoop {
                clock,
                schedule,
                epoch: 7,
                tick_end: ticks,
                tolerance_m: config.scenario.tolerance_m,
                limits: config.scenario.limits,
                states,
                commands,
                source: Box::new(Plant::new(&config.scenario, T, START)),
                board: Arc::clone(&board),
                publish_at: config.timing.publish,
                wakeup,
                records: Arc::new(Pool::new(2, || PeriodRecord::with_robots(robots))),
                desk: Arc::clone(&common.desk),
                memory: LoopMemory::new(common.first_states()),
            };
            assert_eq!(control_loop.run(), StopReason::Finished);
            (watcher.join().unwrap(), Arc::clone(&board))
        })
    }
}

pub(super) fn watch(
    node: &Attachment,
    board: &Board,
    watching: &std::sync::mpsc::Sender<()>,
    periods_seen: &AtomicU64,
) -> Seen {
    let (mut states, mut commands): (StateReader, CommandReader) =
        (node.reader().unwrap(), node.reader().unwrap());
    watching.send(()).unwrap();
    let mut seen = Seen::default();
    let mut over = false;
    while !over {
        over = board.released(None) == Released::Over;
        while let Some(sample) = states.next().unwrap() {
            seen.states.push((*sample.header(), sample.robots().to_vec()));
            periods_seen.store(sample.header().tick + 1, Ordering::Release);
        }
        while let Some(sample) = commands.next().unwrap() {
            seen.commands.push((*sample.header(), sample.robots().to_vec()));
        }
        std::thread::yield_now();
    }
    seen
}
