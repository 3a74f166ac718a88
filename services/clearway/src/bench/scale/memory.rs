//! What the machine's memory allows: how fast it copies, and how many bytes a period moves.

use clearway::wire::{RobotCheckpoint, RobotCommand, RobotIntent, RobotState, RobotTelemetry};
use std::hint::black_box;
use std::sync::Barrier;
use std::time::Instant;

/// Bytes that each thread copies at once: far more than the caches hold.
const BLOCK_BYTES: usize = 64 << 20;
/// Copies of each thread, of which the fastest counts.
const COPIES: usize = 8;
/// A slot of a staged command, padded to its own cache lines.
const SLOT_BYTES: usize = 128;
/// A robot's id and flags, which the loop keeps beside the states.
const HEAD_BYTES: usize = 8;

/// Bytes a second that `threads` copy together, reads and writes both counted, as in STREAM's copy.
pub(super) fn copy_bytes_per_s(threads: usize) -> f64 {
    let barrier = Barrier::new(threads);
    let copy = || {
        let (from, mut to) = (vec![1_u8; BLOCK_BYTES], vec![0_u8; BLOCK_BYTES]);
        let mut best_s = f64::INFINITY;
        for _ in 0..COPIES {
            barrier.wait();
            let begun = Instant::now();
            black_box(&mut to).copy_from_slice(black_box(&from));
            best_s = best_s.min(begun.elapsed().as_secs_f64());
        }
        (2 * BLOCK_BYTES) as f64 / best_s
    };
    std::thread::scope(|scope| {
        let running: Vec<_> = (0..threads).map(|_| scope.spawn(copy)).collect();
        running.into_iter().filter_map(|thread| thread.join().ok()).sum()
    })
}

/// Bytes that the step moves for each robot at least, from the states in shared memory to the commands
/// there, if nothing stays in a cache from one pass to the next.
pub(super) fn step_bytes(workers: usize) -> usize {
    let (state, command) = (size_of::<RobotState>(), size_of::<RobotCommand>());
    let intent = size_of::<RobotIntent>();
    // Every worker: the states read, their predictions written, read again for the cells, and cells
    // written and read (a position and two indices).
    let every_worker = 3 * state + 2 * 24;
    // Its owner: prediction and memory read, memory written (about a checkpoint), the answer staged, the
    // record for telemetry written.
    let owner = state + 3 * size_of::<RobotCheckpoint>() + 2 * SLOT_BYTES + 2 * size_of::<RobotTelemetry>();
    // The loop: slot and the head of the state read, command and intent written, command read and published.
    let collecting = SLOT_BYTES + HEAD_BYTES + command + intent + 2 * command;
    workers * every_worker + owner + collecting
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_worker_reads_the_whole_fleet() {
        let more = step_bytes(3) - step_bytes(2);
        assert!(more >= 2 * size_of::<RobotState>());
        assert_eq!(step_bytes(2) - step_bytes(1), more);
        assert!(copy_bytes_per_s(1) > 0.0);
    }
}
