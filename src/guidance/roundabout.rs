//! Virtual roundabout: how far clockwise of its target a robot steers, so that everybody converging on the same place
//! forms a ring with room enough.
//!
//! Let two robots drive straight to their targets at full speed: d their distance, α the signed angle between the line
//! to the other and the relative velocity, so that they miss each other by d sin α. If both turn clockwise by the same
//! β, the relative velocity turns by β too and the miss distance becomes d sin(α + β). Hence
//!
//!   β = max over converging neighbours of asin(s / d) − α,  s = ρ + `lane_gap_m`,
//!
//! gives everybody a lane of width s. On a circle of N robots it is the ring of circumference N s, and no robot needs
//! to know N. It depends on positions and targets only, so it does not oscillate.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::Params;
use super::lanes::{Which, bits};
use super::shown::{Listed, Shown};
use super::types::{Ego, Limits, NEIGHBOURS_MAX};
use crate::geometry::Vec2;

/// Share of the horizon over which a conflict fades in.
const FADE: f64 = 0.3;

/// Clockwise rotation of the target, rad, in [0, `lane_beta_max_rad`].
pub(super) fn rotation(ego: &Ego, neighbours: &Shown, limits: &Limits, params: &Params) -> f64 {
    let to = ego.target_m - ego.position_m;
    let left = to.norm();
    if left < 1e-6 {
        return 0.0;
    }
    let mine = to * (limits.v_max_mps / left);
    let my_time = left / limits.v_max_mps;
    let Meetings { time_s, miss_m, side, lane_m, matter } =
        Meetings::of(neighbours.lanes(), mine, my_time, limits, params);
    let (mut left_side, mut right_side) = (Side::default(), Side::default());
    for at in Which(matter & neighbours.driving().0) {
        let (d, miss, lane) = (neighbours.lanes().distance_m[at], miss_m[at], lane_m[at]);
        // A clear miss on the other side is left alone.
        let keep = if miss >= 0.0 { 1.0 } else { (1.0 + miss / params.lane_wrong_m).max(0.0) };
        let soon = ((1.0 - time_s[at] / params.lane_horizon_s) / FADE).clamp(0.0, 1.0);
        // Later conflicts count once neighbours close in on both sides: a big ring must not shrink too far first.
        let close = (params.lane_close - d / lane).clamp(0.0, 1.0);
        if keep * soon.max(close) == 0.0 {
            continue;
        }
        let need = libm::asin((lane / d).min(1.0)) - libm::asin((miss / d).clamp(-1.0, 1.0));
        if need <= 0.0 {
            continue;
        }
        let side = if side[at] > 0.0 { &mut left_side } else { &mut right_side };
        side.now_rad = side.now_rad.max(need * keep * soon);
        side.later_rad = side.later_rad.max(need * keep * close);
    }
    let single = params.lane_single * left_side.now_rad.max(right_side.now_rad);
    let now = left_side.now_rad.min(right_side.now_rad);
    let later = left_side.later_rad.min(right_side.later_rad);
    single.max(now).max(later).min(params.lane_beta_max_rad)
}

/// Largest turns that the neighbours on one side ask for.
#[derive(Clone, Copy, Default)]
struct Side {
    now_rad: f64,
    later_rad: f64,
}

/// How the robot meets its neighbours when all drive straight on; one number for each of them.
#[derive(Debug)]
struct Meetings {
    /// Until they are nearest to each other.
    time_s: [f64; NEIGHBOURS_MAX],
    /// How near that is; positive when the neighbour stays on the left, as the rule wants.
    miss_m: [f64; NEIGHBOURS_MAX],
    /// Positive for those on the left.
    side: [f64; NEIGHBOURS_MAX],
    /// Width of the lane between them.
    lane_m: [f64; NEIGHBOURS_MAX],
    /// Which of them matter if they drive.
    matter: u32,
}

