use std::fmt::Debug;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use iceoryx2::port::{DegradationAction, DegradationFn};
use iceoryx2::prelude::*;

use super::memory::Memory;
use super::node::SharedNode;
use super::{Attachment, Channel, ChannelError, admin, room};
use crate::config::{ChannelConfig, is_fleet_name};

/// What one more process takes to join: its node, its ports, and the writers' connections to them.
const JOIN_BYTES: u64 = 128 << 10;

/// Where the channels of one fleet are.
#[derive(Debug, Clone)]
pub struct Transport {
    pub(super) fleet: String,
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
    pub(super) fn counting(&self) -> impl DegradationFn + 'static {
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

    pub(super) fn join(&self, role: &str, iceoryx: &Config) -> Result<SharedNode, ChannelError> {
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
        Ok(SharedNode::new(self.clone(), node))
    }
}
