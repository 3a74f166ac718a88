//! What the coefficients of the certificates promise, and their numbers in examples worked by hand.

use clearway::certificate::barrier::{Approach, activation_m, approach_exact, approach_linear, budget_m};
use clearway::certificate::robust::{CONTACT_M, Margin, Reach};
use clearway::certificate::{Decrease, FiniteTime, HeadingCertificate, PositionCertificate};
use clearway::model::{Command, Disturbance, Limits};
use proptest::prelude::*;

fn near(got: f64, expected: f64) -> bool {
    (got - expected).abs() <= 1e-12 * (1.0 + expected.abs())
}

proptest! {
    /// Form F2 holds for every turn rate up to the largest, and asks for hardly more than that.
    #[test]
    fn the_linear_form_is_sound_for_all_turn_rates_and_tight(
        phi in -3.1..3.1f64, turn_rate in 0.1..3.0f64, period in 0.02..0.3f64, share in -1.0..1.0f64,
    ) {
        let x = turn_rate * period;
        let linear = approach_linear(phi.cos(), phi.sin(), turn_rate, period);
        let exact = |omega: f64| approach_exact(phi.cos(), phi.sin(), omega, period);
        let of: [fn(Approach) -> f64; 2] = [|a| a.forward, |a| a.backward];
        for (of, along) in of.into_iter().zip([phi.cos(), -phi.cos()]) {
            prop_assert!(of(linear) >= of(exact(share * turn_rate)) - 1e-12);
            let worst = [-turn_rate, 0.0, turn_rate].into_iter().map(|omega| of(exact(omega))).fold(0.0, f64::max);
            // The remainders of the series of sine and cosine that the form leaves out.
            let towards = (-along).max(0.0) * x * x / 6.0;
            let spare = period * (towards + along.max(0.0) * x.powi(4) / 120.0 + x.powi(3) / 24.0);
            prop_assert!(of(linear) <= worst + spare + 1e-12, "{} {worst} {spare}", of(linear));
        }
    }

    /// A body further than the activation distance cannot bind at full speed, one that is nearer does.
    #[test]
    fn the_activation_distance_is_where_a_row_begins_to_bind(
        required in 0.1..2.0f64, speed in 0.1..10.0f64, period in 0.01..0.5f64, rate in 0.05..1.0f64,
        share in prop_oneof![Just(0.5), Just(1.0)],
    ) {
        let at_m = activation_m(required, speed, period, rate, share);
        let budget = |distance: f64| budget_m(distance - required, rate, share);
        prop_assert!(budget(at_m + 1e-9) >= speed * period);
        prop_assert!(budget(at_m - 1e-6) < speed * period);
    }

    /// Everything that a robot can turn, it turns at most; a certificate asks for no more.
    #[test]
    fn the_heading_certificate_never_asks_for_more_than_a_turn_can_give(
        e in -3.1..3.1f64, reach in 0.01..0.5f64, alignment in 0.1..1.0f64,
    ) {
        let law = FiniteTime { c3: 0.5, alpha: 0.6 };
        let asked = Decrease::FiniteTime { law, alignment }.heading(e, reach);
        let given = (e.abs() - reach).max(0.0).cos() - e.cos();
        prop_assert!(asked <= given + 1e-12 && asked >= 0.0, "{asked} {given}");
        // Far from the reference it asks for just the share that it may.
        let v = 1.0 - e.cos();
        let share = (e.abs() - alignment * reach).max(0.0).cos() - e.cos();
        prop_assert!((asked - share.min(law.decrease(v))).abs() <= 1e-12);
    }

    /// So it is for the distance, when the robot faces its reference.
    #[test]
    fn the_position_certificate_asks_for_its_share_of_one_step(
        d in 0.0..50.0f64, reach in 0.01..1.0f64, alignment in 0.1..1.0f64,
    ) {
        let law = FiniteTime { c3: 0.5, alpha: 0.6 };
        let asked = Decrease::FiniteTime { law, alignment }.position(d, reach);
        let left = (d - alignment * reach).max(0.0);
        let share = 0.5 * (d * d - left * left);
        prop_assert!((asked - share.min(law.decrease(0.5 * d * d))).abs() <= 1e-9);
    }

    /// A capsule reaches as far as the furthest of its points.
    #[test]
    fn a_reach_extends_as_far_as_its_furthest_point(
        behind_m in 0.0..2.0f64, ahead_m in 0.0..2.0f64, error_m in 0.0..1.0f64, along in -1.0..1.0f64,
    ) {
        let reach = Reach { lead_m: 0.3, behind_m, ahead_m, error_m };
        let points = (0..=100).map(|k| f64::from(k) / 100.0 * (ahead_m + behind_m) - behind_m);
        let (mut furthest, mut extent) = (f64::NEG_INFINITY, 0.0_f64);
        for s in points {
            furthest = furthest.max(-along * s);
            extent = extent.max(s.abs());
        }
        prop_assert!((reach.towards_m(along) - (furthest + error_m)).abs() <= 1e-9);
        prop_assert!((reach.extent_m() - (extent + error_m)).abs() <= 1e-9);
    }

    /// Motion is free of a body without a gap only if it leads away whatever the true direction is.
    #[test]
    fn only_what_leads_away_for_certain_is_free_in_contact(
        angle in 0.0..3.1f64, blind in 0.0..1.1f64, heading_rad in 0.0..0.6f64, speed in prop::bool::ANY,
    ) {
        let bounds = Disturbance { heading_rad, ..Disturbance::NONE };
        let margin = Margin::new(bounds, &LIMITS, T, 0.0);
        let spread = margin.spread();
        let along = if speed { angle.cos() } else { -angle.cos() };
        let approach = margin.approach(along, 0.0, blind);
        let got = if speed { approach.forward } else { approach.backward };
        // The true direction is up to asin(blind) to the side of the one that is seen.
        let least = (0..=50).map(|k| (angle + blind.min(1.0).asin() * f64::from(k) / 50.0).cos());
        let least = least.fold(f64::INFINITY, f64::min);
        prop_assume!((least - spread).abs() > 1e-9);
        if blind < 1.0 && least >= spread {
            prop_assert_eq!(got, 0.0);
        } else {
            prop_assert!(near(got, T * (1.0 + spread)), "{got}");
        }
        // With a gap the motion across counts, and nothing is gained by driving away.
        let approach = margin.approach(along, 0.1, blind);
        let got = if speed { approach.forward } else { approach.backward };
        prop_assert!(near(got, T * (spread - angle.cos()).max(0.0)), "{got}");
    }

    /// Nobody extends further than the largest extent.
    #[test]
    fn the_largest_extent_bounds_every_reach(
        v in 0.0..5.0f64, omega in -2.0..2.0f64, left in 0.0..1.0f64, share in 0.0..1.0f64, reverses in prop::bool::ANY,
    ) {
        let limits = Limits { v_min_mps: if reverses { -5.0 } else { 0.0 }, ..LIMITS };
        let margin = Margin::new(BOUNDS.scaled(share), &limits, T, T);
        let late_s = BOUNDS.scaled(share).late_s();
        let reach = margin.reach(left * 5.0 * late_s, Command { v_mps: v, omega_radps: omega });
        prop_assert!(reach.extent_m() + reach.lead_m <= margin.extent_max_m() + 1e-12);
    }
}

