//! Who is attached.

use iceoryx2::node::NodeView;
use iceoryx2::prelude::*;

use super::{ChannelError, Transport};

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

impl Transport {
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
}
