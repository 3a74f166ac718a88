//! What happens in a seed: the fleet, who speaks for it, and which faults come when.

use std::f64::consts::PI;
use std::ops::Range;

use super::kind::{Kind, Scope};
use super::random::Random;
use crate::config::Config;
use crate::document::ConfigError;
use crate::geometry::{Pose, Vec2};
use crate::model::{Obstacle, RobotId, RobotSpec};
use crate::scenario::Scenario;

/// Periods before the first fault, and after the last one until everybody is to arrive.
const CALM: u64 = 8;

/// Kinds that came after seeds had been run, and are drawn in addition.
const NEWER: &[Kind] = &[Kind::Halted];

/// What kind of fleet a seed has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Class {
    /// One of the built-in scenarios without obstacles.
    Open,
    /// One with obstacles.
    Obstacles,
    /// Two robots at the same place.
    Coincident,
    /// Two robots that overlap.
    Overlap,
    /// Robots that stand at their goals.
    AtGoal,
    /// Headings and bearings at ±π.
    Wrap,
    /// A robot behind walls, that cannot come nearer to its goal.
    Boxed,
    /// More neighbours than a controller has rows for.
    Crowd,
    /// A robot that takes no commands.
    Foreign,
    /// Two groups that cannot see each other, of which only one has faults.
    TwoGroups,
}

impl Class {
    /// Every class.
    pub const ALL: [Self; 10] = [
        Self::Open,
        Self::Obstacles,
        Self::Coincident,
        Self::Overlap,
        Self::AtGoal,
        Self::Wrap,
        Self::Boxed,
        Self::Crowd,
        Self::Foreign,
        Self::TwoGroups,
    ];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Open => "open",
            Self::Obstacles => "obstacles",
            Self::Coincident => "coincident",
            Self::Overlap => "overlap",
            Self::AtGoal => "at-goal",
            Self::Wrap => "wrap",
            Self::Boxed => "boxed",
            Self::Crowd => "crowd",
            Self::Foreign => "foreign",
            Self::TwoGroups => "two-groups",
        }
    }

    /// The class that is called so.
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|class| class.name() == name)
    }
}

/// What is simulated.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Robots of the fleet; `None`: by the seed.
    pub robots: Option<usize>,
    /// Worker threads' turns; `None`: by the seed.
    pub workers: Option<usize>,
    /// Periods in which faults come; then everybody is to arrive.
    pub periods: u64,
    /// Kinds of faults; `None`: all.
    pub kinds: Option<Vec<Kind>>,
    /// The class of the fleet; `None`: by the seed.
    pub class: Option<Class>,
    /// Of the seed's faults only those with these numbers.
    pub only: Option<Vec<usize>>,
    /// Tell the story.
    pub trace: bool,
    /// Drive commands that nobody verified, from the twentieth period on: every seed has to fail.
    pub sabotage: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            robots: None,
            workers: None,
            periods: 160,
            kinds: None,
            class: None,
            only: None,
            trace: false,
            sabotage: false,
        }
    }
}

/// [`Fault::coordinate`] for a heading.
const HEADING: usize = 2;

/// One fault of a seed.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Fault {
    /// Its number in the seed.
    pub number: usize,
    /// What goes wrong.
    pub kind: Kind,
    /// First period, counted from the start of the world.
    pub from: u64,
    /// How many.
    pub periods: u64,
    /// Which robot, driver or worker.
    pub target: usize,
    /// What is left to chance about it, in [0, 1).
    pub chance: f64,
}

impl Fault {
    /// The last period in which it acts.
    pub fn last(&self) -> u64 {
        self.from + self.periods - 1
    }

    /// The last period in which it may show.
    pub fn until(&self) -> u64 {
        // An overrun lasts as long as it is late, and shows when the loop wakes.
        let late = if self.kind == Kind::Overrun { 22 } else { 0 };
        self.last().saturating_add(late).saturating_add(self.kind.promise().recovery)
    }

    /// Which of x, y and the heading it puts something else into, where it does.
    pub(crate) fn coordinate(&self) -> usize {
        (self.chance * 9.0) as usize % 3
    }

