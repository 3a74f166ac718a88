//! What a programme says of an input, and what verification says of a solution: in an example that is solved by
//! hand, and of every way in which a solution can be wrong.

use clearway::config::Weights;
use clearway::model::Command;
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::verify::{Disagreement, Residuals};
use proptest::prelude::*;

fn near(got: f64, expected: f64) -> bool {
    got == expected || (got - expected).abs() <= 1e-14 * (1.0 + expected.abs())
}

/// A programme whose solution is v = 2, ω = −2, with rows that hold with and without slack, that are active
/// and that are not.
fn programme() -> Programme {
    let weights = Weights { v: 0.5, omega: 6.0, position: 10.0, heading: 4.0, comfort: 3.0 };
    let mut p = Programme::with_capacity(weights, 4);
    // At v = 2: (−5 + 2) · 2 + 8 = 2 to be covered by slack.
    p.position = Certificate { linear: -5.0, curvature: 2.0, decrease: 8.0 };
    // At ω = −2: (7.5 − 2) · −2 + 12.5 = 1.5.
    p.heading = Certificate { linear: 7.5, curvature: 2.0, decrease: 12.5 };
    p.v_mps = Interval { min: -1.0, max: 2.0 };
    p.omega_radps = Interval { min: -2.0, max: 1.0 };
    for (coefficient, bound) in [(1.5, 1.0), (2.0, 4.0), (1.0, 5.0)] {
        assert!(p.push_comfort(Row { coefficient, bound }));
    }
    for (coefficient, bound) in [(0.5, 1.0), (-1.0, 3.0)] {
        assert!(p.push_safety(Row { coefficient, bound }));
    }
    p
}

/// Its solution. In v: 0.5 · 2 + 10 · (−5 + 4) + 3 · 1.5 + 1 · 2 + 4 · 0.5 + 0.5 = 0; in ω:
/// 6 · −2 + 4 · (7.5 − 4) − 2 = 0.
fn solution() -> Solution {
    Solution {
        v_mps: 2.0,
        omega_radps: -2.0,
        slack_position: 2.0,
        slack_heading: 1.5,
        slack_comfort: vec![2.0, 0.0, 0.0],
        dual_position: 10.0,
        dual_heading: 4.0,
        dual_comfort: vec![3.0, 1.0, 0.0],
        dual_safety: vec![4.0, 0.0],
        dual_v: [0.0, 0.5],
        dual_omega: [2.0, 0.0],
    }
}

/// The residuals of the solution with one thing changed.
fn residuals(change: impl FnOnce(&mut Solution)) -> Residuals {
    let mut changed = solution();
    change(&mut changed);
    Residuals::of(&programme(), &changed)
}

#[test]
fn the_exact_solution_leaves_nothing() {
    assert_eq!(residuals(|_| ()), Residuals::default());
    assert_eq!(residuals(|_| ()).max(), 0.0);
}

