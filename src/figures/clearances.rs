use super::VIOLATION_M;
use crate::geometry::{TimedArc, min_distance_timed};
use crate::scenario::Scenario;

/// The smallest clearance of robots whose true motion is known piece by piece, over continuous time.
///
/// For robots that live outside of the daemon. Not for real-time threads.
#[derive(Debug, Clone)]
pub struct Clearances {
    scenario: Scenario,
    min_clearance_m: f64,
    /// One for each robot with each before it, then with each obstacle.
    violated: Vec<bool>,
}

impl Clearances {
    /// None so far, for the robots and obstacles of `scenario`.
    pub fn new(scenario: &Scenario) -> Self {
        let (robots, obstacles) = (scenario.robots.len(), scenario.obstacles.len());
        let violated = vec![false; robots * (robots + obstacles)];
        Self { scenario: scenario.clone(), min_clearance_m: f64::INFINITY, violated }
    }

    /// Adds motions, those of one robot in the order of time, for each robot in the scenario's order.
    /// What is compared with each other has to come in one call.
    pub fn add(&mut self, motions: &[Vec<TimedArc>]) {
        let bodies = self.scenario.robots.len() + self.scenario.obstacles.len();
        for (i, own) in motions.iter().enumerate().take(self.scenario.robots.len()) {
            for (j, other) in motions.iter().enumerate().take(i) {
                if let Some(distance_m) = min_distance_timed(own, other) {
                    self.note(i * bodies + j, distance_m - self.scenario.required_distance_m(i, j));
                }
            }
            for k in 0..self.scenario.obstacles.len() {
                let obstacle = self.scenario.obstacles[k];
                let keep_m = self.scenario.limits.safety_margin_m
                    + self.scenario.robots[i].radius_m
                    + obstacle.reach_m();
                for piece in own {
                    let distance_m = obstacle.min_core_distance(&piece.arc, piece.duration_s()).upper_m;
                    self.note(i * bodies + self.scenario.robots.len() + k, distance_m - keep_m);
                }
            }
        }
    }

    fn note(&mut self, pair: usize, clearance_m: f64) {
        self.min_clearance_m = self.min_clearance_m.min(clearance_m);
        self.violated[pair] |= clearance_m < VIOLATION_M;
    }

    /// Smallest distance beyond the required one, m; `None` when nobody was near anybody.
    pub fn min_clearance_m(&self) -> Option<f64> {
        self.min_clearance_m.is_finite().then_some(self.min_clearance_m)
    }

    /// Pairs, of robots or of a robot and an obstacle, that came closer than they may.
    pub fn violations(&self) -> usize {
        self.violated.iter().filter(|violated| **violated).count()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Arc, Pose};

    fn drive(from_ns: u64, x_m: f64, v_mps: f64) -> TimedArc {
        let arc = Arc { start: Pose::new(x_m, 0.0, 0.0), v_mps, omega_radps: 0.0 };
        TimedArc { from_ns, to_ns: from_ns + 1_000_000_000, arc }
    }

    #[test]
    fn clearance_counts_pairs_and_obstacles_once_each() {
        let text = "schema = 1\nname = \"row\"\n[limits]\nsafety_margin_m = 0.1\n\
            [[robot]]\nid = 4\nradius_m = 0.2\nstart = { x_m = 0, y_m = 0 }\ngoal = { x_m = 3, y_m = 0 }\n\
            [[robot]]\nid = 7\nradius_m = 0.2\nstart = { x_m = 5, y_m = 0 }\ngoal = { x_m = 5, y_m = 0 }\n\
            [[obstacle]]\ncircle = { x_m = 8, y_m = 0, radius_m = 1 }\n";
        let scenario = Scenario::parse(text, "row.toml").unwrap();
        let mut clearances = Clearances::new(&scenario);
        assert_eq!((clearances.min_clearance_m(), clearances.violations()), (None, 0));
        clearances.add(&[vec![drive(0, 0.0, 3.0)], vec![drive(0, 5.0, 0.0)]]);
        // Two metres less the radii and the margin; the obstacle is further.
        assert!((clearances.min_clearance_m().unwrap() - 1.5).abs() < 1e-12);
        for _ in 0..3 {
            clearances.add(&[vec![drive(0, 4.0, 0.6)], vec![drive(0, 5.0, 0.0)]]);
        }
        assert!((clearances.min_clearance_m().unwrap() + 0.1).abs() < 1e-12);
        assert_eq!(clearances.violations(), 1);
        clearances.add(&[vec![], vec![drive(0, 6.0, 1.0)]]);
        assert_eq!(clearances.violations(), 2);
    }
}
