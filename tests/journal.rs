//! A fleet that is driven again: what its journal says of it, and what only observations can.

mod support;

use clearway::attach::{Client, ObservationPublisher};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::{Config, SourceKind};
use clearway::geometry::Pose;
use clearway::model::RobotId;
use clearway::runtime::{Daemon, Until};
use clearway::wire::{RobotState, state_flags};
use support::process::until;
use support::{World, config, lanes};

fn kept(world: &World) -> Config {
    std::fs::create_dir_all(&world.channel.root).unwrap();
    let mut config = config(world, lanes(2, 50.0), 20_000_000);
    config.source.kind = SourceKind::Observation;
    // Nothing here depends on how busy the machine is.
    config.source.max_age_ns = Some(10_000_000_000);
    config.journal.path = Some(world.channel.root.join("fleet.journal"));
    config
}

#[test]
fn nobody_drives_again_before_everybody_has_been_seen() {
    let world = World::new("again");
    let config = kept(&world);
    let see = |eyes: &mut ObservationPublisher, id: u32, y_m| {
        eyes.publish(MonotonicClock.now_ns(), &[(RobotId(id), Pose::new(1.0, y_m, 0.0))]).unwrap();
    };
    let fleet = |client: &Client| -> Vec<RobotState> {
        let mut states = client.states().unwrap();
        until(|| states.next().unwrap().map(|sample| sample.robots().to_vec()))
    };
    for (run, unseen_m) in [(0, 0.0), (1, f64::INFINITY)] {
        let daemon = Daemon::start(config.clone(), Until::Stopped).unwrap();
        assert_eq!(daemon.journal(), config.journal.path.as_deref());
        let client = Client::connect_at(&config.fleet, &world.channel).unwrap();
        let [mut one, mut other] = [(); 2].map(|()| client.observations(1).unwrap());
        assert_eq!(fleet(&client)[0].uncertainty_m, unseen_m, "run {run}");
        // One of the two: the other one stands at its start, or anywhere.
        until(|| {
            see(&mut one, 0, 0.0);
            fleet(&client)[0].has(state_flags::VALID).then_some(())
        });
        let mut states = client.states().unwrap();
        let (mut periods, mut moved) = (0, false);
        until(|| {
            let sample = states.next().unwrap()?;
            (periods, moved) = (periods + 1, moved || sample.robots()[0].v_mps > 0.0);
            (moved || periods == 50).then_some(())
        });
        assert_eq!(moved, run == 0, "run {run}");
        until(|| {
            see(&mut one, 0, 0.0);
            see(&mut other, 3, 1.0);
            fleet(&client).iter().all(|robot| robot.v_mps > 0.0).then_some(())
        });
        drop((states, one, other, client));
        daemon.stop();
        daemon.join().unwrap();
    }
}

#[test]
fn a_run_that_ends_by_itself_keeps_nothing() {
    let world = World::new("once");
    let mut config = kept(&world);
    config.source.kind = SourceKind::Plant;
    config.timing.ticks = Some(3);
    let daemon = Daemon::start(config.clone(), Until::Arrived).unwrap();
    assert_eq!(daemon.journal(), None);
    daemon.join().unwrap();
    assert!(!config.journal.path.unwrap().exists());
}
