//! Shared memory as a file system that can fill up.

use rustix::fs::{FallocateFlags, Mode, OFlags, fallocate, fstat, open, statvfs};
use rustix::io::Errno;

/// Where the kernel keeps shared memory.
pub(super) const SHARED_MEMORY: &str = "/dev/shm";

/// What is free, bytes; `None` when the file system cannot be asked.
pub(super) fn free_bytes() -> Option<u64> {
    statvfs(SHARED_MEMORY).ok().map(|shared| shared.f_bavail.saturating_mul(shared.f_frsize))
}

/// Takes the memory of every file whose name begins with `prefix`, down to its last page. Those of others, that
/// have just gone or cannot be written, are left as they are.
///
/// # Errors
/// [`Errno::NOSPC`] when there is less than what they promise.
pub(super) fn reserve(prefix: &str) -> Result<(), Errno> {
    let Ok(entries) = std::fs::read_dir(SHARED_MEMORY) else { return Ok(()) };
    let ours = entries.flatten().filter(|entry| entry.file_name().to_string_lossy().starts_with(prefix));
    for path in ours.map(|entry| entry.path()) {
        let Ok(file) = open(&path, OFlags::RDWR | OFlags::CLOEXEC, Mode::empty()) else { continue };
        let length = fstat(&file).map_or(0, |stat| stat.st_size.unsigned_abs());
        if length > 0 && fallocate(&file, FallocateFlags::KEEP_SIZE, 0, length) == Err(Errno::NOSPC) {
            return Err(Errno::NOSPC);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_has_its_memory_before_anybody_uses_it() {
        let prefix = format!("cw_room_{}_", std::process::id());
        let path = format!("{SHARED_MEMORY}/{prefix}file");
        let file = std::fs::File::create(&path).unwrap();
        file.set_len(1 << 20).unwrap();
        let kib = || fstat(&file).unwrap().st_blocks / 2;
        assert_eq!(kib(), 0);
        reserve(&format!("{prefix}other")).unwrap();
        assert_eq!(kib(), 0);
        reserve(&prefix).unwrap();
        assert_eq!((kib(), file.metadata().unwrap().len()), (1024, 1 << 20));
        std::fs::remove_file(path).unwrap();
        assert!(free_bytes() > Some(0));
    }
}
