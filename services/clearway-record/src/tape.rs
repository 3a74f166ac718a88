//! A file that grows by whole pieces, with room set aside for its end.
//!
//! What is written is collected in memory and reaches the file in one call, so that a process that is
//! killed leaves whole pieces behind. Room is reserved ahead of each piece: when the disk is full, that
//! is known before anything is lost, and what closes the file still fits.

use rustix::fs::{FallocateFlags, fallocate, fstatvfs};
use rustix::io::Errno;
use std::cell::RefCell;
use std::fs::File;
use std::io::{self, Write};
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::rc::Rc;

/// What is reserved at a time beyond what is asked for.
const STEP_BYTES: u64 = 1 << 20;

/// The side that the MCAP writer sees: bytes on their way to the file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Pending(Rc<RefCell<Vec<u8>>>);

impl Write for Pending {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.borrow_mut().extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

/// A file and what is on its way to it.
#[derive(Debug)]
pub(crate) struct Tape {
    path: PathBuf,
    file: File,
    pending: Pending,
    written: u64,
    reserved: u64,
}

impl Tape {
    /// Makes the file. One that exists is refused unless it is empty or may be overwritten.
    pub(crate) fn create(path: &Path, overwrite: bool) -> io::Result<Self> {
        let empty = || std::fs::metadata(path).is_ok_and(|about| about.is_file() && about.len() == 0);
        let mut options = File::options();
        options.read(true).write(true);
        if overwrite || empty() {
            options.create(true).truncate(true);
        } else {
            options.create_new(true);
        }
        let file = options.open(path)?;
        Ok(Self { path: path.to_owned(), file, pending: Pending::default(), written: 0, reserved: 0 })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Where an MCAP writer writes to.
    pub(crate) fn pending(&self) -> Pending {
        self.pending.clone()
    }

    /// Bytes in the file, those on their way included.
    pub(crate) fn len(&self) -> u64 {
        self.written + self.pending.0.borrow().len() as u64
    }

    /// Makes sure that the file can grow by `ahead` bytes, whatever others write to the disk.
    pub(crate) fn reserve(&mut self, ahead: u64) -> io::Result<()> {
        let end = self.len() + ahead;
        if end <= self.reserved {
            return Ok(());
        }
        // In large steps, so that it is not done for every message; the last bit of a disk by itself.
        let reserve =
            |to| fallocate(&self.file, FallocateFlags::KEEP_SIZE, self.reserved, to - self.reserved);
        self.reserved = match reserve(end + STEP_BYTES)
            .map(|()| end + STEP_BYTES)
            .or_else(|_| reserve(end).map(|()| end))
        {
            Ok(reserved) => reserved,
            // A file system that reserves nothing can at least be asked.
            Err(Errno::OPNOTSUPP | Errno::NOSYS) => {
                let free =
                    fstatvfs(&self.file).map_or(u64::MAX, |fs| fs.f_bavail.saturating_mul(fs.f_frsize));
                if free < end - self.written {
                    return Err(Errno::NOSPC.into());
                }
                return Ok(());
            }
            Err(e) => return Err(e.into()),
        };
        Ok(())
    }

    /// Writes what is pending. When that fails the file ends where it ended before.
    pub(crate) fn commit(&mut self) -> io::Result<()> {
        let mut pending = self.pending.0.borrow_mut();
        if pending.is_empty() {
            return Ok(());
        }
        if let Err(e) = self.file.write_all_at(&pending, self.written) {
            let _ = self.file.set_len(self.written);
            return Err(e);
        }
        self.written += pending.len() as u64;
        pending.clear();
        Ok(())
    }

    /// Gives back what was reserved and not used, and waits until the disk has the rest.
    pub(crate) fn close(self) -> io::Result<()> {
        if self.reserved > self.written {
            let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
            let _ = fallocate(&self.file, hole, self.written, self.reserved - self.written);
        }
        self.file.set_len(self.written)?;
        self.file.sync_data()
    }
}
