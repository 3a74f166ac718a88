//! The certificates: what the programme asks of the inputs, as numbers.
//!
//! Reads poses and parameters, writes the coefficients of the rows of the programme.
//!
//! * [`FiniteTime`] and [`Exponential decrease`](Decrease::Exponential): how much a Lyapunov
//!   function is to fall in one step (Definition 2, (28), (31)).
//! * [`barrier`]: how fast a robot may approach another body in one step.
//! * [`robust`]: the same for robots that are disturbed within known bounds.
//!
//! Cost: tens of nanoseconds each. Nothing here allocates.

pub mod barrier;
mod lyapunov;
pub mod robust;

pub use lyapunov::{Decrease, FiniteTime, HeadingCertificate, HeadingLaw, PositionCertificate};
