use std::collections::BTreeSet;
use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

use iceoryx2::node::{DeadNodeView, NodeCleanupFailure, NodeDetails, NodeView};
use iceoryx2::port::publisher::PublisherCreateError;
use iceoryx2::port::{DegradationAction, DegradationFn};
use iceoryx2::prelude::*;
use iceoryx2::service::builder::publish_subscribe::{
    PublishSubscribeOpenError, PublishSubscribeOpenOrCreateError,
};
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::port_factory::publish_subscribe::PortFactory as Service;
use iceoryx2::service::port_factory::request_response::PortFactory as AdminService;
use rustix::io::Errno;

use super::admin::{self, AdminPort, AdminServer};
use super::memory::Memory;
use super::owned::Owned;
use super::{Attachment, Channel, ChannelError, Owner, Reader, Record, Writer, remains, room};
use crate::config::{ChannelConfig, is_fleet_name};
use crate::wire::{
    AdminAnswer, AdminRequest, AdminRobot, RobotCheckpoint, RobotCommand, RobotObservation, RobotState,
    RobotTelemetry,
};

/// Nodes that a service can have: the daemon's threads and everybody who is attached.
const MAX_NODES: usize = 256;
/// Samples that a reader may hold at a time.
const MAX_HELD: usize = 4;
/// Samples that a writer may hold before sending: the next one, and one more.
const MAX_LOANED: usize = 2;

/// What iceoryx2 adds to a sample.
const SAMPLE_OVERHEAD_BYTES: usize = 64;
/// What services, nodes and connections take besides the samples.
const MANAGEMENT_BYTES: usize = 2 << 20;
/// What one more process takes to join: its node, its ports, and the writers' connections to them.
const JOIN_BYTES: u64 = 128 << 10;

/// How often the daemon looks for a moment in which it can mend its channels, and for room.
const LOOKS: u32 = 50;
const LOOK_EVERY: Duration = Duration::from_millis(7);

fn sample_bytes<R: Record>(robots: usize) -> usize {
    robots * size_of::<R>() + size_of::<R::Header>()
}

/// Where the channels of one fleet are.
#[derive(Debug, Clone)]
pub struct Transport {
    fleet: String,
    pub(super) settings: ChannelConfig,
    pub(super) iceoryx: Config,
    memory: Option<Arc<Memory>>,
    /// Of all ports that were made with this and its clones.
    attach_failures: Arc<AtomicU64>,
}

impl Transport {
    /// Checks the fleet's name and the location; touches nothing yet.
    ///
    /// # Errors
    /// [`ChannelError::FleetName`] or [`ChannelError::Location`].
    pub fn new(fleet: &str, settings: &ChannelConfig) -> Result<Self, ChannelError> {
        if !is_fleet_name(fleet) {
            return Err(ChannelError::FleetName { name: fleet.to_owned() });
        }
        // Explicit, because iceoryx2 otherwise looks for a file relative to the working directory.
        let mut iceoryx = Config::default();
        let location = |what, value: String, reason: &dyn Debug| ChannelError::Location {
            what,
            value,
            reason: format!("{reason:?}"),
        };
        iceoryx.global.prefix = FileName::new(settings.prefix.as_bytes())
            .map_err(|e| location("prefix", settings.prefix.clone(), &e))?;
        let root = settings.root.to_string_lossy().into_owned();
        let path = Path::new(root.as_bytes()).map_err(|e| location("root", root, &e))?;
        iceoryx.global.set_root_path(&path);
        Ok(Self {
            fleet: fleet.to_owned(),
            settings: settings.clone(),
            iceoryx,
            memory: None,
            attach_failures: Arc::default(),
        })
    }

    /// The same channels inside this process: nothing of them is in shared memory.
    pub(crate) fn in_memory(self, memory: Arc<Memory>) -> Self {
        Self { memory: Some(memory), ..self }
    }

    /// Times that somebody who joined could not be connected to a port that was made with this or a clone of
    /// it: no file descriptors were left, or memory could not be mapped. Who is meant is neither heard nor
    /// served; the port tries again when the next one joins or leaves.
    pub fn attach_failures(&self) -> u64 {
        self.attach_failures.load(Ordering::Relaxed)
    }

