//! Theorem 1 of docs/MATH.md over continuous time: whatever the guidance asks for, inputs that keep the
//! barrier rows keep every pair apart at every instant.

use clearway::certificate::barrier::{Approach, approach_exact, approach_linear, budget_m};
use clearway::geometry::{Arc, Pose, Vec2, min_distance_arcs, wrap};
use clearway::model::Obstacle;
use proptest::prelude::*;

const T: f64 = 0.08;

/// Which form of the row bounds the speed.
#[derive(Debug, Clone, Copy)]
enum Form {
    Exact,
    Linear,
}

fn approach(form: Form, pose: Pose, normal: Vec2, omega: f64, omega_max: f64, t: f64) -> Approach {
    match form {
        Form::Exact => {
            let h = pose.heading();
            approach_exact(normal.dot(&h), normal.perp(&h), omega, t)
        }
        Form::Linear => {
            let h = pose.heading();
            approach_linear(normal.dot(&h), normal.perp(&h), omega_max, t)
        }
    }
}

/// The input nearest to `wanted_mps` that the row admits.
fn admitted(a: Approach, budget: f64, wanted_mps: f64) -> f64 {
    let limit = |rate: f64| if rate > 0.0 { budget / rate } else { f64::INFINITY };
    if wanted_mps >= 0.0 { wanted_mps.min(limit(a.forward)) } else { wanted_mps.max(-limit(a.backward)) }
}

