//! Starting threads, waiting for them, and sharing out the robots.

use std::ops::Range;
use std::sync::mpsc::Receiver;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use super::board::Board;
use super::error::DaemonError;
use crate::realtime::ThreadGrant;
use crate::wire::StopReason;

/// Waits for a thread until `end`.
///
/// # Errors
/// The thread, when it has not ended by then.
pub(super) fn join_until<T>(
    thread: JoinHandle<T>,
    end: Instant,
) -> Result<std::thread::Result<T>, JoinHandle<T>> {
    while !thread.is_finished() {
        if Instant::now() >= end {
            return Err(thread);
        }
        std::thread::sleep(Duration::from_millis(1));
    }
    Ok(thread.join())
}

/// Ends the run when the loop does, however it does.
pub(super) struct EndOnDrop<'a>(pub(super) &'a Board);

impl Drop for EndOnDrop<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

/// Asks for the end of the run when housekeeping ends, however it does.
pub(super) struct StopOnDrop<'a>(pub(super) &'a Board);

impl Drop for StopOnDrop<'_> {
    fn drop(&mut self) {
        self.0.request_stop(StopReason::Operator);
    }
}

/// Starts a thread.
///
/// # Errors
/// [`DaemonError::Thread`].
pub(super) fn spawn<T: Send + 'static>(
    name: &str,
    body: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, DaemonError> {
    std::thread::Builder::new()
        .name(name.to_owned())
        .spawn(body)
        .map_err(|e| DaemonError::Thread { thread: name.to_owned(), reason: e.to_string() })
}

/// Waits until a thread is ready, or has died before it was.
pub(super) fn wait(
    readiness: &Receiver<Result<ThreadGrant, DaemonError>>,
) -> Result<ThreadGrant, DaemonError> {
    readiness.recv().unwrap_or(Err(DaemonError::Panicked { thread: "starting" }))
}

/// Contiguous shares of `robots` for `workers`, as equal as they can be. The last one gets the places
/// beyond them as well.
pub(super) fn shares(robots: usize, places: usize, workers: usize) -> impl Iterator<Item = Range<usize>> {
    let workers = workers.max(1);
    (0..workers).map(move |w| {
        let end = if w + 1 == workers { places.max(robots) } else { (w + 1) * robots / workers };
        w * robots / workers..end
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Wakeup;

    #[test]
    fn shares_are_contiguous_and_nearly_equal() {
        assert_eq!(shares(8, 8, 3).collect::<Vec<_>>(), [0..2, 2..5, 5..8]);
        assert_eq!(shares(2, 0, 2).collect::<Vec<_>>(), [0..1, 1..2]);
        assert_eq!(shares(8, 12, 3).collect::<Vec<_>>(), [0..2, 2..5, 5..12]);
        assert!(shares(5, 5, 0).eq(std::iter::once(0..5)));
        assert_eq!(shares(1000, 1000, 7).map(|share| share.len()).sum::<usize>(), 1000);
    }

    #[test]
    fn a_panic_in_housekeeping_asks_for_the_end() {
        let board = std::sync::Arc::new(Board::new(vec![0], 1, Wakeup::Futex));
        let shared = std::sync::Arc::clone(&board);
        let house = std::thread::spawn(move || {
            let _stop = StopOnDrop(&shared);
            std::panic::resume_unwind(Box::new("a fault, injected"));
        });
        assert!(house.join().is_err());
        assert_eq!(board.stop_requested(), Some(StopReason::Operator));
    }

    #[test]
    fn waiting_for_a_thread_ends_when_it_does_or_at_the_end_of_patience() {
        let quick = std::thread::spawn(|| 7);
        assert!(matches!(join_until(quick, Instant::now() + Duration::from_secs(60)), Ok(Ok(7))));
        let (release, wait) = std::sync::mpsc::channel::<()>();
        let slow = std::thread::spawn(move || wait.recv().is_err());
        let slow = join_until(slow, Instant::now()).expect_err("it waits for us");
        drop(release);
        assert!(slow.join().unwrap());
    }
}
