//! Time: one monotonic clock for stamps, schedules and expiry, and one that tests turn by hand.
//!
//! All times are `CLOCK_MONOTONIC` nanoseconds in a `u64`, which lasts 584 years from boot; steps
//! of the wall clock have no effect. Neither clock allocates. Reading the real one costs about
//! 25 ns.

use std::sync::atomic::{AtomicU64, Ordering};

use rustix::thread::clock_nanosleep_absolute;
use rustix::time::{ClockId, Timespec, clock_gettime};

/// A source of time and of absolute sleeps.
pub trait Clock {
    /// Now, ns.
    fn now_ns(&self) -> u64;

    /// Returns at `wake_ns` or as soon after it as the machine allows; at once if it has passed.
    fn sleep_until(&self, wake_ns: u64);
}

/// `CLOCK_MONOTONIC`, with `clock_nanosleep(TIMER_ABSTIME)`: relative sleeps would drift by the
/// time that passes between reading the clock and falling asleep.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

const NS_PER_S: u64 = 1_000_000_000;

impl Clock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        let now = clock_gettime(ClockId::Monotonic);
        now.tv_sec.unsigned_abs() * NS_PER_S + now.tv_nsec.unsigned_abs()
    }

    fn sleep_until(&self, wake_ns: u64) {
        let wake = Timespec {
            tv_sec: (wake_ns / NS_PER_S).cast_signed(),
            tv_nsec: (wake_ns % NS_PER_S).cast_signed(),
        };
        // A signal handler ends the sleep early; the absolute time makes going on exact. Any other
        // error cannot happen for this clock and a normalised time, and must not become a spin.
        while clock_nanosleep_absolute(ClockId::Monotonic, &wake) == Err(rustix::io::Errno::INTR) {}
    }
}

/// A clock that moves only when told to: a sleep jumps to its end.
#[derive(Debug, Default)]
pub struct VirtualClock {
    now_ns: AtomicU64,
}

impl VirtualClock {
    /// A clock that stands at `now_ns`.
    pub fn new(now_ns: u64) -> Self {
        Self { now_ns: AtomicU64::new(now_ns) }
    }

    /// Lets `ns` pass: work, or a machine that was busy with something else.
    pub fn advance(&self, ns: u64) {
        self.now_ns.fetch_add(ns, Ordering::AcqRel);
    }
}

impl Clock for VirtualClock {
    fn now_ns(&self) -> u64 {
        self.now_ns.load(Ordering::Acquire)
    }

    fn sleep_until(&self, wake_ns: u64) {
        self.now_ns.fetch_max(wake_ns, Ordering::AcqRel);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn never_wakes_early() {
        let clock = MonotonicClock;
        for ahead_ns in [0, 1, 1_000, 500_000] {
            let wake = clock.now_ns() + ahead_ns;
            clock.sleep_until(wake);
            assert!(clock.now_ns() >= wake);
        }
        // A time that has passed.
        clock.sleep_until(1);
    }

    #[test]
    fn virtual_time_never_runs_backwards() {
        let clock = VirtualClock::new(100);
        clock.sleep_until(50);
        assert_eq!(clock.now_ns(), 100);
        clock.sleep_until(150);
        clock.advance(7);
        assert_eq!(clock.now_ns(), 157);
    }
}
