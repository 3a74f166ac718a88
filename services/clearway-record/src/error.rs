use clearway::channel::ChannelError;
use miette::Diagnostic;
use std::path::PathBuf;
use thiserror::Error;

/// Why a recording could not begin or go on.
#[derive(Debug, Error, Diagnostic)]
pub enum RecordError {
    /// The file is there.
    #[error("{} exists", .path.display())]
    #[diagnostic(help("choose another name, or give --overwrite"))]
    Exists {
        /// The file.
        path: PathBuf,
    },

    /// The file could not be made.
    #[error("{} cannot be written: {source}", .path.display())]
    #[diagnostic(help("check that the directory exists, is writable and has room"))]
    Create {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },

    /// Nobody controls the fleet.
    #[error("no daemon of the fleet {fleet:?} appeared in {seconds} s")]
    #[diagnostic(help("start clearwayd, check the fleet's name, or wait longer with --wait"))]
    NoDaemon {
        /// The fleet.
        fleet: String,
        /// How long was waited.
        seconds: u64,
    },

    /// Shared memory is unusable.
    #[error(transparent)]
    #[diagnostic(transparent)]
    Channel(#[from] ChannelError),

    /// A thread ended before its time.
    #[error("the recorder's {thread} thread panicked")]
    #[diagnostic(help("this should not happen: report it"))]
    Panicked {
        /// Which.
        thread: &'static str,
    },
}
