//! What a daemon keeps over its end, whatever ends it: the fleet's goals, a stop, a pause, who was added
//! or removed, and how often it had to be started again.
//!
//! [`Kept`] is plain data. [`Kept::encode`] and [`Kept::decode`] turn it into text and back, with a
//! checksum, so that a torn, corrupt or foreign text is told from a sound one; [`mod@file`] puts the text on
//! a disk so that there is always one whole file. [`Restarts`] counts starts after a crash. World frame,
//! metres, radians, `CLOCK_BOOTTIME` ns. Never on a real-time thread; it allocates and formats.
//!
//! ```
//! use clearway::journal::{Kept, StoppedBy};
//! use clearway::scenario::Scenario;
//!
//! let scenario = Scenario::builtin("swap8")?;
//! let mut kept = Kept::new("default", &scenario);
//! kept.stopped = Some(StoppedBy::Operator);
//! let text = kept.encode();
//! assert_eq!(Kept::decode(text.as_bytes()).unwrap(), kept);
//! assert!(Kept::decode(&text.as_bytes()[1..]).is_err());
//! # Ok::<(), clearway::document::ConfigError>(())
//! ```

pub mod file;
mod restarts;
mod resume;
mod text;

pub use restarts::{Moment, Restarts};
pub use resume::{Note, OtherFleet, Resumed, resume};
pub use text::{Damage, epoch_after};

use crate::document::names;
use crate::model::RobotSpec;
use crate::scenario::Scenario;

/// What stopped a fleet, and has to be cleared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StoppedBy {
    /// An operator.
    Operator,
    /// The daemon itself: it had to be started again too often.
    Restarts,
    /// The daemon itself: its journal could not be read, so that nobody knows whether there was a stop.
    Journal,
}

names!(StoppedBy { Operator => "operator", Restarts => "restarts", Journal => "journal" });

/// What is kept.
#[derive(Debug, Clone, PartialEq)]
pub struct Kept {
    /// Name of the fleet.
    pub fleet: String,
    /// Name of the scenario that the robots are from, for people.
    pub scenario: String,
    /// [`digest`] of that scenario as it was read.
    pub digest: String,
    /// The run of the daemon that wrote it; below 2⁶³.
    pub epoch: u64,
    /// Whether that run came to an orderly end.
    pub ended: bool,
    /// Whether the fleet was paused.
    pub paused: bool,
    /// What had stopped the fleet, if something had.
    pub stopped: Option<StoppedBy>,
    /// Starts after runs that did not end in order.
    pub restarts: Restarts,
    /// The robots that take commands, with today's goals, in ascending order of id. A robot's start is
    /// where the scenario, or whoever added it, said.
    pub robots: Vec<RobotSpec>,
}

impl Kept {
    /// What there is to keep before the first period of a fleet.
    pub fn new(fleet: &str, scenario: &Scenario) -> Self {
        Self {
            fleet: fleet.to_owned(),
            scenario: scenario.name.clone(),
            digest: digest(scenario),
            epoch: 0,
            ended: false,
            paused: false,
            stopped: None,
            restarts: Restarts::default(),
            robots: own(&scenario.robots),
        }
    }

    /// The text of a journal.
    pub fn encode(&self) -> String {
        text::encode(self)
    }

    /// Reads the text of a journal.
    ///
    /// # Errors
    /// What is wrong with it: any bit that is not as it was written, any byte that is missing.
    pub fn decode(bytes: &[u8]) -> Result<Self, Damage> {
        text::decode(bytes)
    }
}

/// The robots that take commands, in ascending order of id.
pub fn own<'a>(robots: impl IntoIterator<Item = &'a RobotSpec>) -> Vec<RobotSpec> {
    let mut own: Vec<_> =
        robots.into_iter().filter(|robot| robot.foreign_speed_mps.is_none()).copied().collect();
    own.sort_by_key(|robot| robot.id);
    own
}

/// Names the contents of a scenario: SHA-1 of it as TOML, in hexadecimal. Against mistakes, not against
/// malice.
pub fn digest(scenario: &Scenario) -> String {
    sha1_smol::Sha1::from(scenario.to_toml()).hexdigest()
}
