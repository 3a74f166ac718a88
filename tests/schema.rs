//! Who was built with another layout of the records cannot attach, and is told why.

mod support;

use clearway::channel::{ChannelError, StateReader, Transport, Writer};
use clearway::wire::{RobotObservation, RobotState};
use iceoryx2::prelude::*;
use support::World;

/// The header of `state` as it was before it had a checksum: the same name, another size.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("clearway.v1.StateHeader")]
struct Shorter {
    words: [u64; 5],
}

/// The same size, another name.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("clearway.v2.StateHeader")]
struct Renamed {
    words: [u64; 6],
}

/// A record with a field more.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, ZeroCopySend)]
#[type_name("clearway.v1.RobotState")]
struct Longer {
    record: [u64; 22],
}

fn node(world: &World) -> Node<ipc::Service> {
    let mut config = Config::default();
    config.global.prefix = FileName::new(world.channel.prefix.as_bytes()).unwrap();
    let root = world.channel.root.to_string_lossy().into_owned();
    config.global.set_root_path(&Path::new(root.as_bytes()).unwrap());
    NodeBuilder::new().config(&config).create::<ipc::Service>().unwrap()
}

/// Keeps the channel alive with other types, and attaches as we do.
fn ours_is_refused<
    R: ZeroCopySend + std::fmt::Debug + 'static,
    H: ZeroCopySend + std::fmt::Debug + 'static,
>() {
    let world = World::new("schema");
    let other = node(&world);
    let name = "clearway/default/v1/state";
    let service = other.service_builder(&ServiceName::new(name).unwrap());
    let _theirs = service.publish_subscribe::<[R]>().user_header::<H>().create().unwrap();
    let ours = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let reader: Result<StateReader, _> = ours.reader();
    let writer: Result<Writer<RobotState>, _> = ours.writer(8);
    for refused in [reader.map(|_| ()).unwrap_err(), writer.map(|_| ()).unwrap_err()] {
        assert!(matches!(&refused, ChannelError::Schema { service } if service == name), "{refused:?}");
        assert!(refused.to_string().contains("another schema"), "{refused}");
    }
}

#[test]
fn a_channel_of_another_version_is_refused_whatever_differs() {
    ours_is_refused::<RobotState, Shorter>();
    ours_is_refused::<RobotState, Renamed>();
    ours_is_refused::<Longer, clearway::wire::StateHeader>();
    ours_is_refused::<RobotObservation, clearway::wire::StateHeader>();
}

#[test]
fn a_client_of_another_version_cannot_attach_to_ours() {
    let world = World::new("schema");
    let ours = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let _states: Writer<RobotState> = ours.writer(8).unwrap();
    let other = node(&world);
    let name = ServiceName::new("clearway/default/v1/state").unwrap();
    let open = || other.service_builder(&name).publish_subscribe::<[RobotState]>();
    assert!(open().user_header::<Shorter>().open().is_err());
    assert!(open().user_header::<Renamed>().open().is_err());
    assert!(open().user_header::<clearway::wire::StateHeader>().open().is_ok());
}
