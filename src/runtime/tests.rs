//! The loop and its workers over real shared memory, in lockstep under a virtual clock: nothing here
//! depends on how fast the machine is.

use std::ops::Range;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

use super::board::{Board, Released};
use super::control_loop::{ControlLoop, LoopMemory};
use super::decider::Decider;
use super::desk::Desk;
use super::supervisor::Supervisor;
use super::threads::{Begin, Common, MakeSource, Outside};
use super::worker::Worker;
use super::{Daemon, Until};
use crate::admission::Rejections;
use crate::channel::{Attachment, CommandReader, StateReader, Transport};
use crate::clock::{Clock, SlowedClock};
use crate::config::{Config, PublishAt, Wakeup};
use crate::controller::{Decision, RobotGroup, Robots, RouteShelf, Timing};
use crate::model::RobotSpec;
use crate::plant::Plant;
use crate::scenario::Scenario;
use crate::schedule::{Schedule, TICK_MAX};
use crate::source::{Instant, StateSource};
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{
    CommandHeader, RobotCheckpoint, RobotCommand, RobotIntent, RobotState, StateHeader, StopReason,
};

#[path = "../../tests/support/mod.rs"]
pub(super) mod support;
use support::{World, config, lanes, straight};

const T: u64 = 80_000_000;
const START: u64 = 1_000_000_000;

/// Whether the deadline of a tick may come.
type Ready = Box<dyn Fn(&Board, u64) -> bool + Send + Sync>;
/// What goes wrong in a worker's n-th period.
type Fault = Arc<dyn Fn(u64, &Range<usize>) + Send + Sync>;

/// A clock whose deadline comes when the workers are done, and the next period when the reader has seen this
/// one; work takes no time unless somebody lets it pass.
#[derive(Clone)]
struct Lockstep(Arc<LockstepState>);

struct LockstepState {
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
struct Seen {
    states: Vec<(StateHeader, Vec<RobotState>)>,
    commands: Vec<(CommandHeader, Vec<RobotCommand>)>,
}

struct Rig {
    config: Config,
    ticks: u64,
    now_ns: Arc<AtomicU64>,
    ready: Ready,
}

impl Rig {
    fn new(world: &World, scenario: Scenario, workers: usize, ticks: u64) -> Self {
        let mut config = config(world, scenario, T);
        config.timing.workers = Some(workers);
        config.timing.deadline_margin_ns = Some(T / 10);
        let ready = Box::new(|board: &Board, tick| board.staging.complete(tick));
        Self { config, ticks, now_ns: Arc::new(AtomicU64::new(START - T)), ready }
    }

