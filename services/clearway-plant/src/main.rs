//! The robots of a Clearway fleet as a process of their own.

mod arguments;
mod display;
mod simulation;
mod trajectory;

use std::fs::File;
use std::io::Write;
use std::path::Path;
use std::process::ExitCode;

use clap::Parser;
use clearway::robots::Report;
use clearway_signals::{Again, Stop};
use miette::{IntoDiagnostic, WrapErr, miette};

use arguments::Arguments;
use display::Display;
use simulation::{Failure, Simulation};

/// What scripts can tell from the exit status; `--help` lists the same.
#[derive(Debug, Clone, Copy)]
enum Exit {
    Success = 0,
    TaskFailed = 1,
    Configuration = 2,
    Failed = 5,
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

fn main() -> ExitCode {
    let arguments = Arguments::parse();
    let parts = arguments.config().map_err(miette::Report::from).and_then(|config| {
        let own = arguments.own(&config.scenario).map_err(|reason| miette!("{reason}"))?;
        Ok((config, own))
    });
    let (config, own) = match parts {
        Ok(parts) => parts,
        Err(e) => return fail(&e, Exit::Configuration),
    };
    let mut display = Display::new(arguments.quiet);
    let run = || -> Result<Report, Failure> {
        // Files are opened first: a run of hours must not end with a misspelt path.
        let mut report_file = arguments.report.as_deref().map(create).transpose()?;
        let stop = Stop::listen(Again::Ends).into_diagnostic().wrap_err("signals cannot be handled")?;
        let report = Simulation::new(&arguments, config, own)?.run(&stop, &mut display)?;
        if let Some((file, path)) = report_file.as_mut().zip(arguments.report.as_deref()) {
            write(file, path, &report)?;
        }
        Ok(report)
    };
    let result = run();
    display.finish();
    match result {
        Ok(report) => {
            if !arguments.quiet {
                print!("{}", display::table(&report));
            }
            judge(&report, arguments.once).into()
        }
        Err(Failure::Mismatch(e)) => fail(&e, Exit::Configuration),
        Err(Failure::Other(e)) => fail(&e, Exit::Failed),
    }
}

fn fail(error: &miette::Report, exit: Exit) -> ExitCode {
    eprintln!("{error:?}");
    exit.into()
}

fn create(path: &Path) -> miette::Result<File> {
    let created = File::create(path).into_diagnostic();
    created.wrap_err_with(|| format!("the report {} cannot be written", path.display()))
}

fn write(file: &mut File, path: &Path, report: &Report) -> miette::Result<()> {
    let mut text = serde_json::to_string_pretty(report).into_diagnostic()?;
    text.push('\n');
    let written = file.write_all(text.as_bytes()).into_diagnostic();
    written.wrap_err_with(|| format!("the report {} cannot be written", path.display()))
}

/// A run that was asked to end need not have arrived; the daemon's whole run must.
fn judge(report: &Report, once: bool) -> Exit {
    let arrived = !once || report.arrived == report.robots.len();
    if report.violations == 0 && arrived { Exit::Success } else { Exit::TaskFailed }
}
