use std::fmt::Write;

use clearway::attach::Status;
use clearway::journal::StoppedBy;
use clearway::wire::{AdminAnswer, admin_flags};
use serde_json::{Value, json};

/// How the daemon is doing, for a person.
pub(super) fn text(fleet: &str, status: &Status) -> String {
    let f = &status.figures;
    let held = match (status.is_stopped(), status.is_paused()) {
        (true, _) if status.stopped_at_start() == Some(StoppedBy::Restarts) => {
            "STOPPED, restarted too often: `clearway clear`, `resume`"
        }
        (true, _) if status.stopped_at_start() == Some(StoppedBy::Journal) => {
            "STOPPED, journal unreadable: `clearway clear`, `resume`"
        }
        (true, _) => "STOPPED: `clearway clear`, then `clearway resume`",
        (false, true) => "PAUSED: `clearway resume`",
        (false, false) => "running",
    };
    let ms = |ns: u64| ns as f64 * 1e-6;
    let clearance =
        if f.min_clearance_m.is_finite() { format!("{:.4} m", f.min_clearance_m) } else { "–".to_owned() };
    let rows = [
        ("fleet", format!("{fleet}: {held}")),
        ("epoch", f.epoch.to_string()),
        ("tick", format!("{}, period {:.3} ms, up {:.1} s", f.tick, ms(f.period_ns), ms(f.uptime_ns) * 1e-3)),
        (
            "robots",
            format!(
                "{} of {} places, {} arrived, {} stalled, {} unseen",
                f.robots, f.capacity, f.arrived, f.stalled, f.unseen
            ),
        ),
        ("clearance", clearance),
        ("periods", format!("{}, {} skipped, {} missed", f.periods, f.skipped_periods, f.deadline_misses)),
        ("fallbacks", format!("{} stops in place of commands", f.fallback_commands)),
        ("inputs", format!("{} observations refused", f.rejected_inputs)),
        ("workers", workers(f)),
        (
            "latency",
            format!(
                "release at most {:.3} ms late, solve p99 {} ns",
                ms(f.release_lateness_max_ns),
                f.solve_p99_ns
            ),
        ),
        (
            "attached",
            format!(
                "{} state, {} command, {} telemetry, {} observing, {} admin",
                f.state_readers,
                f.command_readers,
                f.telemetry_readers,
                f.observation_writers,
                f.admin_clients
            ),
        ),
        (
            "requests",
            format!("{} done, {} refused, {} busy", f.requests_done, f.requests_refused, f.requests_busy),
        ),
        ("journal", journal(status)),
        ("real time", if f.has(admin_flags::DEGRADED) { "DEGRADED" } else { "as configured" }.to_owned()),
    ];
    let mut text = String::new();
    for (name, value) in rows {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "{name:10} {value}");
    }
    for line in status.degraded.iter().flat_map(|line| textwrap::wrap(line, 67)) {
        let _ = writeln!(text, "{:10} {line}", "");
    }
    text
}

fn workers(f: &AdminAnswer) -> String {
    let resting = if f.has(admin_flags::WORKER_RESTING) { ", one RESTS after repeated panics" } else { "" };
    format!("{}, {} silent, {} panics{resting}", f.workers, f.workers_silent, f.worker_panics)
}

/// What is kept over a restart.
fn journal(status: &Status) -> String {
    let f = &status.figures;
    if !f.has(admin_flags::JOURNAL) {
        return "none: a restart begins with the scenario's goals".to_owned();
    }
    let written = if f.has(admin_flags::JOURNAL_FAILING) { "CANNOT BE WRITTEN" } else { "written" };
    format!("{written}, {} restarts after a crash lately", f.restarts)
}

/// How the daemon is doing, for a script.
pub(super) fn json(fleet: &str, status: &Status) -> String {
    format!("{:#}\n", value(fleet, status))
}

/// The same as a value.
pub(crate) fn value(fleet: &str, status: &Status) -> Value {
    let f = &status.figures;
    json!({
        "fleet": fleet,
        "epoch": f.epoch,
        "tick": f.tick,
        "period_ns": f.period_ns,
        "uptime_ns": f.uptime_ns,
        "paused": status.is_paused(),
        "stopped": status.is_stopped(),
        "ends_on_arrival": f.has(admin_flags::ENDS_ON_ARRIVAL),
        "observed": f.has(admin_flags::OBSERVED),
        "capacity": f.capacity,
        "robots": f.robots,
        "arrived": f.arrived,
        "stalled": f.stalled,
        "unseen": f.unseen,
        "min_clearance_m": f.min_clearance_m.is_finite().then_some(f.min_clearance_m),
        "periods": f.periods,
        "skipped_periods": f.skipped_periods,
        "deadline_misses": f.deadline_misses,
        "fallback_commands": f.fallback_commands,
        "rejected_inputs": f.rejected_inputs,
        "lost_records": f.lost_records,
        "workers": f.workers,
        "workers_silent": f.workers_silent,
        "worker_panics": f.worker_panics,
        "release_lateness_max_ns": f.release_lateness_max_ns,
        "solve_p99_ns": f.solve_p99_ns,
        "stopped_by": status.is_stopped().then(|| status.stopped_at_start().unwrap_or(StoppedBy::Operator).name()),
        "journal": {
            "kept": f.has(admin_flags::JOURNAL),
            "failing": f.has(admin_flags::JOURNAL_FAILING),
            "restarts": f.restarts,
        },
        "worker_resting": f.has(admin_flags::WORKER_RESTING),
        "realtime": {
            "memory_locked": f.has(admin_flags::MEMORY_LOCKED),
            "degraded": status.degraded,
        },
        "attached": {
            "state_readers": f.state_readers,
            "command_readers": f.command_readers,
            "telemetry_readers": f.telemetry_readers,
            "observation_writers": f.observation_writers,
            "admin_clients": f.admin_clients,
        },
        "requests": { "done": f.requests_done, "refused": f.requests_refused, "busy": f.requests_busy },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eighty_columns_hold_every_line() {
        let figures = AdminAnswer {
            epoch: u64::MAX,
            tick: 1_234_567_890,
            period_ns: 80_000_000,
            uptime_ns: 98_765_432_100_000,
            capacity: 4096,
            robots: 4096,
            arrived: 4000,
            stalled: 100,
            unseen: 100,
            release_lateness_max_ns: 1_234_567_890,
            solve_p99_ns: 123_456,
            flags: admin_flags::STOPPED | admin_flags::DEGRADED,
            requests_done: 1_234_567,
            requests_busy: 1_234_567,
            ..AdminAnswer::default()
        };
        let status = Status { figures, degraded: vec!["a reason that is long ".repeat(8)] };
        let text = text("a-fleet", &status);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert!(text.contains("STOPPED") && text.contains("DEGRADED"));
        let json: serde_json::Value = serde_json::from_str(&json("a-fleet", &status)).unwrap();
        assert_eq!((json["stopped"].as_bool(), json["capacity"].as_u64()), (Some(true), Some(4096)));
    }
}
