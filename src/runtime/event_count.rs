use std::sync::atomic::{AtomicU32, Ordering};

use crossbeam::utils::CachePadded;

use crate::clock::{Clock, wake};

/// Lets threads sleep until a condition changes that is kept elsewhere.
///
/// A waiter reads the count, looks at its condition, and waits with that count when it does not hold: a
/// change in between is not slept through. The other side changes the condition, then notifies. No lock,
/// no allocation; a system call to notify only when somebody sleeps.
#[derive(Debug, Default)]
pub(super) struct EventCount {
    /// Notifications, modulo 2³². Nobody sleeps through 2³² of them.
    count: CachePadded<AtomicU32>,
    /// Waiters that are asleep or about to be.
    asleep: AtomicU32,
}

impl EventCount {
    /// Notifications so far. What was changed before one that is counted here is visible.
    pub(super) fn count(&self) -> u32 {
        self.count.load(Ordering::Acquire)
    }

    /// Wakes everybody who waits.
    pub(super) fn notify(&self) {
        // Sequentially consistent on both sides: this sees the sleeper, or the sleeper sees this.
        self.count.fetch_add(1, Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) > 0 {
            wake(&self.count);
        }
    }

    /// Waits until the count is not `known` any more, or until `end_ns`; may return for no reason.
    pub(super) fn wait(&self, clock: &impl Clock, known: u32, end_ns: u64) {
        self.asleep.fetch_add(1, Ordering::SeqCst);
        clock.wait(&self.count, known, end_ns);
        self.asleep.fetch_sub(1, Ordering::SeqCst);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MonotonicClock;
    use std::sync::atomic::AtomicU64;

    /// Two threads that answer each other, each asleep until the other notifies.
    #[test]
    fn no_notification_is_slept_through() {
        const ROUNDS: u64 = 5_000;
        let (there, back) = (EventCount::default(), EventCount::default());
        let (asked, answered) = (AtomicU64::new(0), AtomicU64::new(0));
        let hear = |event: &EventCount, said: &AtomicU64, n: u64| loop {
            let known = event.count();
            if said.load(Ordering::Relaxed) >= n {
                break;
            }
            event.wait(&MonotonicClock, known, u64::MAX);
        };
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for n in 1..=ROUNDS {
                    hear(&there, &asked, n);
                    answered.store(n, Ordering::Relaxed);
                    back.notify();
                }
            });
            for n in 1..=ROUNDS {
                asked.store(n, Ordering::Relaxed);
                there.notify();
                hear(&back, &answered, n);
            }
        });
        assert_eq!((there.count(), back.count()), (5_000, 5_000));
    }

    #[test]
    fn the_count_wraps() {
        let event = EventCount::default();
        event.count.store(u32::MAX, Ordering::Relaxed);
        let known = event.count();
        event.notify();
        assert_eq!(event.count(), 0);
        // Returns at once.
        event.wait(&MonotonicClock, known, u64::MAX);
    }
}
