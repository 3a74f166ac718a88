//! A place for one thing that several threads change in turn, and for which nobody waits.
//!
//! As a mutex that is only ever tried, but left with a plain store: with nobody asleep there is nobody to wake, and
//! an atomic exchange for that would hold up everything that was written before it.

use std::cell::UnsafeCell;
use std::marker::PhantomData;
use std::ops::{Deref, DerefMut};
use std::sync::atomic::{AtomicU32, Ordering};

const FREE: u32 = 0;
const TAKEN: u32 = 1;
/// A panic has left it half changed.
const LOST: u32 = 2;

/// A thing and who has it. Begins a line of the cache, with what is asked first.
#[repr(C, align(64))]
pub(super) struct Seat<T> {
    state: AtomicU32,
    occupant: UnsafeCell<T>,
}

// SAFETY: the occupant is reached through a `Taken` alone, of which there is one at a time, so that what it passes
// from thread to thread is the occupant itself, never a shared reference to it.
unsafe impl<T: Send> Sync for Seat<T> {}

/// The occupant of a seat, until it is dropped; in a panic it is lost if it was to be changed.
pub(super) struct Taken<'a, T> {
    seat: &'a Seat<T>,
    /// It may be half changed.
    touched: bool,
    /// Shared and sent as what it stands for.
    occupant: PhantomData<&'a mut T>,
}

impl<T> Seat<T> {
    pub(super) fn new(occupant: T) -> Self {
        Self { state: AtomicU32::new(FREE), occupant: UnsafeCell::new(occupant) }
    }

    /// Who has it, to be asked for ahead.
    pub(super) fn state(&self) -> &impl Sized {
        &self.state
    }

    /// The occupant, if nobody has it and it is whole.
    pub(super) fn take(&self) -> Option<Taken<'_, T>> {
        self.take_from(FREE)
    }

    /// The occupant, if it was lost. It is whole for everybody once this is dropped.
    pub(super) fn take_lost(&self) -> Option<Taken<'_, T>> {
        self.take_from(LOST)
    }

    fn take_from(&self, state: u32) -> Option<Taken<'_, T>> {
        // Acquires what the one before left with a release.
        let taken = self.state.compare_exchange(state, TAKEN, Ordering::Acquire, Ordering::Relaxed);
        // One that was lost is half changed already.
        taken.is_ok().then(|| Taken { seat: self, touched: state == LOST, occupant: PhantomData })
    }
}

impl<T> Deref for Taken<'_, T> {
    type Target = T;

    fn deref(&self) -> &T {
        // SAFETY: only the one that made the state `TAKEN` has a `Taken`, and until it is dropped nobody else
        // can make it so.
        unsafe { &*self.seat.occupant.get() }
    }
}

impl<T> DerefMut for Taken<'_, T> {
    fn deref_mut(&mut self) -> &mut T {
        self.touched = true;
        // SAFETY: as above; and this one is borrowed for as long.
        unsafe { &mut *self.seat.occupant.get() }
    }
}

impl<T> Drop for Taken<'_, T> {
    fn drop(&mut self) {
        let state = if self.touched && std::thread::panicking() { LOST } else { FREE };
        self.seat.state.store(state, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn it_has_one_holder_and_is_lost_in_a_panic_until_it_is_made_anew() {
        let seat = Seat::new(1);
        let mut held = seat.take().unwrap();
        assert!(seat.take().is_none() && seat.take_lost().is_none());
        *held += 1;
        drop(held);
        assert_eq!(seat.take().as_deref(), Some(&2));
        let fails = |change: bool| {
            let failed = catch_unwind(AssertUnwindSafe(|| {
                let mut held = seat.take().unwrap();
                if change {
                    *held += 1;
                }
                std::panic::resume_unwind(Box::new("a fault, injected"));
            }));
            assert!(failed.is_err());
        };
        // One that was not touched is whole.
        fails(false);
        assert_eq!(seat.take().as_deref(), Some(&2));
        fails(true);
        assert!(seat.take().is_none());
        // And so does one that was to be made anew, and was not.
        let failed = catch_unwind(AssertUnwindSafe(|| {
            let _lost = seat.take_lost().unwrap();
            std::panic::resume_unwind(Box::new("a fault, injected"));
        }));
        assert!(failed.is_err() && seat.take().is_none());
        *seat.take_lost().unwrap() = 7;
        assert_eq!(seat.take().as_deref(), Some(&7));
    }

    /// Two numbers that only a holder at a time keeps equal, and of which no change is lost.
    #[test]
    fn many_threads_change_it_in_turn() {
        let (seat, rounds) = (Seat::new((0_u64, 0_u64)), 20_000);
        let change = || {
            let mut changed = 0;
            while changed < rounds {
                if let Some(mut both) = seat.take() {
                    assert_eq!(both.0, both.1);
                    both.0 += 1;
                    both.1 += 1;
                    changed += 1;
                }
            }
            changed
        };
        let changed: u64 = std::thread::scope(|scope| {
            let threads: Vec<_> = (0..4).map(|_| scope.spawn(change)).collect();
            threads.into_iter().map(|thread| thread.join().unwrap()).sum()
        });
        assert_eq!(changed, 4 * rounds);
        assert_eq!(seat.take().as_deref(), Some(&(changed, changed)));
    }
}
