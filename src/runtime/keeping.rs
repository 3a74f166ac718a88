//! The journal while the daemon runs: taken up at the start, and written by a thread of its own.
//!
//! Whoever changes what is to be kept says so and gets a number; the thread writes what is newest, so
//! that a slow disk delays answers and nothing else, and says up to which number it is on the disk.

use std::path::{Path, PathBuf};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use miette::Diagnostic;
use thiserror::Error;

use super::Until;
use super::error::DaemonError;
use super::starting::{join_until, spawn};
use crate::config::Config;
use crate::journal::{Kept, Moment, Note, Resumed, StoppedBy, epoch_after, file, resume};

/// Between two attempts at a disk that takes nothing.
const RETRY_EVERY: Duration = Duration::from_secs(1);
/// A disk that takes longer for one writing is slow.
const SLOW: Duration = Duration::from_millis(200);
/// How long the last writing may take.
const PATIENCE: Duration = Duration::from_secs(5);

/// Why the journal does not let the daemon start.
#[derive(Debug, Error, Diagnostic)]
pub enum JournalError {
    /// It is there and cannot be read, or it cannot be written.
    #[error("the journal {path} cannot be {what}: {reason}")]
    #[diagnostic(help(
        "its directory has to exist and be writable; choose another with --journal or journal.path"
    ))]
    File {
        /// The file.
        path: String,
        /// What failed.
        what: &'static str,
        /// Why.
        reason: String,
    },

    /// It belongs to another fleet, whose daemon may be running.
    #[error("the journal {path} is that of fleet `{other}`")]
    #[diagnostic(help(
        "every fleet needs a journal of its own: choose another with --journal or journal.path"
    ))]
    OtherFleet {
        /// The file.
        path: String,
        /// That fleet.
        other: String,
    },

    /// It changed after it was read.
    #[error("the journal {path} was changed by somebody else while the daemon started")]
    #[diagnostic(help("start again; only one daemon may use it"))]
    Changed {
        /// The file.
        path: String,
    },
}

fn failed(path: &Path, what: &'static str, reason: &std::io::Error) -> JournalError {
    JournalError::File { path: path.display().to_string(), what, reason: reason.to_string() }
}

/// The wall clock, ns since 1970; 0 before.
fn wall_ns() -> u64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_nanos()).unwrap_or(0)
}

/// A journal that was read, and not touched yet.
#[derive(Debug)]
pub(super) struct Opened {
    path: PathBuf,
    found: Option<Vec<u8>>,
    aside: Option<&'static str>,
    kept: Kept,
    again: bool,
    notes: Vec<Note>,
}

impl Opened {
    /// The fleet as it is by now, and its journal if it is to have one. Only a run that goes on until
    /// it is stopped has.
    ///
    /// # Errors
    /// [`JournalError`].
    pub(super) fn open(config: Config, until: Until) -> Result<(Config, Option<Self>), JournalError> {
        let Some(path) = config.journal.path.clone().filter(|_| until == Until::Stopped) else {
            return Ok((config, None));
        };
        let found = file::load(&path).map_err(|e| failed(&path, "read", &e))?;
        let decoded = found.as_deref().map(Kept::decode);
        let least_epoch = match (&found, &decoded) {
            (Some(bytes), Some(Err(_))) => epoch_after(bytes, wall_ns()),
            _ => 0,
        };
        let Resumed { config, mut kept, again, aside, notes } = resume(config, decoded, &Moment::now())
            .map_err(|other| JournalError::OtherFleet { path: path.display().to_string(), other: other.0 })?;
        kept.epoch = kept.epoch.max(least_epoch);
        Ok((config, Some(Self { path, found, aside, kept, again, notes })))
    }

    /// What is kept, for a start.
    pub(super) fn kept(&self) -> &Kept {
        &self.kept
    }

    /// Whether robots may stand anywhere, because they were driven before.
    pub(super) fn again(&self) -> bool {
        self.again
    }

