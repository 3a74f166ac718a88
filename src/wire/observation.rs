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
    /// Which command the robot follows: the code of its [`Holding`] at the stamp; 0 where the writer does
    /// not know.
    pub holding: u32,
    /// Position, m.
    pub x_m: f64,
    /// Position, m.
    pub y_m: f64,
    /// Heading, rad; any finite value, wrapped on admission.
    pub theta_rad: f64,
}

/// Which command a robot follows at an instant, as its [gate](crate::actuation::Gate) tells it.
///
/// Without it the daemon takes a robot to have got every command in time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Holding {
    /// Who looks does not know: a localisation system that has nothing to do with the driver.
    #[default]
    Untold,
    /// None: the robot stands, because it missed one or never had one.
    Nothing,
    /// It has followed every command up to this one, which it has taken and may still be waiting to act.
    Command {
        /// The command's tick.
        tick: u64,
    },
}

impl Holding {
    /// The code of [`Nothing`](Self::Nothing).
    const NOTHING: u32 = 1;
    /// Marks the code of a command; the other bits are the lowest of its tick.
    const COMMAND: u32 = 1 << 31;

    /// How it stands in a record: 0 untold, 1 nothing, otherwise bit 31 and the lowest 31 bits of the tick.
    pub fn code(self) -> u32 {
        match self {
            Self::Untold => 0,
            Self::Nothing => Self::NOTHING,
            Self::Command { tick } => {
                let [a, b, c, d, ..] = tick.to_le_bytes();
                Self::COMMAND | u32::from_le_bytes([a, b, c, d])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_tell_ticks_apart_and_from_no_command() {
        let code = |tick| Holding::Command { tick }.code();
        assert_eq!((Holding::Untold.code(), Holding::Nothing.code()), (0, 1));
        assert_eq!((code(0), code(1), code(7)), (0x8000_0000, 0x8000_0001, 0x8000_0007));
        // Period numbers run on past what the code has room for.
        assert_eq!((code(u64::MAX), code(1 << 31)), (u32::MAX, code(0)));
    }
}
