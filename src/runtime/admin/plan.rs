use std::collections::HashMap;

use super::goals::Goals;
use super::refusal::Refusal;
use crate::config::Config;
use crate::geometry::{Pose, Vec2};
use crate::model::{Limits, Obstacle, RobotId, RobotSpec};
use crate::runtime::desk::Change;
use crate::scenario::{ROUNDING_M, SIZE_MAX_M, Scenario};
use crate::wire::{AdminCode, AdminKind, AdminRobot, NO_ROBOT, state_flags};

const ADD_ONE: &str = "one robot at a time is added";
const REMOVE_ONE: &str = "one robot at a time is removed";

/// The fleet as it will be once everything that was accepted is carried out: what requests are checked
/// against.
#[derive(Debug, Clone)]
pub(super) struct Plan {
    places: Vec<Option<RobotSpec>>,
    /// The place of each robot, by its id.
    ids: HashMap<u32, usize>,
    hold: u32,
    limits: Limits,
    obstacles: Vec<Obstacle>,
    arena_m: f64,
    /// How far a robot may be from where it is seen, m: as for the scenario, it needs that much more room.
    noise_m: f64,
}

impl Plan {
    pub(super) fn new(config: &Config) -> Self {
        let scenario = &config.scenario;
        let mut places: Vec<_> = scenario.robots.iter().copied().map(Some).collect();
        places.resize(config.places(), None);
        let taken =
            places.iter().enumerate().filter_map(|(place, robot)| Some((robot.as_ref()?.id.0, place)));
        Self {
            ids: taken.collect(),
            places,
            hold: 0,
            limits: scenario.limits,
            obstacles: scenario.obstacles.clone(),
            arena_m: config.source.arena_m,
            noise_m: config.robust.position_m,
        }
    }

    /// With the fleet held by these bits of [`state_flags`].
    pub(super) fn held(self, hold: u32) -> Self {
        Self { hold, ..self }
    }

    /// Places, taken or not.
    pub(super) fn capacity(&self) -> usize {
        self.places.len()
    }

    pub(super) fn robots(&self) -> impl Iterator<Item = &RobotSpec> {
        self.places.iter().flatten()
    }

    /// How many robots there are.
    pub(super) fn len(&self) -> usize {
        self.ids.len()
    }

    /// The places of all robots that have a goal.
    pub(super) fn aimed(&self) -> impl Iterator<Item = (usize, &RobotSpec)> {
        let taken =
            self.places.iter().enumerate().filter_map(|(place, robot)| Some((place, robot.as_ref()?)));
        taken.filter(|(_, robot)| robot.foreign_speed_mps.is_none())
    }

    /// Obstacles that a point is checked against.
    pub(super) fn obstacles(&self) -> usize {
        self.obstacles.len()
    }

    /// Bits of [`state_flags`] that hold the fleet.
    pub(super) fn hold(&self) -> u32 {
        self.hold
    }

    pub(super) fn robot(&self, place: usize) -> Option<&RobotSpec> {
        self.places.get(place)?.as_ref()
    }

    /// The scenario as it is now, in ascending order of id.
    pub(super) fn scenario(&self, start: &Scenario) -> Scenario {
        let mut robots: Vec<RobotSpec> = self.robots().copied().collect();
        robots.sort_by_key(|robot| robot.id);
        Scenario { robots, ..start.clone() }
    }

    /// Takes a change as carried out.
    pub(super) fn apply(&mut self, change: &Change) {
        match *change {
            Change::Goal { place, goal_m } => {
                if let Some(Some(robot)) = self.places.get_mut(place) {
                    robot.goal_m = goal_m;
                }
            }
            Change::Hold { set, clear } => self.hold = self.hold & !clear | set,
            Change::Add { place, robot, .. } => self.put(place, Some(robot)),
            Change::Remove { place } => self.put(place, None),
        }
    }

