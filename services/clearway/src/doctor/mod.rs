//! `clearway doctor`: is this machine fit for real time, and what would make it fitter?

mod channels;
mod configuration;
mod examination;
mod finding;
mod print;
mod processors;
mod rights;
mod system;
#[cfg(test)]
mod tests;

use std::path::PathBuf;
use std::process::ExitCode;

use clearway::config::Config;
use miette::{IntoDiagnostic, Result};
use serde::Serialize;

use crate::host::Host;
use examination::Examination;
use finding::{Finding, Status};

/// Examine this machine: what delays a real-time daemon here, and what to do about it.
///
/// Looks at scheduling rights, memory locking, processors, clock, kernel and shared memory, and changes
/// nothing. Every finding says what was found, why it matters and the exact remedy.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway doctor
  clearway doctor --config fleet.toml     its priorities, CPUs and memory, too
  clearway doctor --json | jq '.findings[] | select(.status != \"ok\")'

Exit codes: 0 nothing prevents real time (there may be warnings), 1 something does, 2 something
could not be examined, or the command line or the configuration is wrong.")]
pub(crate) struct Args {
    /// Hold this configuration against the machine too.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// Print the findings as JSON.
    #[arg(long)]
    json: bool,
    /// Read /proc and /sys below this directory, for instance of a support archive; what only the
    /// running kernel can answer is left out.
    #[arg(long, value_name = "DIR")]
    root: Option<PathBuf>,
}

/// All findings and what they come to.
#[derive(Debug, Serialize)]
struct Diagnosis {
    exit_code: u8,
    ok: usize,
    warnings: usize,
    unknown: usize,
    failures: usize,
    findings: Vec<Finding>,
}

impl Diagnosis {
    fn of(e: &Examination) -> Self {
        let findings: Vec<Finding> = [
            rights::findings(e),
            processors::findings(e),
            system::findings(e),
            channels::findings(e),
            configuration::findings(e),
        ]
        .concat();
        let count = |status| findings.iter().filter(|finding| finding.status == status).count();
        let (failures, unknown) = (count(Status::Fail), count(Status::Unknown));
        let exit_code = match (failures, unknown) {
            (1.., _) => 1,
            (0, 1..) => 2,
            _ => 0,
        };
        Self { exit_code, ok: count(Status::Ok), warnings: count(Status::Warn), unknown, failures, findings }
    }
}

pub(crate) fn run(args: &Args) -> Result<ExitCode> {
    let config = args.config.as_deref().map(Config::load).transpose()?.map(|mut config| {
        config.channel = config.channel.with_environment();
        config
    });
    let host = args.root.as_deref().map_or_else(Host::here, Host::at);
    let diagnosis = Diagnosis::of(&Examination::new(host, config, args.root.is_none()));
    if args.json {
        crate::show(&(serde_json::to_string_pretty(&diagnosis).into_diagnostic()? + "\n"));
    } else {
        crate::show(&print::text(&diagnosis));
    }
    Ok(ExitCode::from(diagnosis.exit_code))
}
