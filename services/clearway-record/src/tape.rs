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
    /// Where the file is until it takes the place of an older one.
    aside: Option<PathBuf>,
    file: File,
    pending: Pending,
    written: u64,
    reserved: u64,
}

impl Tape {
    /// Makes the file. One that exists is refused unless it is empty or may be overwritten; that one stays
    /// until [`take_place`](Self::take_place).
    pub(crate) fn create(path: &Path, overwrite: bool) -> io::Result<Self> {
        let old = std::fs::metadata(path).ok().filter(std::fs::Metadata::is_file);
        let full = old.as_ref().is_some_and(|about| about.len() > 0);
        let aside = (overwrite && full).then(|| beside(path));
        let mut options = File::options();
        options.read(true).write(true);
        if overwrite || old.is_some() && !full {
            options.create(true).truncate(true);
        } else {
            options.create_new(true);
        }
        let file = options.open(aside.as_deref().unwrap_or(path))?;
        let (path, pending) = (path.to_owned(), Pending::default());
        Ok(Self { path, aside, file, pending, written: 0, reserved: 0 })
    }

    /// There is something to keep: what was there before under this name is replaced.
    pub(crate) fn take_place(&mut self) -> io::Result<()> {
        if let Some(aside) = &self.aside {
            std::fs::rename(aside, &self.path)?;
            self.aside = None;
        }
        Ok(())
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

    /// Gives back what was reserved and not used, and waits until the disk has the rest. A file that never
    /// took its place goes; whether it is there.
    pub(crate) fn close(self) -> io::Result<bool> {
        if let Some(aside) = &self.aside {
            return std::fs::remove_file(aside).map(|()| false);
        }
        if self.reserved > self.written {
            let hole = FallocateFlags::PUNCH_HOLE | FallocateFlags::KEEP_SIZE;
            let _ = fallocate(&self.file, hole, self.written, self.reserved - self.written);
        }
        self.file.set_len(self.written)?;
        self.file.sync_data().map(|()| true)
    }
}

/// Where a file grows that is to replace `path`.
fn beside(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".part");
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_older_file_is_replaced_when_there_is_something_to_keep() {
        let folder = std::env::temp_dir().join(format!("clearway_tape_{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let path = folder.join("run.mcap");
        std::fs::write(&path, "old").unwrap();
        assert!(Tape::create(&path, false).is_err());
        let written = |tape: &mut Tape| {
            tape.pending().write_all(b"new").unwrap();
            tape.commit().unwrap();
            std::fs::read(&path).unwrap()
        };
        let mut tape = Tape::create(&path, true).unwrap();
        assert_eq!(written(&mut tape), b"old");
        assert!(!tape.close().unwrap());
        assert_eq!((std::fs::read(&path).unwrap(), beside(&path).exists()), (b"old".to_vec(), false));
        let mut tape = Tape::create(&path, true).unwrap();
        tape.take_place().unwrap();
        assert_eq!(written(&mut tape), b"new");
        assert!(tape.close().unwrap() && !beside(&path).exists());
        // An empty one is nobody's.
        std::fs::write(&path, "").unwrap();
        let mut tape = Tape::create(&path, false).unwrap();
        assert_eq!(written(&mut tape), b"new");
        std::fs::remove_dir_all(&folder).unwrap();
    }
}
