//! `clearway replay`: every recorded command computed again.

mod report;

use clearway::config::Config;
use clearway_record::replay::{Outcome, Replay, ReplayError};
use clearway_record::{Configurations, Ending, Piece, ReadError, Reading};
use indicatif::{ProgressBar, ProgressStyle};
use serde::Serialize;
use std::collections::BTreeMap;
use std::io::IsTerminal;
use std::path::PathBuf;
use std::time::{Duration, Instant};

/// Compute every recorded command again and compare it bit by bit.
///
/// Needs the recording alone: it holds the states, what the controllers remembered before each period,
/// and the configuration. Commands that no controller decided (late ones, an operator's stop) are
/// counted by their reason. Several files of one recording are read as one, in the order given.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway replay run.mcap
  clearway replay run.mcap run-0001.mcap run-0002.mcap
  clearway replay run.mcap --json | jq .first_difference
  clearway replay old.mcap --config fleet.toml      where the recording has none

Exit codes: 0 every command that was compared is equal to the bit, 1 one differs
or none could be compared, 2 the command line or a file is wrong or damaged.")]
pub(crate) struct Args {
    /// The recording: one file, or several in their order.
    #[arg(required = true, value_name = "IN.mcap")]
    files: Vec<PathBuf>,
    /// The daemon's configuration, in place of the one in the recording.
    #[arg(long, value_name = "FILE")]
    config: Option<PathBuf>,
    /// The daemon's scenario, in place of the one in the recording.
    #[arg(long, value_name = "FILE|NAME")]
    scenario: Option<String>,
    /// Any key of the configuration, as section.key=value; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
    /// Print the result as JSON.
    #[arg(long)]
    json: bool,
}

/// What a file was like.
#[derive(Debug, Clone, Serialize)]
struct FileReport {
    file: PathBuf,
    /// Whether it ends with its index.
    whole: bool,
    /// The version of the program that recorded it.
    version: Option<String>,
    /// What the recorder said it lost until the file was ended.
    counts: BTreeMap<String, String>,
}

/// Everything that is told.
#[derive(Debug, Serialize)]
struct Told {
    equal: bool,
    #[serde(flatten)]
    outcome: Outcome,
    files: Vec<FileReport>,
    /// Where the configuration came from.
    configuration: &'static str,
}

impl Args {
    /// The configuration of the command line; `None` when it names none.
    fn configuration(&self) -> miette::Result<Option<Config>> {
        if self.config.is_none() && self.scenario.is_none() && self.settings.is_empty() {
            return Ok(None);
        }
        let mut overrides = self.settings.clone();
        overrides.extend(self.scenario.iter().map(|scenario| format!("scenario={scenario}")));
        Ok(Some(Config::with_overrides(self.config.as_deref(), &overrides)?))
    }
}

/// Something differs, or nothing could be compared.
const DIFFERENT: u8 = 1;
/// A file is wrong or damaged.
const WRONG_FILE: u8 = 2;

/// Replays the files; the exit status.
pub(crate) fn run(args: &Args) -> miette::Result<u8> {
    let given = args.configuration()?;
    let source = if given.is_some() { "command line" } else { "recording" };
    let mut player = Player {
        given,
        enclosed: Configurations::default(),
        replay: None,
        configured: None,
        early: Vec::new(),
    };
    let mut files = Vec::new();
    let mut damage = None;
    let progress = Progress::new(&args.files);
    for path in &args.files {
        let mut reading = Reading::open(path)?;
        let mut report =
            FileReport { file: path.clone(), whole: false, version: None, counts: BTreeMap::new() };
        loop {
            match reading.next() {
                Ok(Some(piece)) => player.take(piece, &mut report)?,
                Ok(None) => break,
                Err(error @ ReadError::Damaged { .. }) => {
                    damage = Some(error);
                    break;
                }
                Err(error) => return Err(error.into()),
            }
            progress.show(&reading);
        }
        report.whole = reading.ending() == Some(Ending::Whole);
        progress.file_done(&reading);
        files.push(report);
        if damage.is_some() {
            break;
        }
    }
    progress.finish();
    let outcome = match player.replay {
        Some(replay) => replay.finish()?,
        None => Outcome::default(),
    };
    let result = Told { equal: outcome.is_equal(), outcome, files, configuration: source };
    if args.json {
        crate::show(&report::json(&result)?);
    } else {
        crate::show(&report::text(&result));
    }
    if let Some(error) = damage {
        eprintln!("{:?}", miette::Report::new(error));
        return Ok(WRONG_FILE);
    }
    Ok(if result.equal { 0 } else { DIFFERENT })
}

