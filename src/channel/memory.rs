//! The channels of one fleet inside one process, for the simulator: the same ports over queues.
//!
//! Whoever holds the [`Memory`] stands between writers and readers: it can look at what waits in a
//! reader's queue and drop, repeat, reorder, change or add samples before the reader takes them.

use std::collections::VecDeque;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, Weak};

use super::{ChannelError, Record};
use crate::wire::{
    AdminAnswer, AdminRequest, AdminRobot, RobotCheckpoint, RobotCommand, RobotObservation, RobotState,
    RobotTelemetry,
};

/// Samples that wait for a reader before the oldest is overwritten, or the newest discarded.
const DEPTH: usize = 64;

/// A sample on its way.
#[doc(hidden)]
#[derive(Debug, Clone)]
pub(crate) struct Message<R: Record> {
    pub(crate) writer: u128,
    pub(crate) header: R::Header,
    pub(crate) robots: Arc<[R]>,
}

/// What waits for one reader.
#[doc(hidden)]
#[derive(Debug)]
pub(crate) struct Queue<R: Record>(Mutex<VecDeque<Message<R>>>);

impl<R: Record> Queue<R> {
    pub(super) fn take(&self) -> Option<Message<R>> {
        lock(&self.0).pop_front()
    }

    /// Shows everything that waits, to be changed.
    pub(crate) fn edit<T>(&self, change: impl FnOnce(&mut VecDeque<Message<R>>) -> T) -> T {
        change(&mut lock(&self.0))
    }
}

/// One channel.
#[doc(hidden)]
#[derive(Debug)]
pub struct Topic<R: Record> {
    readers: Mutex<Vec<Weak<Queue<R>>>>,
    writers: AtomicUsize,
    newest: Mutex<Option<Message<R>>>,
    /// There is no memory for another sample.
    exhausted: AtomicBool,
}

impl<R: Record> Default for Topic<R> {
    fn default() -> Self {
        Self {
            readers: Mutex::default(),
            writers: AtomicUsize::new(0),
            newest: Mutex::default(),
            exhausted: AtomicBool::new(false),
        }
    }
}

impl<R: Record> Topic<R> {
    /// Hands `message` to every reader; how many did not get it.
    pub(crate) fn send(&self, message: &Message<R>) -> u64 {
        let mut discarded = 0;
        lock(&self.readers).retain(|reader| {
            let Some(queue) = reader.upgrade() else { return false };
            queue.edit(|waiting| {
                if waiting.len() >= DEPTH && !R::CHANNEL.overwrites_oldest() {
                    discarded += 1;
                    return;
                }
                if waiting.len() >= DEPTH {
                    waiting.pop_front();
                }
                waiting.push_back(message.clone());
            });
            true
        });
        if R::CHANNEL.keeps_newest() {
            *lock(&self.newest) = Some(message.clone());
        }
        discarded
    }

    /// A queue of its own for one more reader.
    pub(crate) fn subscribe(&self) -> Arc<Queue<R>> {
        let waiting = lock(&self.newest).iter().cloned().collect();
        let queue = Arc::new(Queue(Mutex::new(waiting)));
        lock(&self.readers).push(Arc::downgrade(&queue));
        queue
    }

    /// Whether loans fail from now on.
    pub(crate) fn exhaust(&self, exhausted: bool) {
        self.exhausted.store(exhausted, Ordering::Relaxed);
    }

    pub(super) fn join(&self, writers_max: usize) -> bool {
        let joined = |n: usize| (n < writers_max).then_some(n + 1);
        self.writers.fetch_update(Ordering::Relaxed, Ordering::Relaxed, joined).is_ok()
    }

    fn readers(&self) -> usize {
        lock(&self.readers).iter().filter(|reader| reader.strong_count() > 0).count()
    }

    fn writers(&self) -> usize {
        self.writers.load(Ordering::Relaxed)
    }
}

