//! Progress: motion, turning one way on the spot, or waiting in a queue that moves. The rest counts as blocked.

use super::Params;
use super::types::{Ego, Limits, Memory};

/// A queue that leaves less speed than this makes the robot wait.
const QUEUE_STOP_MPS: f64 = 0.3;
/// Share of the largest possible turn that counts as turning one way.
const TURNING_SHARE: f64 = 0.6;

/// Brings the counters up to date and starts the escalations they call for. Returns whether the robot moves.
pub(super) fn update(
    ego: &Ego,
    queue: Option<f64>,
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> bool {
    let distance = (ego.target_m - ego.position_m).norm();
    let full_speed = limits.v_max_mps.min(distance / limits.period_s);
    let moving = ego.v_mps > params.moving_fraction * full_speed;
    let p = &mut memory.progress;
    let waiting = queue.is_some_and(|v| v < QUEUE_STOP_MPS) && p.queued_s < params.queue_patience_s;
    p.queued_s = if moving || queue.is_none() { 0.0 } else { p.queued_s + limits.period_s };
    if waiting {
        p.blocked_s = (p.blocked_s - limits.period_s).max(0.0);
        memory.fallback_s = 0.0;
    } else if moving {
        p.still_s = 0.0;
        p.turned_rad = 0.0;
        p.blocked_s = (p.blocked_s - 2.0 * limits.period_s).max(0.0);
    } else {
        p.still_s += limits.period_s;
        p.turned_rad += ego.omega_radps * limits.period_s;
        // Turning to and fro is no progress.
        let due = TURNING_SHARE * limits.omega_max_radps * (p.still_s - 2.0 * limits.period_s);
        if p.turned_rad.abs() < due {
            p.blocked_s += limits.period_s;
        }
    }
    if p.blocked_s > params.ask_after_s && memory.ask_s <= 0.0 && memory.way.rest_s <= 0.0 {
        memory.ask_s = params.ask_s;
        p.blocked_s = 0.0;
    }
    if p.blocked_s > params.blocked_enter_s {
        memory.fallback_s = params.fallback_hold_s;
    }
    moving
}
