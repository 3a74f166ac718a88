//! `clearway bench solve`: the exact solver and Clarabel on the same problems.

mod export;
mod measure;
mod problems;
mod report;

use super::machine::Machine;
use measure::Bench;
use miette::{IntoDiagnostic, Result, miette};
use report::Report;
use std::path::PathBuf;

/// Most rows of each kind that a programme may have here.
const ROWS_MAX: usize = 128;

/// Where the problems are drawn from unless other scenarios are named: open ground, from sparse to
/// crowded, pillars and a doorway for the rows of what does not move, and fleets in so little room
/// that many neighbours are within reach of one period.
const SCENARIOS: &[&str] = &[
    "swap8",
    "swap8-zero",
    "circle-10",
    "circle-20",
    "circle-50",
    "circle-100",
    "random-20-1",
    "random-20-2",
    "random-40-1",
    "random-40-2",
    "pillars-12",
    "doorway-both-12",
    "random-100-1@0.25",
    "random-100-2@0.25",
    "random-100-1@0.1",
    "random-100-2@0.1",
    "random-200-1@0.1",
];

/// Time the solvers on the problems of closed-loop runs.
///
/// The robots of several scenarios drive as in `clearway eval`; the programmes that they solved on
/// their way, grouped by the number of neighbours with a row, are solved again by the exact solver
/// and by Clarabel. Each problem is copied into a workspace and its solve timed alone, with the clock's own cost in the figure and reported
/// beside it. Two more figures for the exact solver have no clock in them: `repeated`, one problem
/// many times in a row, and `mean`, all problems one after another. The JSON report says under
/// `method` how every figure was taken. Run it on a quiet machine.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway bench solve
  clearway bench solve --neighbours 7 --samples 20000 --json solve.json
  clearway bench solve --export problems.json    the problems, for benches/peers

Exit codes: 0 measured, 2 the command line or a file is wrong.")]
pub(crate) struct Args {
    /// Write the report to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Problems for each number of neighbours, at most.
    #[arg(long, value_name = "N", default_value = "5000")]
    samples: std::num::NonZeroUsize,
    /// Numbers of neighbours.
    #[arg(long, value_name = "N,N,…", value_delimiter = ',', default_value = "0,1,2,3,4,5,6,7,8,10,12")]
    neighbours: Vec<usize>,
    /// Scenarios to draw from, built-in names or files. NAME@SCALE multiplies places, radii and gap
    /// but not speeds, which brings more neighbours within reach; such problems are only used where
    /// the others do not suffice.
    #[arg(long, value_name = "NAME,NAME,…", value_delimiter = ',')]
    scenarios: Vec<String>,
    /// Write the problems and the exact solutions to this file too.
    #[arg(long, value_name = "FILE")]
    export: Option<PathBuf>,
}

pub(crate) fn run(args: &Args) -> Result<()> {
    if let Some(large) = args.neighbours.iter().find(|n| **n > ROWS_MAX) {
        return Err(miette!(help = "name smaller numbers", "{large} neighbours are more than {ROWS_MAX}"));
    }
    let scenarios = if args.scenarios.is_empty() {
        SCENARIOS.iter().map(|name| (*name).to_owned()).collect()
    } else {
        args.scenarios.clone()
    };
    let bar = super::bar(scenarios.len() + args.neighbours.len());
    let groups = problems::collect(&scenarios, &args.neighbours, args.samples.get(), |name| {
        bar.set_message(format!("driving {name}"));
        bar.inc(1);
    })?;
    let machine = Machine::here();
    let mut bench = Bench::new(ROWS_MAX)?;
    let mut cases = Vec::new();
    for group in groups.iter().filter(|g| !g.problems.is_empty()) {
        bar.set_message(format!("{} neighbours, {} problems", group.neighbours, group.problems.len()));
        bar.inc(1);
        cases.push(bench.measure(group)?);
    }
    bar.finish_and_clear();
    for group in groups.iter().filter(|g| g.problems.len() < args.samples.get()) {
        let (n, held) = (group.neighbours, group.problems.len());
        eprintln!("note: the runs held {held} problems with {n} neighbours");
    }

    if let Some(path) = &args.export {
        let document = export::document(&groups, ROWS_MAX);
        super::write(path, &serde_json::to_string(&document).into_diagnostic()?)?;
    }
    let report = Report::new(machine, scenarios, cases);
    super::hand_out(args.json.as_deref(), &report, || report.table())
}
