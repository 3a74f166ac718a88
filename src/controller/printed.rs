//! The printed row (33d), for the profile `paper`. **Unsafe**: here to be compared with.
//!
//! ```text
//! ΔB = 2T Δpᵀb + T²‖b‖² ≥ −γ T B − T² φ + δ_r,   b = v h − v_j h_j,   δ_r ≥ 0
//! ```
//!
//! The slack only tightens, so it is 0 at every solution; the other robot's input is unknown and taken
//! to be its last one. In v the row is a quadratic that has to be non-negative: it leaves two intervals.
//! The slower one is taken.

use super::Law;
use crate::model::Limits;
use crate::neighbours::Nearby;
use crate::wire::RobotState;

/// γ of Section IV.A, a rate per second as printed.
pub const GAMMA_PER_S: f64 = 0.6;

/// ε_r of (32) as printed, read in the unit of B, m².
pub const ACTIVATION_M2: f64 = 1.5;

/// φ of (5) for two robots at the distance `d_m`: half of the largest |B̈|, m²/s².
pub fn phi(d_m: f64, limits: &Limits) -> f64 {
    let (v, omega) = (limits.speed_mps(), limits.turn_rate_radps());
    4.0 * v * v + 2.0 * d_m * v * omega
}

/// Largest speed up to `wanted_mps` that every printed row admits; `None` when not even 0 is.
pub(super) fn speed_limit(
    law: &Law,
    fleet: &[RobotState],
    me: usize,
    near: &[Nearby],
    wanted_mps: f64,
) -> Option<f64> {
    let own = &fleet[me];
    let (t, h) = (law.period_s, own.pose().heading());
    let mut v = wanted_mps;
    // Each pass that changes v leaves one more interval behind.
    for _ in 0..=near.len() {
        let before = v;
        for n in near {
            let other = &fleet[n.index];
            let required = law.limits.safety_margin_m + own.radius_m + other.radius_m;
            let barrier = n.distance_m * n.distance_m - required * required;
            if barrier > ACTIVATION_M2 {
                continue;
            }
            let (offset, drift) =
                (own.position_m() - other.position_m(), other.pose().heading() * other.v_mps);
            // T²v² + linear·v + constant ≥ 0
            let linear = 2.0 * t * h.dot(&offset) - 2.0 * t * t * h.dot(&drift);
            let constant = t * t * drift.norm_squared() - 2.0 * t * offset.dot(&drift)
                + GAMMA_PER_S * t * barrier
                + t * t * phi(n.distance_m, &law.limits);
            let discriminant = linear * linear - 4.0 * t * t * constant;
            if discriminant > 0.0 {
                let root = |sign: f64| (-linear + sign * discriminant.sqrt()) / (2.0 * t * t);
                if v > root(-1.0) && v < root(1.0) {
                    v = root(-1.0);
                }
            }
        }
        if v < 0.0 {
            return None;
        }
        if v == before {
            break;
        }
    }
    Some(v)
}
