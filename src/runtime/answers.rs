use std::sync::Arc;

use super::statistics::Statistics;
use super::watchdog::Watchdog;
use crate::figures::Accumulator;
use crate::telemetry::{Pool, SolveRecord};
use crate::wire::telemetry_flags;

/// The workers' records of the periods whose own record has not been read yet.
pub(super) struct Answers {
    held: Vec<Held>,
    /// The newest period that is done with: what is said of it, or of one before, comes too late.
    done: Option<u64>,
    pub(super) watchdog: Watchdog,
    /// Robots that each worker answered since somebody last looked, and in how many records.
    pub(super) answered: Vec<u64>,
    pub(super) records: u64,
}

/// A record that its worker gets back.
#[derive(Debug)]
struct Held {
    worker: usize,
    record: Box<SolveRecord>,
    /// Robots in it that have not made progress for long.
    stalled: Vec<usize>,
}

/// How far a period was answered.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Answered {
    /// Robots whose record is there.
    pub(super) known: usize,
    /// When the last of them was staged, from the state's stamp, ns.
    pub(super) staged_ns: u64,
}

impl Answers {
    pub(super) fn new(workers: usize) -> Self {
        Self {
            held: Vec::new(),
            done: None,
            watchdog: Watchdog::new(workers),
            answered: vec![0; workers],
            records: 0,
        }
    }

    fn held(&self, tick: u64) -> impl Iterator<Item = &Held> {
        self.held.iter().filter(move |held| held.record.tick == tick)
    }

    /// The records that answer `tick`.
    pub(super) fn of(&self, tick: u64) -> impl Iterator<Item = &SolveRecord> {
        self.held(tick).map(|held| &*held.record)
    }

    /// Robots that have not made progress for long by `tick`.
    pub(super) fn stalled(&self, tick: u64) -> impl Iterator<Item = usize> {
        self.held(tick).flat_map(|held| held.stalled.iter().copied())
    }

    /// How far `tick` was answered.
    pub(super) fn answered(&self, tick: u64) -> Answered {
        self.of(tick).fold(Answered::default(), |all, record| Answered {
            known: all.known + record.robots.len(),
            staged_ns: all.staged_ns.max(record.state_to_staged_ns),
        })
    }

    /// Takes what the workers left since the last time.
    pub(super) fn drain(
        &mut self,
        solves: &[Arc<Pool<SolveRecord>>],
        figures: &mut Accumulator,
        statistics: &mut Statistics,
    ) {
        for (worker, pool) in solves.iter().enumerate() {
            while let Some(record) = pool.take() {
                self.watchdog.answered(worker, record.tick);
                self.records += 1;
                if let Some(answered) = self.answered.get_mut(worker) {
                    *answered += record.robots.len() as u64;
                }
                statistics.state_to_worker.record(record.state_to_worker_ns);
                let mut stalled = Vec::new();
                for (index, robot) in &record.robots {
                    statistics.add_solve(robot);
                    figures.observe_solve(robot);
                    if robot.flags & telemetry_flags::STALLED != 0 {
                        stalled.push(*index);
                    }
                }
                if self.done >= Some(record.tick) {
                    pool.give_back(record);
                } else {
                    self.held.push(Held { worker, record, stalled });
                }
            }
        }
    }

    /// Gives back what was held of the periods up to `tick`.
    pub(super) fn put_away(&mut self, solves: &[Arc<Pool<SolveRecord>>], tick: u64) {
        self.done = self.done.max(Some(tick));
        for held in self.held.extract_if(.., |held| held.record.tick <= tick) {
            if let Some(pool) = solves.get(held.worker) {
                pool.give_back(held.record);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use crate::wire::RobotTelemetry;

    /// Two workers, two records each: one is read, one is held, one comes too late.
    #[test]
    fn records_are_held_until_their_period_is_done_with_and_then_given_back() {
        let scenario = Scenario::builtin("swap8").unwrap();
        let mut figures = Accumulator::new(&scenario, 0.08);
        let mut statistics = Statistics::new(8, 0.08).unwrap();
        let solves: Vec<_> = (0..2).map(|_| Arc::new(Pool::new(2, || SolveRecord::with_room(4)))).collect();
        let leave = |worker: usize, tick: u64, flags: u32| {
            solves[worker].write(|record| {
                (record.tick, record.state_to_staged_ns) = (tick, 10 * tick + worker as u64);
                record.robots.clear();
                let telemetry = RobotTelemetry { flags, ..RobotTelemetry::default() };
                record.robots.extend((4 * worker..4 * worker + 4).map(|index| (index, telemetry)));
            })
        };
        let mut answers = Answers::new(2);
        assert!(leave(0, 5, 0) && leave(1, 5, telemetry_flags::STALLED) && leave(0, 6, 0));
        answers.drain(&solves, &mut figures, &mut statistics);
        let known = |answers: &Answers, tick| {
            let answered = answers.answered(tick);
            (answered.known, answered.staged_ns, answers.of(tick).count())
        };
        assert_eq!([5, 6, 7].map(|tick| known(&answers, tick)), [(8, 51, 2), (4, 60, 1), (0, 0, 0)]);
        assert_eq!(answers.stalled(5).collect::<Vec<_>>(), [4, 5, 6, 7]);
        assert_eq!((answers.answered.as_slice(), answers.records), ([8, 4].as_slice(), 3));
        // Both of the first worker's are away.
        assert!(!leave(0, 7, 0));
        answers.put_away(&solves, 5);
        assert_eq!([5, 6].map(|tick| known(&answers, tick)), [(0, 0, 0), (4, 60, 1)]);
        assert!(leave(0, 5, 0));
        answers.drain(&solves, &mut figures, &mut statistics);
        assert_eq!(known(&answers, 5), (0, 0, 0));
        answers.put_away(&solves, 8);
        for worker in 0..2 {
            assert!(leave(worker, 9, 0) && leave(worker, 10, 0) && !leave(worker, 11, 0));
        }
    }
}
