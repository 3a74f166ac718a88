//! `clearway eval`: closed loops under a virtual clock.

mod table;
mod trajectory;

use clearway::config::{Config, Profile, SolverKind};
use clearway::controller::Timing;
use clearway::evaluation::{self, Evaluation};
use clearway::scenario::Scenario;
use indicatif::{ProgressBar, ProgressStyle};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::fs::File;
use std::io::BufWriter;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::mpsc;
use trajectory::{Ordered, Trajectory};

/// Run scenarios as fast as the machine allows, and measure what the robots do.
///
/// The same controller as the daemon's drives the exact plant under a virtual clock. Prints a table;
/// everything but the times is the same on every run.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway eval swap8 swap8-zero circle-50
  clearway eval suite --jsonl suite.jsonl        every family, several sizes, many seeds
  clearway eval my-scenarios/ --profile exp      every .toml file of a folder
  clearway eval swap8 --trajectories swap8.jsonl poses and inputs of every period
  clearway eval swap8 --set controller.gamma=0.5 --timing ideal

Exit codes: 0 everybody arrived and nobody came too close, 1 not so, 2 the command line or a file is wrong.")]
pub(crate) struct Args {
    /// Built-in names, scenario files, folders of scenario files, or `suite`.
    #[arg(required = true)]
    scenario: Vec<String>,
    /// Control law [certified, paper, exp].
    #[arg(long)]
    profile: Option<Profile>,
    /// Solver [exact, clarabel].
    #[arg(long)]
    solver: Option<SolverKind>,
    /// When a command acts: `let` one period after its state, as in the daemon; `ideal` at once.
    #[arg(long, default_value = "let", value_parser = ["let", "ideal"])]
    timing: String,
    /// A configuration key to change, as in a configuration file.
    #[arg(long = "set", value_name = "SECTION.KEY=VALUE")]
    set: Vec<String>,
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
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    if let Some(set) = args.set.iter().find(|set| set.trim_start().starts_with("scenario")) {
        return Err(miette!(help = "name the scenarios as arguments", "--set {set} has no effect here"));
    }
    let configs: Vec<Config> =
        expand(&args.scenario)?.iter().map(|name| configure(args, name)).collect::<Result<_>>()?;
    let jobs = args.jobs.or_else(|| std::thread::available_parallelism().ok()).map_or(1, usize::from);
    let results = run_all(args, &configs, jobs)?;

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
        crate::show(&table::render(&results, args.all));
    }
    Ok(results.iter().all(Evaluation::passed))
}

/// Names as they are, folders as their scenario files in order of name, `suite` as its members.
fn expand(names: &[String]) -> Result<Vec<String>> {
    let mut all = Vec::new();
    for name in names {
        let path = Path::new(name);
        if name == "suite" {
            all.extend(Scenario::suite());
        } else if path.is_dir() {
            let entries = std::fs::read_dir(path)
                .into_diagnostic()
                .wrap_err_with(|| format!("{name} cannot be listed"))?;
            let mut files: Vec<String> = entries
                .filter_map(|entry| entry.ok().map(|e| e.path()))
                .filter(|p| p.extension().is_some_and(|e| e == "toml"))
                .map(|p| p.to_string_lossy().into_owned())
                .collect();
            if files.is_empty() {
                return Err(miette!(
                    help = "name a folder that holds scenario files",
                    "{name} has no .toml file"
                ));
            }
            files.sort();
            all.extend(files);
        } else {
            all.push(name.clone());
        }
    }
    Ok(all)
}

fn configure(args: &Args, name: &str) -> Result<Config> {
    let scenario = Scenario::resolve(name)?;
    let overridden = Config::with_overrides(None, &args.set)?;
    let mut config = Config { scenario, ..overridden };
    config.controller.profile = args.profile.unwrap_or(config.controller.profile);
    config.controller.solver = args.solver.unwrap_or(config.controller.solver);
    Ok(config)
}

fn written<T>(path: &Path, result: std::io::Result<T>) -> Result<T> {
    result.into_diagnostic().wrap_err_with(|| format!("{} cannot be written", path.display()))
}

/// One run, and what the robots did as a line when that is asked for.
fn run_one(args: &Args, config: &Config) -> Result<(Evaluation, Option<String>)> {
    let timing = if args.timing == "ideal" { Timing::Ideal } else { Timing::LogicalExecutionTime };
    let mut trajectory = args.trajectories.as_ref().map(|_| Trajectory::new(config, &args.timing));
    let result = evaluation::run(config, timing, |_, fleet| {
        if let Some(trajectory) = &mut trajectory {
            trajectory.push(fleet);
        }
    })
    .into_diagnostic()
    .wrap_err_with(|| format!("{} could not run", config.scenario.name))?;
    let line = trajectory.map(|t| serde_json::to_string(&t)).transpose().into_diagnostic()?;
    Ok((result, line))
}

/// Runs every configuration on `jobs` threads; results in the order of the configurations.
fn run_all(args: &Args, configs: &[Config], jobs: usize) -> Result<Vec<Evaluation>> {
    let mut trajectories = match &args.trajectories {
        Some(path) => Some((path, Ordered::new(BufWriter::new(written(path, File::create(path))?)))),
        None => None,
    };
    let bar = ProgressBar::new(configs.len() as u64).with_style(
        ProgressStyle::with_template("{bar:30} {pos}/{len} scenarios  {elapsed}  {msg}")
            .unwrap_or_else(|_| ProgressStyle::default_bar()),
    );
    let next = AtomicUsize::new(0);
    let (sender, results) = mpsc::channel();
    std::thread::scope(|scope| {
        for _ in 0..jobs.min(configs.len()) {
            let (sender, next) = (sender.clone(), &next);
            scope.spawn(move || {
                while let Some((k, config)) = take(next, configs) {
                    // The receiver lives as long as the scope.
                    let _ = sender.send((k, run_one(args, config)));
                }
            });
        }
        drop(sender);
        let mut ordered: Vec<Option<Evaluation>> = vec![None; configs.len()];
        for (k, result) in results {
            let (result, line) = result?;
            if let (Some((path, out)), Some(line)) = (&mut trajectories, line) {
                written(path, out.put(k, line))?;
            }
            ordered[k] = Some(result);
            bar.set_message(configs[k].scenario.name.clone());
            bar.inc(1);
        }
        bar.finish_and_clear();
        if let Some((path, out)) = trajectories {
            written(path, out.finish())?;
        }
        Ok(ordered.into_iter().flatten().collect())
    })
}

/// The next configuration that nobody has taken.
fn take<'a>(next: &AtomicUsize, configs: &'a [Config]) -> Option<(usize, &'a Config)> {
    let k = next.fetch_add(1, Ordering::Relaxed);
    configs.get(k).map(|config| (k, config))
}
