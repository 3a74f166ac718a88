//! `clearway eval`: closed loops under a virtual clock.

mod select;
mod sweep;
mod table;
mod trajectory;

use clearway::config::{Config, Profile, SolverKind};
use clearway::controller::Timing;
use clearway::evaluation::{self, Evaluation};
use clearway::geometry::Integration;
use clearway::scenario::Scenario;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::Serialize;
use serde_json::{Map, Value};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use sweep::{Point, Sweep};
use table::Form;
use trajectory::{Ordered, Trajectory};

/// Run scenarios as fast as the machine allows, and measure what the robots do.
///
/// The same controller as the daemon's drives the plant under a virtual clock. Prints a table of 80
/// columns; everything but the times is the same on every run. Columns: runs, robots arrived, pairs that
/// came too close, smallest gap beyond the required distance over continuous time, last arrival (mean
/// and worst over the runs), arrival time and length driven over the straight line's, ∫|dω| in rad/s;
/// with --wide also robots that stood still for a second away from their goal, and those that arrived
/// within the paper's bound (14), as such and with the first turn on the spot taken off.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway eval swap8 swap8-zero circle-50
  clearway eval suite --jsonl suite.jsonl        all families, sizes and seeds
  clearway eval my-scenarios/ --profile exp      every .toml file of a folder
  clearway eval swap8 --trajectories swap8.jsonl all poses and inputs
  clearway eval swap8 --set controller.gamma=0.5 --timing ideal
  clearway eval swap8 --profile paper --plant euler --timing ideal
  clearway eval swap8 circle-20 --sweep controller.gamma=0.2..1.0:9
  clearway eval suite --sweep controller.profile=certified,exp,paper

Exit codes: 0 everybody arrived and nobody came too close, 1 not so, 2 the command line or a file is wrong.")]
pub(crate) struct Args {
    /// Built-in names, ranges of seeds (random-20-0..49), scenario files, folders of them, or `suite`.
    #[arg(required = true)]
    scenario: Vec<String>,
    /// Control law [certified, paper, exp].
    #[arg(long)]
    profile: Option<Profile>,
    /// Solver [exact, clarabel].
    #[arg(long)]
    solver: Option<SolverKind>,
    /// When a command acts: `let` one period after its state, as in the daemon; `ideal` at once.
    #[arg(long, default_value = "let")]
    timing: Timing,
    /// How the plant moves: `exact` along arcs; `euler` by forward Euler steps, as the paper's.
    #[arg(long, value_name = "exact|euler")]
    plant: Option<Integration>,
    /// A configuration key to change, as in a configuration file.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
    /// A key that takes several values in turn, KEY=A..B:N or KEY=a,b,c; several make a grid.
    #[arg(long = "sweep", value_name = "SECTION.KEY=VALUES")]
    sweep: Vec<Sweep>,
    /// Scenarios that run at the same time; as many as there are cores by default.
    #[arg(long)]
    jobs: Option<std::num::NonZeroUsize>,
    /// Write one JSON object a scenario to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    jsonl: Option<PathBuf>,
    /// Write every robot's pose and input in every period to this file, one JSON object a scenario.
    #[arg(long, value_name = "OUT")]
    trajectories: Option<PathBuf>,
    /// A row for every scenario, also where there are many.
    #[arg(long)]
    all: bool,
    /// Every column, wider than a terminal.
    #[arg(long, conflicts_with = "markdown")]
    wide: bool,
    /// Every column that does not depend on the machine, as a Markdown table.
    #[arg(long)]
    markdown: bool,
}

/// One closed loop, done.
#[derive(Debug, Serialize)]
struct Run {
    #[serde(flatten)]
    evaluation: Evaluation,
    /// What was swept.
    #[serde(rename = "sweep", skip_serializing_if = "Vec::is_empty", serialize_with = "as_object")]
    point: Point,
}

