//! `clearway simulate`: the whole controller with faults, by seeds.

mod report;

use std::num::NonZeroUsize;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::time::Instant;

use clearway::simulation::{Class, Kind, Options, Outcome, shrink, simulate};
use miette::{IntoDiagnostic, Result, miette};
use report::{Failed, Simulation};

/// Seeds that one run may name.
const SEEDS_MAX: u64 = 100_000_000;

/// Simulate the whole controller with faults, and check what must hold after every period.
///
/// The daemon's own loop, workers, admission, gates and operators' thread take turns under a virtual clock, with
/// faults that each seed decides: workers that panic, hang or answer wrongly, periods that overrun, observations
/// and commands that are lost, repeated, forged or late, daemons that are killed and started again. A seed
/// always gives the same bits. docs/SIMULATION.md says what is checked and what each kind of fault may cost.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway simulate                             200 seeds, all kinds of faults
  clearway simulate --seeds 0..10000 --jobs 2
  clearway simulate --seeds 17..18 --trace      the story of seed 17
  clearway simulate --seeds 17..18 --only 3,5   with its faults 3 and 5 alone
  clearway simulate --faults worker-panic,obs-teleport
  clearway simulate --class overlap --robots 12
  clearway simulate --list                      the kinds of faults and what is done about them

Exit codes: 0 everything held, 1 it did not in some seed, 2 the command line is wrong.")]
#[expect(clippy::struct_excessive_bools, reason = "flags of a command line")]
pub(crate) struct Args {
    /// Seeds from A up to B, without B.
    #[arg(long, value_name = "A..B", default_value = "0..200", value_parser = seeds)]
    seeds: Range<u64>,
    /// Robots of each fleet; by the seed when it is not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(2..=500))]
    robots: Option<u16>,
    /// Workers of each daemon; by the seed when it is not given.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=64))]
    workers: Option<u16>,
    /// Periods in which faults come; then everybody has to arrive.
    #[arg(long, value_name = "N", default_value_t = 160, value_parser = clap::value_parser!(u64).range(32..=1_000_000))]
    periods: u64,
    /// Kinds of faults, all by default.
    #[arg(long, value_name = "LIST", value_delimiter = ',', value_parser = kind)]
    faults: Option<Vec<Kind>>,
    /// Class of the fleets; by the seed when it is not given.
    #[arg(long, value_name = "CLASS", value_parser = class)]
    class: Option<Class>,
    /// Of the seeds' faults only those with these numbers.
    #[arg(long, value_name = "NUMBERS|none", value_parser = only)]
    only: Option<Only>,
    /// Seeds that run at the same time; as many as there are cores by default.
    #[arg(long)]
    jobs: Option<NonZeroUsize>,
    /// Tell what happens, period by period.
    #[arg(long)]
    trace: bool,
    /// Drive commands that nobody verified from period 20 on: every seed has to fail, or the checks are worth nothing.
    #[arg(long)]
    sabotage: bool,
    /// Do not look for the fewest faults with which a seed still fails.
    #[arg(long)]
    no_shrink: bool,
    /// List the kinds of faults and classes of fleets, and end.
    #[arg(long)]
    list: bool,
    /// Write the whole result as JSON to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT")]
    json: Option<PathBuf>,
    /// Write one JSON object a seed to this file; `-` for standard output instead of the table.
    #[arg(long, value_name = "OUT", conflicts_with = "json")]
    jsonl: Option<PathBuf>,
}

fn seeds(text: &str) -> Result<Range<u64>, String> {
    let range = text.split_once("..").and_then(|(a, b)| Some(a.parse().ok()?..b.parse().ok()?));
    let range: Range<u64> = range.ok_or("write A..B with two numbers")?;
    if range.is_empty() || range.end - range.start > SEEDS_MAX {
        return Err(format!("write A..B with A below B, up to {SEEDS_MAX} seeds"));
    }
    Ok(range)
}

/// Numbers of faults.
#[derive(Debug, Clone)]
struct Only(Vec<usize>);

fn only(text: &str) -> Result<Only, String> {
    if text == "none" {
        return Ok(Only(Vec::new()));
    }
    let numbers: Result<_, _> = text.split(',').map(|number| number.trim().parse()).collect();
    numbers.map(Only).map_err(|_| "write the numbers with commas between them, or none".to_owned())
}

fn kind(name: &str) -> Result<Kind, String> {
    Kind::from_name(name).ok_or_else(|| format!("there is no kind `{name}`: see clearway simulate --list"))
}