    /// Whether distances are kept in spite of it. Admission sees every wrong heading that can lead a robot
    /// far astray, but a position may be wrong by as much as the robot can have driven.
    pub(crate) fn keeps_clear(&self) -> bool {
        self.kind.promise().keeps_clear || self.kind == Kind::ObsSubnormal && self.coordinate() == HEADING
    }
}

impl std::fmt::Display for Fault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let whom = match self.kind.promise().scope {
            Scope::Robot => format!(" of robot {}", self.target),
            Scope::Driver => format!(" of driver {}", self.target),
            Scope::Worker => format!(" of worker {}", self.target),
            Scope::Fleet => String::new(),
        };
        write!(
            f,
            "#{} {}{whom} in periods {}..{}",
            self.number,
            self.kind,
            self.from,
            self.from + self.periods
        )
    }
}

/// Everything that a seed decides before its world begins.
#[derive(Debug, Clone)]
pub(crate) struct Plan {
    pub(crate) class: Class,
    pub(crate) config: Config,
    pub(crate) workers: usize,
    /// Robots of each driver, by their places.
    pub(crate) drivers: Vec<Vec<usize>>,
    /// A robot that stands apart and can be added, and one for which there is no room.
    pub(crate) spares: [RobotSpec; 2],
    /// How long before the start of a period poses are taken, ns.
    pub(crate) lead_ns: u64,
    /// When the world begins, ns.
    pub(crate) start_ns: u64,
    /// The drivers' first number.
    pub(crate) sequence: u64,
    pub(crate) faults: Vec<Fault>,
    /// The robots that no fault concerns; empty where there is one group.
    pub(crate) apart: Vec<usize>,
    pub(crate) random: Random,
}

impl Plan {
    /// The plan of `seed`.
    ///
    /// # Errors
    /// When there is no scenario with so many robots.
    pub(crate) fn new(seed: u64, options: &Options) -> Result<Self, ConfigError> {
        let mut random = Random::new(seed);
        // Half of the seeds have nothing special about their fleet.
        let mut class = Class::Open;
        if random.one_in(2) {
            class = random.pick(&Class::ALL).copied().unwrap_or(class);
        }
        class = options.class.unwrap_or(class);
        let robots = options.robots.unwrap_or(4 + random.index(6)).max(2);
        let (scenario, apart) = scenario(class, robots, seed, &mut random)?;
        let mut config = Config::new(scenario);
        let fleet = config.scenario.robots.len();
        config.admin.capacity = fleet + 1;
        if class == Class::Crowd {
            config.controller.max_neighbours = 3;
        }
        if random.one_in(8) {
            // Numbers that get large while it runs.
            config.timing.first_tick = (1 << 48) - 40;
        }
        let first = config.scenario.robots.iter().map(|robot| robot.id.0).max().unwrap_or(0) + 100;
        let spare = |n: u32| RobotSpec {
            id: RobotId(first + n),
            radius_m: 0.15,
            start: Pose::new(-300.0 - 10.0 * f64::from(n), -300.0, 0.0),
            goal_m: Vec2::new(-300.0 - 10.0 * f64::from(n), -297.0),
            foreign_speed_mps: None,
        };
        let workers = options.workers.unwrap_or(1 + random.index(3));
        let drivers = drivers(fleet, &apart, &mut random);
        let period_ns = config.timing.period_ns;
        let mut plan = Self {
            class,
            workers,
            spares: [spare(0), spare(1)],
            lead_ns: random.below(period_ns / 2),
            start_ns: 1_000_000_000 + random.below(period_ns),
            sequence: if random.one_in(4) { u64::MAX - 20 } else { 1 },
            faults: Vec::new(),
            apart,
            config,
            drivers,
            random: random.branch(),
        };
        plan.draw(options, &mut random);
        if let Some(only) = &options.only {
            plan.faults.retain(|fault| only.contains(&fault.number));
        }
        Ok(plan)
    }