impl Meetings {
    fn of(listed: &Listed, mine: Vec2, my_time: f64, limits: &Limits, params: &Params) -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
            {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { Self::of_avx512(listed, mine, my_time, limits, params) };
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { Self::of_avx2(listed, mine, my_time, limits, params) };
            }
        }
        Self::of_all(listed, mine, my_time, limits, params)
    }

    /// [`of_all`](Self::of_all) for wider registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn of_avx512(listed: &Listed, mine: Vec2, my_time: f64, limits: &Limits, params: &Params) -> Self {
        Self::of_all(listed, mine, my_time, limits, params)
    }

    /// [`of_all`](Self::of_all) for wide registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn of_avx2(listed: &Listed, mine: Vec2, my_time: f64, limits: &Limits, params: &Params) -> Self {
        Self::of_all(listed, mine, my_time, limits, params)
    }

    /// Of all of them side by side, without a branch: which of them matter is hard to guess.
    #[inline(always)]
    fn of_all(listed: &Listed, mine: Vec2, my_time: f64, limits: &Limits, params: &Params) -> Self {
        let Listed { x_m, y_m, to_x_m, to_y_m, distance_m, required_m, .. } = listed;
        let none = [0.0; NEIGHBOURS_MAX];
        let v_max = limits.v_max_mps;
        let mut all = Self { time_s: none, miss_m: none, side: none, lane_m: none, matter: 0 };
        let mut matter = [false; NEIGHBOURS_MAX];
        for at in 0..NEIGHBOURS_MAX {
            let (x, y, d) = (-x_m[at], -y_m[at], distance_m[at]);
            let (to_x, to_y) = (to_x_m[at], to_y_m[at]);
            let their_left = (to_x * to_x + to_y * to_y).sqrt();
            let share = v_max / their_left;
            let (relative_x, relative_y) = (mine.x - to_x * share, mine.y - to_y * share);
            let approach = x * relative_x + y * relative_y;
            let speed = (relative_x * relative_x + relative_y * relative_y).sqrt();
            let time = approach / speed / speed;
            let miss = (relative_x * y - relative_y * x) / speed;
            let lane = required_m[at] + params.lane_gap_m;
            (all.time_s[at], all.miss_m[at], all.lane_m[at]) = (time, miss, lane);
            all.side[at] = mine.x * y - mine.y * x;
            // They come nearer, neither is at its target before they meet, and it is no clear miss.
            matter[at] = (their_left >= 1e-6)
                & (approach > 0.0)
                & (speed >= 1e-3)
                & (d >= 1e-6)
                & (time <= my_time)
                & (time <= their_left / v_max)
                & (miss < lane);
        }
        all.matter = bits(matter);
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::shown::with_all;
    use crate::guidance::types::{Intent, Neighbour};
    use proptest::prelude::*;

    proptest! {
        /// However wide the registers are, robots meet as they do one by one.
        #[test]
        fn the_width_of_registers_changes_no_bit(
            places in prop::collection::vec((-3.0..3.0f64, -3.0..3.0f64, -6.0..6.0f64, -6.0..6.0f64), 0..=16),
            (x_mps, y_mps, my_time) in (-5.0..5.0f64, -5.0..5.0f64, 0.0..5.0f64),
        ) {
            let (limits, params) =
                (Limits { v_max_mps: 5.0, omega_max_radps: 1.0, period_s: 0.08 }, Params::default());
            let neighbours: Vec<Neighbour> = places.iter().map(|(x, y, to_x, to_y)| {
                let (position_m, target_m) = (Vec2::new(*x, *y), Vec2::new(*to_x, *to_y));
                let intent = Intent { target_m, speed_mps: 2.0, ..Intent::default() };
                Neighbour { position_m, target_m, intent, ..Neighbour::default() }
            }).collect();
            with_all(Vec2::zeros(), 0.45, (&neighbours, true), |shown| {
                let (listed, mine) = (shown.lanes(), Vec2::new(x_mps, y_mps));
                let narrow = format!("{:?}", Meetings::of_all(listed, mine, my_time, &limits, &params));
                prop_assert_eq!(format!("{:?}", Meetings::of(listed, mine, my_time, &limits, &params)), &narrow[..]);
                #[cfg(target_arch = "x86_64")]
                if std::arch::is_x86_feature_detected!("avx2") {
                    // SAFETY: the processor has what the function was compiled for.
                    let half = unsafe { Meetings::of_avx2(listed, mine, my_time, &limits, &params) };
                    prop_assert_eq!(format!("{half:?}"), &narrow[..]);
                }
                Ok(())
            })?;
        }
    }
}
