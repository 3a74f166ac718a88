//! The programme through Clarabel, the reference that the exact solver is held against.

mod layout;
mod scaling;
mod workspace;

use super::exact::solve_within;
use super::{Outcome, Solver};
use crate::programme::{Programme, Solution};
use clarabel::solver::SolverError;
use workspace::Workspace;

/// Rows of each kind that the smaller workspaces hold; the largest holds the programme's capacity.
const SIZES: [usize; 4] = [4, 8, 16, 32];

/// The programme in conic form, solved by Clarabel.
///
/// One workspace for each of a few sizes is built at start with a fixed sparsity; a solve picks the
/// smallest that fits, overwrites its data and iterates. The data are scaled first so that every
/// row and the objective are of order one, whatever the weights and units:
///
/// * v = lo + (hi − lo) v̂ over the part of the admissible interval that can hold the minimiser,
///   likewise ω, so that a blocked robot's programme, where hi = lo, still has an interior;
/// * each row is divided by its largest term, and its slack with it;
/// * a certificate ĉx̂ + ½κ²x̂² + Q̂ ≤ δ̂ is the second-order cone
///   ‖(t̂ − 1, √2 κ x̂)‖ ≤ t̂ + 1 with t̂ = δ̂ − Q̂ − ĉx̂.
///
/// An interior point method that ends at a duality gap ε leaves the inputs within about √ε of a
/// flat optimum. Clarabel's answer therefore only says where the solution is; inside a trust
/// interval around it the last digits and the multipliers come from the optimality conditions in
/// closed form. When they would leave the trust interval, Clarabel's own numbers stay.
///
/// Tens of microseconds a solve. Updating the data does not allocate; Clarabel allocates once a solve.
pub struct ClarabelSolver {
    workspaces: Vec<Workspace>,
    polished: Option<Solution>,
}

impl ClarabelSolver {
    /// Builds the workspaces for programmes of up to `capacity` rows of each kind.
    ///
    /// # Errors
    /// What Clarabel says about the problem that it is built with.
    pub fn new(capacity: usize) -> Result<Self, SolverError> {
        let sizes = SIZES.into_iter().filter(|s| *s < capacity).chain([capacity]);
        let workspaces = sizes.map(Workspace::new).collect::<Result<_, _>>()?;
        Ok(Self { workspaces, polished: Some(Solution::with_capacity(capacity)) })
    }

    /// Builds one workspace only, for programmes of up to `rows` rows of each kind.
    ///
    /// # Errors
    /// As [`new`](Self::new).
    pub fn of_one_size(rows: usize) -> Result<Self, SolverError> {
        let workspaces = vec![Workspace::new(rows)?];
        Ok(Self { workspaces, polished: Some(Solution::with_capacity(rows)) })
    }

    /// Returns Clarabel's numbers as they are, without the closed-form last digits.
    #[must_use]
    pub fn without_polish(self) -> Self {
        Self { polished: None, ..self }
    }

    /// Iterations of the last solve that used the workspace for `rows` rows.
    pub fn iterations(&self, rows: usize) -> Option<u32> {
        self.workspaces.iter().find(|w| rows <= w.size).map(|w| w.solver.solution.iterations)
    }
}

impl Solver for ClarabelSolver {
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome {
        if !programme.is_well_posed() {
            return Outcome::IllPosed;
        }
        let rows = programme.comfort.len().max(programme.safety.len());
        let Some(workspace) = self.workspaces.iter_mut().find(|w| rows <= w.size) else {
            return Outcome::TooLarge;
        };
        let Some(scales) = workspace.solve(programme) else {
            return Outcome::NotConverged;
        };
        workspace.read(programme, &scales, solution);
        if let Some(polished) = &mut self.polished {
            let (v, omega) = (solution.v_mps, solution.omega_radps);
            if solve_within(programme, polished, scales.v.trust(v), scales.omega.trust(omega)) {
                std::mem::swap(solution, polished);
            }
        }
        Outcome::Solved
    }
}
