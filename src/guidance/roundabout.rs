//! Virtual roundabout: how far clockwise of its target a robot should steer, so that everybody converging on the
//! same place forms a ring with room enough.
//!
//! If two robots turn their preferred directions clockwise by the same β, their relative velocity turns by β too, and
//! the miss distance becomes D sin(α + β), with D the distance and α the signed angle between −relative position and
//! relative velocity. So β = asin(s / D) − α gives the lane s, without knowing who else is in the ring.

use super::params::Params;
use super::types::*;

pub fn rotation(ego: &Ego, neighbours: &[Neighbour], limits: &Limits, params: &Params) -> f64 {
    let to = ego.target_m - ego.position_m;
    let left = to.norm();
    if left < 1e-6 {
        return 0.0;
    }
    let mine = to * (limits.v_max_mps / left);
    let my_time = left / limits.v_max_mps;
    let mut beta: f64 = 0.0;
    let (mut far_left, mut far_right) = (0.0f64, 0.0f64);
    for n in neighbours.iter().take(NEIGHBOURS_MAX) {
        if n.arrived {
            continue;
        }
        let theirs = n.target_m - n.position_m;
        let their_left = theirs.norm();
        if their_left < 1e-6 {
            continue;
        }
        let relative = mine - theirs * (limits.v_max_mps / their_left);
        let offset = n.position_m - ego.position_m;
        let d = offset.norm();
        let speed = relative.norm();
        if speed < 1e-3 || d < 1e-6 {
            continue;
        }
        let along = offset.dot(&relative) / speed;
        let time = along / speed;
        if along <= 0.0 || time > my_time || time > their_left / limits.v_max_mps {
            continue;
        }
        // Positive when the neighbour already passes on the left, as the rule wants.
        let miss = cross(relative, offset) / speed;
        let alpha = libm::asin((miss / d).clamp(-1.0, 1.0));
        let lane = n.required_distance_m + params.lane_gap_m;
        let need = libm::asin((lane / d).min(1.0)) - alpha;
        if need <= 0.0 {
            continue;
        }
        // A clear miss on the other side is left alone.
        let keep = if miss >= 0.0 { 1.0 } else { (1.0 + miss / (params.lane_wrong_m)).max(0.0) };
        let soon = ((1.0 - time / params.lane_horizon_s) / 0.3).clamp(0.0, 1.0);
        beta = beta.max(need * keep * soon);
        // Later conflicts count once neighbours close in on both sides: a big ring must not shrink too far first.
        let close = (params.lane_close - d / lane).clamp(0.0, 1.0);
        if cross(mine, offset) > 0.0 {
            far_left = far_left.max(need * keep * close);
        } else {
            far_right = far_right.max(need * keep * close);
        }
    }
    beta.max(far_left.min(far_right)).min(params.lane_beta_max_rad)
}
