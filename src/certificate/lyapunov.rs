use crate::config::{ControllerConfig, Profile};
use crate::geometry::{Vec2, sincos, unit};
use std::f64::consts::PI;

/// The finite-time decrease of Definition 2: Q(V) = min{V, c₃ V^α}.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FiniteTime {
    /// Gain c₃ > 0.
    pub c3: f64,
    /// Exponent α in (0, 1).
    pub alpha: f64,
}

impl FiniteTime {
    /// Q(V). Zero at V = 0 and never above V.
    pub fn decrease(&self, v: f64) -> f64 {
        v.min(self.c3 * libm::pow(v, self.alpha))
    }

    /// min{Q(V), `most`}, without the power where that is not needed to know.
    fn decrease_to(&self, v: f64, most: f64) -> f64 {
        if self.is_above(v, most) { v.min(most) } else { self.decrease(v).min(most) }
    }

    /// Whether c₃ V^α is above `most` for certain, by a bound of the power: √V, V^¾ or V, without the roots. The slack
    /// is more than what rounding makes, and where squares would be too large or too small to tell nothing is certain.
    fn is_above(&self, v: f64, most: f64) -> bool {
        let c3 = self.c3 * (1.0 - 1e-12);
        let (gain, square) = (c3 * c3, most * most);
        let (power, most_of_it) = match v >= 1.0 {
            true if self.alpha >= 0.5 => (gain * v, square),
            true => (c3, most),
            false if self.alpha <= 0.75 => (gain * gain * (v * v * v), square * square),
            false => (c3 * v, most),
        };
        most <= 0.0 || power >= most_of_it && (1e-290..=1e290).contains(&power)
    }

    /// r⋆ = c₃^{1/(1−α)}: from here one step is to reach zero (Theorem 2).
    pub fn capture_radius(&self) -> f64 {
        libm::pow(self.c3, 1.0 / (1.0 - self.alpha))
    }

    /// The closed-form bound (14) on the settling step of z ← z − Q(z) from `v0`; `None` where its
    /// logarithm has no finite value.
    pub fn settling_bound(&self, v0: f64) -> Option<u64> {
        let capture = self.capture_radius();
        if v0 <= capture {
            return Some(1);
        }
        let ratio = 1.0 - self.c3 * libm::pow(v0, self.alpha - 1.0);
        let steps = (libm::log(v0 / capture) / -libm::log(ratio)).ceil() + 1.0;
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // checked on this line
        (steps.is_finite() && steps < 1e18).then_some(steps as u64)
    }
}

/// How much a certificate asks its Lyapunov function to fall in one step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Decrease {
    /// min{V, c₃V^α}, and no more than the input limits can deliver.
    FiniteTime {
        /// The unsaturated Q.
        law: FiniteTime,
        /// Share η of the reachable decrease that is asked for.
        alignment: f64,
    },
    /// min{V, c₃V^α} as printed, whatever the inputs can deliver.
    Printed(FiniteTime),
    /// c₃V: the exponential baseline.
    Exponential {
        /// Rate c₃ in (0, 1).
        c3: f64,
    },
}

impl Decrease {
    /// The decrease that a profile asks for.
    pub fn of(config: &ControllerConfig) -> Self {
        let law = FiniteTime { c3: config.c3, alpha: config.alpha };
        match config.profile {
            Profile::Certified => Self::FiniteTime { law, alignment: config.alignment },
            Profile::Paper => Self::Printed(law),
            Profile::Exponential => Self::Exponential { c3: config.c3 },
        }
    }

    /// Q_p for the distance `d_m` to the goal when one step covers at most `reach_m`, m².
    pub fn position(&self, d_m: f64, reach_m: f64) -> f64 {
        let v = 0.5 * d_m * d_m;
        match *self {
            Self::FiniteTime { law, alignment } => {
                let rest = (d_m - reach_m * alignment).max(0.0);
                law.decrease_to(v, v - 0.5 * rest * rest)
            }
            Self::Printed(law) => law.decrease(v),
            Self::Exponential { c3 } => c3 * v,
        }
    }

    /// Q_θ for the heading error `e_rad` when one step turns at most `reach_rad`.
    pub fn heading(&self, e_rad: f64, reach_rad: f64) -> f64 {
        let error = unit(e_rad);
        self.heading_at(lyapunov_heading(error), error, &self.asked_of(reach_rad))
    }

