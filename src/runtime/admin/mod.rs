//! The thread that answers operators.
//!
//! Requests are checked here, where there is time to allocate, to format and to build routes; what they
//! change waits on the [`Desk`] for the loop, which carries it out at the start of the next period. No
//! more waits there than one period takes, and no client has more than its share; what goes beyond is
//! answered busy at once. So a flood costs this thread some time and the period nothing.
//!
//! What takes long (thousands of goals, routes among many obstacles, the text of a large fleet) is worked
//! off a part at a time; whatever holds the fleet is taken up between two parts. A panic costs the request
//! that it came from.

mod answer;
mod goals;
mod job;
mod kept;
mod plan;
mod refusal;
mod rehearsal;
mod settle;
#[cfg(test)]
mod tests;
mod texts;
mod thread;
mod under_way;

pub use refusal::Refusal;
pub use rehearsal::Rehearsal;

use std::sync::mpsc::SyncSender;
use std::sync::{Arc, Mutex};

use super::Until;
use super::board::Board;
use super::desk::Desk;
use super::error::DaemonError;
use super::keeping::Journal;
use super::progress::Progress;
use crate::channel::Transport;
use crate::clock::MonotonicClock;
use crate::config::Config;
use crate::realtime::Achieved;
pub(super) use thread::Admin;

/// What the thread shares with the others.
pub(super) struct Shared {
    pub(super) config: Arc<Config>,
    pub(super) board: Arc<Board>,
    pub(super) desk: Arc<Desk>,
    pub(super) progress: Arc<Mutex<Progress>>,
    pub(super) realtime: Achieved,
    pub(super) workers: usize,
    pub(super) epoch: u64,
    /// Bits of [`crate::wire::state_flags`] that hold the fleet from the first period on.
    pub(super) hold: u32,
    pub(super) journal: Option<Journal>,
    pub(super) until: Until,
}

/// Batches that the desk has room for: orders, as many pauses, resumes and clears, and stops, which are
/// never busy. There is at most one before and one after each that clears one.
pub(super) fn desk_size(config: &Config) -> usize {
    3 * config.admin.changes_per_period + 1
}

/// The thread: makes its port, says so, answers until the run is over.
pub(super) fn admin_thread(
    transport: &Transport,
    shared: Shared,
    ready: &SyncSender<Result<(), DaemonError>>,
) {
    let prepared = (|| {
        let node = transport.attach("clearwayd-admin")?;
        let server = node.admin_server(shared.config.admin.max_clients)?;
        Ok::<_, DaemonError>((node, server))
    })();
    match prepared {
        Ok((node, server)) => {
            let _ = ready.send(Ok(()));
            Admin::new(MonotonicClock, node, server, shared).run();
        }
        Err(e) => {
            let _ = ready.send(Err(e));
        }
    }
}
