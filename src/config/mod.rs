//! Everything that can be set, with its default, its unit and its range.
//!
//! One struct a concern; the modules that follow take theirs by reference. The defaults are the
//! paper's where it gives a value. Used at start-up only.

mod channel;
mod controller;
mod runtime;

pub use channel::ChannelConfig;
pub use controller::{BarrierForm, ControllerConfig, Profile, SolverKind, Weights};
pub use runtime::{RealTimeConfig, RealTimePolicy, SourceConfig, SourceKind, TelemetryConfig, TimingConfig};

use crate::scenario::Scenario;

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
    /// Where states come from.
    pub source: SourceConfig,
    /// Queues and histograms.
    pub telemetry: TelemetryConfig,
    /// Where the channels live and how much they hold.
    pub channel: ChannelConfig,
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
            source: SourceConfig::default(),
            telemetry: TelemetryConfig::default(),
            channel: ChannelConfig::default(),
        }
    }
}
