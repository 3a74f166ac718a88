//! Shared memory and what is left in it.

use std::os::unix::fs::PermissionsExt;

use super::examination::Examination;
use super::finding::Finding;

pub(super) fn findings(e: &Examination) -> Vec<Finding> {
    let mut found = vec![mounted(e)];
    found.extend(room(e));
    found.push(directory(e));
    found.extend(left_over(e));
    found
}

fn mounted(e: &Examination) -> Finding {
    const NAME: &str = "shared_memory";
    let Some(mounts) = e.host.read("/proc/mounts") else { return Finding::unknown(NAME, "/proc/mounts") };
    // A later mount covers an earlier one.
    let mount = mounts.lines().rev().find_map(|line| {
        let mut words = line.split_whitespace().skip(1);
        (words.next()? == "/dev/shm").then_some(())?;
        Some((words.next()?.to_owned(), words.next()?.to_owned()))
    });
    match mount {
        Some((kind, options)) if kind == "tmpfs" && !options.split(',').any(|option| option == "ro") => {
            Finding::ok(NAME, "tmpfs, writable")
        }
        found => Finding::fail(
            NAME,
            found.map_or("/dev/shm is not mounted".to_owned(), |(kind, options)| {
                format!("/dev/shm is {kind} ({options})")
            }),
            "The channels live in /dev/shm.",
            "mount -t tmpfs -o rw,mode=1777 tmpfs /dev/shm",
        ),
    }
}

fn room(e: &Examination) -> Option<Finding> {
    const NAME: &str = "shared_memory_room";
    const MIB: u64 = 1 << 20;
    let (free, all) = e.live.as_ref()?.shared_memory?;
    let needed = e.needed_bytes?;
    let (free_mib, needed_mib) = (free / MIB, needed.div_ceil(MIB));
    let value = format!("{free_mib} MiB free; {} robots need up to {needed_mib} MiB", e.robots);
    let remedy = format!(
        "mount -o remount,size={}M /dev/shm (container: --shm-size={}m), or lower channel.max_readers or \
         channel.depth",
        all / MIB + needed_mib * 2,
        all / MIB + needed_mib * 2
    );
    Some(if free < needed {
        Finding::fail(NAME, value, "The daemon refuses to start without room for its channels.", remedy)
    } else if free < 2 * needed {
        Finding::warn(NAME, value, "A second fleet or a recorder may not find room beside it.", remedy)
    } else {
        Finding::ok(NAME, value)
    })
}

fn directory(e: &Examination) -> Finding {
    const NAME: &str = "channel_directory";
    let root = e.channel.root.to_string_lossy().into_owned();
    let usable = |path: &std::path::Path| {
        let metadata = std::fs::metadata(path).ok()?;
        // The access bits, not the caller's identity: root may write anywhere, its clients may not.
        Some(metadata.is_dir() && metadata.permissions().mode() & 0o222 != 0)
    };
    let path = e.host.path(&root);
    let parent = path.parent().map_or_else(|| path.clone(), std::path::Path::to_owned);
    match usable(&path).or_else(|| usable(&parent)) {
        Some(true) => Finding::ok(NAME, root),
        _ => Finding::fail(
            NAME,
            format!("{root} can neither be used nor made"),
            "Every process that attaches keeps a small file there.",
            format!("mkdir -p {root}, owned by the user that runs the daemon; or set channel.root"),
        ),
    }
}

fn left_over(e: &Examination) -> Option<Finding> {
    const NAME: &str = "left_over_nodes";
    Some(match &e.live.as_ref()?.census {
        Ok(census) if census.dead + census.unclear == 0 => {
            Finding::ok(NAME, format!("none; {} attached", census.alive))
        }
        Ok(census) if census.dead > 0 => Finding::warn(
            NAME,
            format!("{} of processes that died; {} attached", census.dead, census.alive),
            "They keep shared memory and places in the channels.",
            "nothing, as a rule: the next process that attaches removes them, and a running daemon does once \
             a second; until then `clearwayd --ticks 1` will do",
        ),
        Ok(census) => Finding::warn(
            NAME,
            format!("{} that cannot be examined; {} attached", census.unclear, census.alive),
            "They belong to another user, or are damaged, and may hold a fleet's channels.",
            format!("run as the user that owns the files {}* in /dev/shm", e.channel.prefix),
        ),
        Err(reason) => {
            Finding { value: reason.clone(), ..Finding::unknown(NAME, &e.channel.root.to_string_lossy()) }
        }
    })
}
