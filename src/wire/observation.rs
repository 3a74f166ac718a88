use bytemuck::{Pod, Zeroable};
use iceoryx2::prelude::ZeroCopySend;

/// Header of a sample on `observation`, written by a plant, a driver or a localisation system.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.ObservationHeader")]
pub struct ObservationHeader {
    /// The epoch of the daemon that the writer is following; 0 before it saw one.
    pub epoch: u64,
    /// Number of the sample, rising by one from the writer's first.
    pub sequence: u64,
    /// When the poses were true, `CLOCK_MONOTONIC` ns.
    pub stamp_ns: u64,
    /// Records of the sample.
    pub records: u32,
    /// CRC-32 of the channel's name, the header before this field, and the records.
    pub checksum: u32,
}

/// One robot in a sample on `observation`.
#[repr(C)]
#[derive(Debug, Clone, Copy, Default, PartialEq, ZeroCopySend, Pod, Zeroable)]
#[type_name("clearway.v1.RobotObservation")]
pub struct RobotObservation {
    /// Id of the robot.
    pub id: u32,
    /// Zero; reserved.
    pub reserved: u32,
    /// Position, m.
    pub x_m: f64,
    /// Position, m.
    pub y_m: f64,
    /// Heading, rad; any finite value, wrapped on admission.
    pub theta_rad: f64,
}