#[test]
fn a_law_asks_for_its_own_decrease() {
    let law = FiniteTime { c3: 0.5, alpha: 0.6 };
    // V = 8 at 4 m; ½ · 8^0.6 = 1.741.
    assert!((Decrease::Printed(law).position(4.0, 0.1) - 1.741_101).abs() < 1e-6);
    assert_eq!(Decrease::Exponential { c3: 0.25 }.position(4.0, 0.1), 2.0);
    // V = 1 at a right angle.
    assert!(near(Decrease::Printed(law).heading(std::f64::consts::FRAC_PI_2, 0.1), 0.5));
    // V = ½ at 60°.
    assert!(near(Decrease::Exponential { c3: 0.25 }.heading(std::f64::consts::FRAC_PI_3, 0.1), 0.125));
    // Below V = 1/32 the law asks for all of it.
    assert_eq!(Decrease::Printed(law).position(0.2, 0.1), 0.5 * 0.2 * 0.2);
}

#[test]
fn the_settling_bound_is_a_number_where_there_is_one() {
    let law = FiniteTime { c3: 0.5, alpha: 0.6 };
    // r* = ½^2.5 = 0.17678; ln(45.125 / 0.17678) / −ln(1 − ½ · 45.125^−0.4) = 5.542 / 0.1154 = 48.05: 49, and one.
    assert_eq!(law.settling_bound(45.125), Some(50));
    assert_eq!(law.settling_bound(law.capture_radius()), Some(1));
    // So far away that a step changes nothing to the last bit.
    assert_eq!(FiniteTime { c3: 0.5, alpha: 0.05 }.settling_bound(1e300), None);
    assert_eq!(law.settling_bound(f64::INFINITY), None);
}

