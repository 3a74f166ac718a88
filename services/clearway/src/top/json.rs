//! The same figures for a script.

use clearway::figures::LatencyNs;
use clearway::wire::state_flags;
use serde_json::{Map, Value, json};

use super::model::{Model, Run};
use super::robot::{Filter, Robot, Sort, listed};

/// Everything at `now_ns`, after a collection of `window_s`.
pub(crate) fn object(model: &Model, now_ns: u64, window_s: f64) -> Value {
    let run = model.run.as_ref();
    let status = model.status.as_ref();
    json!({
        "fleet": model.fleet,
        "window_s": window_s,
        "live": model.is_live(now_ns),
        "age_ns": run.map(|_| model.age_ns(now_ns)),
        "epoch": run.map(|run| run.epoch),
        "tick": run.map(|run| run.tick),
        "period_ns": run.map(|run| run.period_ns),
        "hold": model.hold().map(str::to_lowercase),
        "scenario": model.law.as_ref().map(|law| &law.scenario),
        "profile": model.law.as_ref().map(|law| &law.profile),
        "solver": model.law.as_ref().map(|law| &law.solver),
        "realtime_policy": model.law.as_ref().map(|law| &law.policy),
        "alerts": model.alerts(now_ns),
        "min_clearance_m": model.clearance_m(),
        "window": run.map(window),
        "robots": run.map(|run| robots(&run.robots)),
        "attached": model.ports.map(|ports| json!({
            "state_readers": ports.state_readers,
            "command_readers": ports.command_readers,
            "telemetry_readers": ports.telemetry_readers,
            "observation_writers": ports.observation_writers,
            "admin_clients": ports.admin_clients,
        })),
        "members": model.members.iter().map(|member| json!({
            "process": member.process,
            "executable": member.executable,
            "role": member.role,
        })).collect::<Vec<_>>(),
        // What `clearway status --json` prints; null when the daemon did not answer.
        "daemon": status.map(|status| crate::operate::status_value(&model.fleet, status)),
    })
}

/// What was counted and measured while this monitor watched.
fn window(run: &Run) -> Value {
    let counters = &run.counters;
    let times =
        run.times.each().map(|(what, track)| (what.key().to_owned(), latency(&track.all().summary())));
    let mut value = json!({
        "states": run.states.samples,
        "commands": run.commands.samples,
        "telemetry": run.telemetry.samples,
        "overwritten": run.overwritten(),
        "dropped": counters.dropped,
        "late_periods": counters.late,
        "skipped_periods": counters.skipped,
        "fallback_commands": counters.fallbacks,
        "lost_records": counters.lost_records,
        "audited": counters.audited,
        "audit_disagreed": counters.audit_disagreed,
    });
    if let Value::Object(keys) = &mut value {
        keys.extend(times.collect::<Map<_, _>>());
    }
    value
}

fn latency(summary: &LatencyNs) -> Value {
    json!(summary)
}

fn robots(robots: &[Robot]) -> Vec<Value> {
    listed(robots, Sort::Id, Filter::All).into_iter().map(robot).collect()
}

fn robot(robot: &Robot) -> Value {
    let state = &robot.state;
    let finite = |value: f64| value.is_finite().then_some(value);
    let mut value = json!({
        "id": state.id,
        "status": robot.status(),
        "stop_reason": robot.stop_reason(),
        "valid": robot.is_seen(),
        "arrived": robot.has_arrived(),
        "foreign": state.has(state_flags::FOREIGN),
        "stalled": robot.is_stalled(),
        "x_m": state.x_m,
        "y_m": state.y_m,
        "theta_rad": state.theta_rad,
        "v_mps": state.v_mps,
        "omega_radps": state.omega_radps,
        "goal_x_m": state.goal_x_m,
        "goal_y_m": state.goal_y_m,
        "to_goal_m": robot.goal_away_m(),
        "radius_m": state.radius_m,
    });
    if let (Value::Object(keys), Some(t)) = (&mut value, robot.telemetry) {
        let more = json!({
            "solve_status": robot.solve_status(),
            "solve_ns": t.solve_ns,
            "step_ns": t.step_ns,
            "lyapunov_position_m2": t.lyapunov_position_m2,
            "slack_position_m2": t.slack_position_m2,
            "lyapunov_heading": t.lyapunov_heading,
            "slack_heading": t.slack_heading,
            "slack_comfort_m": t.slack_comfort_m,
            "clearance_m": finite(t.clearance_m),
            "safety_rows": t.safety_rows,
            "active_rows": t.active_rows,
            "kkt_residual": finite(t.kkt_residual),
        });
        if let Value::Object(more) = more {
            keys.extend(more);
        }
    }
    value
}

/// The screen as text, without the blanks at the ends of its lines.
pub(crate) fn plain(lines: impl Iterator<Item = String>) -> String {
    let mut text = lines.map(|line| line.trim_end().to_owned()).collect::<Vec<_>>().join("\n");
    let end = text.trim_end().len();
    text.truncate(end);
    text.push('\n');
    text
}
