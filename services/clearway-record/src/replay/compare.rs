//! Two commands, bit by bit.

use clearway::model::Limits;
use clearway::wire::{RobotCommand, RobotState, StopReason, state_flags};
use serde::Serialize;
use std::fmt;

/// A field of a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Field {
    /// Id of the robot.
    Id,
    /// Why it was stopped.
    StopReason,
    /// Forward speed.
    VMps,
    /// Turn rate.
    OmegaRadps,
}

impl fmt::Display for Field {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Id => "id",
            Self::StopReason => "stop_reason",
            Self::VMps => "v_mps",
            Self::OmegaRadps => "omega_radps",
        })
    }
}

/// A field's value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Value {
    /// As a number.
    pub number: f64,
    /// All bits; as text, because JSON's numbers have fewer.
    #[serde(serialize_with = "hexadecimal")]
    pub bits: u64,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde's signature")]
fn hexadecimal<S: serde::Serializer>(bits: &u64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("0x{bits:016x}"))
}

impl Value {
    fn whole(n: u32) -> Self {
        Self { number: f64::from(n), bits: u64::from(n) }
    }

    fn real(x: f64) -> Self {
        Self { number: x, bits: x.to_bits() }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:?} (0x{:016x})", self.number, self.bits)
    }
}

/// Where a recording and its replay part.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Difference {
    /// Which run of the daemon.
    pub epoch: u64,
    /// Tick of the command sample: the period in which the command acts.
    pub tick: u64,
    /// Id of the robot.
    pub robot: u32,
    /// The field.
    pub field: Field,
    /// What was recorded.
    pub recorded: Value,
    /// What was computed.
    pub solved: Value,
}

/// What the loop sends for a robot in this state when its controller decided `solved` in time.
pub(super) fn expected(state: &RobotState, solved: RobotCommand, limits: &Limits) -> RobotCommand {
    let stop = |reason| RobotCommand::stop(state.robot(), reason);
    if state.has(state_flags::VACANT) {
        stop(StopReason::Vacant)
    } else if state.has(state_flags::FOREIGN) {
        stop(StopReason::Foreign)
    } else if state.has(state_flags::STOPPED) {
        stop(StopReason::Stopped)
    } else if state.has(state_flags::PAUSED) {
        stop(StopReason::Paused)
    } else if !state.has(state_flags::VALID) {
        stop(StopReason::NoState)
    } else if state.has(state_flags::OUT_OF_STEP) {
        stop(StopReason::OutOfStep)
    } else if solved.stop_reason != 0 {
        RobotCommand { v_mps: 0.0, omega_radps: 0.0, ..solved }
    } else if limits.admits(solved.command()) {
        solved
    } else {
        stop(StopReason::Unverified)
    }
}

/// The first field that differs, with both values.
pub(super) fn compare(recorded: &RobotCommand, solved: &RobotCommand) -> Option<(Field, Value, Value)> {
    let fields = |c: &RobotCommand| {
        [
            (Field::Id, Value::whole(c.id)),
            (Field::StopReason, Value::whole(c.stop_reason)),
            (Field::VMps, Value::real(c.v_mps)),
            (Field::OmegaRadps, Value::real(c.omega_radps)),
        ]
    };
    fields(recorded)
        .into_iter()
        .zip(fields(solved))
        .find(|((_, recorded), (_, solved))| recorded.bits != solved.bits)
        .map(|((field, recorded), (_, solved))| (field, recorded, solved))
}

#[cfg(test)]
mod tests {
    use super::*;
    use clearway::model::{Command, RobotId};

    #[test]
    fn every_bit_of_every_field_counts() {
        let command = RobotCommand::verified(RobotId(3), Command { v_mps: 1.5, omega_radps: 0.0 });
        assert_eq!(compare(&command, &command), None);
        let nan = RobotCommand { v_mps: f64::NAN, ..command };
        assert_eq!(compare(&nan, &nan), None, "the same bits are equal, whatever they mean");
        for bit in 0..64 {
            let v = RobotCommand { v_mps: f64::from_bits(command.v_mps.to_bits() ^ 1 << bit), ..command };
            let (field, recorded, solved) = compare(&command, &v).unwrap();
            assert_eq!((field, recorded.bits ^ solved.bits), (Field::VMps, 1 << bit));
        }
        let signed = RobotCommand { omega_radps: -0.0, ..command };
        assert_eq!(compare(&command, &signed).unwrap().0, Field::OmegaRadps);
        let stopped = RobotCommand { stop_reason: 2, ..signed };
        assert_eq!(compare(&command, &stopped).unwrap().0, Field::StopReason);
        assert_eq!(compare(&command, &RobotCommand { id: 4, ..command }).unwrap().0, Field::Id);
    }

    #[test]
    fn what_a_state_says_stops_a_robot_whatever_was_computed() {
        let solved = RobotCommand::verified(RobotId(0), Command { v_mps: 1.5, omega_radps: 0.0 });
        let sent =
            |flags| expected(&RobotState { flags, ..RobotState::default() }, solved, &Limits::default());
        assert_eq!(sent(state_flags::VALID | state_flags::MAY_STAND), solved);
        // As in the loop, the first of these that applies.
        let out = state_flags::VALID | state_flags::OUT_OF_STEP;
        let cases = [
            (out, StopReason::OutOfStep),
            (state_flags::OUT_OF_STEP, StopReason::NoState),
            (out | state_flags::PAUSED, StopReason::Paused),
            (out | state_flags::PAUSED | state_flags::STOPPED, StopReason::Stopped),
        ];
        for (flags, reason) in cases {
            assert_eq!(sent(flags), RobotCommand::stop(RobotId(0), reason), "{flags:#b}");
        }
    }
}
