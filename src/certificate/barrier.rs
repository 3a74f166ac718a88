//! The sampled-data barrier row: how far a robot may approach another body within one period.
//!
//! With n the unit vector from the other body to the robot at `t_k`, d their distance and ρ the
//! distance to keep, the robot's own motion has to satisfy, for **all** s in [0, T],
//!
//! ```text
//! −n · (p(s) − p(0)) ≤ share · γ · (d − ρ)
//! ```
//!
//! with share ½ against a robot that does the same and 1 against what stands still. Both halves
//! together leave d(s) ≥ ρ at every instant (docs/MATH.md, Theorem 1). Both forms below turn it
//! into one row g·v ≤ b for v ≥ 0, and one more for v < 0.

use crate::geometry::{chord_factor, sinc, sincos};
use std::f64::consts::FRAC_PI_2;

/// The two coefficients of a barrier row: `forward`·v ≤ b for v ≥ 0 and `backward`·|v| ≤ b for v < 0.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Approach {
    /// Most that unit forward speed can approach within the period, s.
    pub forward: f64,
    /// Most that unit backward speed can approach within the period, s.
    pub backward: f64,
}

/// Form F2: a bound for every |ω| ≤ `turn_rate_radps`.
///
/// `normal` = n·h and `tangent` = n·h⊥ are the components of n along and across the heading. Over
/// s the approach is at most −s n·h + ½ω s² |n·h⊥| + (n·h)₊ ω² s³/6, a convex function that is 0 at
/// s = 0, so its largest value over the period is at s = T or 0.
pub fn approach_linear(normal: f64, tangent: f64, turn_rate_radps: f64, period_s: f64) -> Approach {
    let turn = turn_rate_radps * period_s;
    let sideways = 0.5 * turn * tangent.abs();
    let cubic = turn * turn / 6.0;
    let one = |n: f64| (period_s * (-n + sideways + n.max(0.0) * cubic)).max(0.0);
    Approach { forward: one(normal), backward: one(-normal) }
}

/// Turns from here on are looked at angle by angle, rad: below, the heading is square to n once at most.
const FAR_RAD: f64 = 3.0;

/// Form F1: exact for a given ω; `normal` = n·h = cos φ and `tangent` = sin φ as above.
pub fn approach_exact(normal: f64, tangent: f64, omega_radps: f64, period_s: f64) -> Approach {
    Turning::new(omega_radps, period_s).approach(normal, tangent)
}

/// What form F1 takes of one turn, whatever it is towards.
///
/// The largest approach of a unit-speed arc is at s = 0, at s = T, or where the heading is square to n. The way
/// along n is (sin(φ + ωs) − sin φ)/ω; up to where the heading is square it is (1 − σ)/|ω| with
/// σ = sin φ · sign(ω cos φ), for σ > 0 without cancellation cos² φ/(1 + σ)/|ω|, and no angle is needed.
#[derive(Debug, Clone, Copy)]
pub struct Turning {
    omega_radps: f64,
    period_s: f64,
    /// Of half the turn.
    sin: f64,
    cos: f64,
    /// What unit speed covers, s.
    chord_s: f64,
    /// It may turn so far that its heading is square to n more than once.
    far: bool,
}

impl Turning {
    /// Turning at `omega_radps` for one period.
    pub fn new(omega_radps: f64, period_s: f64) -> Self {
        let half = 0.5 * omega_radps * period_s;
        if half.is_nan() || half.abs() >= 0.5 * FAR_RAD {
            return Self { omega_radps, period_s, sin: 0.0, cos: 0.0, chord_s: 0.0, far: true };
        }
        let (sin, cos) = sincos(half);
        let chord_s = period_s * if half.abs() < 1e-4 { sinc(half) } else { sin / half };
        Self { omega_radps, period_s, sin, cos, chord_s, far: false }
    }

    /// How far it approaches a body, `normal` = n·h = cos φ and `tangent` = sin φ.
    pub fn approach(&self, normal: f64, tangent: f64) -> Approach {
        let Self { omega_radps, sin, cos, .. } = *self;
        if self.far {
            return approach_far(libm::atan2(tangent, normal), omega_radps, self.period_s);
        }
        let end = -self.chord_s * (normal * cos - tangent * sin);
        let mut approach = Approach { forward: end.max(0.0), backward: (-end).max(0.0) };
        let normal_at_end = normal * (1.0 - 2.0 * sin * sin) - tangent * (2.0 * sin * cos);
        if normal * normal_at_end < 0.0 {
            // Of sin φ, what is on the side that it turns to.
            let side = tangent * omega_radps.signum() * normal.signum();
            let rest = if side > 0.0 { normal * normal / (1.0 + side) } else { 1.0 - side };
            let square = -rest.copysign(normal) / omega_radps.abs();
            approach.forward = approach.forward.max(square);
            approach.backward = approach.backward.max(-square);
        }
        approach
    }
}

