use std::fmt::Write as _;
use std::io::{IsTerminal, Write};
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

/// Two lines, so that 80 columns hold them.
const LIVE: &str = "{spinner} arrived {pos}/{len} {bar:12}  {prefix}\n  {wide_msg}";

/// Shows how a run goes: a live line on a terminal, otherwise a line a second; all on stderr.
pub(crate) struct Display {
    bar: Option<ProgressBar>,
    lines: bool,
    title: String,
    line_due: Instant,
}

impl Display {
    pub(crate) fn new(arguments: &Arguments, config: &Config, terminal: bool) -> Self {
        let shown = !arguments.quiet;
        let title = format!(
            "{}: {} robots, fleet {:?}, {} law, {} solver, T = {}",
            config.scenario.name,
            config.scenario.robots.len(),
            config.fleet,
            config.controller.profile.name(),
            config.controller.solver.name(),
            time(config.timing.period_ns),
        );
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

    pub(crate) fn started(&self, realtime: &Achieved) {
        if self.bar.is_none() && !self.lines {
            return;
        }
        let cpus: Vec<String> =
            realtime.cpus.iter().map(|cpu| cpu.map_or("any".to_owned(), |cpu| cpu.to_string())).collect();
        self.say(&format!("clearwayd  {}", self.title));
        self.say(&format!(
            "real time  policy {}, priority {}, CPUs {} (loop, workers), memory {}",
            realtime.policy,
            realtime.priority,
            cpus.join(" "),
            if realtime.memory_locked { "locked" } else { "not locked" },
        ));
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
            bar.set_message(health(progress));
            bar.tick();
        } else if self.lines && Instant::now() >= self.line_due {
            self.line_due = Instant::now() + LINE_EVERY;
            let (clocks, health) = (clocks(progress), health(progress));
            self.say(&format!("arrived {}/{}  {clocks}  {health}", progress.arrived, progress.robots));
        }
    }

    pub(crate) fn finish(&mut self) {
        if let Some(bar) = self.bar.take() {
            bar.finish();
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

fn health(p: &Progress) -> String {
    let mut line = format!(
        "clearance ≥ {}  late {} (max {})  solve p99 {}  misses {}",
        metres(Some(p.min_clearance_m)),
        time(p.release_lateness_ns),
        time(p.release_lateness_max_ns),
        time(p.solve_p99_ns),
        p.deadline_misses,
    );
    for (count, what) in [
        (p.fallback_commands, "fallbacks"),
        (p.rejected_inputs, "rejected"),
        (p.lost_records, "records lost"),
        (p.worker_panics, "worker panics"),
        (p.workers_silent as u64, "workers silent"),
    ] {
        if count > 0 {
            // Writing to a string cannot fail.
            let _ = write!(line, "  {what} {count}");
        }
    }
    line
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
