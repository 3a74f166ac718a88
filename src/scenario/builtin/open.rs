//! Families without obstacles: the free plane.

use super::fleet::Fleet;
use super::rng::SplitMix64;
use crate::scenario::Scenario;
use std::f64::consts::{PI, TAU};

/// Arc between neighbours on a circle, m.
const CIRCLE_SPACING_M: f64 = 1.5;
/// The smallest circle has the scale of the paper's swap, m.
const CIRCLE_RADIUS_MIN_M: f64 = 5.0;

/// `n` robots on a circle, each going to the opposite point.
pub(super) fn circle(name: &str, n: u32) -> Scenario {
    let radius = (f64::from(n) * CIRCLE_SPACING_M / (2.0 * PI)).max(CIRCLE_RADIUS_MIN_M);
    let mut fleet = Fleet::new(name);
    for k in 0..n {
        let (sin, cos) = libm::sincos(TAU * f64::from(k) / f64::from(n));
        fleet.robot((radius * cos, radius * sin), (-radius * cos, -radius * sin));
    }
    fleet.finish()
}

/// Area of the square for each robot, m².
const RANDOM_AREA_M2: f64 = 9.0;
/// Between two starts, and between two goals, m: twice the required distance, so that a robot can
/// pass between two that are parked.
const RANDOM_SPACING_M: f64 = 0.9;

/// Random starts, goals and headings in a square.
pub(super) fn random(name: &str, n: u32, seed: u64) -> Scenario {
    let mut rng = SplitMix64::new(seed);
    let side_m = (RANDOM_AREA_M2 * f64::from(n)).sqrt();
    let starts = scatter(&mut rng, n, side_m);
    let goals = scatter(&mut rng, n, side_m);
    let mut fleet = Fleet::new(name);
    for (start, goal) in starts.into_iter().zip(goals) {
        fleet.robot(start, goal);
    }
    fleet.face(|| rng.range(-PI, PI));
    fleet.finish()
}

/// `n` points in a centred square, drawn again while they are closer than the spacing to another.
///
/// Terminates: what a new point must avoid, the discs of that radius around the others, covers at
/// most 29 % of the square.
fn scatter(rng: &mut SplitMix64, n: u32, side_m: f64) -> Vec<(f64, f64)> {
    let half = 0.5 * side_m;
    let mut points: Vec<(f64, f64)> = Vec::new();
    while points.len() < n as usize {
        let p = (rng.range(-half, half), rng.range(-half, half));
        let apart =
            |q: &(f64, f64)| (p.0 - q.0).powi(2) + (p.1 - q.1).powi(2) >= RANDOM_SPACING_M * RANDOM_SPACING_M;
        if points.iter().all(apart) {
            points.push(p);
        }
    }
    points
}

/// Two robots that exchange places on a line.
pub(super) fn head_on(name: &str) -> Scenario {
    facing_pair(name).finish()
}

/// The same with a third robot parked half way.
pub(super) fn head_on_parked(name: &str) -> Scenario {
    let mut fleet = facing_pair(name);
    fleet.robot((0.0, 0.0), (0.0, 0.0));
    fleet.finish()
}

fn facing_pair(name: &str) -> Fleet {
    let mut fleet = Fleet::new(name);
    fleet.robot((-5.0, 0.0), (5.0, 0.0));
    fleet.robot((5.0, 0.0), (-5.0, 0.0));
    fleet
}

/// Between neighbours in a row or a column, m.
const FILE_SPACING_M: f64 = 1.0;

/// Two rows, 8 m apart, whose robots exchange places with those opposite.
pub(super) fn rows(name: &str, n: u32) -> Scenario {
    let mut fleet = Fleet::new(name);
    let half = n.div_ceil(2);
    for k in 0..n {
        let y = (f64::from(k % half) - f64::from(half - 1) / 2.0) * FILE_SPACING_M;
        let x = if k < half { -4.0 } else { 4.0 };
        fleet.robot((x, y), (-x, y));
    }
    fleet.finish()
}

/// Two columns in single file, one going east and one going north, that cross at the origin.
pub(super) fn columns(name: &str, n: u32) -> Scenario {
    let mut fleet = Fleet::new(name);
    let half = n.div_ceil(2);
    for k in 0..n {
        let place = k % half;
        let start = 3.0 + f64::from(place) * FILE_SPACING_M;
        // Who leads also parks farthest, so nobody has to overtake.
        let goal = 3.0 + f64::from(half - 1 - place) * FILE_SPACING_M;
        if k < half {
            fleet.robot((-start, 0.0), (goal, 0.0));
        } else {
            fleet.robot((0.0, -start), (0.0, goal));
        }
    }
    fleet.finish()
}
