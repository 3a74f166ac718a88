//! The loop and its workers over real shared memory, in lockstep under a virtual clock: nothing here
//! depends on how fast the machine is.

use std::ops::Range;
use std::sync::Arc;

use crate::config::Config;
use crate::controller::{RobotGroup, Robots};
use crate::scenario::Scenario;

mod faults;
mod heartbeat;
mod periods;
mod regions;
mod rig;
#[path = "../../../tests/support/mod.rs"]
pub(in crate::runtime) mod support;

const T: u64 = 80_000_000;
const START: u64 = 1_000_000_000;

/// What goes wrong in a worker's n-th period.
type Fault = Arc<dyn Fn(u64, &Range<usize>) + Send + Sync>;

fn swap8() -> Scenario {
    Scenario::builtin("swap8").unwrap()
}

fn group(config: &Config) -> impl Fn(Range<usize>) -> RobotGroup + Send + Sync + use<> {
    let config = config.clone();
    move |owned| RobotGroup::new(&config, owned).unwrap()
}

/// Groups that share the controllers of the fleet and answer regions.
fn regional(config: &Config) -> impl Fn(Range<usize>) -> RobotGroup + Send + Sync + use<> {
    let robots = Arc::new(Robots::new(config));
    let config = config.clone();
    move |_| RobotGroup::among(&config, Arc::clone(&robots)).unwrap()
}