prop_compose! {
    fn any_pair()(
        rho in 0.05..2.0f64, log_gap in -6.0..0.5f64, bearing in -3.1..3.1f64,
        theta in prop::array::uniform2(-3.1..3.1f64),
        // Saturated inputs are as likely as all others together.
        v in prop::array::uniform2(prop_oneof![Just(5.0), Just(-5.0), -5.0..5.0f64]),
        omega in prop::array::uniform2(prop_oneof![Just(1.0), Just(-1.0), -1.0..1.0f64]),
        gamma in prop_oneof![Just(1.0), 0.01..1.0f64],
        t in prop_oneof![Just(0.08), 0.001..0.3f64],
    ) -> (f64, f64, [Pose; 2], [f64; 2], [f64; 2], f64, f64) {
        let gap = 10f64.powf(log_gap);
        let n = Vec2::new(bearing.cos(), bearing.sin()) * (rho + gap);
        let poses = [Pose::new(n.x, n.y, theta[0]), Pose::new(0.0, 0.0, theta[1])];
        (rho, gap, poses, v, omega, gamma, t)
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    #[test]
    fn pair_keeps_its_distance_at_every_instant(
        (rho, gap, poses, v, omega, gamma, t) in any_pair(),
        form in prop::sample::select(vec![Form::Exact, Form::Linear]),
    ) {
        let offset = poses[0].position_m - poses[1].position_m;
        let budget = budget_m(gap, gamma, 0.5);
        let arcs = [0, 1].map(|k| {
            let normal = if k == 0 { offset } else { -offset } / offset.norm();
            let a = approach(form, poses[k], normal, omega[k], 1.0, t);
            Arc { start: poses[k], v_mps: admitted(a, budget, v[k]), omega_radps: omega[k] }
        });
        let nearest = min_distance_arcs(&arcs[0], &arcs[1], t).lower_m - rho;
        prop_assert!(nearest >= (1.0 - gamma) * gap - 1e-9, "{nearest} of {gap}");
    }

    #[test]
    fn obstacle_keeps_its_distance_at_every_instant(
        (rho, _, poses, v, omega, gamma, t) in any_pair(), length in 0.0..3.0f64, along in -3.1..3.1f64,
        form in prop::sample::select(vec![Form::Exact, Form::Linear]),
    ) {
        // A segment from the origin; the robot stands outside of its keep-out.
        let to_m = Vec2::new(along.cos(), along.sin()) * length;
        let obstacle = Obstacle::Segment { from_m: Vec2::zeros(), to_m };
        let here = poses[0].position_m;
        let core = obstacle.closest_core_point(here);
        let distance = (here - core).norm();
        let rho = rho.min(0.9 * distance);
        let a = approach(form, poses[0], (here - core) / distance, omega[0], 1.0, t);
        let v_mps = admitted(a, budget_m(distance - rho, gamma, 1.0), v[0]);
        let arc = Arc { start: poses[0], v_mps, omega_radps: omega[0] };
        let nearest = obstacle.min_core_distance(&arc, t).lower_m - rho;
        prop_assert!(nearest >= (1.0 - gamma) * (distance - rho) - 1e-9, "{nearest} of {distance} − {rho}");
    }

    /// A stop with any turn rate satisfies every row at every gap: the programme is always feasible.
    #[test]
    fn stop_is_always_admissible(
        (_, gap, poses, _, omega, gamma, t) in any_pair(), form in prop::sample::select(vec![Form::Exact, Form::Linear]),
    ) {
        let a = approach(form, poses[0], Vec2::new(1.0, 0.0), omega[0], 1.0, t);
        prop_assert!(a.forward >= 0.0 && a.backward >= 0.0);
        prop_assert_eq!(admitted(a, budget_m(gap, gamma, 0.5), 0.0), 0.0);
        prop_assert_eq!(budget_m(-gap, gamma, 0.5), 0.0, "inside ρ nothing closer is admitted");
    }
}

/// Recursive feasibility: a crowd in a box driven by random saturated inputs for thousands of steps.
#[test]
fn crowd_under_random_inputs_never_comes_too_close() {
    let (rho, n, steps) = (0.45, 12, 6_000);
    for (form, gamma, seed) in [(Form::Exact, 1.0, 1u64), (Form::Linear, 1.0, 2), (Form::Exact, 0.3, 3)] {
        let mut state = seed;
        let mut unit = || {
            // SplitMix64, reduced to [0, 1).
            state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
            let mut z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        };
        let mut poses: Vec<Pose> = (0..n)
            .map(|k| Pose::new(f64::from(k % 4) * 0.8, f64::from(k / 4) * 0.8, unit() * 6.0 - 3.0))
            .collect();
        let (mut closest, mut contacts) = (f64::INFINITY, 0u64);
        for _ in 0..steps {
            let arcs: Vec<Arc> = (0..poses.len())
                .map(|i| {
                    let here = poses[i];
                    // Home when far out, so that the crowd stays a crowd.
                    let home = -here.position_m;
                    let error = wrap(home.y.atan2(home.x) - here.theta_rad);
                    let omega =
                        if home.norm() > 1.5 { error.signum() } else { (unit() * 2.0 - 1.0).signum() };
                    let wanted = if unit() < 0.2 { unit() * 5.0 } else { 5.0 };
                    let mut v = wanted;
                    for (_, other) in poses.iter().enumerate().filter(|(j, _)| *j != i) {
                        let offset = here.position_m - other.position_m;
                        let d = offset.norm();
                        let a = approach(form, here, offset / d, omega, 1.0, T);
                        v = admitted(a, budget_m(d - rho, gamma, 0.5), v);
                    }
                    Arc { start: here, v_mps: v, omega_radps: omega }
                })
                .collect();
            for i in 0..arcs.len() {
                for j in 0..i {
                    let clearance = min_distance_arcs(&arcs[i], &arcs[j], T).lower_m - rho;
                    closest = closest.min(clearance);
                    contacts += u64::from(clearance < 1e-3);
                }
            }
            poses = arcs.iter().map(|a| a.pose(T)).collect();
        }
        assert!(closest >= -1e-9, "{form:?} γ = {gamma}: {closest}");
        assert!(contacts > 100 || gamma < 1.0, "the crowd has to press: {contacts}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(4_000))]

    /// A foreign robot that moves anyhow within its bound: what is left of the gap is ours to use.
    #[test]
    fn foreign_robot_within_its_bound_is_never_hit(
        (rho, gap, poses, v, omega, gamma, t) in any_pair(), bound in 0.0..3.0f64, share in -1.0..1.0f64,
        form in prop::sample::select(vec![Form::Exact, Form::Linear]),
    ) {
        let offset = poses[0].position_m - poses[1].position_m;
        let left = gap - bound * t;
        let a = approach(form, poses[0], offset / offset.norm(), omega[0], 1.0, t);
        // Within its reach no direction is known to lead away from it: stop.
        let v_mps = if left < 0.0 { 0.0 } else { admitted(a, budget_m(left, gamma, 1.0), v[0]) };
        let ours = Arc { start: poses[0], v_mps, omega_radps: omega[0] };
        let theirs = Arc { start: poses[1], v_mps: share * bound, omega_radps: omega[1] * 3.0 };
        let nearest = min_distance_arcs(&ours, &theirs, t).lower_m - rho;
        let standing = min_distance_arcs(&Arc { v_mps: 0.0, ..ours }, &theirs, t).lower_m - rho;
        let promised = if left < 0.0 { standing } else { (1.0 - gamma) * left };
        prop_assert!(nearest >= promised - 1e-9, "{nearest} of {left}");
    }
}
