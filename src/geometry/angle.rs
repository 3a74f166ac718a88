use super::Vec2;
use super::trig::{atan2, sincos};
use std::f64::consts::{PI, TAU};

/// The representative of `angle_rad` in (−π, π], the interval of the paper's `wrap`.
///
/// Values already inside come back unchanged to the bit, so a heading that needs no wrapping is
/// never rounded. Not finite in, NaN out.
pub fn wrap(angle_rad: f64) -> f64 {
    if angle_rad > -PI && angle_rad <= PI {
        return angle_rad;
    }
    // One turn at most, as a sum and a difference of angles are: what the remainder gives, and quickly.
    let r = if angle_rad.abs() < TAU {
        if angle_rad < 0.0 { angle_rad + TAU } else { angle_rad }
    } else {
        angle_rad.rem_euclid(TAU)
    };
    if r > PI { r - TAU } else { r }
}

/// Unit vector (cos, sin) of an angle.
pub fn unit(angle_rad: f64) -> Vec2 {
    let (sin, cos) = sincos(angle_rad);
    Vec2::new(cos, sin)
}

/// Angle of a vector from the x axis, rad, in [−π, π]; 0 for the zero vector.
pub fn bearing(v: Vec2) -> f64 {
    atan2(v.y, v.x)
}

/// `v` turned counter-clockwise by the angle with this cosine and sine.
pub fn rotate(v: Vec2, cos: f64, sin: f64) -> Vec2 {
    Vec2::new(v.x * cos - v.y * sin, v.x * sin + v.y * cos)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn boundary_belongs_to_plus_pi() {
        assert_eq!(wrap(PI).to_bits(), PI.to_bits());
        assert_eq!(wrap(-PI).to_bits(), PI.to_bits());
        assert!(wrap(f64::NAN).is_nan());
        assert!(wrap(f64::INFINITY).is_nan());
    }

    proptest! {
        #[test]
        fn stays_in_interval_and_on_the_circle(a in -1e6..1e6f64) {
            let w = wrap(a);
            prop_assert!(w > -PI && w <= PI);
            prop_assert!((w.sin() - a.sin()).abs() < 1e-9 && (w.cos() - a.cos()).abs() < 1e-9);
            prop_assert_eq!(wrap(w).to_bits(), w.to_bits());
        }

        #[test]
        fn one_turn_is_taken_off_as_the_remainder_takes_it(a in -7.0..7.0f64) {
            let r = a.rem_euclid(TAU);
            let inside = a > -PI && a <= PI;
            let remainder = if inside { a } else if r > PI { r - TAU } else { r };
            prop_assert_eq!(wrap(a).to_bits(), remainder.to_bits());
        }
    }
}