    /// What a port does that cannot connect to somebody: it counts, and goes on with the others.
    fn counting(&self) -> impl DegradationFn + 'static {
        let failures = Arc::clone(&self.attach_failures);
        move |_, _: &_| {
            failures.fetch_add(1, Ordering::Relaxed);
            DegradationAction::Ignore
        }
    }

    /// The fleet's name.
    pub fn fleet(&self) -> &str {
        &self.fleet
    }

    /// Full name of a channel.
    pub fn service_name(&self, channel: Channel) -> String {
        channel.service_name(&self.fleet)
    }

    /// Full name of the `admin` channel.
    pub fn admin_name(&self) -> String {
        format!("clearway/{}/v1/{}", self.fleet, admin::NAME)
    }

    /// Checks that shared memory can hold what the daemon of a fleet writes. Memory that is promised
    /// and not there ends a process with SIGBUS at its first use, far from the cause.
    ///
    /// # Errors
    /// [`ChannelError::Full`]. A file system that cannot be asked is taken to be large enough.
    pub fn check_room(&self, robots: usize, admin_clients: usize) -> Result<(), ChannelError> {
        let needed_bytes = self.needed_bytes(robots, admin_clients);
        let short = || room::free_bytes().filter(|free| *free < needed_bytes);
        for _ in 0..LOOKS {
            if short().is_none() {
                return Ok(());
            }
            // Who reads what a dead daemon left lets go of it at the next look.
            std::thread::sleep(LOOK_EVERY);
        }
        short().map_or(Ok(()), |free_bytes| Err(ChannelError::Full { robots, needed_bytes, free_bytes }))
    }

    /// Shared memory that the channels of a fleet of `robots` with `admin_clients` can fill, bytes.
    pub fn needed_bytes(&self, robots: usize, admin_clients: usize) -> u64 {
        let needed = self.bytes::<RobotState>(robots)
            + self.bytes::<RobotCommand>(robots)
            + self.bytes::<RobotTelemetry>(robots)
            + self.bytes::<RobotCheckpoint>(robots)
            + admin::server_bytes(admin_clients)
            + MANAGEMENT_BYTES;
        u64::try_from(needed).unwrap_or(u64::MAX)
    }

    /// Looks whether the channels can be used as they are. Where they cannot, because shared memory was
    /// damaged or is of another version, and nobody lives who uses them, removes all of them: they are made
    /// anew. Files of others with the same prefix stay. Returns how many it removed. For the daemon, before it
    /// starts.
    ///
    /// # Errors
    /// [`ChannelError::Damaged`] when what keeps them from being used may be somebody's who lives.
    pub fn mend(&self) -> Result<usize, ChannelError> {
        let mut owned = Owned::listed(&self.iceoryx);
        let lives = || self.census().map_or(true, |census| census.alive + census.unclear > 0);
        let (mut hangs, mut refused) = (false, false);
        for _ in 0..LOOKS {
            owned.look();
            // iceoryx2 waits for ever for a file to be filled whose maker is gone.
            hangs = owned.has_empty();
            let joined = (!hangs).then(|| self.join("clearwayd-look", &self.iceoryx));
            let full = matches!(joined, Some(Err(ChannelError::NoRoom { .. })));
            refused = matches!(joined, Some(Err(_)));
            if joined.is_some_and(|node| node.is_ok_and(|node| node.is_sound())) {
                return Ok(0);
            }
            let removed = remains::remove_all(&self.iceoryx, &owned, lives);
            // Whether that is enough is asked for later.
            if removed > 0 || full {
                return Ok(removed);
            }
            // Whoever waits for a daemon is there for a moment, again and again.
            std::thread::sleep(LOOK_EVERY);
        }
        // Who cannot join, or opens the channels of somebody who lives, is told why.
        if refused || !hangs && self.census().is_ok_and(|census| census.alive > 0) {
            return Ok(0);
        }
        Err(ChannelError::Damaged {
            prefix: self.settings.prefix.clone(),
            root: self.settings.root.to_string_lossy().into_owned(),
        })
    }

    /// Gives every file of these channels the memory that it promises, whatever else fills up later.
    /// Memory is otherwise taken at its first use, and a process that uses what is not there any more
    /// ends with SIGBUS. For whoever has made its ports; at start only.
    ///
    /// # Errors
    /// [`ChannelError::Full`] when there is not enough, [`ChannelError::NotReserved`] when it could not be taken.
    pub fn reserve(&self, robots: usize, admin_clients: usize) -> Result<(), ChannelError> {
        self.reserve_or(|free_bytes| ChannelError::Full {
            robots,
            needed_bytes: self.needed_bytes(robots, admin_clients),
            free_bytes,
        })
    }

    /// The same; `full` is the error when there is not enough, of what is free in bytes.
    fn reserve_or(&self, full: impl FnOnce(u64) -> ChannelError) -> Result<(), ChannelError> {
        room::reserve(&Owned::listed(&self.iceoryx).found().ours).map_err(|e| match e {
            Errno::NOSPC => full(room::free_bytes().unwrap_or(0)),
            other => ChannelError::NotReserved { reason: other.to_string() },
        })
    }

    /// Who is attached below the same prefix and root, found without joining and without cleaning up.
    ///
    /// # Errors
    /// [`ChannelError::Attach`] when the management directory cannot be read.
    pub fn census(&self) -> Result<Census, ChannelError> {
        let mut census = Census::default();
        Node::<ipc::Service>::list(&self.iceoryx, |node| {
            match node {
                NodeState::Alive(_) => census.alive += 1,
                NodeState::Dead(_) => census.dead += 1,
                NodeState::Inaccessible(_) | NodeState::Undefined(_) => census.unclear += 1,
            }
            CallbackProgression::Continue
        })
        .map_err(|e| ChannelError::Attach {
            root: self.settings.root.to_string_lossy().into_owned(),
            reason: format!("{e:?}"),
        })?;
        Ok(census)
    }

    /// Processes that are attached to this fleet, found as [`Transport::census`] does; ascending by
    /// process and role.
    ///
    /// # Errors
    /// Those of [`Transport::census`].
    pub fn members(&self) -> Result<Vec<Member>, ChannelError> {
        let mut members = Vec::new();
        Node::<ipc::Service>::list(&self.iceoryx, |node| {
            if let NodeState::Alive(node) = node
                && let Some(details) = node.details()
            {
                // The name that `attach` gave it.
                let process = details.process_id().value();
                let name = details.name().as_str();
                if let Some(role) = name.strip_suffix(&format!("-{}-{process}", self.fleet)) {
                    let executable = details.executable().to_string();
                    members.push(Member { process, executable, role: role.to_owned() });
                }
            }
            CallbackProgression::Continue
        })
        .map_err(|e| ChannelError::Attach {
            root: self.settings.root.to_string_lossy().into_owned(),
            reason: format!("{e:?}"),
        })?;
        members.sort();
        Ok(members)
    }

    /// What the writer of a channel sets aside for its samples.
    fn bytes<R: Record>(&self, robots: usize) -> usize {
        let sample = sample_bytes::<R>(robots);
        let depth = R::CHANNEL.depth(&self.settings, sample);
        (R::CHANNEL.max_readers(&self.settings) * (depth + MAX_HELD) + MAX_LOANED + 1)
            * (sample + SAMPLE_OVERHEAD_BYTES)
    }

    /// Joins shared memory under a name that tells others who this is. Cleans up after processes
    /// that died.
    ///
    /// # Errors
    /// [`ChannelError::Attach`], or [`ChannelError::NoRoom`] when shared memory is full.
    pub fn attach(&self, role: &str) -> Result<Attachment, ChannelError> {
        self.node(role, &self.iceoryx)
    }

    /// The same for those who come and go: they leave the cleaning to the daemon. A clean-up that is
    /// killed halfway leaves what nobody can remove any more.
    ///
    /// # Errors
    /// Those of [`Transport::attach`].
    pub fn visit(&self, role: &str) -> Result<Attachment, ChannelError> {
        let mut iceoryx = self.iceoryx.clone();
        iceoryx.global.node.cleanup_dead_nodes_on_creation = false;
        iceoryx.global.node.cleanup_dead_nodes_on_destruction = false;
        iceoryx.global.service.cleanup_dead_nodes_on_open = false;
        self.node(role, &iceoryx)
    }

    fn node(&self, role: &str, iceoryx: &Config) -> Result<Attachment, ChannelError> {
        if let Some(memory) = &self.memory {
            return Ok(Attachment::local(Arc::clone(memory), self));
        }
        self.join(role, iceoryx).map(Attachment::shared)
    }

    fn join(&self, role: &str, iceoryx: &Config) -> Result<SharedNode, ChannelError> {
        let failed = |reason: String| ChannelError::Attach {
            root: self.settings.root.to_string_lossy().into_owned(),
            reason,
        };
        // Who dies of memory that is not there leaves files that keep everybody else from joining.
        if let Some(free_bytes) = room::free_bytes().filter(|free| *free < JOIN_BYTES) {
            return Err(ChannelError::NoRoom { free_bytes });
        }
        let name = format!("{role}-{}-{}", self.fleet, std::process::id());
        let name = NodeName::new(&name).map_err(|e| failed(format!("{e:?}")))?;
        let node = NodeBuilder::new()
            .name(&name)
            .config(iceoryx)
            // Signals belong to the daemon.
            .signal_handling_mode(SignalHandlingMode::Disabled)
            .create::<ipc::Service>()
            .map_err(|e| failed(format!("{e:?}")))?;
        Ok(SharedNode { transport: self.clone(), node })
    }
}

