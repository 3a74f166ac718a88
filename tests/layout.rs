//! `services/clearway-py/tests/layout.json` is the wire as the compiler laid it out: the Python package
//! compares its own declarations with it.
//!
//! After an addition to the wire write it anew with `CLEARWAY_WRITE_LAYOUT=1 cargo test --test layout`.

use std::any::type_name;
use std::fmt::Write;
use std::mem::{align_of, offset_of, size_of};
use std::path::Path;

use clearway::wire::{
    AdminAnswer, AdminCode, AdminKind, AdminRequest, AdminRobot, CheckpointHeader, CommandHeader, Holding,
    NO_ROBOT, ObservationHeader, RobotCheckpoint, RobotCommand, RobotIntent, RobotObservation, RobotState,
    RobotTelemetry, SolveStatus, StateHeader, StopReason, TelemetryHeader, admin_flags, checkpoint_flags,
    state_flags, telemetry_flags,
};
use iceoryx2::prelude::ZeroCopySend;

/// The last part of a type's path.
fn short<T>(_: &T) -> &'static str {
    let name = type_name::<T>();
    name.rsplit("::").next().unwrap_or(name)
}

/// A record, one line a field. All fields have to be named, or this does not compile.
macro_rules! record {
    ($text:ident, $record:ident { $($field:ident),+ $(,)? }) => {{
        let $record { $($field),+ } = $record::default();
        // SAFETY: the name is only written down; equal layouts across languages are what this is for.
        let name = unsafe { <$record as ZeroCopySend>::type_name() };
        let (size, align) = (size_of::<$record>(), align_of::<$record>());
        let fields = [$(format!(
            "      [\"{}\", {}, {}, \"{}\"]",
            stringify!($field), offset_of!($record, $field), size_of_val(&$field), short(&$field)
        )),+];
        let fields = fields.join(",\n");
        write!($text, "    \"{name}\": {{\"size\": {size}, \"align\": {align}, \"fields\": [\n{fields}\n    ]}}")
            .unwrap();
    }};
}

/// The constants of a module of flags.
macro_rules! flags {
    ($module:ident { $($name:ident),+ $(,)? }) => {
        (stringify!($module), vec![$((stringify!($name).to_lowercase(), $module::$name)),+])
    };
}

fn records() -> String {
    format!("{},\n{}", published(), received())
}

/// What the daemon publishes for everybody.
#[expect(clippy::too_many_lines, reason = "a line for each field")]
fn published() -> String {
    let mut text = String::new();
    record!(text, StateHeader { epoch, tick, stamp_ns, release_ns, period_ns, records, checksum });
    text += ",\n";
    record!(
        text,
        RobotState {
            id,
            flags,
            x_m,
            y_m,
            theta_rad,
            v_mps,
            omega_radps,
            goal_x_m,
            goal_y_m,
            radius_m,
            uncertainty_m,
            seen_x_m,
            seen_y_m,
            way_m,
            intent,
        }
    );
    text += ",\n";
    record!(
        text,
        RobotIntent {
            heading_rad,
            speed_mps,
            blocked_s,
            target_x_m,
            target_y_m,
            waypoint_x_m,
            waypoint_y_m,
            rank,
            valid,
        }
    );
    text += ",\n";
    record!(
        text,
        CommandHeader {
            epoch,
            tick,
            stamp_ns,
            state_stamp_ns,
            valid_from_ns,
            valid_until_ns,
            follows,
            records,
            checksum
        }
    );
    text += ",\n";
    record!(text, RobotCommand { id, stop_reason, v_mps, omega_radps });
    text += ",\n";
    record!(
        text,
        TelemetryHeader {
            epoch,
            tick,
            release_ns,
            release_lateness_ns,
            state_publish_ns,
            state_to_staged_ns,
            state_to_command_ns,
            deadline_lateness_ns,
            skipped_periods,
            fallback_commands,
            lost_records,
            audited,
            audit_disagreed,
            audit_max_input_gap,
            records,
            checksum,
        }
    );
    text += ",\n";
    record!(
        text,
        RobotTelemetry {
            id,
            stop_reason,
            status,
            safety_rows,
            active_rows,
            settling_steps,
            flags,
            reserved,
            solve_ns,
            step_ns,
            v_mps,
            omega_radps,
            lyapunov_position_m2,
            decrease_position_m2,
            slack_position_m2,
            lyapunov_heading,
            decrease_heading,
            slack_heading,
            slack_comfort_m,
            reference_rotation_rad,
            speed_cap_mps,
            clearance_m,
            kkt_residual,
        }
    );
    text
}