#[test]
fn settling_steps_are_found_up_to_the_limit_and_no_further() {
    let law = |c3, alpha| Decrease::FiniteTime { law: FiniteTime { c3, alpha }, alignment: 1.0 };
    // Beyond 8 m the paper's law asks for full speed: ten steps of half a metre, exactly.
    assert_eq!(law(0.5, 0.6).settling_steps(13.0, 0.5, 8.0, 10), Some(10));
    assert_eq!(law(0.5, 0.6).settling_steps(13.0, 0.5, 8.0, 9), None);
    // Seven steps of up to 4 m.
    assert_eq!(law(0.95, 0.95).settling_steps(30.0, 4.0, 3.0, 10), Some(7));
    assert!(law(0.5, 0.6).settling_steps(1.0, 0.4, 0.01, 100).is_some_and(|steps| steps < 20));
    // The printed law may ask for more than a step covers, and so arrive sooner.
    let printed = Decrease::Printed(FiniteTime { c3: 0.5, alpha: 0.6 });
    assert!(printed.settling_steps(1.0, 0.01, 0.05, 20).is_some());
}

#[test]
fn the_printed_heading_row_has_the_printed_curvature() {
    let decrease = Decrease::Exponential { c3: 0.5 };
    let row = HeadingCertificate::printed(1.0, 0.2, 1.0, &decrease);
    assert!(near(row.curvature, 0.04 * 1.0_f64.cos()));
    assert_eq!(HeadingCertificate::printed(2.0, 0.2, 1.0, &decrease).curvature, 0.0);
    assert!(near(row.linear, 0.2 * 1.0_f64.sin()) && near(row.lyapunov, 1.0 - 1.0_f64.cos()));
    // The bound uses the heading where the turn has made the error smallest.
    let bound = HeadingCertificate::new(-1.0, 0.2, 1.0, &decrease);
    assert!(near(bound.curvature, 0.04 * 0.8_f64.cos()) && near(bound.linear, -0.2 * 1.0_f64.sin()));
    assert_eq!(HeadingCertificate::new(0.1, 0.2, 1.0, &decrease).curvature, 0.2 * 0.2);
}

#[test]
fn a_position_row_is_the_fall_of_half_the_square() {
    // From 3 m, 2 of them along the heading: after v the square is 9 − 4 T v + (T v)².
    let row = PositionCertificate::new(2.0, 3.0, 0.5, 5.0, &Decrease::Exponential { c3: 0.5 });
    assert_eq!((row.lyapunov_m2, row.linear, row.curvature, row.decrease_m2), (4.5, -1.0, 0.25, 2.25));
}

const T: f64 = 0.1;

const LIMITS: Limits = Limits {
    v_min_mps: 0.0,
    v_max_mps: 5.0,
    omega_min_radps: -2.0,
    omega_max_radps: 2.0,
    safety_margin_m: 0.15,
};

const BOUNDS: Disturbance = Disturbance {
    position_m: 0.01,
    heading_rad: 0.02,
    slip: 0.03,
    turn_rate_radps: 0.5,
    lag_s: 0.2,
    delay_s: 0.04,
};

#[test]
fn each_bound_has_its_own_part_in_the_spread() {
    let spread = |bounds: Disturbance, ahead_s: f64| Margin::new(bounds, &LIMITS, T, ahead_s).spread();
    let none = Disturbance::NONE;
    // Half a period at 2 rad/s.
    assert!(near(spread(none, T), 0.1));
    assert!(near(spread(Disturbance { heading_rad: 0.02, ..none }, T), 0.12));
    assert!(near(spread(Disturbance { slip: 0.03, ..none }, T), 0.13));
    assert!(near(spread(Disturbance { position_m: 1.0, ..none }, T), 0.1));
    // 0.05 rad until the command acts, and half a period more at 0.5 rad/s.
    assert!(near(spread(Disturbance { turn_rate_radps: 0.5, ..none }, T), 0.175));
    // 2 · 2 rad/s · 0.3 s behind at the start, and 2 rad/s for 0.3 s longer.
    assert!(near(spread(Disturbance { lag_s: 0.3, ..none }, T), 1.9));
    assert!(near(spread(Disturbance { delay_s: 0.3, ..none }, T), 1.9));
    // Acting at once leaves nothing that lags, and no time to turn before.
    assert!(near(spread(Disturbance { lag_s: 0.3, ..none }, 0.0), 0.7));
    assert!(near(spread(Disturbance { turn_rate_radps: 0.5, ..none }, 0.0), 0.125));
    // All together: 0.02 + 0.05 + 0.96, 0.03, and 2.5 rad/s for 0.29 s.
    assert!(near(spread(BOUNDS, T), 1.785));
}

