//! Guidance: where each robot steers and how fast it may go, so that robots do not deadlock.
pub mod anticipate;
pub mod bypass;
pub mod giveway;
pub mod halfplane;
pub mod params;
pub mod queue;
pub mod roundabout;
pub mod route;
pub mod types;

pub use params::Params;
pub use route::Route;
pub use types::*;

/// Published as `blocked_s` by a robot that asks parked ones to make way.
const ASKING_S: f64 = 100.0;

pub fn guide(
    ego: &Ego,
    neighbours: &[Neighbour],
    obstacles: &[ObstacleView],
    limits: &Limits,
    params: &Params,
    memory: &mut Memory,
) -> Guidance {
    let to_target = ego.target_m - ego.position_m;
    let distance = to_target.norm();
    let bearing = libm::atan2(to_target.y, to_target.x);
    if !memory.started {
        memory.started = true;
        memory.rank = ego.id;
        memory.intent = Intent {
            heading_rad: bearing,
            speed_mps: limits.v_max_mps,
            blocked_s: 0.0,
            target_m: ego.target_m,
            rank: ego.id,
        };
    }
    let spot = giveway::spot(ego, neighbours, obstacles, limits, params, memory);
    if ego.arrived && spot.is_none() {
        memory.blocked_s = 0.0;
        memory.intent = Intent {
            heading_rad: ego.heading_rad,
            speed_mps: 0.0,
            blocked_s: 0.0,
            target_m: ego.target_m,
            rank: ego.id,
        };
        return Guidance {
            reference_m: ego.target_m,
            speed_cap_mps: limits.v_max_mps,
            beta_rad: 0.0,
            intent: memory.intent,
            stalled: false,
            leave_goal: false,
        };
    }
    // Progress is motion, or turning on the spot toward what was decided.
    let moving = ego.v_mps > params.moving_fraction * limits.v_max_mps.min(distance / limits.period_s);
    // Waiting in a queue is not being blocked, unless the queue itself does not move.
    let queue = queue::speed_cap(ego, neighbours, params);
    let waiting = queue.is_some_and(|v| v < 0.3) && memory.queued_s < params.queue_patience_s;
    memory.queued_s = if moving || queue.is_none() { 0.0 } else { memory.queued_s + limits.period_s };
    if waiting {
        memory.blocked_s = (memory.blocked_s - limits.period_s).max(0.0);
        memory.fallback_s = 0.0;
    } else if moving {
        memory.still_s = 0.0;
        memory.turned_rad = 0.0;
        memory.blocked_s = (memory.blocked_s - 2.0 * limits.period_s).max(0.0);
    } else {
        memory.still_s += limits.period_s;
        memory.turned_rad += ego.omega_radps * limits.period_s;
        // Turning one way counts as progress, turning to and fro does not.
        if memory.turned_rad.abs() < 0.6 * limits.omega_max_radps * (memory.still_s - 2.0 * limits.period_s) {
            memory.blocked_s += limits.period_s;
        }
    }
    if memory.blocked_s > params.ask_after_s && memory.straight_s <= 0.0 && memory.rest_s <= 0.0 {
        memory.straight_s = params.straight_s;
        memory.blocked_s = 0.0;
    }
    if memory.blocked_s > params.blocked_enter_s {
        memory.fallback_s = params.fallback_hold_s;
    }
    let (heading, cap, intent_speed);
    memory.intent.target_m = ego.target_m;
    if let Some(spot) = spot {
        let to = spot - ego.position_m;
        heading = if to.norm() > 0.05 { libm::atan2(to.y, to.x) } else { ego.heading_rad };
        let e = wrap(heading - ego.heading_rad).abs();
        cap = (to.norm() / limits.period_s).min(0.4 * limits.v_max_mps) * (1.0 - 2.0 * e).max(0.0);
        intent_speed = cap;
    } else if memory.straight_s > 0.0 {
        // Asking parked robots to make way: straight on, and stop with room for them to move.
        memory.straight_s -= limits.period_s;
        memory.around_s = 0.0;
        memory.fallback_s = 0.0;
        heading = bearing;
        // First wait with room for them to move, then squeeze through what they left.
        let ask_room = if memory.straight_s > 0.5 * params.straight_s { params.ask_room_m } else { 0.0 };
        let h = unit(ego.heading_rad);
        let mut v = limits.v_max_mps * ((libm::cos(heading - ego.heading_rad) - 0.8) / 0.2).max(0.0);
        for n in neighbours.iter().take(NEIGHBOURS_MAX) {
            let offset = ego.position_m - n.position_m;
            let d = offset.norm().max(1e-6);
            let closing = -h.dot(&offset) / d;
            if closing > 0.2 {
                let room =
                    if n.required_distance_m < (n.position_m - ego.target_m).norm() { ask_room } else { 0.0 };
                v = v.min(params.row_rate * (d - n.required_distance_m - room * closing).max(0.0));
            }
        }
        cap = v;
        intent_speed = v;
    } else if memory.fallback_s > 0.0 {
        // Only motion ends the fallback: turning on the spot takes longer than any timer.
        if moving {
            memory.fallback_s -= limits.period_s;
        }
        let c = halfplane::choose(ego, neighbours, obstacles, limits, params, memory.beta_rad);
        memory.beta_rad = c.beta_rad;
        heading = libm::atan2(c.direction.y, c.direction.x);
        let e = wrap(heading - ego.heading_rad).abs();
        cap = c.speed_mps * (1.0 - params.align_slope * e).max(0.0);
        intent_speed = c.speed_mps;
    } else {
        memory.beta_rad = 0.0;
        let around = bypass::rotation(ego, neighbours, limits, params, memory);
        let turn =
            if around != 0.0 { -around } else { roundabout::rotation(ego, neighbours, limits, params) };
        let (s, c) = libm::sincos(-turn);
        let ring = Ego { target_m: ego.position_m + rotate(to_target, c, s), ..*ego };
        memory.intent.target_m = ring.target_m;
        // The longer it takes to get past parked robots, the closer it may pass.
        let patience = (1.0 - memory.around_s / params.squeeze_s).clamp(0.05, 1.0);
        let nearer = Params { parked_margin_m: params.parked_margin_m * patience, ..*params };
        let c = anticipate::choose(&ring, neighbours, obstacles, limits, &nearer, memory.intent.heading_rad);
        heading = c.heading_rad;
        let cos_e = libm::cos(heading - ego.heading_rad);
        let a = ((cos_e - params.align_cos) / (1.0 - params.align_cos)).clamp(0.0, 1.0);
        let mut v = limits.v_max_mps * c.speed_factor * a;
        let sideways = libm::sin(bearing - ego.heading_rad).abs();
        if sideways > 1e-6 {
            v = v.min(params.arc_gain * limits.omega_max_radps * distance / (2.0 * sideways));
        }
        // Stop short of contact, so that there is room left to slip aside.
        let h = unit(ego.heading_rad);
        let standoff =
            params.standoff_m * (1.0 - memory.blocked_s / params.blocked_enter_s.max(0.01)).max(0.0);
        for n in neighbours.iter().take(NEIGHBOURS_MAX) {
            let offset = ego.position_m - n.position_m;
            let d = offset.norm();
            let gap = d - n.required_distance_m;
            if gap > 1.5 {
                break;
            }
            let closing = -h.dot(&offset) / d.max(1e-6);
            if closing > 1e-6 {
                v = v.min(params.row_rate * (gap - standoff).max(0.0) / closing);
            }
        }
        if let (Some(q), true) = (queue, memory.queued_s < params.queue_patience_s) {
            v = v.min(q);
        }
        cap = v;
        intent_speed = c.mean_speed_mps;
    }
    let asks = if memory.straight_s > 0.0 { ASKING_S } else { memory.blocked_s };
    memory.intent = Intent {
        heading_rad: heading,
        speed_mps: intent_speed,
        blocked_s: asks,
        target_m: memory.intent.target_m,
        rank: memory.rank,
    };
    let beta = wrap(heading - bearing);
    let (s, c) = libm::sincos(beta);
    let reference_m = match spot {
        Some(_) => ego.position_m + unit(heading) * limits.v_max_mps,
        None => ego.position_m + rotate(to_target, c, s),
    };
    Guidance {
        reference_m,
        speed_cap_mps: cap,
        beta_rad: beta,
        intent: memory.intent,
        stalled: memory.blocked_s > 1.0,
        leave_goal: spot.is_some(),
    }
}
