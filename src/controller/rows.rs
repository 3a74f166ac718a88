//! The barrier rows of one robot: what every body near it leaves of its speed.

use super::Law;
use crate::certificate::barrier::{Approach, activation_m, approach_exact, approach_linear, budget_m};
use crate::certificate::robust::{Margin, Reach};
use crate::config::BarrierForm;
use crate::geometry::{Vec2, unit};
use crate::neighbours::Nearby;
use crate::programme::{Programme, Row};
use crate::wire::{RobotState, state_flags};
use std::cmp::Ordering;

/// A body that a robot has to keep away from, reduced to what a row needs.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    /// Unit vector from the body to the robot.
    pub(super) normal: Vec2,
    /// Distance left beyond the required one, m.
    pub(super) gap_m: f64,
    /// Part of the gap that this robot may use: ½ against one that does the same, 1 against what
    /// stands still.
    pub(super) share: f64,
    /// It may come from any side: no motion at all is known to lead away from it.
    pub(super) anywhere: bool,
    /// Sine of the largest angle between `normal` and the true direction; 0 without disturbances.
    pub(super) blind: f64,
}

/// A way that is straight but for this is taken to be straight, m: what rounding makes of a straight one.
const BOW_MIN_M: f64 = 1e-7;

/// Distances below this have no direction, m.
const COINCIDENT_M: f64 = 1e-9;

/// A direction for coincident centres: opposite for the two robots, so that they may part.
fn away(offset: Vec2, distance_m: f64, me: u32, other: u32) -> Vec2 {
    if distance_m > COINCIDENT_M {
        offset / distance_m
    } else if me < other {
        Vec2::new(1.0, 0.0)
    } else {
        Vec2::new(-1.0, 0.0)
    }
}

/// Those of `near` whose rows can bind, however fast they may be: no farther than `all_m`, unless there are strangers.
pub(super) fn binding<'a>(law: &Law, near: &'a [Nearby], all_m: f64) -> &'a [Nearby] {
    if !law.strangers.is_empty() {
        return near;
    }
    // Sorted, and few of them: one after the other is found sooner than by halving.
    let beyond = near.iter().position(|n| n.distance_m.partial_cmp(&all_m).is_none_or(Ordering::is_gt));
    &near[..beyond.unwrap_or(near.len())]
}

