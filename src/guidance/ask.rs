//! Asking parked robots to make way: when the goal is enclosed, or nothing else helped.
//!
//! The robot goes straight and stops with room for them to move, then squeezes through what they left. `giveway` is
//! the other half.

use super::Params;
use super::direction::unit;
use super::shown::Shown;
use super::types::{Drive, Ego, Limits, Memory};

/// Published as `Intent::blocked_s` while asking.
pub(super) const ASKING_S: f64 = 100.0;
/// Cosine of the heading error at which driving starts.
const ALIGNED_COS: f64 = 0.8;
/// Neighbours approached more slowly than this fraction of the speed do not matter.
const CLOSING_MIN: f64 = 0.2;

pub(super) fn drive(
    ego: &Ego,
    bearing_rad: f64,
    neighbours: &Shown,
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> Drive {
    memory.ask_s -= limits.period_s;
    memory.around.spent_s = 0.0;
    memory.fallback_s = 0.0;
    let room = if memory.ask_s > 0.5 * params.ask_s { params.ask_room_m } else { 0.0 };
    let aligned = (libm::cos(bearing_rad - ego.heading_rad) - ALIGNED_COS) / (1.0 - ALIGNED_COS);
    let h = unit(ego.heading_rad);
    let mut v = limits.v_max_mps * aligned.max(0.0);
    for n in neighbours.iter() {
        let seen = n.bearing();
        let closing = -h.dot(&seen.normal);
        if closing > CLOSING_MIN {
            // One that stands beside the goal cannot leave it free.
            let blocks = n.required_m < (neighbours.who(n.lane).position_m - ego.target_m).norm();
            v = v.min(params.row_rate * (seen.gap_m - if blocks { room * closing } else { 0.0 }).max(0.0));
        }
    }
    Drive { heading_rad: bearing_rad, direction: unit(bearing_rad), speed_cap_mps: v, intent_speed_mps: v }
}
