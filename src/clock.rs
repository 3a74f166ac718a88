//! Time: one monotonic clock for stamps, schedules and expiry, and one that tests turn by hand.
//!
//! All times are `CLOCK_MONOTONIC` nanoseconds in a `u64`, which lasts 584 years from boot; steps
//! of the wall clock have no effect. Neither clock allocates. Reading the real one costs about
//! 25 ns.

use std::num::{NonZeroU32, NonZeroU64};
use std::rc::Rc;
use std::sync::atomic::{AtomicU32, AtomicU64, Ordering};

use rustix::thread::{clock_nanosleep_absolute, futex};
use rustix::time::{ClockId, Timespec, clock_gettime};

/// A source of time and of absolute sleeps.
pub trait Clock {
    /// Now, ns.
    fn now_ns(&self) -> u64;

    /// Returns at `wake_ns` or as soon after it as the machine allows; at once if it has passed.
    fn sleep_until(&self, wake_ns: u64);

    /// Returns at `wake_ns` without sleeping. For short times, on a CPU that nobody else needs.
    fn spin_until(&self, wake_ns: u64) {
        while self.now_ns() < wake_ns {
            std::hint::spin_loop();
        }
    }

    /// Returns when `word` is not `value` (any more) and [`wake`] was called after it had changed, or at
    /// `wake_ns`; sometimes for no reason, so that a caller has to look again.
    fn wait(&self, word: &AtomicU32, value: u32, wake_ns: u64);
}

/// Wakes every thread that [waits](Clock::wait) for `word` to change. One system call.
pub fn wake(word: &AtomicU32) {
    // Fails only for a word that is not aligned or not mapped, and a reference is both.
    let _ = futex::wake(word, futex::Flags::PRIVATE, i32::MAX.unsigned_abs());
}

/// `CLOCK_MONOTONIC`, with `clock_nanosleep(TIMER_ABSTIME)`: relative sleeps would drift by the
/// time that passes between reading the clock and falling asleep.
#[derive(Debug, Clone, Copy, Default)]
pub struct MonotonicClock;

const NS_PER_S: u64 = 1_000_000_000;

fn timespec(ns: u64) -> Timespec {
    Timespec { tv_sec: (ns / NS_PER_S).cast_signed(), tv_nsec: (ns % NS_PER_S).cast_signed() }
}

impl Clock for MonotonicClock {
    fn now_ns(&self) -> u64 {
        let now = clock_gettime(ClockId::Monotonic);
        now.tv_sec.unsigned_abs() * NS_PER_S + now.tv_nsec.unsigned_abs()
    }

    fn sleep_until(&self, wake_ns: u64) {
        let wake = timespec(wake_ns);
        // A signal handler ends the sleep early; the absolute time makes going on exact. Any other
        // error cannot happen for this clock and a normalised time, and must not become a spin.
        while clock_nanosleep_absolute(ClockId::Monotonic, &wake) == Err(rustix::io::Errno::INTR) {}
    }

    fn wait(&self, word: &AtomicU32, value: u32, wake_ns: u64) {
        // This operation's time is absolute, on the monotonic clock. A change, a signal and the time
        // are different answers that mean the same: look again.
        let _ =
            futex::wait_bitset(word, futex::Flags::PRIVATE, value, Some(&timespec(wake_ns)), NonZeroU32::MAX);
    }
}

/// [`MonotonicClock`] with longer seconds: time passes `slowdown` times slower.
///
/// For measuring work that does not fit into its period, with the period's length as it is in everything
/// that is computed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SlowedClock {
    slowdown: NonZeroU64,
}

impl SlowedClock {
    /// A clock on which `slowdown` seconds are one.
    pub fn new(slowdown: NonZeroU64) -> Self {
        Self { slowdown }
    }

    /// The time of the machine's clock, ns; the end of time when it is beyond.
    fn real_ns(self, ns: u64) -> u64 {
        ns.saturating_mul(self.slowdown.get())
    }
}

impl Default for SlowedClock {
    /// Not slowed at all.
    fn default() -> Self {
        Self::new(NonZeroU64::MIN)
    }
}

impl Clock for SlowedClock {
    fn now_ns(&self) -> u64 {
        MonotonicClock.now_ns() / self.slowdown
    }

    fn sleep_until(&self, wake_ns: u64) {
        MonotonicClock.sleep_until(self.real_ns(wake_ns));
    }

    fn wait(&self, word: &AtomicU32, value: u32, wake_ns: u64) {
        MonotonicClock.wait(word, value, self.real_ns(wake_ns));
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

    fn spin_until(&self, wake_ns: u64) {
        self.sleep_until(wake_ns);
    }

    /// Nobody else has a part in virtual time: what has not happened before a wait does not happen in it.
    fn wait(&self, word: &AtomicU32, value: u32, wake_ns: u64) {
        if word.load(Ordering::Acquire) == value {
            self.sleep_until(wake_ns);
        }
    }
}

/// A [`VirtualClock`] that several parts of one thread look at.
#[derive(Debug, Clone, Default)]
pub struct VirtualTime(Rc<VirtualClock>);

impl VirtualTime {
    /// A clock that stands at `now_ns`.
    pub fn new(now_ns: u64) -> Self {
        Self(Rc::new(VirtualClock::new(now_ns)))
    }
}

impl Clock for VirtualTime {
    fn now_ns(&self) -> u64 {
        self.0.now_ns()
    }

    fn sleep_until(&self, wake_ns: u64) {
        self.0.sleep_until(wake_ns);
    }

    fn spin_until(&self, wake_ns: u64) {
        self.0.spin_until(wake_ns);
    }

    fn wait(&self, word: &AtomicU32, value: u32, wake_ns: u64) {
        self.0.wait(word, value, wake_ns);
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
    fn a_slowed_clock_sleeps_longer_and_never_wakes_early() {
        let slow = SlowedClock::new(NonZeroU64::new(4).unwrap());
        let (begun_ns, wake_ns) = (MonotonicClock.now_ns(), slow.now_ns() + 500_000);
        slow.sleep_until(wake_ns);
        assert!(slow.now_ns() >= wake_ns);
        // Four times as much has passed, less what was rounded off before.
        assert!(MonotonicClock.now_ns() >= begun_ns + 4 * 499_999);
        slow.wait(&AtomicU32::new(0), 0, wake_ns);
        assert_eq!(slow.real_ns(u64::MAX), u64::MAX);
    }

    #[test]
    fn a_wait_ends_with_the_change_of_its_word_or_with_its_time() {
        let (clock, word) = (MonotonicClock, AtomicU32::new(0));
        clock.wait(&word, 1, u64::MAX);
        let end_ns = clock.now_ns() + 200_000;
        while clock.now_ns() < end_ns {
            clock.wait(&word, 0, end_ns);
        }
        // Whether the other thread is asleep already or not yet: it does not sleep for ever.
        for _ in 0..1000 {
            let before = word.load(Ordering::Acquire);
            std::thread::scope(|scope| {
                scope.spawn(|| {
                    while word.load(Ordering::Acquire) == before {
                        clock.wait(&word, before, u64::MAX);
                    }
                });
                word.fetch_add(1, Ordering::Release);
                wake(&word);
            });
        }
        assert_eq!(word.load(Ordering::Acquire), 1000);

        let clock = VirtualClock::new(100);
        clock.wait(&word, 0, 150);
        assert_eq!(clock.now_ns(), 100);
        clock.wait(&word, 1000, 150);
        assert_eq!(clock.now_ns(), 150);
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
