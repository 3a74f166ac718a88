use std::sync::Arc;

use crossbeam::queue::ArrayQueue;

use crate::controller::{PreparedRoute, RouteShelf};
use crate::geometry::Vec2;
use crate::model::RobotSpec;

/// One thing that changes between two periods.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Change {
    /// The robot in a place gets another goal.
    Goal { place: usize, goal_m: Vec2 },
    /// Bits of [`crate::wire::state_flags`] for the whole fleet: those to set, and those to take away.
    Hold { set: u32, clear: u32 },
    /// A robot takes a free place, if its body has a gap of `margin_m` to every other.
    Add { place: usize, robot: RobotSpec, margin_m: f64 },
    /// The robot in a place is taken away.
    Remove { place: usize },
}

/// What became of a request that reached the loop.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Outcome {
    /// Not looked at yet.
    Waiting,
    /// The state of this tick is the first to show it.
    Done { tick: u64 },
    /// It had expired.
    Expired,
    /// One before it was refused, so that what it was checked against is not so.
    Outdated,
    /// The robot would stand too close to this one.
    TooClose { id: u32 },
}

/// The changes of one request: all of them or none.
#[derive(Debug)]
pub(super) struct Batch {
    /// Which request.
    pub(super) key: u64,
    pub(super) expires_ns: u64,
    /// Refusals of the loop that were known when it was checked.
    pub(super) refusals_known: u64,
    pub(super) changes: Vec<Change>,
    /// The routes to the goals among them, by place; what they replaced once it was carried out.
    pub(super) routes: Vec<(usize, Option<Box<PreparedRoute>>)>,
    pub(super) outcome: Outcome,
}

/// Where checked requests wait for the next period, and where they come back from it. What the loop
/// takes it gives back, so that it frees nothing.
#[derive(Debug)]
pub(super) struct Desk {
    pub(super) todo: ArrayQueue<Box<Batch>>,
    pub(super) done: ArrayQueue<Box<Batch>>,
    /// Where the workers find the routes to the goals that the next state tells.
    pub(super) shelf: Option<Arc<RouteShelf>>,
}

impl Desk {
    /// With room for `batches` at a time: the most that one period carries out.
    pub(super) fn new(batches: usize) -> Self {
        // Twice: a batch may wait for its answer while as many new ones are on their way.
        let (todo, done) = (ArrayQueue::new(batches.max(1)), ArrayQueue::new(2 * batches.max(1)));
        Self { todo, done, shelf: None }
    }

    /// Puts the routes to new goals on `shelf` when they are carried out.
    pub(super) fn with_shelf(self, shelf: Arc<RouteShelf>) -> Self {
        Self { shelf: Some(shelf), ..self }
    }
}