    /// The turn that is asked for of a step that turns at most `reach_rad`.
    fn asked_of(&self, reach_rad: f64) -> Turn {
        match *self {
            Self::FiniteTime { alignment, .. } => Turn::of(reach_rad * alignment),
            Self::Printed(_) | Self::Exponential { .. } => Turn::of(reach_rad),
        }
    }

    /// Q_θ where the Lyapunov function is `v` and the heading error has this cosine and sine.
    fn heading_at(&self, v: f64, error: Vec2, asked: &Turn) -> f64 {
        match *self {
            Self::FiniteTime { law, .. } => law.decrease_to(v, asked.fall(v, error)),
            Self::Printed(law) => law.decrease(v),
            Self::Exponential { c3 } => c3 * v,
        }
    }

    /// Steps that the scalar recursion of the position certificate needs from a distance `d_m` to
    /// inside `tolerance_m`, at most `limit`: exact where (14) is only a bound. `None`: more than
    /// `limit`.
    pub fn settling_steps(&self, d_m: f64, reach_m: f64, tolerance_m: f64, limit: u32) -> Option<u32> {
        let (mut z, end) = (0.5 * d_m * d_m, 0.5 * tolerance_m * tolerance_m);
        // No step asks for more way than one step can cover; the printed one asks for more.
        if matches!(self, Self::FiniteTime { .. }) && d_m - tolerance_m > reach_m * f64::from(limit) {
            return None;
        }
        for step in 0..=limit {
            if z <= end {
                return Some(step);
            }
            z = (z - self.position((2.0 * z).sqrt(), reach_m)).max(0.0);
        }
        None
    }
}

/// 1 − cos e of an error with this cosine and sine: never negative, and no less exact for small errors.
fn lyapunov_heading(error: Vec2) -> f64 {
    if error.x > 0.0 { error.y * error.y / (1.0 + error.x) } else { 1.0 - error.x }
}

/// The sine of π as it is rounded: the least that an error beyond a right angle has.
const HALF_TURN: f64 = 1.224_646_799_147_353_2e-16;

/// The error that is turned away: straight behind, where both ways round are as far, one of them is taken. Without a
/// slope nobody would turn at all.
fn one_way_round(error: Vec2) -> Vec2 {
    let straight_behind = error.x < 0.0 && error.y.abs() < HALF_TURN;
    if straight_behind { Vec2::new(error.x, HALF_TURN.copysign(error.y)) } else { error }
}

/// A turn of at most a half turn.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Turn {
    cos: f64,
    sin: f64,
    /// 1 − cos.
    versine: f64,
}

impl Turn {
    fn of(angle_rad: f64) -> Self {
        let angle_rad = angle_rad.min(PI);
        let ((sin, cos), (half, _)) = (sincos(angle_rad), sincos(0.5 * angle_rad));
        Self { cos, sin, versine: 2.0 * half * half }
    }

    /// cos(max(0, |e| − turn)).
    fn cos_after(&self, error: Vec2) -> f64 {
        if error.x >= self.cos { 1.0 } else { error.x * self.cos + error.y.abs() * self.sin }
    }

    /// By how much the turn lowers 1 − cos e, which is `v`.
    fn fall(&self, v: f64, error: Vec2) -> f64 {
        if error.x >= self.cos { v } else { error.y.abs() * self.sin - error.x * self.versine }
    }
}

/// The coefficients of (28): linear·v + ½ curvature·v² ≤ −decrease + δ_p.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PositionCertificate {
    /// V_p = ½ d², m².
    pub lyapunov_m2: f64,
    /// c = T (p − p_ref)·h, m s.
    pub linear: f64,
    /// T², s².
    pub curvature: f64,
    /// Q_p, m².
    pub decrease_m2: f64,
}

impl PositionCertificate {
    /// `offset_m` = p_ref − p as (along the heading, distance): its component along h and its norm.
    pub fn new(along_m: f64, d_m: f64, period_s: f64, v_max_mps: f64, decrease: &Decrease) -> Self {
        Self {
            lyapunov_m2: 0.5 * d_m * d_m,
            linear: -period_s * along_m,
            curvature: period_s * period_s,
            decrease_m2: decrease.position(d_m, v_max_mps * period_s),
        }
    }
}

