//! How often the real-time threads allocate in the steady state, counted by thread.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Mutex;
use std::sync::atomic::{AtomicI32, AtomicU64, AtomicUsize, Ordering};

use clearway::audit;
use clearway::channel::{StateReader, Transport};
use clearway::controller::{Decision, RobotGroup, rows_max};
use clearway::runtime::{Daemon, Decider, Until};
use clearway::scenario::Scenario;
use clearway::solver::ClarabelSolver;
use clearway::wire::RobotState;
use support::{World, config};

/// Counts every allocation of every thread.
struct Counting;

/// Threads that can be told apart; the test starts about a dozen.
const THREADS: usize = 128;

/// A thread's kernel id and how often it has allocated.
static COUNTS: [(AtomicI32, AtomicU64); THREADS] =
    [const { (AtomicI32::new(0), AtomicU64::new(0)) }; THREADS];
static NEXT: AtomicUsize = AtomicUsize::new(0);

thread_local! {
    // Constant and without a destructor: using it never allocates.
    static SLOT: Cell<usize> = const { Cell::new(usize::MAX) };
}

/// The calling thread's counter.
fn mine() -> Option<&'static AtomicU64> {
    let slot = SLOT
        .try_with(|slot| {
            if slot.get() == usize::MAX {
                slot.set(NEXT.fetch_add(1, Ordering::Relaxed));
                if let Some((thread, _)) = COUNTS.get(slot.get()) {
                    thread.store(rustix::thread::gettid().as_raw_nonzero().get(), Ordering::Relaxed);
                }
            }
            slot.get()
        })
        .ok()?;
    COUNTS.get(slot).map(|(_, count)| count)
}

/// The counter of the thread that the kernel knows by `name`.
fn named(name: &str) -> &'static AtomicU64 {
    let is_named = |thread: i32| {
        std::fs::read_to_string(format!("/proc/self/task/{thread}/comm"))
            .is_ok_and(|comm| comm.trim() == name)
    };
    let found = COUNTS.iter().find(|(thread, _)| is_named(thread.load(Ordering::Relaxed)));
    &found.expect("a thread that allocated").1
}

fn count() {
    if let Some(count) = mine() {
        count.fetch_add(1, Ordering::Relaxed);
    }
}

// SAFETY: hands every call to the system's allocator unchanged; counting uses statics and a plain
// thread-local, and neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        count();
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[global_allocator]
static COUNTING: Counting = Counting;

const T: u64 = 2_000_000;
const TICKS: u64 = 400;
/// Periods before the steady state: connections are made and lazily built parts of the system woken.
const WARM_UP: usize = 50;
/// The steady state of the loop; at the end it takes its ports apart.
const STEADY: Range<u64> = WARM_UP as u64..TICKS - 10;

/// Allocations of each worker at the start of each of its periods.
static WORKERS: Mutex<BTreeMap<usize, Vec<u64>>> = Mutex::new(BTreeMap::new());

/// The real controller, which notes what its thread has allocated so far.
struct Counted {
    group: RobotGroup,
    first: usize,
    counts: Vec<u64>,
}

impl Decider for Counted {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        if self.counts.len() < self.counts.capacity() {
            self.counts.push(mine().map_or(0, |count| count.load(Ordering::Relaxed)));
        }
        self.group.decide(fleet, each);
    }
}

impl Drop for Counted {
    fn drop(&mut self) {
        WORKERS.lock().unwrap().insert(self.first, std::mem::take(&mut self.counts));
    }
}

#[test]
fn workers_allocate_nothing_and_the_loop_only_its_loans() {
    let world = World::new("allocation");
    let mut config = config(&world, Scenario::builtin("swap8").unwrap(), T);
    config.timing.workers = Some(2);
    config.timing.ticks = Some(TICKS);
    let for_workers = config.clone();
    // The audit's recording side belongs to the workers' period as well.
    let rows = rows_max(&config.controller);
    let (recorder, mut auditor) = audit::start(ClarabelSolver::new(rows).unwrap(), rows, 16, 1);
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let daemon = Daemon::start_with(config, Until::Stopped, move |owned| {
        let first = owned.start;
        let group =
            RobotGroup::new(&for_workers, owned).map_err(|e| e.to_string())?.audited_by(recorder.clone());
        let capacity = usize::try_from(TICKS).unwrap_or(0);
        Ok::<_, String>(Counted { group, first, counts: Vec::with_capacity(capacity) })
    })
    .unwrap();
    let loop_count = named("clearway-loop");
    let mut reader: StateReader = transport.attach("watcher").unwrap().reader().unwrap();
    let (mut first, mut last, mut tick) = (None, None, 0);
    while !daemon.is_finished() {
        let before = loop_count.load(Ordering::Relaxed);
        tick = reader.newest().unwrap().map_or(tick, |sample| sample.header().tick);
        // A tick and a count that belong together: the loop allocated nothing while they were read.
        if STEADY.contains(&tick) && loop_count.load(Ordering::Relaxed) == before {
            first = first.or(Some((tick, before)));
            last = Some((tick, before));
        }
        auditor.audit(4);
        std::thread::sleep(std::time::Duration::from_micros(300));
    }
    let report = daemon.join().unwrap();
    let ((first_tick, first_count), (last_tick, last_count)) = (first.unwrap(), last.unwrap());
    let (periods, allocated) = (last_tick - first_tick, last_count - first_count);
    println!("loop: {allocated} allocations in {periods} periods, {} missed", report.deadline_misses);
    assert!(periods > 100);
    // One loan of a state and one of a command; each end is up to a period's loans uncertain. A missed
    // period needs fewer.
    assert!(allocated <= 2 * periods + 4, "{allocated} in {periods} periods");
    assert!(report.deadline_misses > 0 || allocated + 4 >= 2 * periods, "{allocated} in {periods} periods");

    let workers = WORKERS.lock().unwrap();
    assert_eq!(workers.keys().copied().collect::<Vec<_>>(), [0, 4]);
    for (first, counts) in workers.iter() {
        let steady = &counts[WARM_UP.min(counts.len())..];
        assert!(steady.len() > 10, "worker of robot {first}: {} periods", counts.len());
        let allocated = steady.last().unwrap() - steady[0];
        println!("worker of robot {first}: {allocated} allocations in {} periods", steady.len() - 1);
        assert_eq!(allocated, 0, "worker of robot {first}: {steady:?}");
    }
}
