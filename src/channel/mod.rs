//! The channels of a fleet in shared memory: `clearway/<fleet>/v1/<channel>`.
//!
//! Reads and writes the records of [`crate::wire`] through iceoryx2 publish-subscribe services. A
//! sample is written in place and read in place: nothing is copied. `observation` has many writers,
//! the others one.
//!
//! | channel | record | writer | when a reader is slow |
//! |---|---|---|---|
//! | `observation` | [`RobotObservation`] | plants, drivers | oldest overwritten |
//! | `state` | [`RobotState`] | the daemon | oldest overwritten |
//! | `command` | [`RobotCommand`] | the daemon | oldest overwritten |
//! | `telemetry` | [`RobotTelemetry`] | the daemon | newest discarded, counted |
//! | `checkpoint` | [`RobotCheckpoint`] | the daemon | newest discarded, counted |
//!
//! A fifth one, `admin`, carries requests to the daemon and its answers: [`AdminPort`] and
//! [`AdminServer`].
//!
//! No writer ever waits for a reader. Sending and receiving take a few hundred nanoseconds and
//! neither allocate nor call the kernel; a loan makes one allocation of 48 bytes, so a [`Writer`]
//! takes the loan of its next sample ahead of time with [`Writer::prepare`]. The first send after
//! a reader has joined maps memory, up to 0.3 ms. Ports belong to the thread that made them.
//!
//! ```no_run
//! use clearway::{channel::{StateReader, Transport}, config::ChannelConfig};
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let transport = Transport::new("default", &ChannelConfig::default())?;
//! let node = transport.attach("watcher")?;
//! let mut states: StateReader = node.reader()?;
//! while let Some(sample) = states.next()? {
//!     println!("period {}: {} robots", sample.header().tick, sample.robots().len());
//! }
//! # Ok(())
//! # }
//! ```

mod admin;
mod attachment;
mod census;
mod error;
pub(crate) mod memory;
mod node;
mod node_admin;
mod owned;
mod reader;
mod record;
mod remains;
mod room;
mod transport;
mod upkeep;
mod writer;

pub use admin::{AdminPort, AdminServer, Asked, TEXT_MAX, Waiting};
pub use attachment::Attachment;
pub use census::{Attached, Census, CleanUp, Member};
pub use error::{ChannelError, Owner};
pub(crate) use reader::NotCopied;
pub use reader::{Reader, Received};
pub use record::{Channel, Record};
pub use transport::Transport;
pub use writer::Writer;

use crate::wire::{RobotCheckpoint, RobotCommand, RobotObservation, RobotState, RobotTelemetry};

/// Reads the fleet's states.
pub type StateReader = Reader<RobotState>;
/// Reads the fleet's commands.
pub type CommandReader = Reader<RobotCommand>;
/// Reads the daemon's telemetry.
pub type TelemetryReader = Reader<RobotTelemetry>;
/// Reads what plants and drivers observed.
pub type ObservationReader = Reader<RobotObservation>;
/// Reads what the controllers remembered.
pub type CheckpointReader = Reader<RobotCheckpoint>;