    /// Runs with one thread a worker and the loop in this one.
    fn run<D: Decider>(self, make: impl Fn(Range<usize>) -> D + Send + Sync) -> (Seen, Arc<Board>) {
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

fn watch(
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

fn swap8() -> Scenario {
    Scenario::builtin("swap8").unwrap()
}

fn group(config: &Config) -> impl Fn(Range<usize>) -> RobotGroup + Send + Sync + use<> {
    let config = config.clone();
    move |owned| RobotGroup::new(&config, owned).unwrap()
}

/// Groups that share the controllers of the fleet and answer regions.
fn regional(config: &Config) -> impl Fn(Range<usize>) -> RobotGroup + Send + Sync + use<> {
    let robots = Arc::new(Robots::new(config));
    let config = config.clone();
    move |_| RobotGroup::among(&config, Arc::clone(&robots)).unwrap()
}

/// Asks for other regions in every `every`-th period, empty ones among them, before its deadline comes.
fn restless(workers: usize, every: u64, places: usize) -> Ready {
    Box::new(move |board, tick| {
        if tick.is_multiple_of(every) {
            let round = usize::try_from(tick / every).unwrap();
            let mut cuts: Vec<_> = (1..workers).map(|w| (5 * round + 3 * w * w) % (places + 1)).collect();
            cuts.extend([0, places]);
            cuts.sort_unstable();
            board.regions.want(&cuts);
        }
        board.staging.complete(tick)
    })
}

/// However many workers, and whoever answers a robot in which period: the bits of fixed shares.
#[test]
fn regions_and_their_changes_change_nothing() {
    const TICKS: u64 = 60;
    let world = World::new("regions");
    let field = Scenario::builtin("random-20-1").unwrap();
    let rig = Rig::new(&world, field.clone(), 2, TICKS);
    let make = group(&rig.config);
    let fixed = rig.run(make).0.states;
    assert_eq!(fixed.len() as u64, TICKS);
    for (workers, every) in [(1, 1), (2, 1), (3, 1), (2, 7), (3, 7), (8, 2)] {
        let mut rig = Rig::new(&world, field.clone(), workers, TICKS);
        rig.config.timing.publish = PublishAt::Deadline;
        rig.ready = restless(workers, every, field.robots.len());
        let make = regional(&rig.config);
        let (seen, board) = rig.run(make);
        assert!(seen.states == fixed, "{workers} workers, other regions every {every} periods");
        assert!(board.regions.adopted() >= TICKS / every - 1);
    }
}

/// A regional group that panics while it holds the controller of robot 3 in period 5.
struct Panicking {
    group: RobotGroup,
    panics: Arc<AtomicU64>,
}

impl Decider for Panicking {
    fn decide(&mut self, _: &[RobotState], _: &mut dyn FnMut(usize, &Decision)) {
        unreachable!("it is regional");
    }

    fn is_regional(&self) -> bool {
        true
    }

    fn decide_region(
        &mut self,
        region: (u64, Range<usize>),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, RobotCheckpoint),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        let tick = region.0;
        self.group.decide_region(region, fleet, remember, &mut |index, decision| {
            if (tick, index) == (5, 3) {
                self.panics.fetch_add(1, Ordering::Relaxed);
                std::panic::resume_unwind(Box::new("a fault, injected"));
            }
            each(index, decision);
        });
    }
}

#[test]
fn a_robot_whose_controller_was_lost_in_a_panic_drives_on_with_a_new_one_in_any_region() {
    let world = World::new("lost");
    let mut rig = Rig::new(&world, swap8(), 2, 20);
    rig.config.timing.publish = PublishAt::Deadline;
    let restless = restless(2, 1, 8);
    rig.ready = Box::new(move |board, tick| restless(board, tick) || tick == 5 && board.complete(tick));
    let make = regional(&rig.config);
    let panics = Arc::new(AtomicU64::new(0));
    let counted = Arc::clone(&panics);
    let (seen, board) = rig.run(move |owned| Panicking { group: make(owned), panics: Arc::clone(&counted) });
    assert_eq!((panics.load(Ordering::Relaxed), board.worker_panics.load(Ordering::Relaxed)), (1, 1));
    for robot in 0..8 {
        let stopped: Vec<_> = (1..21).filter(|k| seen.commands[*k].1[robot].stop_reason != 0).collect();
        // Period 5 is answered by the commands of period 6.
        assert!(
            if robot == 3 { stopped == [6] } else { stopped.is_empty() || stopped == [6] },
            "{stopped:?}"
        );
    }
}

/// The whole daemon across the places where numbers wrap, in virtual time.
#[test]
fn large_numbers_change_nothing() {
    use super::Accelerated;
    const TICKS: u64 = 400;
    let run = |first_tick: u64, start_ns: u64| {
        let world = World::new("large");
        let mut config = config(&world, Scenario::builtin("head-on").unwrap(), T);
        config.timing.first_tick = first_tick;
        let run = Accelerated::run(config, TICKS, start_ns, |_| {}).unwrap();
        assert_eq!(run.report.inconsistencies(), Vec::<String>::new());
        assert_eq!(
            (run.refused, run.report.fallback_commands, run.report.rejected_inputs.total()),
            (0, 0, 0)
        );
        assert!(run.laps > 2);
        (run.report.ticks, run.commands, run.observations, run.laps, run.report.control)
    };
    let reference = run(0, START);
    assert_eq!((reference.0, reference.1, reference.2), (TICKS, TICKS + 2, TICKS + 1));
    for edge in [1_u64 << 32, 1 << 48, 1 << 53, 1 << 63] {
        assert_eq!(run(edge - TICKS / 2, START), reference);
        // The clock, too, passes the edge in the middle of the run.
        assert_eq!(run(edge - TICKS / 2, edge.saturating_sub(TICKS / 2 * T).max(START)), reference);
    }
    // The last numbers there are: the run ends by itself before them.
    assert_eq!(run(TICK_MAX - TICKS, START), reference);
    assert_eq!(run(TICK_MAX - TICKS / 2, START).0, TICKS / 2);
}

/// The order of logical execution time, to the bit.
#[test]
fn what_is_published_is_what_happens() {
    // Work takes no time here.
    published_is_what_happens(PublishAt::Complete, 0);
    published_is_what_happens(PublishAt::Deadline, T - T / 10);
}

fn published_is_what_happens(publish: PublishAt, after_release_ns: u64) {
    let world = World::new("let");
    let mut rig = Rig::new(&world, swap8(), 2, 25);
    rig.config.timing.publish = publish;
    let make = group(&rig.config);
    let (seen, _) = rig.run(make);
    let ticks: Vec<u64> = seen.states.iter().map(|(header, _)| header.tick).collect();
    assert_eq!(ticks, (0..25).collect::<Vec<_>>());
    for (k, (header, robots)) in seen.states.iter().enumerate() {
        let (command_header, commands) = &seen.commands[k];
        assert_eq!((command_header.tick, command_header.epoch), (header.tick, header.epoch));
        assert_eq!(command_header.valid_from_ns, header.release_ns);
        assert_eq!(command_header.valid_until_ns, header.release_ns + T);
        for (robot, command) in robots.iter().zip(commands) {
            // The command that acts over the period is the one that its state carries.
            assert_eq!((robot.id, robot.command()), (command.id, command.command()));
        }
        if let Some((_, next)) = seen.states.get(k + 1) {
            // It leads from this state to the next, and answers the one before.
            for (robot, next) in robots.iter().zip(next) {
                assert_eq!(robot.arc().pose(T as f64 * 1e-9), next.pose());
            }
            assert_eq!(seen.commands[k + 1].0.state_stamp_ns, header.stamp_ns);
            assert_eq!(seen.commands[k + 1].0.stamp_ns, header.release_ns + after_release_ns);
        }
    }
    let reasons = |k: usize| seen.commands[k].1.iter().map(|c| c.stop_reason).collect::<Vec<_>>();
    assert_eq!(reasons(0), [StopReason::Start as u32; 8]);
    assert_eq!(reasons(12), [0; 8]);
    assert_eq!(reasons(26), [StopReason::Finished as u32; 8]);
    assert_eq!(seen.commands.len(), 27);
}

/// However the robots are shared out, and with no daemon at all: the same bits.
#[test]
fn workers_wake_ups_and_the_time_of_publishing_change_nothing() {
    let world = World::new("workers");
    let mut runs = Vec::new();
    for (workers, publish, wakeup) in [
        (1, PublishAt::Complete, Wakeup::Futex),
        (3, PublishAt::Complete, Wakeup::Futex),
        (8, PublishAt::Complete, Wakeup::Futex),
        (1, PublishAt::Complete, Wakeup::Spin),
        (3, PublishAt::Complete, Wakeup::Spin),
        (1, PublishAt::Complete, Wakeup::Channel),
        (3, PublishAt::Complete, Wakeup::Channel),
        (3, PublishAt::Deadline, Wakeup::Futex),
        (3, PublishAt::Deadline, Wakeup::Spin),
        (3, PublishAt::Deadline, Wakeup::Channel),
    ] {
        let mut rig = Rig::new(&world, swap8(), workers, 40);
        rig.config.timing.publish = publish;
        rig.config.realtime.wakeup = wakeup;
        let make = group(&rig.config);
        runs.push(rig.run(make).0.states);
    }
    assert_eq!(runs[0].len(), 40);
    assert!(runs.iter().all(|run| *run == runs[0]));

    let mut config = Config::new(swap8());
    config.timing.ticks = Some(40);
    let mut tick = 0;
    crate::evaluation::run(&config, Timing::LogicalExecutionTime, |_, fleet| {
        let Some((_, robots)) = runs[0].get(tick) else { return };
        for (robot, evaluated) in robots.iter().zip(fleet) {
            assert_eq!(
                (robot.pose(), robot.command()),
                (evaluated.pose(), evaluated.command()),
                "tick {tick}"
            );
        }
        tick += 1;
    })
    .unwrap();
    assert!(tick > 20);
}

/// The work of period 3 ends `tenths` tenths of a period after it: the ticks of the states, the ticks of
/// the commands, and whether anybody moved without a valid command.
fn overrun(tenths: u64, publish: PublishAt) -> (Vec<u64>, Vec<u64>) {
    let world = World::new("overrun");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 1, 3 + tenths / 10 + 5);
    rig.config.timing.publish = publish;
    let now_ns = Arc::clone(&rig.now_ns);
    let fault: Fault = Arc::new(move |period, _| {
        if period == 3 {
            now_ns.fetch_max(START + 4 * T + T / 10 * tenths, Ordering::AcqRel);
        }
    });
    let make = straight(T);
    let (seen, _) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    for pair in seen.states.windows(2) {
        let [(a, before), (b, after)] = pair else { unreachable!() };
        let driven_m = after[0].x_m - before[0].x_m;
        assert_eq!(driven_m, before[0].arc().position(T as f64 * 1e-9).x - before[0].x_m);
        // Whatever was ready too late is not used: the period after the overrun is a standstill.
        if a.tick == 3 {
            assert_eq!((before[0].v_mps > 0.0, after[0].v_mps), (true, 0.0));
        }
        assert!(b.stamp_ns >= b.release_ns && b.release_ns == START + b.tick * T);
    }
    let states = seen.states.iter().map(|(header, _)| header.tick);
    let commands = seen.commands.iter().map(|(header, _)| header.tick);
    (states.collect(), commands.collect())
}

#[test]
fn overruns_skip_whole_periods_and_discard_late_commands() {
    // The last command is the stop at the end; 4 is never published, because it was late.
    for publish in [PublishAt::Complete, PublishAt::Deadline] {
        let overrun = |tenths| overrun(tenths, publish);
        assert_eq!(overrun(5), (vec![0, 1, 2, 3, 4, 5, 6, 7], vec![0, 1, 2, 3, 5, 6, 7, 8, 9]));
        assert_eq!(overrun(15), (vec![0, 1, 2, 3, 5, 6, 7, 8], vec![0, 1, 2, 3, 6, 7, 8, 9, 10]));
        assert_eq!(overrun(32), (vec![0, 1, 2, 3, 7, 8, 9, 10], vec![0, 1, 2, 3, 8, 9, 10, 11, 12]));
        assert_eq!(overrun(200), (vec![0, 1, 2, 3, 24, 25, 26, 27], vec![0, 1, 2, 3, 25, 26, 27, 28, 29]));
    }
}

/// Does what [`support::Straight`] does, but for one period, in which it fails in its own way.
struct Faulty {
    inner: support::Straight,
    periods: u64,
    fault: Fault,
}

impl Decider for Faulty {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        (self.fault)(self.periods, &self.inner.owned);
        self.periods += 1;
        let intent = RobotIntent { speed_mps: 2.0, target_x_m: 9.0, valid: 1, ..RobotIntent::default() };
        self.inner.decide(fleet, &mut |index, decision| each(index, &Decision { intent, ..*decision }));
    }
}

fn reasons_of(seen: &Seen, robot: usize) -> Vec<u32> {
    seen.commands.iter().map(|(_, commands)| commands[robot].stop_reason).collect()
}

#[test]
fn a_worker_that_panics_stops_its_robots_for_one_period_and_is_built_anew() {
    panics_once(PublishAt::Complete);
    panics_once(PublishAt::Deadline);
}

fn panics_once(publish: PublishAt) {
    let world = World::new("panic");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 8);
    rig.config.timing.publish = publish;
    rig.ready = Box::new(|board, tick| {
        let other = board.staging.take(1, tick).is_some();
        let panicked = tick == 3 && board.worker_panics.load(Ordering::Relaxed) == 1;
        other && (panicked || board.staging.complete(tick))
    });
    let once = Arc::new(AtomicBool::new(true));
    let fault: Fault = Arc::new(move |period, owned| {
        if period == 3 && owned.start == 0 && once.swap(false, Ordering::Relaxed) {
            std::panic::resume_unwind(Box::new("a fault, injected"));
        }
    });
    let make = straight(T);
    let (seen, board) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    let (start, end, missed) =
        (StopReason::Start as u32, StopReason::Finished as u32, StopReason::Deadline as u32);
    assert_eq!(reasons_of(&seen, 0), [start, 0, 0, 0, missed, 0, 0, 0, 0, end]);
    assert_eq!(reasons_of(&seen, 1), [start, 0, 0, 0, 0, 0, 0, 0, 0, end]);
    // While it stands it keeps its plans, at speed 0, and nobody expects it to drive.
    let intents = |robot: usize| -> Vec<(u32, f64, f64)> {
        let of = |(_, robots): &(StateHeader, Vec<RobotState>)| {
            let intent = robots[robot].intent;
            (intent.valid, intent.speed_mps, intent.target_x_m)
        };
        seen.states.iter().map(of).collect()
    };
    let (none, drives, stands) = ((0, 0.0, 0.0), (1, 2.0, 9.0), (1, 0.0, 9.0));
    assert_eq!(intents(0), [none, drives, drives, drives, stands, drives, drives, drives]);
    assert_eq!(intents(1), [none, drives, drives, drives, drives, drives, drives, drives]);
    assert_eq!(board.worker_panics.load(Ordering::Relaxed), 1);
    assert_eq!(board.worker_rests.load(Ordering::Relaxed), 0);
}

