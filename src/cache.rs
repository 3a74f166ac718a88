//! Memory asked for before it is needed, so that the processor has it near when it is.

/// Bytes of a line of the cache.
const LINE_BYTES: usize = 64;

/// Asks for the memory of `place`, to be written soon. Changes nothing but how long it takes afterwards;
/// does nothing on processors for which it is not made.
#[inline]
pub fn expect<T>(place: &T) {
    #[cfg(target_arch = "x86_64")]
    for offset in (0..size_of::<T>()).step_by(LINE_BYTES) {
        use std::arch::x86_64::{_MM_HINT_ET0, _mm_prefetch};
        let line = std::ptr::from_ref(place).cast::<i8>().wrapping_add(offset);
        // SAFETY: it reads and writes nothing, and fails at no address.
        unsafe { _mm_prefetch::<_MM_HINT_ET0>(line) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (place, LINE_BYTES);
}
