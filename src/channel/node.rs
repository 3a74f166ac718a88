use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::atomic::Ordering;

use iceoryx2::node::{DeadNodeView, NodeCleanupFailure, NodeDetails, NodeView};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as Service;

use super::upkeep::sample_bytes;
use super::{Attached, ChannelError, CleanUp, Owner, Reader, Record, Transport, Writer, remains};
use crate::wire::{RobotCheckpoint, RobotCommand, RobotObservation, RobotState, RobotTelemetry};

/// Nodes that a service can have: the daemon's threads and everybody who is attached.
pub(super) const MAX_NODES: usize = 256;
/// Samples that a reader may hold at a time.
pub(super) const MAX_HELD: usize = 4;
/// Samples that a writer may hold before sending: the next one, and one more.
pub(super) const MAX_LOANED: usize = 2;

/// One thread's membership in shared memory.
#[derive(Debug)]
pub(super) struct SharedNode {
    pub(super) transport: Transport,
    pub(super) node: Node<ipc::Service>,
}

impl SharedNode {
    pub(super) fn new(transport: Transport, node: Node<ipc::Service>) -> Self {
        Self { transport, node }
    }

    /// Attaches to a channel as a writer of samples with `robots` records, and makes the channel if
    /// it does not exist.
    ///
    /// # Errors
    /// [`ChannelError::Owned`] when the channel's only writer is somebody else, and the reasons for
    /// which a channel cannot be opened.
    pub(super) fn writer<R: Record>(&self, robots: usize) -> Result<Writer<R>, ChannelError> {
        self.publisher(&self.create::<R>(robots)?, robots)
    }

    fn publisher<R: Record>(
        &self,
        service: &Service<ipc::Service, [R], R::Header>,
        robots: usize,
    ) -> Result<Writer<R>, ChannelError> {
        let discarded = Writer::<R>::discard_counter();
        let counter = discarded.clone();
        let created = service
            .publisher_builder()
            .initial_max_slice_len(robots.max(1))
            .max_loaned_samples(MAX_LOANED)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .set_degradation_handler(self.transport.counting())
            .set_backpressure_handler(move |_| {
                counter.fetch_add(1, Ordering::Relaxed);
                iceoryx2::port::BackpressureAction::DiscardData
            })
            .create();
        match created {
            Ok(publisher) => {
                Ok(Writer::new(publisher, robots, R::CHANNEL.seal(&self.transport.fleet), discarded))
            }
            Err(PublisherCreateError::ExceedsMaxSupportedPublishers) => Err(ChannelError::Owned {
                fleet: self.transport.fleet.clone(),
                owner: self.owner_of(service),
            }),
            Err(e) => Err(self.port_error::<R>(&e)),
        }
    }

    /// Attaches to a channel that exists.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when it does not, and the reasons for which it cannot be opened.
    pub(super) fn reader<R: Record>(&self) -> Result<Reader<R>, ChannelError> {
        self.subscribe(&self.open::<R>()?)
    }

    /// Attaches to a channel, and makes it if it does not exist.
    ///
    /// # Errors
    /// The reasons for which it cannot be opened.
    pub(super) fn reader_or_create<R: Record>(&self, robots: usize) -> Result<Reader<R>, ChannelError> {
        self.subscribe(&self.create::<R>(robots)?)
    }

    /// Attaches to `observation` as one more writer, of samples with `robots` records. The channel has to
    /// exist: the daemon makes it when it listens.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when it does not, and the reasons for which it cannot be opened.
    pub(super) fn observer(&self, robots: usize) -> Result<Writer<RobotObservation>, ChannelError> {
        let writer = self.publisher(&self.open::<RobotObservation>()?, robots)?;
        self.transport.reserve_or(|free_bytes| ChannelError::NoRoom { free_bytes })?;
        Ok(writer)
    }

    fn subscribe<R: Record>(
        &self,
        service: &Service<ipc::Service, [R], R::Header>,
    ) -> Result<Reader<R>, ChannelError> {
        let created =
            service.subscriber_builder().set_degradation_handler(self.transport.counting()).create();
        created
            .map(|port| Reader::new(port, R::CHANNEL.seal(&self.transport.fleet)))
            .map_err(|e| self.port_error::<R>(&e))
    }

    fn open<R: Record>(&self) -> Result<Service<ipc::Service, [R], R::Header>, ChannelError> {
        let service = self.name::<R>()?;
        let opened =
            self.node.service_builder(&service).publish_subscribe::<[R]>().user_header::<R::Header>().open();
        opened.map_err(|e| self.open_error::<R>(e))
    }

    fn create<R: Record>(
        &self,
        robots: usize,
    ) -> Result<Service<ipc::Service, [R], R::Header>, ChannelError> {
        let settings = &self.transport.settings;
        let history = usize::from(R::CHANNEL.keeps_newest());
        let service = self.name::<R>()?;
        self.node
            .service_builder(&service)
            .publish_subscribe::<[R]>()
            .user_header::<R::Header>()
            .max_publishers(R::CHANNEL.max_writers(settings))
            .max_subscribers(R::CHANNEL.max_readers(settings))
            .max_nodes(MAX_NODES)
            .subscriber_max_borrowed_samples(MAX_HELD)
            .subscriber_max_buffer_size(R::CHANNEL.depth(settings, sample_bytes::<R>(robots)))
            .history_size(history)
            .enable_safe_overflow(R::CHANNEL.overwrites_oldest())
            .open_or_create()
            .map_err(|e| match e {
                PublishSubscribeOpenOrCreateError::PublishSubscribeOpenError(e) => self.open_error::<R>(e),
                other => self.open_failure::<R>(&other),
            })
    }