#[test]
fn a_worker_that_panics_again_and_again_rests_before_it_tries_once_more() {
    let world = World::new("crashes");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 64);
    rig.ready = Box::new(Board::complete);
    // It fails in its first five periods, in each with another decider.
    let faults = AtomicU64::new(0);
    let fault: Fault = Arc::new(move |_, owned| {
        if owned.start == 0 && faults.fetch_add(1, Ordering::Relaxed) < 5 {
            std::panic::resume_unwind(Box::new("a fault, injected"));
        }
    });
    let make = straight(T);
    let (seen, board) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    // Four periods and a rest of 16, one more and a rest of 32; then it works.
    let reasons = reasons_of(&seen, 0);
    assert_eq!(reasons[1..54], [StopReason::Deadline as u32; 53]);
    assert_eq!(reasons[54..65], [0; 11]);
    assert_eq!(reasons_of(&seen, 1)[1..65], [0; 64]);
    assert_eq!(board.worker_panics.load(Ordering::Relaxed), 5);
    assert_eq!((board.worker_rests.load(Ordering::Relaxed), board.resting()), (2, 0));
}

#[test]
fn a_worker_that_hangs_stops_its_robots_and_its_late_answer_is_not_used() {
    hangs_for_a_while(PublishAt::Complete);
    hangs_for_a_while(PublishAt::Deadline);
}

