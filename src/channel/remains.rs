//! What a process leaves that was killed while it joined: iceoryx2 neither finds nor removes it.

use std::collections::BTreeSet;
use std::fs;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::prelude::Config;

use super::owned::{Owned, entries, file_name, tail};

/// Files that iceoryx2 is still writing; it never shows them to anybody. What they would announce is
/// made after them, so it does not exist yet.
const UNFINISHED: u32 = 0o600;
/// Far longer than joining takes, between a node's folder and the entry that shows it.
const JOINING: Duration = Duration::from_secs(10);

fn folder(iceoryx: &Config) -> PathBuf {
    PathBuf::from(iceoryx.global.node_dir().to_string())
}

/// Removes what a dead node was writing when its process was killed. Its folder is not empty
/// otherwise when iceoryx2 removes it, which makes iceoryx2 stop halfway, for good.
pub(super) fn remove_unfinished(iceoryx: &Config, node: u128) {
    let prefix = iceoryx.global.prefix.to_string();
    let Ok(entries) = fs::read_dir(folder(iceoryx).join(node.to_string())) else { return };
    for entry in entries.flatten() {
        let ours = entry.file_name().to_string_lossy().starts_with(&prefix);
        let unfinished = entry
            .metadata()
            .is_ok_and(|found| found.is_file() && found.permissions().mode() & 0o777 == UNFINISHED);
        if ours && unfinished {
            // Somebody else may clean up too; what cannot be removed shows as a failed clean-up.
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Removes what nodes left that had made their folder and were not seen by anybody yet: neither in
/// `known`, nor of a process that lives, nor young. Returns how many.
pub(super) fn remove_unborn(iceoryx: &Config, known: &BTreeSet<u128>) -> u64 {
    let Ok(entries) = fs::read_dir(folder(iceoryx)) else { return 0 };
    let mut removed = 0;
    for entry in entries.flatten() {
        let Some(node) = entry.file_name().to_str().and_then(|name| name.parse::<u128>().ok()) else {
            continue;
        };
        let abandoned = !known.contains(&node) && !is_alive(node) && is_old(&entry.path());
        if abandoned && remove_node(iceoryx, node, &entry.path()) {
            removed += 1;
        }
    }
    removed
}

/// The files of a node, of our prefix only, and its folder, which stays if it holds anything else.
fn remove_node(iceoryx: &Config, node: u128, path: &Path) -> bool {
    let prefix = iceoryx.global.prefix.to_string();
    let monitor = format!("{prefix}{node}{}", iceoryx.global.node.monitor_suffix);
    let Ok(inside) = fs::read_dir(path) else { return false };
    let inside: Vec<PathBuf> = inside.flatten().map(|entry| entry.path()).collect();
    let ours =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(&prefix));
    if !inside.iter().all(ours) {
        return false;
    }
    for path in inside {
        let _ = fs::remove_file(path);
    }
    for suffix in ["", "_context", "_owner_lock"] {
        let _ = fs::remove_file(folder(iceoryx).join(format!("{monitor}{suffix}")));
    }
    fs::remove_dir(path).is_ok()
}

/// Removes every file of ours: below the root, and in shared memory what `owned` knows. Nothing when a process
/// lives that made one of them, or somebody `lives` who is listed. Returns how many.
pub(super) fn remove_all(iceoryx: &Config, owned: &Owned, lives: impl Fn() -> bool) -> usize {
    let nodes = folder(iceoryx);
    let ours = |path: &PathBuf| tail(iceoryx, &file_name(path)).is_some();
    // In this order: what somebody makes who joins from now on is not in these lists.
    let services = PathBuf::from(iceoryx.global.service_dir().to_string());
    let mut files: Vec<PathBuf> =
        [&services, &nodes].into_iter().flat_map(|at| entries(at)).filter(ours).collect();
    let found = owned.found();
    files.extend(found.ours);
    // Somebody else may be using it.
    files.extend(found.common.into_iter().filter(|_| found.others == 0));
    let mut folders = Vec::new();
    for node in entries(&nodes) {
        let inside = entries(&node);
        let Ok(id) = file_name(&node).parse::<u128>() else { continue };
        if !inside.is_empty() && !inside.iter().any(ours) {
            continue;
        }
        if is_alive(id) {
            return 0;
        }
        files.extend(inside.into_iter().filter(ours));
        folders.push(node);
    }
    // Processes cannot be seen from every container; the locks of those who are listed can.
    if lives() {
        return 0;
    }
    let removed = files.iter().filter(|file| fs::remove_file(file).is_ok()).count();
    // One that still holds anything stays.
    for folder in &folders {
        _ = fs::remove_dir(folder);
    }
    removed
}

fn is_old(path: &Path) -> bool {
    let modified = fs::metadata(path).and_then(|found| found.modified());
    modified.is_ok_and(|time| time.elapsed().is_ok_and(|age| age >= JOINING))
}

/// Whether the process lives that made a node: the id holds its process id, above the time.
fn is_alive(node: u128) -> bool {
    let process = (node >> 64) & u128::from(u32::MAX);
    Path::new("/proc").join(process.to_string()).exists()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::Transport;
    use crate::channel::room::SHARED_MEMORY;
    use crate::config::ChannelConfig;

    fn transport(name: &str) -> (ChannelConfig, Transport) {
        let unique = format!("{name}_{}", std::process::id());
        let root = std::env::temp_dir().join(format!("clearway_{unique}"));
        let settings = ChannelConfig { prefix: format!("cw_{unique}_"), root, ..ChannelConfig::default() };
        let transport = Transport::new("default", &settings).unwrap();
        (settings, transport)
    }

    fn write(path: &Path, mode: u32, old: bool) {
        fs::write(path, "x").unwrap();
        fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
        if old {
            age(path.parent().unwrap());
        }
    }

    fn age(path: &Path) {
        let before = std::time::SystemTime::now() - 2 * JOINING;
        fs::File::open(path).unwrap().set_modified(before).unwrap();
    }

    /// An id that a process would have.
    fn id(process: u32, number: u128) -> u128 {
        (u128::from(process) << 64) | number
    }

    #[test]
    fn only_what_dead_processes_left_unfinished_goes() {
        let (settings, transport) = transport("remains");
        let node = transport.attach("test").unwrap();
        let nodes = settings.root.join("nodes");
        let alive = fs::read_dir(&nodes).unwrap().flatten().find(|e| e.path().is_dir()).unwrap();
        // The bits are where this module looks for them.
        let own: u128 = alive.file_name().to_str().unwrap().parse().unwrap();
        assert_eq!((own >> 64) & u128::from(u32::MAX), u128::from(std::process::id()));

        // No process has an id this large.
        let (dead, me) = (u32::MAX, std::process::id());
        let make = |node: u128, name: &str, old: bool| {
            let folder = nodes.join(node.to_string());
            fs::create_dir(&folder).unwrap();
            write(&folder.join(name), 0o600, old);
            folder
        };
        let ours = format!("{}node.details", settings.prefix);
        let gone = make(id(dead, 1), &ours, true);
        let monitor = nodes.join(format!("{}{}.node_monitor_context", settings.prefix, id(dead, 1)));
        write(&monitor, 0o200, false);
        let kept = [
            make(id(dead, 2), &ours, false),
            make(id(me, 3), &ours, true),
            make(id(dead, 4), "of_somebody_else", true),
        ];
        assert_eq!(node.clean_up().removed, 1);
        assert!(!gone.exists() && !monitor.exists());
        assert!(kept.iter().all(|folder| fs::read_dir(folder).unwrap().count() == 1));
        age(&alive.path());
        assert_eq!(node.clean_up().removed, 0);
        assert_eq!(transport.census().unwrap().alive, 1);
        drop(node);
        fs::remove_dir_all(&settings.root).unwrap();
        for entry in fs::read_dir("/dev/shm").unwrap().flatten() {
            if entry.file_name().to_string_lossy().starts_with(&settings.prefix) {
                fs::remove_file(entry.path()).unwrap();
            }
        }
    }

    #[test]
    fn everything_goes_when_nobody_lives_and_nothing_before() {
        let (settings, transport) = transport("everything");
        let node = transport.attach("test").unwrap();
        let states = node.writer::<crate::wire::RobotState>(2).unwrap();
        let (nodes, dead) = (settings.root.join("nodes"), id(u32::MAX, 1));
        fs::create_dir_all(nodes.join(dead.to_string())).unwrap();
        let ours = nodes.join(dead.to_string()).join(format!("{}node.details", settings.prefix));
        write(&ours, 0o600, false);
        let port = id(u32::MAX, 3);
        let tag = format!("{}{port}.port_tag", settings.prefix);
        write(&nodes.join(dead.to_string()).join(tag), 0o400, false);
        let shared = |prefix: &str, port: u128| {
            let path = Path::new(SHARED_MEMORY).join(format!("{prefix}{}_{port}.data", "0a".repeat(20)));
            write(&path, 0o600, false);
            path
        };
        // Of the dead node, of somebody with another root, and of another prefix.
        let left = shared(&settings.prefix, port);
        let strangers =
            [shared(&settings.prefix, id(u32::MAX, 4)), shared(&format!("{}b_", settings.prefix), port)];
        let removed = |lives: bool| {
            let owned = Owned::listed(&transport.iceoryx);
            remove_all(&transport.iceoryx, &owned, || lives)
        };
        assert_eq!(removed(false), 0);
        assert!(ours.exists() && left.exists());

        // The same files as if another process had made them, which is no more.
        let alive = fs::read_dir(&nodes)
            .unwrap()
            .flatten()
            .find(|e| e.file_name().to_str().and_then(|name| name.parse().ok()).is_some_and(is_alive));
        let foreign = settings.root.join("foreign");
        write(&foreign, 0o600, false);
        fs::rename(alive.unwrap().path(), nodes.join(id(u32::MAX, 2).to_string())).unwrap();
        // As far as this process can see; a lock says otherwise.
        assert_eq!(removed(true), 0);
        assert!(ours.exists() && left.exists());
        let common = || Owned::listed(&transport.iceoryx).found().common;
        assert!(removed(false) > 5);
        assert!(!ours.exists() && !left.exists() && foreign.exists());
        assert_eq!(fs::read_dir(&nodes).unwrap().count(), 0);
        assert!(strangers.iter().all(|path| path.exists()) && common().len() == 1);
        assert_eq!(removed(false), 0);
        // What is common to a prefix goes when nobody else uses the prefix.
        for path in &strangers {
            fs::remove_file(path).unwrap();
        }
        assert_eq!((removed(false), common().len()), (1, 0));
        std::mem::forget((states, node));
        fs::remove_dir_all(&settings.root).unwrap();
    }

    #[test]
    fn a_dead_nodes_unfinished_files_go_and_its_others_stay_for_iceoryx() {
        let (settings, transport) = transport("unfinished");
        let folder = settings.root.join("nodes").join("7");
        fs::create_dir_all(&folder).unwrap();
        let name = |what: &str| folder.join(format!("{}{what}", settings.prefix));
        write(&name("5.port_tag"), 0o600, false);
        write(&name("6.port_tag"), 0o400, false);
        write(&folder.join("foreign"), 0o600, false);
        remove_unfinished(&transport.iceoryx, 7);
        assert!(!name("5.port_tag").exists());
        assert!(name("6.port_tag").exists() && folder.join("foreign").exists());
        fs::remove_dir_all(&settings.root).unwrap();
    }
}
