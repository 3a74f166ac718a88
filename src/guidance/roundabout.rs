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

use super::Params;
use super::types::{Ego, Limits, Neighbour};

/// Share of the horizon over which a conflict fades in.
const FADE: f64 = 0.3;

/// Clockwise rotation of the target, rad, in [0, `lane_beta_max_rad`].
pub(super) fn rotation(ego: &Ego, neighbours: &[Neighbour], limits: &Limits, params: &Params) -> f64 {
    let to = ego.target_m - ego.position_m;
    let left = to.norm();
    if left < 1e-6 {
        return 0.0;
    }
    let mine = to * (limits.v_max_mps / left);
    let my_time = left / limits.v_max_mps;
    let (mut left_side, mut right_side) = (Side::default(), Side::default());
    for n in neighbours.iter().filter(|n| !n.arrived) {
        let theirs = n.target_m - n.position_m;
        let their_left = theirs.norm();
        if their_left < 1e-6 {
            continue;
        }
        let relative = mine - theirs * (limits.v_max_mps / their_left);
        let offset = n.position_m - ego.position_m;
        let approach = offset.dot(&relative);
        // Diverging.
        if approach <= 0.0 {
            continue;
        }
        let d = offset.norm();
        let speed = relative.norm();
        if speed < 1e-3 || d < 1e-6 {
            continue;
        }
        let time = approach / speed / speed;
        // One of them is at its target before they meet.
        if time > my_time || time > their_left / limits.v_max_mps {
            continue;
        }
        // Positive when the neighbour stays on the left, as the rule wants.
        let miss = relative.perp(&offset) / speed;
        let lane = n.required_distance_m + params.lane_gap_m;
        let need = libm::asin((lane / d).min(1.0)) - libm::asin((miss / d).clamp(-1.0, 1.0));
        if need <= 0.0 {
            continue;
        }
        // A clear miss on the other side is left alone.
        let keep = if miss >= 0.0 { 1.0 } else { (1.0 + miss / params.lane_wrong_m).max(0.0) };
        let soon = ((1.0 - time / params.lane_horizon_s) / FADE).clamp(0.0, 1.0);
        // Later conflicts count once neighbours close in on both sides: a big ring must not shrink too far first.
        let close = (params.lane_close - d / lane).clamp(0.0, 1.0);
        let side = if mine.perp(&offset) > 0.0 { &mut left_side } else { &mut right_side };
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