fn hangs_for_a_while(publish: PublishAt) {
    let world = World::new("hangs");
    let mut rig = Rig::new(&world, lanes(2, 50.0), 2, 8);
    rig.config.timing.publish = publish;
    let release = Arc::new(Mutex::new(0_u64));
    let hold = Arc::clone(&release);
    // The hanging worker may go on once period 5 has been answered without it.
    rig.ready = Box::new(move |board, tick| {
        let other = board.staging.take(1, tick).is_some();
        if tick >= 6 {
            *release.lock().unwrap() = 6;
        }
        other && ((3..=5).contains(&tick) || board.staging.complete(tick))
    });
    let fault: Fault = Arc::new(move |period, owned| {
        while period == 3 && owned.start == 0 && *hold.lock().unwrap() < 6 {
            std::thread::sleep(std::time::Duration::from_micros(50));
        }
    });
    let make = straight(T);
    let (seen, _) =
        rig.run(move |owned| Faulty { inner: make(owned).unwrap(), periods: 0, fault: Arc::clone(&fault) });
    let (start, end, missed) =
        (StopReason::Start as u32, StopReason::Finished as u32, StopReason::Deadline as u32);
    assert_eq!(reasons_of(&seen, 0), [start, 0, 0, 0, missed, missed, missed, 0, 0, end]);
    // Nobody is waited for longer than to the deadline, and nobody who is done is waited for.
    let deadline_ns = |header: &CommandHeader| header.valid_from_ns - T / 10;
    let waited = seen.commands[1..9].iter().map(|(header, _)| header.stamp_ns == deadline_ns(header));
    let hangs = [false, false, false, true, true, true, false, false];
    assert_eq!(waited.collect::<Vec<_>>(), hangs.map(|hangs| hangs || publish == PublishAt::Deadline));
    assert_eq!(reasons_of(&seen, 1), [start, 0, 0, 0, 0, 0, 0, 0, 0, end]);
}

