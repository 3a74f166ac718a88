use super::Config;
use crate::document::{ConfigError, Document};
use crate::scenario::Scenario;
use std::path::Path;

/// Keys that only a configuration has at its top.
const CONFIG_KEYS: [&str; 13] = [
    "scenario",
    "fleet",
    "timing",
    "realtime",
    "controller",
    "guidance",
    "robust",
    "disturbance",
    "source",
    "telemetry",
    "admin",
    "journal",
    "channel",
];

/// What a file turned out to be, read and checked.
#[derive(Debug, Clone, PartialEq)]
pub enum Checked {
    /// A scenario.
    Scenario(Scenario),
    /// A configuration, its scenario included.
    Config(Box<Config>),
}

impl Checked {
    /// Reads a configuration file, a scenario file or a built-in scenario. A file is a configuration
    /// when it has a top-level key that only a configuration has.
    ///
    /// # Errors
    /// As [`Config::load`] or [`Scenario::resolve`].
    pub fn resolve(name_or_path: &str) -> Result<Self, ConfigError> {
        let path = Path::new(name_or_path);
        if !crate::scenario::is_path(name_or_path) {
            return Scenario::builtin(name_or_path).map(Self::Scenario);
        }
        let doc = Document::load(path)?;
        if CONFIG_KEYS.iter().any(|key| doc.has(key)) {
            return super::read::read(doc, Some(path)).map(|config| Self::Config(Box::new(config)));
        }
        crate::scenario::read(doc).map(Self::Scenario)
    }
}