/// Who is attached in shared memory.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Census {
    /// Nodes of processes that live.
    pub alive: u64,
    /// Nodes of processes that died and left their files.
    pub dead: u64,
    /// Nodes that cannot be examined: of another user, or damaged.
    pub unclear: u64,
}

/// A thread's membership in a fleet, of a process that lives.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub struct Member {
    /// Its process id.
    pub process: i32,
    /// File name of its program.
    pub executable: String,
    /// What it called itself when it attached.
    pub role: String,
}

/// What a clean-up after dead processes did.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct CleanUp {
    /// Nodes removed.
    pub removed: u64,
    /// Nodes that could not be removed.
    pub failed: u64,
}

/// Who is attached to a fleet's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Attached {
    /// Readers of `state`, the daemon's workers among them.
    pub state_readers: usize,
    /// Readers of `command`.
    pub command_readers: usize,
    /// Readers of `telemetry`.
    pub telemetry_readers: usize,
    /// Writers of `observation`.
    pub observation_writers: usize,
    /// Clients of `admin`.
    pub admin_clients: usize,
}

/// The service behind `admin`.
type Admin = AdminService<ipc::Service, [AdminRobot], AdminRequest, [u8], AdminAnswer>;

/// One thread's membership in shared memory.
#[derive(Debug)]
pub(super) struct SharedNode {
    transport: Transport,
    node: Node<ipc::Service>,
}

