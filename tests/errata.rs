//! What the paper prints, and what comes of it: the errata of docs/MATH.md, one test a claim.

use clearway::certificate::barrier::{activation_m, approach_exact, budget_m};
use clearway::certificate::{Decrease, FiniteTime};
use clearway::config::{Config, Profile, Weights};
use clearway::controller::{Timing, printed};
use clearway::evaluation::{self, Evaluation};
use clearway::geometry::{Arc, Pose, Vec2, min_distance_arcs};
use clearway::model::{Limits, RobotId, RobotSpec};
use clearway::programme::{Certificate, Interval, Programme, Row, Solution};
use clearway::scenario::Scenario;
use clearway::solver::{ExactSolver, Outcome, Solver};
use proptest::prelude::*;

const T: f64 = 0.08;
const RHO: f64 = 0.45;
// ρ² = 0.2025 m², which the printed margin of 0.66 m² and more exceeds threefold.
const PRINTED: FiniteTime = FiniteTime { c3: 0.5, alpha: 0.6 };

fn solve(programme: &Programme) -> Solution {
    let mut solution = Solution::with_capacity(programme.capacity());
    assert_eq!(ExactSolver.solve(programme, &mut solution), Outcome::Solved);
    solution
}

/// A robot `d` metres from its goal and facing it.
fn aligned(d: f64, decrease: f64) -> Programme {
    let mut p = Programme::with_capacity(Weights::default(), 4);
    p.position = Certificate { linear: -T * d, curvature: T * T, decrease };
    p.v_mps = Interval { min: 0.0, max: 5.0 };
    p.omega_radps = Interval { min: -1.0, max: 1.0 };
    p
}

fn run(name: &str, change: impl FnOnce(&mut Config)) -> Evaluation {
    let mut config = Config::new(Scenario::builtin(name).unwrap());
    change(&mut config);
    evaluation::run(&config, Timing::Ideal, |_, _| {}).unwrap()
}

/// (33) Q: with the printed sign V may grow, so nobody has a reason to move.
#[test]
fn printed_sign_of_q_lets_everybody_stand_still() {
    let q = PRINTED.decrease(0.5 * 9.5 * 9.5);
    assert_eq!(solve(&aligned(9.5, -q)).v_mps, 0.0, "as printed");
    assert!(solve(&aligned(9.5, q)).v_mps > 4.9, "with the sign of Definition 2");
}

/// (25), (33d): a slack on the right of ≥ only tightens; with none there are states that not even a
/// stop satisfies.
#[test]
fn printed_slack_cannot_relax() {
    let row = |v: f64, v_j: f64, d: f64, slack: f64| {
        let closing = v + v_j;
        let change = -2.0 * T * d * closing + T * T * closing * closing;
        let b = d * d - RHO * RHO;
        let margin = T * T * printed::phi(d, &Limits::default());
        change >= -printed::GAMMA_PER_S * T * b - margin + slack
    };
    let d = 1.3;
    assert!(d * d - RHO * RHO <= printed::ACTIVATION_M2, "the row is active");
    for slack in [0.0, 0.1, 1.0] {
        assert!(!row(5.0, 5.0, d, slack), "refused at every slack");
    }
    // At a smaller distance the slack is what makes it fail.
    assert!(row(5.0, 5.0, 0.7, 0.0) && !row(5.0, 5.0, 0.7, 1.0));
}

