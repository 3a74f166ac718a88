//! The last check before a command goes out: the exact motion against the bodies, not the programme.
//!
//! Who is near, how far beyond the required distance, and which share of that gap is ours: that it takes
//! from the rows' [bodies](super::bodies::gather), and a mistake there it would share. Those are looked for
//! from outside, by the theorem's tests over continuous time and by the simulator, each with a geometry of
//! its own. What it does not take over is what the rows make of them. They were computed from closed forms
//! of the approach, and the command is what a solver made of the rows; here the arc itself is held against
//! the line that it must not cross, by the branch and bound that measures clearances, unless its length
//! alone keeps it from there. For disturbed robots it is the disc that holds all that the command may still do.

use super::Law;
use super::bodies::Body;
use super::rows::{Approaching, is_out_of_reach};
use crate::certificate::barrier::budget_m;
use crate::certificate::robust::CONTACT_M;
use crate::geometry::{Arc, Pose, Vec2, bearing, min_distance_arc_segment, unit};
use crate::model::Command;

/// Rounding that the check forgives, m.
const ROUNDING_M: f64 = 1e-11;

/// Margin beyond which rounding decides nothing, as a part of the way.
const CLEAR: f64 = 1e-9;

/// Holds `command` back to the largest speed that keeps its share of every gap at its turn rate, by a robot from
/// that pose on, with its heading as a vector. Whether it then is admissible, and keeps it at every instant of
/// the period.
pub(super) fn held_back(
    law: &Law,
    (start, ahead): (Pose, Vec2),
    bodies: &[Body],
    command: &mut Command,
) -> bool {
    if bodies.iter().all(|body| is_clear(law, ahead, body, *command)) {
        return law.limits.admits(*command);
    }
    let limit = speed_limit_mps(law, ahead, bodies, *command);
    command.v_mps = command.v_mps.clamp(-limit, limit);
    is_safe(law, start, bodies, *command)
}

/// Whether a body is so far off, or so far to the side, that no way of this command's length leads across its line
/// whatever it bends: it keeps clear of it and does not limit its speed.
fn is_clear(law: &Law, ahead: Vec2, body: &Body, command: Command) -> bool {
    let driven_m = command.v_mps.abs() * law.period_s;
    let budget_m = budget_m(body.gap_m, law.control.gamma, body.share);
    let is_within = |towards: f64| driven_m * (towards + CLEAR) <= budget_m;
    let towards = -body.normal.dot(&ahead) * command.v_mps.signum();
    let most = towards + (command.omega_radps * law.period_s).abs();
    law.margin.is_none() && !body.anywhere && (is_within(1.0) || is_within(most))
}

/// Largest |v| of `command`'s sign that keeps its share of every gap at its turn rate, by a robot that heads along
/// `ahead`, m/s.
fn speed_limit_mps(law: &Law, ahead: Vec2, bodies: &[Body], command: Command) -> f64 {
    let mut limit = law.limits.speed_mps();
    let approaching = Approaching::new(law, ahead, command.omega_radps);
    for body in bodies {
        let budget_m = budget_m(body.gap_m, law.control.gamma, body.share);
        if is_out_of_reach(law, ahead, command.omega_radps.abs(), body, budget_m) {
            continue;
        }
        let approach = approaching.exact(body);
        let rate = if command.v_mps < 0.0 { approach.backward } else { approach.forward };
        if rate > 0.0 {
            limit = limit.min(budget_m / rate);
        }
    }
    limit
}

/// Whether `command` from `start` on is admissible and keeps its share of every gap at every instant of the period.
fn is_safe(law: &Law, start: Pose, bodies: &[Body], command: Command) -> bool {
    let arc = Arc { start, v_mps: command.v_mps, omega_radps: command.omega_radps };
    law.limits.admits(command)
        && bodies.iter().all(|body| {
            let budget_m = budget_m(body.gap_m, law.control.gamma, body.share);
            match &law.margin {
                None => keeps_clear(&arc, body, budget_m, law.period_s),
                Some(margin) => keeps_clear_disturbed(&arc, body, budget_m, law.period_s, margin.spread()),
            }
        })
}

