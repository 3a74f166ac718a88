use super::fleet::Fleet;
use super::rng::SplitMix64;
use crate::scenario::Scenario;
use std::f64::consts::PI;

/// The eight starts of the paper's Section IV.A, m.
const STARTS: [(f64, f64); 8] =
    [(-5.0, -0.4), (5.0, 0.4), (-0.4, 5.0), (0.4, -5.0), (3.2, 3.8), (-3.2, -3.8), (-3.8, 3.2), (3.8, -3.2)];

/// The eight goals of the paper's Section IV.A, m.
const GOALS: [(f64, f64); 8] =
    [(4.5, 0.0), (-4.5, 0.0), (0.0, -4.5), (0.0, 4.2), (-3.5, -3.4), (3.4, 3.5), (3.5, -3.4), (-3.4, 3.5)];

fn swap(name: &str) -> Fleet {
    let mut fleet = Fleet::new(name);
    for (start, goal) in STARTS.into_iter().zip(GOALS) {
        fleet.robot(start, goal);
    }
    fleet
}

/// The paper's position swap; the paper gives no headings, here each robot faces its goal.
pub(super) fn toward_goal(name: &str) -> Scenario {
    swap(name).finish()
}

/// The swap with all headings 0.
pub(super) fn all_zero(name: &str) -> Scenario {
    let mut fleet = swap(name);
    fleet.face(|| 0.0);
    fleet.finish()
}

/// The swap with headings uniform in [−π, π).
pub(super) fn random_headings(name: &str, seed: u64) -> Scenario {
    let mut fleet = swap(name);
    let mut rng = SplitMix64::new(seed);
    fleet.face(|| rng.range(-PI, PI));
    fleet.finish()
}
