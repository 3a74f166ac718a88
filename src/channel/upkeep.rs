//! Room for the channels, and channels that are damaged: what the daemon looks at before it starts.

use std::time::Duration;

use rustix::io::Errno;

use super::node::{MAX_HELD, MAX_LOANED};
use super::owned::Owned;
use super::{ChannelError, Record, Transport, admin, remains, room};
use crate::wire::{RobotCheckpoint, RobotCommand, RobotState, RobotTelemetry};

/// What iceoryx2 adds to a sample.
const SAMPLE_OVERHEAD_BYTES: usize = 64;
/// What services, nodes and connections take besides the samples.
const MANAGEMENT_BYTES: usize = 2 << 20;

/// How often the daemon looks for a moment in which it can mend its channels, and for room.
const LOOKS: u32 = 50;
const LOOK_EVERY: Duration = Duration::from_millis(7);

pub(super) fn sample_bytes<R: Record>(robots: usize) -> usize {
    robots * size_of::<R>() + size_of::<R::Header>()
}

impl Transport {
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
    pub(super) fn reserve_or(&self, full: impl FnOnce(u64) -> ChannelError) -> Result<(), ChannelError> {
        room::reserve(&Owned::listed(&self.iceoryx).found().ours).map_err(|e| match e {
            Errno::NOSPC => full(room::free_bytes().unwrap_or(0)),
            other => ChannelError::NotReserved { reason: other.to_string() },
        })
    }

    /// What the writer of a channel sets aside for its samples.
    fn bytes<R: Record>(&self, robots: usize) -> usize {
        let sample = sample_bytes::<R>(robots);
        let depth = R::CHANNEL.depth(&self.settings, sample);
        (R::CHANNEL.max_readers(&self.settings) * (depth + MAX_HELD) + MAX_LOANED + 1)
            * (sample + SAMPLE_OVERHEAD_BYTES)
    }
}
