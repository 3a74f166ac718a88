//! What a recording shows: events as lines, and where it stands on the last line of a terminal.

use clearway_record::{Notice, Recorded, Status};
use indicatif::{ProgressBar, ProgressStyle};
use std::fmt::Write;
use std::io::IsTerminal;
use std::path::Path;
use std::time::Duration;

pub(crate) struct Display {
    bar: Option<ProgressBar>,
}

fn mib(bytes: u64) -> f64 {
    bytes as f64 / f64::from(1 << 20)
}

impl Display {
    pub(crate) fn new(out: &Path) -> Self {
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::new_spinner();
            if let Ok(style) = ProgressStyle::with_template("{spinner} {msg}") {
                bar.set_style(style);
            }
            bar.enable_steady_tick(Duration::from_millis(200));
            bar
        });
        let mut display = Self { bar };
        display.line(&format!("recording to {}, waiting for the daemon", out.display()));
        display
    }

    fn line(&mut self, text: &str) {
        match &self.bar {
            Some(bar) => bar.println(text),
            None => eprintln!("{text}"),
        }
    }

    pub(crate) fn notice(&mut self, notice: &Notice) {
        let text = match notice {
            Notice::Attached { epoch } => format!("attached to epoch {epoch}"),
            Notice::RunOver { epoch } => format!("epoch {epoch} is over"),
            Notice::Rotated { path } => format!("went on with {}", path.display()),
            Notice::Deleted { path } => format!("deleted {}", path.display()),
            Notice::DiskFull { path, reason, whole } => {
                let end = if *whole { "was ended in order" } else { "ends with its last whole chunk" };
                format!(
                    "NOT RECORDING: {reason}\n  {} {end}; trying again every second, and counting",
                    path.display()
                )
            }
            Notice::Resumed { path, unrecorded } => {
                format!("recording again, to {}; {unrecorded} messages were not recorded", path.display())
            }
        };
        self.line(&text);
    }

    pub(crate) fn update(&mut self, status: &Status) {
        let Some(bar) = &self.bar else { return };
        let tick = status
            .runs
            .last()
            .and_then(|run| run.channels.iter().find(|c| c.channel == Recorded::State)?.ticks)
            .map_or_else(|| "no tick yet".to_owned(), |(_, last)| format!("tick {last}"));
        let state = if status.recording { "" } else { "NOT RECORDING  " };
        let lost = status.missed() + status.dropped + status.unrecorded;
        bar.set_message(format!("{state}{tick}  {:.1} MiB  lost {lost}", mib(status.bytes)));
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// What was recorded, in a few lines.
pub(crate) fn summary(status: &Status) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    for run in &status.runs {
        let end = if run.over { "to its end" } else { "still running" };
        let _ = writeln!(out, "epoch {}, {end}, {} periods skipped", run.epoch, run.skipped_periods);
        for c in &run.channels {
            let ticks = c.ticks.map_or_else(|| "none".to_owned(), |(a, b)| format!("ticks {a} to {b}"));
            let _ = writeln!(
                out,
                "  {:<11}{:>9} samples  {:>7} missed  {ticks}",
                c.channel.name(),
                c.received,
                c.missed
            );
        }
    }
    if status.earlier_runs > 0 {
        let _ =
            writeln!(out, "{} earlier runs, {} samples missed", status.earlier_runs, status.earlier_missed);
    }
    let _ =
        writeln!(out, "{} too fast for the disk, {} without room on it", status.dropped, status.unrecorded);
    if status.corrupt > 0 {
        let _ = writeln!(out, "{} left out: they had changed in memory on their way", status.corrupt);
    }
    for path in &status.files {
        let _ = writeln!(out, "{}", path.display());
    }
    let _ = writeln!(out, "{:.2} MiB in {} file(s)", mib(status.bytes), status.files.len());
    out
}
