//! The records that cross shared memory, `v1`.
//!
//! Every record is `repr(C)`, has no implicit padding and carries an explicit type name, so that a
//! reader in another language can declare the same layout. Units are in the names; the frame is
//! the world frame; time stamps are `CLOCK_MONOTONIC` nanoseconds of the machine that wrote them.
//! Every sample has one header and a slice of records, one for each place of the fleet: first the
//! scenario's robots in ascending order of id, then, where the fleet has room for more, places for
//! robots that are added while it runs. A place that is free is marked ([`state_flags::VACANT`],
//! [`StopReason::Vacant`]) and its id is [`NO_ROBOT`]. `docs/CHANNELS.md` lists every field. The version
//! is in the channel's name: a layout never changes within a version.

mod admin;
mod checkpoint;
mod codes;
mod command;
mod observation;
mod seal;
mod state;
mod telemetry;

use codes::named_codes;

pub use admin::{AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, admin_flags};
pub use checkpoint::{CheckpointHeader, RobotCheckpoint, checkpoint_flags};
pub use command::{CommandHeader, RobotCommand, StopReason};
pub use observation::{Holding, ObservationHeader, RobotObservation};
pub use seal::{Header, Seal};
pub use state::{RobotIntent, RobotState, StateHeader, state_flags};
pub use telemetry::{RobotTelemetry, SolveStatus, TelemetryHeader, telemetry_flags};

/// In place of an id: no robot. No robot can be added under it.
pub const NO_ROBOT: u32 = u32::MAX;
