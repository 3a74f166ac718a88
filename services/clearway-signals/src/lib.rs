//! How Clearway's programs are asked to end: a signal sets a flag, which is all that a handler does, and
//! the program looks at it.
//!
//! ```no_run
//! use clearway_signals::{Again, Stop};
//!
//! let stop = Stop::listen(Again::Ends)?;
//! while !stop.is_asked() {
//!     // Work for a moment.
//! }
//! # Ok::<(), std::io::Error>(())
//! ```

use std::io;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use signal_hook::flag;

/// Exit status after a second signal, as shells report a death by SIGINT.
pub const IMPATIENT: i32 = 130;

/// What a second signal does.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Again {
    /// It ends the process at once, without a report, with status [`IMPATIENT`].
    Ends,
    /// Nothing more: what the program still has to do is short and must not be cut off.
    Waits,
}

/// Set once somebody asks the program to end. Clones are the same flag.
#[derive(Debug, Clone, Default)]
pub struct Stop(Arc<AtomicBool>);

impl Stop {
    /// Set by SIGINT and SIGTERM.
    ///
    /// # Errors
    /// The system refuses to have them handled.
    pub fn listen(again: Again) -> io::Result<Self> {
        Self::on(&[SIGINT, SIGTERM], again)
    }

    /// Set by the end of the terminal as well, SIGHUP: for a program that leaves something unfinished.
    ///
    /// # Errors
    /// Those of [`Stop::listen`].
    pub fn listen_to_terminal(again: Again) -> io::Result<Self> {
        Self::on(&[SIGINT, SIGTERM, SIGHUP], again)
    }

    /// Set by SIGTERM. SIGINT is ignored: it goes to every process of a terminal, and the end of a child is
    /// its parent's decision.
    ///
    /// # Errors
    /// Those of [`Stop::listen`].
    pub fn listen_to_parent() -> io::Result<Self> {
        Self::on(&[SIGINT], Again::Waits)?;
        Self::on(&[SIGTERM], Again::Waits)
    }

    fn on(signals: &[i32], again: Again) -> io::Result<Self> {
        let stop = Self::default();
        for signal in signals {
            if again == Again::Ends {
                // Before the other: the first signal finds the flag unset.
                flag::register_conditional_shutdown(*signal, IMPATIENT, Arc::clone(&stop.0))?;
            }
            flag::register(*signal, Arc::clone(&stop.0))?;
        }
        Ok(stop)
    }

    /// Whether the program is asked to end.
    pub fn is_asked(&self) -> bool {
        self.0.load(Ordering::Acquire)
    }

    /// Asks it, as a signal would.
    pub fn ask(&self) {
        self.0.store(true, Ordering::Release);
    }
}
