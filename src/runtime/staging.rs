use std::sync::atomic::{AtomicU64, Ordering, fence};

use crossbeam::utils::CachePadded;

use crate::cache;
use crate::wire::{RobotCommand, RobotIntent};

/// Marks a slot that is being written. No period has this number.
const WRITING: u64 = u64::MAX;

/// Words of a staged result: the command and the intent, without the id.
const WORDS: usize = 11;

/// One robot's result on its way from its worker to the loop.
#[derive(Debug)]
struct Slot {
    /// The period that the result answers, or [`WRITING`].
    tick: AtomicU64,
    words: [AtomicU64; WORDS],
}

fn encode(command: &RobotCommand, intent: &RobotIntent) -> [u64; WORDS] {
    [
        u64::from(command.stop_reason),
        command.v_mps.to_bits(),
        command.omega_radps.to_bits(),
        intent.heading_rad.to_bits(),
        intent.speed_mps.to_bits(),
        intent.blocked_s.to_bits(),
        intent.target_x_m.to_bits(),
        intent.target_y_m.to_bits(),
        intent.waypoint_x_m.to_bits(),
        intent.waypoint_y_m.to_bits(),
        u64::from(intent.rank) << 32 | u64::from(intent.valid),
    ]
}

#[expect(clippy::cast_possible_truncation, reason = "takes apart what `encode` put together")]
fn decode(id: u32, words: [u64; WORDS]) -> (RobotCommand, RobotIntent) {
    let [stop_reason, v, omega, heading, speed, blocked, tx, ty, wx, wy, rank_valid] = words;
    let command = RobotCommand {
        id,
        stop_reason: stop_reason as u32,
        v_mps: f64::from_bits(v),
        omega_radps: f64::from_bits(omega),
    };
    let intent = RobotIntent {
        heading_rad: f64::from_bits(heading),
        speed_mps: f64::from_bits(speed),
        blocked_s: f64::from_bits(blocked),
        target_x_m: f64::from_bits(tx),
        target_y_m: f64::from_bits(ty),
        waypoint_x_m: f64::from_bits(wx),
        waypoint_y_m: f64::from_bits(wy),
        rank: (rank_valid >> 32) as u32,
        valid: rank_valid as u32,
    };
    (command, intent)
}

/// Where workers leave commands and the loop finds them: a sequence lock for each robot.
///
/// Each slot has one writer, the robot's worker, and one reader, the loop; neither ever waits. A
/// worker that is late can write while the loop reads, so a read is believed only if the tick
/// stands before **and** after it:
///
/// - the writer stores `WRITING`, a release fence, the fields, then the tick with release;
/// - the reader loads the tick with acquire, the fields, an acquire fence, then the tick again.
///
/// If the first load sees the tick, the fields read are at least those written before it. If any of
/// them is newer, the reader's fence synchronises with the writer's, so the second load sees
/// `WRITING` or what came after, and the read is refused. Ticks never repeat, so there is no way
/// back to the same value.
#[derive(Debug)]
pub struct Staging {
    ids: Vec<u32>,
    slots: Vec<CachePadded<Slot>>,
}

impl Staging {
    /// Empty slots for robots with these ids.
    pub fn new(ids: Vec<u32>) -> Self {
        let slots = ids
            .iter()
            .map(|_| {
                CachePadded::new(Slot {
                    tick: AtomicU64::new(WRITING),
                    words: std::array::from_fn(|_| AtomicU64::new(0)),
                })
            })
            .collect();
        Self { ids, slots }
    }

    /// Leaves the result of robot `index` that answers the state of `tick`. For its worker only.
    pub fn put(&self, index: usize, tick: u64, command: &RobotCommand, intent: &RobotIntent) {
        let Some(slot) = self.slots.get(index) else { return };
        slot.tick.store(WRITING, Ordering::Relaxed);
        fence(Ordering::Release);
        for (word, bits) in slot.words.iter().zip(encode(command, intent)) {
            word.store(bits, Ordering::Relaxed);
        }
        slot.tick.store(tick, Ordering::Release);
    }

    /// Says that the result of robot `index` will be put soon.
    pub(super) fn expect(&self, index: usize) {
        if let Some(slot) = self.slots.get(index) {
            cache::expect(slot);
        }
    }

    /// The result of robot `index` that answers the state of `tick`, if it is complete.
    pub fn take(&self, index: usize, tick: u64) -> Option<(RobotCommand, RobotIntent)> {
        let (slot, id) = (self.slots.get(index)?, *self.ids.get(index)?);
        if slot.tick.load(Ordering::Acquire) != tick {
            return None;
        }
        let words = std::array::from_fn(|word| slot.words[word].load(Ordering::Relaxed));
        fence(Ordering::Acquire);
        (slot.tick.load(Ordering::Relaxed) == tick).then(|| decode(id, words))
    }

    /// Whether every robot's command that answers `tick` is there.
    pub fn complete(&self, tick: u64) -> bool {
        self.slots.iter().all(|slot| slot.tick.load(Ordering::Acquire) == tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::AtomicBool;

    /// A result whose every field is made of `n`.
    fn result(id: u32, n: u32) -> (RobotCommand, RobotIntent) {
        let x = f64::from(n);
        let command = RobotCommand { id, stop_reason: n, v_mps: x, omega_radps: -x };
        let intent = RobotIntent {
            heading_rad: x + 1.0,
            speed_mps: x + 2.0,
            blocked_s: x + 3.0,
            target_x_m: x + 4.0,
            target_y_m: x + 5.0,
            waypoint_x_m: x + 6.0,
            waypoint_y_m: x + 7.0,
            rank: n ^ 0xffff,
            valid: n,
        };
        (command, intent)
    }

    #[test]
    fn only_the_result_of_the_right_period_is_taken() {
        let staging = Staging::new(vec![4, 9]);
        assert_eq!(staging.take(1, 0), None);
        let (command, intent) = result(9, 77);
        staging.put(1, 7, &command, &intent);
        assert_eq!(staging.take(1, 7), Some((command, intent)));
        assert_eq!((staging.take(1, 6), staging.take(1, 8), staging.take(0, 7)), (None, None, None));
        assert!(!staging.complete(7));
        staging.put(0, 7, &command, &intent);
        assert!(staging.complete(7));
        assert_eq!(staging.take(2, 7), None);
    }

    /// A writer in full speed: whatever the reader gets belongs together and to its tick.
    #[test]
    fn a_torn_read_is_never_believed() {
        const LAST: u32 = 200_000;
        let staging = Staging::new(vec![0]);
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for n in 0..=LAST {
                    let (command, intent) = result(0, n);
                    staging.put(0, u64::from(n), &command, &intent);
                }
                done.store(true, Ordering::Release);
            });
            let mut taken = 0_u64;
            loop {
                let last = done.load(Ordering::Acquire);
                let tick = staging.slots[0].tick.load(Ordering::Relaxed);
                if let Some(got) = u32::try_from(tick).ok().and_then(|n| Some((n, staging.take(0, tick)?))) {
                    assert_eq!(got.1, result(0, got.0));
                    taken += 1;
                }
                if last {
                    break;
                }
            }
            assert!(taken > 0);
        });
    }
}
