//! Unit vectors of angles for the guidance, on which no safety depends: without a branch, and so side by side as well.
//!
//! Polynomials about the nearest quarter turn; their coefficients are those of Cephes (`sin`, `cos`, `sinf`, `cosf`).

use crate::geometry::{Vec2, wrap};
use core::f32::consts::FRAC_2_PI as QUARTERS_SINGLE;
use core::f64::consts::FRAC_2_PI as QUARTERS;

/// (cos, sin) of an angle, 3e-16 off at most.
#[inline]
pub(super) fn unit(angle_rad: f64) -> Vec2 {
    // Adding it leaves whole numbers.
    const WHOLE: f64 = 6_755_399_441_055_744.0;
    // π/2 in parts of which few multiples have no rounding.
    const QUARTER: [f64; 3] = [1.570_796_251_296_997, 7.549_789_415_861_596e-8, 5.390_302_858_158_119e-15];
    let angle_rad = wrap(angle_rad);
    let quarters = (angle_rad * QUARTERS + WHOLE) - WHOLE;
    let a = ((angle_rad - quarters * QUARTER[0]) - quarters * QUARTER[1]) - quarters * QUARTER[2];
    let a2 = a * a;
    let sin = [
        1.589_623_015_765_465_6e-10,
        -2.505_074_776_285_780_6e-8,
        2.755_731_362_138_572_4e-6,
        -1.984_126_982_958_954e-4,
        8.333_333_333_322_118e-3,
        -1.666_666_666_666_663e-1,
    ];
    let cos = [
        -1.135_853_652_138_768_2e-11,
        2.087_570_084_197_473e-9,
        -2.755_731_417_929_674e-7,
        2.480_158_728_885_170_4e-5,
        -1.388_888_888_887_305_6e-3,
        4.166_666_666_666_66e-2,
    ];
    let sum = |terms: [f64; 6]| terms.into_iter().fold(0.0, |sum, term| sum * a2 + term);
    let (sin, cos) = (a + a * a2 * sum(sin), 1.0 - 0.5 * a2 + a2 * a2 * sum(cos));
    let across = quarters.abs() == 1.0;
    let back = if quarters.abs() == 2.0 { -1.0 } else { 1.0 };
    Vec2::new(
        if across { -quarters * sin } else { back * cos },
        if across { quarters * cos } else { back * sin },
    )
}

/// (cos, sin) of an angle in [−π, π], 1e-7 off at most.
#[inline(always)]
pub(super) fn unit_single(angle_rad: f32) -> (f32, f32) {
    const WHOLE: f32 = 12_582_912.0;
    const QUARTER: [f32; 2] = [1.570_312_5, 4.838_268e-4];
    let quarters = (angle_rad * QUARTERS_SINGLE + WHOLE) - WHOLE;
    let a = (angle_rad - quarters * QUARTER[0]) - quarters * QUARTER[1];
    let a2 = a * a;
    let sin = a + a * a2 * (-1.666_665_5e-1 + a2 * (8.332_161e-3 - a2 * 1.951_529_6e-4));
    let cos = 1.0 - 0.5 * a2 + a2 * a2 * (4.166_664_6e-2 + a2 * (-1.388_731_6e-3 + a2 * 2.443_315_7e-5));
    let across = quarters.abs() == 1.0;
    let back = if quarters.abs() == 2.0 { -1.0 } else { 1.0 };
    (if across { -quarters * sin } else { back * cos }, if across { quarters * cos } else { back * sin })
}

#[cfg(test)]
mod tests {
    use super::super::lanes::single;
    use super::*;
    use core::f64::consts::PI;

    #[test]
    fn they_are_those_of_the_library_as_exactly_as_is_said() {
        for i in -100_000..=100_000 {
            let exactly = PI * f64::from(i) / 100_000.0;
            for angle_rad in [exactly, 3.0 * exactly] {
                let (sin, cos) = libm::sincos(wrap(angle_rad));
                let off_m = (unit(angle_rad) - Vec2::new(cos, sin)).amax();
                assert!(off_m <= 3e-16, "{angle_rad}: {off_m}");
            }
            let (sin, cos) = libm::sincos(f64::from(single(exactly)));
            let (x, y) = unit_single(single(exactly));
            let off_m = (f64::from(x) - cos).abs().max((f64::from(y) - sin).abs());
            assert!(off_m < 1e-7, "{exactly}: {off_m}");
        }
    }
}