#[test]
fn a_reach_holds_what_is_still_to_be_travelled() {
    let command = Command { v_mps: 3.0, omega_radps: -1.5 };
    let margin = Margin::new(BOUNDS, &LIMITS, T, T);
    let reach = margin.reach(0.4, command);
    // 60 ms after it acts, e^−0.3 of the lag is left: of this command and of the 0.4 m before it.
    let kept = (-0.3_f64).exp();
    let left = 3.0 * (0.04 + 0.2 * (1.0 - kept)) + 0.4 * kept;
    assert!(near(reach.lead_m, 0.4) && near(reach.behind_m, 0.4 + left) && reach.ahead_m == 0.0);
    // Held for 0.3 m: 0.02 + 0.03 + 0.025 + 6.5 rad/s · 0.24 s. Carried on for 0.4 m: 0.02 + 0.03 + 0.15 + 0.6.
    // Left for the next: 1.03 + 0.6.
    assert!(near(reach.error_m, 0.01 + 0.3 * 1.635 + 0.4 * 0.8 + left * 1.63));
    // More than full speed times the lag is never left of earlier commands: 1 m.
    let beyond = margin.reach(9.0, Command::STOP);
    assert!(near(beyond.behind_m, 9.0 + kept));
    let both_ways = Margin::new(BOUNDS, &Limits { v_min_mps: -1.0, ..LIMITS }, T, T).reach(0.4, command);
    let expected = Reach { lead_m: 0.0, behind_m: reach.behind_m, ahead_m: reach.behind_m, ..reach };
    assert_eq!(both_ways, expected);
}

#[test]
fn a_faster_turn_widens_what_is_still_to_be_travelled() {
    let limits = Limits { omega_min_radps: -3.0, ..LIMITS };
    let bounds = Disturbance { delay_s: 0.04, ..Disturbance::NONE };
    let reach = Margin::new(bounds, &limits, T, T).reach(0.0, Command { v_mps: 3.0, omega_radps: 0.0 });
    // Held for 0.3 m: (6 + 3) rad/s · 40 ms. Left of it, 0.12 m: 2 · 3 rad/s · 40 ms and 3 rad/s · 40 ms.
    assert!(near(reach.error_m, 0.3 * 0.36 + 0.12 * 0.36));
}

#[test]
fn a_reach_under_ideal_timing_knows_only_what_is_left() {
    let reach = Margin::new(BOUNDS, &LIMITS, T, 0.0).reach(0.4, Command { v_mps: 3.0, omega_radps: 1.5 });
    assert_eq!((reach.lead_m, reach.behind_m, reach.ahead_m), (0.4, 0.4, 0.0));
    // Carried on: 0.02 + 0.03 + 0.6. Left for the next, the same 0.4 m: 0.02 + 0.6.
    assert!(near(reach.error_m, 0.01 + 0.4 * 0.65 + 0.4 * 0.62));
}

#[test]
fn without_a_lag_the_delay_alone_is_left_to_travel() {
    let bounds = Disturbance { delay_s: 0.04, ..Disturbance::NONE };
    let reach = Margin::new(bounds, &LIMITS, T, T).reach(0.0, Command { v_mps: -3.0, omega_radps: 0.0 });
    assert!(near(reach.behind_m, 0.12));
    // A delay of a whole period leaves all of the command's travel.
    let bounds = Disturbance { delay_s: 0.1, lag_s: 0.2, ..Disturbance::NONE };
    let reach = Margin::new(bounds, &LIMITS, T, T).reach(0.0, Command { v_mps: 3.0, omega_radps: 0.0 });
    assert!(near(reach.behind_m, 0.3));
}

#[test]
fn times_and_ways_of_a_robot_that_is_lost() {
    let margin = Margin::new(BOUNDS, &LIMITS, T, T);
    assert_eq!(margin.bounds(), &BOUNDS);
    // The delay and five lags.
    assert!(near(margin.rest_s(), 1.04));
    // 5 m/s · 0.24 s on the way at the start, 11.2 m after 2 s, in a direction known to 1.785 + 1 rad.
    assert!(near(margin.lost_m(2.0), 1.2 + 11.2 * 2.785));
    let fastest = margin.reach(1.2, Command { v_mps: 5.0, omega_radps: 2.0 });
    assert_eq!(margin.extent_max_m(), fastest.extent_m() + fastest.lead_m);
}

#[test]
fn a_gap_that_rounding_may_have_made_is_none() {
    let margin = Margin::new(Disturbance::NONE, &LIMITS, T, 0.0);
    let spread = margin.spread();
    assert!(near(margin.approach(-1.0, CONTACT_M, 0.0).forward, T * (1.0 + spread)));
    assert!(near(margin.approach(0.0, CONTACT_M, 0.0).forward, T * (1.0 + spread)));
    assert!(near(margin.approach(0.0, 2.0 * CONTACT_M, 0.0).forward, T * spread));
    assert_eq!(margin.approach(1.0, 0.0, 0.0).forward, 0.0);
}
