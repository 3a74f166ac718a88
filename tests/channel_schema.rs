//! Peers that speak of other records under the same names.

mod support;

use clearway::channel::{ChannelError, StateReader, Transport};
use clearway::runtime::{Daemon, DaemonError, Until};
use clearway::wire::RobotState;
use iceoryx2::prelude::{Config, FileName, NodeBuilder, Path, SemanticString, ipc};
use support::{World, config, lanes, straight};

const T: u64 = 10_000_000;

/// Somebody who holds the state channel of the default fleet with records of his own.
macro_rules! other_version {
    ($world:expr) => {{
        let mut iceoryx = Config::default();
        iceoryx.global.prefix = FileName::new($world.channel.prefix.as_bytes()).unwrap();
        let root = Path::new($world.channel.root.to_string_lossy().as_bytes()).unwrap();
        iceoryx.global.set_root_path(&root);
        let name = Transport::new("default", &$world.channel)
            .unwrap()
            .service_name(clearway::channel::Channel::State);
        let node = NodeBuilder::new().config(&iceoryx).create::<ipc::Service>().unwrap();
        let service = node
            .service_builder(&name.as_str().try_into().unwrap())
            .publish_subscribe::<[u64]>()
            .open_or_create();
        (node, service)
    }};
}

#[test]
fn a_daemon_does_not_start_beside_records_of_another_schema() {
    let world = World::new("schema_daemon");
    let (_node, service) = other_version!(world);
    let service = service.unwrap();
    let daemon = Daemon::start_with(config(&world, lanes(1, 1.0), T), Until::Stopped, straight(T));
    match daemon.map(drop) {
        Err(DaemonError::Channel(ChannelError::Schema { service })) => assert!(service.ends_with("/state")),
        other => panic!("{other:?}"),
    }
    let reader: Result<StateReader, _> =
        Transport::new("default", &world.channel).unwrap().visit("reader").unwrap().reader::<RobotState>();
    assert!(matches!(reader.map(drop), Err(ChannelError::Schema { .. })));
    drop(service);
}

#[test]
fn a_peer_of_another_schema_cannot_join_a_running_daemon() {
    let world = World::new("schema_peer");
    let daemon = Daemon::start_with(config(&world, lanes(1, 50.0), T), Until::Stopped, straight(T)).unwrap();
    let (node, service) = other_version!(world);
    assert!(service.is_err());
    drop((service, node));
    daemon.stop();
    let report = daemon.join().unwrap();
    assert_eq!((report.send_failures, report.ended_by), (0, "operator"));
}
