use miette::Diagnostic;
use thiserror::Error;

use super::keeping::JournalError;
use crate::channel::ChannelError;

/// Why the daemon could not start or could not finish.
#[derive(Debug, Error, Diagnostic)]
pub enum DaemonError {
    /// A channel could not be had.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Channel(#[from] ChannelError),

    /// What is to be kept over a restart cannot be.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Journal(#[from] JournalError),

    /// The policy is `require` and the kernel refused.
    #[error("real-time operation is required and was refused:\n  {}", degraded.join("\n  "))]
    #[diagnostic(help("grant what is missing, or set realtime.policy to \"prefer\" to run without"))]
    RealTime {
        /// What was refused, and what to do about it.
        degraded: Vec<String>,
    },

    /// A worker's controller could not be made.
    #[error("the controller of {worker} cannot be made: {reason}")]
    Controller {
        /// Which worker.
        worker: String,
        /// Why.
        reason: String,
    },

    /// A histogram could not be made.
    #[error("a histogram cannot be set up: {0}")]
    Histogram(#[from] hdrhistogram::errors::CreationError),

    /// A thread could not be started.
    #[error("the {thread} thread cannot be started: {reason}")]
    #[diagnostic(help("check `ulimit -u` and the memory limits of the process"))]
    Thread {
        /// Which thread.
        thread: String,
        /// Why.
        reason: String,
    },

    /// A thread panicked: a defect of the daemon.
    #[error("the {thread} thread panicked; every robot stops when its command expires")]
    #[diagnostic(help("please report this with the lines printed before it"))]
    Panicked {
        /// Which thread.
        thread: &'static str,
    },
}
