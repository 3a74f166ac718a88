//! Robots that live in another process than the daemon.
//!
//! [`RemoteRobots`] receives command samples, moves its robots between the instants at which commands
//! begin and expire, and makes the observations that a link carries late, or loses. It keeps what its
//! robots really did: pieces of arcs, from which the smallest clearance over continuous time follows, also
//! between robots of different processes ([`MotionRecord`]). It knows neither channels nor clocks, so
//! that a test can turn the time. World frame, metres, radians, `CLOCK_MONOTONIC` ns. Allocates.

mod link;
mod record;
mod remote;

pub use link::{Link, Outgoing, Sighting};
pub use record::{MotionRecord, motions};
pub use remote::{Commands, RemoteRobots, Report, RobotReport};

#[cfg(test)]
mod tests;