/// Numbers as numbers, everything else as text.
fn as_object<S: serde::Serializer>(point: &Point, serializer: S) -> Result<S::Ok, S::Error> {
    let value =
        |text: &String| text.parse().map_or_else(|_| Value::from(text.as_str()), |x: f64| Value::from(x));
    point.iter().map(|(key, text)| (key.clone(), value(text))).collect::<Map<_, _>>().serialize(serializer)
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    if let Some(set) = args.set.iter().find(|set| set.trim_start().starts_with("scenario")) {
        return Err(miette!(help = "name the scenarios as arguments", "--set {set} has no effect here"));
    }
    let names = select::expand(&args.scenario)?;
    let mut runs: Vec<(Config, Point)> = Vec::new();
    for point in sweep::grid(&args.sweep)? {
        for name in &names {
            runs.push((configure(args, name, &point)?, point.clone()));
        }
    }
    let results = run_all(args, runs)?;

    let to_stdout = args.jsonl.as_deref() == Some(Path::new("-"));
    if let Some(path) = &args.jsonl {
        let mut lines = String::new();
        for result in &results {
            lines.push_str(&serde_json::to_string(result).into_diagnostic()?);
            lines.push('\n');
        }
        if to_stdout {
            crate::show(&lines);
        } else {
            written(path, std::fs::write(path, lines))?;
        }
    }
    if !to_stdout {
        let form = match (args.markdown, args.wide) {
            (true, _) => Form::Markdown,
            (_, true) => Form::Wide,
            _ => Form::Terminal,
        };
        crate::show(&table::render(&results, args.all, form));
    }
    Ok(results.iter().all(|run| run.evaluation.passed()))
}

fn configure(args: &Args, name: &str, point: &Point) -> Result<Config> {
    let scenario = Scenario::resolve(name)?;
    let swept = point.iter().map(|(key, value)| format!("{key}={value}"));
    let set: Vec<String> = args.set.iter().cloned().chain(swept).collect();
    let mut config = Config { scenario, ..Config::with_overrides(None, &set)? };
    let swept = |key: &str| point.iter().any(|(swept, _)| swept == key);
    for (key, given) in [
        ("controller.profile", args.profile.map(|profile| config.controller.profile = profile)),
        ("controller.solver", args.solver.map(|solver| config.controller.solver = solver)),
        ("source.plant", args.plant.map(|plant| config.source.plant = plant)),
    ] {
        if given.is_some() && swept(key) {
            return Err(miette!(help = "leave one of them out", "{key} is swept and given as well"));
        }
    }
    config.check_robust()?;
    Ok(config)
}

fn written<T>(path: &Path, result: std::io::Result<T>) -> Result<T> {
    result.into_diagnostic().wrap_err_with(|| format!("{} cannot be written", path.display()))
}

/// One run, and what the robots did as a line when that is asked for.
fn run_one(args: &Args, config: &Config) -> Result<(Evaluation, Option<String>)> {
    let mut trajectory = args.trajectories.as_ref().map(|_| Trajectory::new(config, args.timing.name()));
    let result = evaluation::run(config, args.timing, |_, fleet| {
        if let Some(trajectory) = &mut trajectory {
            trajectory.push(fleet);
        }
    })
    .into_diagnostic()
    .wrap_err_with(|| format!("{} could not run", config.scenario.name))?;
    let line = trajectory.map(|t| serde_json::to_string(&t)).transpose().into_diagnostic()?;
    Ok((result, line))
}

/// Runs every configuration; results in their order.
fn run_all(args: &Args, runs: Vec<(Config, Point)>) -> Result<Vec<Run>> {
    let mut trajectories = match &args.trajectories {
        Some(path) => Some((path, Ordered::new(BufWriter::new(written(path, File::create(path))?)))),
        None => None,
    };
    let mut results: Vec<Option<Evaluation>> = vec![None; runs.len()];
    let one = |(config, _): &(Config, Point)| run_one(args, config);
    crate::batch::run(&runs, args.jobs, one, |k, (result, line)| {
        if let (Some((path, out)), Some(line)) = (&mut trajectories, line) {
            written(path, out.put(k, line))?;
        }
        results[k] = Some(result);
        Ok(())
    })?;
    if let Some((path, out)) = trajectories {
        written(path, out.finish())?;
    }
    let run = |(result, (_, point)): (Option<Evaluation>, (Config, Point))| {
        result.map(|evaluation| Run { evaluation, point })
    };
    Ok(results.into_iter().zip(runs).filter_map(run).collect())
}
