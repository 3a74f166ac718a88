//! Several arcs followed at once, eight at a time where the processor can.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of its caller")]

use super::{Arc, Pose, Vec2, trig};
use std::f64::consts::{PI, TAU};

/// Motions as of [`Arc`], side by side.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Arcs {
    /// Where they are, m.
    pub x_m: [f64; Arcs::COUNT],
    /// Where they are, m.
    pub y_m: [f64; Arcs::COUNT],
    /// Headings, rad.
    pub theta_rad: [f64; Arcs::COUNT],
    /// Forward speeds, m/s.
    pub v_mps: [f64; Arcs::COUNT],
    /// Turn rates, rad/s.
    pub omega_radps: [f64; Arcs::COUNT],
}

impl Arcs {
    /// Arcs that are followed at once.
    pub const COUNT: usize = 8;

    /// Moves all of them on by `s` seconds, each as [`Arc::pose`] does, to the bit.
    pub fn advance(&mut self, s: f64) {
        #[cfg(target_arch = "x86_64")]
        if std::arch::is_x86_feature_detected!("avx512f") && std::arch::is_x86_feature_detected!("avx512vl") {
            // SAFETY: the processor has what the function was compiled for.
            return unsafe { self.advance_avx512(s) };
        }
        self.advance_all(s);
    }

    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn advance_avx512(&mut self, s: f64) {
        self.advance_all(s);
    }

    #[inline(always)]
    #[expect(
        clippy::needless_range_loop,
        clippy::needless_bitwise_bool,
        reason = "side by side, and nothing to guess"
    )]
    fn advance_all(&mut self, s: f64) {
        let (mut ends, mut odd) = (*self, [0_u64; Self::COUNT]);
        for k in 0..Self::COUNT {
            let (theta_rad, omega_radps) = (self.theta_rad[k], self.omega_radps[k]);
            let half = 0.5 * omega_radps * s;
            let (middle, turned) = (theta_rad + half, theta_rad + omega_radps * s);
            let (sin, cos) = trig::formula(middle);
            let small = half.abs() < 1e-4;
            let sinc = if small { 1.0 - half * half / 6.0 } else { trig::formula(half).0 / half };
            let chord_m = self.v_mps[k] * s * sinc;
            ends.x_m[k] = self.x_m[k] + cos * chord_m;
            ends.y_m[k] = self.y_m[k] + sin * chord_m;
            let positive = if turned < 0.0 { turned + TAU } else { turned };
            let wrapped = if positive > PI { positive - TAU } else { positive };
            ends.theta_rad[k] = if (turned > -PI) & (turned <= PI) { turned } else { wrapped };
            let even = trig::is_covered(middle) & (small | trig::is_covered(half)) & (turned.abs() < TAU);
            odd[k] = u64::from(!even);
        }
        // Those that the formulas do not cover, one by one.
        if odd.iter().fold(0, |any, odd| any | odd) != 0 {
            for k in (0..Self::COUNT).filter(|k| odd[*k] != 0) {
                let position_m = Vec2::new(self.x_m[k], self.y_m[k]);
                let start = Pose { position_m, theta_rad: self.theta_rad[k] };
                let end = Arc { start, v_mps: self.v_mps[k], omega_radps: self.omega_radps[k] }.pose(s);
                (ends.x_m[k], ends.y_m[k]) = (end.position_m.x, end.position_m.y);
                ends.theta_rad[k] = end.theta_rad;
            }
        }
        *self = ends;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::FRAC_PI_2;

    fn number() -> impl Strategy<Value = f64> {
        let special =
            vec![0.0, -0.0, PI, -PI, FRAC_PI_2, -FRAC_PI_2, TAU, -TAU, 1e300, f64::INFINITY, f64::NAN];
        prop_oneof![
            8 => -4.0..4.0f64,
            2 => -0.002..0.002f64,
            1 => -1e-12..1e-12f64,
            1 => -1e3..1e3f64,
            1 => prop::sample::select(special),
        ]
    }

    proptest! {
        /// Whatever the numbers and the width of the registers, each is where it would be alone.
        #[test]
        fn together_they_end_where_each_ends_alone(
            numbers in prop::array::uniform8(prop::array::uniform5(number())),
            s in prop_oneof![Just(0.08), Just(0.0), 0.0..2.0f64],
        ) {
            let lane = |field: usize| numbers.map(|arc| arc[field]);
            let (x_m, y_m, theta_rad, v_mps, omega_radps) = (lane(0), lane(1), lane(2), lane(3), lane(4));
            let before = Arcs { x_m, y_m, theta_rad, v_mps, omega_radps };
            let (mut widest, mut plain) = (before, before);
            widest.advance(s);
            plain.advance_all(s);
            for after in [widest, plain] {
                for (k, [x_m, y_m, theta_rad, v_mps, omega_radps]) in numbers.into_iter().enumerate() {
                    let start = Pose { position_m: Vec2::new(x_m, y_m), theta_rad };
                    let alone = Arc { start, v_mps, omega_radps }.pose(s);
                    let pairs = [
                        (after.x_m[k], alone.position_m.x),
                        (after.y_m[k], alone.position_m.y),
                        (after.theta_rad[k], alone.theta_rad),
                    ];
                    for (together, alone) in pairs {
                        // What is not a number may be so in several ways.
                        let same = together.to_bits() == alone.to_bits() || together.is_nan() && alone.is_nan();
                        prop_assert!(same, "{together:e} {alone:e} of {:?}", numbers[k]);
                    }
                }
            }
        }
    }
}