proptest! {
    /// (7), (33d): up to 0.49 m² of barrier, 0.83 m between the centres, no input at all is excluded.
    #[test]
    fn printed_margin_excludes_nothing_near_contact(
        b in 0.0..0.46f64, bearing in -3.1..3.1f64, heading in -3.1..3.1f64,
        v_i in 0.0..5.0f64, v_j in 0.0..5.0f64,
    ) {
        let d = (b + RHO * RHO).sqrt();
        let offset = Vec2::new(d, 0.0);
        let drift = Vec2::new(bearing.cos(), bearing.sin()) * v_i - Vec2::new(heading.cos(), heading.sin()) * v_j;
        let change = 2.0 * T * offset.dot(&drift) + T * T * drift.norm_squared();
        let margin = T * T * printed::phi(d, &Limits::default());
        prop_assert!(margin > 0.66, "{margin}");
        prop_assert!(change >= -printed::GAMMA_PER_S * T * b - margin);
    }

    /// (32): beyond the activation distance a row holds at full speed straight ahead.
    #[test]
    fn rows_beyond_the_activation_distance_cannot_bind(
        beyond in 0.0..5.0f64, gamma in 0.05..1.0f64, share in prop::sample::select(vec![0.5, 1.0]),
        omega in -1.0..1.0f64, phi in -3.1..3.1f64,
    ) {
        let d = activation_m(RHO, 5.0, T, gamma, share) + beyond;
        prop_assert!(5.0 * approach_exact(phi.cos(), phi.sin(), omega, T).forward <= budget_m(d - RHO, gamma, share) + 1e-12);
    }

    /// Remark 1 is backwards: a larger γ admits a faster approach.
    #[test]
    fn larger_gamma_admits_more(gap in 0.0..3.0f64, a in 0.01..1.0f64, b in 0.01..1.0f64) {
        prop_assert_eq!(a < b, budget_m(gap, a, 0.5) < budget_m(gap, b, 0.5) || gap == 0.0 && a < b);
    }
}

/// (33d) and soft safety: the printed law on the paper's own scenario.
#[test]
fn printed_law_drives_robots_through_each_other() {
    for name in ["swap8", "swap8-zero"] {
        let e = run(name, |c| c.controller.profile = Profile::Paper);
        let centres = e.figures.min_clearance_m.unwrap() + RHO;
        assert!(e.figures.violations > 0 && centres < 0.1, "{name}: {centres} m, {e:?}");
    }
}

/// A constant margin on the safe side: at contact not even standing still is admitted.
#[test]
fn constant_margin_on_the_safe_side_is_not_recursively_feasible() {
    let b = 0.01;
    let margin = T * T * printed::phi((b + RHO * RHO).sqrt(), &Limits::default());
    let change_at_rest = 0.0;
    assert!(change_at_rest < -printed::GAMMA_PER_S * T * b + margin);
    // The budget in use admits a stop at every gap.
    assert!((0..100).all(|k| budget_m(f64::from(k) * 0.01, 1.0, 0.5) >= 0.0));
}

/// ΔB is taken between end points, and + T²‖b‖² makes up for what − 2T Δp·b takes: two robots that
/// change places within one period satisfy the row and meet half-way.
#[test]
fn end_point_row_lets_robots_tunnel() {
    let (d, t): (f64, f64) = (1.0, 0.2);
    let closing = 2.0 * d / t;
    let change = -2.0 * t * d * closing + t * t * closing * closing;
    assert!(change.abs() < 1e-12, "ΔB = 0 satisfies every DCBF row");
    let arc =
        |x: f64, theta: f64| Arc { start: Pose::new(x, 0.0, theta), v_mps: 0.5 * closing, omega_radps: 0.0 };
    let met = min_distance_arcs(&arc(-0.5, 0.0), &arc(0.5, std::f64::consts::PI), t);
    assert!(met.upper_m < 1e-9);
}

/// w_r δ_r beside w_p δ_p: far from the goal the certificate outbids a row that only has a slack.
#[test]
fn soft_safety_is_outbid_at_oblique_angles() {
    let d_goal = 9.5;
    let oblique = Row { coefficient: 2.0 * T * RHO * 0.7, bound: 0.0 };
    let mut p = aligned(d_goal, Decrease::Printed(PRINTED).position(d_goal, 0.4));
    assert!(p.push_comfort(oblique));
    let s = solve(&p);
    assert!(s.v_mps > 4.9 && s.slack_comfort[0] > 0.0, "drives on although the row asks for a stop: {s:?}");
    p.clear_rows();
    assert!(p.push_safety(oblique));
    assert_eq!(solve(&p).v_mps, 0.0, "the same row without slack");
}

