//! The shadow audit: a sample of the solutions that became commands, solved again by another solver.
//!
//! The real-time side holds a [`Recorder`]: one solve in so many is copied into a slot that was
//! allocated at start; without a free slot it is dropped and counted. Some thread that has time holds
//! the [`Auditor`]: it solves the copies again with a solver of its choice, keeps the largest
//! disagreement and hands the slots back. Recording neither allocates, nor locks, nor waits.
//!
//! ```
//! use clearway::config::Weights;
//! use clearway::programme::{Interval, Programme, Solution};
//! use clearway::solver::{ClarabelSolver, ExactSolver, Solver};
//!
//! let (mut recorder, mut auditor) = clearway::audit::start(ClarabelSolver::new(8)?, 8, 16, 1);
//! let mut programme = Programme::with_capacity(Weights::default(), 8);
//! programme.v_mps = Interval { min: 0.0, max: 5.0 };
//! let mut solution = Solution::with_capacity(8);
//! ExactSolver.solve(&programme, &mut solution);
//! recorder.offer(&programme, &solution);
//!
//! auditor.audit(usize::MAX);
//! assert_eq!((auditor.report().audited, auditor.report().disagreed), (1, 0));
//! # Ok::<(), clarabel::solver::SolverError>(())
//! ```

use crate::config::Weights;
use crate::model::Command;
use crate::programme::{Programme, Solution};
use crate::solver::{Outcome, Solver};
use crate::verify::Disagreement;
use crossbeam::queue::ArrayQueue;
use serde::Serialize;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Inputs and objectives further apart than this count as a disagreement.
pub const TOLERANCE: f64 = 1e-6;

/// A programme and the answer that it got.
#[derive(Debug, Clone, PartialEq)]
struct Sample {
    programme: Programme,
    answer: Command,
}

/// Slots on their way between the two sides. Each is in one of the queues or in somebody's hands.
#[derive(Debug)]
struct Shared {
    free: ArrayQueue<Box<Sample>>,
    recorded: ArrayQueue<Box<Sample>>,
    dropped: AtomicU64,
}

/// What the audit has found so far.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize)]
pub struct AuditReport {
    /// Solutions compared.
    pub audited: u64,
    /// Of these, further apart than [`TOLERANCE`].
    pub disagreed: u64,
    /// Programmes that the auditor's solver did not solve; not compared.
    pub not_solved: u64,
    /// Solutions that were due and found no free slot, or had more rows than one holds.
    pub dropped: u64,
    /// Largest relative difference of the objectives.
    pub max_objective_gap_rel: f64,
    /// Largest difference of the inputs, m/s or rad/s.
    pub max_input_gap: f64,
}

/// Sets up `slots` slots for programmes of up to `rows` rows of each kind; one solve in `every` is
/// recorded, all of them with 0 or 1.
pub fn start<S: Solver>(solver: S, rows: usize, slots: usize, every: u32) -> (Recorder, Auditor<S>) {
    let slots = slots.max(1);
    let shared = Arc::new(Shared {
        free: ArrayQueue::new(slots),
        recorded: ArrayQueue::new(slots),
        dropped: AtomicU64::new(0),
    });
    let slot = || {
        Box::new(Sample {
            programme: Programme::with_capacity(Weights::default(), rows),
            answer: Command::STOP,
        })
    };
    while shared.free.push(slot()).is_ok() {}
    let recorder = Recorder { shared: Arc::clone(&shared), every: every.max(1), until_due: 0 };
    let auditor = Auditor {
        shared,
        solver,
        solution: Solution::with_capacity(rows),
        report: AuditReport::default(),
        worst: None,
    };
    (recorder, auditor)
}

/// The real-time side. Each worker has a clone of its own.
#[derive(Debug, Clone)]
pub struct Recorder {
    shared: Arc<Shared>,
    every: u32,
    until_due: u32,
}

impl Recorder {
    /// Shows a solution that became a command; true when it was recorded.
    pub fn offer(&mut self, programme: &Programme, solution: &Solution) -> bool {
        if self.until_due > 0 {
            self.until_due -= 1;
            return false;
        }
        self.until_due = self.every - 1;
        let recorded = self.record(programme, solution.command());
        if !recorded {
            self.shared.dropped.fetch_add(1, Ordering::Relaxed);
        }
        recorded
    }

    fn record(&self, programme: &Programme, answer: Command) -> bool {
        let Some(mut slot) = self.shared.free.pop() else {
            return false;
        };
        let fits = slot.programme.copy_from(programme);
        slot.answer = answer;
        // Each queue has room for every slot.
        let to = if fits { &self.shared.recorded } else { &self.shared.free };
        to.push(slot).is_ok() && fits
    }
}

/// The side that has time.
#[derive(Debug)]
pub struct Auditor<S> {
    shared: Arc<Shared>,
    solver: S,
    solution: Solution,
    report: AuditReport,
    worst: Option<Programme>,
}

impl<S: Solver> Auditor<S> {
    /// Compares up to `most` of the recorded solutions; how many there were.
    pub fn audit(&mut self, most: usize) -> usize {
        let mut count = 0;
        while count < most {
            let Some(sample) = self.shared.recorded.pop() else {
                break;
            };
            self.compare(&sample);
            count += 1;
            // Each queue has room for every slot.
            let _ = self.shared.free.push(sample);
        }
        self.report.dropped = self.shared.dropped.load(Ordering::Relaxed);
        count
    }

    fn compare(&mut self, sample: &Sample) {
        let Sample { programme, answer } = sample;
        if self.solver.solve(programme, &mut self.solution) != Outcome::Solved {
            self.report.not_solved += 1;
            return;
        }
        let found = Disagreement::between(programme, self.solution.command(), *answer);
        let r = &mut self.report;
        r.audited += 1;
        if !found.within(TOLERANCE) {
            r.disagreed += 1;
            let before = r.max_objective_gap_rel.max(r.max_input_gap);
            if found.objective_rel.max(found.input) > before {
                self.worst = Some(programme.clone());
            }
        }
        r.max_objective_gap_rel = r.max_objective_gap_rel.max(found.objective_rel);
        r.max_input_gap = r.max_input_gap.max(found.input);
    }

    /// What has been found up to the last [`audit`](Self::audit).
    pub fn report(&self) -> AuditReport {
        self.report
    }

    /// The programme of the largest disagreement beyond [`TOLERANCE`], for whoever looks into it.
    pub fn worst(&self) -> Option<&Programme> {
        self.worst.as_ref()
    }
}