/// What it receives and answers, and what it keeps.
fn received() -> String {
    let mut text = String::new();
    record!(text, ObservationHeader { epoch, sequence, stamp_ns, records, checksum });
    text += ",\n";
    record!(text, RobotObservation { id, holding, x_m, y_m, theta_rad });
    text += ",\n";
    record!(text, CheckpointHeader { epoch, tick, skipped_periods, commands_published, records, checksum });
    text += ",\n";
    record!(text, RobotCheckpoint { id, flags, words });
    text += ",\n";
    record!(text, AdminRequest { ticket, expires_ns, epoch, offset, kind, reserved });
    text += ",\n";
    record!(
        text,
        AdminRobot { id, reserved, goal_x_m, goal_y_m, start_x_m, start_y_m, start_theta_rad, radius_m }
    );
    text += ",\n";
    record!(
        text,
        AdminAnswer {
            ticket,
            epoch,
            stamp_ns,
            acts_from_tick,
            code,
            kind,
            robot,
            flags,
            text_bytes,
            tick,
            period_ns,
            uptime_ns,
            periods,
            deadline_misses,
            skipped_periods,
            fallback_commands,
            rejected_inputs,
            lost_records,
            worker_panics,
            release_lateness_max_ns,
            solve_p99_ns,
            min_clearance_m,
            requests_done,
            requests_refused,
            requests_busy,
            capacity,
            robots,
            arrived,
            stalled,
            unseen,
            workers,
            workers_silent,
            degraded,
            state_readers,
            command_readers,
            telemetry_readers,
            observation_writers,
            admin_clients,
            restarts,
        }
    );
    text
}

type Numbers = (&'static str, Vec<(String, u32)>);

fn flags() -> Vec<Numbers> {
    vec![
        flags!(state_flags { VALID, ARRIVED, FOREIGN, VACANT, PAUSED, STOPPED, MAY_STAND, OUT_OF_STEP }),
        flags!(telemetry_flags { STALLED, GIVING_WAY, HOLDING }),
        flags!(checkpoint_flags { ANSWERED, SETTLED }),
        flags!(admin_flags {
            PAUSED,
            STOPPED,
            DEGRADED,
            MEMORY_LOCKED,
            OBSERVED,
            ENDS_ON_ARRIVAL,
            JOURNAL,
            JOURNAL_FAILING,
            STOPPED_BY_RESTARTS,
            STOPPED_BY_JOURNAL,
            WORKER_RESTING
        }),
    ]
}

fn codes() -> Vec<Numbers> {
    let stops = StopReason::ALL.iter().map(|one| (one.name().to_owned(), *one as u32));
    let kinds = AdminKind::ALL.iter().map(|one| (one.name().to_owned(), *one as u32));
    let answers = AdminCode::ALL.iter().map(|one| (one.name().to_owned(), *one as u32));
    let solved = [SolveStatus::NotSolved, SolveStatus::Verified, SolveStatus::Refused, SolveStatus::Failed];
    // Does not compile when there is another one.
    let name = |status: &SolveStatus| match status {
        SolveStatus::NotSolved => "not_solved",
        SolveStatus::Verified => "verified",
        SolveStatus::Refused => "refused",
        SolveStatus::Failed => "failed",
    };
    let holding = [("untold", Holding::Untold.code()), ("nothing", Holding::Nothing.code())];
    vec![
        ("StopReason", stops.collect()),
        ("Holding", holding.map(|(name, code)| (name.to_owned(), code)).to_vec()),
        ("SolveStatus", solved.iter().map(|one| (name(one).to_owned(), *one as u32)).collect()),
        ("AdminKind", kinds.collect()),
        ("AdminCode", answers.collect()),
    ]
}

/// Names and numbers, one line a group.
fn numbers(groups: &[Numbers]) -> String {
    let line = |(name, members): &Numbers| {
        let members: Vec<_> = members.iter().map(|(name, number)| format!("\"{name}\": {number}")).collect();
        format!("    \"{name}\": {{{}}}", members.join(", "))
    };
    groups.iter().map(line).collect::<Vec<_>>().join(",\n")
}

#[test]
fn the_committed_layout_is_the_compilers() {
    let expected = format!(
        "{{\n  \"records\": {{\n{}\n  }},\n  \"flags\": {{\n{}\n  }},\n  \"codes\": {{\n{}\n  }},\n  \
         \"no_robot\": {NO_ROBOT}\n}}\n",
        records(),
        numbers(&flags()),
        numbers(&codes())
    );
    serde_json::from_str::<serde_json::Value>(&expected).unwrap();
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("services/clearway-py/tests/layout.json");
    if std::env::var_os("CLEARWAY_WRITE_LAYOUT").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let committed = std::fs::read_to_string(&path).unwrap();
    assert_eq!(committed, expected, "the wire has changed: bring the Python package along (see above)");
}

#[test]
fn no_record_and_no_flag_is_left_out() {
    let wire = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/wire");
    let (records, mut flag_lines) = (records(), 0);
    for file in std::fs::read_dir(wire).unwrap() {
        let source = std::fs::read_to_string(file.unwrap().path()).unwrap();
        for name in source.split("#[type_name(\"").skip(1).filter_map(|rest| rest.split('"').next()) {
            assert!(records.contains(&format!("\"{name}\": ")), "{name}");
        }
        for module in source.split("_flags {").skip(1).filter_map(|rest| rest.split("\n}").next()) {
            flag_lines += module.matches("pub const ").count();
        }
    }
    assert_eq!(flags().iter().map(|(_, members)| members.len()).sum::<usize>(), flag_lines);
}