/// Whether the disc that holds everything the command may still do by the time it is done is on the
/// robot's side of the line that lies its budget towards the body; without a gap, of every line that
/// the body may be behind.
fn keeps_clear_disturbed(arc: &Arc, body: &Body, budget_m: f64, period_s: f64, spread: f64) -> bool {
    if arc.v_mps == 0.0 {
        return true;
    }
    let travel = arc.start.heading() * (arc.v_mps * period_s);
    let radius_m = travel.norm() * spread;
    if body.gap_m > CONTACT_M && !body.anywhere {
        return radius_m - body.normal.dot(&travel) <= budget_m + ROUNDING_M;
    }
    // Both edges of the cone of directions around the normal.
    let blind_rad = libm::asin(body.blind.min(1.0));
    !body.anywhere
        && body.blind < 1.0
        && [blind_rad, -blind_rad].into_iter().all(|turn| {
            let edge = unit(bearing(body.normal) + turn);
            edge.dot(&travel) >= radius_m - ROUNDING_M
        })
}

/// Whether the arc stays on the robot's side of the line that lies its budget towards the body.
fn keeps_clear(arc: &Arc, body: &Body, budget_m: f64, period_s: f64) -> bool {
    if body.anywhere {
        return arc.v_mps == 0.0;
    }
    let driven = arc.v_mps.abs() * period_s;
    if driven <= budget_m {
        return true;
    }
    // It turns by no more than |ω|T, so no more of the way than this leads towards the line.
    let towards = -body.normal.dot(&arc.start.heading()) * arc.v_mps.signum();
    if driven * (towards + (arc.omega_radps * period_s).abs()) <= budget_m {
        return true;
    }
    // Within half a turn it turns across the line's direction once at most. Where it does not, because it heads to
    // the same side at both ends, one of the ends is nearest.
    let heads = |velocity: Vec2| -body.normal.dot(&velocity);
    let (first, last) = (heads(arc.velocity(0.0)), heads(arc.velocity(period_s)));
    if (arc.omega_radps * period_s).abs() < 3.0 && first * last >= 0.0 {
        let moved = arc.position(period_s) - arc.start.position_m;
        return -body.normal.dot(&moved) <= budget_m + ROUNDING_M;
    }
    // Measured from a metre behind the line, long enough for any motion of this period.
    let behind_m = 1.0;
    let foot = arc.start.position_m - body.normal * (budget_m + behind_m);
    let along = Vec2::new(-body.normal.y, body.normal.x) * (driven + behind_m);
    min_distance_arc_segment(arc, foot - along, foot + along, period_s).lower_m >= behind_m - ROUNDING_M
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::certificate::barrier::approach_exact;
    use crate::certificate::robust::Margin;
    use crate::config::Config;
    use crate::controller::Timing;
    use crate::controller::bodies::gather;
    use crate::model::{Disturbance, Limits};
    use crate::neighbours::{NO_PLACE, Nearby};
    use crate::scenario::Scenario;
    use crate::wire::{RobotState, state_flags};
    use proptest::prelude::*;

    fn around(law: &Law, fleet: &[RobotState], me: usize, near: &[Nearby]) -> Vec<Body> {
        let mut found = Vec::new();
        assert!(gather(law, fleet, me, near, (law.bodies_max(), &mut found)).is_some());
        found
    }

    fn is_safe(law: &Law, fleet: &[RobotState], me: usize, near: &[Nearby], command: Command) -> bool {
        super::is_safe(law, fleet[me].pose(), &around(law, fleet, me, near), command)
    }

    fn speed_limit_mps(law: &Law, fleet: &[RobotState], me: usize, near: &[Nearby], command: Command) -> f64 {
        super::speed_limit_mps(law, unit(fleet[me].theta_rad), &around(law, fleet, me, near), command)
    }

    proptest! {
        /// At whatever states, overlapping, unseen and foreign ones included, turning on the spot passes;
        /// driving at full speed towards one that touches does not.
        #[test]
        fn a_stop_passes_at_every_state_and_a_drive_into_contact_at_none(
            poses in prop::collection::vec((-2.0..2.0f64, -2.0..2.0f64, -3.1..3.1f64, 0.0..5.0f64, any::<bool>()), 8),
            doubts in prop::collection::vec(prop_oneof![3 => 0.0..0.5f64, 1 => Just(f64::INFINITY)], 8),
            bounds in (0.0..0.1f64, 0.0..0.2f64, 0.0..0.2f64, 0.0..0.3f64, 0.0..0.15f64, 0.0..0.08f64),
            foreign in 0..8usize, turn in -1.0..1.0f64, exact in any::<bool>(),
        ) {
            let mut scenario = Scenario::builtin("swap8").unwrap();
            scenario.robots[foreign].foreign_speed_mps = Some(0.5);
            let mut config = Config::new(scenario);
            if !exact {
                let (position_m, heading_rad, slip, turn_rate_radps, lag_s, delay_s) = bounds;
                config.robust = Disturbance { position_m, heading_rad, slip, turn_rate_radps, lag_s, delay_s };
            }
            let mut fleet: Vec<_> = config.scenario.robots.iter().map(RobotState::at_start).collect();
            for ((robot, pose), doubt_m) in fleet.iter_mut().zip(&poses).zip(&doubts) {
                robot.set_pose(Pose::new(pose.0, pose.1, pose.2));
                (robot.v_mps, robot.uncertainty_m) = (pose.3, *doubt_m);
                robot.flags |= if pose.4 { state_flags::VALID } else { 0 };
            }
            let mut law = Law::new(&config);
            law.prepare(&fleet, Timing::default());
            for me in 0..fleet.len() {
                let others = (0..fleet.len()).filter(|index| *index != me);
                let near: Vec<Nearby> = others.map(|index| Nearby {
                    distance_m: (fleet[index].position_m() - fleet[me].position_m()).norm(),
                    id: fleet[index].id,
                    index,
                    place: NO_PLACE,
                }).collect();
                let stop = Command { v_mps: 0.0, omega_radps: turn * law.limits.turn_rate_radps() };
                prop_assert!(is_safe(&law, &fleet, me, &near, stop), "{me}");
                let mut touching = fleet.clone();
                let other = (me + 1) % touching.len();
                let ahead = fleet[me].pose();
                let p = ahead.position_m + ahead.heading() * 0.1;
                touching[other].set_pose(Pose::new(p.x, p.y, 0.0));
                let near = [Nearby { distance_m: 0.1, id: fleet[other].id, index: other, place: NO_PLACE }];
                let drive = Command { v_mps: law.limits.v_max_mps, omega_radps: 0.0 };
                prop_assert!(!is_safe(&law, &touching, me, &near, drive), "{me}");
                prop_assert!(is_safe(&law, &touching, me, &near, stop), "{me}");
            }
        }

        /// The line and the closed form draw the same border, from both sides.
        #[test]
        fn check_agrees_with_the_closed_form_and_refuses_just_beyond_it(
            theta in -3.1..3.1f64, bearing in -3.1..3.1f64, v in -5.0..5.0f64,
            omega in prop_oneof![-3.0..3.0f64, -40.0..40.0f64], budget in 0.0..0.3f64, t in 0.01..0.3f64,
        ) {
            let normal = unit(bearing);
            let body = Body { normal, gap_m: budget, share: 1.0, anywhere: false, blind: 0.0 };
            let arc = Arc { start: Pose::new(1.0, -2.0, theta), v_mps: v, omega_radps: omega };
            let approach = approach_exact((theta - bearing).cos(), (theta - bearing).sin(), omega, t);
            let used = v.abs() * if v < 0.0 { approach.backward } else { approach.forward };
            prop_assume!((used - budget).abs() > 1e-9);
            prop_assert_eq!(keeps_clear(&arc, &body, budget, t), used < budget);
            // What the closed form allows to the last bit is not refused for rounding.
            prop_assert!(keeps_clear(&arc, &body, used, t));
            let anywhere = Body { anywhere: true, ..body };
            prop_assert_eq!(keeps_clear(&arc, &anywhere, budget, t), v == 0.0);
        }

        /// The disc and the closed form for disturbed robots draw the same border; without a gap nothing
        /// passes that does not lead away in every direction that may be the true one.
        #[test]
        fn check_of_the_disturbed_agrees_with_their_closed_form(
            theta in -3.1..3.1f64, bearing in -3.1..3.1f64, v in prop_oneof![9 => -5.0..5.0f64, 1 => Just(0.0)],
            gap in prop_oneof![Just(-0.1), Just(0.0), Just(CONTACT_M), 0.001..0.3f64], share in 0.1..1.0f64,
            blind in 0.0..1.1f64, heading_rad in 0.0..0.5f64, t in 0.01..0.3f64, anywhere in prop::bool::weighted(0.1),
        ) {
            let bounds = Disturbance { heading_rad, ..Disturbance::NONE };
            let margin = Margin::new(bounds, &Limits::default(), t, 0.0);
            let spread = margin.spread();
            let body = Body { normal: unit(bearing), gap_m: gap, share, anywhere, blind };
            let arc = Arc { start: Pose::new(1.0, -2.0, theta), v_mps: v, omega_radps: 0.3 };
            let budget = budget_m(gap, 0.3, share);
            let along = (theta - bearing).cos() * v.signum();
            let approach = margin.approach(along, gap, blind);
            let used = v.abs() * approach.forward;
            let edge = (along.clamp(-1.0, 1.0).acos() + blind.min(1.0).asin()).cos();
            let near_the_border = (used - budget).abs() < 1e-9 || (edge - spread).abs() * v.abs() * t < 1e-9;
            prop_assume!(v == 0.0 || anywhere || !near_the_border);
            let expected = v == 0.0 || used <= budget && !anywhere;
            prop_assert_eq!(keeps_clear_disturbed(&arc, &body, budget, t, spread), expected, "{} {}", used, budget);
        }

        /// Leaving out the closed form and the arc for what is clear of all bodies changes no bit.
        #[test]
        fn what_is_clear_is_neither_held_back_nor_unsafe(
            at in prop::collection::vec((-3.1..3.1f64, prop_oneof![0.0..0.2f64, -1e-12..1e-12f64, Just(0.0)]), 1..4),
            theta in -3.1..3.1f64, v in prop_oneof![-3.0..3.0f64, Just(0.0)], omega in -1.0..1.0f64,
            border in prop_oneof![Just(0.0), -1e-8..1e-8f64, -1e-12..1e-12f64], to in any::<bool>(),
            anywhere in prop::bool::weighted(0.1), share in prop_oneof![Just(0.5), Just(1.0)],
        ) {
            let (law, fleet, _) = pair(theta, 1.0, 0.0);
            let (start, ahead, command) = (fleet[0].pose(), unit(theta), Command { v_mps: v, omega_radps: omega });
            let mut bodies: Vec<Body> = at.into_iter().map(|(at, gap_m)| {
                Body { normal: unit(at), gap_m, share, anywhere: false, blind: 0.0 }
            }).collect();
            bodies[0].anywhere = anywhere;
            if to {
                // One that the way, or what it can be at most, just about reaches.
                let most = (omega.abs() * law.period_s - bodies[0].normal.dot(&ahead) * v.signum()).clamp(0.0, 1.0);
                bodies[0].gap_m = v.abs() * law.period_s * most * (1.0 + border) / (law.control.gamma * share);
            }
            let limit = super::speed_limit_mps(&law, ahead, &bodies, command);
            let mut expected = command;
            expected.v_mps = command.v_mps.clamp(-limit, limit);
            let safe = super::is_safe(&law, start, &bodies, expected);
            let mut held = command;
            prop_assert_eq!(held_back(&law, (start, ahead), &bodies, &mut held), safe);
            prop_assert_eq!(held.v_mps.to_bits(), expected.v_mps.to_bits());
        }

        /// Just below the largest speed the exact motion passes, and just above it does not.
        #[test]
        fn the_largest_speed_is_the_largest_that_passes(
            theta in -3.1..3.1f64, distance in 0.46..0.9f64, at in -3.1..3.1f64, omega in -1.0..1.0f64,
            backwards in any::<bool>(),
        ) {
            let (law, fleet, near) = pair(theta, distance, at);
            let of = |v_mps: f64| Command { v_mps, omega_radps: omega };
            let sign = if backwards { -1.0 } else { 1.0 };
            let limit = speed_limit_mps(&law, &fleet, 0, &near, of(sign));
            prop_assert!((0.0..=3.0).contains(&limit));
            prop_assert!(is_safe(&law, &fleet, 0, &near, of(sign * limit * (1.0 - 1e-9))), "{limit}");
            if limit < 3.0 {
                let beyond = of(sign * (limit * (1.0 + 1e-6) + 1e-6));
                prop_assert!(!is_safe(&law, &fleet, 0, &near, beyond), "{limit}");
            }
        }
    }

    /// Two robots 0.15 m in radius that drive both ways: the first at the origin, the second at `distance_m` in
    /// the direction `at_rad`.
    fn pair(theta_rad: f64, distance_m: f64, at_rad: f64) -> (Law, Vec<RobotState>, [Nearby; 1]) {
        let mut scenario = Scenario::builtin("swap8").unwrap();
        scenario.robots.truncate(2);
        (scenario.limits.v_min_mps, scenario.limits.v_max_mps) = (-3.0, 3.0);
        let config = Config::new(scenario);
        let mut fleet: Vec<_> = config.scenario.robots.iter().map(RobotState::at_start).collect();
        let p = unit(at_rad) * distance_m;
        fleet[0].set_pose(Pose::new(0.0, 0.0, theta_rad));
        fleet[1].set_pose(Pose::new(p.x, p.y, 0.0));
        for robot in &mut fleet {
            robot.flags |= state_flags::VALID;
        }
        let mut law = Law::new(&config);
        law.prepare(&fleet, Timing::default());
        let near = [Nearby { distance_m, id: fleet[1].id, index: 1, place: NO_PLACE }];
        (law, fleet, near)
    }

    #[test]
    fn a_turn_towards_the_body_is_seen_however_it_begins() {
        // Square to the body, and turned towards it by 0.09 rad on 1.5 m: 0.0675 m.
        let arc =
            Arc { start: Pose::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2), v_mps: 5.0, omega_radps: -0.3 };
        let body = Body { normal: unit(0.0), gap_m: 0.1, share: 1.0, anywhere: false, blind: 0.0 };
        assert!(keeps_clear(&arc, &body, 0.068, 0.3) && !keeps_clear(&arc, &body, 0.067, 0.3));
    }

    #[test]
    fn half_of_the_way_that_is_left_is_each_robots_own() {
        // 0.45 m are required; of the 0.2 m beyond it γ / 2 in 80 ms.
        let (law, fleet, near) = pair(0.0, 0.65, 0.0);
        let limit = |v_mps: f64| speed_limit_mps(&law, &fleet, 0, &near, Command { v_mps, omega_radps: 0.0 });
        assert!((limit(1.0) - 0.5 * law.control.gamma * 0.2 / 0.08).abs() < 1e-9, "{}", limit(1.0));
        // Backwards it drives away, as fast as it may.
        assert_eq!(limit(-1.0), 3.0);
    }

    #[test]
    fn rounding_at_the_border_of_the_disturbed_is_forgiven_and_contact_is_not() {
        let body = Body { normal: unit(0.0), gap_m: 0.1, share: 1.0, anywhere: false, blind: 0.0 };
        let arc = |theta_rad, v_mps| Arc { start: Pose::new(0.0, 0.0, theta_rad), v_mps, omega_radps: 0.0 };
        let passes = |arc: &Arc, body: &Body, budget: f64, spread: f64| {
            keeps_clear_disturbed(arc, body, budget, 0.1, spread)
        };
        // Square to the body, 1 m/s for 0.1 s with half of it to the side.
        let across = arc(std::f64::consts::FRAC_PI_2, 1.0);
        assert!(passes(&across, &body, 0.05, 0.5) && !passes(&across, &body, 0.05 - 1e-10, 0.5));
        // A gap that rounding may have made leaves no way towards the body, however short.
        let crawl = arc(std::f64::consts::PI, 1e-9);
        let touching = Body { gap_m: CONTACT_M, ..body };
        assert!(passes(&crawl, &Body { gap_m: 2.0 * CONTACT_M, ..body }, 1e-9, 0.5));
        assert!(!passes(&arc(std::f64::consts::PI, 1e-3), &touching, 1e-3, 0.5));
        // At 60° away just half of the way leads away.
        let away = arc(std::f64::consts::FRAC_PI_3, 1.0);
        assert!(passes(&away, &touching, 0.0, 0.5) && !passes(&away, &touching, 0.0, 0.5 + 1e-9));
        // Where the direction is not known at all, none leads away.
        let blind = Body { blind: 1.0, ..touching };
        assert!(!passes(&arc(0.0, 1.0), &blind, 0.0, 0.0) && passes(&arc(0.0, 0.0), &blind, 0.0, 0.0));
    }
}