#[test]
fn a_command_beyond_the_limits_never_goes_out() {
    struct Reckless(Range<usize>);
    impl Decider for Reckless {
        fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
            for index in self.0.clone() {
                let v_mps = if index == 0 { 5.1 } else { f64::NAN };
                let command = RobotCommand { id: fleet[index].id, stop_reason: 0, v_mps, omega_radps: 0.0 };
                each(
                    index,
                    &Decision {
                        command,
                        intent: crate::wire::RobotIntent::default(),
                        telemetry: crate::wire::RobotTelemetry::default(),
                    },
                );
            }
        }
    }
    let world = World::new("reckless");
    let (seen, _) = Rig::new(&world, lanes(2, 50.0), 1, 4).run(Reckless);
    for (_, commands) in &seen.commands[1..5] {
        assert!(commands.iter().all(|c| c.stop_reason == StopReason::Unverified as u32));
        assert!(commands.iter().all(|c| (c.v_mps, c.omega_radps) == (0.0, 0.0)));
    }
}

/// A supervisor of the test's own, and what it has heard since it was asked last.
struct Listener {
    socket: std::os::unix::net::UnixDatagram,
    address: String,
}

impl Listener {
    fn new(name: &str) -> Self {
        use std::os::linux::net::SocketAddrExt;
        let name = format!("clearway_{name}_{}", std::process::id());
        let address = std::os::unix::net::SocketAddr::from_abstract_name(&name).unwrap();
        let socket = std::os::unix::net::UnixDatagram::bind_addr(&address).unwrap();
        socket.set_nonblocking(true).unwrap();
        Self { socket, address: format!("@{name}") }
    }

