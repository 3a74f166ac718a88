use super::Scenario;
use crate::document::ErrorKind;
use crate::geometry::{Grid, Vec2};
use crate::model::{Obstacle, RobotSpec};
use std::f64::consts::PI;
use std::ops::RangeInclusive;

/// Coordinates are at most this far from the origin, m: beyond it the last bit of a position is no
/// longer small against the clearance that is reported.
const COORDINATE_MAX_M: f64 = 1e5;
/// Largest radius and largest gap between bodies, m.
pub(crate) const SIZE_MAX_M: f64 = 100.0;
/// Largest speed, m/s, and turn rate, rad/s.
const RATE_MAX: f64 = 100.0;
/// Two that touch up to this are apart, m: positions were rounded when they were written down.
pub(crate) const ROUNDING_M: f64 = 1e-9;
/// A reading stops here; more complaints would only repeat the same mistake.
const FAULTS_MAX: usize = 8;

/// The part of a scenario that a fault is about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Name,
    Tolerance,
    Duration,
    Speed,
    TurnRate,
    Margin,
    Fleet,
    Id(usize),
    Radius(usize),
    Start(usize),
    Goal(usize),
    Obstacles,
    Obstacle(usize),
}

impl Part {
    /// The key it is written under; robots and obstacles count from 0.
    pub(super) fn key(self) -> String {
        match self {
            Self::Name => "name".to_owned(),
            Self::Tolerance => "tolerance_m".to_owned(),
            Self::Duration => "duration_s".to_owned(),
            Self::Speed => "limits.v_mps".to_owned(),
            Self::TurnRate => "limits.omega_radps".to_owned(),
            Self::Margin => "limits.safety_margin_m".to_owned(),
            Self::Fleet => "robot".to_owned(),
            Self::Id(i) => format!("robot[{i}].id"),
            Self::Radius(i) => format!("robot[{i}].radius_m"),
            Self::Start(i) => format!("robot[{i}].start"),
            Self::Goal(i) => format!("robot[{i}].goal"),
            Self::Obstacles => "obstacle".to_owned(),
            Self::Obstacle(i) => format!("obstacle[{i}]"),
        }
    }
}

/// A rule that a scenario breaks.
#[derive(Debug)]
pub(super) struct Fault {
    pub(super) kind: ErrorKind,
    pub(super) message: String,
    pub(super) help: String,
    /// The parts that break it together, the one to change first, each with its label.
    pub(super) parts: Vec<(Part, String)>,
}

/// Every rule that `scenario` breaks, at most [`FAULTS_MAX`]. Files and built-ins pass here alike.
///
/// Cost: the robots times those near each, plus robots times obstacles.
pub(super) fn faults(scenario: &Scenario) -> Vec<Fault> {
    let mut check = Check { scenario, faults: Vec::new() };
    check.values();
    // Only among sound numbers do distances mean anything.
    if check.faults.is_empty() {
        check.identities();
        check.distances();
    }
    check.faults.truncate(FAULTS_MAX);
    check.faults
}

struct Check<'a> {
    scenario: &'a Scenario,
    faults: Vec<Fault>,
}