/// All channels of a fleet.
#[doc(hidden)]
#[derive(Debug, Default)]
pub struct Memory {
    pub(crate) observation: Topic<RobotObservation>,
    pub(crate) state: Topic<RobotState>,
    pub(crate) command: Topic<RobotCommand>,
    pub(crate) telemetry: Topic<RobotTelemetry>,
    pub(crate) checkpoint: Topic<RobotCheckpoint>,
    requests: Mutex<VecDeque<LocalRequest>>,
    identities: AtomicU64,
}

impl Memory {
    /// The next identity of a port: never used again.
    pub(crate) fn identity(&self) -> u128 {
        u128::from(self.identities.fetch_add(1, Ordering::Relaxed)) + 1
    }

    pub(super) fn attached(&self) -> super::Attached {
        super::Attached {
            state_readers: self.state.readers(),
            command_readers: self.command.readers(),
            telemetry_readers: self.telemetry.readers(),
            observation_writers: self.observation.writers(),
            admin_clients: 0,
        }
    }

    pub(super) fn has_daemon(&self) -> bool {
        self.state.writers() > 0
    }

    pub(super) fn next_request(&self) -> Option<LocalRequest> {
        lock(&self.requests).pop_front()
    }

    /// Asks the daemon; the answer is there once it was given.
    pub(super) fn ask(&self, client: u128, header: AdminRequest, robots: &[AdminRobot]) -> Arc<LocalAnswer> {
        let answer = Arc::new(LocalAnswer::default());
        let request = LocalRequest { client, header, robots: robots.to_vec(), answer: Arc::clone(&answer) };
        lock(&self.requests).push_back(request);
        answer
    }
}

/// Where a request's answer is put.
#[derive(Debug, Default)]
pub(super) struct LocalAnswer(Mutex<Option<(AdminAnswer, Vec<u8>)>>);

impl LocalAnswer {
    pub(super) fn put(&self, header: &AdminAnswer, text: &[u8]) {
        *lock(&self.0) = Some((*header, text.to_vec()));
    }

    pub(super) fn take(&self) -> Option<(AdminAnswer, Vec<u8>)> {
        lock(&self.0).take()
    }
}

/// A request on its way.
#[derive(Debug)]
pub(super) struct LocalRequest {
    pub(super) client: u128,
    pub(super) header: AdminRequest,
    pub(super) robots: Vec<AdminRobot>,
    pub(super) answer: Arc<LocalAnswer>,
}

/// The writing end of a channel in memory.
#[derive(Debug)]
pub(super) struct LocalWriter<R: Record> {
    memory: Arc<Memory>,
    identity: u128,
    robots: Vec<R>,
    discarded: u64,
}

impl<R: Record> LocalWriter<R> {
    pub(super) fn new(memory: &Arc<Memory>, robots: usize) -> Self {
        let (memory, identity) = (Arc::clone(memory), memory.identity());
        Self { memory, identity, robots: vec![R::default(); robots], discarded: 0 }
    }

    pub(super) fn prepare(&self) -> Result<(), ChannelError> {
        if R::topic(&self.memory).exhausted.load(Ordering::Relaxed) {
            return Err(ChannelError::NotLoaned { channel: R::CHANNEL.name() });
        }
        Ok(())
    }

    pub(super) fn publish(
        &mut self,
        fill: impl FnOnce(&mut R::Header, &mut [R]),
    ) -> Result<(), ChannelError> {
        self.prepare()?;
        let mut header = R::Header::default();
        self.robots.fill(R::default());
        fill(&mut header, &mut self.robots);
        let message = Message { writer: self.identity, header, robots: Arc::from(&self.robots[..]) };
        self.discarded += R::topic(&self.memory).send(&message);
        Ok(())
    }

    pub(super) fn discarded(&self) -> u64 {
        self.discarded
    }
}

impl<R: Record> Drop for LocalWriter<R> {
    fn drop(&mut self) {
        R::topic(&self.memory).writers.fetch_sub(1, Ordering::Relaxed);
    }
}

/// Nobody panics while holding one of these locks, and if so what they guard is still whole.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
