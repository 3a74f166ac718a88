//! What is controlled: robots, their inputs and limits, and what stands in their way.
//!
//! Plain values in SI units and the world frame; no behaviour beyond what their invariants need.

mod command;
mod disturbance;
mod limits;
mod obstacle;
mod robot;

pub use command::Command;
pub use disturbance::Disturbance;
pub use limits::Limits;
pub use obstacle::Obstacle;
pub use robot::{RobotId, RobotSpec};