/// Violations are measured against 1 and the size of their row, multipliers against 1 and their weight.
#[test]
fn each_mistake_is_seen_for_what_it_is_and_with_its_size() {
    // The position row is 10 + 4 + 8 large.
    let r = residuals(|s| s.slack_position = 1.0);
    assert!(near(r.primal, 1.0 / 23.0) && near(r.complementarity, 10.0 / 231.0), "{r:?}");
    assert_eq!((r.dual, r.stationarity), (0.0, 0.0));
    let r = residuals(|s| s.slack_position = 3.0);
    assert!(r.primal == 0.0 && near(r.complementarity, 10.0 / 231.0), "{r:?}");
    let r = residuals(|s| s.dual_position = 12.0);
    assert!(near(r.dual, 2.0 / 11.0) && near(r.complementarity, 4.0 / 231.0), "{r:?}");
    assert!(near(r.stationarity, 2.0 / 119.0), "{r:?}");
    let r = residuals(|s| s.dual_position = 7.0);
    assert!(r.dual == 0.0 && near(r.complementarity, 6.0 / 231.0), "{r:?}");
    assert!(near(r.stationarity, 3.0 / 74.0), "{r:?}");

    // The heading row is 15 + 4 + 12.5 large.
    let r = residuals(|s| s.slack_heading = 1.0);
    assert!(near(r.primal, 0.5 / 32.5) && near(r.complementarity, 2.0 / 131.0), "{r:?}");
    let r = residuals(|s| s.dual_heading = 3.0);
    assert!(near(r.complementarity, 1.5 / 131.0) && near(r.stationarity, 3.5 / 49.5), "{r:?}");

    // Comfort rows, 4, 8 and 7 large.
    let r = residuals(|s| s.slack_comfort[0] = 1.0);
    assert!(near(r.primal, 1.0 / 5.0) && near(r.complementarity, 3.0 / 16.0), "{r:?}");
    let r = residuals(|s| s.slack_comfort[2] = -0.5);
    assert!(near(r.primal, 0.5 / 8.0) && near(r.complementarity, 1.5 / 25.0), "{r:?}");
    let r = residuals(|s| s.dual_comfort[1] = -1.0);
    assert!(near(r.dual, 1.0 / 4.0) && near(r.stationarity, 4.0 / 101.0), "{r:?}");
    let r = residuals(|s| s.dual_comfort[2] = 2.0);
    assert!(near(r.complementarity, 6.0 / 25.0) && near(r.stationarity, 2.0 / 103.0), "{r:?}");

    // Safety rows, 2 and 5 large; their multipliers are measured against themselves.
    let r = residuals(|s| s.dual_safety[1] = 2.0);
    assert!(near(r.complementarity, 10.0 / 13.0) && near(r.stationarity, 2.0 / 103.0), "{r:?}");
    assert_eq!((r.primal, r.dual), (0.0, 0.0));
    let r = residuals(|s| s.dual_safety[0] = -4.0);
    assert!(near(r.dual, 4.0 / 5.0) && near(r.stationarity, 4.0 / 101.0), "{r:?}");

    // Bounds.
    let r = residuals(|s| s.dual_v = [1.0, 0.5]);
    assert!(near(r.complementarity, 3.0 / 3.0) && near(r.stationarity, 1.0 / 102.0), "{r:?}");
    let r = residuals(|s| s.dual_omega = [2.0, 1.0]);
    assert!(near(r.complementarity, 3.0 / 3.0) && near(r.stationarity, 1.0 / 62.0), "{r:?}");
    let r = residuals(|s| s.v_mps = 3.0);
    assert!(near(r.primal, 1.0 / 3.0), "{r:?}");
    let r = residuals(|s| s.omega_radps = -3.0);
    assert!(near(r.primal, 1.0 / 3.0), "{r:?}");
}

#[test]
fn an_input_beyond_a_safety_row_is_a_violation() {
    let mut p = programme();
    p.safety[0].bound = 0.25;
    let r = Residuals::of(&p, &solution());
    assert!(near(r.primal, 0.75 / 2.25) && near(r.complementarity, 3.0 / 10.0), "{r:?}");
    let mut p = programme();
    p.v_mps.min = 2.5;
    assert!(near(Residuals::of(&p, &solution()).primal, 0.5 / 3.5));
}

/// Whatever is not a number, and whatever does not belong to this programme.
#[test]
fn what_cannot_be_checked_is_refused() {
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let places: [fn(&mut Solution) -> &mut f64; 15] = [
            |s| &mut s.v_mps,
            |s| &mut s.omega_radps,
            |s| &mut s.slack_position,
            |s| &mut s.slack_heading,
            |s| &mut s.slack_comfort[0],
            |s| &mut s.slack_comfort[2],
            |s| &mut s.dual_position,
            |s| &mut s.dual_heading,
            |s| &mut s.dual_comfort[2],
            |s| &mut s.dual_safety[0],
            |s| &mut s.dual_safety[1],
            |s| &mut s.dual_v[0],
            |s| &mut s.dual_v[1],
            |s| &mut s.dual_omega[0],
            |s| &mut s.dual_omega[1],
        ];
        for (n, place) in places.into_iter().enumerate() {
            let r = residuals(|s| *place(s) = poison);
            assert_eq!(r.max(), f64::INFINITY, "{poison} in place {n}: {r:?}");
        }
        // Poison in one multiplier may cancel against another.
        let r = residuals(|s| (s.slack_comfort[1], s.dual_comfort[1]) = (poison, -poison));
        assert_eq!(r.primal.min(r.dual).min(r.complementarity).min(r.stationarity), f64::INFINITY);
    }
    let lengths: [fn(&mut Solution) -> &mut Vec<f64>; 3] =
        [|s| &mut s.slack_comfort, |s| &mut s.dual_comfort, |s| &mut s.dual_safety];
    for list in lengths {
        for r in [residuals(|s| _ = list(s).pop()), residuals(|s| list(s).push(0.0))] {
            assert_eq!(r.primal.min(r.dual).min(r.complementarity).min(r.stationarity), f64::INFINITY);
        }
    }
}

