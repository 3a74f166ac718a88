//! What is to be done: the robots, their starts and goals, the limits and the obstacles.
//!
//! Reads a built-in name or a TOML file (`schema = 1`); writes a checked [`Scenario`]. World frame,
//! metres, radians, seconds. Used at start-up only, so it may allocate and format.
//!
//! ```
//! use clearway::scenario::Scenario;
//!
//! let circle = Scenario::builtin("circle-10")?;
//! assert_eq!(circle.robots.len(), 10);
//!
//! let error = Scenario::builtin("cirle-10").unwrap_err();
//! assert_eq!(error.to_string(), "there is no built-in scenario `cirle-10`");
//! # Ok::<(), clearway::document::ConfigError>(())
//! ```

mod builtin;
mod check;
mod read;
mod write;

pub(crate) use builtin::SplitMix64;
pub(crate) use check::{ROUNDING_M, SIZE_MAX_M};
pub(crate) use read::read;
pub(crate) use write::ScenarioText;

use crate::document::{ConfigError, Document, Problem};
use crate::geometry::{Vec2, wrap};
use crate::model::{Limits, Obstacle, RobotSpec};
use std::path::Path;

/// A checked scenario: ids unique, all numbers finite, starts and goals apart.
#[derive(Debug, Clone, PartialEq)]
pub struct Scenario {
    /// Name, for people and reports.
    pub name: String,
    /// A robot has arrived when it stays within this distance of its goal, m.
    pub tolerance_m: f64,
    /// Time after which the run is given up, s.
    pub duration_s: f64,
    /// Input limits and the gap to keep.
    pub limits: Limits,
    /// The fleet, in ascending order of id.
    pub robots: Vec<RobotSpec>,
    /// Everything that does not move.
    pub obstacles: Vec<Obstacle>,
}

impl Scenario {
    /// Most robots of a fleet.
    pub const MAX_ROBOTS: usize = 131_072;
    /// Most obstacles.
    pub const MAX_OBSTACLES: usize = 1024;
    /// Tolerance of a scenario that gives none, m.
    pub const DEFAULT_TOLERANCE_M: f64 = 0.05;
    /// Duration of a scenario that gives none, s.
    pub const DEFAULT_DURATION_S: f64 = 60.0;

    /// Reads and checks the TOML file at `path`.
    ///
    /// # Errors
    /// It cannot be read, or something in it is wrong: every problem found, each with its line, its
    /// key and what to change.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        read(Document::load(path)?)
    }

    /// Reads and checks TOML text; errors name it `file_name`.
    ///
    /// # Errors
    /// As [`Scenario::load`].
    pub fn parse(text: &str, file_name: &str) -> Result<Self, ConfigError> {
        read(Document::parse(text, file_name)?)
    }

    /// The scenario that a command line means: a file when `name_or_path` ends in `.toml` or exists,
    /// a built-in name otherwise.
    ///
    /// # Errors
    /// As [`Scenario::load`] or [`Scenario::builtin`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ConfigError> {
        if is_path(name_or_path) { Self::load(Path::new(name_or_path)) } else { Self::builtin(name_or_path) }
    }

    /// The built-in scenario called `name`; [`Scenario::builtins`] lists them.
    ///
    /// # Errors
    /// There is none of that name (with the nearest one as help), or its number of robots is out of
    /// range.
    pub fn builtin(name: &str) -> Result<Self, ConfigError> {
        let scenario = builtin::build(name)?;
        scenario.check()?;
        Ok(scenario)
    }

    /// The built-in families: the pattern of their names, such as `circle-N`, and one line about
    /// each. `N` stands for a number of robots, `SEED` for any number below 2⁶⁴.
    pub fn builtins() -> impl Iterator<Item = (&'static str, &'static str)> {
        builtin::families()
    }

    /// The names of the built-in scenarios that a control law is held to: every family, several
    /// sizes, many seeds.
    pub fn suite() -> Vec<String> {
        builtin::suite()
    }

    /// Checks a scenario that was put together by a program, by the rules for files.
    ///
    /// # Errors
    /// The first rules that it breaks, without places.
    pub fn check(&self) -> Result<(), ConfigError> {
        let problem = |fault: check::Fault| {
            let key = fault.parts.first().map_or(String::new(), |(part, _)| part.key());
            Problem::new(fault.kind, key, fault.message)
                .advise(fault.help)
                .of(format!("scenario `{}`", self.name))
        };
        let problems = check::faults(self).into_iter().map(problem).collect();
        ConfigError::from_problems(problems).map_or(Ok(()), Err)
    }

    /// The scenario as a TOML file that reads back to the bit: a built-in to start from.
    pub fn to_toml(&self) -> String {
        write::to_toml(self)
    }

    /// Distance ρ_ij = d_s + r_i + r_j that two centres keep, m (22).
    pub fn required_distance_m(&self, i: usize, j: usize) -> f64 {
        self.limits.safety_margin_m + self.robots[i].radius_m + self.robots[j].radius_m
    }
}

/// Whether a command line means a file: it ends in `.toml`, or there is one.
pub(crate) fn is_path(name_or_path: &str) -> bool {
    has_file_ending(name_or_path) || Path::new(name_or_path).is_file()
}

/// Whether it ends in `.toml`.
pub(crate) fn has_file_ending(name_or_path: &str) -> bool {
    Path::new(name_or_path).extension().is_some_and(|e| e.eq_ignore_ascii_case("toml"))
}

/// Heading from one point to another, rad, in (−π, π]; 0 when they are the same.
fn heading_toward(from_m: Vec2, to_m: Vec2) -> f64 {
    let d = to_m - from_m;
    // atan2 gives −π for a y of −0; headings are in (−π, π].
    if d == Vec2::zeros() { 0.0 } else { wrap(libm::atan2(d.y, d.x)) }
}
