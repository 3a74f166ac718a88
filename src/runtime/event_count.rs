use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use crossbeam::channel::{Receiver, Sender, bounded};
use crossbeam::utils::CachePadded;

use crate::clock::{Clock, wake};
use crate::config::Wakeup;

/// How long before the event that it expects a thread begins to spin, ns. More than a wake-up takes
/// from the timer, nearly always.
pub const SPIN_LEAD_NS: u64 = 50_000;

/// How long it spins for at most after the event was due, ns; then it sleeps, so that one that does not
/// come costs no CPU.
const SPIN_NS: u64 = 100_000;

/// How a thread waits this time.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Waiting {
    /// Asleep on a futex.
    Futex,
    /// Spinning: the event is due at `due_ns`.
    Spin {
        /// When it is due, ns.
        due_ns: u64,
    },
    /// Asleep in its own queue.
    Channel {
        /// Which of the waiters it is.
        waiter: usize,
    },
}

impl Waiting {
    /// How the `waiter`-th thread waits for what is due at `due_ns`.
    pub fn new(wakeup: Wakeup, waiter: usize, due_ns: u64) -> Self {
        match wakeup {
            Wakeup::Futex => Self::Futex,
            Wakeup::Spin => Self::Spin { due_ns },
            Wakeup::Channel => Self::Channel { waiter },
        }
    }
}

/// Lets threads wait until a condition changes that is kept elsewhere.
///
/// A waiter reads the count, looks at its condition, and waits with that count when it does not hold: a
/// change in between is not missed. The other side changes the condition, then notifies. No allocation;
/// no lock but the channel's; a system call to notify only when somebody sleeps.
#[derive(Debug)]
pub struct EventCount {
    /// Notifications, modulo 2³². Nobody sleeps through 2³² of them.
    count: CachePadded<AtomicU32>,
    /// Waiters that are asleep on the count, or about to be.
    asleep: AtomicU32,
    /// One for each waiter with [`Wakeup::Channel`]; a full one has a wake-up to deliver already.
    queues: Vec<(Sender<()>, Receiver<()>)>,
}

impl EventCount {
    /// For `waiters` threads.
    pub fn new(wakeup: Wakeup, waiters: usize) -> Self {
        let queues = if wakeup == Wakeup::Channel { waiters } else { 0 };
        Self {
            count: CachePadded::default(),
            asleep: AtomicU32::new(0),
            queues: (0..queues).map(|_| bounded(1)).collect(),
        }
    }

    /// Notifications so far. What was changed before one that is counted here is visible.
    pub fn count(&self) -> u32 {
        self.count.load(Ordering::Acquire)
    }

    /// Wakes everybody who waits.
    pub fn notify(&self) {
        // Sequentially consistent on both sides: this sees the sleeper, or the sleeper sees this.
        self.count.fetch_add(1, Ordering::SeqCst);
        if self.asleep.load(Ordering::SeqCst) > 0 {
            wake(&self.count);
        }
        for (queue, _) in &self.queues {
            let _ = queue.try_send(());
        }
    }

    /// Waits until the count is not `known` any more, or until `end_ns`; may return for no reason.
    pub fn wait(&self, clock: &impl Clock, waiting: Waiting, known: u32, end_ns: u64) {
        match waiting {
            Waiting::Futex => self.sleep(clock, known, end_ns),
            Waiting::Spin { due_ns } => self.spin(clock, known, due_ns, end_ns),
            Waiting::Channel { waiter } => {
                let Some((_, queue)) = self.queues.get(waiter) else {
                    return self.sleep(clock, known, end_ns);
                };
                if self.count() == known {
                    // Both answers mean the same: look again.
                    let _ = queue.recv_timeout(Duration::from_nanos(end_ns.saturating_sub(clock.now_ns())));
                }
            }
        }
    }

    fn sleep(&self, clock: &impl Clock, known: u32, end_ns: u64) {
        self.asleep.fetch_add(1, Ordering::SeqCst);
        clock.wait(&self.count, known, end_ns);
        self.asleep.fetch_sub(1, Ordering::SeqCst);
    }

    fn spin(&self, clock: &impl Clock, known: u32, due_ns: u64, end_ns: u64) {
        let from_ns = due_ns.saturating_sub(SPIN_LEAD_NS);
        let mut now_ns = clock.now_ns();
        if now_ns < from_ns {
            self.sleep(clock, known, from_ns.min(end_ns));
            now_ns = clock.now_ns();
        }
        let until_ns = now_ns.max(due_ns).saturating_add(SPIN_NS).min(end_ns);
        while self.count() == known {
            if clock.now_ns() >= until_ns {
                return self.sleep(clock, known, end_ns);
            }
            std::hint::spin_loop();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::clock::MonotonicClock;
    use std::sync::atomic::AtomicU64;

    const ALL: [Wakeup; 3] = [Wakeup::Futex, Wakeup::Spin, Wakeup::Channel];

    /// Two threads that answer each other, each waiting until the other notifies.
    #[test]
    fn no_notification_is_missed() {
        const ROUNDS: u64 = 2_000;
        for wakeup in ALL {
            let (there, back) = (EventCount::new(wakeup, 1), EventCount::new(wakeup, 1));
            let (asked, answered) = (AtomicU64::new(0), AtomicU64::new(0));
            let hear = |event: &EventCount, said: &AtomicU64, n: u64| loop {
                let known = event.count();
                if said.load(Ordering::Relaxed) >= n {
                    break;
                }
                event.wait(&MonotonicClock, Waiting::new(wakeup, 0, 0), known, u64::MAX);
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
            assert_eq!((there.count(), back.count()), (2_000, 2_000));
        }
    }

    #[test]
    fn a_wait_ends_in_time_and_with_the_count_s_wrap() {
        let clock = MonotonicClock;
        for wakeup in ALL {
            let event = EventCount::new(wakeup, 1);
            let waiting = |due_ns| Waiting::new(wakeup, 0, due_ns);
            // Nothing comes: before, while and after it spins.
            for ahead_ns in [10_000, 90_000, 400_000] {
                let end_ns = clock.now_ns() + ahead_ns;
                while clock.now_ns() < end_ns {
                    event.wait(&clock, waiting(clock.now_ns() + 60_000), 0, end_ns);
                }
            }
            event.count.store(u32::MAX, Ordering::Relaxed);
            let known = event.count();
            event.notify();
            assert_eq!(event.count(), 0);
            // Each returns at once.
            event.wait(&clock, waiting(0), known, u64::MAX);
            event.wait(&clock, waiting(u64::MAX), known, u64::MAX);
        }
    }
}