    fn put(&mut self, place: usize, robot: Option<RobotSpec>) {
        let Some(slot) = self.places.get_mut(place) else { return };
        if let Some(before) = slot {
            self.ids.remove(&before.id.0);
        }
        if let Some(robot) = robot {
            self.ids.insert(robot.id.0, place);
        }
        *slot = robot;
    }

    /// Whether a request of a kind that changes something may be about so many robots.
    ///
    /// # Errors
    /// How many it may be about.
    pub(super) fn check_number(&self, kind: AdminKind, robots: usize) -> Result<(), Refusal> {
        let several = 1..=self.capacity();
        match kind {
            AdminKind::SetGoals if !several.contains(&robots) => Err(Refusal::malformed(
                "goals for one robot or several, at most as many as the fleet has room for, are needed",
            )),
            AdminKind::AddRobot if robots != 1 => Err(Refusal::malformed(ADD_ONE)),
            AdminKind::RemoveRobot if robots != 1 => Err(Refusal::malformed(REMOVE_ONE)),
            AdminKind::Pause | AdminKind::Stop | AdminKind::Clear | AdminKind::Resume if robots != 0 => {
                Err(Refusal::about_no_robot())
            }
            _ => Ok(()),
        }
    }

    /// What a request of a kind that changes something comes to.
    ///
    /// # Errors
    /// Why it cannot be carried out.
    pub(super) fn changes(&self, kind: AdminKind, records: &[AdminRobot]) -> Result<Vec<Change>, Refusal> {
        self.check_number(kind, records.len())?;
        let (paused, stopped) = (state_flags::PAUSED, state_flags::STOPPED);
        let hold = |set, clear| Ok(vec![Change::Hold { set, clear }]);
        match kind {
            AdminKind::SetGoals => {
                let mut goals = Goals::new(self, records.to_vec());
                while !goals.advance(self, &mut { usize::MAX })? {}
                Ok(goals.changes())
            }
            AdminKind::AddRobot => self.add(records),
            AdminKind::RemoveRobot => self.remove(records),
            AdminKind::Pause => hold(paused, 0),
            AdminKind::Stop => hold(stopped, 0),
            // Nobody moves because a latch is taken off: that takes a resume.
            AdminKind::Clear if self.hold & stopped != 0 => hold(paused, stopped),
            AdminKind::Clear => hold(0, stopped),
            AdminKind::Resume if self.hold & stopped != 0 => Err(Refusal::fleet(
                AdminCode::Stopped,
                "the fleet is stopped: clear that first, then resume".to_owned(),
            )),
            AdminKind::Resume => hold(0, paused),
            AdminKind::Status | AdminKind::Configuration | AdminKind::Scenario => {
                Err(Refusal::malformed("this request changes nothing"))
            }
        }
    }

    fn add(&self, records: &[AdminRobot]) -> Result<Vec<Change>, Refusal> {
        let [record] = records else { return Err(Refusal::malformed(ADD_ONE)) };
        let id = record.id;
        if id == NO_ROBOT || self.ids.contains_key(&id) {
            return Err(Refusal::of(id, AdminCode::TakenId, format!("the id {id} is taken: choose another")));
        }
        if !(record.radius_m > 0.0 && record.radius_m <= SIZE_MAX_M) {
            let text = format!(
                "the radius of robot {id} has to be above 0 and at most {SIZE_MAX_M} m, is {:?}",
                record.radius_m
            );
            return Err(Refusal::of(id, AdminCode::BadRadius, text));
        }
        if !record.start_theta_rad.is_finite() {
            return Err(Refusal::of(
                id,
                AdminCode::NotFinite,
                format!("the heading of robot {id} is not finite"),
            ));
        }
        let start = Pose::new(record.start_x_m, record.start_y_m, record.start_theta_rad);
        let goal_m = Vec2::new(record.goal_x_m, record.goal_y_m);
        let robot =
            RobotSpec { id: RobotId(id), radius_m: record.radius_m, start, goal_m, foreign_speed_mps: None };
        self.check_point(robot.id, robot.radius_m, start.position_m, "the start")?;
        self.check_point(robot.id, robot.radius_m, goal_m, "the goal")?;
        let Some(place) = self.free_place() else {
            let text = format!(
                "the fleet has room for {} robots, all there: remove one, or start with a larger admin.capacity",
                self.capacity()
            );
            return Err(Refusal::of(id, AdminCode::Full, text));
        };
        let others = self.aimed().map(|(_, other)| (other.id, other.radius_m, other.goal_m));
        self.check_goal((robot.id, robot.radius_m, robot.goal_m), others)?;
        Ok(vec![Change::Add { place, robot, margin_m: self.margin_m() }])
    }

