use super::check::{self, Part};
use super::{Scenario, heading_toward};
use crate::document::{ConfigError, Document, Found, Place, Problem, Section};
use crate::geometry::{Pose, Vec2};
use crate::model::{Limits, Obstacle, RobotId, RobotSpec};
use std::f64::consts::TAU;

/// The version of the file format that this reads.
pub(super) const SCHEMA: u64 = 1;

/// A scenario as it stands in a file, and where its parts stand.
struct Draft {
    scenario: Scenario,
    places: Vec<(Part, Place)>,
    robots: Vec<RobotPlaces>,
    /// Path and place of each shape.
    obstacles: Vec<(String, Place)>,
    top: Place,
}

/// Where the parts of one robot stand.
struct RobotPlaces {
    /// `robot[3]`, counted in the file.
    path: String,
    id: Place,
    radius: Place,
    start: Place,
    goal: Place,
}

/// Reads and checks a whole document.
pub(crate) fn read(doc: Document) -> Result<Scenario, ConfigError> {
    let draft = draft(&doc);
    // What was not understood is missing from the draft: its rules come after that is mended.
    if doc.is_sound() {
        for fault in check::faults(&draft.scenario) {
            doc.report(draft.problem(fault));
        }
    }
    doc.finish(Some(draft.scenario))
}

fn draft(doc: &Document) -> Draft {
    let mut root = doc.root();
    root.check_schema(SCHEMA);
    let mut places = Vec::new();
    let mut note = |part: Part, place: Option<Place>| places.extend(place.map(|place| (part, place)));

    let name = root.text("name");
    let name = root.require("name", name, "a name for people and reports, for instance name = \"swap8\"");
    note(Part::Name, name.as_ref().map(|n| n.place.clone()));
    let mut number = |key, part, default| {
        let found = root.number(key);
        note(part, found.as_ref().map(|n| n.place.clone()));
        found.map_or(default, |n| n.value)
    };
    let tolerance_m = number("tolerance_m", Part::Tolerance, Scenario::DEFAULT_TOLERANCE_M);
    let duration_s = number("duration_s", Part::Duration, Scenario::DEFAULT_DURATION_S);

    let mut section = root.section("limits");
    let mut limits = Limits::default();
    if let Some(v) = section.pair("v_mps") {
        [limits.v_min_mps, limits.v_max_mps] = v.value;
        note(Part::Speed, Some(v.place));
    }
    if let Some(omega) = section.pair("omega_radps") {
        [limits.omega_min_radps, limits.omega_max_radps] = omega.value;
        note(Part::TurnRate, Some(omega.place));
    }
    if let Some(margin) = section.number("safety_margin_m") {
        limits.safety_margin_m = margin.value;
        note(Part::Margin, Some(margin.place));
    }
    section.finish();

    // In order of id; places move along.
    let mut fleet: Vec<_> = root.sections("robot").into_iter().filter_map(robot).collect();
    fleet.sort_by_key(|(spec, _)| spec.id);
    let (robots, robot_places) = fleet.into_iter().unzip();
    let (obstacles, obstacle_places) = root.sections("obstacle").into_iter().filter_map(obstacle).unzip();
    let top = root.place().clone();
    root.finish();

    Draft {
        scenario: Scenario {
            name: name.map_or(String::new(), |n| n.value),
            tolerance_m,
            duration_s,
            limits,
            robots,
            obstacles,
        },
        places,
        robots: robot_places,
        obstacles: obstacle_places,
        top,
    }
}

fn robot(mut section: Section<'_>) -> Option<(RobotSpec, RobotPlaces)> {
    let path = section.path().to_owned();
    let id = section.natural("id").and_then(|id| {
        if let Ok(value) = u32::try_from(id.value) {
            return Some(Found { value, place: id.place });
        }
        section.refuse("id", &id.place, "has to fit 32 bits", "number the robots from 0");
        None
    });
    let id = section.require("id", id, "a number of its own, for instance id = 0");
    let radius = section.number("radius_m");
    let radius = section.require("radius_m", radius, "the radius of its body, for instance radius_m = 0.15");

    let start = section.section_if_there("start");
    let start = section.require("start", start, "start = { x_m = 0.0, y_m = 0.0 }");
    let start = start.and_then(|mut start| {
        let theta = start.number("theta_rad");
        if let Some(theta) = theta.as_ref().filter(|theta| theta.value.abs() > TAU) {
            start.refuse("theta_rad", &theta.place, "is more than one turn", "give radians, not degrees");
        }
        Some((point(start)?, theta.map(|theta| theta.value)))
    });
    let foreign = section.number("foreign_speed_mps");
    let goal = section.section_if_there("goal");
    let goal = match (&foreign, &start, goal) {
        // Nobody tells a foreign robot where to go.
        (Some(_), Some((start, _)), None) => Some(Found { value: start.value, place: start.place.clone() }),
        (Some(_), _, Some(goal)) => {
            let help = "leave out the goal, or leave out foreign_speed_mps if the robot takes commands";
            section.refuse("goal", goal.place(), "a foreign robot takes no commands and has no goal", help);
            None
        }
        (_, _, goal) => section.require("goal", goal, "goal = { x_m = 0.0, y_m = 0.0 }").and_then(point),
    };
    section.finish();

    let (id, radius, (start, theta), goal) = (id?, radius?, start?, goal?);
    let (from, to) = (start.value, goal.value);
    let spec = RobotSpec {
        id: RobotId(id.value),
        radius_m: radius.value,
        start: Pose::new(from.x, from.y, theta.unwrap_or_else(|| heading_toward(from, to))),
        goal_m: to,
        foreign_speed_mps: foreign.map(|speed| speed.value),
    };
    let places =
        RobotPlaces { path, id: id.place, radius: radius.place, start: start.place, goal: goal.place };
    Some((spec, places))
}

