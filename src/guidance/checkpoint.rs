//! A robot's memory as plain words and back, to the bit: what a recording needs to compute a decision again.

use super::types::{Around, Intent, Memory, Plan, Progress, Way};
use crate::geometry::Vec2;
use crate::wire::RobotCheckpoint;

/// Writes the memory as words, where they are kept; unused ones become 0.
#[inline]
pub(crate) fn write(memory: &Memory, words: &mut [u64; RobotCheckpoint::WORDS]) {
    // Taken apart completely: a field that is forgotten here does not compile.
    let Memory { started, intent, progress, fallback_s, beta_rad, around, way, ask_s, plan, crowded_s } =
        *memory;
    let Intent { heading_rad, speed_mps, target_m, blocked_s: told_blocked_s, rank: told_rank } = intent;
    let Progress { blocked_s, still_s, turned_rad, queued_s } = progress;
    let Around { side, free_s, spent_s, changes } = around;
    let Way { left_s, rest_s, rank, spot_m } = way;
    let Plan { heading_rad: plan_rad, share, mean_speed_mps, turn_rad } = plan;
    let numbers = [
        heading_rad,
        speed_mps,
        target_m.x,
        target_m.y,
        told_blocked_s,
        blocked_s,
        still_s,
        turned_rad,
        queued_s,
        fallback_s,
        beta_rad,
        side,
        free_s,
        spent_s,
        changes,
        left_s,
        rest_s,
        spot_m.x,
        spot_m.y,
        ask_s,
        plan_rad,
        share,
        mean_speed_mps,
        turn_rad,
        crowded_s,
    ];
    words[0] = u64::from(started);
    words[1] = u64::from(told_rank) << 32 | u64::from(rank);
    let (used, unused) = words[2..].split_at_mut(numbers.len());
    for (word, number) in used.iter_mut().zip(numbers) {
        *word = number.to_bits();
    }
    unused.fill(0);
}

/// The memory that `words` came from.
#[expect(clippy::cast_possible_truncation, reason = "takes apart what `write` put together")]
pub(crate) fn memory(words: &[u64; RobotCheckpoint::WORDS]) -> Memory {
    let number = |index: usize| f64::from_bits(words[index + 2]);
    Memory {
        started: words[0] != 0,
        intent: Intent {
            heading_rad: number(0),
            speed_mps: number(1),
            target_m: Vec2::new(number(2), number(3)),
            blocked_s: number(4),
            rank: (words[1] >> 32) as u32,
        },
        progress: Progress {
            blocked_s: number(5),
            still_s: number(6),
            turned_rad: number(7),
            queued_s: number(8),
        },
        fallback_s: number(9),
        beta_rad: number(10),
        around: Around { side: number(11), free_s: number(12), spent_s: number(13), changes: number(14) },
        way: Way {
            left_s: number(15),
            rest_s: number(16),
            rank: words[1] as u32,
            spot_m: Vec2::new(number(17), number(18)),
        },
        ask_s: number(19),
        plan: Plan {
            heading_rad: number(20),
            share: number(21),
            mean_speed_mps: number(22),
            turn_rad: number(23),
        },
        crowded_s: number(24),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn memory_survives_the_round_trip(
            started in any::<bool>(),
            ranks in any::<u64>(),
            numbers in prop::array::uniform25(any::<u64>()),
        ) {
            let mut before = [0; RobotCheckpoint::WORDS];
            (before[0], before[1]) = (u64::from(started), ranks);
            before[2..27].copy_from_slice(&numbers);
            let mut after = [7; RobotCheckpoint::WORDS];
            write(&memory(&before), &mut after);
            prop_assert_eq!(after, before);
        }
    }
}
