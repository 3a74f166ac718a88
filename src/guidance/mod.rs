//! Guidance: where each robot steers and how fast it may go, so that robots do not deadlock.
//!
//! Reads the snapshot of the tick (states, targets and the intents published last tick), the static obstacles and the
//! robot's own memory; writes the reference p_ref = p + R(β)(p_target − p), a speed cap and the intent to publish.
//! Deterministic and decentralised: no robot needs more than its nearest `NEIGHBOURS_MAX` neighbours. Bounded cost, no
//! allocation, no panic. Safety never depends on it: the hard rows hold for any reference.
//!
//! The rules, the first that applies decides:
//! 1. `giveway`: leave the way of a blocked robot of higher rank;
//! 2. `ask`: go straight and have parked robots make way;
//! 3. `halfplane`: the right-hand rule, when blocked;
//! 4. `anticipate`: the normal case. The target is turned by `bypass` (around parked robots) or `roundabout` (clockwise
//!    with everybody who converges), then candidate headings are scored against everybody's predicted motion. `queue`
//!    keeps order at openings.
//!
//! `contact` bends the result where something is touched.

use crate::geometry::{bearing, wrap};
mod anticipate;
mod ask;
mod bypass;
mod candidates;
pub(crate) mod checkpoint;
mod contact;
mod direction;
mod giveway;
mod halfplane;
mod lanes;
mod others;
mod predict;
mod progress;
mod queue;
mod rollout;
mod roundabout;
mod route;
mod scene;
mod shown;
mod types;

pub use crate::config::GuidanceParams as Params;
pub use predict::Predictions;
pub use route::{Route, RouteBuilder};
pub use shown::{Listed, Shown};
pub use types::{
    Ego, Guidance, Intent, Limits, Memory, NEIGHBOURS_MAX, Neighbour, OBSTACLES_MAX, ObstacleView,
};

use types::Progress;

/// A robot without progress for longer is counted as stalled.
const STALLED_S: f64 = 1.0;

/// Decides for one robot and one tick. `neighbours`, listed for where it is, and `obstacles`: nearest first, the id
/// breaking ties.
pub fn guide(
    ego: &Ego,
    neighbours: &Shown,
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    predictions: &mut Predictions,
    memory: &mut Memory,
) -> Guidance {
    let obstacles = &obstacles[..obstacles.len().min(OBSTACLES_MAX)];
    let to_target = ego.target_m - ego.position_m;
    let bearing = bearing(to_target);
    if !memory.started {
        memory.started = true;
        memory.way.rank = ego.id;
        memory.intent.heading_rad = bearing;
    }
    memory.intent.target_m = ego.target_m;

    let spot = giveway::spot(ego, neighbours, obstacles, limits, params, memory);
    if ego.arrived && spot.is_none() {
        return hold(ego, limits, memory);
    }
    let queue = queue::speed_cap(ego, neighbours, params);
    let moving = progress::update(ego, queue, limits, params, memory);

    let drive = if let Some(spot) = spot {
        giveway::drive(ego, spot, limits)
    } else if memory.ask_s > 0.0 {
        ask::drive(ego, bearing, neighbours, limits, params, memory)
    } else if memory.fallback_s > 0.0 {
        // Only motion ends the right-hand rule: turning on the spot takes longer than any timer.
        if moving {
            memory.fallback_s -= limits.period_s;
        }
        halfplane::drive(ego, neighbours, obstacles, limits, params, &mut memory.beta_rad)
    } else {
        anticipate::drive(ego, neighbours, obstacles, queue, limits, params, predictions, memory)
    };

    let touching = if memory.progress.still_s > params.slide_after_s { neighbours.len() } else { 0 };
    let (heading_rad, direction) = contact::slide(ego, &drive, neighbours.iter().take(touching), obstacles);
    let intent = Intent {
        heading_rad,
        speed_mps: drive.intent_speed_mps,
        target_m: memory.intent.target_m,
        blocked_s: if memory.ask_s > 0.0 { ask::ASKING_S } else { memory.progress.blocked_s },
        rank: memory.way.rank,
    };
    // Not read back: what has been written number by number is not there yet for who reads several.
    memory.intent = intent;
    let beta_rad = wrap(heading_rad - bearing);
    Guidance {
        // The spot to give way at is no target: V has nothing to say about it, only the direction counts.
        reference_m: ego.position_m
            + direction * if spot.is_some() { limits.v_max_mps } else { to_target.norm() },
        speed_cap_mps: drive.speed_cap_mps,
        beta_rad,
        intent,
        stalled: memory.progress.blocked_s > STALLED_S,
        leave_goal: spot.is_some(),
    }
}

/// An arrived robot stays, and publishes that it does.
fn hold(ego: &Ego, limits: &Limits, memory: &mut Memory) -> Guidance {
    memory.progress = Progress::default();
    memory.intent = Intent {
        heading_rad: ego.heading_rad,
        speed_mps: 0.0,
        target_m: ego.target_m,
        blocked_s: 0.0,
        rank: ego.id,
    };
    Guidance {
        reference_m: ego.target_m,
        speed_cap_mps: limits.v_max_mps,
        beta_rad: 0.0,
        intent: memory.intent,
        stalled: false,
        leave_goal: false,
    }
}
