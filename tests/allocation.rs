//! How often the real-time threads allocate in the steady state, counted by thread.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, OnceLock};

use clearway::audit;
use clearway::channel::{StateReader, Transport};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::Config;
use clearway::controller::{Decision, RobotGroup, Robots, Timing, rows_max};
use clearway::evaluation;
use clearway::geometry::{Pose, Vec2};
use clearway::model::Command;
use clearway::runtime::{Daemon, Decider, Until};
use clearway::scenario::Scenario;
use clearway::solver::ClarabelSolver;
use clearway::wire::{AdminCode, AdminKind, AdminRequest, AdminRobot, RobotState, StopReason};
use support::{World, config};

/// Counts every allocation of every thread.
struct Counting;

/// Threads that can be told apart; the test starts about a dozen.
const THREADS: usize = 128;

/// What one thread has asked of the allocator.
struct Count {
    /// The kernel's id of the thread.
    thread: AtomicI32,
    /// Allocations of the size of a loan.
    loans: AtomicU64,
    /// Allocations of any other size.
    others: AtomicU64,
}

impl Count {
    fn so_far(&self) -> Allocated {
        Allocated { loans: self.loans.load(Ordering::Relaxed), others: self.others.load(Ordering::Relaxed) }
    }
}

/// Allocations up to a moment, or between two.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Allocated {
    loans: u64,
    others: u64,
}

impl Allocated {
    fn since(self, earlier: Self) -> Self {
        Self { loans: self.loans - earlier.loans, others: self.others - earlier.others }
    }
}

/// What iceoryx2 allocates for each sample that it lends, bytes.
const LOAN_BYTES: usize = 48;

static COUNTS: [Count; THREADS] =
    [const { Count { thread: AtomicI32::new(0), loans: AtomicU64::new(0), others: AtomicU64::new(0) } };
        THREADS];
static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // Constant and without a destructor: using it never allocates.
    static SLOT: Cell<usize> = const { Cell::new(usize::MAX) };
}

/// The calling thread's counter.
fn mine() -> Option<&'static Count> {
    let slot = SLOT
        .try_with(|slot| {
            if slot.get() == usize::MAX {
                slot.set(NEXT.fetch_add(1, Ordering::Relaxed));
                if let Some(count) = COUNTS.get(slot.get()) {
                    count.thread.store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::Relaxed);
                }
            }
            slot.get()
        })
        .ok()?;
    COUNTS.get(slot)
}

/// The counter of the thread that the kernel knows by `name`.
fn named(name: &str) -> &'static Count {
    let is_named = |thread: i32| {
        std::fs::read_to_string(format!("/proc/self/task/{thread}/comm"))
            .is_ok_and(|comm| comm.trim() == name)
    };
    let found = COUNTS.iter().find(|count| is_named(count.thread.load(Ordering::Relaxed)));
    found.expect("a thread that allocated")
}

