//! The flight recorder of a fleet, and the replay of what it recorded.
//!
//! ```text
//! shared memory ─▶ reading thread ─▶ bounded queue ─▶ writing thread ─▶ MCAP files
//!                  counts ticks      drops, counted   chunks, rotation, full disk
//! ```
//!
//! A [`Recorder`] attaches to `state`, `command`, `telemetry` and `checkpoint` like any reader: the
//! daemon never waits for it, and what it misses is counted by the ticks. The samples are stored without
//! loss as protobuf, next to poses, twists and scenes in the types that Foxglove, Lichtblick, Rerun and
//! PlotJuggler know. Chunks are small and flushed by the clock, so that a kill leaves all but the last
//! fraction of a second; a full disk ends the file in order and is looked at again.
//!
//! `docs/RECORDING.md` describes topics, fields and what survives what.

mod configuration;
mod convert;
mod error;
mod files;
mod gaps;
mod options;
mod reading;
mod recorder;
pub mod replay;
pub mod schema;
mod segment;
mod status;
mod tap;
mod tape;
pub mod topic;
mod view;
mod writer;

pub use configuration::Configurations;
pub use convert::{Checkpoint, Command, Sample, State, Telemetry};
pub use error::RecordError;
pub use gaps::{Gaps, Recorded};
pub use options::{Compression, Options};
pub use reading::{Ending, Piece, ReadError, Reading};
pub use recorder::Recorder;
pub use status::{ChannelCounts, Notice, RunCounts, Status};

pub(crate) use status::Shared;
