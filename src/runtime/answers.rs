use std::sync::Arc;

use super::statistics::Statistics;
use super::watchdog::Watchdog;
use crate::figures::Accumulator;
use crate::telemetry::{Pool, SolveRecord};
use crate::wire::{RobotCheckpoint, RobotTelemetry};

/// The workers' records of the last periods, put together by tick.
pub(super) struct Answers {
    ring: Vec<Answer>,
    pub(super) watchdog: Watchdog,
    /// Robots that each worker answered since somebody last looked, and in how many records.
    pub(super) answered: Vec<u64>,
    pub(super) records: u64,
}

/// One period's solutions.
#[derive(Debug, Clone)]
pub(super) struct Answer {
    tick: Option<u64>,
    /// Robots whose record is there.
    pub(super) known: usize,
    /// When the last of them was staged, from the state's stamp, ns.
    pub(super) staged_ns: u64,
    pub(super) robots: Vec<RobotTelemetry>,
    pub(super) checkpoints: Vec<RobotCheckpoint>,
}

impl Answers {
    pub(super) fn new(robots: usize, workers: usize, periods: usize) -> Self {
        let empty = Answer {
            tick: None,
            known: 0,
            staged_ns: 0,
            robots: vec![RobotTelemetry::default(); robots],
            checkpoints: vec![RobotCheckpoint::default(); robots],
        };
        Self {
            ring: vec![empty; periods.max(1)],
            watchdog: Watchdog::new(workers),
            answered: vec![0; workers],
            records: 0,
        }
    }

    fn slot(&self, tick: u64) -> usize {
        usize::try_from(tick % self.ring.len() as u64).unwrap_or(0)
    }

    pub(super) fn get(&self, tick: u64) -> Option<&Answer> {
        self.ring.get(self.slot(tick)).filter(|answer| answer.tick == Some(tick))
    }

    /// Takes what the workers left since the last time.
    pub(super) fn drain(
        &mut self,
        solves: &[Arc<Pool<SolveRecord>>],
        figures: &mut Accumulator,
        statistics: &mut Statistics,
    ) {
        for (worker, pool) in solves.iter().enumerate() {
            let mut more = true;
            while more {
                more = pool
                    .read(|record| {
                        self.watchdog.answered(worker, record.tick);
                        self.records += 1;
                        if let Some(answered) = self.answered.get_mut(worker) {
                            *answered += record.robots.len() as u64;
                        }
                        self.add(record, figures, statistics);
                    })
                    .is_some();
            }
        }
    }

    fn add(&mut self, record: &SolveRecord, figures: &mut Accumulator, statistics: &mut Statistics) {
        statistics.add_solves(record);
        let slot = self.slot(record.tick);
        let Some(answer) = self.ring.get_mut(slot) else { return };
        if answer.tick != Some(record.tick) {
            (answer.tick, answer.known, answer.staged_ns) = (Some(record.tick), 0, 0);
            answer.robots.fill(RobotTelemetry::default());
            answer.checkpoints.fill(RobotCheckpoint::default());
        }
        answer.known += record.robots.len();
        answer.staged_ns = answer.staged_ns.max(record.state_to_staged_ns);
        for (index, checkpoint) in &record.checkpoints {
            if let Some(mine) = answer.checkpoints.get_mut(*index) {
                *mine = *checkpoint;
            }
        }
        for (index, robot) in &record.robots {
            if let Some(mine) = answer.robots.get_mut(*index) {
                *mine = *robot;
            }
            figures.observe_solve(robot);
        }
    }
}
