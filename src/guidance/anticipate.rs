//! Anticipation: candidate headings scored against the predicted motion of the neighbours.
//!
//! Everybody is assumed to turn to the heading it published, to hold it for `hold_s`, then to steer to its target. The
//! ego is rolled out the same way for every candidate (a heading and a share of the full speed), slowed by what the
//! hard rows would allow. The cost of a candidate is
//!
//!   time lost against the straight way + Σ_j worst closeness to j + deflection, change of heading, slowness,
//!
//! all in seconds. Right turns cost less than left ones, so that mirrored robots choose the same side. At most
//! 57 candidates x 16 steps x 16 neighbours; most candidates are given up early (`scene`).

#![expect(clippy::too_many_arguments, reason = "what a rule reads, and what it remembers")]

use super::Params;
use super::direction::unit;
use super::predict::{Predictions, align};
use super::scene::Asked;
use super::shown::Shown;
use super::types::{Drive, Ego, Limits, Memory, NEIGHBOURS_MAX, ObstacleView, Plan};
use super::{bypass, roundabout};
use crate::geometry::{Vec2, rotate};

/// Least share of `parked_margin_m` after long going around.
const PATIENCE_MIN: f64 = 0.05;
/// This near to its target a robot in a crowd decides every time.
const CROWD_TARGET_M: f64 = 2.0;
/// Times at which the robots of a crowd decide.
const PHASES: u32 = 16;
/// Neighbours farther than this do not slow the robot.
const STANDOFF_RANGE_M: f64 = 1.5;

/// The normal case: turn the target by the way around parked robots or by the roundabout, then choose the best candidate.
pub(super) fn drive(
    ego: &Ego,
    neighbours: &Shown,
    obstacles: &[ObstacleView],
    queue_mps: Option<f64>,
    limits: &Limits,
    params: &Params,
    predictions: &mut Predictions,
    memory: &mut Memory,
) -> Drive {
    memory.beta_rad = 0.0;
    let to_target = ego.target_m - ego.position_m;
    let around = bypass::rotation(ego, neighbours, limits, params, memory);
    if around != 0.0 || !holds(ego, neighbours, limits, params, memory) {
        let turn_rad =
            if around == 0.0 { -roundabout::rotation(ego, neighbours, limits, params) } else { around };
        memory.intent.target_m = ego.position_m + turned(to_target, turn_rad);
        // The longer it takes to get past parked robots, the closer it may pass.
        let patience = (1.0 - memory.around.spent_s / params.squeeze_s).clamp(PATIENCE_MIN, 1.0);
        let target_m = memory.intent.target_m;
        let previous_rad = memory.intent.heading_rad;
        let asked = Asked { ego, target_m, neighbours, obstacles, limits, params, patience, previous_rad };
        memory.plan = Plan { turn_rad, ..asked.best(predictions) };
    } else {
        memory.intent.target_m = ego.position_m + turned(to_target, memory.plan.turn_rad);
    }
    let best = memory.plan;

    let (h, direction) = (unit(ego.heading_rad), unit(best.heading_rad));
    let mut v = limits.v_max_mps * best.share * align(h.dot(&direction), params);
    v = v.min(arc_speed(h, to_target, to_target.norm(), limits, params));
    // Stop short of contact while not blocked, so that there is room left to slip aside.
    let calm = (1.0 - memory.progress.blocked_s / params.blocked_enter_s.max(limits.period_s)).max(0.0);
    // From there on nobody slows it, whichever way he is: the speed that he leaves only grows.
    let slowing = neighbours.within(params.standoff_m * calm + v / params.row_rate);
    for lane in slowing {
        let seen = neighbours.at(lane).bearing();
        let closing = -h.dot(&seen.normal);
        if seen.gap_m < STANDOFF_RANGE_M && closing > 1e-6 {
            v = v.min(params.row_rate * (seen.gap_m - params.standoff_m * calm).max(0.0) / closing);
        }
    }
    if let Some(q) = queue_mps
        && memory.progress.queued_s < params.queue_patience_s
    {
        v = v.min(q);
    }
    Drive {
        heading_rad: best.heading_rad,
        direction,
        speed_cap_mps: v,
        intent_speed_mps: best.mean_speed_mps,
    }
}

/// `v` turned counter-clockwise.
fn turned(v: Vec2, angle_rad: f64) -> Vec2 {
    if angle_rad == 0.0 {
        return v;
    }
    let direction = unit(angle_rad);
    rotate(v, direction.x, direction.y)
}

/// Speed at which the arc of the largest turn rate still reaches the target instead of circling it.
pub(super) fn arc_speed(h: Vec2, to: Vec2, left: f64, limits: &Limits, params: &Params) -> f64 {
    let sideways = h.perp(&to).abs();
    if sideways > 1e-9 {
        params.arc_gain * limits.omega_max_radps * left * left / (2.0 * sideways)
    } else {
        f64::INFINITY
    }
}

/// Whether a robot in a crowd keeps to what it decided. Nobody gets far there in a few periods, and who decides at
/// another time than those around it sees what they have decided.
fn holds(ego: &Ego, neighbours: &Shown, limits: &Limits, params: &Params, memory: &mut Memory) -> bool {
    let near = |apart_m: Vec2, m: f64| apart_m.norm_squared() < m * m;
    let crowded = near(neighbours.at(NEIGHBOURS_MAX - 1).apart_m, params.crowd_m)
        && !near(ego.target_m - ego.position_m, CROWD_TARGET_M);
    if !crowded {
        memory.crowded_s = 0.0;
        return false;
    }
    if memory.crowded_s == 0.0 {
        // Not all of a crowd at the same time.
        memory.crowded_s =
            limits.period_s + params.crowd_hold_s * f64::from(ego.id % PHASES) / f64::from(PHASES);
        return false;
    }
    memory.crowded_s += limits.period_s;
    let over = memory.crowded_s > params.crowd_hold_s + 0.5 * limits.period_s;
    if over {
        memory.crowded_s = limits.period_s;
    }
    !over
}
