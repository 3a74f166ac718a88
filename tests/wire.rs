//! The layout of `v1`: what readers in other languages rely on, and what can therefore never change.

use std::mem::{align_of, offset_of, size_of};

use clearway::wire::{
    AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, CheckpointHeader, CommandHeader,
    ObservationHeader, RobotCheckpoint, RobotCommand, RobotIntent, RobotObservation, RobotState,
    RobotTelemetry, StateHeader, StopReason, TelemetryHeader,
};
use iceoryx2::prelude::ZeroCopySend;

/// Name, size and alignment on the wire, and the sum of the fields' sizes: without implicit padding
/// the size is that sum.
fn layout<T: ZeroCopySend>(fields: &[usize]) -> (&'static str, usize, usize) {
    assert_eq!(fields.iter().sum::<usize>(), size_of::<T>(), "padding in {}", name::<T>());
    (name::<T>(), size_of::<T>(), align_of::<T>())
}

fn name<T: ZeroCopySend>() -> &'static str {
    // SAFETY: the name is only compared; equal layouts across languages are what this file is for.
    unsafe { <T as ZeroCopySend>::type_name() }
}

#[test]
fn names_sizes_and_alignments() {
    let words = |n: usize| vec![8; n];
    // Number of records and checksum stand at the end.
    let sealed = |n: usize| [words(n), vec![4, 4]].concat();
    let ids_then = |n: usize| [vec![4, 4], words(n)].concat();
    assert_eq!(layout::<StateHeader>(&sealed(5)), ("clearway.v1.StateHeader", 48, 8));
    assert_eq!(layout::<RobotIntent>(&[words(7), vec![4, 4]].concat()), ("clearway.v1.RobotIntent", 64, 8));
    assert_eq!(
        layout::<RobotState>(&[ids_then(12), vec![size_of::<RobotIntent>()]].concat()),
        ("clearway.v1.RobotState", 168, 8)
    );
    assert_eq!(layout::<CommandHeader>(&sealed(7)), ("clearway.v1.CommandHeader", 64, 8));
    assert_eq!(layout::<RobotCommand>(&ids_then(2)), ("clearway.v1.RobotCommand", 24, 8));
    assert_eq!(layout::<ObservationHeader>(&sealed(3)), ("clearway.v1.ObservationHeader", 32, 8));
    assert_eq!(layout::<RobotObservation>(&ids_then(3)), ("clearway.v1.RobotObservation", 32, 8));
    assert_eq!(layout::<TelemetryHeader>(&sealed(14)), ("clearway.v1.TelemetryHeader", 120, 8));
    assert_eq!(
        layout::<RobotTelemetry>(&[vec![4; 8], words(15)].concat()),
        ("clearway.v1.RobotTelemetry", 152, 8)
    );
    assert_eq!(layout::<AdminRequest>(&[words(4), vec![4, 4]].concat()), ("clearway.v1.AdminRequest", 40, 8));
    assert_eq!(layout::<AdminRobot>(&ids_then(6)), ("clearway.v1.AdminRobot", 56, 8));
    assert_eq!(
        layout::<AdminAnswer>(&[words(4), vec![4; 4], words(17), vec![4; 14]].concat()),
        ("clearway.v1.AdminAnswer", 240, 8)
    );
    assert_eq!(layout::<CheckpointHeader>(&sealed(4)), ("clearway.v1.CheckpointHeader", 40, 8));
    assert_eq!(layout::<RobotCheckpoint>(&ids_then(32)), ("clearway.v1.RobotCheckpoint", 264, 8));
}

#[test]
fn fields_that_every_reader_needs_stay_where_they_are() {
    assert_eq!(offset_of!(StateHeader, tick), 8);
    assert_eq!((offset_of!(StateHeader, records), offset_of!(StateHeader, checksum)), (40, 44));
    assert_eq!((offset_of!(CommandHeader, records), offset_of!(CommandHeader, checksum)), (56, 60));
    assert_eq!((offset_of!(ObservationHeader, records), offset_of!(ObservationHeader, checksum)), (24, 28));
    assert_eq!((offset_of!(TelemetryHeader, records), offset_of!(TelemetryHeader, checksum)), (112, 116));
    assert_eq!((offset_of!(CheckpointHeader, records), offset_of!(CheckpointHeader, checksum)), (32, 36));
    assert_eq!(offset_of!(RobotState, flags), 4);
    assert_eq!(offset_of!(RobotState, x_m), 8);
    assert_eq!(offset_of!(RobotState, v_mps), 32);
    assert_eq!((offset_of!(RobotState, seen_x_m), offset_of!(RobotState, intent)), (80, 104));
    assert_eq!(offset_of!(CommandHeader, valid_from_ns), 32);
    assert_eq!(offset_of!(CommandHeader, valid_until_ns), 40);
    assert_eq!(offset_of!(CommandHeader, follows), 48);
    assert_eq!(offset_of!(RobotCommand, stop_reason), 4);
    assert_eq!(offset_of!(RobotCommand, v_mps), 8);
    assert_eq!((offset_of!(RobotObservation, holding), offset_of!(RobotObservation, theta_rad)), (4, 24));
    assert_eq!((offset_of!(AdminRequest, expires_ns), offset_of!(AdminRequest, kind)), (8, 32));
    assert_eq!((offset_of!(AdminRobot, goal_x_m), offset_of!(AdminRobot, start_x_m)), (8, 24));
    assert_eq!((offset_of!(AdminAnswer, acts_from_tick), offset_of!(AdminAnswer, code)), (24, 32));
    assert_eq!((offset_of!(AdminAnswer, tick), offset_of!(AdminAnswer, capacity)), (56, 184));
}

#[test]
fn codes_of_stop_reasons_are_fixed() {
    let codes: Vec<(u32, &str)> =
        StopReason::ALL.iter().map(|reason| (*reason as u32, reason.name())).collect();
    let expected = [
        "start",
        "deadline",
        "unverified",
        "solver",
        "crowded",
        "no_state",
        "operator",
        "finished",
        "foreign",
        "paused",
        "stopped",
        "vacant",
        "corrupt",
        "out_of_step",
    ];
    assert_eq!(codes, (1..).zip(expected).collect::<Vec<_>>());
    assert!(StopReason::ALL.iter().all(|reason| StopReason::from_code(*reason as u32) == Some(*reason)));
    assert_eq!((StopReason::from_code(0), StopReason::from_code(15)), (None, None));
}

#[test]
fn codes_of_admin_are_fixed() {
    let kinds: Vec<(u32, &str)> = AdminKind::ALL.iter().map(|kind| (*kind as u32, kind.name())).collect();
    let expected = [
        "status",
        "configuration",
        "set_goals",
        "pause",
        "resume",
        "stop",
        "clear",
        "add_robot",
        "remove_robot",
        "scenario",
    ];
    assert_eq!(kinds, (1..).zip(expected).collect::<Vec<_>>());
    let codes: Vec<(u32, &str)> = AdminCode::ALL.iter().map(|code| (*code as u32, code.name())).collect();
    let expected = [
        "done",
        "busy",
        "expired",
        "malformed",
        "other_epoch",
        "unknown_robot",
        "foreign_robot",
        "repeated_robot",
        "taken_id",
        "not_finite",
        "outside_arena",
        "inside_obstacle",
        "goal_taken",
        "too_close",
        "bad_radius",
        "full",
        "stopped",
        "ending",
        "not_kept",
    ];
    assert_eq!(codes, (0..).zip(expected).collect::<Vec<_>>());
    assert_eq!((AdminKind::from_code(0), AdminCode::from_code(19)), (None, None));
}
