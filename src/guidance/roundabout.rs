//! Virtual roundabout: how far clockwise of its target a robot steers, so that everybody converging on the same place
//! forms a ring with room enough.
//!
//! Let two robots drive straight to their targets at full speed: d their distance, α the signed angle between the line
//! to the other and the relative velocity, so that they miss each other by d sin α. If both turn clockwise by the same
//! β, the relative velocity turns by β too and the miss distance becomes d sin(α + β). Hence
//!
//!   β = max over converging neighbours of asin(s / d) − α,  s = ρ + `lane_gap_m`,
//!
//! gives everybody a lane of width s. On a circle of N robots it is the ring of circumference N s, and no robot needs
//! to know N. It depends on positions and targets only, so it does not oscillate.

#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::Params;
use super::shown::Shown;
use super::types::{Ego, Limits, NEIGHBOURS_MAX};
use crate::geometry::Vec2;

/// Share of the horizon over which a conflict fades in.
const FADE: f64 = 0.3;

/// Clockwise rotation of the target, rad, in [0, `lane_beta_max_rad`].
pub(super) fn rotation(ego: &Ego, neighbours: &Shown, limits: &Limits, params: &Params) -> f64 {
    let to = ego.target_m - ego.position_m;
    let left = to.norm();
    if left < 1e-6 {
        return 0.0;
    }
    let mine = to * (limits.v_max_mps / left);
    let my_time = left / limits.v_max_mps;
    let meetings = Meetings::of(neighbours, mine, my_time, limits, params);
    let (mut left_side, mut right_side) = (Side::default(), Side::default());
    for at in 0..NEIGHBOURS_MAX {
        if !meetings.matters[at] {
            continue;
        }
        let (d, miss, lane) = (meetings.distance_m[at], meetings.miss_m[at], meetings.lane_m[at]);
        // A clear miss on the other side is left alone.
        let keep = if miss >= 0.0 { 1.0 } else { (1.0 + miss / params.lane_wrong_m).max(0.0) };
        let soon = ((1.0 - meetings.time_s[at] / params.lane_horizon_s) / FADE).clamp(0.0, 1.0);
        // Later conflicts count once neighbours close in on both sides: a big ring must not shrink too far first.
        let close = (params.lane_close - d / lane).clamp(0.0, 1.0);
        if keep * soon.max(close) == 0.0 {
            continue;
        }
        let need = libm::asin((lane / d).min(1.0)) - libm::asin((miss / d).clamp(-1.0, 1.0));
        if need <= 0.0 {
            continue;
        }
        let side = if meetings.side[at] > 0.0 { &mut left_side } else { &mut right_side };
        side.now_rad = side.now_rad.max(need * keep * soon);
        side.later_rad = side.later_rad.max(need * keep * close);
    }
    let single = params.lane_single * left_side.now_rad.max(right_side.now_rad);
    let now = left_side.now_rad.min(right_side.now_rad);
    let later = left_side.later_rad.min(right_side.later_rad);
    single.max(now).max(later).min(params.lane_beta_max_rad)
}

/// Largest turns that the neighbours on one side ask for.
#[derive(Clone, Copy, Default)]
struct Side {
    now_rad: f64,
    later_rad: f64,
}

/// How the robot meets its neighbours when all drive straight on; one number for each of them.
struct Meetings {
    distance_m: [f64; NEIGHBOURS_MAX],
    /// Until they are nearest to each other.
    time_s: [f64; NEIGHBOURS_MAX],
    /// How near that is; positive when the neighbour stays on the left, as the rule wants.
    miss_m: [f64; NEIGHBOURS_MAX],
    /// Positive for those on the left.
    side: [f64; NEIGHBOURS_MAX],
    /// Width of the lane between them.
    lane_m: [f64; NEIGHBOURS_MAX],
    matters: [bool; NEIGHBOURS_MAX],
}

impl Meetings {
    /// Of all of them side by side, without a branch: which of them matter is hard to guess.
    fn of(neighbours: &Shown, mine: Vec2, my_time: f64, limits: &Limits, params: &Params) -> Self {
        let none = [0.0; NEIGHBOURS_MAX];
        let (mut x, mut y, mut to_x, mut to_y, mut lane_m) = (none, none, none, none, none);
        let mut drives = [false; NEIGHBOURS_MAX];
        for (at, n) in neighbours.iter().enumerate() {
            (x[at], y[at]) = (-n.apart_m.x, -n.apart_m.y);
            let to_target = neighbours.towards_target(at);
            (to_x[at], to_y[at]) = (to_target.x, to_target.y);
            lane_m[at] = n.required_m + params.lane_gap_m;
            drives[at] = !neighbours.is_parked(at);
        }
        let v_max = limits.v_max_mps;
        let mut all =
            Self { distance_m: none, time_s: none, miss_m: none, side: none, lane_m, matters: drives };
        for at in 0..NEIGHBOURS_MAX {
            let their_left = (to_x[at] * to_x[at] + to_y[at] * to_y[at]).sqrt();
            let share = v_max / their_left;
            let (relative_x, relative_y) = (mine.x - to_x[at] * share, mine.y - to_y[at] * share);
            let approach = x[at] * relative_x + y[at] * relative_y;
            let d = (x[at] * x[at] + y[at] * y[at]).sqrt();
            let speed = (relative_x * relative_x + relative_y * relative_y).sqrt();
            let time = approach / speed / speed;
            let miss = (relative_x * y[at] - relative_y * x[at]) / speed;
            (all.distance_m[at], all.time_s[at], all.miss_m[at]) = (d, time, miss);
            all.side[at] = mine.x * y[at] - mine.y * x[at];
            // They come nearer, neither is at its target before they meet, and it is no clear miss.
            all.matters[at] = drives[at]
                & (their_left >= 1e-6)
                & (approach > 0.0)
                & (speed >= 1e-3)
                & (d >= 1e-6)
                & (time <= my_time)
                & (time <= their_left / v_max)
                & (miss < lane_m[at]);
        }
        all
    }
}
