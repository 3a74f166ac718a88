use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
use std::path::Path;
use std::time::{Duration, Instant};

use clearway::config::Config;
use clearway::realtime::Achieved;
use clearway::runtime::Progress;
use indicatif::{ProgressBar, ProgressStyle};
use tracing_subscriber::EnvFilter;
use tracing_subscriber::fmt::MakeWriter;

use crate::arguments::Arguments;
use crate::summary::{metres, time};

/// Time between two lines where there is no terminal.
const LINE_EVERY: Duration = Duration::from_secs(1);

/// Columns that a terminal has at least.
const COLUMNS: usize = 80;

/// Two lines, so that 80 columns hold them.
const LIVE: &str = "{spinner} arrived {pos}/{len} {bar:12}  {prefix}\n  {wide_msg}";

/// Shows how a run goes: a live line on a terminal, otherwise a line a second; all on stderr.
pub(crate) struct Display {
    bar: Option<ProgressBar>,
    lines: bool,
    title: [String; 5],
    line_due: Instant,
}

impl Display {
    pub(crate) fn new(arguments: &Arguments, config: &Config, terminal: bool) -> Self {
        let shown = !arguments.quiet;
        let title = [
            format!("{}: {} robots", config.scenario.name, config.scenario.robots.len()),
            format!("fleet {:?}", config.fleet),
            format!("{} law", config.controller.profile.name()),
            format!("{} solver", config.controller.solver.name()),
            format!("T = {}", time(config.timing.period_ns)),
        ];
        let bar = (shown && terminal).then(|| {
            let bar = ProgressBar::new(config.scenario.robots.len() as u64);
            // The template is a constant; if it did not parse, the default style would do.
            if let Ok(style) = ProgressStyle::with_template(LIVE) {
                bar.set_style(style);
            }
            bar
        });
        Self { bar, lines: shown && !terminal, title, line_due: Instant::now() }
    }

    /// Log lines go to stderr, above the live line.
    pub(crate) fn start_logging(&self, arguments: &Arguments) {
        let level = match (arguments.quiet, arguments.verbose) {
            (true, _) => "error",
            (_, 0) => "warn",
            (_, 1) => "info",
            _ => "debug",
        };
        let filter = EnvFilter::try_from_default_env().unwrap_or_else(|_| EnvFilter::new(level));
        let writer = AboveBar(self.bar.clone());
        let logger = tracing_subscriber::fmt()
            .with_env_filter(filter)
            .with_writer(writer)
            .with_ansi(std::io::stderr().is_terminal())
            .with_target(false);
        // A logger that somebody else installed is as good.
        let _ = logger.try_init();
    }

    pub(crate) fn started(&self, realtime: &Achieved, journal: Option<&Path>) {
        if self.bar.is_none() && !self.lines {
            return;
        }
        let cpus: Vec<String> =
            realtime.cpus.iter().map(|cpu| cpu.map_or("any".to_owned(), |cpu| cpu.to_string())).collect();
        self.say(&wrapped("clearwayd  ", ", ", &self.title));
        let granted = [
            format!("policy {}", realtime.policy),
            format!("priority {}", realtime.priority),
            format!("CPUs {} (loop, workers)", cpus.join(" ")),
            format!("memory {}", if realtime.memory_locked { "locked" } else { "not locked" }),
        ];
        self.say(&wrapped("real time  ", ", ", &granted));
        if let Some(journal) = journal {
            self.say(&format!("journal    {}", journal.display()));
        }
        for refused in &realtime.degraded {
            self.say(&format!("DEGRADED   {refused}"));
        }
    }

    pub(crate) fn update(&mut self, progress: &Progress) {
        if progress.ticks == 0 {
            return;
        }
        if let Some(bar) = &self.bar {
            bar.set_position(progress.arrived as u64);
            bar.set_prefix(clocks(progress));
            bar.set_message(health(progress).join("  "));
            bar.tick();
        } else if self.lines && Instant::now() >= self.line_due {
            self.line_due = Instant::now() + LINE_EVERY;
            self.say(&lines(progress));
        }
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            // Finishing would fill it, whoever arrived.
            bar.abandon();
        }
    }

    fn say(&self, text: &str) {
        match &self.bar {
            Some(bar) => bar.suspend(|| eprintln!("{text}")),
            None => eprintln!("{text}"),
        }
    }
}

