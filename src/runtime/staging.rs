use std::sync::atomic::{AtomicU32, AtomicU64, Ordering, fence};

use crossbeam::utils::CachePadded;

use crate::wire::RobotCommand;

/// Marks a slot that is being written. No period has this number.
const WRITING: u64 = u64::MAX;

/// One robot's command on its way from its worker to the loop.
#[derive(Debug)]
struct Slot {
    /// The period that the command answers, or [`WRITING`].
    tick: AtomicU64,
    stop_reason: AtomicU32,
    v_bits: AtomicU64,
    omega_bits: AtomicU64,
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
                    stop_reason: AtomicU32::new(0),
                    v_bits: AtomicU64::new(0),
                    omega_bits: AtomicU64::new(0),
                })
            })
            .collect();
        Self { ids, slots }
    }

    /// Leaves the command of robot `index` that answers the state of `tick`. For its worker only.
    pub fn put(&self, index: usize, tick: u64, command: &RobotCommand) {
        let Some(slot) = self.slots.get(index) else { return };
        slot.tick.store(WRITING, Ordering::Relaxed);
        fence(Ordering::Release);
        slot.stop_reason.store(command.stop_reason, Ordering::Relaxed);
        slot.v_bits.store(command.v_mps.to_bits(), Ordering::Relaxed);
        slot.omega_bits.store(command.omega_radps.to_bits(), Ordering::Relaxed);
        slot.tick.store(tick, Ordering::Release);
    }

    /// The command of robot `index` that answers the state of `tick`, if it is complete.
    pub fn take(&self, index: usize, tick: u64) -> Option<RobotCommand> {
        let slot = self.slots.get(index)?;
        if slot.tick.load(Ordering::Acquire) != tick {
            return None;
        }
        let command = RobotCommand {
            id: *self.ids.get(index)?,
            stop_reason: slot.stop_reason.load(Ordering::Relaxed),
            v_mps: f64::from_bits(slot.v_bits.load(Ordering::Relaxed)),
            omega_radps: f64::from_bits(slot.omega_bits.load(Ordering::Relaxed)),
        };
        fence(Ordering::Acquire);
        (slot.tick.load(Ordering::Relaxed) == tick).then_some(command)
    }

    /// Whether every robot's command that answers `tick` is there.
    pub fn complete(&self, tick: u64) -> bool {
        self.slots.iter().all(|slot| slot.tick.load(Ordering::Acquire) == tick)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Command, RobotId};
    use std::sync::atomic::AtomicBool;

    #[test]
    fn only_the_command_of_the_right_period_is_taken() {
        let staging = Staging::new(vec![4, 9]);
        assert_eq!(staging.take(1, 0), None);
        let command = RobotCommand::verified(RobotId(9), Command { v_mps: 1.5, omega_radps: -0.5 });
        staging.put(1, 7, &command);
        assert_eq!(staging.take(1, 7), Some(command));
        assert_eq!((staging.take(1, 6), staging.take(1, 8), staging.take(0, 7)), (None, None, None));
        assert!(!staging.complete(7));
        staging.put(0, 7, &command);
        assert!(staging.complete(7));
        assert_eq!(staging.take(2, 7), None);
    }

    /// A writer in full speed: whatever the reader gets belongs together and to its tick.
    #[test]
    fn a_torn_read_is_never_believed() {
        let staging = Staging::new(vec![0]);
        let done = AtomicBool::new(false);
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for tick in 0..300_000_u32 {
                    let x = f64::from(tick);
                    let command = RobotCommand { id: 0, stop_reason: tick, v_mps: x, omega_radps: -x };
                    staging.put(0, u64::from(tick), &command);
                }
                done.store(true, Ordering::Release);
            });
            let (mut tick, mut taken) = (0, 0_u64);
            while !done.load(Ordering::Acquire) || tick != 299_999 {
                let seen = staging.slots[0].tick.load(Ordering::Relaxed);
                if seen == WRITING {
                    continue;
                }
                tick = seen;
                if let Some(command) = staging.take(0, tick) {
                    taken += 1;
                    assert_eq!(u64::from(command.stop_reason), tick);
                    assert_eq!((command.v_mps, command.omega_radps), (tick as f64, -(tick as f64)));
                }
            }
            assert!(taken > 0);
        });
    }
}