/// Reads `x_m` and `y_m` and finishes the section.
fn point(mut section: Section<'_>) -> Option<Found<Vec2>> {
    let (x, y) = (section.number("x_m"), section.number("y_m"));
    let x = section.require("x_m", x, "x_m = 0.0");
    let y = section.require("y_m", y, "y_m = 0.0");
    let place = section.place().clone();
    section.finish();
    Some(Found { value: Vec2::new(x?.value, y?.value), place })
}

fn obstacle(mut section: Section<'_>) -> Option<(Obstacle, (String, Place))> {
    let circle = section.section_if_there("circle");
    let segment = section.section_if_there("segment");
    let at = |shape: &Section<'_>| (shape.path().to_owned(), shape.place().clone());
    let found = match (circle, segment) {
        (Some(circle), None) => Some((at(&circle), disc(circle))),
        (None, Some(segment)) => Some((at(&segment), wall(segment))),
        (Some(_), Some(segment)) => {
            let help = "give every shape an [[obstacle]] of its own";
            section.refuse("segment", segment.place(), "an obstacle has one shape and this has two", help);
            None
        }
        (None, None) => {
            let example = "circle = { x_m = 0.0, y_m = 0.0, radius_m = 0.5 } \
                or segment = { from_m = [0.0, 0.0], to_m = [1.0, 0.0] }";
            section.require::<()>("circle", None, example);
            None
        }
    };
    section.finish();
    let (at, shape) = found?;
    Some((shape?, at))
}

fn disc(mut section: Section<'_>) -> Option<Obstacle> {
    let radius = section.number("radius_m");
    let radius = section.require("radius_m", radius, "radius_m = 0.5");
    let centre = point(section);
    Some(Obstacle::Circle { centre_m: centre?.value, radius_m: radius?.value })
}

fn wall(mut section: Section<'_>) -> Option<Obstacle> {
    let (from, to) = (section.pair("from_m"), section.pair("to_m"));
    let from = section.require("from_m", from, "from_m = [0.0, 0.0]");
    let to = section.require("to_m", to, "to_m = [1.0, 0.0]");
    section.finish();
    Some(Obstacle::Segment { from_m: Vec2::from(from?.value), to_m: Vec2::from(to?.value) })
}

impl Draft {
    fn problem(&self, mut fault: check::Fault) -> Problem {
        // Of two robots, complain about the one that was written later: the other stood there first.
        if let [(a @ (Part::Start(_) | Part::Goal(_)), _), (b @ (Part::Start(_) | Part::Goal(_)), _)] =
            fault.parts.as_mut_slice()
            && self.place(*a).line() < self.place(*b).line()
        {
            std::mem::swap(a, b);
        }
        let key = fault.parts.first().map_or(String::new(), |&(part, _)| self.key(part));
        let problem = Problem::new(fault.kind, key, fault.message).advise(fault.help);
        fault.parts.iter().fold(problem, |problem, (part, label)| problem.at(self.place(*part), label))
    }

    /// The key with the index that counts in the file.
    fn key(&self, part: Part) -> String {
        match part {
            Part::Id(i) => format!("{}.id", self.robots[i].path),
            Part::Radius(i) => format!("{}.radius_m", self.robots[i].path),
            Part::Start(i) => format!("{}.start", self.robots[i].path),
            Part::Goal(i) => format!("{}.goal", self.robots[i].path),
            Part::Obstacle(i) => self.obstacles[i].0.clone(),
            part => part.key(),
        }
    }

    fn place(&self, part: Part) -> &Place {
        match part {
            Part::Id(i) => &self.robots[i].id,
            Part::Radius(i) => &self.robots[i].radius,
            Part::Start(i) => &self.robots[i].start,
            Part::Goal(i) => &self.robots[i].goal,
            Part::Obstacle(i) => &self.obstacles[i].1,
            part => self.places.iter().find(|(p, _)| *p == part).map_or(&self.top, |(_, place)| place),
        }
    }
}
