//! `clearway bench`: how fast, on this machine. A file or folder for each benchmark.

mod latency;
mod machine;
mod quantiles;
mod scale;
mod soak;
mod solve;
mod wakeup;

use clap::Subcommand;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr};
use std::path::Path;

/// Measure how fast Clearway is on this machine.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Debug, Subcommand)]
enum Bench {
    Latency(latency::Args),
    /// A second process of `bench latency`.
    #[command(hide = true)]
    LatencyProcess(latency::ProcessArgs),
    Soak(soak::Args),
    Scale(scale::Args),
    Solve(solve::Args),
    Wakeup(wakeup::Args),
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    match &args.bench {
        Bench::Latency(args) => latency::run(args),
        Bench::LatencyProcess(args) => latency::run_process(args).map(|()| true),
        Bench::Soak(args) => soak::run(args),
        Bench::Scale(args) => scale::run(args).map(|()| true),
        Bench::Solve(args) => solve::run(args).map(|()| true),
        Bench::Wakeup(args) => wakeup::run(args).map(|()| true),
    }
}

/// A bar of `length` steps.
fn bar(length: usize) -> ProgressBar {
    let style = ProgressStyle::with_template("{bar:30} {pos}/{len}  {elapsed}  {msg}");
    ProgressBar::new(length as u64).with_style(style.unwrap_or_else(|_| ProgressStyle::default_bar()))
}

/// Writes `report` as JSON where `json` says, `-` being standard output, and shows the table unless
/// that is there already.
fn hand_out(json: Option<&Path>, report: &impl serde::Serialize, table: impl Fn() -> String) -> Result<()> {
    let to_stdout = json == Some(Path::new("-"));
    if let Some(path) = json {
        let text = serde_json::to_string_pretty(report).into_diagnostic()? + "\n";
        if to_stdout {
            crate::show(&text);
        } else {
            write(path, &text)?;
        }
    }
    if !to_stdout {
        crate::show(&table());
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    std::fs::write(path, text)
        .into_diagnostic()
        .wrap_err_with(|| format!("{} cannot be written", path.display()))
}
