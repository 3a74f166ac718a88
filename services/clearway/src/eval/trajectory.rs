//! What every robot did in every period, for plots and for evaluators other than our own.

use clearway::config::Config;
use clearway::wire::RobotState;
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::{self, Write};

/// What the numbers of a state are, in their order.
const COLUMNS: [&str; 5] = ["x_m", "y_m", "theta_rad", "v_mps", "omega_radps"];

/// One line of the file: a run.
#[derive(Debug, Serialize)]
pub(super) struct Trajectory {
    scenario: String,
    profile: &'static str,
    solver: &'static str,
    timing: &'static str,
    plant: &'static str,
    period_s: f64,
    /// Robots in the order of the states.
    ids: Vec<u32>,
    columns: [&'static str; 5],
    /// For every period and robot the pose at its start and the input held over it.
    states: Vec<Vec<[f64; 5]>>,
}

impl Trajectory {
    pub(super) fn new(config: &Config, timing: &'static str) -> Self {
        Self {
            scenario: config.scenario.name.clone(),
            profile: config.controller.profile.name(),
            solver: config.controller.solver.name(),
            timing,
            plant: config.source.plant.name(),
            period_s: config.timing.period_s(),
            ids: config.scenario.robots.iter().map(|robot| robot.id.0).collect(),
            columns: COLUMNS,
            states: Vec::new(),
        }
    }

    pub(super) fn push(&mut self, fleet: &[RobotState]) {
        let state = |r: &RobotState| [r.x_m, r.y_m, r.theta_rad, r.v_mps, r.omega_radps];
        self.states.push(fleet.iter().map(state).collect());
    }
}

/// Writes runs that end in any order as lines in their order, each as soon as it may.
#[derive(Debug)]
pub(super) struct Ordered<W> {
    out: W,
    next: usize,
    waiting: BTreeMap<usize, String>,
}

impl<W: Write> Ordered<W> {
    pub(super) fn new(out: W) -> Self {
        Self { out, next: 0, waiting: BTreeMap::new() }
    }

    /// Takes the `k`-th line, without its end.
    pub(super) fn put(&mut self, k: usize, line: String) -> io::Result<()> {
        self.waiting.insert(k, line);
        while let Some(line) = self.waiting.remove(&self.next) {
            writeln!(self.out, "{line}")?;
            self.next += 1;
        }
        Ok(())
    }

    /// Writes out what is buffered.
    pub(super) fn finish(mut self) -> io::Result<()> {
        self.out.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::Ordered;

    #[test]
    fn lines_come_out_in_their_order() {
        let mut out = Vec::new();
        let mut ordered = Ordered::new(&mut out);
        for k in [2, 0, 3, 1] {
            ordered.put(k, k.to_string()).unwrap();
        }
        ordered.finish().unwrap();
        assert_eq!(out, b"0\n1\n2\n3\n");
    }
}
