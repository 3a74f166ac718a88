use std::sync::Arc;

use super::memory::{LocalWriter, Memory};
use super::node::SharedNode;
use super::{AdminPort, AdminServer, Attached, ChannelError, CleanUp, Reader, Record, Transport, Writer};
use crate::config::ChannelConfig;
use crate::wire::RobotObservation;

/// One thread's membership in a fleet.
#[derive(Debug)]
pub struct Attachment {
    place: Place,
}

#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one a thread, made at its start")]
enum Place {
    Shared(SharedNode),
    /// Inside this process.
    Local {
        memory: Arc<Memory>,
        fleet: String,
        settings: ChannelConfig,
    },
}

impl Attachment {
    pub(super) fn shared(node: SharedNode) -> Self {
        Self { place: Place::Shared(node) }
    }

    pub(super) fn local(memory: Arc<Memory>, transport: &Transport) -> Self {
        let (fleet, settings) = (transport.fleet().to_owned(), transport.settings.clone());
        Self { place: Place::Local { memory, fleet, settings } }
    }

    /// Attaches to a channel as a writer of samples with `robots` records, and makes the channel if
    /// it does not exist.
    ///
    /// # Errors
    /// [`ChannelError::Owned`] when the channel's only writer is somebody else, and the reasons for
    /// which a channel cannot be opened.
    pub fn writer<R: Record>(&self, robots: usize) -> Result<Writer<R>, ChannelError> {
        let (memory, fleet, settings) = match &self.place {
            Place::Shared(node) => return node.writer(robots),
            Place::Local { memory, fleet, settings } => (memory, fleet, settings),
        };
        if !R::topic(memory).join(R::CHANNEL.max_writers(settings)) {
            return Err(ChannelError::Owned { fleet: fleet.clone(), owner: None });
        }
        Ok(Writer::local(LocalWriter::new(memory, robots), R::CHANNEL.seal(fleet)))
    }

    /// Attaches to a channel that exists.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when it does not, and the reasons for which it cannot be opened.
    pub fn reader<R: Record>(&self) -> Result<Reader<R>, ChannelError> {
        match &self.place {
            Place::Shared(node) => node.reader(),
            Place::Local { memory, fleet, .. } => {
                Ok(Reader::local(R::topic(memory).subscribe(), R::CHANNEL.seal(fleet)))
            }
        }
    }

    /// Attaches to a channel, and makes it if it does not exist.
    ///
    /// # Errors
    /// The reasons for which it cannot be opened.
    pub fn reader_or_create<R: Record>(&self, robots: usize) -> Result<Reader<R>, ChannelError> {
        match &self.place {
            Place::Shared(node) => node.reader_or_create(robots),
            Place::Local { .. } => self.reader(),
        }
    }

    /// Removes what processes that died left behind: 0.1 ms when there is nothing, about 1 ms for
    /// each. Not for real-time threads.
    pub fn clean_up(&self) -> CleanUp {
        match &self.place {
            Place::Shared(node) => node.clean_up(),
            Place::Local { .. } => CleanUp::default(),
        }
    }

    /// Attaches to `admin` as the fleet's server, with room for `max_clients`. Makes the
    /// channel if it does not exist.
    ///
    /// # Errors
    /// [`ChannelError::Port`] when there is a server already, and the reasons for which the channel
    /// cannot be opened.
    pub fn admin_server(&self, max_clients: usize) -> Result<AdminServer, ChannelError> {
        match &self.place {
            Place::Shared(node) => node.admin_server(max_clients),
            Place::Local { memory, .. } => Ok(AdminServer::local(Arc::clone(memory))),
        }
    }

    /// Attaches to `observation` as one more writer, of samples with `robots` records. The channel has to
    /// exist: the daemon makes it when it listens.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when it does not, and the reasons for which it cannot be opened.
    pub fn observer(&self, robots: usize) -> Result<Writer<RobotObservation>, ChannelError> {
        match &self.place {
            Place::Shared(node) => node.observer(robots),
            Place::Local { .. } => self.writer(robots),
        }
    }

    /// Whether somebody who lives writes the fleet's state.
    pub fn has_daemon(&self) -> bool {
        match &self.place {
            Place::Shared(node) => node.has_daemon(),
            Place::Local { memory, .. } => memory.has_daemon(),
        }
    }

    /// Attaches to `admin` as a client.
    ///
    /// # Errors
    /// [`ChannelError::NoDaemon`] when the channel does not exist, and the reasons for which it cannot
    /// be opened.
    pub fn admin(&self) -> Result<AdminPort, ChannelError> {
        match &self.place {
            Place::Shared(node) => node.admin(),
            Place::Local { memory, .. } => Ok(AdminPort::local(Arc::clone(memory))),
        }
    }

    /// Times that somebody who joined could not be connected, for all threads of this process: see
    /// [`Transport::attach_failures`].
    pub fn attach_failures(&self) -> u64 {
        match &self.place {
            Place::Shared(node) => node.attach_failures(),
            Place::Local { .. } => 0,
        }
    }

    /// Who is attached now; 0 where a channel does not exist.
    pub fn attached(&self) -> Attached {
        match &self.place {
            Place::Shared(node) => node.attached(),
            Place::Local { memory, .. } => memory.attached(),
        }
    }
}
