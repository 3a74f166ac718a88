//! The last check before a command goes out: against the bodies themselves, not the programme.

use super::Law;
use super::rows::{approach_at, bodies};
use crate::certificate::barrier::budget_m;
use crate::model::Command;
use crate::neighbours::Nearby;
use crate::wire::RobotState;

/// Rounding that the check forgives, m.
const ROUNDING_M: f64 = 1e-12;

/// What [`against_bodies`] found.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Verdict {
    /// The command keeps its share of every gap at every instant of the period.
    pub(super) safe: bool,
    /// Largest |v| of the command's sign that would, m/s.
    pub(super) speed_limit_mps: f64,
}

/// Checks the exact motion of `command` against every body that it can reach.
pub(super) fn against_bodies(
    law: &Law,
    fleet: &[RobotState],
    me: usize,
    near: &[Nearby],
    command: Command,
) -> Verdict {
    let theta_rad = fleet[me].theta_rad;
    let mut verdict = Verdict { safe: law.limits.admits(command), speed_limit_mps: law.limits.speed_mps() };
    for body in bodies(law, fleet, me, near, law.control.gamma) {
        let approach = approach_at(theta_rad, command.omega_radps, &body, law.period_s);
        let rate = if command.v_mps < 0.0 { approach.backward } else { approach.forward };
        let budget = budget_m(body.gap_m, law.control.gamma, body.share);
        if rate * command.v_mps.abs() > budget + ROUNDING_M {
            verdict.safe = false;
        }
        if rate > 0.0 {
            verdict.speed_limit_mps = verdict.speed_limit_mps.min(budget / rate);
        }
    }
    verdict
}
