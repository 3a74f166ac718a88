//! A family for large fleets: the same traffic whatever the number of robots.

use super::fleet::{Fleet, RADIUS_M};
use super::rng::SplitMix64;
use crate::scenario::Scenario;
use std::f64::consts::{PI, TAU};

/// Share of the ground that the robots' discs cover.
const COVERED: f64 = 0.07;
/// Radius of the innermost lane, m.
const INNER_M: f64 = 16.0;
/// Lanes of a street; the next street runs the other way.
const LANES: u32 = 8;
/// Starts and goals are at most this far from their places, along the lane and across, m.
const JITTER_M: f64 = 0.15;
/// Way to a goal along the lane, m.
const LEG_M: f64 = 12.0;

/// Largest speed, m/s: that of robots in warehouses. At the paper's 5 m/s a street so full is a jam.
const SPEED_MPS: f64 = 1.5;

/// `n` robots on circular lanes around the origin, filled from the innermost; streets of eight lanes run
/// to and fro in turn. Each robot goes 12 m along its street and changes places with those of the
/// lane beside it, so that paths cross all along.
pub(super) fn field(name: &str, n: u32, seed: u64) -> Scenario {
    let mut rng = SplitMix64::new(seed);
    let pitch_m = (PI * RADIUS_M * RADIUS_M / COVERED).sqrt();
    let mut fleet = Fleet::new(name);
    fleet.at_most(SPEED_MPS);
    let mut left = n;
    for lane in 0.. {
        let lane_m = INNER_M + f64::from(lane) * pitch_m;
        // The places of a lane share its length, so each robot has its part of the ground to the digit.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few thousand
        let places = (TAU * lane_m / pitch_m) as u32;
        let towards = if (lane / LANES).is_multiple_of(2) { 1.0 } else { -1.0 };
        let goal_m = if lane.is_multiple_of(2) { lane_m + pitch_m } else { lane_m - pitch_m };
        let mut at = |angle_rad: f64, radius_m: f64| {
            let radius_m = radius_m + rng.range(-JITTER_M, JITTER_M);
            let (sin, cos) = libm::sincos(angle_rad + rng.range(-JITTER_M, JITTER_M) / radius_m);
            (radius_m * cos, radius_m * sin)
        };
        for place in 0..places.min(left) {
            let angle_rad = TAU * f64::from(place) / f64::from(places);
            let start = at(angle_rad, lane_m);
            fleet.robot(start, at(angle_rad + towards * LEG_M / lane_m, goal_m));
        }
        left = left.saturating_sub(places);
        if left == 0 {
            break;
        }
    }
    fleet.finish()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_robots_cover_seven_percent_of_the_streets() {
        let scenario = field("field-10000-1", 10_000, 1);
        let radii = || scenario.robots.iter().map(|r| r.start.position_m.norm());
        let (inner, outer) = (radii().fold(f64::MAX, f64::min), radii().fold(0.0, f64::max));
        let covered = 10_000.0 * RADIUS_M * RADIUS_M / (outer * outer - inner * inner);
        assert!((0.068..0.072).contains(&covered), "{covered}");
        let ways: Vec<f64> = scenario.robots.iter().map(|r| (r.goal_m - r.start.position_m).norm()).collect();
        assert!(ways.iter().all(|way| (11.0..13.5).contains(way)), "{ways:?}");
    }
}
