use crate::model::Command;
use crate::programme::Programme;

/// How far two answers to one programme are apart.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Disagreement {
    /// |f(a) − f(b)| / (1 + |f(a)|), with the objective f and the smallest slacks.
    pub objective_rel: f64,
    /// Largest difference of the inputs, in m/s or rad/s.
    pub input: f64,
}

impl Disagreement {
    /// Between the answers `a`, the reference, and `b`; +∞ where a number is not finite.
    pub fn between(programme: &Programme, a: Command, b: Command) -> Self {
        let value = |c: Command| programme.objective(c.v_mps, c.omega_radps);
        let finite = |x: f64| if x.is_finite() { x } else { f64::INFINITY };
        let (v, omega) = ((a.v_mps - b.v_mps).abs(), (a.omega_radps - b.omega_radps).abs());
        Self {
            objective_rel: finite((value(a) - value(b)).abs() / (1.0 + value(a).abs())),
            input: finite(v).max(finite(omega)),
        }
    }

    /// The larger of each.
    #[must_use]
    pub fn max(self, other: Self) -> Self {
        Self {
            objective_rel: self.objective_rel.max(other.objective_rel),
            input: self.input.max(other.input),
        }
    }

    /// Both within `tolerance`.
    pub fn within(&self, tolerance: f64) -> bool {
        self.objective_rel <= tolerance && self.input <= tolerance
    }
}
