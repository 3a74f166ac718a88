use std::io::IsTerminal;
use std::time::{Duration, Instant};

use clearway::robots::Report;
use indicatif::{ProgressBar, ProgressStyle};

/// Time between two lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(1);
/// Time between two looks of the live line.
const LOOK_EVERY: Duration = Duration::from_millis(100);

/// Says what goes on: a live line on a terminal, otherwise a line a second; all on stderr.
pub(crate) struct Display {
    bar: Option<ProgressBar>,
    shown: bool,
    due: Instant,
}

impl Display {
    pub(crate) fn new(quiet: bool) -> Self {
        let bar = (!quiet && std::io::stderr().is_terminal()).then(|| {
            let bar = ProgressBar::new_spinner();
            // The template is a constant; if it did not parse, the default style would do.
            if let Ok(style) = ProgressStyle::with_template("{spinner} {wide_msg}") {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, shown: !quiet, due: Instant::now() }
    }

    /// Something that happened once.
    pub(crate) fn say(&self, text: &str) {
        if let Some(bar) = &self.bar {
            bar.suspend(|| eprintln!("{text}"));
        } else if self.shown {
            eprintln!("{text}");
        }
    }

    /// Whether it is time for [`Display::update`].
    pub(crate) fn is_due(&self) -> bool {
        self.shown && Instant::now() >= self.due
    }

    /// How it is going.
    pub(crate) fn update(&mut self, text: String) {
        if let Some(bar) = &self.bar {
            self.due = Instant::now() + LOOK_EVERY;
            bar.set_message(text);
            bar.tick();
        } else {
            self.due = Instant::now() + LINE_EVERY;
            eprintln!("{text}");
        }
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish_and_clear();
        }
    }
}

/// One line of at most 80 columns.
pub(crate) fn line(report: &Report, commanded: usize) -> String {
    format!(
        "arrived {}/{}  commanded {commanded}  expired {}  refused {}  clear ≥ {}",
        report.arrived,
        report.robots.len(),
        report.commands.expired,
        report.commands.refused,
        metres(report.min_clearance_m),
    )
}

fn metres(value: Option<f64>) -> String {
    value.map_or("–".to_owned(), |m| format!("{m:.4} m"))
}

/// The summary for people.
pub(crate) fn table(report: &Report) -> String {
    let commands = &report.commands;
    let rows = [
        ("scenario", report.scenario.clone()),
        ("robots here", report.robots.len().to_string()),
        ("arrived", format!("{} of {}", report.arrived, report.robots.len())),
        ("clearance violations", report.violations.to_string()),
        ("minimum clearance", format!("{} (true, over continuous time)", metres(report.min_clearance_m))),
        ("commands accepted", commands.accepted.to_string()),
        ("commands expired", commands.expired.to_string()),
        ("commands missed", commands.missed.to_string()),
        ("commands refused", commands.refused.to_string()),
        ("samples of them corrupted", commands.corrupt.to_string()),
        ("stops for want of one", commands.ran_out.to_string()),
        ("observations", format!("{} sent, {} lost", report.observations_sent, report.observations_lost)),
        ("runs of the daemon", report.epochs.to_string()),
    ];
    let width = rows.iter().map(|(name, _)| name.len()).max().unwrap_or(0);
    let lines = rows.iter().map(|(name, value)| format!("  {name:width$}  {value}\n"));
    format!("\n{}", lines.collect::<String>())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clearway::robots::{Commands, RobotReport};

    #[test]
    fn eighty_columns_hold_every_line() {
        let robot = RobotReport { id: 0, arrived: false, x_m: 0.0, y_m: 0.0, theta_rad: 0.0 };
        let most = 99_999;
        let report = Report {
            scenario: "swap8".into(),
            robots: vec![robot; 999],
            arrived: 999,
            violations: 12,
            min_clearance_m: Some(-0.1234),
            commands: Commands {
                accepted: most,
                expired: most,
                missed: most,
                refused: most,
                corrupt: most,
                ran_out: most,
            },
            observations_sent: most * 100,
            observations_lost: most * 100,
            epochs: 100,
        };
        let text = line(&report, 999) + "\n" + &table(&report);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
        assert!(text.contains("expired 99999") && text.contains("-0.1234 m"), "{text}");
    }
}