/// Builds the replay when the first state comes, with the configuration of its epoch.
struct Player {
    given: Option<Config>,
    enclosed: Configurations,
    replay: Option<Replay>,
    configured: Option<u64>,
    early: Vec<Piece>,
}

/// Pieces before the first state that are kept for it.
const EARLY_MAX: usize = 1000;

impl Player {
    fn take(&mut self, piece: Piece, report: &mut FileReport) -> miette::Result<()> {
        match &piece {
            Piece::Facts(facts) => {
                report.version = facts.get("clearway_version").cloned();
                return Ok(());
            }
            Piece::Counts(counts) => {
                report.counts.clone_from(counts);
                return Ok(());
            }
            Piece::Enclosed { name, text } => {
                self.enclosed.add(name, text);
                return Ok(());
            }
            Piece::State(state) if self.configured != Some(state.header.epoch) => {
                let epoch = state.header.epoch;
                let config = match &self.given {
                    Some(config) => Some(config.clone()),
                    None => self.enclosed.of(epoch)?,
                };
                let config = config.ok_or(ReplayError::NoConfiguration)?;
                match &mut self.replay {
                    Some(replay) => replay.configure(config)?,
                    None => self.replay = Some(Replay::new(config)?),
                }
                self.configured = Some(epoch);
            }
            _ => {}
        }
        let Some(replay) = &mut self.replay else {
            // A first command comes before the first state.
            if self.early.len() < EARLY_MAX {
                self.early.push(piece);
            }
            return Ok(());
        };
        for early in self.early.drain(..) {
            replay.take(early)?;
        }
        Ok(replay.take(piece)?)
    }
}

/// A bar once it takes longer than two seconds.
struct Progress {
    bar: Option<ProgressBar>,
    started: Instant,
    before: std::cell::Cell<u64>,
    looked: std::cell::Cell<Instant>,
}

impl Progress {
    fn new(files: &[PathBuf]) -> Self {
        let total =
            files.iter().filter_map(|path| std::fs::metadata(path).ok()).map(|about| about.len()).sum();
        let bar = std::io::stderr().is_terminal().then(|| {
            let bar = ProgressBar::hidden();
            bar.set_length(total);
            if let Ok(style) = ProgressStyle::with_template("{bar:40} {percent} %  {eta} left") {
                bar.set_style(style);
            }
            bar
        });
        let now = Instant::now();
        Self { bar, started: now, before: 0.into(), looked: now.into() }
    }

    fn show(&self, reading: &Reading) {
        let Some(bar) = &self.bar else { return };
        if self.looked.get().elapsed() < Duration::from_millis(100) {
            return;
        }
        self.looked.set(Instant::now());
        if bar.is_hidden() && self.started.elapsed() > Duration::from_secs(2) {
            bar.set_draw_target(indicatif::ProgressDrawTarget::stderr());
        }
        bar.set_position(self.before.get() + reading.offset());
    }

    fn file_done(&self, reading: &Reading) {
        self.before.set(self.before.get() + reading.size());
    }

    fn finish(&self) {
        if let Some(bar) = &self.bar {
            bar.finish_and_clear();
        }
    }
}
