//! `clearway`: the operator's command. Each subcommand has a file of its own.

mod check;
mod scenario;
mod summary;

use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Operate, evaluate and check Clearway fleets.
#[derive(Debug, Parser)]
#[command(name = "clearway", version, after_help = EXAMPLES)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  clearway check clearway.toml            is this configuration sound, and what does it say?
  clearway scenario circle-10 > mine.toml start a scenario of your own from a built-in one

Exit codes: 0 done, 2 the command line or a file is wrong.";

#[derive(Debug, Subcommand)]
enum Command {
    Check(check::Args),
    Scenario(scenario::Args),
}

/// The command line, or a file that it names, is wrong.
const WRONG_INPUT: u8 = 2;

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Check(args) => check::run(&args),
        Command::Scenario(args) => scenario::run(&args),
    };
    match done {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("Error: {:?}", miette::Report::new(error));
            ExitCode::from(WRONG_INPUT)
        }
    }
}

/// Prints to standard output. A closed pipe (`| head`) is the reader's decision, not an error.
fn show(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}