/// u_j unknown: when both take the other to stand still and use the whole gap, they collide.
#[test]
fn taking_the_other_to_stand_still_is_unsound() {
    let gap = 0.3;
    let arc =
        |x: f64, theta: f64, v_mps: f64| Arc { start: Pose::new(x, 0.0, theta), v_mps, omega_radps: 0.0 };
    let met = |share: f64| {
        let v = budget_m(gap, 1.0, share) / T;
        min_distance_arcs(&arc(0.0, 0.0, v), &arc(RHO + gap, std::f64::consts::PI, v), T).lower_m
    };
    assert!(met(1.0) < RHO - 0.2, "whole gap each");
    assert!(met(0.5) >= RHO - 1e-12, "half of the gap each");
}

/// (30): the printed √cos e has no real value beyond a right angle.
#[test]
fn printed_heading_curvature_is_imaginary_beyond_a_right_angle() {
    assert!(2.0f64.cos().sqrt().is_nan());
}

/// ∂ΔB/∂ω = 0: without guidance the sound law is safe, and nobody arrives on the swap.
#[test]
fn one_step_barriers_cannot_steer() {
    let e = run("swap8", |c| {
        c.controller.guidance = false;
        c.scenario.duration_s = 30.0;
    });
    assert_eq!((e.figures.arrived, e.figures.violations), (0, 0), "{e:?}");
    assert_eq!(e.figures.stalled, 8);
}

/// Plant: forward Euler misses up to 16 mm of arc in one step.
#[test]
fn forward_euler_hides_the_arc() {
    let arc = Arc { start: Pose::default(), v_mps: 5.0, omega_radps: 1.0 };
    let euler = arc.start.position_m + arc.start.heading() * (arc.v_mps * T);
    let missed = (arc.position(T) - euler).norm();
    assert!((0.0155..0.0165).contains(&missed), "{missed}");
}

/// Q_sat: an aligned robot that nothing holds back never needs its slack, and arrives in the step that
/// the scalar recursion predicts.
#[test]
fn aligned_unblocked_robot_meets_its_certificate_and_its_prediction() {
    for d in [0.7, 3.0, 9.5, 40.0] {
        let mut scenario = Scenario::builtin("head-on").unwrap();
        let start = Pose::new(0.0, 0.0, 0.0);
        scenario.robots = vec![RobotSpec {
            id: RobotId(0),
            radius_m: 0.15,
            start,
            goal_m: Vec2::new(d, 0.0),
            foreign_speed_mps: None,
        }];
        let config = Config::new(scenario);
        let decrease = Decrease::of(&config.controller);
        let predicted = decrease.settling_steps(d, 0.4, config.scenario.tolerance_m, 10_000).unwrap();
        let mut fleet = evaluation::initial_fleet(&config);
        let mut group = clearway::controller::RobotGroup::new(&config, 0..1).unwrap();
        let mut steps = 0;
        while (fleet[0].position_m() - fleet[0].goal_m()).norm() > config.scenario.tolerance_m {
            let mut next = fleet[0];
            group.solve(&fleet, Timing::Ideal, |_, decision| {
                let t = &decision.telemetry;
                // The last step is asked to land exactly, where the effort ½R₁v² has its small say.
                let landing = t.lyapunov_position_m2 <= 0.5 * 0.4 * 0.4 * (1.0 + 1e-9);
                assert!(landing || t.slack_position_m2 < 1e-9, "{d} m, step {steps}: {t:?}");
                next.set_command(decision.command.command());
            });
            next.set_pose(next.arc().pose(T));
            fleet[0] = next;
            steps += 1;
            assert!(steps <= predicted + 1, "{d} m: predicted {predicted}");
        }
        assert!(steps >= predicted, "{d} m: {steps} < {predicted}");
    }
}
