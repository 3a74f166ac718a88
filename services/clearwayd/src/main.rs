//! The Clearway daemon: controls a fleet in real time over shared memory.

mod arguments;
mod display;
mod summary;

use std::io::IsTerminal;
use std::process::ExitCode;
use std::time::Duration;

use clap::Parser;
use clearway::channel::ChannelError;
use clearway::config::Config;
use clearway::report::Report;
use clearway::runtime::{Daemon, DaemonError, JournalError, Supervisor, Until};
use clearway_signals::{Again, Stop};
use miette::{IntoDiagnostic, WrapErr};

use arguments::Arguments;
use display::Display;

/// What scripts can tell from the exit status; `--help` lists the same.
#[derive(Debug, Clone, Copy)]
enum Exit {
    Success = 0,
    TaskFailed = 1,
    Configuration = 2,
    Owned = 3,
    RealTimeRefused = 4,
    Failed = 5,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let config = match arguments.config() {
        Ok(config) => config,
        Err(e) => return fail(&e.into(), Exit::Configuration),
    };
    match run(&arguments, config) {
        Ok(report) => judge(&report).into(),
        Err(Failure { error, exit }) => fail(&error, exit),
    }
}

struct Failure {
    error: miette::Report,
    exit: Exit,
}

impl From<miette::Report> for Failure {
    fn from(error: miette::Report) -> Self {
        Self { error, exit: Exit::Failed }
    }
}

impl From<DaemonError> for Failure {
    fn from(error: DaemonError) -> Self {
        let exit = match &error {
            DaemonError::Channel(ChannelError::Owned { .. }) => Exit::Owned,
            DaemonError::Channel(ChannelError::FleetName { .. } | ChannelError::Location { .. })
            | DaemonError::Journal(JournalError::OtherFleet { .. })
            | DaemonError::Controller { .. } => Exit::Configuration,
            DaemonError::RealTime { .. } => Exit::RealTimeRefused,
            _ => Exit::Failed,
        };
        Self { error: error.into(), exit }
    }
}

fn fail(error: &miette::Report, exit: Exit) -> ExitCode {
    eprintln!("{error:?}");
    exit.into()
}

fn run(arguments: &Arguments, config: Config) -> Result<Report, Failure> {
    // The report's file is opened first: a run of hours must not end with a misspelt path.
    let mut report_file = arguments.open_report()?;
    // A second signal ends the process at once, and the robots stop when their commands expire.
    let stop = Stop::listen(Again::Ends).into_diagnostic().wrap_err("signals cannot be handled")?;
    let mut display = Display::new(arguments, &config, std::io::stderr().is_terminal());
    display.start_logging(arguments);

    let until = if arguments.config.is_some() { Until::Stopped } else { Until::Arrived };
    // The fleet is worth more than a supervisor that cannot be told of it.
    let supervisor = Supervisor::from_environment().unwrap_or_else(|e| {
        tracing::warn!("{e}");
        None
    });
    let daemon = Daemon::start_supervised(config, until, supervisor)?;
    display.started(daemon.realtime(), daemon.journal());
    while !daemon.is_finished() {
        if stop.is_asked() {
            daemon.stop();
        }
        display.update(&daemon.progress());
        std::thread::sleep(Duration::from_millis(50));
    }
    display.update(&daemon.progress());
    display.finish();
    let report = daemon.join()?;

    if let Some(file) = &mut report_file {
        file.write(&report)?;
    }
    if !arguments.quiet {
        print!("{}", summary::table(&report));
    }
    Ok(report)
}

/// A run that was asked to end need not have arrived; one that ran to its end must.
fn judge(report: &Report) -> Exit {
    let safe = report.control.violations == 0 && report.lost_records == 0;
    let arrived = report.control.arrived == report.control.robots || report.ended_by == "operator";
    if safe && arrived { Exit::Success } else { Exit::TaskFailed }
}
