//! Sine, cosine and the angle of a vector: to the bit those of `libm`, without its branches.
//!
//! `libm` decides by the size and the sign of its argument which formula to take. Headings and bearings are spread
//! over the whole circle, so that every second of these branches is mispredicted, and that costs more than the
//! formula. Here all cases are one formula with a table of coefficients and masks of signs. What it does not
//! cover (tiny and large arguments, zeros, what is next to a multiple of π/2, what is not finite) goes to `libm`.
//!
//! The formulas and coefficients are those of `libm`, which has them from FreeBSD's msun (`e_atan2.c`, `s_atan.c`,
//! `k_sin.c`, `k_cos.c`, `e_rem_pio2.c`):
//!
//! > Copyright (C) 1993 by Sun Microsystems, Inc. All rights reserved.
//! > Developed at SunPro and SunSoft, Sun Microsystems, Inc. business.
//! > Permission to use, copy, modify, and distribute this software is freely granted, provided that this notice
//! > is preserved.

#![allow(clippy::unreadable_literal)] // as the tables that they come from
#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI};

/// π/2 in two parts; the first has 33 bits, so that small multiples of it are exact.
const PIO2: [f64; 2] = [1.5707963267341256, 6.077100506506192e-11];

const SIN: [f64; 6] = [
    -0.16666666666666632,
    0.00833333333332249,
    -0.0001984126982985795,
    2.7557313707070068e-06,
    -2.5050760253406863e-08,
    1.58969099521155e-10,
];

const COS: [f64; 6] = [
    0.0416666666666666,
    -0.001388888888887411,
    2.480158728947673e-05,
    -2.7557314351390663e-07,
    2.087572321298175e-09,
    -1.1359647557788195e-11,
];

const ATAN: [f64; 11] = [
    0.3333333333333293,
    -0.19999999999876483,
    0.14285714272503466,
    -0.11111110405462356,
    0.09090887133436507,
    -0.0769187620504483,
    0.06661073137387531,
    -0.058335701337905735,
    0.049768779946159324,
    -0.036531572744216916,
    0.016285820115365782,
];

/// The part of the arctangent's argument t that is left, (a t + b) / (c + d t), and what of the arctangent is not in it.
struct Reduced {
    a: f64,
    b: f64,
    c: f64,
    d: f64,
    high: f64,
    low: f64,
}

/// From 0, 7/16, 11/16, 19/16 and 39/16 on.
const REDUCED: [Reduced; 5] = [
    Reduced { a: 1.0, b: 0.0, c: 1.0, d: 0.0, high: 0.0, low: 0.0 },
    Reduced { a: 2.0, b: -1.0, c: 2.0, d: 1.0, high: 0.4636476090008061, low: 2.2698777452961687e-17 },
    Reduced { a: 1.0, b: -1.0, c: 1.0, d: 1.0, high: FRAC_PI_4, low: 3.061616997868383e-17 },
    Reduced { a: 1.0, b: -1.5, c: 1.0, d: 1.5, high: 0.982793723247329, low: 1.3903311031230998e-17 },
    Reduced { a: 0.0, b: -1.0, c: 0.0, d: 1.0, high: FRAC_PI_2, low: 6.123233995736766e-17 },
];

/// π in two parts.
const PI_PARTS: [f64; 2] = [PI, 1.2246467991473532e-16];

/// The upper half of the bits without the sign: enough to compare sizes by.
fn size(x: f64) -> u32 {
    (x.to_bits() >> 32) as u32 & 0x7fff_ffff
}

/// Below this the formula does not hold.
const TINY: u32 = 0x3e46_a09e;

/// π/4, 3π/4 and 5π/4.
const EIGHTHS: [u32; 3] = [0x3fe9_21fb, 0x4002_d97c, 0x400f_6a7a];

/// Whether the formula holds for the angle.
#[inline(always)]
#[expect(clippy::needless_bitwise_bool, reason = "nothing to guess for the processor")]
pub(super) fn is_covered(x: f64) -> bool {
    let size = size(x);
    (size >= TINY) & (size <= EIGHTHS[2]) & (size & 0xf_ffff != 0x9_21fb)
}

/// The sine and the cosine of an angle.
#[inline]
pub fn sincos(x: f64) -> (f64, f64) {
    if is_covered(x) { formula(x) } else { libm::sincos(x) }
}

/// The sine and the cosine of an angle for which it holds.
#[inline(always)]
pub(super) fn formula(x: f64) -> (f64, f64) {
    let size = size(x);
    let beyond = [size > EIGHTHS[0], size > EIGHTHS[1]];
    let quarters = u64::from(beyond[0]) + u64::from(beyond[1]);
    let negative = x.to_bits() >> 63;
    // What is left of the angle, y + rest, after so many quarters of a turn.
    let [one, another] = beyond.map(|beyond| if beyond { 1.0_f64 } else { 0.0 });
    let n = (one + another).copysign(x);
    let r = x - n * PIO2[0];
    let y = r - n * PIO2[1];
    let rest = (r - y) - n * PIO2[1];

    let z = y * y;
    let w = z * z;
    let sin = {
        let r = SIN[1] + z * (SIN[2] + z * SIN[3]) + z * w * (SIN[4] + z * SIN[5]);
        let v = z * y;
        // Without a rest the sum is taken in another order.
        let whole = y + v * (SIN[0] + z * r);
        let reduced = y - ((z * (0.5 * rest - v * r) - rest) - v * SIN[0]);
        [whole.to_bits(), reduced.to_bits()]
    };
    let any = 0u64.wrapping_sub(u64::from(quarters != 0));
    let sin = sin[0] ^ ((sin[0] ^ sin[1]) & any);
    let cos = {
        let r = z * (COS[0] + z * (COS[1] + z * COS[2])) + w * w * (COS[3] + z * (COS[4] + z * COS[5]));
        let half = 0.5 * z;
        let w = 1.0 - half;
        (w + (((1.0 - w) - half) + (z * r - y * rest))).to_bits()
    };
    // A quarter exchanges them, with a sign; a half turns both signs.
    let (quarter, half) = (quarters & 1, quarters >> 1);
    let exchanged = (sin ^ cos) & 0u64.wrapping_sub(quarter);
    let sin = sin ^ exchanged ^ ((half | quarter & negative) << 63);
    let cos = cos ^ exchanged ^ ((half | quarter & (negative ^ 1)) << 63);
    (f64::from_bits(sin), f64::from_bits(cos))
}

