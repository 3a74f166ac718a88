//! Any value in any field of a record from shared memory, and what is promised for it: refused and counted,
//! wrapped, bounded, or without effect. Fields that the daemon only writes have no promise to keep.

mod admin;
mod command;
mod observation;
mod state;

use std::f64::consts::PI;

use clearway::actuation::{Gate, Refusal};
use clearway::admission::{Admission, Rejection};
use clearway::config::{Config, SourceConfig};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation::initial_fleet;
use clearway::geometry::wrap;
use clearway::model::{Command, Limits, RobotId};
use clearway::runtime::Rehearsal;
use clearway::scenario::Scenario;
use clearway::wire::{
    AdminCode, AdminKind, AdminRequest, AdminRobot, CommandHeader, Holding, ObservationHeader,
    RobotCheckpoint, RobotCommand, RobotIntent, RobotObservation, RobotState, StopReason, state_flags,
};
use proptest::prelude::*;

/// Any number that eight bytes can be, the odd ones often.
fn number() -> impl Strategy<Value = f64> {
    let odd = [
        f64::NAN,
        -f64::NAN,
        f64::INFINITY,
        f64::NEG_INFINITY,
        f64::MAX,
        f64::MIN,
        f64::MIN_POSITIVE,
        5e-324,
        -5e-324,
        0.0,
        -0.0,
        1e-300,
        1e150,
        1e4,
        -1e4,
        PI,
        -PI,
    ];
    prop_oneof![
        prop::sample::select(odd.to_vec()),
        any::<u64>().prop_map(f64::from_bits),
        -1e5..1e5_f64,
        -9.0..9.0_f64
    ]
}

/// Any eight bytes, those around `at` and the ends often.
fn word(at: u64) -> impl Strategy<Value = u64> {
    let near = (0..6_u64).prop_map(move |n| at.wrapping_sub(3).wrapping_add(n));
    prop_oneof![
        near,
        prop::sample::select(vec![0, 1, u64::MAX / 2, u64::MAX / 2 + 1, u64::MAX]),
        any::<u64>()
    ]
}

/// Any four bytes, small ones often.
fn half() -> impl Strategy<Value = u32> {
    prop_oneof![0..16_u32, Just(u32::MAX), any::<u32>()]
}

const T: u64 = 80_000_000;
const EPOCH: u64 = 77;
const NOW: u64 = 10 * T;