impl Check<'_> {
    fn fault(&mut self, kind: ErrorKind, part: Part, label: &str, message: String, help: &str) {
        let (help, parts) = (help.to_owned(), vec![(part, label.to_owned())]);
        self.faults.push(Fault { kind, message, help, parts });
    }

    fn full(&self) -> bool {
        self.faults.len() >= FAULTS_MAX
    }

    fn values(&mut self) {
        let s = self.scenario;
        if s.name.is_empty() || s.name.len() > 64 || s.name.chars().any(char::is_control) {
            let message = "has to be 1 to 64 bytes without control characters".to_owned();
            self.fault(ErrorKind::OutOfRange, Part::Name, "here", message, "choose a short name");
        }
        self.number(Part::Tolerance, "", s.tolerance_m, above_zero(10.0));
        self.number(Part::Duration, "", s.duration_s, above_zero(1e6));
        self.limits();
        if s.robots.is_empty() {
            let message = "the fleet is empty".to_owned();
            self.fault(
                ErrorKind::MissingKey,
                Part::Fleet,
                "no [[robot]]",
                message,
                "add at least one [[robot]]",
            );
        }
        self.count(Part::Fleet, "robots", s.robots.len(), Scenario::MAX_ROBOTS);
        self.count(Part::Obstacles, "obstacles", s.obstacles.len(), Scenario::MAX_OBSTACLES);
        for (i, robot) in s.robots.iter().enumerate() {
            if self.full() {
                return;
            }
            self.number(Part::Radius(i), "", robot.radius_m, above_zero(SIZE_MAX_M));
            self.point(Part::Start(i), robot.start.position_m);
            self.number(Part::Start(i), "theta_rad ", robot.start.theta_rad, -PI..=PI);
            self.point(Part::Goal(i), robot.goal_m);
            self.number(
                Part::Start(i),
                "foreign_speed_mps ",
                robot.foreign_speed_mps.unwrap_or(0.0),
                0.0..=RATE_MAX,
            );
        }
        for (i, obstacle) in s.obstacles.iter().enumerate() {
            if self.full() {
                return;
            }
            let (from, to) = match *obstacle {
                Obstacle::Circle { centre_m, .. } => (centre_m, centre_m),
                Obstacle::Segment { from_m, to_m } => (from_m, to_m),
            };
            self.point(Part::Obstacle(i), from);
            self.point(Part::Obstacle(i), to);
            self.number(Part::Obstacle(i), "radius_m ", obstacle.reach_m(), 0.0..=COORDINATE_MAX_M);
        }
    }

    fn limits(&mut self) {
        let l = self.scenario.limits;
        self.number(Part::Margin, "", l.safety_margin_m, 0.0..=SIZE_MAX_M);
        for (part, low, high, unit) in [
            (Part::Speed, l.v_min_mps, l.v_max_mps, "m/s"),
            (Part::TurnRate, l.omega_min_radps, l.omega_max_radps, "rad/s"),
        ] {
            let before = self.faults.len();
            self.number(part, "the smallest ", low, -RATE_MAX..=RATE_MAX);
            self.number(part, "the largest ", high, -RATE_MAX..=RATE_MAX);
            if self.faults.len() > before {
                continue;
            }
            if low > 0.0 || high < 0.0 {
                let message = format!("[{low}, {high}] {unit} does not contain 0, so a robot could not stop");
                let help = "give the smallest value first, at most 0, then the largest, at least 0";
                self.fault(ErrorKind::OutOfRange, part, "0 is outside", message, help);
            } else if part == Part::TurnRate && (low == 0.0 || high == 0.0) {
                let message = format!("[{low}, {high}] {unit} lets a robot turn to one side only at most");
                let help = "give a smallest value below 0 and a largest above 0";
                self.fault(ErrorKind::OutOfRange, part, "one side", message, help);
            } else if part == Part::Speed && high == 0.0 {
                let message = "the largest speed is 0, so no robot could move".to_owned();
                self.fault(ErrorKind::OutOfRange, part, "0", message, "give a largest speed above 0");
            }
        }
    }

    fn identities(&mut self) {
        for i in 1..self.scenario.robots.len() {
            let (before, id) = (self.scenario.robots[i - 1].id, self.scenario.robots[i].id);
            if id == before {
                let message = format!("two robots have the id {id}");
                let help = "give every robot an id of its own; ids may have gaps".to_owned();
                let parts =
                    vec![(Part::Id(i), "again".to_owned()), (Part::Id(i - 1), "first here".to_owned())];
                self.faults.push(Fault { kind: ErrorKind::Contradiction, message, help, parts });
            } else if id < before {
                let message = format!("robot {id} comes after robot {before}");
                self.fault(ErrorKind::Contradiction, Part::Id(i), "here", message, "sort the robots by id");
            }
        }
    }

    fn distances(&mut self) {
        let s = self.scenario;
        let margin = s.limits.safety_margin_m;
        let largest_m = s.robots.iter().map(|r| r.radius_m).fold(0.0, f64::max);
        let cell_m = (margin + 2.0 * largest_m).max(f64::MIN_POSITIVE.sqrt());
        let (start, goal) = (|r: &RobotSpec| r.start.position_m, |r: &RobotSpec| r.goal_m);
        let mut grids = [start as fn(&RobotSpec) -> Vec2, goal].map(|place| {
            let mut grid = Grid::with_capacity(s.robots.len(), cell_m);
            grid.build(s.robots.iter().map(place));
            (grid, place)
        });
        let mut near = Vec::new();
        for (j, a) in s.robots.iter().enumerate() {
            near.clear();
            for (grid, place) in &mut grids {
                let reach_m = margin + a.radius_m + largest_m;
                grid.near(place(a), reach_m, |range| near.extend_from_slice(&grid.order()[range]));
            }
            near.sort_unstable();
            near.dedup();
            for i in near.iter().map(|i| *i as usize).take_while(|i| *i < j) {
                if self.full() {
                    return;
                }
                let (b, rho) = (&s.robots[i], s.required_distance_m(i, j));
                let starts = (a.start.position_m - b.start.position_m).norm();
                let goals = (a.goal_m - b.goal_m).norm();
                for (what, d, part) in [
                    ("starts", starts, Part::Start as fn(usize) -> Part),
                    ("goals", goals, Part::Goal as fn(usize) -> Part),
                ] {
                    if d < rho - ROUNDING_M {
                        self.too_close(
                            format!("the {what} of robots {} and {} are {d:.3} m apart", b.id, a.id),
                            (part(j), part(i)),
                            rho,
                        );
                    }
                }
            }
            for (i, obstacle) in s.obstacles.iter().enumerate() {
                let keep = obstacle.reach_m() + a.radius_m + margin;
                for (what, p, part) in
                    [("start", a.start.position_m, Part::Start(j)), ("goal", a.goal_m, Part::Goal(j))]
                {
                    let d = obstacle.core_distance(p);
                    if d < keep - ROUNDING_M && !self.full() {
                        let message = format!("the {what} of robot {} is {d:.3} m from obstacle {i}", a.id);
                        self.too_close(message, (part, Part::Obstacle(i)), keep);
                    }
                }
            }
        }
    }

    fn too_close(&mut self, message: String, (part, other): (Part, Part), required_m: f64) {
        self.faults.push(Fault {
            kind: ErrorKind::Contradiction,
            message,
            help: format!(
                "move them to at least {required_m:.3} m (both radii and safety_margin_m), or make the robots smaller"
            ),
            parts: vec![(part, "too close".to_owned()), (other, "to this".to_owned())],
        });
    }

    fn number(&mut self, part: Part, what: &str, value: f64, range: RangeInclusive<f64>) {
        if !range.contains(&value) {
            let low = match *range.start() {
                f64::MIN_POSITIVE => "above 0".to_owned(),
                low => format!("at least {low}"),
            };
            let message = format!("{what}has to be {low} and at most {}, is {value}", range.end());
            self.fault(ErrorKind::OutOfRange, part, "out of range", message, "give a number in that range");
        }
    }

    fn point(&mut self, part: Part, p: Vec2) {
        for (what, value) in [("x ", p.x), ("y ", p.y)] {
            self.number(part, what, value, -COORDINATE_MAX_M..=COORDINATE_MAX_M);
        }
    }

    fn count(&mut self, part: Part, what: &str, n: usize, most: usize) {
        if n > most {
            let message = format!("{n} {what} are more than the {most} that are accepted");
            self.fault(
                ErrorKind::TooLarge,
                part,
                "too many",
                message,
                "split the fleet over several daemons",
            );
        }
    }
}

/// (0, `high`].
fn above_zero(high: f64) -> RangeInclusive<f64> {
    f64::MIN_POSITIVE..=high
}
