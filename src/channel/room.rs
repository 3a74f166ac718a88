//! Shared memory as a file system that can fill up.

use std::path::PathBuf;

use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate, fstat, open, statvfs};
use rustix::io::{Errno, retry_on_intr};

/// Where the kernel keeps shared memory.
pub(super) const SHARED_MEMORY: &str = "/dev/shm";

/// What is free, bytes; `None` when the file system cannot be asked.
pub(super) fn free_bytes() -> Option<u64> {
    statvfs(SHARED_MEMORY).ok().map(|shared| shared.f_bavail.saturating_mul(shared.f_frsize))
}

/// Takes the memory of `files`, down to their last pages. Those that have just gone or cannot be written, which
/// are another user's, are left as they are.
///
/// # Errors
/// [`Errno::NOSPC`] when there is less than what they promise, and whatever else keeps it from being taken.
pub(super) fn reserve(files: &[PathBuf]) -> Result<(), Errno> {
    for path in files {
        let file = match retry_on_intr(|| open(path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty())) {
            Ok(file) => file,
            Err(Errno::NOENT | Errno::ACCESS | Errno::PERM) => continue,
            Err(e) => return Err(e),
        };
        let length = fstat(&file)?.st_size.unsigned_abs();
        if length > 0 {
            taken(retry_on_intr(|| fallocate(&file, FallocateFlags::KEEP_SIZE, 0, length)))?;
        }
    }
    Ok(())
}

/// Where memory cannot be taken ahead, it is taken at its first use; every other failure is one.
fn taken(result: Result<(), Errno>) -> Result<(), Errno> {
    match result {
        Err(Errno::OPNOTSUPP | Errno::NOSYS) => Ok(()),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_its_memory_before_anybody_uses_it() {
        let path = PathBuf::from(format!("{SHARED_MEMORY}/cw_room_{}_file", std::process::id()));
        let file = std::fs::File::create(&path).unwrap();
        file.set_len(1 << 20).unwrap();
        let kib = || fstat(&file).unwrap().st_blocks / 2;
        assert_eq!(kib(), 0);
        reserve(&[path.with_extension("gone")]).unwrap();
        assert_eq!(kib(), 0);
        reserve(std::slice::from_ref(&path)).unwrap();
        assert_eq!((kib(), file.metadata().unwrap().len()), (1024, 1 << 20));
        std::fs::remove_file(path).unwrap();
        assert!(free_bytes() > Some(0));
    }

    #[test]
    fn memory_that_was_not_taken_is_no_success() {
        assert_eq!(taken(Ok(())), Ok(()));
        // A file system that cannot.
        assert_eq!((taken(Err(Errno::OPNOTSUPP)), taken(Err(Errno::NOSYS))), (Ok(()), Ok(())));
        for e in [Errno::NOSPC, Errno::NOMEM, Errno::INTR, Errno::IO, Errno::DQUOT, Errno::FBIG] {
            assert_eq!(taken(Err(e)), Err(e));
        }
    }
}
