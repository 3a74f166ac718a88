//! The numbers of one writer's samples: they only rise, and wrap.

use super::Rejection;

/// Samples in a row that a writer may lose: an hour at 1 kHz, rounded down.
pub(super) const GAP_MAX: u64 = 3_000_000;

/// Refused samples in a row that must follow each other before their numbers are believed instead.
pub(super) const FOLLOW_SAMPLES: u32 = 5;

/// What is known of one writer.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sequence {
    writer: u128,
    last: Numbered,
    heard_ns: u64,
    /// The newest of the refused samples that follow each other, and how many they are.
    aside: Option<(Numbered, u32)>,
}

/// A sample's number and the time that it is about.
#[derive(Debug, Clone, Copy)]
pub(super) struct Numbered {
    pub(super) sequence: u64,
    pub(super) stamp_ns: u64,
}

/// How a sample comes to be taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Taken {
    /// So many before it never came.
    After(u64),
    /// The numbers before were wrong, and these are followed from now on.
    Resynchronised,
}

impl Sequence {
    pub(super) fn new(writer: u128, first: Numbered, now_ns: u64) -> Self {
        Self { writer, last: first, heard_ns: now_ns, aside: None }
    }

    pub(super) fn writer(&self) -> u128 {
        self.writer
    }

    pub(super) fn heard_ns(&self) -> u64 {
        self.heard_ns
    }

    /// Takes the next sample of this writer.
    ///
    /// A small gap loses samples that a newer one replaces. A large one is a corrupted number: believing it
    /// would refuse what the writer says from then on. Where the number that was believed is the wrong one,
    /// because it was the first that was heard, the right ones come again and again, each of a later time
    /// than the one before: then they are followed. What is really old has an old time.
    pub(super) fn take(&mut self, next: Numbered, now_ns: u64) -> Result<Taken, Rejection> {
        let taken = match next.sequence.wrapping_sub(self.last.sequence) {
            0 => return Err(Rejection::Repeated),
            ahead @ 1..=GAP_MAX => Taken::After(ahead - 1),
            ahead => {
                if !self.follows(next) {
                    let old = ahead > u64::MAX / 2;
                    return Err(if old { Rejection::Reordered } else { Rejection::Gap });
                }
                Taken::Resynchronised
            }
        };
        *self = Self::new(self.writer, next, now_ns);
        Ok(taken)
    }

    /// Whether `next` is one more of enough refused samples that follow each other.
    fn follows(&mut self, next: Numbered) -> bool {
        let agreeing = match self.aside {
            _ if next.stamp_ns <= self.last.stamp_ns => return false,
            Some((before, agreeing)) => {
                let ahead = next.sequence.wrapping_sub(before.sequence);
                if ahead == 0 || next.stamp_ns <= before.stamp_ns {
                    return false;
                }
                if ahead <= GAP_MAX { agreeing + 1 } else { 1 }
            }
            None => 1,
        };
        self.aside = Some((next, agreeing));
        agreeing >= FOLLOW_SAMPLES
    }
}
