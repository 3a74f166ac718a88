//! The result of a replay, for people and for programs.

use super::Told;
use miette::IntoDiagnostic;
use std::fmt::Write;

pub(super) fn json(told: &Told) -> miette::Result<String> {
    let mut text = serde_json::to_string_pretty(told).into_diagnostic()?;
    text.push('\n');
    Ok(text)
}

/// In at most 80 columns.
pub(super) fn text(told: &Told) -> String {
    let o = &told.outcome;
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{} of {} periods computed again, in {} run(s)",
        o.compared_periods, o.periods, o.epochs
    );
    if o.missing_ticks > 0 {
        let _ = writeln!(
            out,
            "  {} ticks are not in the recording; the daemon skipped {} of them",
            o.missing_ticks, o.skipped_periods
        );
    }
    for (number, what) in [
        (o.too_late, "periods whose commands were too late to go out"),
        (o.without_commands, "periods whose commands are not in the recording"),
        (o.without_memory, "periods with robots whose memory is not in the recording"),
        (o.without_state, "command samples whose state is not in the recording"),
    ] {
        if number > 0 {
            let _ = writeln!(out, "  {number} {what}: not compared");
        }
    }
    for (reason, number) in &o.not_decided {
        let _ = writeln!(out, "  {number} commands decided by no controller ({reason}): not compared");
    }
    for file in &told.files {
        if !file.whole {
            let _ = writeln!(out, "  {} is cut off: read to its last whole chunk", file.file.display());
        }
        if let Some(version) = file.version.as_ref().filter(|v| *v != env!("CARGO_PKG_VERSION")) {
            let _ = writeln!(
                out,
                "  recorded by version {version}, computed by {}: they may differ",
                env!("CARGO_PKG_VERSION")
            );
        }
        let lost: Vec<String> = file
            .counts
            .iter()
            .filter(|(_, count)| *count != "0")
            .map(|(name, count)| format!("{count} {name}"))
            .collect();
        if !lost.is_empty() {
            let _ = writeln!(out, "  the recorder lost samples of this file: {}", lost.join(", "));
        }
    }
    match &o.first_difference {
        Some(d) => {
            let _ = writeln!(out, "DIFFERENT: {} of {} commands", o.different_commands, o.compared_commands);
            let _ = writeln!(out, "  first: tick {}, robot {}, field {}", d.tick, d.robot, d.field);
            let _ = writeln!(out, "  recorded  {}\n  computed  {}", d.recorded, d.solved);
            if o.epochs > 1 {
                let _ = writeln!(out, "  in epoch {}", d.epoch);
            }
        }
        None if o.compared_commands == 0 => out.push_str("NOTHING COMPARED: see above for what is missing\n"),
        None => {
            let _ = writeln!(out, "bit-equal: all {} commands compared", o.compared_commands);
        }
    }
    out
}