    fn remove(&self, records: &[AdminRobot]) -> Result<Vec<Change>, Refusal> {
        let [record] = records else { return Err(Refusal::malformed(REMOVE_ONE)) };
        self.find(record.id).map(|(place, _)| vec![Change::Remove { place }])
    }

    /// Gap between two bodies, m, for those who cannot see each other exactly.
    pub(super) fn margin_m(&self) -> f64 {
        self.limits.safety_margin_m + 2.0 * self.noise_m
    }

    /// The first place that is free.
    fn free_place(&self) -> Option<usize> {
        self.places.iter().position(Option::is_none)
    }

    /// A robot that takes commands, and its place.
    pub(super) fn find(&self, id: u32) -> Result<(usize, &RobotSpec), Refusal> {
        let place = self.ids.get(&id).copied();
        let Some(found) = place.and_then(|place| Some((place, self.robot(place)?))) else {
            let text = format!("there is no robot {id} in the fleet");
            return Err(Refusal::of(id, AdminCode::UnknownRobot, text));
        };
        if found.1.foreign_speed_mps.is_some() {
            let text = format!("robot {id} is a foreign one: it is only observed and takes no orders");
            return Err(Refusal::of(id, AdminCode::ForeignRobot, text));
        }
        Ok(found)
    }

    /// Whether a robot may stand at `p`, as far as the arena and the obstacles go.
    pub(super) fn check_point(&self, id: RobotId, radius_m: f64, p: Vec2, what: &str) -> Result<(), Refusal> {
        // `{:?}` writes 1e300 as that and not as 301 digits.
        let place = format!("{what} of robot {id}, ({:?}, {:?}) m,", p.x, p.y);
        if !(p.x.is_finite() && p.y.is_finite()) {
            return Err(Refusal::of(id.0, AdminCode::NotFinite, format!("{place} is not finite")));
        }
        if p.norm() > self.arena_m {
            let text = format!("{place} is more than {} m (source.arena_m) from the origin", self.arena_m);
            return Err(Refusal::of(id.0, AdminCode::OutsideArena, text));
        }
        for (index, obstacle) in self.obstacles.iter().enumerate() {
            let keep_m = obstacle.reach_m() + radius_m + self.limits.safety_margin_m + self.noise_m;
            let apart_m = obstacle.core_distance(p);
            if apart_m < keep_m - ROUNDING_M {
                let text =
                    format!("{place} is {apart_m:.3} m from obstacle {index}: it has to keep {keep_m:.3} m");
                return Err(Refusal::of(id.0, AdminCode::InsideObstacle, text));
            }
        }
        Ok(())
    }

