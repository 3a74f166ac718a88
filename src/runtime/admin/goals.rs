//! New goals for one robot or for all of them, checked a part at a time.

use super::plan::Plan;
use super::refusal::Refusal;
use crate::geometry::{Grid, Vec2};
use crate::model::RobotId;
use crate::runtime::desk::Change;
use crate::wire::{AdminCode, AdminRobot};

/// What a goal costs beside the obstacles around it, in looks at one.
const GOAL_LOOKS: usize = 16;

/// A request for new goals on its way through the checks: each goal by itself, then all of them beside
/// those of the others.
#[derive(Debug)]
pub(super) struct Goals {
    records: Vec<AdminRobot>,
    changes: Vec<Change>,
    /// Places that have been named.
    named: Vec<bool>,
    /// The goals as they will be, once each is sound by itself.
    after: Option<After>,
    /// Goals that have room beside the others.
    free: usize,
}

/// The fleet's goals, sorted into cells.
#[derive(Debug)]
struct After {
    grid: Grid,
    robots: Vec<(RobotId, f64, Vec2)>,
    /// Where the robot in each place is in `robots`.
    of_place: Vec<usize>,
    largest_m: f64,
}

impl Goals {
    /// Begins to check `records` against `plan`, which stays the same until they are checked.
    pub(super) fn new(plan: &Plan, records: Vec<AdminRobot>) -> Self {
        let (changes, named) = (Vec::with_capacity(records.len()), vec![false; plan.capacity()]);
        Self { records, changes, named, after: None, free: 0 }
    }

    /// Goes on for about `looks` looks at an obstacle or a robot and takes off what it needed; whether all
    /// is checked.
    ///
    /// # Errors
    /// Why one of the robots cannot have its goal.
    pub(super) fn advance(&mut self, plan: &Plan, looks: &mut usize) -> Result<bool, Refusal> {
        while *looks > 0 {
            let needed = if let Some(record) = self.records.get(self.changes.len()) {
                let record = *record;
                self.take(plan, &record)?;
                GOAL_LOOKS + plan.obstacles()
            } else if let Some(after) = &mut self.after {
                let Some(change) = self.changes.get(self.free) else { return Ok(true) };
                self.free += 1;
                GOAL_LOOKS + after.check(plan, change)?
            } else {
                self.after = Some(After::new(plan, &self.changes));
                plan.capacity()
            };
            *looks = looks.saturating_sub(needed);
        }
        Ok(self.after.is_some() && self.free == self.changes.len())
    }

    /// What was asked for, once it is checked.
    pub(super) fn changes(self) -> Vec<Change> {
        self.changes
    }

    fn take(&mut self, plan: &Plan, record: &AdminRobot) -> Result<(), Refusal> {
        let (place, robot) = plan.find(record.id)?;
        let goal_m = Vec2::new(record.goal_x_m, record.goal_y_m);
        plan.check_point(robot.id, robot.radius_m, goal_m, "the goal")?;
        if self.named.get_mut(place).is_some_and(|named| std::mem::replace(named, true)) {
            let text = format!("robot {} stands in the request twice", record.id);
            return Err(Refusal::of(record.id, AdminCode::RepeatedRobot, text));
        }
        self.changes.push(Change::Goal { place, goal_m });
        Ok(())
    }
}

impl After {
    fn new(plan: &Plan, changes: &[Change]) -> Self {
        let mut of_place = vec![usize::MAX; plan.capacity()];
        let mut robots = Vec::with_capacity(plan.capacity());
        for (place, robot) in plan.aimed() {
            of_place[place] = robots.len();
            robots.push((robot.id, robot.radius_m, robot.goal_m));
        }
        for change in changes {
            if let Change::Goal { place, goal_m } = *change
                && let Some(robot) = robots.get_mut(of_place[place])
            {
                robot.2 = goal_m;
            }
        }
        let largest_m = robots.iter().map(|robot| robot.1).fold(0.0, f64::max);
        let cell_m = (plan.margin_m() + 2.0 * largest_m).max(f64::MIN_POSITIVE.sqrt());
        let mut grid = Grid::with_capacity(robots.len(), cell_m);
        grid.build(robots.iter().map(|robot| robot.2));
        Self { grid, robots, of_place, largest_m }
    }

