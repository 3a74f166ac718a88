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

#[cfg(test)]
mod tests {
    use super::*;
    use std::mem::MaybeUninit;

    #[test]
    fn asking_changes_nothing_whatever_the_place() {
        let (large, small, spare) = ([7_u64; 100], 3_u8, MaybeUninit::<[u64; 40]>::uninit());
        let (nothing, list) = ((), vec![1_u32; 5]);
        expect(&large);
        expect(&small);
        expect(&spare);
        expect(&nothing);
        list.iter().for_each(expect);
        assert_eq!((large, small, list), ([7; 100], 3, vec![1; 5]));
    }
}
