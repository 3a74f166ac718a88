use std::fmt::Write;

use clearway::figures::LatencyNs;
use clearway::report::Report;

/// The report as a table for people.
pub(crate) fn table(report: &Report) -> String {
    let control = &report.control;
    let mut rows: Vec<(&str, String)> = vec![
        ("scenario", format!("{} ({} law, {} solver)", report.scenario, report.profile, report.solver)),
        ("arrived", format!("{} of {}", control.arrived, control.robots)),
        ("clearance violations", control.violations.to_string()),
        ("minimum clearance", metres(control.min_clearance_m)),
        ("last arrival", seconds(control.makespan_s)),
        ("mean arrival", seconds(control.mean_arrival_s)),
        ("arrival / straight line", ratio(control.arrival_ratio)),
        ("path / straight line", ratio(control.path_ratio)),
        ("ended by", report.ended_by.to_owned()),
        (
            "periods",
            format!("{} of {}, {} skipped", report.ticks, time(report.period_ns), report.skipped_periods),
        ),
        ("deadline misses", report.deadline_misses.to_string()),
        ("fallback commands", stops(report)),
    ];
    let times = [
        ("release lateness", &report.release_lateness_ns),
        ("solve", &report.solve_ns),
        ("state → all staged", &report.state_to_staged_ns),
        ("state → command", &report.state_to_command_ns),
    ];
    rows.extend(times.map(|(name, quantiles)| (name, distribution(quantiles))));
    let realtime = &report.realtime;
    rows.push((
        "real time",
        format!(
            "policy {}, priority {}, {} worker{}, memory {}",
            realtime.policy,
            realtime.priority,
            report.workers,
            if report.workers == 1 { "" } else { "s" },
            if realtime.memory_locked { "locked" } else { "not locked" },
        ),
    ));
    if let Some(audit) = report.audit.filter(|audit| audit.audited > 0) {
        rows.push((
            "shadow audit",
            format!("{} re-solved, largest gap {:.1e}", audit.audited, audit.max_input_gap),
        ));
    }
    let trouble = [
        (report.rejected_inputs.total(), "observations refused"),
        (report.audit.map_or(0, |a| a.disagreed + a.not_solved), "audit disagreements"),
        (report.lost_records, "records lost"),
        (report.send_failures, "sends that failed"),
        (report.attach_failures, "connections that failed"),
        (report.worker_panics, "worker panics"),
        (report.admin_panics, "panics answering operators"),
        (report.corrupt_states, "states that changed in memory"),
        (report.workers_hung as u64, "workers hung"),
    ];
    rows.extend(trouble.into_iter().filter(|(n, _)| *n > 0).map(|(n, name)| (name, n.to_string())));
    rows.extend(realtime.degraded.iter().map(|refused| ("DEGRADED", refused.clone())));

    let width = rows.iter().map(|(name, _)| name.chars().count()).max().unwrap_or(0);
    let mut text = String::from("\n");
    for (name, value) in rows {
        // Writing to a string cannot fail.
        let _ = writeln!(text, "  {name:width$}  {value}");
    }
    text
}

fn stops(report: &Report) -> String {
    let ordinary = ["start", "operator", "finished"];
    let reasons: Vec<String> = report
        .stops
        .iter()
        .filter(|(reason, _)| !ordinary.contains(reason))
        .map(|(reason, count)| format!("{reason} {count}"))
        .collect();
    if reasons.is_empty() {
        report.fallback_commands.to_string()
    } else {
        format!("{} ({})", report.fallback_commands, reasons.join(", "))
    }
}

/// What fits into 80 columns; the JSON report has more.
fn distribution(ns: &LatencyNs) -> String {
    format!("p50 {}, p99 {}, max {}", time(ns.p50), time(ns.p99), time(ns.max))
}

fn ratio(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |x| format!("{x:.3}"))
}

fn seconds(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |s| format!("{s:.2} s"))
}

/// A distance; a dash where there is none.
pub(crate) fn metres(value: Option<f64>) -> String {
    value.filter(|m| m.is_finite()).map_or("–".to_owned(), |m| format!("{m:.4} m"))
}

/// A time in the unit that suits it.
pub(crate) fn time(ns: u64) -> String {
    let x = ns as f64;
    match ns {
        0..1_000 => format!("{ns} ns"),
        1_000..1_000_000 => format!("{:.1} µs", x * 1e-3),
        1_000_000..1_000_000_000 => format!("{:.2} ms", x * 1e-6),
        _ => format!("{:.2} s", x * 1e-9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_suit_the_size() {
        assert_eq!(
            [time(0), time(999), time(1_500), time(80_000_000)],
            ["0 ns", "999 ns", "1.5 µs", "80.00 ms"]
        );
        assert_eq!((metres(Some(f64::INFINITY)), metres(Some(0.25))), ("–".into(), "0.2500 m".into()));
    }
}
