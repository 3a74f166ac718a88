//! One robot's programme for one period, and what a solution of it is.
//!
//! ```text
//! minimise    ½ R₁ v² + ½ R₂ ω² + w_p δ_p + w_θ δ_θ + w_r Σ_j δ_rj
//! subject to  c v + ½ q v² ≤ −Q_p + δ_p           position certificate (28)
//!             a ω + ½ k ω² ≤ −Q_θ + δ_θ           heading certificate (31)
//!             a_j v ≤ b_j + δ_rj                  comfort rows, b_j ≥ 0
//!             g_j v ≤ s_j                         safety rows, s_j ≥ 0: no slack
//!             v_min ≤ v ≤ v_max, ω_min ≤ ω ≤ ω_max, δ ≥ 0
//! ```
//!
//! with v_min ≤ 0 ≤ v_max and ω_min ≤ 0 ≤ ω_max. Then u = 0 with δ large enough is feasible, the
//! objective is strictly convex in u, and the solution exists and is unique in u.
//!
//! Nothing here allocates after [`Programme::with_capacity`] and [`Solution::with_capacity`].

mod solution;

pub use solution::Solution;

use crate::config::Weights;

/// linear·x + ½ curvature·x² ≤ −decrease + δ, curvature ≥ 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Certificate {
    /// Coefficient of x.
    pub linear: f64,
    /// Coefficient of ½x².
    pub curvature: f64,
    /// Decrease Q asked for, in the certificate's unit.
    pub decrease: f64,
}

impl Certificate {
    /// linear·x + ½ curvature·x² + decrease: what the slack has to cover when positive.
    pub fn excess(&self, x: f64) -> f64 {
        (self.linear + 0.5 * self.curvature * x) * x + self.decrease
    }

    /// Derivative of [`excess`](Self::excess).
    pub fn slope(&self, x: f64) -> f64 {
        self.linear + self.curvature * x
    }
}

/// coefficient·v ≤ bound.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Row {
    /// Coefficient of v, s.
    pub coefficient: f64,
    /// Right side, m.
    pub bound: f64,
}

impl Row {
    /// coefficient·v − bound: positive when the row does not hold.
    pub fn excess(&self, v: f64) -> f64 {
        self.coefficient * v - self.bound
    }
}

/// A closed interval that contains 0.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Interval {
    /// Lower end, ≤ 0.
    pub min: f64,
    /// Upper end, ≥ 0.
    pub max: f64,
}

/// The data of one programme.
#[derive(Debug, Clone, PartialEq)]
pub struct Programme {
    /// Weights of the objective.
    pub weights: Weights,
    /// (28), in v.
    pub position: Certificate,
    /// (31), in ω.
    pub heading: Certificate,
    /// Bounds on v, m/s: the limits and the guidance's speed cap.
    pub v_mps: Interval,
    /// Bounds on ω, rad/s.
    pub omega_radps: Interval,
    /// Rows with slack, at most `capacity`.
    pub comfort: Vec<Row>,
    /// Rows without slack, at most `capacity`.
    pub safety: Vec<Row>,
    capacity: usize,
}

impl Programme {
    /// An empty programme with room for `capacity` rows of each kind.
    pub fn with_capacity(weights: Weights, capacity: usize) -> Self {
        Self {
            weights,
            position: Certificate::default(),
            heading: Certificate::default(),
            v_mps: Interval::default(),
            omega_radps: Interval::default(),
            comfort: Vec::with_capacity(capacity),
            safety: Vec::with_capacity(capacity),
            capacity,
        }
    }

    /// Becomes `other` without allocating; false, and unchanged, when its rows do not fit.
    pub fn copy_from(&mut self, other: &Self) -> bool {
        if other.comfort.len().max(other.safety.len()) > self.capacity {
            return false;
        }
        self.weights = other.weights;
        (self.position, self.heading) = (other.position, other.heading);
        (self.v_mps, self.omega_radps) = (other.v_mps, other.omega_radps);
        self.comfort.clear();
        self.comfort.extend_from_slice(&other.comfort);
        self.safety.clear();
        self.safety.extend_from_slice(&other.safety);
        true
    }

    /// Rows of each kind that fit.
    pub fn capacity(&self) -> usize {
        self.capacity
    }

    /// Removes all rows.
    pub fn clear_rows(&mut self) {
        self.comfort.clear();
        self.safety.clear();
    }

    /// Adds a comfort row; false when there is no room.
    pub fn push_comfort(&mut self, row: Row) -> bool {
        push_bounded(&mut self.comfort, row, self.capacity)
    }

    /// Adds a safety row; false when there is no room.
    pub fn push_safety(&mut self, row: Row) -> bool {
        push_bounded(&mut self.safety, row, self.capacity)
    }

    /// True when every number is finite and the signs are those that the module states.
    pub fn is_well_posed(&self) -> bool {
        let finite = |x: f64| x.abs() <= f64::MAX;
        let not_negative = |x: f64| (0.0..=f64::MAX).contains(&x);
        let certificate =
            |c: &Certificate| finite(c.linear) && finite(c.decrease) && not_negative(c.curvature);
        let interval = |i: &Interval| not_negative(-i.min) && not_negative(i.max);
        let row = |r: &Row| finite(r.coefficient) && not_negative(r.bound);
        let weight = |w: f64| w > 0.0 && w <= f64::MAX;
        let w = &self.weights;
        certificate(&self.position)
            && certificate(&self.heading)
            && interval(&self.v_mps)
            && interval(&self.omega_radps)
            && weight(w.v)
            && weight(w.omega)
            && weight(w.position)
            && weight(w.heading)
            && weight(w.comfort)
            && self.comfort.iter().all(row)
            && self.safety.iter().all(row)
    }

    /// The objective at (v, ω) with the smallest slacks.
    pub fn objective(&self, v_mps: f64, omega_radps: f64) -> f64 {
        let w = &self.weights;
        0.5 * (w.v * v_mps * v_mps + w.omega * omega_radps * omega_radps)
            + w.position * self.position.excess(v_mps).max(0.0)
            + w.heading * self.heading.excess(omega_radps).max(0.0)
            + w.comfort * self.comfort.iter().map(|r| r.excess(v_mps).max(0.0)).sum::<f64>()
    }

    /// The interval of v that the bounds and the safety rows leave. Contains 0.
    pub fn admissible_v(&self) -> Interval {
        let mut interval = self.v_mps;
        for row in &self.safety {
            if row.coefficient > 0.0 {
                interval.max = interval.max.min(row.bound / row.coefficient);
            } else if row.coefficient < 0.0 {
                interval.min = interval.min.max(row.bound / row.coefficient);
            }
        }
        interval
    }
}

/// `Vec::push` that never grows the vector.
fn push_bounded(rows: &mut Vec<Row>, row: Row, capacity: usize) -> bool {
    let room = rows.len() < capacity;
    if room {
        rows.push(row);
    }
    room
}