    fn draw(&mut self, options: &Options, random: &mut Random) {
        let kinds: Vec<Kind> = match &options.kinds {
            Some(kinds) => kinds.clone(),
            None => Kind::ALL.iter().copied().filter(|kind| kind.promise().is_fault()).collect(),
        };
        let kinds: Vec<Kind> = kinds.into_iter().filter(|kind| self.suits(*kind)).collect();
        // So that seeds stay what they were, newer kinds are drawn after the others.
        let asked = options.kinds.is_some();
        let (newer, kinds): (Vec<Kind>, Vec<Kind>) =
            kinds.into_iter().partition(|kind| !asked && NEWER.contains(kind));
        let wanted = if kinds.len() == 1 { 1 + random.below(3) } else { 3 + random.below(10) };
        let wanted = usize::try_from(wanted).unwrap_or(0);
        self.draw_from(&kinds, 0..wanted, options, random);
        if random.one_in(4) {
            self.draw_from(&newer, wanted..wanted + 2, options, random);
        }
        self.faults.sort_by_key(|fault| fault.from);
    }

    fn draw_from(&mut self, kinds: &[Kind], numbers: Range<usize>, options: &Options, random: &mut Random) {
        for number in numbers {
            let Some(&kind) = random.pick(kinds) else { return };
            let promise = kind.promise();
            let periods = random.within(promise.lasts);
            let last = options.periods.saturating_sub(periods + CALM).max(CALM);
            let target = match promise.scope {
                Scope::Robot => self.robot(random),
                Scope::Driver => {
                    let robot = self.robot(random);
                    self.drivers.iter().position(|robots| robots.contains(&robot)).unwrap_or(0)
                }
                Scope::Worker => random.index(self.workers),
                Scope::Fleet => 0,
            };
            let fault = Fault {
                number,
                kind,
                from: random.within((CALM, last)),
                periods,
                target,
                chance: random.range(0.0, 1.0),
            };
            if self.fits(&fault) {
                self.faults.push(fault);
            }
        }
    }

    /// A robot that faults may concern, and that takes commands.
    fn robot(&self, random: &mut Random) -> usize {
        let robots = self.config.scenario.robots.iter().enumerate();
        let own: Vec<usize> = robots
            .filter(|(index, robot)| robot.foreign_speed_mps.is_none() && !self.apart.contains(index))
            .map(|(index, _)| index)
            .collect();
        random.pick(&own).copied().unwrap_or(0)
    }

    fn suits(&self, kind: Kind) -> bool {
        let scope = kind.promise().scope;
        match kind {
            // Who is far away would be seen to be touched by these.
            _ if !self.apart.is_empty() => {
                matches!(scope, Scope::Robot | Scope::Driver)
                    && !matches!(kind, Kind::OpGoal | Kind::OpBadGoal)
            }
            // New places have to be free.
            Kind::OpGoal | Kind::Kidnapped => self.class == Class::Open,
            _ => true,
        }
    }

    /// Whether a fault does not take another one's ground: what would make two promises contradict.
    fn fits(&self, new: &Fault) -> bool {
        let many = |kind: Kind| self.faults.iter().filter(|fault| fault.kind == kind).count();
        let near = |fault: &Fault, margin: u64| {
            fault.from <= new.until().saturating_add(margin)
                && new.from <= fault.until().saturating_add(margin)
        };
        let exclusive = |kind: Kind| {
            matches!(
                kind,
                Kind::Kill | Kind::OpPause | Kind::OpStop | Kind::OpAdd | Kind::OpGoal | Kind::OpBadGoal
            )
        };
        // A worker rests after the fourth panic, which has to be the one that is meant.
        let panics = match new.kind {
            Kind::WorkerPanic => many(Kind::WorkerPanic) < 3 && many(Kind::WorkerRests) == 0,
            Kind::WorkerRests => many(Kind::WorkerPanic) == 0 && many(Kind::WorkerRests) == 0,
            _ => true,
        };
        panics
            && (new.kind != Kind::Kill || many(Kind::Kill) < 2)
            && !(exclusive(new.kind)
                && self.faults.iter().any(|fault| exclusive(fault.kind) && near(fault, 4)))
            && !self.faults.iter().any(|f| f.kind == new.kind && f.target == new.target && near(f, 2))
    }
}

/// Everybody has a driver; no driver has robots of both groups.
fn drivers(fleet: usize, apart: &[usize], random: &mut Random) -> Vec<Vec<usize>> {
    let share = 1 + random.index(fleet.min(4));
    let (far, near): (Vec<usize>, Vec<usize>) = (0..fleet).partition(|index| apart.contains(index));
    near.chunks(share).chain(far.chunks(share.max(2))).map(<[usize]>::to_vec).collect()
}

