use crate::document::names;

/// Which control law runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Profile {
    /// Hard, sound safety rows and the FT-DCLF with reachable decrease. The default.
    #[default]
    Certified,
    /// The paper's printed programme (33) with only its typing slips mended. **Unsafe**: robots
    /// collide; here to compare with.
    Paper,
    /// `Certified` with Q = c₃V in place of the FT-DCLF: only the performance certificate differs.
    Exponential,
}

names!(Profile { Certified => "certified", Paper => "paper", Exponential => "exp" });

/// Which solver a worker runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum SolverKind {
    /// The closed-form solver: no iteration, no allocation.
    #[default]
    Exact,
    /// Clarabel's interior point method on the conic form, workspace kept between periods.
    Clarabel,
}

names!(SolverKind { Exact => "exact", Clarabel => "clarabel" });

/// How the hard barrier row bounds the approach within a period.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum BarrierForm {
    /// F1: exact for the turn rate that the heading part of the programme has decided.
    #[default]
    Exact,
    /// F2: one bound for every admissible turn rate; a little slower in dense traffic.
    Linear,
}

names!(BarrierForm { Exact => "exact", Linear => "linear" });

/// Weights of the objective (33a), at the paper's period of 80 ms. All positive.
///
/// Slacks are amounts a step and shrink with the period, v and ω do not: [`at`](Self::at) gives the
/// weights that ask for the same speeds at another period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// R₁, on v².
    pub v: f64,
    /// R₂, on ω².
    pub omega: f64,
    /// `w_p`, on the slack of the position certificate.
    pub position: f64,
    /// `w_θ`, on the slack of the heading certificate.
    pub heading: f64,
    /// `w_r`, on the slack of a comfort row.
    pub comfort: f64,
}

impl Weights {
    /// The period at which the weights are given, s.
    pub const PERIOD_S: f64 = 0.08;

    /// The weights for a period of `period_s`: those of the slacks grow as the slacks shrink.
    #[must_use]
    pub fn at(self, period_s: f64) -> Self {
        let steps = Self::PERIOD_S / period_s;
        Self {
            position: self.position * steps,
            heading: self.heading * steps,
            comfort: self.comfort * steps,
            ..self
        }
    }
}

impl Default for Weights {
    fn default() -> Self {
        Self { v: 1.0, omega: 0.5, position: 1e3, heading: 1e4, comfort: 1e4 }
    }
}

/// The control law's parameters.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ControllerConfig {
    /// Which law.
    pub profile: Profile,
    /// Which solver.
    pub solver: SolverKind,
    /// FT-DCLF gain c₃ > 0 of Definition 2. Larger asks for faster decrease.
    pub c3: f64,
    /// FT-DCLF exponent α in (0, 1). Smaller asks for relatively more near the goal.
    pub alpha: f64,
    /// Share η in (0, 1] of the largest decrease that the certificate asks for under the speed
    /// limit; below 1 it forgives a misaligned heading and the robot drives at η `v_max`.
    pub alignment: f64,
    /// Barrier rate γ in (0, 1] **per step** of the hard rows: the share of the gap that may be
    /// used up in one period. Larger allows a faster approach.
    pub gamma: f64,
    /// Form of the hard rows.
    pub barrier: BarrierForm,
    /// Barrier rate of the comfort rows, in (0, `gamma`].
    pub comfort_gamma: f64,
    /// Objective weights.
    pub weights: Weights,
    /// Whether guidance chooses the reference and caps the speed. Without it every robot heads
    /// straight for its goal (β = 0, the paper's law): safe, but robots stop nose to nose.
    pub guidance: bool,
    /// Rows kept for each robot. A robot with more neighbours that can bind is stopped and
    /// reported, never served with a truncated list.
    pub max_neighbours: usize,
}

impl Default for ControllerConfig {
    fn default() -> Self {
        Self {
            profile: Profile::default(),
            solver: SolverKind::default(),
            c3: 0.5,
            alpha: 0.6,
            alignment: 1.0,
            gamma: 1.0,
            barrier: BarrierForm::default(),
            comfort_gamma: 0.9,
            weights: Weights::default(),
            guidance: true,
            max_neighbours: 64,
        }
    }
}
