//! The candidates of a decision: what they cost before they are driven, and the best of them so far.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]

use super::Params;
use super::lanes::{least, single};
use core::f32::consts::TAU;

/// Candidate deflections, rad, counter-clockwise positive; near ones first, so that the rest is given up early.
pub(super) const DEFLECTIONS_RAD: [f64; 19] = [
    0.0, -0.06, 0.06, -0.12, 0.12, -0.2, 0.2, -0.3, 0.3, -0.42, 0.42, -0.6, 0.6, -0.85, 0.85, -1.15, 1.15,
    -1.5, -1.9,
];
/// Their cosines and sines.
const COS: [f32; DEFLECTIONS_RAD.len()] = [
    1.0,
    0.998_200_54,
    0.998_200_54,
    0.992_808_64,
    0.992_808_64,
    0.980_066_6,
    0.980_066_6,
    0.955_336_5,
    0.955_336_5,
    0.913_088_9,
    0.913_088_9,
    0.825_335_6,
    0.825_335_6,
    0.659_983_16,
    0.659_983_16,
    0.408_487_44,
    0.408_487_44,
    0.070_737_2,
    -0.323_289_57,
];
const SIN: [f32; DEFLECTIONS_RAD.len()] = [
    0.0,
    -0.059_964_005,
    0.059_964_005,
    -0.119_712_204,
    0.119_712_204,
    -0.198_669_33,
    0.198_669_33,
    -0.295_520_22,
    0.295_520_22,
    -0.407_760_44,
    0.407_760_44,
    -0.564_642_5,
    0.564_642_5,
    -0.751_280_4,
    0.751_280_4,
    -0.912_763_95,
    0.912_763_95,
    -0.997_495,
    -0.946_300_1,
];
/// Candidate shares of the full speed.
pub(super) const SPEEDS: [f32; 3] = [1.0, 0.6, 0.25];

/// One number for each deflection.
pub(super) type Deflected = [f32; DEFLECTIONS_RAD.len()];

/// What each deflection costs beside what the way does, s, when the bearing of the target is `change_rad` from the
/// heading that was steered to until now.
#[inline(always)]
pub(super) fn biases(change_rad: f32, params: &Params) -> Deflected {
    let (left, right) = (single(params.left_weight), single(params.right_weight));
    let hysteresis = single(params.hysteresis_weight);
    std::array::from_fn(|i| {
        let deflection = single(DEFLECTIONS_RAD[i]);
        let side = if deflection > 0.0 { left } else { right };
        let change = (change_rad + deflection).abs();
        side * deflection.abs() + hysteresis * least(change, (TAU - change).abs())
    })
}

/// The unit vectors that lie these deflections from the unit vector `(x, y)`.
#[inline(always)]
pub(super) fn directions(x: f32, y: f32) -> (Deflected, Deflected) {
    (std::array::from_fn(|i| x * COS[i] - y * SIN[i]), std::array::from_fn(|i| x * SIN[i] + y * COS[i]))
}

/// The best candidate so far.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Best {
    pub(super) cost: f32,
    /// Its place among all: of equal ones the first wins, in whatever order they are looked at.
    pub(super) rank: usize,
    pub(super) mean_speed_mps: f32,
}

impl Best {
    /// The cost from which on the candidate of this place does not win.
    pub(super) fn give_up(&self, rank: usize) -> f32 {
        if rank < self.rank { self.cost.next_up() } else { self.cost }
    }

    pub(super) fn offer(&mut self, cost: f32, rank: usize, mean_speed_mps: f32) {
        if cost < self.give_up(rank) {
            *self = Self { cost, rank, mean_speed_mps };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_tables_belong_to_the_deflections() {
        for (i, deflection_rad) in DEFLECTIONS_RAD.into_iter().enumerate() {
            let (sin, cos) = libm::sincos(deflection_rad);
            assert_eq!((COS[i], SIN[i]), (single(cos), single(sin)), "{deflection_rad}");
        }
    }
}
