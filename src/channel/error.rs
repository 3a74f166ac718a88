use std::fmt;

use miette::Diagnostic;
use thiserror::Error;

use super::room::SHARED_MEMORY;

/// Who holds a channel that is wanted.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Owner {
    /// Name of its iceoryx2 node.
    pub node: String,
    /// Its executable.
    pub executable: String,
    /// Its process id.
    pub pid: i64,
}

impl fmt::Display for Owner {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "process {} ({}, node {:?})", self.pid, self.executable, self.node)
    }
}

/// Why a channel could not be had.
#[derive(Debug, Error, Diagnostic)]
pub enum ChannelError {
    /// The fleet's name cannot be part of a channel's name.
    #[error("the fleet name {name:?} cannot be part of a channel's name")]
    #[diagnostic(help("use 1 to 64 letters, digits, '-' or '_'"))]
    FleetName {
        /// The name.
        name: String,
    },

    /// The prefix or the root directory of shared memory is unusable.
    #[error("the channel {what} {value:?} is not usable: {reason}")]
    #[diagnostic(help(
        "set channel.prefix and channel.root in the configuration, or CLEARWAY_IOX2_PREFIX and CLEARWAY_IOX2_ROOT"
    ))]
    Location {
        /// Which setting.
        what: &'static str,
        /// Its value.
        value: String,
        /// What iceoryx2 says.
        reason: String,
    },

    /// The process could not join shared memory.
    #[error("cannot join shared memory under {root:?}: {reason}")]
    #[diagnostic(help(
        "check that {root} and /dev/shm exist, are writable and not full, and that `ulimit -n` allows more files"
    ))]
    Attach {
        /// The management directory.
        root: String,
        /// What iceoryx2 says.
        reason: String,
    },

    /// Shared memory is too full for the fleet's channels.
    #[error("the channels of {robots} robots need {} KiB of shared memory and {SHARED_MEMORY} has {} KiB free",
        needed_bytes / 1024, free_bytes / 1024)]
    #[diagnostic(help(
        "make room in {SHARED_MEMORY}, or lower channel.max_readers, channel.depth or admin.max_clients"
    ))]
    Full {
        /// Robots of the fleet.
        robots: usize,
        /// What the channels can fill.
        needed_bytes: u64,
        /// What there is.
        free_bytes: u64,
    },

    /// Shared memory is too full to join.
    #[error("{SHARED_MEMORY} is full: {} KiB are free, and that is not enough to join", free_bytes / 1024)]
    #[diagnostic(help(
        "make room in {SHARED_MEMORY}: `df {SHARED_MEMORY}` and `ls -lS {SHARED_MEMORY}` show what fills it"
    ))]
    NoRoom {
        /// What there is.
        free_bytes: u64,
    },

    /// What was left in shared memory cannot be used, and cannot be told to be nobody's.
    #[error(
        "the channels that were left cannot be used, and who lives may use files of {prefix:?} in {SHARED_MEMORY}"
    )]
    #[diagnostic(help(
        "end who is attached; when nobody is, remove the files of {prefix:?} in {SHARED_MEMORY}, {root}/nodes and \
         {root}/services; or set channel.prefix to one that nobody else uses"
    ))]
    Damaged {
        /// How names in shared memory begin.
        prefix: String,
        /// The management directory.
        root: String,
    },

    /// Shared memory could not be taken ahead.
    #[error("shared memory could not be taken ahead: {reason}")]
    #[diagnostic(help(
        "check the memory that the process may have (`ulimit -a`, its cgroup) and what {SHARED_MEMORY} is"
    ))]
    NotReserved {
        /// What the kernel says.
        reason: String,
    },

    /// Another process writes this fleet's channel.
    #[error("the fleet {fleet:?} belongs to {}", owner_text(.owner.as_ref()))]
    #[diagnostic(help("stop that process, or start this one with another --fleet name"))]
    Owned {
        /// The fleet.
        fleet: String,
        /// The owner, when it could be found out.
        owner: Option<Owner>,
    },

    /// Nobody has made the channel.
    #[error("the channel {service:?} does not exist: no daemon runs for this fleet")]
    #[diagnostic(help("start it with `clearwayd --fleet NAME`, or check the fleet's name"))]
    NoDaemon {
        /// The channel's full name.
        service: String,
    },

    /// The channel carries other records.
    #[error("the channel {service:?} carries records of another schema than v1")]
    #[diagnostic(help(
        "the daemon, or somebody who keeps its channel alive, is of another version: use the same on both sides"
    ))]
    Schema {
        /// The channel's full name.
        service: String,
    },

    /// The channel exists and does not fit.
    #[error("the channel {service:?} cannot be opened: {reason}")]
    #[diagnostic(help(
        "a reader or writer of another version, or with other limits, keeps it alive: stop that process"
    ))]
    Open {
        /// The channel's full name.
        service: String,
        /// What iceoryx2 says.
        reason: String,
    },

    /// The channel has no place for another reader or writer, or its memory could not be made.
    #[error("cannot attach to the channel {service:?}: {reason}")]
    #[diagnostic(help("raise channel.max_readers, or make room in /dev/shm"))]
    Port {
        /// The channel's full name.
        service: String,
        /// What iceoryx2 says.
        reason: String,
    },

    /// There was no memory for a sample: nothing went out.
    #[error("the channel {channel:?} has no memory for a sample")]
    #[diagnostic(help("a reader holds too many samples: end it"))]
    NotLoaned {
        /// The channel.
        channel: &'static str,
    },

    /// A sample could not be sent to every reader, or not received.
    #[error("the channel {channel:?} failed: {reason}")]
    Transfer {
        /// The channel.
        channel: &'static str,
        /// What failed.
        reason: &'static str,
    },
}

fn owner_text(owner: Option<&Owner>) -> String {
    owner.map_or_else(|| "another process".to_owned(), Owner::to_string)
}
