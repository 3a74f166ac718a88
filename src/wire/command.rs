use crate::model::{Command, RobotId};
use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Header of a sample on `command`.
///
/// The commands act from `valid_from_ns` and expire at `valid_until_ns`; a receiver that holds an
/// expired command stops.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.CommandHeader")]
pub struct CommandHeader {
    /// Which run of the daemon: receivers refuse epochs older than the newest they saw.
    pub epoch: u64,
    /// The period in which the commands act: one more than the tick of the state they answer.
    pub tick: u64,
    /// When the sample was published, `CLOCK_MONOTONIC` ns.
    pub stamp_ns: u64,
    /// Stamp of the state that the commands answer, `CLOCK_MONOTONIC` ns.
    pub state_stamp_ns: u64,
    /// From when the commands act, `CLOCK_MONOTONIC` ns.
    pub valid_from_ns: u64,
    /// From when they must not be used any more, `CLOCK_MONOTONIC` ns.
    pub valid_until_ns: u64,
    /// Tick of the sample before this one, which its commands take the robots to hold; its own where there
    /// is none. A robot that does not hold that one follows no command of this sample but a stop, and none of
    /// later ones until it has held a stop for [`StopReason::OutOfStep`].
    pub follows: u64,
    /// Records of the sample.
    pub records: u32,
    /// CRC-32 of the channel's name, the header before this field, and the records.
    pub checksum: u32,
}

/// One robot in a sample on `command`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotCommand")]
pub struct RobotCommand {
    /// Id of the robot.
    pub id: u32,
    /// 0: a verified command. Otherwise a stop, and the code of its [`StopReason`].
    pub stop_reason: u32,
    /// Forward speed, m/s.
    pub v_mps: f64,
    /// Turn rate, rad/s.
    pub omega_radps: f64,
}

impl RobotCommand {
    /// A verified command.
    pub fn verified(id: RobotId, command: Command) -> Self {
        Self { id: id.0, stop_reason: 0, v_mps: command.v_mps, omega_radps: command.omega_radps }
    }

    /// A stop, and why.
    pub fn stop(id: RobotId, reason: StopReason) -> Self {
        Self { id: id.0, stop_reason: reason as u32, v_mps: 0.0, omega_radps: 0.0 }
    }

    /// The input.
    pub fn command(&self) -> Command {
        Command { v_mps: self.v_mps, omega_radps: self.omega_radps }
    }
}

/// Why a robot was told to stop instead of following its programme.
#[repr(u32)]
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum StopReason {
    /// The first period of an epoch, before any state was answered.
    Start = 1,
    /// Its command was not complete at the deadline.
    Deadline = 2,
    /// Its solution did not pass verification.
    Unverified = 3,
    /// The solver returned no solution.
    Solver = 4,
    /// More neighbours can bind than there are rows.
    Crowded = 5,
    /// There is no trusted state of this robot.
    NoState = 6,
    /// An operator or a signal asked for it.
    Operator = 7,
    /// The run is over.
    Finished = 8,
    /// The robot is a foreign one: it is observed and takes no commands.
    Foreign = 9,
    /// The fleet is paused.
    Paused = 10,
    /// The fleet is stopped, by an operator or by the daemon itself, until that is cleared.
    Stopped = 11,
    /// There is no robot: a free place of the fleet.
    Vacant = 12,
    /// The state that its command would have answered had changed in memory on its way.
    Corrupt = 13,
    /// The robot has told that it follows no commands: it missed one, or was stopped by something else. Once it
    /// holds this stop it may follow the next.
    OutOfStep = 14,
}

impl StopReason {
    /// Every reason, in the order of the codes.
    pub const ALL: [Self; 14] = [
        Self::Start,
        Self::Deadline,
        Self::Unverified,
        Self::Solver,
        Self::Crowded,
        Self::NoState,
        Self::Operator,
        Self::Finished,
        Self::Foreign,
        Self::Paused,
        Self::Stopped,
        Self::Vacant,
        Self::Corrupt,
        Self::OutOfStep,
    ];

    /// Whether nothing went wrong: an operator wants it so, or nobody is there to be driven.
    pub fn is_wanted(self) -> bool {
        matches!(self, Self::Operator | Self::Paused | Self::Stopped | Self::Foreign | Self::Vacant)
    }

    /// The reason behind a code on the wire; `None` for 0 and for codes of later versions.
    pub fn from_code(code: u32) -> Option<Self> {
        Self::ALL.into_iter().find(|r| *r as u32 == code)
    }

    /// The name in reports and logs.
    pub fn name(self) -> &'static str {
        match self {
            Self::Start => "start",
            Self::Deadline => "deadline",
            Self::Unverified => "unverified",
            Self::Solver => "solver",
            Self::Crowded => "crowded",
            Self::NoState => "no_state",
            Self::Operator => "operator",
            Self::Finished => "finished",
            Self::Foreign => "foreign",
            Self::Paused => "paused",
            Self::Stopped => "stopped",
            Self::Vacant => "vacant",
            Self::Corrupt => "corrupt",
            Self::OutOfStep => "out_of_step",
        }
    }
}
