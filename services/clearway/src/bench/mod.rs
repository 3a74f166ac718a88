//! `clearway bench`: how fast, on this machine. A file or folder for each benchmark.

mod machine;
mod quantiles;
mod solve;

use clap::Subcommand;
use miette::Result;

/// Measure how fast Clearway is on this machine.
#[derive(Debug, clap::Args)]
pub(crate) struct Args {
    #[command(subcommand)]
    bench: Bench,
}

#[derive(Debug, Subcommand)]
enum Bench {
    Solve(solve::Args),
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    match &args.bench {
        Bench::Solve(args) => solve::run(args).map(|()| true),
    }
}