/// The exact form for turns of any size; `phi_rad` in [−π, π] is the angle from n to the heading.
fn approach_far(phi_rad: f64, omega_radps: f64, period_s: f64) -> Approach {
    let at = |s: f64| -chord_factor(omega_radps, s) * libm::cos(phi_rad + 0.5 * omega_radps * s);
    let end = at(period_s);
    let mut approach = Approach { forward: end.max(0.0), backward: (-end).max(0.0) };
    // After one turn the approach repeats, so the first time at each of the two sides is enough.
    for square in [1.0, -1.0, 3.0, -3.0, 5.0, -5.0].map(|k| k * FRAC_PI_2) {
        let s = (square - phi_rad) / omega_radps;
        if s > 0.0 && s < period_s {
            let value = at(s);
            approach.forward = approach.forward.max(value);
            approach.backward = approach.backward.max(-value);
        }
    }
    approach
}

/// Right side b = share · γ · (d − ρ) of a barrier row, m; 0 inside ρ, where no further approach is
/// allowed.
pub fn budget_m(gap_m: f64, rate: f64, share: f64) -> f64 {
    (share * rate * gap_m).max(0.0)
}

/// Distance beyond which the row of a body cannot bind, m: ρ + v T / (share γ) (the sound form of
/// the paper's (32)).
pub fn activation_m(required_m: f64, speed_mps: f64, period_s: f64, rate: f64, share: f64) -> f64 {
    required_m + speed_mps * period_s / (share * rate)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Arc, Pose, Vec2};
    use proptest::prelude::*;

    /// Largest −n·(p(s) − p(0)) over the period by brute force.
    fn sampled_approach(theta: f64, n: Vec2, v: f64, omega: f64, t: f64) -> f64 {
        let arc = Arc { start: Pose::new(0.0, 0.0, theta), v_mps: v, omega_radps: omega };
        (0..=2000).map(|k| -n.dot(&arc.position(t * f64::from(k) / 2000.0))).fold(0.0, f64::max)
    }

    proptest! {
        #[test]
        fn both_forms_bound_the_motion_and_f1_is_tight(
            theta in -3.1..3.1f64, bearing in -3.1..3.1f64, v in -5.0..5.0f64,
            omega in prop_oneof![-1.0..1.0f64, -12.0..12.0f64], t in 0.001..1.0f64,
        ) {
            let n = Vec2::new(bearing.cos(), bearing.sin());
            let truth = sampled_approach(theta, n, v, omega, t);
            let phi = crate::geometry::wrap(theta - bearing);
            let exact = approach_exact(phi.cos(), phi.sin(), omega, t);
            let linear = approach_linear(phi.cos(), phi.sin(), omega.abs(), t);
            let of = |a: Approach| if v >= 0.0 { a.forward * v } else { a.backward * -v };
            prop_assert!(of(exact) >= truth - 1e-12);
            prop_assert!(of(exact) <= truth + 1e-5 * (1.0 + v.abs()), "{} {truth}", of(exact));
            prop_assert!(of(linear) >= of(exact) - 1e-12, "{} {}", of(linear), of(exact));
        }

        /// Without an angle the form is what it is by the angles at which the heading is square to n, also where it
        /// all but is at an end of the period and where it hardly turns.
        #[test]
        fn the_form_for_small_turns_is_that_for_all(
            phi in prop_oneof![
                -3.1..3.1f64,
                (prop_oneof![Just(-FRAC_PI_2), Just(FRAC_PI_2)], -1e-3..1e-3f64, 0..5).prop_map(|(at, by, scale)| {
                    at + by * 1e-3f64.powi(scale)
                })
            ],
            turn in prop_oneof![-3.0..3.0f64, -1e-3..1e-3f64, -1e-9..1e-9f64, Just(0.0)], t in 0.001..1.0f64,
        ) {
            let (omega, (sin, cos)) = (turn / t, libm::sincos(phi));
            let (near, far) = (approach_exact(cos, sin, omega, t), approach_far(phi, omega, t));
            prop_assert!((near.forward - far.forward).abs() <= 2e-15 * t, "{near:?} {far:?}");
            prop_assert!((near.backward - far.backward).abs() <= 2e-15 * t, "{near:?} {far:?}");
        }
    }
}
