//! Everything that can be set, with its default, its unit and its range.
//!
//! One struct a concern; the modules that follow take theirs by reference. The defaults are the
//! paper's where it gives a value. `docs/CONFIGURATION.md` explains every key. Used at start-up only.
//!
//! ```
//! use clearway::config::{Config, Profile};
//!
//! let text = r#"
//!     schema = 1
//!     scenario = "circle-10"
//!     [timing]
//!     period_us = 40_000
//! "#;
//! let config = Config::parse(text, "clearway.toml")?;
//! assert_eq!((config.timing.period_ns, config.scenario.robots.len()), (40_000_000, 10));
//!
//! // Command lines set keys the same way, checked by the same rules.
//! let config = Config::with_overrides(None, &["scenario=swap8", "controller.profile=exp"])?;
//! assert_eq!(config.controller.profile, Profile::Exponential);
//! # Ok::<(), clearway::document::ConfigError>(())
//! ```

mod admin;
mod channel;
mod checked;
mod controller;
mod disturbance;
mod guidance;
mod journal;
mod read;
mod robust;
mod rules;
mod runtime;
mod write;

pub use admin::AdminConfig;
pub use channel::ChannelConfig;
pub use checked::Checked;
pub use controller::{BarrierForm, ControllerConfig, Profile, SolverKind, Weights};
pub use disturbance::{DisturbanceConfig, Pattern};
pub use guidance::GuidanceParams;
pub use journal::JournalConfig;
pub use runtime::{
    PublishAt, RealTimeConfig, RealTimePolicy, SourceConfig, SourceKind, TelemetryConfig, TimingConfig,
    Wakeup,
};

use crate::document::{ConfigError, Document, ErrorKind, Problem};
use crate::model::Disturbance;
use crate::scenario::Scenario;
use std::path::Path;

/// The whole configuration of one fleet's daemon, resolved and checked.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// Name of the fleet: the second element of every channel's name.
    pub fleet: String,
    /// What is to be done.
    pub scenario: Scenario,
    /// Period, deadline, workers.
    pub timing: TimingConfig,
    /// Scheduling, pinning, memory locking.
    pub realtime: RealTimeConfig,
    /// The control law.
    pub controller: ControllerConfig,
    /// How robots avoid each other ahead of time.
    pub guidance: GuidanceParams,
    /// Bounds on disturbances that the safety rows allow for.
    pub robust: Disturbance,
    /// Disturbances that the plant makes.
    pub disturbance: DisturbanceConfig,
    /// Where states come from.
    pub source: SourceConfig,
    /// Queues and histograms.
    pub telemetry: TelemetryConfig,
    /// What operators may do.
    pub admin: AdminConfig,
    /// What is kept over a restart.
    pub journal: JournalConfig,
    /// Where the channels live and how much they hold.
    pub channel: ChannelConfig,
}

/// Whether `name` can be part of channel names, and of file names under `/dev/shm`.
pub fn is_fleet_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=64).contains(&name.len()) && name.chars().all(allowed)
}

impl Config {
    /// The defaults around a scenario.
    pub fn new(scenario: Scenario) -> Self {
        Self {
            fleet: "default".to_owned(),
            scenario,
            timing: TimingConfig::default(),
            realtime: RealTimeConfig::default(),
            controller: ControllerConfig::default(),
            guidance: GuidanceParams::default(),
            robust: Disturbance::NONE,
            disturbance: DisturbanceConfig::default(),
            source: SourceConfig::default(),
            telemetry: TelemetryConfig::default(),
            admin: AdminConfig::default(),
            journal: JournalConfig::default(),
            channel: ChannelConfig::default(),
        }
    }

    /// Places of the fleet: its robots, and room for those that may be added.
    pub fn places(&self) -> usize {
        self.scenario.robots.len().max(self.admin.capacity)
    }

    /// The settings as a TOML file, each with its value or what happens without one. The scenario goes
    /// by its name; [`Scenario::to_toml`] writes it out.
    pub fn to_toml(&self) -> String {
        write::to_toml(self)
    }

    /// Checks that the scenario leaves room for the bounds in `robust`: for configurations that were put
    /// together by a program.
    ///
    /// # Errors
    /// The rules that it breaks, without places.
    pub fn check_robust(&self) -> Result<(), ConfigError> {
        let faults = robust::faults(self);
        let problem = |fault: robust::Fault| {
            Problem::new(ErrorKind::Contradiction, fault.key, fault.message).advise(fault.help)
        };
        ConfigError::from_problems(faults.into_iter().map(problem).collect()).map_or(Ok(()), Err)
    }

    /// Reads and checks the TOML file at `path`. A scenario given as a path is relative to it.
    ///
    /// # Errors
    /// It cannot be read, or something in it is wrong: every problem found, each with its line, its
    /// key and what to change.
    pub fn load(path: &Path) -> Result<Self, ConfigError> {
        Self::with_overrides::<&str>(Some(path), &[])
    }

    /// Reads and checks TOML text; errors name it `file_name`, and a scenario given as a path is
    /// relative to it.
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn parse(text: &str, file_name: &str) -> Result<Self, ConfigError> {
        read::read(Document::parse(text, file_name)?, Some(Path::new(file_name)))
    }

    /// [`Config::parse`] around a scenario that is there already, whatever the text names: reads back
    /// [`Config::to_toml`] beside [`Scenario::to_toml`].
    ///
    /// # Errors
    /// As [`Config::load`].
    pub fn parse_around(text: &str, file_name: &str, scenario: Scenario) -> Result<Self, ConfigError> {
        read::read_around(Document::parse(text, file_name)?, Path::new(file_name), scenario)
    }

    /// The file at `path`, if there is one, with `section.key=value` arguments on top, the later
    /// ones over the earlier ones. What the file says and an argument replaces is not looked at.
    /// Without a file the scenario is `swap8` unless an argument names another.
    ///
    /// A value that is not TOML is a string: `controller.profile=exp` needs no quotes. A scenario's
    /// path in an argument is relative to the working directory.
    ///
    /// # Errors
    /// As [`Config::load`]; a problem with an argument names the argument.
    pub fn with_overrides<S: AsRef<str>>(path: Option<&Path>, overrides: &[S]) -> Result<Self, ConfigError> {
        let mut doc = match path {
            Some(path) => Document::load(path)?,
            None => Document::parse("", "defaults")?,
        };
        for argument in overrides {
            doc.set(argument.as_ref())?;
        }
        read::read(doc, path)
    }
}
