//! The bodies that one robot has to keep away from, and what is left of the way to each.

use super::Law;
use crate::certificate::robust::Reach;
use crate::geometry::{Vec2, unit};
use crate::model::Obstacle;
use crate::neighbours::Nearby;
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

/// The bodies around the robot `me` whose rows can bind, nearest robots first, then the ways on which they may stand,
/// then obstacles; `None` when there are more than `room`, which `found` has at least.
pub(super) fn gather<'a>(
    law: &Law,
    fleet: &[RobotState],
    me: usize,
    near: &[Nearby],
    (room, found): (usize, &'a mut Vec<Body>),
) -> Option<&'a [Body]> {
    found.clear();
    let mut take = |body: Option<Body>| {
        let Some(body) = body else { return Some(()) };
        (found.len() < room).then(|| found.push(body))
    };
    let looking = Looking::new(law, &fleet[me]);
    for n in near {
        take(looking.at_robot(n, &fleet[n.index]))?;
    }
    // One of ours that follows its commands may as well have come to a stand anywhere on its way. Then it
    // goes on standing, and leaves us the whole gap.
    if law.longest_way_m.is_some() {
        for other in near.iter().map(|n| &fleet[n.index]).filter(|other| other.has(state_flags::MAY_STAND)) {
            looking.at_way(other).into_iter().try_for_each(&mut take)?;
        }
    }
    for obstacle in &law.obstacles {
        take(looking.at_obstacle(obstacle))?;
    }
    Some(found)
}

/// One robot that looks for bodies.
struct Looking<'a> {
    law: &'a Law,
    own: &'a RobotState,
    here: Vec2,
    /// Speed bounds of those that are not ours, by index; none where nobody is.
    foreign_speed_mps: &'a [Option<f64>],
    disturbed: Option<Disturbed>,
}

/// What matters besides where robots may be disturbed.
struct Disturbed {
    ahead: Vec2,
    reach: Reach,
    /// How far two robots may be from where they are taken to be, at most, m.
    extent_m: f64,
}

impl<'a> Looking<'a> {
    fn new(law: &'a Law, own: &'a RobotState) -> Self {
        Self {
            law,
            own,
            here: own.position_m(),
            foreign_speed_mps: if law.strangers.is_empty() { &[] } else { &law.foreign_speed_mps },
            disturbed: law.margin.as_ref().map(|margin| Disturbed {
                ahead: unit(own.theta_rad),
                reach: law.reach(own),
                extent_m: 2.0 * margin.extent_max_m(),
            }),
        }
    }

    /// Within which distance a row binds, m.
    fn range_m(&self, required_m: f64, beyond_m: f64) -> f64 {
        required_m + self.disturbed.as_ref().map_or(0.0, |disturbed| disturbed.extent_m) + beyond_m
    }

    /// How far we, and `other` where it may be elsewhere too, may be from where we are seen, m: towards each other,
    /// and in any direction.
    fn doubt_m(&self, normal: Vec2, other: Option<&RobotState>) -> (f64, f64) {
        let Some(Disturbed { ahead, reach, .. }) = &self.disturbed else { return (0.0, 0.0) };
        let (other_m, extent_m) = other.map_or((0.0, 0.0), |other| {
            let theirs = self.law.reach(other);
            (theirs.towards_m(-normal.dot(&unit(other.theta_rad))), theirs.extent_m())
        });
        (reach.towards_m(normal.dot(ahead)) + other_m, reach.extent_m() + extent_m)
    }

    fn at_robot(&self, n: &Nearby, other: &RobotState) -> Option<Body> {
        let (law, [half_m, whole_m]) = (self.law, self.law.binds_m);
        // What it may move beyond what is known, and our share of what that leaves: one that is not ours
        // uses up what it can reach until the command has acted, and leaves us the whole rest.
        let (unknown_m, share, beyond_m) = match self.foreign_speed_mps.get(n.index) {
            Some(Some(speed_mps)) => (other.uncertainty_m + law.foreign_s * speed_mps, 1.0, whole_m),
            _ if other.has(state_flags::VALID) => (0.0, 0.5, half_m),
            // It drives on under the command in force, or stands anywhere on the way since it was seen.
            _ => {
                let way_m = other.uncertainty_m + other.v_mps.abs() * law.period_s * (1.0 + law.spread());
                (law.untrusted_m.max(way_m) + law.lost_m, 0.5, half_m)
            }
        };
        let required_m = law.limits.safety_margin_m + self.own.radius_m + other.radius_m + unknown_m;
        (n.distance_m <= self.range_m(required_m, beyond_m)).then(|| {
            let normal = away(self.here - other.position_m(), n.distance_m, self.own.id, other.id);
            let (doubt_m, extent_m) = self.doubt_m(normal, Some(other));
            let gap_m = n.distance_m - required_m - doubt_m;
            Body {
                normal,
                gap_m,
                share,
                anywhere: unknown_m > 0.0 && gap_m < 0.0,
                blind: extent_m / n.distance_m.max(COINCIDENT_M),
            }
        })
    }

    fn at_way(&self, other: &RobotState) -> [Option<Body>; 2] {
        let (law, here, [_, whole_m]) = (self.law, self.here, self.law.binds_m);
        let (way, stray_m) = (law.way(other), law.stray_m(other));
        let required_m = law.limits.safety_margin_m + self.own.radius_m + other.radius_m + stray_m;
        let body = |point: Vec2, beyond_m: f64, (touches, bends): (bool, bool)| {
            let offset = here - point;
            let distance_m = offset.norm();
            let normal = away(offset, distance_m, self.own.id, other.id);
            let (doubt_m, extent_m) = self.doubt_m(normal, None);
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
        if (here - nearest).norm() > self.range_m(required_m + bow_m, whole_m) {
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
    }

    fn at_obstacle(&self, obstacle: &Obstacle) -> Option<Body> {
        let [_, whole_m] = self.law.binds_m;
        let required_m = self.law.limits.safety_margin_m + self.own.radius_m + obstacle.reach_m();
        let offset = self.here - obstacle.closest_core_point(self.here);
        let distance_m = offset.norm();
        (distance_m <= self.range_m(required_m, whole_m)).then(|| {
            let normal = away(offset, distance_m, 0, 1);
            let (doubt_m, extent_m) = self.doubt_m(normal, None);
            Body {
                normal,
                gap_m: distance_m - required_m - doubt_m,
                share: 1.0,
                anywhere: false,
                blind: extent_m / distance_m.max(COINCIDENT_M),
            }
        })
    }
}
