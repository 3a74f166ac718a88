//! What is to be done: the robots, their starts and goals, the limits and the obstacles.
//!
//! Reads a built-in name or a TOML file (`schema = 1`); writes a checked [`Scenario`]. World frame,
//! metres, radians, seconds. Used at start-up only, so it may allocate and format.

use crate::model::{Limits, Obstacle, RobotSpec};

/// A checked scenario: ids unique, all numbers finite, starts and goals apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Name, for people and reports.
    pub name: String,
    /// A robot has arrived when it stays within this distance of its goal, m.
    pub tolerance_m: f64,
    /// Time after which the run is given up, s.
    pub duration_s: f64,
    /// Input limits and the gap to keep.
    pub limits: Limits,
    /// The fleet, in ascending order of id.
    pub robots: Vec<RobotSpec>,
    /// Everything that does not move.
    pub obstacles: Vec<Obstacle>,
}

impl Scenario {
    /// Distance ρ_ij = d_s + r_i + r_j that two centres keep, m (22).
    pub fn required_distance_m(&self, i: usize, j: usize) -> f64 {
        self.limits.safety_margin_m + self.robots[i].radius_m + self.robots[j].radius_m
    }
}