/// The angle of the vector (x, y) from the x axis, in [−π, π].
#[inline]
pub(super) fn atan2(y: f64, x: f64) -> f64 {
    // 2⁻²⁷ and 2⁶¹.
    const COVERED: std::ops::Range<u32> = 0x3e40_0000..0x43c0_0000;
    let t = (y / x).abs();
    let size = size(t);
    if !COVERED.contains(&size) {
        return libm::atan2(y, x);
    }
    let case = [0x3fdc_0000, 0x3fe6_0000, 0x3ff3_0000, 0x4003_8000].map(|from| usize::from(size >= from));
    let part = &REDUCED[case[0] + case[1] + case[2] + case[3]];
    let u = (part.a * t + part.b) / (part.c + part.d * t);
    let z = u * u;
    let w = z * z;
    let odd = z * (ATAN[0] + w * (ATAN[2] + w * (ATAN[4] + w * (ATAN[6] + w * (ATAN[8] + w * ATAN[10])))));
    let even = w * (ATAN[1] + w * (ATAN[3] + w * (ATAN[5] + w * (ATAN[7] + w * ATAN[9]))));
    let angle = part.high - ((u * (odd + even) - part.low) - u);
    // To the left it is what is left to π.
    let left = x.to_bits() >> 63;
    let mask = 0u64.wrapping_sub(left);
    let [pi, low] = PI_PARTS.map(|part| f64::from_bits(part.to_bits() & mask));
    let turned = f64::from_bits((angle - low).to_bits() ^ (left << 63));
    (pi + turned).copysign(y)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn same(x: f64) {
        let ((sin, cos), (s, c)) = (sincos(x), libm::sincos(x));
        if x.is_finite() {
            assert_eq!((sin.to_bits(), cos.to_bits()), (s.to_bits(), c.to_bits()), "{x:e}");
        } else {
            assert!(sin.is_nan() && cos.is_nan(), "{x:e}");
        }
    }

    fn same_angle(y: f64, x: f64) {
        let (angle, a) = (atan2(y, x), libm::atan2(y, x));
        assert!(
            angle.to_bits() == a.to_bits() || angle.is_nan() && a.is_nan(),
            "{y:e} {x:e}: {angle:e} {a:e}"
        );
    }

    /// A number and its neighbours, with both signs.
    fn around(x: f64) -> impl Iterator<Item = f64> {
        let bits = x.to_bits();
        let near = (-40..=40i64).chain([-(1 << 33), -(1 << 32), 1 << 32, 1 << 33]);
        near.flat_map(move |d| {
            let x = f64::from_bits(bits.wrapping_add_signed(d));
            [x, -x]
        })
    }

    #[test]
    fn every_border_of_a_case_is_on_the_side_where_it_is_with_libm() {
        let octants = (0..=12).map(|k| f64::from(k) * FRAC_PI_4);
        let angles = octants.chain([2f64.powf(-26.5), 2f64.powi(-27), 0.5, 1.0, 1e-300, 1e9, f64::MAX]);
        angles.flat_map(around).for_each(same);
        [0.0, -0.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN].into_iter().for_each(same);
        let slopes = [7.0 / 16.0, 11.0 / 16.0, 19.0 / 16.0, 39.0 / 16.0, 1.0, 0.5, 1.5];
        let far = [-27, 27, 60, 61, 62, 63, 64, 65, 66, 67].map(|k| 2f64.powi(k));
        for slope in slopes.into_iter().chain(far).flat_map(around) {
            for x in [1.0, 2.0, -1.0, -0.5, 3.0, -7.0, 1e-310, -1e-310] {
                same_angle(slope * x, x);
                same_angle(x, slope * x);
            }
        }
        let odd =
            [0.0, -0.0, 1.0, -1.0, f64::INFINITY, f64::NEG_INFINITY, f64::NAN, 5e-324, 1e-310, f64::MAX];
        for y in odd {
            for x in odd {
                same_angle(y, x);
            }
        }
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        #[test]
        fn angles_have_the_bits_of_libm(x in prop_oneof![-4.0..4.0f64, -10.0..10.0f64, -1e-6..1e-6f64]) {
            same(x);
        }

        #[test]
        fn vectors_have_the_bits_of_libm(
            angle in -3.2..3.2f64, length in prop_oneof![0.0..10.0f64, 1e-12..1e-6f64, 1e3..1e9f64],
        ) {
            same_angle(length * angle.sin(), length * angle.cos());
        }

        #[test]
        fn whatever_the_bits_they_are_those_of_libm(x in any::<f64>(), y in any::<f64>()) {
            same(x);
            same_angle(y, x);
        }
    }
}