/// The coefficients of (31): linear·ω + ½ curvature·ω² ≤ −decrease + δ_θ.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingCertificate {
    /// V_θ = 1 − cos e.
    pub lyapunov: f64,
    /// T sin e, s.
    pub linear: f64,
    /// T² H, s².
    pub curvature: f64,
    /// Q_θ.
    pub decrease: f64,
}

impl HeadingCertificate {
    /// [`HeadingLaw::printed`] at the heading error `e_rad`.
    pub fn printed(e_rad: f64, period_s: f64, turn_rate_radps: f64, decrease: &Decrease) -> Self {
        HeadingLaw::new(period_s, turn_rate_radps, *decrease).printed(unit(e_rad))
    }

    /// [`HeadingLaw::certificate`] at the heading error `e_rad`.
    pub fn new(e_rad: f64, period_s: f64, turn_rate_radps: f64, decrease: &Decrease) -> Self {
        HeadingLaw::new(period_s, turn_rate_radps, *decrease).certificate(unit(e_rad))
    }
}

/// What the heading's certificate is computed from, the same for all robots.
///
/// The error e comes as (cos e, sin e): the scalar and the cross product of the heading and the direction of the
/// reference, as exact as the angle between them and found without it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct HeadingLaw {
    period_s: f64,
    decrease: Decrease,
    /// What a step can turn, and what it is asked to.
    reach: Turn,
    asked: Turn,
}

impl HeadingLaw {
    /// For steps of `period_s` that turn by at most `turn_rate_radps`.
    pub fn new(period_s: f64, turn_rate_radps: f64, decrease: Decrease) -> Self {
        let reach_rad = turn_rate_radps * period_s;
        Self { period_s, decrease, reach: Turn::of(reach_rad), asked: decrease.asked_of(reach_rad) }
    }

    /// The certificate with the printed H = √cos e, 0 beyond a right angle where it is imaginary:
    /// a Taylor value, not a bound.
    pub fn printed(&self, error: Vec2) -> HeadingCertificate {
        let curvature = self.period_s * self.period_s * error.x.max(0.0);
        HeadingCertificate { curvature, ..self.certificate(error) }
    }

