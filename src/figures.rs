//! Stand-in until the control figures are merged.
use crate::scenario::Scenario;
use crate::wire::{RobotState, RobotTelemetry, state_flags};
use serde::Serialize;

/// Figures.
#[derive(Debug, Clone, Serialize)]
pub struct ControlFigures {
    /// Robots that arrived.
    pub arrived: usize,
    /// Pairs that came too close.
    pub violations: usize,
    /// Smallest clearance.
    pub min_clearance_m: f64,
}

/// Accumulates.
#[derive(Debug)]
pub struct Accumulator {
    required: Vec<Vec<f64>>,
    min: f64,
    arrived: usize,
}

impl Accumulator {
    /// New.
    pub fn new(scenario: &Scenario, _period_s: f64) -> Self {
        let n = scenario.robots.len();
        let required = (0..n).map(|i| (0..n).map(|j| scenario.required_distance_m(i, j)).collect()).collect();
        Self { required, min: f64::INFINITY, arrived: 0 }
    }
    /// One state sample.
    pub fn observe_period(&mut self, _tick: u64, states: &[RobotState]) {
        self.arrived = states.iter().filter(|s| s.has(state_flags::ARRIVED) && s.v_mps == 0.0).count();
        for i in 0..states.len() {
            for j in 0..i {
                let d = (states[i].position_m() - states[j].position_m()).norm() - self.required[i][j];
                self.min = self.min.min(d);
            }
        }
    }
    /// One solve.
    pub fn observe_solve(&mut self, _telemetry: &RobotTelemetry) {}
    /// How many arrived.
    pub fn arrived(&self) -> usize {
        self.arrived
    }
    /// Smallest clearance.
    pub fn min_clearance_m(&self) -> f64 {
        self.min
    }
    /// Figures.
    pub fn finish(&self) -> ControlFigures {
        ControlFigures {
            arrived: self.arrived,
            violations: usize::from(self.min < -1e-9),
            min_clearance_m: self.min,
        }
    }
}