    /// Whether a robot's goal leaves every one of `others` room at its own: each is given by its id, its
    /// radius and its goal.
    pub(super) fn check_goal(
        &self,
        (id, radius_m, goal_m): (RobotId, f64, Vec2),
        others: impl Iterator<Item = (RobotId, f64, Vec2)>,
    ) -> Result<(), Refusal> {
        for (other, other_radius_m, other_goal_m) in others {
            let apart_m = (other_goal_m - goal_m).norm();
            let required_m = self.margin_m() + radius_m + other_radius_m;
            if apart_m < required_m - ROUNDING_M {
                let text = format!(
                    "the goal of robot {id} is {apart_m:.3} m from that of robot {other}: they have to be {required_m:.3} m apart"
                );
                return Err(Refusal::of(id.0, AdminCode::GoalTaken, text));
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::PI;

    fn plan(capacity: usize) -> Plan {
        let text = "schema = 1\nname = \"four\"\n\
            [[robot]]\nid = 1\nradius_m = 0.15\nstart = { x_m = 0, y_m = 0 }\ngoal = { x_m = 4, y_m = 0 }\n\
            [[robot]]\nid = 5\nradius_m = 0.15\nstart = { x_m = 0, y_m = 2 }\ngoal = { x_m = 4, y_m = 2 }\n\
            [[robot]]\nid = 9\nradius_m = 0.15\nstart = { x_m = 0, y_m = 4 }\nforeign_speed_mps = 1\n\
            [[obstacle]]\ncircle = { x_m = 2, y_m = -3, radius_m = 0.5 }\n";
        let mut config = Config::new(Scenario::parse(text, "four.toml").unwrap());
        config.admin.capacity = capacity;
        config.source.arena_m = 50.0;
        Plan::new(&config)
    }

    fn goal(id: u32, x: f64, y: f64) -> AdminRobot {
        AdminRobot { id, goal_x_m: x, goal_y_m: y, ..AdminRobot::default() }
    }

    fn refused(result: Result<Vec<Change>, Refusal>) -> (AdminCode, u32) {
        let refusal = result.expect_err("refused");
        assert!(!refusal.text.is_empty());
        (refusal.code, refusal.robot)
    }

    #[test]
    fn goals_that_no_robot_can_have_are_refused_with_the_reason() {
        let plan = plan(0);
        let set = |records: &[AdminRobot]| refused(plan.changes(AdminKind::SetGoals, records));
        for (x, y) in [(f64::NAN, 0.0), (0.0, f64::INFINITY), (f64::NEG_INFINITY, f64::NAN)] {
            assert_eq!(set(&[goal(1, x, y)]), (AdminCode::NotFinite, 1));
        }
        assert_eq!(set(&[goal(5, 40.0, 40.0)]), (AdminCode::OutsideArena, 5));
        // Half a metre of obstacle, half a robot, the margin: 0.8 m.
        assert_eq!(set(&[goal(1, 2.0, -3.0)]), (AdminCode::InsideObstacle, 1));
        assert_eq!(set(&[goal(1, 2.0, -2.21)]), (AdminCode::InsideObstacle, 1));
        assert!(plan.changes(AdminKind::SetGoals, &[goal(1, 2.0, -2.2)]).is_ok());
        assert_eq!(set(&[goal(2, 0.0, 0.0)]), (AdminCode::UnknownRobot, 2));
        assert_eq!(set(&[goal(9, 0.0, 0.0)]), (AdminCode::ForeignRobot, 9));
        assert_eq!(set(&[goal(1, 4.0, 1.6)]), (AdminCode::GoalTaken, 1));
        assert_eq!(set(&[goal(1, 9.0, 1.0), goal(1, 9.0, 2.0)]), (AdminCode::RepeatedRobot, 1));
        assert_eq!(set(&[]), (AdminCode::Malformed, NO_ROBOT));
        assert_eq!(set(&[goal(1, 9.0, 1.0); 4]), (AdminCode::Malformed, NO_ROBOT));
        // All or nothing, and seen together: two robots may swap their goals.
        assert_eq!(set(&[goal(1, 9.0, 9.0), goal(5, 9.0, f64::NAN)]), (AdminCode::NotFinite, 5));
        let swap = plan.changes(AdminKind::SetGoals, &[goal(1, 4.0, 2.0), goal(5, 4.0, 0.0)]).unwrap();
        let goal_m = |y| Vec2::new(4.0, y);
        let expected =
            [Change::Goal { place: 0, goal_m: goal_m(2.0) }, Change::Goal { place: 1, goal_m: goal_m(0.0) }];
        assert_eq!(swap, expected);
    }

    #[test]
    fn a_robot_is_added_where_it_has_room_and_removed_by_its_id() {
        let mut plan = plan(5);
        let new = |id, x, y| AdminRobot {
            start_x_m: x,
            start_y_m: y,
            start_theta_rad: 7.0,
            radius_m: 0.2,
            ..goal(id, x + 3.0, y + 10.0)
        };
        let add = |plan: &Plan, record| plan.changes(AdminKind::AddRobot, &[record]);
        assert_eq!(refused(add(&plan, new(5, 0.0, 9.0))), (AdminCode::TakenId, 5));
        assert_eq!(refused(add(&plan, new(NO_ROBOT, 0.0, 9.0))).0, AdminCode::TakenId);
        for radius_m in [0.0, -1.0, f64::NAN, f64::INFINITY, 101.0] {
            let record = AdminRobot { radius_m, ..new(7, 0.0, 9.0) };
            assert_eq!(refused(add(&plan, record)).0, AdminCode::BadRadius);
        }
        let record = AdminRobot { start_theta_rad: f64::NAN, ..new(7, 0.0, 9.0) };
        assert_eq!(refused(add(&plan, record)).0, AdminCode::NotFinite);
        assert_eq!(refused(add(&plan, new(7, 2.0, -3.0))).0, AdminCode::InsideObstacle);
        assert_eq!(refused(add(&plan, new(7, 1.0, -10.0))).0, AdminCode::GoalTaken);
        for id in [7, 8] {
            let changes = add(&plan, new(id, f64::from(id), 9.0)).unwrap();
            let [Change::Add { place, robot, .. }] = changes[..] else { panic!("{changes:?}") };
            assert_eq!((place, robot.id.0), (id as usize - 4, id));
            assert!((-PI..=PI).contains(&robot.start.theta_rad));
            plan.apply(&changes[0]);
        }
        assert_eq!(refused(add(&plan, new(10, 20.0, 9.0))).0, AdminCode::Full);
        let gone = plan.changes(AdminKind::RemoveRobot, &[goal(5, 0.0, 0.0)]).unwrap();
        assert_eq!(gone, [Change::Remove { place: 1 }]);
        plan.apply(&gone[0]);
        assert_eq!(
            refused(plan.changes(AdminKind::RemoveRobot, &[goal(5, 0.0, 0.0)])).0,
            AdminCode::UnknownRobot
        );
        assert_eq!(
            refused(plan.changes(AdminKind::RemoveRobot, &[goal(9, 0.0, 0.0)])).0,
            AdminCode::ForeignRobot
        );
        let [Change::Add { place: 1, .. }] = add(&plan, new(10, 20.0, 9.0)).unwrap()[..] else {
            panic!("the free place is taken")
        };
        assert!(plan.scenario(&Scenario::builtin("swap8").unwrap()).robots.is_sorted_by_key(|r| r.id));
    }

    #[test]
    fn a_stop_is_latched_and_nobody_moves_before_a_resume() {
        let mut plan = plan(0);
        let mut ask = |kind| {
            let changes = plan.changes(kind, &[])?;
            for change in &changes {
                plan.apply(change);
            }
            Ok::<u32, Refusal>(plan.hold())
        };
        let (paused, stopped) = (state_flags::PAUSED, state_flags::STOPPED);
        assert_eq!(ask(AdminKind::Pause).unwrap(), paused);
        assert_eq!(ask(AdminKind::Resume).unwrap(), 0);
        assert_eq!(ask(AdminKind::Resume).unwrap(), 0);
        assert_eq!(ask(AdminKind::Clear).unwrap(), 0);
        assert_eq!(ask(AdminKind::Stop).unwrap(), stopped);
        assert_eq!(ask(AdminKind::Stop).unwrap(), stopped);
        assert_eq!(ask(AdminKind::Pause).unwrap(), stopped | paused);
        assert_eq!(ask(AdminKind::Resume).unwrap_err().code, AdminCode::Stopped);
        assert_eq!(ask(AdminKind::Clear).unwrap(), paused);
        assert_eq!(ask(AdminKind::Resume).unwrap(), 0);
    }
}