/// Tells `found` the bodies whose rows can bind, nearest robots first, then the ways on which they may stand, then
/// obstacles, until it answers with none.
pub(super) fn bodies(
    law: &Law,
    fleet: &[RobotState],
    me: usize,
    near: &[Nearby],
    rate: f64,
    mut found: impl FnMut(Body) -> Option<()>,
) -> Option<()> {
    let own = &fleet[me];
    let here = own.position_m();
    // Without disturbances nobody's heading matters here.
    let heading = |robot: &RobotState| law.margin.map_or_else(Vec2::zeros, |_| unit(robot.theta_rad));
    let (ahead, mine) = (heading(own), law.reach(own));
    let extent_m = law.margin.map_or(0.0, |margin| 2.0 * margin.extent_max_m());
    let speed_mps = law.limits.speed_mps() * (1.0 + law.spread());
    // Where a row with half or with all of the gap begins to bind, beyond what it requires.
    let [half_m, whole_m] = [0.5, 1.0].map(|share| activation_m(0.0, speed_mps, law.period_s, rate, share));
    let reach = |required_m: f64, beyond_m: f64| required_m + extent_m + beyond_m;
    // Towards the other one, how far we and it may be from where we are seen, and in any direction.
    let doubt = |normal: Vec2, other: Option<(Vec2, Reach)>| {
        let own_m = mine.towards_m(normal.dot(&ahead));
        let (other_m, extent_m) = other.map_or((0.0, 0.0), |(heading, theirs)| {
            (theirs.towards_m(-normal.dot(&heading)), theirs.extent_m())
        });
        (own_m + other_m, mine.extent_m() + extent_m)
    };
    for n in near {
        let other = &fleet[n.index];
        // What it may move beyond what is known, and our share of what that leaves: one that is not ours
        // uses up what it can reach until the command has acted, and leaves us the whole rest.
        let (unknown_m, share, beyond_m) = match law.foreign_speed_mps[n.index] {
            Some(speed_mps) => (other.uncertainty_m + law.foreign_s * speed_mps, 1.0, whole_m),
            None if other.has(state_flags::VALID) => (0.0, 0.5, half_m),
            // It drives on under the command in force, or stands anywhere on the way since it was seen.
            None => {
                let way_m = other.uncertainty_m + other.v_mps.abs() * law.period_s * (1.0 + law.spread());
                (law.untrusted_m.max(way_m) + law.lost_m, 0.5, half_m)
            }
        };
        let required_m = law.limits.safety_margin_m + own.radius_m + other.radius_m + unknown_m;
        if n.distance_m <= reach(required_m, beyond_m) {
            let normal = away(here - other.position_m(), n.distance_m, own.id, other.id);
            let (doubt_m, extent_m) = doubt(normal, Some((heading(other), law.reach(other))));
            let gap_m = n.distance_m - required_m - doubt_m;
            found(Body {
                normal,
                gap_m,
                share,
                anywhere: unknown_m > 0.0 && gap_m < 0.0,
                blind: extent_m / n.distance_m.max(COINCIDENT_M),
            })?;
        }
    }
    // One of ours that follows its commands may as well have come to a stand anywhere on its way. Then it
    // goes on standing, and leaves us the whole gap.
    let standing = |other: &RobotState| {
        let (way, stray_m) = (law.way(other), law.stray_m(other));
        let required_m = law.limits.safety_margin_m + own.radius_m + other.radius_m + stray_m;
        let body = |point: Vec2, beyond_m: f64, (touches, bends): (bool, bool)| {
            let offset = here - point;
            let distance_m = offset.norm();
            let normal = away(offset, distance_m, own.id, other.id);
            let (doubt_m, extent_m) = doubt(normal, None);
            let gap_m = distance_m - required_m - beyond_m - doubt_m;
            Body {
                normal,
                gap_m: if touches { gap_m.min(0.0) } else { gap_m },
                share: 1.0,
                anywhere: touches && bends,
                blind: (extent_m + stray_m) / distance_m.max(COINCIDENT_M),
            }
        };
        let bow_m = way.bow_m();
        let nearest = way.closest_point(here);
        if (here - nearest).norm() > reach(required_m + bow_m, whole_m) {
            return [None, None];
        }
        let next = body(nearest, bow_m, (false, false));
        if next.gap_m > 0.0 {
            return [Some(next), None];
        }
        // Coordinates are rounded the more the further they are from the origin.
        let rounding_m = (8.0 * f64::EPSILON * way.length_m * here.norm()).sqrt();
        let straight_m = BOW_MIN_M.max(rounding_m);
        // Within reach of it: no closer to either end, and so to no point between them.
        [way.from_m, way.to_m].map(|end| Some(body(end, bow_m, (true, bow_m > straight_m))))
    };
    // Without a longest way there is none.
    if law.longest_way_m.is_some() {
        let others = near.iter().map(|n| &fleet[n.index]);
        let mut ways = others.filter(|other| other.has(state_flags::MAY_STAND)).map(standing);
        ways.try_for_each(|ends| ends.into_iter().flatten().try_for_each(&mut found))?;
    }
    for obstacle in &law.obstacles {
        let required_m = law.limits.safety_margin_m + own.radius_m + obstacle.reach_m();
        let offset = here - obstacle.closest_core_point(here);
        let distance_m = offset.norm();
        if distance_m <= reach(required_m, whole_m) {
            let normal = away(offset, distance_m, 0, 1);
            let (doubt_m, extent_m) = doubt(normal, None);
            found(Body {
                normal,
                gap_m: distance_m - required_m - doubt_m,
                share: 1.0,
                anywhere: false,
                blind: extent_m / distance_m.max(COINCIDENT_M),
            })?;
        }
    }
    Some(())
}

/// How fast a body is approached by unit speed along `ahead` at the turn rate `omega_radps`.
pub(super) fn approach(law: &Law, ahead: Vec2, omega_radps: f64, body: &Body) -> Approach {
    if let Some(margin) = &law.margin {
        return approach_disturbed(margin, ahead, body);
    }
    match law.control.barrier {
        BarrierForm::Linear if !body.anywhere => {
            let n = body.normal;
            approach_linear(n.dot(&ahead), n.perp(&ahead), law.limits.turn_rate_radps(), law.period_s)
        }
        _ => approach_at(law, ahead, omega_radps, body),
    }
}

/// The form for robots that are disturbed: whatever the turn rates, for all time.
fn approach_disturbed(margin: &Margin, ahead: Vec2, body: &Body) -> Approach {
    let blind = if body.anywhere { 1.0 } else { body.blind };
    margin.approach(body.normal.dot(&ahead), body.gap_m, blind)
}

/// The exact form, whatever the programme used; that for disturbed robots where they are.
pub(super) fn approach_at(law: &Law, ahead: Vec2, omega_radps: f64, body: &Body) -> Approach {
    if let Some(margin) = &law.margin {
        return approach_disturbed(margin, ahead, body);
    }
    if body.anywhere {
        return Approach { forward: law.period_s, backward: law.period_s };
    }
    let n = body.normal;
    approach_exact(n.dot(&ahead), n.perp(&ahead), omega_radps, law.period_s)
}

/// The [`bodies`] around the robot `me`; none when there are more than `room`, which `found` has at least.
pub(super) fn gather<'a>(
    law: &Law,
    fleet: &[RobotState],
    me: usize,
    near: &[Nearby],
    (room, found): (usize, &'a mut Vec<Body>),
) -> Option<&'a [Body]> {
    found.clear();
    // The smaller rate reaches further: one sweep serves both kinds of rows.
    let rate = law.control.gamma.min(law.control.comfort_gamma);
    bodies(law, fleet, me, near, rate, |body| (found.len() < room).then(|| found.push(body)))?;
    Some(found)
}