    /// What keeps the changes of run `epoch`. The file stays as it was found until
    /// [`begin`](Keeper::begin).
    pub(super) fn keeper(mut self, epoch: u64) -> Keeper {
        self.kept.epoch = epoch;
        let state =
            State { kept: self.kept.clone(), newest: 0, tried: 0, failure: None, writing: None, over: false };
        let (path, state) = (self.path.clone(), Mutex::new(state));
        let journal = Journal(Arc::new(Shared { path, state, changed: Condvar::new() }));
        Keeper { journal, opened: Some(self), thread: None }
    }

    /// Puts the run into the file.
    fn begin(mut self) -> Result<(), JournalError> {
        let path = self.path;
        if let Some(why) = self.aside {
            let aside = file::keep_aside(&path, why).map_err(|e| failed(&path, "kept aside", &e))?;
            self.notes
                .push(Note { alarm: true, text: format!("what it held is kept as {}", aside.display()) });
        }
        file::store(&path, &self.kept.encode()).map_err(|e| failed(&path, "written", &e))?;
        for Note { alarm, text } in &self.notes {
            if *alarm {
                tracing::warn!("journal {}: {text}", path.display());
            } else {
                tracing::info!("journal {}: {text}", path.display());
            }
        }
        Ok(())
    }

    /// Whether it is still as it was found.
    ///
    /// # Errors
    /// [`JournalError::Changed`], or it cannot be read.
    fn check(&self) -> Result<(), JournalError> {
        let path = &self.path;
        if file::load(path).map_err(|e| failed(path, "read", &e))? != self.found {
            return Err(JournalError::Changed { path: path.display().to_string() });
        }
        Ok(())
    }
}

/// What is to be kept, and how much of it is on the disk.
#[derive(Debug)]
struct State {
    kept: Kept,
    /// Number of the newest change.
    newest: u64,
    /// The newest one that was tried, and what came of it.
    tried: u64,
    failure: Option<String>,
    /// Since when it is being written.
    writing: Option<Instant>,
    over: bool,
}

#[derive(Debug)]
struct Shared {
    path: PathBuf,
    state: Mutex<State>,
    changed: Condvar,
}

