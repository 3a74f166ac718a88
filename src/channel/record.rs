use std::fmt::Debug;

use bytemuck::Pod;
use iceoryx2::prelude::ZeroCopySend;

use super::memory::{Memory, Topic};
use crate::config::ChannelConfig;
use crate::wire::{
    CheckpointHeader, CommandHeader, Header, ObservationHeader, RobotCheckpoint, RobotCommand,
    RobotObservation, RobotState, RobotTelemetry, Seal, StateHeader, TelemetryHeader,
};

/// Shared memory that a channel may fill when its depth is not set.
const CHANNEL_BYTES: usize = 32 << 20;

/// Larger samples are those of fleets of thousands: fewer of them wait.
const LARGE_BYTES: usize = 1 << 20;

/// Readers that `checkpoint` can have at a time: recorders.
const CHECKPOINT_READERS_MAX: usize = 4;

/// The channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// Poses from plants and drivers.
    Observation,
    /// The fleet's state at the start of each period.
    State,
    /// What the robots are to do in the next period.
    Command,
    /// How each period went.
    Telemetry,
    /// What the controllers remembered before each period.
    Checkpoint,
}

impl Channel {
    /// The last part of the channel's name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Observation => "observation",
            Self::State => "state",
            Self::Command => "command",
            Self::Telemetry => "telemetry",
            Self::Checkpoint => "checkpoint",
        }
    }

    /// The channel's full name in the fleet `fleet`.
    pub fn service_name(self, fleet: &str) -> String {
        format!("clearway/{fleet}/v1/{}", self.name())
    }

    /// The seal of its samples.
    pub fn seal(self, fleet: &str) -> Seal {
        Seal::of(&self.service_name(fleet))
    }

    /// Whether a slow reader loses its oldest samples; otherwise it does not get the newest.
    pub(super) fn overwrites_oldest(self) -> bool {
        !matches!(self, Self::Telemetry | Self::Checkpoint)
    }

    /// Whether who joins gets the newest sample at once.
    pub(super) fn keeps_newest(self) -> bool {
        matches!(self, Self::State | Self::Command)
    }

    pub(super) fn max_writers(self, config: &ChannelConfig) -> usize {
        if self == Self::Observation { config.max_observers.max(1) } else { 1 }
    }

    pub(super) fn max_readers(self, config: &ChannelConfig) -> usize {
        let readers = config.max_readers.max(1);
        if self == Self::Checkpoint { readers.min(CHECKPOINT_READERS_MAX) } else { readers }
    }

    /// Samples kept for each reader, when one sample has `sample_bytes`.
    pub(super) fn depth(self, config: &ChannelConfig, sample_bytes: usize) -> usize {
        let fits = CHANNEL_BYTES / (self.max_readers(config) * sample_bytes.max(1));
        let least = if sample_bytes > LARGE_BYTES { 2 } else { 8 };
        config.depth.unwrap_or(fits.clamp(least, 64)).max(1)
    }
}

/// A record that has a channel of its own.
pub trait Record: ZeroCopySend + Pod + Debug + Default {
    /// What stands once at the head of a sample.
    type Header: Header + ZeroCopySend + Debug;
    /// Where it travels.
    const CHANNEL: Channel;

    /// The same channel inside one process.
    #[doc(hidden)]
    fn topic(memory: &Memory) -> &Topic<Self>
    where
        Self: Sized;
}

impl Record for RobotObservation {
    type Header = ObservationHeader;
    const CHANNEL: Channel = Channel::Observation;

    fn topic(memory: &Memory) -> &Topic<Self> {
        &memory.observation
    }
}

impl Record for RobotState {
    type Header = StateHeader;
    const CHANNEL: Channel = Channel::State;

    fn topic(memory: &Memory) -> &Topic<Self> {
        &memory.state
    }
}

impl Record for RobotCommand {
    type Header = CommandHeader;
    const CHANNEL: Channel = Channel::Command;

    fn topic(memory: &Memory) -> &Topic<Self> {
        &memory.command
    }
}

impl Record for RobotTelemetry {
    type Header = TelemetryHeader;
    const CHANNEL: Channel = Channel::Telemetry;

    fn topic(memory: &Memory) -> &Topic<Self> {
        &memory.telemetry
    }
}

impl Record for RobotCheckpoint {
    type Header = CheckpointHeader;
    const CHANNEL: Channel = Channel::Checkpoint;

    fn topic(memory: &Memory) -> &Topic<Self> {
        &memory.checkpoint
    }
}