impl SharedNode {
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
    fn is_sound(&self) -> bool {
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

    /// Attaches to `admin` as the fleet's server, with room for `max_clients`. Makes the
    /// channel if it does not exist.
    ///
    /// # Errors
    /// [`ChannelError::Port`] when there is a server already, and the reasons for which the channel
    /// cannot be opened.
    pub(super) fn admin_server(&self, max_clients: usize) -> Result<AdminServer, ChannelError> {
        let service = self
            .node
            .service_builder(&self.admin_service_name()?)
            .request_response::<[AdminRobot], [u8]>()
            .request_user_header::<AdminRequest>()
            .response_user_header::<AdminAnswer>()
            .max_servers(1)
            .max_clients(max_clients.max(1))
            .max_nodes(MAX_NODES)
            .max_active_requests_per_client(admin::WAITING_MAX)
            .max_response_buffer_size(admin::BUFFERED)
            .max_borrowed_responses_per_pending_response(admin::BORROWED)
            // What nobody takes is the newest request, not an older one's place.
            .enable_safe_overflow_for_requests(false)
            .enable_safe_overflow_for_responses(false)
            .enable_fire_and_forget_requests(false)
            .open_or_create()
            .map_err(|e| match e {
                RequestResponseOpenOrCreateError::RequestResponseOpenError(e) => self.admin_open_error(e),
                other => self.admin_open_failure(&other),
            })?;
        let created = service
            .server_builder()
            .initial_max_slice_len(admin::TEXT_MAX)
            .max_loaned_responses_per_request(admin::LOANED)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .set_request_degradation_handler(self.transport.counting())
            .set_response_degradation_handler(self.transport.counting())
            .create();
        created.map(AdminServer::new).map_err(|e| self.admin_port_error(&e))
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

    /// Whether somebody who lives writes the fleet's state.
    pub(super) fn has_daemon(&self) -> bool {
        self.open::<RobotState>().is_ok_and(|service| self.owner_of(&service).is_some())
    }

    /// Attaches to `admin` as a client.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when the channel does not exist, and the reasons for which it cannot
    /// be opened.
    pub(super) fn admin(&self) -> Result<AdminPort, ChannelError> {
        let service = self.open_admin()?;
        let created = service
            .client_builder()
            // Most requests are about one robot; more memory is taken when one is about many.
            .initial_max_slice_len(16)
            .allocation_strategy(AllocationStrategy::PowerOfTwo)
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .create();
        created.map(AdminPort::new).map_err(|e| self.admin_port_error(&e))
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

    fn open_admin(&self) -> Result<Admin, ChannelError> {
        self.node
            .service_builder(&self.admin_service_name()?)
            .request_response::<[AdminRobot], [u8]>()
            .request_user_header::<AdminRequest>()
            .response_user_header::<AdminAnswer>()
            .open()
            .map_err(|e| self.admin_open_error(e))
    }

    fn admin_service_name(&self) -> Result<ServiceName, ChannelError> {
        let name = self.transport.admin_name();
        ServiceName::new(&name).map_err(|_| ChannelError::FleetName { name: self.transport.fleet.clone() })
    }

    fn admin_open_error(&self, error: RequestResponseOpenError) -> ChannelError {
        let service = self.transport.admin_name();
        match error {
            RequestResponseOpenError::DoesNotExist => ChannelError::NoDaemon { service },
            RequestResponseOpenError::IncompatibleRequestOrResponseType => ChannelError::Schema { service },
            other => self.admin_open_failure(&other),
        }
    }

    fn admin_open_failure(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Open { service: self.transport.admin_name(), reason: format!("{reason:?}") }
    }

    fn admin_port_error(&self, reason: &dyn Debug) -> ChannelError {
        ChannelError::Port { service: self.transport.admin_name(), reason: format!("{reason:?}") }
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
