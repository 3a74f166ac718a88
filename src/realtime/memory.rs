use rustix::mm::{MlockAllFlags, mlockall};
use rustix::process::{Resource, getrlimit};
use rustix::thread::{CapabilitySet, capabilities};

use crate::config::{RealTimeConfig, RealTimePolicy};

/// How much stack a real-time thread touches before its first period; it uses far less.
const STACK_BYTES: usize = 256 * 1024;

/// Locks all memory of the process, present and future, so that no access waits for the disk and
/// every mapping (stacks, shared memory) is filled when it is made. Call before the threads start.
///
/// `Ok(false)` when it was not asked for.
///
/// # Errors
/// Why it was not done, and what to change. A finite limit counts as a refusal even when the memory
/// of now would fit: the lock also covers later mappings, and one of those would fail mid-run.
pub fn lock_memory(config: &RealTimeConfig) -> Result<bool, String> {
    if config.policy == RealTimePolicy::Off || !config.lock_memory {
        return Ok(false);
    }
    let advice =
        "grant CAP_IPC_LOCK, or lift the limit (`ulimit -l unlimited`, LimitMEMLOCK=infinity in the unit)";
    let privileged = capabilities(None).is_ok_and(|sets| sets.effective.contains(CapabilitySet::IPC_LOCK));
    if let Some(limit) = getrlimit(Resource::Memlock).current
        && !privileged
    {
        return Err(format!("memory is not locked: the limit is {} KiB; {advice}", limit / 1024));
    }
    match mlockall(MlockAllFlags::CURRENT | MlockAllFlags::FUTURE) {
        Ok(()) => Ok(true),
        Err(e) => Err(format!("memory is not locked: {e}; {advice}")),
    }
}

/// Touches the stack that the calling thread is going to use, so that no page of it is missing later.
#[inline(never)]
#[expect(clippy::large_stack_arrays, reason = "touching that much of the stack is the purpose")]
pub fn prefault_stack() {
    let mut pages = [0_u8; STACK_BYTES];
    for byte in pages.iter_mut().step_by(4096) {
        *byte = 1;
    }
    std::hint::black_box(&pages);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_locked_unless_asked() {
        let off = RealTimeConfig { policy: RealTimePolicy::Off, ..RealTimeConfig::default() };
        assert_eq!(lock_memory(&off), Ok(false));
        let no = RealTimeConfig { lock_memory: false, ..RealTimeConfig::default() };
        assert_eq!(lock_memory(&no), Ok(false));
    }

    #[test]
    fn prefaulting_fits_a_thread() {
        std::thread::spawn(prefault_stack).join().unwrap();
    }
}
