//! How often the real-time threads allocate in the steady state, counted by thread.

mod support;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::collections::BTreeMap;
use std::sync::Mutex;

use clearway::channel::{StateReader, Transport};
use clearway::controller::{Decision, RobotGroup};
use clearway::runtime::{Daemon, Decider, Until};
use clearway::scenario::Scenario;
use clearway::wire::RobotState;
use support::{World, config};

/// Counts every allocation of every thread.
struct Counting;

thread_local! {
    // Constant and without a destructor: reading it never allocates.
    static ALLOCATIONS: Cell<u64> = const { Cell::new(0) };
}

// SAFETY: hands every call to the system's allocator unchanged; the counter is a plain thread-local
// that neither allocates nor unwinds.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
        // SAFETY: the caller's promises are the system allocator's.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        let _ = ALLOCATIONS.try_with(|n| n.set(n.get() + 1));
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
            self.counts.push(ALLOCATIONS.get());
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
    let transport = Transport::new(&config.fleet, &config.channel).unwrap();
    let daemon = Daemon::start_with(config, Until::Stopped, move |owned| {
        let first = owned.start;
        let group = RobotGroup::new(&for_workers, owned).map_err(|e| e.to_string())?;
        let capacity = usize::try_from(TICKS).unwrap_or(0);
        Ok::<_, String>(Counted { group, first, counts: Vec::with_capacity(capacity) })
    })
    .unwrap();
    let mut reader: StateReader = transport.attach("watcher").unwrap().reader().unwrap();
    let mut seen = 0;
    while !daemon.is_finished() {
        while reader.next().unwrap().is_some() {
            seen += 1;
        }
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let report = daemon.join().unwrap();
    assert!(report.ticks > 100 && seen > 0, "{} periods, {seen} seen", report.ticks);

    let workers = WORKERS.lock().unwrap();
    assert_eq!(workers.keys().copied().collect::<Vec<_>>(), [0, 4]);
    for (first, counts) in workers.iter() {
        let steady = &counts[WARM_UP.min(counts.len())..];
        assert!(steady.len() > 50, "worker of robot {first}: {} periods", counts.len());
        let allocated = steady.last().unwrap() - steady[0];
        println!("worker of robot {first}: {allocated} allocations in {} periods", steady.len() - 1);
        assert_eq!(allocated, 0, "worker of robot {first}: {steady:?}");
    }
}