fn class(name: &str) -> Result<Class, String> {
    let names: Vec<&str> = Class::ALL.iter().map(|class| class.name()).collect();
    Class::from_name(name).ok_or_else(|| format!("there is no class `{name}`: one of {}", names.join(", ")))
}

impl Args {
    fn options(&self) -> Options {
        Options {
            robots: self.robots.map(usize::from),
            workers: self.workers.map(usize::from),
            periods: self.periods,
            kinds: self.faults.clone(),
            class: self.class,
            only: self.only.as_ref().map(|only| only.0.clone()),
            trace: self.trace,
            sabotage: self.sabotage,
        }
    }

    /// The command that runs one of the seeds again.
    fn replay(&self, seed: u64, only: &[usize]) -> String {
        let mut command = format!("clearway simulate --seeds {seed}..{}", seed + 1);
        let mut add = |name: &str, value: Option<String>| {
            if let Some(value) = value {
                command.extend([" --", name, " ", &value]);
            }
        };
        add("robots", self.robots.map(|n| n.to_string()));
        add("workers", self.workers.map(|n| n.to_string()));
        add("periods", (self.periods != 160).then(|| self.periods.to_string()));
        let kinds =
            self.faults.as_ref().map(|kinds| kinds.iter().map(|kind| kind.name()).collect::<Vec<_>>());
        add("faults", kinds.map(|kinds| kinds.join(",")));
        add("class", self.class.map(|class| class.name().to_owned()));
        let numbers = only.iter().map(ToString::to_string).collect::<Vec<_>>().join(",");
        add("only", Some(if only.is_empty() { "none".to_owned() } else { numbers }));
        if self.sabotage {
            command.push_str(" --sabotage");
        }
        command + " --trace"
    }
}

pub(crate) fn run(args: &Args) -> Result<bool> {
    if args.list {
        crate::show(&report::list());
        return Ok(true);
    }
    let options = args.options();
    let seeds: Vec<u64> = args.seeds.clone().collect();
    let begun = Instant::now();
    let mut result = Simulation::default();
    let mut lines = Vec::new();
    let mut stories: Vec<(u64, Vec<String>)> = Vec::new();
    let one = |seed: &u64| simulate(*seed, &options).into_diagnostic();
    crate::batch::run(&seeds, args.jobs, one, |_, mut outcome: Outcome| {
        if args.jsonl.is_some() {
            let line = serde_json::to_string(&report::Line::of(&outcome)).into_diagnostic()?;
            lines.push((outcome.seed, line));
        }
        if args.trace {
            stories.push((outcome.seed, std::mem::take(&mut outcome.story)));
        }
        result.add(&outcome);
        if !outcome.failures.is_empty() {
            let mut left: Vec<usize> = outcome.faults.iter().map(|fault| fault.number).collect();
            if !args.no_shrink && result.failed.len() < report::SHRUNK_MAX {
                let quiet = Options { trace: false, ..options.clone() };
                (left, outcome) = shrink(&outcome, &quiet).into_diagnostic()?;
            }
            let replay = args.replay(outcome.seed, &left);
            result.failed.push(Failed::new(&outcome, &left, replay));
        }
        Ok(())
    })?;
    result.finish(begun.elapsed());
    stories.sort_by_key(|(seed, _)| *seed);
    for (seed, story) in &stories {
        crate::show(&format!("seed {seed}\n"));
        for line in story {
            crate::show(&format!("  {line}\n"));
        }
    }
    hand_out(args, &result, lines)?;
    Ok(result.failed.is_empty())
}

fn hand_out(args: &Args, result: &Simulation, mut lines: Vec<(u64, String)>) -> Result<()> {
    let dash = Some(Path::new("-"));
    if let Some(path) = &args.json {
        let text = serde_json::to_string_pretty(result).into_diagnostic()? + "\n";
        write(path, &text)?;
    }
    if let Some(path) = &args.jsonl {
        lines.sort_unstable_by_key(|(seed, _)| *seed);
        let text: String = lines.into_iter().map(|(_, line)| line + "\n").collect();
        write(path, &text)?;
    }
    if args.json.as_deref() != dash && args.jsonl.as_deref() != dash {
        crate::show(&result.table());
    }
    Ok(())
}

fn write(path: &Path, text: &str) -> Result<()> {
    if path == Path::new("-") {
        crate::show(text);
        return Ok(());
    }
    std::fs::write(path, text).map_err(|error| {
        miette!(help = "name a file in a folder that exists", "{} cannot be written: {error}", path.display())
    })
}
