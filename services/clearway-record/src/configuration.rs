//! The daemon's configuration as it travels with a recording.

use clearway::attach::{AdminError, Client};
use clearway::config::{ChannelConfig, Config};
use clearway::document::ConfigError;
use clearway::scenario::Scenario;
use std::collections::BTreeMap;
use std::time::Duration;

/// How long a daemon may take for one answer.
const PATIENCE: Duration = Duration::from_millis(500);

/// What a daemon says of itself.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Answer {
    pub(crate) epoch: u64,
    pub(crate) configuration: String,
    pub(crate) scenario: String,
}

/// Asks the fleet's daemon what it runs with.
pub(crate) fn ask(fleet: &str, location: &ChannelConfig) -> Result<Answer, AdminError> {
    let mut admin = Client::connect_at(fleet, location)?.admin()?.with_timeout(PATIENCE);
    Ok(Answer {
        epoch: admin.status()?.figures.epoch,
        configuration: admin.configuration()?,
        scenario: admin.scenario()?,
    })
}

/// The configurations in a recording, by run.
#[derive(Debug, Clone, Default)]
pub struct Configurations {
    texts: BTreeMap<String, String>,
}

/// Name of the attached configuration of a run.
pub(crate) fn configuration_name(epoch: u64) -> String {
    format!("configuration-{epoch}.toml")
}

/// Name of the attached scenario of a run.
pub(crate) fn scenario_name(epoch: u64) -> String {
    format!("scenario-{epoch}.toml")
}

impl Configurations {
    /// Takes note of an attached file.
    pub fn add(&mut self, name: &str, text: &str) {
        self.texts.insert(name.to_owned(), text.to_owned());
    }

    /// What the daemon ran with in `epoch`; `None` when the recording does not say.
    ///
    /// # Errors
    /// The texts are of another version, or were changed.
    pub fn of(&self, epoch: u64) -> Result<Option<Config>, ConfigError> {
        let name = configuration_name(epoch);
        let (Some(text), Some(scenario)) = (self.texts.get(&name), self.texts.get(&scenario_name(epoch)))
        else {
            return Ok(None);
        };
        let scenario = Scenario::parse(scenario, &scenario_name(epoch))?;
        Config::parse_around(text, &name, scenario).map(Some)
    }
}