impl Shared {
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Writes until it is over and everything is on the disk, or cannot be put there.
    fn run(&self) {
        let mut state = self.lock();
        loop {
            let due = state.newest > state.tried;
            if due || state.failure.is_some() {
                let (newest, text) = (state.newest, state.kept.clone());
                state.writing = Some(Instant::now());
                drop(state);
                let outcome = file::store(&self.path, &text.encode());
                state = self.lock();
                self.settle(&mut state, newest, outcome);
            }
            if state.over && state.newest == state.tried {
                return;
            }
            if state.newest > state.tried {
                continue;
            }
            let again = if state.failure.is_some() { RETRY_EVERY } else { Duration::MAX };
            let waited = self.changed.wait_timeout(state, again.min(Duration::from_secs(3600)));
            state = waited.unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn settle(&self, state: &mut State, number: u64, outcome: std::io::Result<()>) {
        state.tried = number;
        state.writing = None;
        let before = state.failure.take();
        state.failure = outcome.err().map(|e| e.to_string());
        match (&before, &state.failure) {
            (None, Some(why)) => tracing::error!(
                "the journal {} cannot be written: {why}; what operators change from now on does not survive a \
                 restart",
                self.path.display()
            ),
            (Some(_), None) => tracing::warn!("the journal {} is written again", self.path.display()),
            _ => {}
        }
    }
}

/// The journal of a run.
#[derive(Debug, Clone)]
pub(super) struct Journal(Arc<Shared>);

impl Journal {
    /// Changes what is kept; returns the number of the change.
    pub(super) fn keep(&self, change: impl FnOnce(&mut Kept)) -> u64 {
        let mut state = self.0.lock();
        change(&mut state.kept);
        state.newest += 1;
        self.0.changed.notify_all();
        state.newest
    }

    /// What came of a change: `None` while it is not on the disk, and the reason when it could not be put
    /// there.
    pub(super) fn outcome(&self, number: u64) -> Option<Result<(), String>> {
        let state = self.0.lock();
        (state.tried >= number).then(|| state.failure.clone().map_or(Ok(()), Err))
    }

    /// Whether the disk has not answered for longer than one does that is well.
    pub(super) fn is_slow(&self) -> bool {
        self.0.lock().writing.is_some_and(|since| since.elapsed() >= SLOW)
    }

    /// How it stands now.
    pub(super) fn condition(&self) -> Condition {
        let state = self.0.lock();
        Condition {
            failing: state.failure.is_some(),
            stopped: state.kept.stopped,
            restarts: state.kept.restarts.at_ns.len(),
        }
    }
}

/// What there is to tell about a journal.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Condition {
    /// It could not be written the last time.
    pub(super) failing: bool,
    /// What stopped the fleet.
    pub(super) stopped: Option<StoppedBy>,
    /// Restarts that count.
    pub(super) restarts: usize,
}

/// The owner of the journal's thread.
#[derive(Debug)]
pub(super) struct Keeper {
    journal: Journal,
    /// What the file held, until this run is in it.
    opened: Option<Opened>,
    thread: Option<JoinHandle<()>>,
}

impl Keeper {
    /// The fleet is ours, and nothing else can fail: from now on this run is in the journal, and one that
    /// does not end in order counts as a crash.
    ///
    /// # Errors
    /// [`JournalError::Changed`], or it cannot be written.
    pub(super) fn begin(&mut self) -> Result<(), DaemonError> {
        let Some(opened) = self.opened.take() else { return Ok(()) };
        opened.check()?;
        let writer = Arc::clone(&self.journal.0);
        self.thread = Some(spawn("clearway-jrnl", move || writer.run())?);
        Ok(opened.begin()?)
    }

    pub(super) fn path(&self) -> &Path {
        &self.journal.0.path
    }

    pub(super) fn journal(&self) -> Journal {
        self.journal.clone()
    }

    /// Writes that the run came to an orderly end.
    pub(super) fn end_in_order(&mut self) {
        self.journal.keep(|kept| {
            kept.ended = true;
            kept.restarts.reset();
        });
    }
}

impl Drop for Keeper {
    fn drop(&mut self) {
        self.journal.0.lock().over = true;
        self.journal.0.changed.notify_all();
        if let Some(thread) = self.thread.take()
            && join_until(thread, Instant::now() + PATIENCE).is_err()
        {
            tracing::error!("the journal is not written to its end: the disk does not answer");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    #[test]
    fn a_start_that_is_called_off_leaves_the_journal_as_it_was() {
        let folder = std::env::temp_dir().join(format!("clearway_keeping_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("a.journal");
        let mut config = Config::new(Scenario::builtin("swap8").unwrap());
        config.journal.path = Some(path.clone());
        let keeper = |epoch| {
            let (_, opened) = Opened::open(config.clone(), Until::Stopped).unwrap();
            opened.unwrap().keeper(epoch)
        };
        drop(keeper(1));
        assert!(!path.exists());
        let mut first = keeper(2);
        first.begin().unwrap();
        first.end_in_order();
        drop(first);
        let before = std::fs::read(&path).unwrap();
        drop(keeper(3));
        assert_eq!(std::fs::read(&path).unwrap(), before);
        // Begun by two at a time, it is that of the first.
        let (mut second, mut third) = (keeper(4), keeper(5));
        second.begin().unwrap();
        assert!(third.begin().is_err());
        drop((second, third));
        let kept = Kept::decode(&std::fs::read(&path).unwrap()).unwrap();
        assert_eq!((kept.epoch, kept.ended), (4, false));
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
