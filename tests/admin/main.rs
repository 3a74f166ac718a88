//! Operators' requests to a daemon over real shared memory, in one process.

mod asking;
mod flood;
mod goals;
mod holds;
mod robots;
#[path = "../support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use clearway::attach::{AdminClient, AdminError, Client, Subscriber};
use clearway::channel::{CommandReader, Transport};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::Config;
use clearway::geometry::{Pose, Vec2};
use clearway::model::{Obstacle, RobotId, RobotSpec};
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use clearway::wire::{
    AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, NO_ROBOT, RobotCommand, RobotState,
    StopReason, state_flags,
};
use support::{World, config, lanes};

const T: u64 = 10_000_000;

/// Far longer than any of this takes.
const PATIENCE: Duration = Duration::from_secs(30);

/// A daemon with real controllers, and a client of it.
struct Running {
    daemon: Daemon,
    client: Client,
    admin: AdminClient,
}

fn start(config: Config) -> Running {
    let channel = config.channel.clone();
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let client = Client::connect_at("default", &channel).unwrap();
    let admin = client.admin().unwrap().with_timeout(PATIENCE);
    Running { daemon, client, admin }
}

/// Two robots on lanes of fifty metres, a pillar beside them, an arena of a hundred metres.
fn two(world: &World) -> Config {
    let text = "schema = 1\nname = \"two\"\n\
        [[robot]]\nid = 0\nradius_m = 0.15\nstart = { x_m = 0, y_m = 0 }\ngoal = { x_m = 50, y_m = 0 }\n\
        [[robot]]\nid = 3\nradius_m = 0.15\nstart = { x_m = 0, y_m = 2 }\ngoal = { x_m = 50, y_m = 2 }\n\
        [[obstacle]]\ncircle = { x_m = 10, y_m = 10, radius_m = 1 }\n";
    let mut config = config(world, Scenario::parse(text, "two.toml").unwrap(), T);
    config.source.arena_m = 100.0;
    config
}

/// Reads on until `look` finds something.
fn until<R: clearway::channel::Record, F>(
    subscriber: &mut Subscriber<R>,
    mut look: impl FnMut(&R::Header, &[R]) -> Option<F>,
) -> F {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(sample) = subscriber.wait(PATIENCE).unwrap()
            && let Some(found) = look(sample.header(), sample.robots())
        {
            return found;
        }
    }
    panic!("nothing came");
}

fn refused(result: Result<impl std::fmt::Debug, AdminError>) -> (AdminCode, Option<u32>) {
    match result {
        Err(AdminError::Refused { code: Some(code), robot, text }) => {
            assert!(!text.is_empty());
            (code, robot)
        }
        other => panic!("{other:?}"),
    }
}

/// The answer to a request, and its text.
fn answered(waiting: &clearway::channel::Waiting) -> (AdminAnswer, Vec<u8>) {
    let end = Instant::now() + PATIENCE;
    loop {
        if let Some(answer) = waiting.answer().unwrap() {
            return answer;
        }
        assert!(Instant::now() < end, "every request is answered");
        std::thread::sleep(Duration::from_micros(200));
    }
}

fn goal_of(state: &RobotState) -> (f64, f64) {
    (state.goal_x_m, state.goal_y_m)
}

/// The reasons for which the robots stop, in the commands of one tick.
fn reasons(run: &mut Subscriber<RobotCommand>, tick: u64) -> Vec<u32> {
    until(run, |header, robots| {
        (header.tick >= tick).then(|| robots.iter().map(|c| c.stop_reason).collect::<Vec<_>>())
    })
}