    fn heard(&self) -> Vec<String> {
        let mut bytes = [0; 512];
        std::iter::from_fn(|| {
            let length = self.socket.recv(&mut bytes).ok()?;
            Some(String::from_utf8_lossy(&bytes[..length]).trim_end().to_owned())
        })
        .collect()
    }

    /// Waits until it hears this.
    fn hear(&self, text: &str) {
        support::process::until(|| self.heard().iter().any(|heard| heard == text).then_some(()));
    }

    fn outside(&self) -> Outside {
        let watchdog = Some(std::time::Duration::from_millis(20));
        let supervisor = Supervisor::at(self.address.as_bytes(), watchdog).unwrap();
        Outside { supervisor: Some(Arc::new(supervisor)), ..Outside::default() }
    }
}

const BEAT: &str = "WATCHDOG=1";

#[test]
fn there_is_no_heartbeat_while_a_worker_hangs() {
    let (world, listener) = (World::new("beat"), Listener::new("beat"));
    let hangs = Arc::new(AtomicBool::new(false));
    let hung = Arc::clone(&hangs);
    let fault: Fault = Arc::new(move |_, owned| {
        while owned.start == 0 && hung.load(Ordering::Relaxed) {
            std::thread::sleep(std::time::Duration::from_millis(1));
        }
    });
    let period_ns = 10_000_000;
    let mut config = config(&world, lanes(2, 5000.0), period_ns);
    config.timing.workers = Some(2);
    let (make, shelf) = (straight(period_ns), Arc::new(RouteShelf::new(2)));
    let start = (config, None);
    let faulty =
        move |owned| Ok::<_, String>(Faulty { inner: make(owned)?, periods: 0, fault: Arc::clone(&fault) });
    let daemon =
        Daemon::start_audited(start, Until::Stopped, listener.outside(), None, shelf, faulty).unwrap();
    listener.hear("READY=1");
    listener.hear(BEAT);

    hangs.store(true, Ordering::Relaxed);
    support::process::until(|| (daemon.progress().workers_silent == 1).then_some(()));
    listener.heard();
    // The loop goes on, and what is due in the meantime is not said.
    let tick = daemon.progress().tick;
    support::process::until(|| (daemon.progress().tick > tick + 30).then_some(()));
    assert!(!listener.heard().iter().any(|heard| heard == BEAT));

    hangs.store(false, Ordering::Relaxed);
    listener.hear(BEAT);
    daemon.stop();
    daemon.join().unwrap();
    assert!(listener.heard().iter().any(|heard| heard == "STOPPING=1"));
}