fn count(size: usize) {
    if let Some(count) = mine() {
        let counter = if size == LOAN_BYTES { &count.loans } else { &count.others };
        counter.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: hands every call to the system's allocator unchanged; counting uses statics and a plain
// thread-local, and neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count(layout.size());
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count(size);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const T: u64 = 1_000_000;
/// Periods that are counted, after those in which connections are made and lazily built parts of the
/// system woken.
const STEADY: usize = 10_000;
const WARM_UP: usize = 100;
/// Where the run ends in any case: a busy machine makes the loop skip periods.
const TICKS_MAX: u64 = 60_000;

/// Workers that have worked for all of the periods.
static SATISFIED: AtomicUsize = AtomicUsize::new(0);

/// The loop's counter, once it runs.
static LOOP: OnceLock<&Count> = OnceLock::new();
/// What each worker saw, by its first robot.
static WORKERS: Mutex<BTreeMap<usize, Vec<Seen>>> = Mutex::new(BTreeMap::new());

/// Allocations up to the start of a worker's period. The loop, which waits for the worker, is in the
/// middle of the same period, or further when the worker is late.
#[derive(Debug, Clone, Copy)]
struct Seen {
    worker: Allocated,
    control_loop: Allocated,
}

/// The real controller, which notes what was allocated so far.
///
/// The notes are taken here and not in the test's own thread: that one can be kept waiting until the
/// loop takes its ports apart, which allocates thousands of times.
struct Counted {
    group: RobotGroup,
    first: usize,
    seen: Vec<Seen>,
}

impl Decider for Counted {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        if let (Some(worker), Some(control_loop)) = (mine(), LOOP.get())
            && self.seen.len() < self.seen.capacity()
        {
            let seen = Seen { worker: worker.so_far(), control_loop: control_loop.so_far() };
            self.seen.push(seen);
            SATISFIED.fetch_add(usize::from(self.seen.len() == self.seen.capacity()), Ordering::Relaxed);
        }
        self.group.decide(fleet, each);
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        WORKERS.lock().unwrap().insert(self.first, std::mem::take(&mut self.seen));
    }
}

#[test]
fn workers_allocate_nothing_and_the_loop_only_its_loans() {
    let world = World::new("allocation");
    let mut config = config(&world, Scenario::builtin("swap8").unwrap(), T);
    config.timing.workers = Some(2);
    config.timing.ticks = Some(TICKS_MAX);
    let for_workers = config.clone();
    // The audit's recording side belongs to the workers' period as well.
    let rows = rows_max(&config.controller);
    let (recorder, mut auditor) = audit::start(ClarabelSolver::new(rows).unwrap(), rows, 16, 1);
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let daemon = Daemon::start_with(config, Until::Stopped, move |owned| {
        let first = owned.start;
        let group =
            RobotGroup::new(&for_workers, owned).map_err(|e| e.to_string())?.audited_by(recorder.clone());
        Ok::<_, String>(Counted { group, first, seen: Vec::with_capacity(WARM_UP + STEADY + 1) })
    })
    .unwrap();
    assert!(LOOP.set(named("clearway-loop")).is_ok());
    let mut reader: StateReader = transport.attach("watcher").unwrap().reader().unwrap();
    while !daemon.is_finished() {
        if SATISFIED.load(Ordering::Relaxed) == 2 {
            daemon.stop();
        }
        let _ = reader.newest().unwrap();
        auditor.audit(4);
        std::thread::sleep(std::time::Duration::from_micros(300));
    }
    let report = daemon.join().unwrap();

    let workers = WORKERS.lock().unwrap();
    assert_eq!(workers.keys().copied().collect::<Vec<_>>(), [0, 4]);
    for (robot, seen) in workers.iter() {
        let seen = &seen[WARM_UP..];
        let periods = u64::try_from(seen.len()).unwrap() - 1;
        let (first, last) = (seen[0], *seen.last().unwrap());
        let worker = last.worker.since(first.worker);
        let control_loop = last.control_loop.since(first.control_loop);
        println!(
            "worker of robot {robot}: {worker:?} in {periods} periods, {} missed; loop: {control_loop:?}",
            report.deadline_misses
        );
        assert_eq!(periods, STEADY as u64);
        assert_eq!(worker, Allocated::default());
        assert_eq!(control_loop.others, 0);
        // One loan of a state, and one of a command unless they came too late. A note taken late is off by
        // a period.
        assert!(control_loop.loans <= 2 * (report.ticks + report.lost_records - WARM_UP as u64) + 2);
        assert!(control_loop.loans + 2 + report.deadline_misses >= 2 * periods);
    }
}

/// Robots around robot 0, more than it has rows for.
const CROWD: usize = 400;

/// Two groups answer a fleet in turns, in regions that change in every period.
#[test]
fn regions_of_a_large_fleet_are_answered_without_allocating_and_a_crowd_is_stopped_whole() {
    let config = Config::new(Scenario::builtin("field-600-1").unwrap());
    assert!(CROWD > rows_max(&config.controller));
    let robots = Arc::new(Robots::new(&config));
    let mut groups = [(); 2].map(|()| RobotGroup::among(&config, Arc::clone(&robots)).unwrap());
    let mut fleet = evaluation::initial_fleet(&config);
    let (period_s, places, centre) = (config.timing.period_s(), fleet.len(), fleet[0].pose());
    for (k, robot) in fleet.iter_mut().enumerate().take(CROWD + 1).skip(1) {
        let (sin, cos) = (k as f64).sin_cos();
        let offset_m = Vec2::new(cos, sin) * (0.35 + 0.0002 * k as f64);
        robot.set_pose(Pose { position_m: centre.position_m + offset_m, ..centre });
    }
    let mut next = fleet.clone();
    let (mut before, mut crowded) = (Allocated::default(), 0);
    for tick in 0..60_u64 {
        if tick == 10 {
            before = mine().unwrap().so_far();
        }
        let cut = (137 * usize::try_from(tick).unwrap()) % (places + 1);
        let (mut answered, mut remembered) = (0, 0);
        for (group, region) in groups.iter_mut().zip([0..cut, cut..places]) {
            let mut parts = std::iter::once(region);
            group.solve_parts(
                (tick, || parts.next()),
                &fleet,
                Timing::LogicalExecutionTime,
                |_, _| remembered += 1,
                |k, decision| {
                    answered += 1;
                    next[k].set_pose(fleet[k].arc().pose(period_s));
                    next[k].set_command(decision.command.command());
                    next[k].intent = decision.intent;
                    if decision.command.stop_reason == StopReason::Crowded as u32 {
                        assert_eq!(decision.command.command(), Command::STOP);
                        crowded += 1;
                    }
                    if (tick, k) == (0, 0) {
                        let rows = decision.telemetry.safety_rows;
                        assert_eq!(decision.command.stop_reason, StopReason::Crowded as u32, "{rows} rows");
                    }
                },
            );
        }
        assert_eq!((answered, remembered), (places, places));
        std::mem::swap(&mut fleet, &mut next);
    }
    assert_eq!(mine().unwrap().so_far().since(before), Allocated::default());
    assert!(crowded > 0);
}

/// Goals for one robot among pillars, as many as a period takes and more: its routes come ready-made.
#[test]
fn workers_build_no_route_however_many_goals_come_at_once() {
    let world = World::new("allocation_goals");
    let mut config = config(&world, Scenario::builtin("pillars-8").unwrap(), 5 * T);
    config.timing.workers = Some(1);
    let robot = config.scenario.robots[0];
    let channel = config.channel.clone();
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let worker = named("clearway-w0");
    let node = Transport::new("default", &channel).unwrap().attach("test").unwrap();
    let ports = [(); 2].map(|()| node.admin().unwrap());
    let (mut before, mut done) = (Allocated::default(), 0);
    for round in 0..60_u32 {
        if round == 10 {
            before = worker.so_far();
        }
        let ask = |n: u32| {
            let request = AdminRequest {
                expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
                kind: AdminKind::SetGoals as u32,
                ..AdminRequest::default()
            };
            // Away from everybody's goals.
            let goal_x_m = 20.0 + f64::from(round) + f64::from(n) * 0.1;
            let goal = AdminRobot { id: robot.id.0, goal_x_m, ..AdminRobot::default() };
            ports[n as usize % 2].ask(&request, &[goal]).unwrap()
        };
        let waiting: Vec<_> = (0..8).map(ask).collect();
        for one in waiting {
            let answer = loop {
                if let Some((answer, _)) = one.answer().unwrap() {
                    break answer;
                }
                assert!(!daemon.is_finished());
                std::thread::sleep(std::time::Duration::from_micros(100));
            };
            done += u32::from(answer.code == AdminCode::Done as u32);
        }
    }
    assert_eq!(worker.so_far().since(before), Allocated::default());
    assert!(done >= 60, "{done} goals");
    daemon.stop();
    assert_eq!(daemon.join().unwrap().control.violations, 0);
}
