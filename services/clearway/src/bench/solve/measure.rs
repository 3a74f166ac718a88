//! The timing and the comparison of one group of problems.

use super::problems::Group;
use crate::bench::machine::ns_since;
use crate::bench::quantiles::Quantiles;
use clearway::programme::{Programme, Solution};
use clearway::solver::{ClarabelSolver, ExactSolver, Outcome, Solver};
use clearway::verify::Disagreement;
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::Serialize;
use std::hint::black_box;
use std::time::Instant;

/// Passes over all problems of a group that the mean is taken from.
const PASSES: usize = 21;

/// Solves of one problem in a row that a repeated solve is averaged over.
const REPEATS: usize = 100;

/// How often a solver is built anew, at most, for each number of neighbours.
const COLD_SAMPLES_MAX: usize = 1000;

/// The figures of one number of neighbours. Times in ns; `--help` and the report's `method` say how
/// they were taken.
#[derive(Debug, Serialize)]
pub(super) struct Case {
    pub(super) neighbours: usize,
    /// Problems; each is timed once by every solver.
    pub(super) samples: usize,
    /// Of these, drawn from scenarios made smaller.
    pub(super) samples_from_smaller: usize,
    pub(super) exact_ns: Quantiles,
    pub(super) exact_repeated_ns: Quantiles,
    pub(super) exact_mean_ns: f64,
    pub(super) clarabel_ns: Quantiles,
    pub(super) clarabel_raw_ns: Quantiles,
    pub(super) clarabel_cold_ns: Quantiles,
    pub(super) clarabel_cold_samples: usize,
    pub(super) clarabel_iterations_mean: f64,
    /// Clarabel's median over the exact solver's.
    pub(super) ratio_p50: f64,
    #[serde(flatten)]
    pub(super) gaps: Gaps,
}

/// Largest disagreement between the solvers.
#[derive(Debug, Clone, Copy, Default, Serialize)]
pub(super) struct Gaps {
    /// |objective − exact objective| / (1 + |exact objective|).
    pub(super) max_objective_gap_rel: f64,
    /// In v, m/s, or ω, rad/s.
    pub(super) max_input_gap: f64,
    /// As `max_objective_gap_rel`, from Clarabel's numbers as they are.
    pub(super) raw_max_objective_gap_rel: f64,
    /// As `max_input_gap`, from Clarabel's numbers as they are.
    pub(super) raw_max_input_gap: f64,
    /// Problems that a solver ended without a solution; not in the gaps.
    pub(super) not_solved: usize,
}

/// The solvers and room for their solutions.
pub(super) struct Bench {
    polished: ClarabelSolver,
    raw: ClarabelSolver,
    solution: Solution,
    reference: Solution,
}

/// Every problem once, each solve between two readings of the clock, after a pass that does not count.
///
/// The controller solves what it has just written into its workspace; so does this.
fn timed_once(solver: &mut impl Solver, problems: &[Programme], solution: &mut Solution) -> Vec<f64> {
    let Some(first) = problems.first() else {
        return Vec::new();
    };
    let mut workspace = Programme::with_capacity(first.weights, first.capacity());
    let mut time = |problem: &Programme| {
        workspace.copy_from(problem);
        let started = Instant::now();
        black_box(solver.solve(black_box(&workspace), black_box(&mut *solution)));
        ns_since(started)
    };
    problems.iter().for_each(|p| {
        time(p);
    });
    problems.iter().map(&mut time).collect()
}

impl Bench {
    /// Solvers for programmes of up to `rows` rows of each kind.
    pub(super) fn new(rows: usize) -> Result<Self> {
        let clarabel =
            || ClarabelSolver::new(rows).into_diagnostic().wrap_err("Clarabel could not be set up");
        Ok(Self {
            polished: clarabel()?,
            raw: clarabel()?.without_polish(),
            solution: Solution::with_capacity(rows),
            reference: Solution::with_capacity(rows),
        })
    }

