//! What `.ci/realtime-sanitizer` runs under LLVM's RealtimeSanitizer, each test in a process of its own.
//! The one named `caught_…` is a control: the sanitizer has to end it.
#![cfg(clearway_rtsan)]

mod support;

use clearway::config::Config;
use clearway::controller::{Decision, RobotGroup};
use clearway::runtime::{Daemon, Decider, Until};
use clearway::scenario::Scenario;
use clearway::wire::RobotState;
use support::{World, config};

const T: u64 = 10_000_000;
const TICKS: u64 = 300;

fn fleet(world: &World, scenario: &str) -> Config {
    let mut config = config(world, Scenario::builtin(scenario).unwrap(), T);
    config.timing.workers = Some(2);
    config.timing.ticks = Some(TICKS);
    config
}

fn drive(scenario: &str) {
    let world = World::new(scenario);
    let report = Daemon::start(fleet(&world, scenario), Until::Stopped).unwrap().join().unwrap();
    assert_eq!((report.worker_panics, report.send_failures), (0, 0));
    assert!(report.ticks > TICKS / 2, "{} periods", report.ticks);
}

#[test]
fn swap8() {
    drive("swap8");
}

#[test]
fn circle_20() {
    drive("circle-20");
}

/// Allocates in every period.
struct Careless(RobotGroup);

impl Decider for Careless {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        self.0.decide(std::hint::black_box(&fleet.to_vec()), each);
    }
}

#[test]
fn caught_allocating_in_a_worker() {
    let world = World::new("careless");
    let config = fleet(&world, "swap8");
    let for_workers = config.clone();
    let make = move |owned| RobotGroup::new(&for_workers, owned).map(Careless);
    Daemon::start_with(config, Until::Stopped, make).unwrap().join().unwrap();
}
