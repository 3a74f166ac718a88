//! The smallest set of a seed's faults that still fails.

use super::{Options, Outcome, SimulationError, simulate};

/// Leaves out faults of a failing seed, one after the other, as long as the same invariant fails. Returns the
/// numbers of those that are left, and what becomes of them alone.
///
/// # Errors
/// Those of [`simulate`].
pub fn shrink(outcome: &Outcome, options: &Options) -> Result<(Vec<usize>, Outcome), SimulationError> {
    let mut left: Vec<usize> = outcome.faults.iter().map(|fault| fault.number).collect();
    let mut smallest = outcome.clone();
    let Some(invariant) = outcome.failures.first().map(|failure| failure.invariant) else {
        return Ok((left, smallest));
    };
    let mut at = 0;
    while at < left.len() {
        let mut fewer = left.clone();
        fewer.remove(at);
        let again = simulate(outcome.seed, &Options { only: Some(fewer.clone()), ..options.clone() })?;
        if again.failures.first().is_some_and(|failure| failure.invariant == invariant) {
            (left, smallest) = (fewer, again);
        } else {
            at += 1;
        }
    }
    Ok((left, smallest))
}
