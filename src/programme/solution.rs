use crate::model::Command;

/// Primal and dual solution of a [`Programme`](super::Programme).
///
/// The multipliers of δ ≥ 0 are w − λ of the row that the slack belongs to.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Solution {
    /// v, m/s.
    pub v_mps: f64,
    /// ω, rad/s.
    pub omega_radps: f64,
    /// δ_p, m².
    pub slack_position: f64,
    /// δ_θ.
    pub slack_heading: f64,
    /// δ_rj in the order of the comfort rows, m.
    pub slack_comfort: Vec<f64>,
    /// Multiplier of the position certificate, in [0, w_p].
    pub dual_position: f64,
    /// Multiplier of the heading certificate, in [0, w_θ].
    pub dual_heading: f64,
    /// Multipliers of the comfort rows, in [0, w_r].
    pub dual_comfort: Vec<f64>,
    /// Multipliers of the safety rows, ≥ 0.
    pub dual_safety: Vec<f64>,
    /// Multipliers of v ≥ v_min and v ≤ v_max, ≥ 0.
    pub dual_v: [f64; 2],
    /// Multipliers of ω ≥ ω_min and ω ≤ ω_max, ≥ 0.
    pub dual_omega: [f64; 2],
}

impl Solution {
    /// An empty solution with room for `capacity` rows of each kind.
    pub fn with_capacity(capacity: usize) -> Self {
        Self {
            slack_comfort: Vec::with_capacity(capacity),
            dual_comfort: Vec::with_capacity(capacity),
            dual_safety: Vec::with_capacity(capacity),
            ..Self::default()
        }
    }

    /// The input u = (v, ω).
    pub fn command(&self) -> Command {
        Command { v_mps: self.v_mps, omega_radps: self.omega_radps }
    }

    /// Zeroes everything and sets the lengths; keeps the memory.
    pub fn reset(&mut self, comfort: usize, safety: usize) {
        for (rows, n) in [
            (&mut self.slack_comfort, comfort),
            (&mut self.dual_comfort, comfort),
            (&mut self.dual_safety, safety),
        ] {
            rows.clear();
            rows.resize(n, 0.0);
        }
        (self.v_mps, self.omega_radps) = (0.0, 0.0);
        (self.slack_position, self.slack_heading) = (0.0, 0.0);
        (self.dual_position, self.dual_heading) = (0.0, 0.0);
        (self.dual_v, self.dual_omega) = ([0.0; 2], [0.0; 2]);
    }
}
