//! `clearway`: the operator's command. Each subcommand has a file of its own.

mod batch;
mod bench;
mod check;
mod doctor;
mod eval;
mod figures;
mod host;
mod operate;
mod plot;
mod record;
mod replay;
mod robust;
mod scenario;
mod simulate;
mod summary;
mod top;

use clap::{Parser, Subcommand};
use std::io::Write;
use std::process::ExitCode;

/// Operate, evaluate and check Clearway fleets.
#[derive(Debug, Parser)]
#[command(name = "clearway", version, after_help = EXAMPLES, max_term_width = 80)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

const EXAMPLES: &str = "\
Examples:
  clearway check clearway.toml           is this configuration sound?
  clearway status                        how is the running daemon doing?
  clearway goal 3 1.5 -2                 send robot 3 to (1.5, -2) m
  clearway top                           watch robots, deadlines and slacks
  clearway doctor                        is this machine fit for real time?
  clearway eval swap8 circle-10          who arrives, how fast, how close?
  clearway figures --out figures         the paper's figures and ours
  clearway bench solve                   how fast are the solvers here?
  clearway bench latency                 how late, how long, on this machine?
  clearway bench soak --ticks 1000000    does anything grow or wear out?
  clearway bench wakeup                  how fast do threads wake each other?
  clearway robust                        do disturbed robots keep apart?
  clearway simulate --seeds 0..1000      does it all hold whatever fails?
  clearway record run.mcap               for Foxglove and for replay
  clearway replay run.mcap               compute every command again
  clearway scenario circle-10 > my.toml  start a scenario of your own

Exit codes: 0 done, 1 a run did not pass or a daemon refused, 2 the command line
or a file is wrong, 3 no daemon runs for the fleet, or it does not answer.";

#[derive(Debug, Subcommand)]
enum Command {
    Bench(bench::Args),
    Check(check::Args),
    Doctor(doctor::Args),
    Eval(eval::Args),
    Figures(figures::Args),
    Robust(robust::Args),
    Record(Box<record::Args>),
    Replay(replay::Args),
    Scenario(scenario::Args),
    Simulate(simulate::Args),
    Top(top::Args),
    #[command(flatten)]
    Operate(operate::Order),
}

/// The command line, or a file that it names, is wrong.
const WRONG_INPUT: u8 = 2;

/// A run did not pass: a robot did not arrive or a clearance was violated.
const NOT_PASSED: u8 = 1;

fn main() -> ExitCode {
    let done = match Cli::parse().command {
        Command::Bench(args) => bench::run(&args),
        Command::Doctor(args) => return doctor::run(&args).unwrap_or_else(|error| wrong(&error)),
        Command::Operate(order) => return operate::run(&order),
        Command::Check(args) => check::run(&args).map(|()| true).map_err(miette::Report::new),
        Command::Eval(args) => eval::run(&args),
        Command::Figures(args) => figures::run(&args).map(|()| true),
        Command::Robust(args) => robust::run(&args),
        Command::Simulate(args) => simulate::run(&args),
        Command::Record(args) => return code(record::run(&args)),
        Command::Replay(args) => return code(replay::run(&args)),
        Command::Top(args) => return code(top::run(&args)),
        Command::Scenario(args) => scenario::run(&args).map(|()| true).map_err(miette::Report::new),
    };
    match done {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::from(NOT_PASSED),
        Err(error) => wrong(&error),
    }
}

/// Where a command has exit codes of its own.
fn code(done: miette::Result<u8>) -> ExitCode {
    done.map_or_else(|error| wrong(&error), ExitCode::from)
}

fn wrong(error: &miette::Report) -> ExitCode {
    eprintln!("{error:?}");
    ExitCode::from(WRONG_INPUT)
}

/// Prints to standard output. A closed pipe (`| head`) is the reader's decision, not an error.
fn show(text: &str) {
    let _ = std::io::stdout().write_all(text.as_bytes());
}