fn clocks(p: &Progress) -> String {
    format!("tick {}  t {:.2} s  wall {:.2} s", p.tick, p.time_s, p.wall_s)
}

fn health(p: &Progress) -> Vec<String> {
    let mut parts = vec![
        format!("clearance ≥ {}", metres(Some(p.min_clearance_m))),
        format!("late {} (max {})", time(p.release_lateness_ns), time(p.release_lateness_max_ns)),
        format!("solve p99 {}", time(p.solve_p99_ns)),
        format!("misses {}", p.deadline_misses),
    ];
    let trouble = [
        (p.fallback_commands, "fallbacks"),
        (p.rejected_inputs, "rejected"),
        (p.lost_records, "records lost"),
        (p.worker_panics, "worker panics"),
        (p.admin_panics, "DEGRADED: panics while answering operators"),
        (p.attach_failures, "DEGRADED: connections that failed"),
        (p.workers_silent as u64, "workers silent"),
    ];
    parts.extend(
        trouble.iter().filter(|(count, _)| *count > 0).map(|(count, what)| format!("{what} {count}")),
    );
    parts
}

/// How a run goes, where there is no terminal.
fn lines(p: &Progress) -> String {
    let mut parts = vec![clocks(p)];
    parts.extend(p.stopped.then(|| "STOPPED".to_owned()));
    parts.extend(p.paused.then(|| "PAUSED".to_owned()));
    parts.extend(health(p));
    wrapped(&format!("arrived {}/{}  ", p.arrived, p.robots), "  ", &parts)
}

/// `parts` behind `head`, on as many lines as they need; those after the first are indented.
fn wrapped(head: &str, separator: &str, parts: &[String]) -> String {
    let mut text = head.to_owned();
    let mut column = head.chars().count();
    let indent = column;
    for (index, part) in parts.iter().enumerate() {
        let width = part.chars().count();
        let last = index + 1 == parts.len();
        let after = if last { 0 } else { separator.trim_end().chars().count() };
        if column > indent && column + width + after > COLUMNS {
            text.truncate(text.trim_end().len());
            // Writing to a string cannot fail.
            let _ = write!(text, "\n{:indent$}", "");
            column = indent;
        }
        text.push_str(part);
        column += width;
        if !last {
            text.push_str(separator);
            column += separator.chars().count();
        }
    }
    text
}

/// Writes log lines to stderr without tearing the live line.
#[derive(Clone)]
struct AboveBar(Option<ProgressBar>);

impl Write for AboveBar {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let write = || std::io::stderr().write_all(bytes);
        match &self.0 {
            Some(bar) if !bar.is_finished() => bar.suspend(write)?,
            _ => write()?,
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> std::io::Result<()> {
        std::io::stderr().flush()
    }
}

impl<'a> MakeWriter<'a> for AboveBar {
    type Writer = Self;

    fn make_writer(&'a self) -> Self {
        self.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eighty_columns_hold_every_line() {
        let progress = Progress {
            ticks: 1,
            tick: 1_234_567,
            time_s: 98_765.43,
            wall_s: 98_765.43,
            robots: 1000,
            arrived: 999,
            min_clearance_m: 0.1234,
            release_lateness_ns: 123_456,
            release_lateness_max_ns: 123_456_789,
            solve_p99_ns: 123_456,
            deadline_misses: 12_345,
            fallback_commands: 1_234_567,
            rejected_inputs: 1_234_567,
            lost_records: 1234,
            workers_silent: 12,
            worker_panics: 12,
            ..Progress::default()
        };
        let text = lines(&progress);
        assert!(
            text.lines().count() > 1 && text.lines().all(|line| line.chars().count() <= COLUMNS),
            "{text}"
        );
        assert!(text.contains("misses 12345") && text.ends_with("workers silent 12"), "{text}");
        assert!(text.lines().all(|line| line == line.trim_end()), "{text:?}");

        let quiet = Progress { ticks: 1, robots: 8, min_clearance_m: 0.5, ..Progress::default() };
        assert!(lines(&quiet).lines().count() <= 2);
    }
}