    pub(super) fn measure(&mut self, group: &Group) -> Result<Case> {
        let problems = &group.problems;
        let exact_ns = Quantiles::of(timed_once(&mut ExactSolver, problems, &mut self.solution));
        let exact_repeated_ns = self.exact_repeated_ns(problems);
        let exact_mean_ns = self.exact_mean_ns(problems);
        let clarabel_ns = Quantiles::of(timed_once(&mut self.polished, problems, &mut self.solution));
        let clarabel_raw_ns = Quantiles::of(timed_once(&mut self.raw, problems, &mut self.solution));
        let cold = self.cold_ns(problems)?;
        let (gaps, clarabel_iterations_mean) = self.compare(problems);
        Ok(Case {
            neighbours: group.neighbours,
            samples: problems.len(),
            samples_from_smaller: group.from_smaller,
            exact_ns,
            exact_repeated_ns,
            exact_mean_ns,
            clarabel_ns,
            clarabel_raw_ns,
            clarabel_cold_samples: cold.len(),
            clarabel_cold_ns: Quantiles::of(cold),
            clarabel_iterations_mean,
            ratio_p50: clarabel_ns.p50 / exact_ns.p50.max(1.0),
            gaps,
        })
    }

    /// Each problem many times in a row: the quantiles are over problems.
    fn exact_repeated_ns(&mut self, problems: &[Programme]) -> Quantiles {
        let mut time = |programme: &Programme| {
            let started = Instant::now();
            for _ in 0..REPEATS {
                black_box(ExactSolver.solve(black_box(programme), black_box(&mut self.solution)));
            }
            ns_since(started) / REPEATS as f64
        };
        Quantiles::of(problems.iter().map(&mut time).collect())
    }

    /// All problems in their order between two readings of the clock, over their number: the median
    /// pass.
    fn exact_mean_ns(&mut self, problems: &[Programme]) -> f64 {
        let mut pass = || {
            let started = Instant::now();
            for programme in problems {
                black_box(ExactSolver.solve(black_box(programme), black_box(&mut self.solution)));
            }
            ns_since(started) / problems.len().max(1) as f64
        };
        Quantiles::of((0..PASSES).map(|_| pass()).collect()).p50
    }

    /// A solver of just the right size is built, used once and dropped.
    fn cold_ns(&mut self, problems: &[Programme]) -> Result<Vec<f64>> {
        let step = problems.len().div_ceil(COLD_SAMPLES_MAX).max(1);
        let mut times = Vec::new();
        for programme in problems.iter().step_by(step) {
            let rows = programme.comfort.len().max(programme.safety.len());
            let started = Instant::now();
            let mut solver = ClarabelSolver::of_one_size(rows).into_diagnostic()?;
            black_box(solver.solve(black_box(programme), black_box(&mut self.solution)));
            times.push(ns_since(started));
        }
        Ok(times)
    }

    /// The largest disagreements and Clarabel's mean number of iterations.
    fn compare(&mut self, problems: &[Programme]) -> (Gaps, f64) {
        let Self { polished, raw, solution, reference } = self;
        let (mut with_polished, mut with_raw) = (Disagreement::default(), Disagreement::default());
        let (mut not_solved, mut iterations) = (0, 0.0);
        for programme in problems {
            let mut solve = |solver: &mut dyn Solver, worst: &mut Disagreement| {
                let solved = solver.solve(programme, solution) == Outcome::Solved;
                if solved {
                    let gap = Disagreement::between(programme, reference.command(), solution.command());
                    *worst = worst.max(gap);
                }
                solved
            };
            let solved = ExactSolver.solve(programme, reference) == Outcome::Solved
                && solve(raw, &mut with_raw)
                && solve(polished, &mut with_polished);
            not_solved += usize::from(!solved);
            let rows = programme.comfort.len().max(programme.safety.len());
            iterations += raw.iterations(rows).map_or(0.0, f64::from);
        }
        let gaps = Gaps {
            max_objective_gap_rel: with_polished.objective_rel,
            max_input_gap: with_polished.input,
            raw_max_objective_gap_rel: with_raw.objective_rel,
            raw_max_input_gap: with_raw.input,
            not_solved,
        };
        (gaps, iterations / problems.len().max(1) as f64)
    }
}