    fn name<R: Record>(&self) -> Result<ServiceName, ChannelError> {
        let name = self.transport.service_name(R::CHANNEL);
        ServiceName::new(&name).map_err(|_| ChannelError::FleetName { name: self.transport.fleet.clone() })
    }

    fn open_error<R: Record>(&self, error: PublishSubscribeOpenError) -> ChannelError {
        let service = self.transport.service_name(R::CHANNEL);
        match error {
            PublishSubscribeOpenError::DoesNotExist => ChannelError::NoDaemon { service },
            PublishSubscribeOpenError::IncompatibleTypes => ChannelError::Schema { service },
            other => self.open_failure::<R>(&other),
        }
    }

    fn open_failure<R: Record>(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Open { service: self.transport.service_name(R::CHANNEL), reason: format!("{reason:?}") }
    }

    fn port_error<R: Record>(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Port { service: self.transport.service_name(R::CHANNEL), reason: format!("{reason:?}") }
    }

    /// Removes what processes that died left behind: 0.1 ms when there is nothing, about 1 ms for
    /// each. Not for real-time threads.
    pub(super) fn clean_up(&self) -> CleanUp {
        let iceoryx = &self.transport.iceoryx;
        let (mut known, mut dead) = (BTreeSet::new(), Vec::new());
        let listed = Node::<ipc::Service>::list(iceoryx, |node| {
            known.insert(node.node_id().value());
            if let NodeState::Dead(node) = node {
                dead.push(node);
            }
            CallbackProgression::Continue
        });
        let mut done = CleanUp::default();
        for node in dead {
            remains::remove_unfinished(iceoryx, node.id().value());
            let removed = if node.details().is_some() {
                node.try_remove_stale_resources()
            } else {
                // iceoryx2 alone would look where its own default configuration says.
                let details = NodeDetails::__internal_new(&None, iceoryx);
                DeadNodeView::<ipc::Service>::__internal_try_remove_stale_resources(*node.id(), details)
            };
            match removed {
                Ok(()) => done.removed += 1,
                Err(NodeCleanupFailure::ResourcesAlreadyCleanedUp) => {}
                Err(_) => done.failed += 1,
            }
        }
        // Only who is not in the whole list is unknown.
        if listed.is_ok() {
            done.removed += remains::remove_unborn(iceoryx, &known);
        }
        done
    }

    /// Whether every channel that exists can be opened.
    pub(super) fn is_sound(&self) -> bool {
        fn usable<T>(opened: &Result<T, ChannelError>) -> bool {
            matches!(opened, Ok(_) | Err(ChannelError::NoDaemon { .. }))
        }
        usable(&self.open::<RobotState>())
            && usable(&self.open::<RobotCommand>())
            && usable(&self.open::<RobotTelemetry>())
            && usable(&self.open::<RobotCheckpoint>())
            && usable(&self.open::<RobotObservation>())
            && usable(&self.open_admin())
    }

    /// Whether somebody who lives writes the fleet's state.
    pub(super) fn has_daemon(&self) -> bool {
        self.open::<RobotState>().is_ok_and(|service| self.owner_of(&service).is_some())
    }

    /// [`Transport::attach_failures`].
    pub(super) fn attach_failures(&self) -> u64 {
        self.transport.attach_failures()
    }

    /// Who is attached now; 0 where a channel does not exist.
    pub(super) fn attached(&self) -> Attached {
        let (state_readers, _) = self.ports::<RobotState>();
        let (command_readers, _) = self.ports::<RobotCommand>();
        let (telemetry_readers, _) = self.ports::<RobotTelemetry>();
        let (_, observation_writers) = self.ports::<RobotObservation>();
        let admin_clients =
            self.open_admin().map_or(0, |service| service.dynamic_config().number_of_clients());
        Attached { state_readers, command_readers, telemetry_readers, observation_writers, admin_clients }
    }

    /// Readers and writers of a channel.
    fn ports<R: Record>(&self) -> (usize, usize) {
        self.open::<R>().map_or((0, 0), |service| {
            let ports = service.dynamic_config();
            (ports.number_of_subscribers(), ports.number_of_publishers())
        })
    }

    /// The process behind the first writer of a channel.
    fn owner_of<R: Record>(&self, service: &Service<ipc::Service, [R], R::Header>) -> Option<Owner> {
        let mut node_id = None;
        service.dynamic_config().list_publishers(|writer| {
            node_id = Some(writer.node_id);
            CallbackProgression::Stop
        });
        let state = Node::<ipc::Service>::state_of(&self.transport.iceoryx, node_id?).ok()??;
        let NodeState::Alive(view) = state else { return None };
        let details = view.details().as_ref()?;
        Some(Owner {
            node: details.name().as_str().to_owned(),
            executable: details.executable().to_string(),
            pid: i64::from(details.process_id().value()),
        })
    }
}
