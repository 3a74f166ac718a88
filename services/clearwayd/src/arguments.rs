use std::ffi::OsStr;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use clap::Parser;
use clearway::config::Config;
use clearway::document::ConfigError;
use clearway::report::Report;
use miette::{IntoDiagnostic, WrapErr};

const EXAMPLES: &str = "\
Examples:
  clearwayd                                  the paper's eight robots swap places
  clearwayd --scenario circle-20 --workers 4
  clearwayd --scenario my.toml --report out.json --period-us 20000
  clearwayd --config fleet.toml              a fleet of your own, until Ctrl-C
  clearwayd --config fleet.toml --set realtime.policy=require
  clearwayd --config fleet.toml --journal /var/lib/clearway/fleet.journal

Exit status:
  0  every robot arrived and no clearance was violated; or ended by a signal,
     none violated
  1  a robot did not arrive, a clearance was violated, or records were lost
  2  the command line, the configuration or the scenario is wrong, or the
     journal is another fleet's
  3  the fleet belongs to another process
  4  real-time operation is required and was refused
  5  anything else: shared memory, threads, files

Environment:
  CLEARWAY_IOX2_PREFIX, CLEARWAY_IOX2_ROOT
            where the channels live, in place of channel.prefix and channel.root
  STATE_DIRECTORY
            where the journal lives unless journal.path or --journal says; set by
            systemd
  RUST_LOG  what is logged, for instance RUST_LOG=debug";

/// Controls a fleet of wheeled robots in real time over shared memory.
///
/// Without arguments it runs the built-in scenario swap8 with an embedded plant, shows how it goes
/// and prints a report.
#[derive(Debug, Parser)]
#[command(name = "clearwayd", version, after_help = EXAMPLES, max_term_width = 80)]
pub(crate) struct Arguments {
    /// Configuration file (TOML); the daemon then runs until SIGINT or SIGTERM
    #[arg(long, value_name = "FILE")]
    pub(crate) config: Option<PathBuf>,
    /// Scenario file, or the name of a built-in one
    #[arg(long, value_name = "FILE|NAME")]
    scenario: Option<String>,
    /// Control law: certified, paper (unsafe, to compare with) or exp
    #[arg(long)]
    profile: Option<String>,
    /// Solver: exact or clarabel
    #[arg(long)]
    solver: Option<String>,
    /// Name of the fleet, the second element of the channels' names
    #[arg(long, value_name = "NAME")]
    fleet: Option<String>,
    /// Sampling period, µs
    #[arg(long, value_name = "US")]
    period_us: Option<u64>,
    /// Worker threads
    #[arg(long, value_name = "N")]
    workers: Option<u64>,
    /// Stop after this many periods
    #[arg(long, value_name = "N")]
    ticks: Option<u64>,
    /// Where goals, stop and pause are kept over a restart
    #[arg(long, value_name = "FILE", requires = "config")]
    journal: Option<PathBuf>,
    /// Begin as the scenario says: what the journal holds is kept aside
    #[arg(long, requires = "config")]
    fresh: bool,
    /// Any key of the configuration, as section.key=value; may be repeated
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Write the report as JSON
    #[arg(long, value_name = "OUT.json")]
    report: Option<PathBuf>,
    /// Show errors only
    #[arg(long, short, conflicts_with = "verbose")]
    pub(crate) quiet: bool,
    /// Log more; twice for even more
    #[arg(long, short, action = clap::ArgAction::Count)]
    pub(crate) verbose: u8,
}

impl Arguments {
    /// The configuration that file and arguments make together.
    pub(crate) fn config(&self) -> Result<Config, ConfigError> {
        let mut overrides = self.settings.clone();
        let mut set = |key: &str, value: Option<String>| {
            overrides.extend(value.map(|value| format!("{key}={value}")));
        };
        set("scenario", self.scenario.clone());
        set("controller.profile", self.profile.clone());
        set("controller.solver", self.solver.clone());
        set("fleet", self.fleet.clone());
        set("timing.period_us", self.period_us.map(|us| us.to_string()));
        set("timing.workers", self.workers.map(|n| n.to_string()));
        set("timing.ticks", self.ticks.map(|n| n.to_string()));
        let mut config = Config::with_overrides(self.config.as_deref(), &overrides)?;
        config.channel = config.channel.with_environment();
        if self.config.is_some() {
            let state = std::env::var_os("STATE_DIRECTORY");
            let given = self.journal.clone().or(config.journal.path.take());
            config.journal.path = given.or_else(|| Some(journal_in(state.as_deref()?, &config.fleet)));
            config.journal.fresh = self.fresh;
        }
        Ok(config)
    }

    /// The file for the report, if one is wanted.
    pub(crate) fn open_report(&self) -> miette::Result<Option<ReportFile>> {
        self.report.as_deref().map(ReportFile::create).transpose()
    }
}

/// The journal of a fleet in the first of the directories that a supervisor gives the daemon.
fn journal_in(directories: &OsStr, fleet: &str) -> PathBuf {
    let first = std::env::split_paths(directories).next().unwrap_or_default();
    first.join(format!("{fleet}.journal"))
}

/// The report's file.
pub(crate) struct ReportFile {
    path: PathBuf,
    file: File,
}

impl ReportFile {
    fn create(path: &Path) -> miette::Result<Self> {
        let file = File::create(path)
            .into_diagnostic()
            .wrap_err_with(|| format!("the report {} cannot be written", path.display()))?;
        Ok(Self { path: path.to_owned(), file })
    }

    pub(crate) fn write(&mut self, report: &Report) -> miette::Result<()> {
        let mut text = serde_json::to_string_pretty(report).into_diagnostic()?;
        text.push('\n');
        self.file
            .write_all(text.as_bytes())
            .into_diagnostic()
            .wrap_err_with(|| format!("the report {} cannot be written", self.path.display()))
    }
}
