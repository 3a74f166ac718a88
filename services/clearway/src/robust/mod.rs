//! `clearway robust`: closed loops under disturbances, inside and without the robust margin.

mod cases;
mod table;

use cases::{Case, Level, Margin};
use clearway::config::Config;
use clearway::controller::Timing;
use clearway::evaluation::{self, Evaluation};
use miette::{IntoDiagnostic, Result, WrapErr};
use serde::Serialize;
use std::io::Write;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Show that robots that are disturbed within the bounds of [robust] keep their distances, and what it
/// costs.
///
/// Runs every kind of disturbance at several levels over several families of scenarios, seeded and with
/// the worst sign; with the margin, with the margin but without the disturbance, and without the margin to
/// show that the same runs can fail.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway robust                       552 runs, half a minute on two cores
  clearway robust --quick               104 of them
  clearway robust --jsonl robust.jsonl  one object a run, for scripts

Exit codes: 0 no violation inside the bounds and some without the margin, 1 not so, 2 the command line is wrong.")]
pub(crate) struct Args {
    /// Fewer scenarios and only the full level.
    #[arg(long)]
    quick: bool,
    /// Runs at the same time; as many as there are cores by default.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    /// Write one JSON object a run to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    jsonl: Option<PathBuf>,
}

/// One run as it is written and shown.
#[derive(Debug, Clone, Serialize)]
struct Run {
    kind: &'static str,
    pattern: &'static str,
    /// Share of the bounds, and of the disturbance.
    level: Level,
    margin: Margin,
    seed: u64,
    #[serde(flatten)]
    evaluation: Evaluation,
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    let cases = cases::all(args.quick)?;
    let mut results: Vec<Option<Run>> = vec![None; cases.len()];
    let one = |case: &Case| -> Result<Run> {
        let config: &Config = &case.config;
        let evaluation = evaluation::run(config, Timing::LogicalExecutionTime, |_, _| {})
            .into_diagnostic()
            .wrap_err_with(|| format!("{} could not run", config.scenario.name))?;
        Ok(Run {
            kind: case.kind,
            pattern: config.disturbance.pattern.name(),
            level: case.level,
            margin: case.margin,
            seed: config.disturbance.seed,
            evaluation,
        })
    };
    crate::batch::run(&cases, args.jobs, one, |k, result| {
        results[k] = Some(result);
        Ok(())
    })?;
    let runs: Vec<Run> = results.into_iter().flatten().collect();
    let to_stdout = args.jsonl.as_deref() == Some(Path::new("-"));
    if let Some(path) = &args.jsonl {
        let mut lines = String::new();
        for run in &runs {
            lines.push_str(&serde_json::to_string(run).into_diagnostic()?);
            lines.push('\n');
        }
        if to_stdout {
            crate::show(&lines);
        } else {
            std::fs::File::create(path)
                .and_then(|mut file| file.write_all(lines.as_bytes()))
                .into_diagnostic()
                .wrap_err_with(|| format!("{} cannot be written", path.display()))?;
        }
    }
    if !to_stdout {
        crate::show(&table::render(&runs));
    }
    let violations = |margin: Margin| {
        runs.iter().filter(|r| r.margin == margin).map(|r| r.evaluation.figures.violations).sum::<usize>()
    };
    Ok(violations(Margin::On) == 0 && violations(Margin::Only) == 0 && violations(Margin::Off) > 0)
}