fn scenario(
    class: Class,
    robots: usize,
    seed: u64,
    random: &mut Random,
) -> Result<(Scenario, Vec<usize>), ConfigError> {
    let n = robots;
    let open = |random: &mut Random| match random.below(6) {
        0 => Scenario::builtin(&format!("swap8-heading-{seed}")),
        1 => Scenario::builtin(&format!("circle-{n}")),
        2 => Scenario::builtin(&format!("rows-{n}")),
        3 => Scenario::builtin(&format!("columns-{n}")),
        _ => Scenario::builtin(&format!("random-{n}-{seed}")),
    };
    let scattered = |seed: u64| Scenario::builtin(&format!("random-{n}-{seed}"));
    let mut apart = Vec::new();
    let mut scenario = match class {
        Class::Open => open(random)?,
        Class::Obstacles => match random.below(2) {
            0 => Scenario::builtin(&format!("pillars-{}", n.min(8)))?,
            _ => Scenario::builtin(&format!("doorway-{n}"))?,
        },
        _ => scattered(seed)?,
    };
    match class {
        Class::Coincident => scenario.robots[1].start = scenario.robots[0].start,
        Class::Overlap => {
            let at = scenario.robots[0].start.position_m;
            let (gap_m, way) = (random.range(0.01, 0.44), random.range(-PI, PI));
            let (x, y) = (at.x + gap_m * way.cos(), at.y + gap_m * way.sin());
            scenario.robots[1].start = Pose::new(x, y, random.range(-PI, PI));
        }
        Class::AtGoal => {
            for index in (0..scenario.robots.len()).step_by(2) {
                let here = scenario.robots[index].start.position_m;
                let mut others = scenario.robots.iter().enumerate().filter(|(other, _)| *other != index);
                // Not where somebody else wants to be.
                if others.all(|(_, other)| (other.goal_m - here).norm() > 1.5) {
                    scenario.robots[index].goal_m = here;
                }
            }
        }
        Class::Wrap => {
            for (index, robot) in scenario.robots.iter_mut().enumerate() {
                let theta = if index % 2 == 0 { PI } else { -PI };
                robot.start = Pose { theta_rad: theta, ..robot.start };
                robot.goal_m.x = robot.start.position_m.x - 8.0;
                robot.goal_m.y = robot.start.position_m.y;
            }
        }
        Class::Boxed => {
            let at = scenario.robots[0].start.position_m;
            let corner = |x: f64, y: f64| Vec2::new(at.x + 0.8 * x, at.y + 0.8 * y);
            let corners = [corner(-1.0, -1.0), corner(1.0, -1.0), corner(1.0, 1.0), corner(-1.0, 1.0)];
            let walls = (0..4).map(|i| Obstacle::Segment { from_m: corners[i], to_m: corners[(i + 1) % 4] });
            scenario.obstacles.extend(walls);
            // Nobody else is in the box, or wants to be.
            for robot in scenario.robots.iter_mut().skip(1) {
                let away = Vec2::new(0.0, 60.0);
                robot.start.position_m += away;
                robot.goal_m += away;
            }
        }
        Class::Foreign => {
            if let Some(robot) = scenario.robots.last_mut() {
                robot.foreign_speed_mps = Some(0.4);
                robot.goal_m = robot.start.position_m;
            }
        }
        Class::TwoGroups => {
            let far = scattered(seed.wrapping_add(77))?;
            let first = scenario.robots.iter().map(|robot| robot.id.0).max().unwrap_or(0) + 1;
            for robot in far.robots {
                let mut robot = robot;
                robot.id = RobotId(first + robot.id.0);
                robot.start.position_m.x += 2000.0;
                robot.goal_m.x += 2000.0;
                apart.push(scenario.robots.len());
                scenario.robots.push(robot);
            }
        }
        Class::Crowd => {
            // Everybody in a small place.
            for (index, robot) in scenario.robots.iter_mut().enumerate() {
                let (row, column) = ((index / 3) as f64, (index % 3) as f64);
                robot.start = Pose::new(0.7 * column, 0.7 * row, robot.start.theta_rad);
            }
        }
        Class::Open | Class::Obstacles => {}
    }
    Ok((scenario, apart))
}
