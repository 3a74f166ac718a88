//! What the real-time threads tell about themselves, without formatting, locking or allocating.
//!
//! The loop and the workers fill plain records that were allocated before the first period and
//! hand them through bounded lock-free queues to the housekeeping thread, which hands them back.
//! When no empty record is there, the period goes unrecorded and is counted: telemetry never slows
//! control down. Filling a record is a copy of a few hundred bytes a robot.

mod pool;
mod record;

pub use pool::Pool;
pub use record::{PeriodRecord, SolveRecord};