/// How far at most full speed leads towards a body within the period at any turn rate up to `turn_rate_radps`,
/// forwards or backwards, m: the heading turns by no more than that.
fn towards_m(law: &Law, ahead: Vec2, turn_rate_radps: f64, body: &Body) -> f64 {
    let (along, turn) = (body.normal.dot(&ahead), turn_rate_radps * law.period_s);
    let forward_m = (turn - along).max(0.0) * law.limits.v_max_mps;
    let backward_m = (turn + along).max(0.0) * -law.limits.v_min_mps;
    forward_m.max(backward_m) * law.period_s
}

/// Whether no command at this turn rate comes near a body's line, `budget_m` away; `ahead` is the heading.
/// True of most bodies, and decided without the closed form.
pub(super) fn is_out_of_reach(
    law: &Law,
    ahead: Vec2,
    turn_rate_radps: f64,
    body: &Body,
    budget_m: f64,
) -> bool {
    law.margin.is_none() && !body.anywhere && towards_m(law, ahead, turn_rate_radps, body) <= budget_m
}

/// Fills the safety and comfort rows of a robot that heads along `ahead`; false when there is no room for all of them.
pub(super) fn fill(
    law: &Law,
    ahead: Vec2,
    bodies: &[Body],
    omega_radps: f64,
    programme: &mut Programme,
) -> bool {
    let turn_rate_radps = match law.control.barrier {
        BarrierForm::Exact => omega_radps.abs(),
        BarrierForm::Linear => law.limits.turn_rate_radps(),
    };
    let rate = law.control.gamma.min(law.control.comfort_gamma);
    for body in bodies {
        if is_out_of_reach(law, ahead, turn_rate_radps, body, budget_m(body.gap_m, rate, body.share)) {
            continue;
        }
        let approach = approach(law, ahead, omega_radps, body);
        let safety = budget_m(body.gap_m, law.control.gamma, body.share);
        let comfort = budget_m(body.gap_m, law.control.comfort_gamma, body.share);
        let mut push = |coefficient: f64, speed_mps: f64| {
            // A row that full speed cannot reach does not bind.
            let binds = |bound: f64| coefficient.abs() * speed_mps > bound;
            (!binds(safety) || programme.push_safety(Row { coefficient, bound: safety }))
                && (!binds(comfort) || programme.push_comfort(Row { coefficient, bound: comfort }))
        };
        if !push(approach.forward, law.limits.v_max_mps) || !push(-approach.backward, -law.limits.v_min_mps) {
            return false;
        }
    }
    true
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::controller::Timing;
    use crate::evaluation::initial_fleet;
    use crate::scenario::Scenario;
    use proptest::prelude::*;

    proptest! {
        /// What is left out without its closed form is what the closed form would have left out.
        #[test]
        fn what_is_out_of_reach_takes_no_more_than_its_budget_at_any_speed(
            theta in -3.1..3.1f64, at in -3.1..3.1f64, gap_m in -0.1..0.6f64, turn in -1.0..1.0f64,
            limits in (-4.0..=0.0f64, 0.1..5.0f64, -2.0..-0.1f64, 0.1..2.0f64), exact in any::<bool>(),
            share in prop_oneof![Just(0.5), Just(1.0)], speed in -1.0..1.0f64,
        ) {
            let mut scenario = Scenario::builtin("head-on").unwrap();
            let l = &mut scenario.limits;
            (l.v_min_mps, l.v_max_mps, l.omega_min_radps, l.omega_max_radps) = limits;
            let mut config = Config::new(scenario);
            config.controller.barrier = if exact { BarrierForm::Exact } else { BarrierForm::Linear };
            let mut law = Law::new(&config);
            law.prepare(&initial_fleet(&config), Timing::default());
            let omega = if turn < 0.0 { -turn * limits.2 } else { turn * limits.3 };
            let v = if speed < 0.0 { -speed * limits.0 } else { speed * limits.1 };
            let body = Body { normal: unit(at), gap_m, share, anywhere: false, blind: 0.0 };
            let budget = budget_m(gap_m, law.control.comfort_gamma, share);
            let turn_rate = if exact { omega.abs() } else { law.limits.turn_rate_radps() };
            let used = |a: Approach| if v < 0.0 { -v * a.backward } else { v * a.forward };
            if is_out_of_reach(&law, unit(theta), turn_rate, &body, budget) {
                prop_assert!(used(approach(&law, unit(theta), omega, &body)) <= budget + 1e-12);
                prop_assert!(used(approach_at(&law, unit(theta), omega, &body)) <= budget + 1e-12);
            }
            let anywhere = Body { anywhere: true, ..body };
            prop_assert!(!is_out_of_reach(&law, unit(theta), turn_rate, &anywhere, budget));
            // Facing away it is, and straight at what touches it is not.
            let ahead = Body { gap_m: 0.0, ..body };
            prop_assert!(!is_out_of_reach(&law, -body.normal, turn_rate, &ahead, 0.0));
        }
    }
}
