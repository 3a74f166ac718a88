//! The records that cross shared memory, `v1`.
//!
//! Every record is `repr(C)`, has no implicit padding and carries an explicit type name, so that a
//! reader in another language can declare the same layout. Units are in the names; the frame is
//! the world frame; time stamps are `CLOCK_MONOTONIC` nanoseconds of the machine that wrote them.
//! Every sample has one header and a slice of records, one for each robot, in ascending order of
//! id. The version is in the channel's name: a layout never changes within a version.

mod command;
mod observation;
mod state;
mod telemetry;

pub use command::{CommandHeader, RobotCommand, StopReason};
pub use observation::{ObservationHeader, RobotObservation};
pub use state::{RobotIntent, RobotState, StateHeader, state_flags};
pub use telemetry::{RobotTelemetry, SolveStatus, TelemetryHeader, telemetry_flags};