/// A programme's numbers, and one of each kind of its rows.
const NUMBERS: [fn(&mut Programme) -> &mut f64; 19] = [
    |p| &mut p.weights.v,
    |p| &mut p.weights.omega,
    |p| &mut p.weights.position,
    |p| &mut p.weights.heading,
    |p| &mut p.weights.comfort,
    |p| &mut p.position.linear,
    |p| &mut p.position.curvature,
    |p| &mut p.position.decrease,
    |p| &mut p.heading.linear,
    |p| &mut p.heading.curvature,
    |p| &mut p.heading.decrease,
    |p| &mut p.v_mps.min,
    |p| &mut p.v_mps.max,
    |p| &mut p.omega_radps.min,
    |p| &mut p.omega_radps.max,
    |p| &mut p.comfort[0].coefficient,
    |p| &mut p.comfort[2].bound,
    |p| &mut p.safety[1].coefficient,
    |p| &mut p.safety[0].bound,
];

/// However well everything else fits.
#[test]
fn a_solution_of_what_is_no_programme_is_refused() {
    for poison in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        for (n, place) in NUMBERS.into_iter().enumerate() {
            let mut p = programme();
            *place(&mut p) = poison;
            let r = Residuals::of(&p, &solution());
            assert_eq!(r.max(), f64::INFINITY, "{poison} in place {n}: {r:?}");
            // Nor is one that asks for nothing and stands; the weight of rows that it lacks is of no matter.
            let mut p = Programme::with_capacity(Weights::default(), 0);
            if n < 15 && n != 4 {
                *place(&mut p) = poison;
                assert_eq!(Residuals::of(&p, &Solution::default()).max(), f64::INFINITY, "{poison} {n}");
            }
        }
    }
}

#[test]
fn the_largest_residual_counts() {
    let r = |primal, dual, complementarity, stationarity| {
        Residuals { primal, dual, complementarity, stationarity }.max()
    };
    let of = [r(4.0, 1.0, 2.0, 3.0), r(1.0, 4.0, 2.0, 3.0), r(1.0, 2.0, 4.0, 3.0), r(1.0, 2.0, 3.0, 4.0)];
    assert_eq!(of, [4.0; 4]);
}

#[test]
fn the_objective_is_the_cost_of_the_inputs_and_of_the_smallest_slacks() {
    let p = programme();
    // ½ (0.5 · 4 + 6 · 4), 10 · 2, 4 · 1.5, 3 · 2.
    assert_eq!(p.objective(2.0, -2.0), 13.0 + 20.0 + 6.0 + 6.0);
    // Standing costs what the certificates ask for.
    assert_eq!(p.objective(0.0, 0.0), 80.0 + 50.0);
    // ½ · 6, and (7.5 + 1) + 12.5 to be covered.
    assert_eq!(p.objective(0.0, 1.0), 3.0 + 80.0 + 84.0);
    // Beyond the second comfort row as well: 3 · (3.5 + 2).
    assert!(near(p.objective(3.0, 0.0), 2.25 + 20.0 + 50.0 + 16.5));
    let c = Certificate { linear: 2.0, curvature: 3.0, decrease: 1.0 };
    assert_eq!((c.excess(2.0), c.slope(2.0)), (11.0, 8.0));
}

proptest! {
    /// An input is in the admissible interval just when no bound and no safety row objects.
    #[test]
    fn the_admissible_interval_is_what_the_rows_leave(
        rows in prop::collection::vec((prop_oneof![-1.0..1.0f64, Just(0.0), Just(-0.0)], 0.0..1.0f64), 0..5),
        v in -2.0..6.0f64,
    ) {
        let mut p = Programme::with_capacity(Weights::default(), 5);
        p.v_mps = Interval { min: -1.0, max: 5.0 };
        for (coefficient, bound) in rows {
            let row = Row { coefficient, bound };
            prop_assert!(p.push_safety(row));
        }
        let interval = p.admissible_v();
        prop_assert!(interval.min <= 0.0 && interval.max >= 0.0, "{interval:?}");
        let ends = [interval.min, interval.max];
        prop_assume!(ends.iter().all(|end| (v - end).abs() > 1e-9));
        let holds = (-1.0..=5.0).contains(&v) && p.safety.iter().all(|row| row.excess(v) <= 0.0);
        prop_assert_eq!((interval.min..=interval.max).contains(&v), holds);
    }
}

#[test]
fn safety_rows_narrow_the_interval_from_their_side() {
    let mut p = programme();
    assert_eq!(p.admissible_v(), p.v_mps);
    for (coefficient, bound) in [(2.0, 1.0), (-4.0, 1.0)] {
        assert!(p.push_safety(Row { coefficient, bound }));
    }
    assert_eq!(p.admissible_v(), Interval { min: -0.25, max: 0.5 });
}