    /// The certificate at the heading error e.
    ///
    /// H = max(0, cos(max(0, |e| − ω_max T))) bounds the second derivative of 1 − cos(e + Tω) over
    /// every |ω| ≤ ω_max, so the row implies the true decrease. The printed √cos e is imaginary
    /// beyond a right angle, and a Taylor value rather than a bound before it.
    pub fn certificate(&self, error: Vec2) -> HeadingCertificate {
        let error = one_way_round(error);
        let lyapunov = lyapunov_heading(error);
        HeadingCertificate {
            lyapunov,
            linear: self.period_s * error.y,
            curvature: self.period_s * self.period_s * self.reach.cos_after(error).max(0.0),
            decrease: self.decrease.heading_at(lyapunov, error, &self.asked),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn certified() -> Decrease {
        Decrease::of(&ControllerConfig::default())
    }

    proptest! {
        /// Leaving out the power changes no bit.
        #[test]
        fn a_smaller_bound_needs_no_power(
            v in prop_oneof![0.0..2.0f64, 0.0..1e-3f64, 1.0..1e4f64], c3 in 0.01..3.0f64, alpha in 0.01..0.99f64,
            share in 0.0..1.2f64,
        ) {
            let law = FiniteTime { c3, alpha };
            for most in [0.0, v * share, c3 * v * share, c3 * v.sqrt() * share, v] {
                prop_assert_eq!(law.decrease_to(v, most).to_bits(), law.decrease(v).min(most).to_bits());
            }
        }

        /// (14) holds for the recursion (15), over gains, exponents and starts.
        #[test]
        fn settling_bound_holds_for_the_recursion(c3 in 0.05..0.95f64, alpha in 0.05..0.95f64, log_v0 in -4.0..3.0f64) {
            let law = FiniteTime { c3, alpha };
            let mut z = 10f64.powf(log_v0);
            if let Some(bound) = law.settling_bound(z).filter(|b| *b < 1_000_000) {
                for _ in 0..bound {
                    z -= law.decrease(z);
                }
                prop_assert!(z <= 0.0, "left {z} after {bound} steps");
            }
        }

        /// An aligned robot that nothing holds back meets (28) without slack at some admissible v.
        #[test]
        fn saturated_decrease_is_reachable(d in 0.0..2000.0f64) {
            let (t, v_max) = (0.08, 5.0);
            let row = PositionCertificate::new(d, d, t, v_max, &certified());
            let v = (d / t).min(v_max);
            let left = row.linear * v + 0.5 * row.curvature * v * v + row.decrease_m2;
            prop_assert!(left <= 1e-12 * (1.0 + d * d), "slack {left}");
        }

        /// Without the angle they are what they are by it.
        #[test]
        fn the_heading_certificate_is_that_of_the_angle(
            e in prop_oneof![-PI..PI, -1e-3..1e-3f64, -1e-9..1e-9f64],
            reach in prop_oneof![0.0..0.5f64, 0.5..7.0f64], alignment in 0.1..1.0f64,
        ) {
            let law = FiniteTime { c3: 0.5, alpha: 0.6 };
            let row = HeadingLaw::new(1.0, reach, Decrease::FiniteTime { law, alignment }).certificate(unit(e));
            let v = 2.0 * (0.5 * e).sin().powi(2);
            prop_assert!((row.lyapunov - v).abs() <= 1e-15 * v, "{} {v}", row.lyapunov);
            prop_assert_eq!(row.linear, libm::sin(e));
            let left = |reach: f64| (e.abs() - reach).max(0.0);
            prop_assert!((row.curvature - left(reach).cos().max(0.0)).abs() <= 1e-15);
            let fall = v - 2.0 * (0.5 * left(alignment * reach)).sin().powi(2);
            prop_assert!((row.decrease - fall.min(law.decrease(v))).abs() <= 1e-15);
            prop_assert!(row.decrease >= 0.0);
        }

        /// Straight behind there is a way round as well, the one of an angle of π, and of as little as can be told.
        #[test]
        fn who_has_to_turn_round_is_asked_to(cos in -1.0..=-1e-9f64, sin in -1e-17..1e-17f64) {
            let law = FiniteTime { c3: 0.5, alpha: 0.6 };
            let law = HeadingLaw::new(0.08, 1.0, Decrease::FiniteTime { law, alignment: 0.5 });
            prop_assert_eq!(law.certificate(Vec2::new(-1.0, 0.0)).linear, 0.08 * libm::sin(PI));
            prop_assert_eq!(law.certificate(Vec2::new(cos, sin)).linear.abs(), 0.08 * libm::sin(PI));
            prop_assert_eq!(law.certificate(Vec2::new(-cos, sin)).linear, 0.08 * sin);
        }

        /// The heading row implies the true fall of 1 − cos e for every admissible turn rate.
        #[test]
        fn heading_row_is_an_upper_bound(e in -3.0..3.1f64, omega in -1.0..1.0f64) {
            let t = 0.08;
            let row = HeadingCertificate::new(e, t, 1.0, &certified());
            let change = (1.0 - (e + t * omega).cos()) - (1.0 - e.cos());
            prop_assert!(change <= row.linear * omega + 0.5 * row.curvature * omega * omega + 1e-15);
        }
    }

    /// The printed certificate cannot be met at the paper's own start: it asks for 6.7 m/s.
    #[test]
    fn printed_decrease_is_out_of_reach_at_the_papers_start() {
        let (d, t) = (9.5, 0.08);
        let q = Decrease::Printed(FiniteTime { c3: 0.5, alpha: 0.6 }).position(d, 0.4);
        // The smallest v with −T d v + ½T²v² ≤ −Q.
        let v = (d - (d * d - 2.0 * q).sqrt()) / t;
        assert!((6.6..6.8).contains(&v), "{v}");
        let capture = FiniteTime { c3: 0.5, alpha: 0.6 }.capture_radius();
        assert!(((2.0 * capture).sqrt() - 0.595).abs() < 1e-3, "one step is asked to cover 0.595 m");
    }

    #[test]
    fn settling_steps_count_full_speed_steps() {
        // 9.5 m at 0.4 m a step: 23 full steps and a rest.
        assert_eq!(certified().settling_steps(9.5, 0.4, 0.05, 1000), Some(24));
        assert_eq!(certified().settling_steps(0.01, 0.4, 0.05, 1000), Some(0));
        assert_eq!(certified().settling_steps(1e6, 0.4, 0.05, 10), None);
    }
}
