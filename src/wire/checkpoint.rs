use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Bits of [`RobotCheckpoint::flags`].
pub mod checkpoint_flags {
    /// The robot's controller looked at the state of this period, and `words` is what it remembered
    /// before. Without it the worker has not answered, or its record came too late.
    pub const ANSWERED: u32 = 1;
    /// It stands inside the tolerance of its goal, and counts as arrived until it is seen outside for certain.
    pub const SETTLED: u32 = 1 << 1;
}

/// Header of a sample on `checkpoint`: one period of the loop.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.CheckpointHeader")]
pub struct CheckpointHeader {
    /// Which run of the daemon.
    pub epoch: u64,
    /// Number of the period whose state was answered.
    pub tick: u64,
    /// Periods skipped just before this one because the loop overran.
    pub skipped_periods: u64,
    /// 1 when the commands that answer the state went out, 0 when it was too late for them.
    pub commands_published: u64,
    /// Records of the sample.
    pub records: u32,
    /// CRC-32 of the channel's name, the header before this field, and the records.
    pub checksum: u32,
}

/// One robot in a sample on `checkpoint`: what its controller remembered before it answered the
/// state of the period. With that state and the configuration, the command can be computed again.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotCheckpoint")]
pub struct RobotCheckpoint {
    /// Id of the robot.
    pub id: u32,
    /// Bits of [`checkpoint_flags`].
    pub flags: u32,
    /// The memory. Its meaning belongs to the controller of the same version of the program.
    pub words: [u64; RobotCheckpoint::WORDS],
}

impl RobotCheckpoint {
    /// Room for a robot's memory.
    pub const WORDS: usize = 32;
}