#[test]
fn a_row_without_a_coefficient_leaves_every_speed() {
    for coefficient in [0.0, -0.0] {
        let mut p = programme();
        p.clear_rows();
        assert!(p.comfort.is_empty() && p.safety.is_empty());
        assert!(p.push_safety(Row { coefficient, bound: 1.0 }));
        assert_eq!(p.admissible_v(), p.v_mps);
    }
}

#[test]
fn there_is_room_for_the_capacity_and_no_more() {
    let mut p = programme();
    let row = Row { coefficient: 1.0, bound: 1.0 };
    assert_eq!(p.capacity(), 4);
    assert!(p.push_comfort(row) && !p.push_comfort(row));
    assert!(p.push_safety(row) && p.push_safety(row) && !p.push_safety(row));
    assert_eq!((p.comfort.len(), p.safety.len()), (4, 4));
    // One that is just full fits, a fuller one does not and changes nothing.
    let mut copy = Programme::with_capacity(Weights::default(), 4);
    assert!(copy.copy_from(&p));
    assert_eq!(copy, p);
    let mut larger = Programme::with_capacity(Weights::default(), 5);
    for _ in 0..5 {
        assert!(larger.push_safety(row));
    }
    assert!(!copy.copy_from(&larger));
    assert_eq!(copy, p);
    let solution = Solution::with_capacity(7);
    let rooms = [&solution.slack_comfort, &solution.dual_comfort, &solution.dual_safety].map(Vec::capacity);
    assert!(rooms.into_iter().all(|room| room >= 7), "{rooms:?}");
}

#[test]
fn a_solution_begins_with_zeros_of_the_right_lengths() {
    let mut s = solution();
    s.reset(2, 5);
    let expected = Solution {
        slack_comfort: vec![0.0; 2],
        dual_comfort: vec![0.0; 2],
        dual_safety: vec![0.0; 5],
        ..Solution::default()
    };
    assert_eq!(s, expected);
    assert_eq!(solution().command(), Command { v_mps: 2.0, omega_radps: -2.0 });
}

/// One number that is not what the solvers rely on is enough.
#[test]
fn every_number_of_a_programme_is_looked_at() {
    assert!(programme().is_well_posed());
    assert!(Programme::with_capacity(Weights::default(), 0).is_well_posed());
    let refused = |place: fn(&mut Programme) -> &mut f64, value: f64| {
        let mut p = programme();
        *place(&mut p) = value;
        !p.is_well_posed()
    };
    for (n, place) in NUMBERS.into_iter().enumerate() {
        for value in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
            assert!(refused(place, value), "{value} in place {n}");
        }
    }
    // Weights above 0; curvatures and bounds not below; intervals that hold 0.
    assert!(NUMBERS[..5].iter().all(|place| refused(*place, 0.0) && refused(*place, -1.0)));
    assert!([6, 9, 16, 18].into_iter().all(|n| refused(NUMBERS[n], -1.0) && !refused(NUMBERS[n], 0.0)));
    assert!([11, 13].into_iter().all(|n| refused(NUMBERS[n], 0.1) && !refused(NUMBERS[n], 0.0)));
    assert!([12, 14].into_iter().all(|n| refused(NUMBERS[n], -0.1) && !refused(NUMBERS[n], 0.0)));
}

#[test]
fn two_answers_are_as_far_apart_as_their_inputs_and_their_costs() {
    let p = programme();
    let at = |v_mps, omega_radps| Command { v_mps, omega_radps };
    let d = Disagreement::between(&p, at(2.0, -2.0), at(0.0, 0.0));
    // 45 and 130.
    assert!(near(d.objective_rel, 85.0 / 46.0) && d.input == 2.0, "{d:?}");
    assert_eq!(Disagreement::between(&p, at(2.0, -1.0), at(2.5, 1.0)).input, 2.0);
    assert_eq!(Disagreement::between(&p, at(2.0, -1.0), at(2.0, -1.0)), Disagreement::default());
    for (a, b) in [(at(f64::NAN, 0.0), at(0.0, 0.0)), (at(0.0, 0.0), at(0.0, f64::INFINITY))] {
        let d = Disagreement::between(&p, a, b);
        assert_eq!((d.objective_rel, d.input), (f64::INFINITY, f64::INFINITY));
    }
    let (a, b) =
        (Disagreement { objective_rel: 1.0, input: 4.0 }, Disagreement { objective_rel: 3.0, input: 2.0 });
    assert_eq!(a.max(b), Disagreement { objective_rel: 3.0, input: 4.0 });
    assert!(a.within(4.0) && b.within(3.0));
    assert!(!a.within(3.9) && !b.within(2.9));
}
