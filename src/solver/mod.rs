//! Solvers of the [`Programme`]: one trait, two implementations.
//!
//! * [`ExactSolver`]: the programme separates into one convex piecewise quadratic problem in v and
//!   one in ω; each is solved by walking its breakpoints. About a hundred nanoseconds, no iteration
//!   that can fail, no allocation, the same bits every time.
//! * [`ClarabelSolver`]: the whole programme in conic form through Clarabel's interior point method,
//!   with the workspace built once and the data updated. The reference.

mod clarabel;
mod exact;
mod piecewise;

pub use self::clarabel::ClarabelSolver;
pub use exact::{ExactSolver, optimal_speed, optimal_turn_rate};

use crate::programme::{Programme, Solution};

/// How a solve ended. Anything but `Solved` means that the solution must not be used.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// The solution is filled in; it still has to be verified.
    Solved,
    /// The data are not those of a programme: a number is not finite or has the wrong sign.
    IllPosed,
    /// The solver ended without a solution to its tolerance.
    NotConverged,
    /// More rows than the workspace was built for.
    TooLarge,
}

/// Solves one robot's programme.
pub trait Solver {
    /// Fills `solution` with the primal and dual solution of `programme`.
    fn solve(&mut self, programme: &Programme, solution: &mut Solution) -> Outcome;
}
