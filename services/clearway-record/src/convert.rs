//! The records of shared memory as protobuf messages and back, to the bit.

use crate::schema::clearway as proto;
use clearway::wire;

/// What stands once at the head of a sample, and one record for each place of the fleet.
#[derive(Debug, Clone, PartialEq)]
pub struct Sample<H, R> {
    /// The header.
    pub header: H,
    /// The records, in the order of the fleet's places.
    pub robots: Vec<R>,
}

/// A sample on `state`.
pub type State = Sample<wire::StateHeader, wire::RobotState>;
/// A sample on `command`.
pub type Command = Sample<wire::CommandHeader, wire::RobotCommand>;
/// A sample on `telemetry`.
pub type Telemetry = Sample<wire::TelemetryHeader, wire::RobotTelemetry>;
/// A sample on `checkpoint`.
pub type Checkpoint = Sample<wire::CheckpointHeader, wire::RobotCheckpoint>;

/// A number that was written; always, so that 0.0 and −0.0 differ.
fn number(x: Option<f64>) -> f64 {
    x.unwrap_or_default()
}

/// Declares a message's conversion once for both directions: `plain` fields as they are, `number`
/// fields always written.
macro_rules! both_ways {
    ($to:ident, $from:ident, $record:ty, $message:ty, plain [$($p:ident),*], number [$($n:ident),*]
        $(, nested [$($m:ident: $mto:ident, $mfrom:ident),*])?) => {
        #[allow(clippy::field_reassign_with_default, reason = "the message may have robots as well")]
        fn $to(r: &$record) -> $message {
            let mut m = <$message>::default();
            $(m.$p = r.$p;)*
            $(m.$n = Some(r.$n);)*
            $($(m.$m = Some($mto(&r.$m));)*)?
            m
        }

        #[allow(clippy::field_reassign_with_default, reason = "the record may have reserved fields as well")]
        fn $from(m: &$message) -> $record {
            let mut r = <$record>::default();
            $(r.$p = m.$p;)*
            $(r.$n = number(m.$n);)*
            $($(r.$m = m.$m.as_ref().map($mfrom).unwrap_or_default();)*)?
            r
        }
    };
}

both_ways!(state_header_to, state_header_from, wire::StateHeader, proto::State,
    plain [epoch, tick, stamp_ns, release_ns, period_ns, records, checksum], number []);
both_ways!(state_robot_to, state_robot_from, wire::RobotState, proto::RobotState,
    plain [id, flags],
    number [x_m, y_m, theta_rad, v_mps, omega_radps, goal_x_m, goal_y_m, radius_m, uncertainty_m,
        seen_x_m, seen_y_m, way_m],
    nested [intent: intent_to, intent_from]);
both_ways!(intent_to, intent_from, wire::RobotIntent, proto::Intent,
    plain [rank, valid],
    number [heading_rad, speed_mps, blocked_s, target_x_m, target_y_m, waypoint_x_m, waypoint_y_m]);
both_ways!(command_header_to, command_header_from, wire::CommandHeader, proto::Command,
    plain [epoch, tick, stamp_ns, state_stamp_ns, valid_from_ns, valid_until_ns, follows, records, checksum],
    number []);
both_ways!(command_robot_to, command_robot_from, wire::RobotCommand, proto::RobotCommand,
    plain [id, stop_reason], number [v_mps, omega_radps]);
both_ways!(telemetry_header_to, telemetry_header_from, wire::TelemetryHeader, proto::Telemetry,
    plain [epoch, tick, release_ns, release_lateness_ns, state_publish_ns, state_to_staged_ns,
        state_to_command_ns, deadline_lateness_ns, skipped_periods, fallback_commands, lost_records,
        audited, audit_disagreed, records, checksum],
    number [audit_max_input_gap]);
both_ways!(telemetry_robot_to, telemetry_robot_from, wire::RobotTelemetry, proto::RobotTelemetry,
    plain [id, stop_reason, status, safety_rows, active_rows, settling_steps, flags, solve_ns, step_ns],
    number [v_mps, omega_radps, lyapunov_position_m2, decrease_position_m2, slack_position_m2,
        lyapunov_heading, decrease_heading, slack_heading, slack_comfort_m, reference_rotation_rad,
        speed_cap_mps, clearance_m, kkt_residual]);
both_ways!(checkpoint_header_to, checkpoint_header_from, wire::CheckpointHeader, proto::Checkpoint,
    plain [epoch, tick, skipped_periods, commands_published, records, checksum], number []);

fn checkpoint_robot_to(r: &wire::RobotCheckpoint) -> proto::RobotCheckpoint {
    let used = r.words.iter().rposition(|word| *word != 0).map_or(0, |last| last + 1);
    proto::RobotCheckpoint { id: r.id, flags: r.flags, words: r.words[..used].to_vec() }
}

