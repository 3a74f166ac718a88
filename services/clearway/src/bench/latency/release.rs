//! Release lateness: how long after the scheduled start of a period a thread is awake.

use clearway::clock::{Clock, MonotonicClock};
use clearway::figures::LatencyHistogram;
use clearway::realtime::ThreadGrant;
use clearway::schedule::Schedule;
use miette::{IntoDiagnostic, Result, miette};

use super::plan::enter_real_time;
use super::world::Interrupt;

/// Between the set-up and the first release, ns.
const LEAD_NS: u64 = 20_000_000;

/// What a run of releases came to.
#[derive(Debug)]
pub(super) struct Releases {
    pub(super) lateness: LatencyHistogram,
    /// Periods that passed as a whole.
    pub(super) skipped: u64,
    pub(super) grant: ThreadGrant,
}

/// Releases `samples` periods in a thread of its own, set up as the daemon's loop.
///
/// The sleep is absolute, on `CLOCK_MONOTONIC`. A release is late by the time between its schedule and
/// the first reading of the clock after the sleep; one that comes after whole periods counts with all
/// of them. The loop reads the clock, records and sleeps, and nothing else.
pub(super) fn measure(
    period_ns: u64,
    samples: u64,
    priority: u8,
    cpu: usize,
    interrupt: &Interrupt,
) -> Result<Releases> {
    let interrupt = interrupt.clone();
    let mut lateness = LatencyHistogram::new().into_diagnostic()?;
    let thread = std::thread::Builder::new().name("clearway-loop".to_owned());
    let thread = thread.spawn(move || {
        let grant = enter_real_time(priority, Some(cpu));
        let clock = MonotonicClock;
        let schedule = Schedule::new(clock.now_ns() + LEAD_NS.max(period_ns), period_ns, 0);
        let (mut planned, mut skipped) = (0, 0);
        for _ in 0..samples {
            let release_ns = schedule.release_ns(planned);
            clock.sleep_until(release_ns);
            let now_ns = clock.now_ns();
            lateness.record(now_ns - release_ns);
            let tick = schedule.resume(planned, now_ns);
            skipped += tick - planned;
            planned = tick + 1;
            if interrupt.is_set() {
                break;
            }
        }
        Releases { lateness, skipped, grant }
    });
    thread.into_diagnostic()?.join().map_err(|_| miette!("the releasing thread panicked"))
}