    /// Whether a goal has room; at how many others that took a look.
    fn check(&mut self, plan: &Plan, change: &Change) -> Result<usize, Refusal> {
        let Change::Goal { place, .. } = *change else { return Ok(0) };
        let mine = self.of_place[place];
        let Some(&robot) = self.robots.get(mine) else { return Ok(0) };
        let mut near = Vec::new();
        let reach_m = plan.margin_m() + robot.1 + self.largest_m;
        self.grid.near(robot.2, reach_m, |range| near.extend_from_slice(&self.grid.order()[range]));
        // The one that is named does not depend on how they are sorted.
        near.sort_unstable();
        let others = near.iter().map(|other| *other as usize).filter(|other| *other != mine);
        plan.check_goal(robot, others.filter_map(|other| self.robots.get(other).copied()))?;
        Ok(near.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::geometry::Pose;
    use crate::model::{Limits, RobotSpec};
    use crate::scenario::{ROUNDING_M, Scenario};
    use proptest::prelude::*;

    fn plan(robots: u32) -> Plan {
        let robot = |id: u32| RobotSpec {
            id: RobotId(3 * id),
            radius_m: if id.is_multiple_of(5) { 0.4 } else { 0.15 },
            start: Pose::new(f64::from(id), 50.0, 0.0),
            goal_m: Vec2::new(f64::from(id), -50.0),
            foreign_speed_mps: (id % 7 == 6).then_some(1.0),
        };
        let scenario = Scenario {
            name: "row".into(),
            tolerance_m: 0.05,
            duration_s: 20.0,
            limits: Limits::default(),
            robots: (0..robots).map(robot).collect(),
            obstacles: vec![],
        };
        let mut config = Config::new(scenario);
        config.source.arena_m = 1e4;
        Plan::new(&config)
    }

    fn to(id: u32, x: f64, y: f64) -> AdminRobot {
        AdminRobot { id, goal_x_m: x, goal_y_m: y, ..AdminRobot::default() }
    }

    proptest! {
        /// Cells change nothing: a request is refused if any two goals are too close, and only then.
        #[test]
        fn goals_are_refused_just_when_two_of_them_are_too_close(
            wanted in prop::collection::btree_map(0..40u32, (-4.0..4.0f64, -4.0..4.0f64), 1..25),
            part in 1..100usize,
        ) {
            let plan = plan(40);
            let wanted: Vec<_> = wanted.into_iter().filter(|(id, _)| id % 7 != 6).collect();
            prop_assume!(!wanted.is_empty());
            let mut goals: Vec<_> = plan.aimed().map(|(_, r)| (r.id, r.radius_m, r.goal_m)).collect();
            for (id, (x, y)) in &wanted {
                goals.iter_mut().filter(|r| r.0.0 == 3 * id).for_each(|r| r.2 = Vec2::new(*x, *y));
            }
            let close = |a: &(RobotId, f64, Vec2), b: &(RobotId, f64, Vec2)| {
                (a.2 - b.2).norm() < plan.margin_m() + a.1 + b.1 - ROUNDING_M
            };
            let any = goals.iter().enumerate().any(|(k, a)| goals[..k].iter().any(|b| close(a, b)));
            let records = wanted.iter().map(|(id, (x, y))| to(3 * id, *x, *y)).collect();
            let mut check = Goals::new(&plan, records);
            let outcome = loop {
                match check.advance(&plan, &mut part.clone()) {
                    Ok(false) => {}
                    Ok(true) => break Ok(check.changes().len()),
                    Err(refusal) => break Err(refusal.code),
                }
            };
            prop_assert_eq!(outcome, if any { Err(AdminCode::GoalTaken) } else { Ok(wanted.len()) });
        }
    }

    #[test]
    fn a_large_request_is_checked_in_parts_of_the_same_size() {
        let robots = 5000;
        let plan = plan(robots);
        let takes = |id: &u32| id % 7 != 6;
        let records: Vec<_> =
            (0..robots).filter(takes).map(|id| to(3 * id, f64::from(id) * 1.1, 9.0)).collect();
        let (count, mut goals, mut parts) = (records.len(), Goals::new(&plan, records), 1);
        while !goals.advance(&plan, &mut 10_000).unwrap() {
            parts += 1;
        }
        // Every goal is looked at twice, and beside it a few others.
        let least = count * 2 * GOAL_LOOKS / 10_000;
        assert!((least..4 * least).contains(&parts), "{parts} parts, at least {least}");
        assert_eq!(goals.changes().len(), count);
    }
}