fn checkpoint_robot_from(m: &proto::RobotCheckpoint) -> wire::RobotCheckpoint {
    let mut r = wire::RobotCheckpoint { id: m.id, flags: m.flags, ..Default::default() };
    r.words.iter_mut().zip(&m.words).for_each(|(word, written)| *word = *written);
    r
}

macro_rules! sample {
    ($sample:ty, $message:ty, $header_to:ident, $header_from:ident, $robot_to:ident, $robot_from:ident) => {
        impl From<&$sample> for $message {
            fn from(s: &$sample) -> Self {
                let mut m = $header_to(&s.header);
                m.robots = s.robots.iter().map($robot_to).collect();
                m
            }
        }

        impl From<&$message> for $sample {
            fn from(m: &$message) -> Self {
                Self { header: $header_from(m), robots: m.robots.iter().map($robot_from).collect() }
            }
        }
    };
}

sample!(State, proto::State, state_header_to, state_header_from, state_robot_to, state_robot_from);
sample!(
    Command,
    proto::Command,
    command_header_to,
    command_header_from,
    command_robot_to,
    command_robot_from
);
sample!(
    Telemetry,
    proto::Telemetry,
    telemetry_header_to,
    telemetry_header_from,
    telemetry_robot_to,
    telemetry_robot_from
);
sample!(
    Checkpoint,
    proto::Checkpoint,
    checkpoint_header_to,
    checkpoint_header_from,
    checkpoint_robot_to,
    checkpoint_robot_from
);

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message;

    /// A record whose every 32-bit word differs, read from its own memory layout.
    fn filled<R: Copy + Default>(seed: u64) -> R {
        let mut record = R::default();
        let words = size_of::<R>() / 8;
        // SAFETY: the records are `repr(C)` structs of integers, floats and arrays of them without
        // padding (tests/wire.rs), for which every bit pattern is valid, and 8-byte aligned.
        let memory = unsafe { std::slice::from_raw_parts_mut((&raw mut record).cast::<u64>(), words) };
        for (index, word) in memory.iter_mut().enumerate() {
            // Signs, NaNs with payloads and subnormal numbers among them.
            *word = (seed + index as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15).rotate_left(17);
        }
        record
    }

    fn bits<R>(record: &R) -> Vec<u64> {
        let words = size_of::<R>() / 8;
        // SAFETY: as above.
        unsafe { std::slice::from_raw_parts((&raw const *record).cast::<u64>(), words) }.to_vec()
    }

    fn survives<H: Copy + Default, R: Copy + Default, M>(drop: impl Fn(&mut H, &mut R))
    where
        M: Message + Default + for<'a> From<&'a Sample<H, R>>,
        Sample<H, R>: for<'a> From<&'a M>,
    {
        for seed in 0..200 {
            let mut sample = Sample { header: filled::<H>(seed), robots: vec![filled::<R>(seed + 7)] };
            drop(&mut sample.header, &mut sample.robots[0]);
            sample.robots.push(R::default());
            let bytes = M::from(&sample).encode_to_vec();
            let back = Sample::<H, R>::from(&M::decode(bytes.as_slice()).unwrap());
            assert_eq!(bits(&back.header), bits(&sample.header));
            assert_eq!(back.robots.len(), 2);
            for (back, robot) in back.robots.iter().zip(&sample.robots) {
                assert_eq!(bits(back), bits(robot));
            }
        }
    }

    #[test]
    fn every_bit_of_every_record_survives() {
        survives::<wire::StateHeader, wire::RobotState, proto::State>(|_, _| {});
        survives::<wire::CommandHeader, wire::RobotCommand, proto::Command>(|_, _| {});
        survives::<wire::TelemetryHeader, wire::RobotTelemetry, proto::Telemetry>(|_, r| r.reserved = 0);
        survives::<wire::CheckpointHeader, wire::RobotCheckpoint, proto::Checkpoint>(|_, _| {});
    }

    #[test]
    fn the_sign_of_a_zero_survives() {
        let robot = wire::RobotCommand { v_mps: -0.0, omega_radps: 0.0, ..Default::default() };
        let sample = Command { header: wire::CommandHeader::default(), robots: vec![robot] };
        let bytes = proto::Command::from(&sample).encode_to_vec();
        let back = Command::from(&proto::Command::decode(bytes.as_slice()).unwrap());
        assert_eq!(back.robots[0].v_mps.to_bits(), (-0.0f64).to_bits());
        assert_eq!(back.robots[0].omega_radps.to_bits(), 0);
    }
}
