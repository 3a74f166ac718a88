//! Which files in shared memory belong to the services and nodes that are listed under a root.
//!
//! iceoryx2 names them by a prefix, which others may use under a root of their own, and by ids that nobody
//! else has.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

use iceoryx2::prelude::Config;

use super::room::SHARED_MEMORY;

/// Hexadecimal digits of a hash in a name.
const HASH_DIGITS: usize = 40;
/// Decimal digits that an id has at least: a process id stands above 64 bits of time.
const ID_DIGITS: usize = 20;

/// The ids of services, and of ports of nodes, that are or were listed under a root.
#[derive(Debug)]
pub(super) struct Owned<'a> {
    iceoryx: &'a Config,
    ids: BTreeSet<u128>,
}

/// What of a prefix is in shared memory.
#[derive(Debug, Default)]
pub(super) struct Found {
    /// Files of the listed.
    pub(super) ours: Vec<PathBuf>,
    /// What iceoryx2 keeps once for everybody of a prefix, whatever the root.
    pub(super) common: Vec<PathBuf>,
    /// How many files are of somebody else.
    pub(super) others: usize,
}

impl<'a> Owned<'a> {
    /// Those that are listed now.
    pub(super) fn listed(iceoryx: &'a Config) -> Self {
        let mut owned = Self { iceoryx, ids: BTreeSet::new() };
        owned.look();
        owned
    }

    /// Adds those that are listed now. Those that were stay: a clean-up that fails halfway takes them off the
    /// list and leaves their files.
    pub(super) fn look(&mut self) {
        let global = &self.iceoryx.global;
        let tag = global.node.port_tag_suffix.to_string();
        let ids = &mut self.ids;
        for entry in entries(Path::new(&global.node_dir().to_string())).iter().flat_map(|node| entries(node))
        {
            let name = file_name(&entry);
            let port =
                tail(self.iceoryx, &name).and_then(|tail| tail.strip_suffix(&tag)?.parse::<u128>().ok());
            ids.extend(port);
        }
        for entry in entries(Path::new(&global.service_dir().to_string())) {
            if tail(self.iceoryx, &file_name(&entry)).is_some()
                && let Ok(text) = fs::read_to_string(&entry)
            {
                ids.extend(service_id(&text));
            }
        }
    }

    /// What is in shared memory.
    pub(super) fn found(&self) -> Found {
        let mut found = Found::default();
        for path in entries(Path::new(SHARED_MEMORY)) {
            let name = file_name(&path);
            let Some((hash, rest)) = tail(self.iceoryx, &name).and_then(|tail| tail.split_once('_')) else {
                continue;
            };
            let stem = rest.split('.').next().unwrap_or_default();
            if !is_hash(hash) {
                found.others += 1;
            } else if name.ends_with(&self.iceoryx.global.node.global_mgmt_suffix.to_string()) {
                found.common.push(path);
            } else if stem.split('_').any(|id| id.parse::<u128>().is_ok_and(|id| self.ids.contains(&id))) {
                found.ours.push(path);
            } else {
                found.others += 1;
            }
        }
        found
    }

    /// Whether a file has no length that everybody waits for: it is being made, or was truncated.
    pub(super) fn has_empty(&self) -> bool {
        let Found { ours, common, .. } = self.found();
        let empty = |path: &PathBuf| path.metadata().is_ok_and(|found| found.is_file() && found.len() == 0);
        ours.iter().chain(&common).any(empty)
    }
}

/// What stands behind the prefix, in names that iceoryx2 gives: a longer prefix begins the same way.
pub(super) fn tail<'n>(iceoryx: &Config, name: &'n str) -> Option<&'n str> {
    let prefix = iceoryx.global.prefix.to_string();
    let tail = name.strip_prefix(&prefix)?;
    let first = tail.split(['_', '.']).next()?;
    let id = first.len() >= ID_DIGITS && first.bytes().all(|byte| byte.is_ascii_digit());
    (id || is_hash(first) || first == "node").then_some(tail)
}

fn is_hash(text: &str) -> bool {
    text.len() == HASH_DIGITS && text.bytes().all(|byte| byte.is_ascii_hexdigit())
}

/// The id in the description of a service.
fn service_id(text: &str) -> Option<u128> {
    let value = |key: &str| -> Option<u128> {
        let line = text.lines().find_map(|line| line.trim().strip_prefix(key))?;
        line.trim().strip_prefix('=')?.trim().parse().ok()
    };
    Some(value("unique_value")? << 64 | value("payload_value")?)
}

pub(super) fn entries(folder: &Path) -> Vec<PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path()).collect()
}

pub(super) fn file_name(path: &Path) -> String {
    path.file_name().map_or_else(String::new, |name| name.to_string_lossy().into_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::Transport;
    use crate::config::ChannelConfig;
    use crate::wire::{RobotCommand, RobotState};

    #[test]
    fn every_file_of_a_fleet_is_its_own_and_those_of_another_root_or_prefix_are_not() {
        let unique = format!("owned_{}", std::process::id());
        let root = |name: &str| std::env::temp_dir().join(format!("clearway_{unique}_{name}"));
        let prefix = format!("cw_{unique}_");
        let fleets = [("here", prefix.clone()), ("there", prefix.clone()), ("longer", format!("{prefix}b_"))]
            .map(|(name, prefix)| {
                let settings = ChannelConfig { prefix, root: root(name), ..ChannelConfig::default() };
                let transport = Transport::new(name, &settings).unwrap();
                let node = transport.attach("test").unwrap();
                let ports = (node.writer::<RobotState>(2).unwrap(), node.writer::<RobotCommand>(2).unwrap());
                let reader = node.reader::<RobotState>().unwrap();
                ports.0.connect().unwrap();
                (transport, (ports, reader, node))
            });
        let found = fleets.each_ref().map(|(transport, _)| Owned::listed(&transport.iceoryx).found());
        for (own, other) in [(0, 1), (1, 0)] {
            let Found { ours, common, others } = &found[own];
            // Two services, the samples of two writers, and a queue.
            assert_eq!((ours.len(), common.len(), *others), (5, 1, 5), "{ours:?}");
            assert!(ours.iter().all(|path| !found[other].ours.contains(path)));
        }
        assert_eq!((found[2].ours.len(), found[2].common.len(), found[2].others), (5, 1, 0));
        drop(fleets);
        for found in found {
            assert!(found.ours.iter().all(|path| !path.exists()));
            found.common.iter().for_each(|path| _ = fs::remove_file(path));
        }
        for name in ["here", "there", "longer"] {
            fs::remove_dir_all(root(name)).unwrap();
        }
    }
}