#[test]
fn there_is_no_heartbeat_while_the_loop_hangs() {
    struct Hanging(Plant, Arc<AtomicBool>);
    impl StateSource for Hanging {
        fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]) {
            while self.1.load(Ordering::Relaxed) {
                std::thread::sleep(std::time::Duration::from_millis(1));
            }
            self.0.observe(instant, clock, states);
        }
        fn knows_all(&self) -> bool {
            true
        }
        fn admit(&mut self, _: usize, _: &RobotSpec) {}
        fn dismiss(&mut self, _: usize) {}
        fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
            self.0.commit(header, commands, now_ns);
        }
        fn rejections(&self) -> Rejections {
            Rejections::default()
        }
    }
    let (world, listener) = (World::new("loop_beat"), Listener::new("loop_beat"));
    let period_ns = 10_000_000;
    let config = config(&world, lanes(2, 5000.0), period_ns);
    let hangs = Arc::new(AtomicBool::new(false));
    let hung = Arc::clone(&hangs);
    let source: MakeSource = Arc::new(move |config: &Config, start_ns| {
        Box::new(Hanging(Plant::new(&config.scenario, period_ns, start_ns), Arc::clone(&hung)))
    });
    let outside = Outside { source: Some(source), ..listener.outside() };
    let daemon = Daemon::start_controlled(config, Until::Stopped, outside).unwrap();
    listener.hear("READY=1");
    listener.hear(BEAT);
    hangs.store(true, Ordering::Relaxed);
    // Long enough for what was under way, and then for many beats.
    std::thread::sleep(std::time::Duration::from_millis(300));
    listener.heard();
    std::thread::sleep(std::time::Duration::from_millis(300));
    assert_eq!(listener.heard().iter().filter(|heard| *heard == BEAT).count(), 0);
    hangs.store(false, Ordering::Relaxed);
    listener.hear(BEAT);
    drop(daemon);
}
