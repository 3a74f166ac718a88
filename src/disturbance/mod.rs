//! What disturbs robots, made and kept count of.
//!
//! [`DisturbedFleet`] moves robots whose wheels follow commands late and slip, and shows them with
//! noise: the plant of evaluations and of the daemon when `[disturbance]` asks for it. [`Remaining`] keeps
//! count of what robots may still travel on commands that they were given earlier: what the safety rows
//! need to know when `[robust]` allows for lag or delay. World frame, SI units. The same seed gives the
//! same bits on every machine, whatever the order of the robots. Nothing allocates after `new`.

mod fleet;
mod noise;
mod remaining;

pub use fleet::DisturbedFleet;
pub use noise::is_lost;
pub use remaining::Remaining;
