//! Processes that take part: this program once more, with a hidden subcommand.
//!
//! A child says on standard output when it is ready, and at the end what it found, a line of JSON each.
//! It ends when its standard input closes, which happens when its parent ends it and also when the
//! parent dies, and at its time limit.

use std::io::{BufRead, BufReader, Read};
use std::process::{Child as Process, ChildStdin, ChildStdout, Command, Stdio};
use std::time::{Duration, Instant};

use clearway::channel::Transport;
use clearway::config::ChannelConfig;
use clearway::figures::LatencyHistogram;
use clearway_signals::Stop;
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};

use super::world::{Interrupt, World};
use super::{control, load, transfer};

/// How long a child may take to end by itself.
const PATIENCE: Duration = Duration::from_secs(3);

/// What a child is to do.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub(super) enum Role {
    /// Answers every state with a command.
    Echo,
    /// Reads a daemon's commands.
    Reader(control::ReaderTask),
    /// Disturbs.
    Load(load::Disturbance),
}

/// Everything that a child needs to know.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Task {
    pub(super) role: Role,
    pub(super) prefix: String,
    pub(super) root: std::path::PathBuf,
    /// CPU and real-time priority; 0 for none.
    pub(super) cpu: Option<usize>,
    pub(super) priority: u8,
    /// Longest that it may live.
    pub(super) limit_s: u64,
}

impl Task {
    pub(super) fn new(world: &World, role: Role, cpu: Option<usize>, priority: u8, limit: Duration) -> Self {
        let ChannelConfig { prefix, root, .. } = world.channel.clone();
        Self { role, prefix, root, cpu, priority, limit_s: limit.as_secs() + 5 }
    }

    pub(super) fn transport(&self, fleet: &str) -> Result<Transport> {
        let channel = ChannelConfig {
            prefix: self.prefix.clone(),
            root: self.root.clone(),
            ..ChannelConfig::default()
        };
        Ok(Transport::new(fleet, &channel)?)
    }
}

/// What a child was refused, said when it is ready.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Ready {
    pub(super) refused: Vec<String>,
}

/// What a child found.
#[derive(Debug, Default, Serialize, Deserialize)]
pub(super) struct Findings {
    /// Histograms by name: their steps, ns, with counts.
    pub(super) histograms: Vec<(String, Vec<(u64, u64)>)>,
    /// Counts by name.
    pub(super) counts: Vec<(String, u64)>,
}

impl Findings {
    pub(super) fn add(&mut self, name: &str, histogram: &LatencyHistogram) {
        self.histograms.push((name.to_owned(), histogram.steps().collect()));
    }

    pub(super) fn histogram(&self, name: &str) -> Result<LatencyHistogram> {
        let mut histogram = LatencyHistogram::new().into_diagnostic()?;
        for (_, steps) in self.histograms.iter().filter(|(known, _)| known == name) {
            for (ns, count) in steps {
                histogram.record_many(*ns, *count);
            }
        }
        Ok(histogram)
    }

    pub(super) fn count(&self, name: &str) -> u64 {
        self.counts.iter().filter(|(known, _)| known == name).map(|(_, count)| count).sum()
    }
}

/// A running child; ended when it is dropped.
#[derive(Debug)]
pub(super) struct Child {
    process: Process,
    stdin: Option<ChildStdin>,
    stdout: BufReader<ChildStdout>,
}

impl Child {
    /// Starts one, and waits until it is ready.
    pub(super) fn start(task: &Task) -> Result<(Self, Ready)> {
        let program = std::env::current_exe().into_diagnostic()?;
        let mut process = Command::new(program)
            .args(["bench", "latency-process"])
            .arg(serde_json::to_string(task).into_diagnostic()?)
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .into_diagnostic()
            .wrap_err("a second process cannot be started")?;
        let (stdin, stdout) = (process.stdin.take(), process.stdout.take());
        let stdout = stdout.ok_or_else(|| miette!("a second process without a standard output"))?;
        let mut child = Self { process, stdin, stdout: BufReader::new(stdout) };
        let ready = child.line()?;
        Ok((child, ready))
    }

    /// Ends it, and returns what it found.
    pub(super) fn finish(mut self) -> Result<Findings> {
        self.stdin = None;
        self.line()
    }

    fn line<T: DeserializeOwned>(&mut self) -> Result<T> {
        let mut text = String::new();
        self.stdout.read_line(&mut text).into_diagnostic()?;
        serde_json::from_str(&text)
            .into_diagnostic()
            .wrap_err("a second process ended early; its reason is above")
    }
}

impl Drop for Child {
    fn drop(&mut self) {
        self.stdin = None;
        let end = Instant::now() + PATIENCE;
        while Instant::now() < end {
            if !matches!(self.process.try_wait(), Ok(None)) {
                return;
            }
            std::thread::sleep(Duration::from_millis(2));
        }
        let _ = self.process.kill();
        let _ = self.process.wait();
    }
}

/// The hidden subcommand.
#[derive(Debug, clap::Args)]
pub(crate) struct ProcessArgs {
    task: String,
}

/// What a child runs.
pub(crate) fn run(args: &ProcessArgs) -> Result<()> {
    let task: Task = serde_json::from_str(&args.task).into_diagnostic()?;
    let over = Stop::listen_to_parent().into_diagnostic()?;
    watch(&over, Duration::from_secs(task.limit_s));
    let over = Interrupt::by(over);
    let findings = match &task.role {
        Role::Echo => transfer::echo_process(&task, &over)?,
        Role::Reader(reader) => control::read_commands(&task, *reader, &over)?,
        Role::Load(disturbance) => load::disturb(&task, *disturbance, &over)?,
    };
    say(&findings)
}

/// Tells the parent that everything is in place.
pub(super) fn say_ready(refused: Vec<String>) -> Result<()> {
    say(&Ready { refused })
}

fn say(line: &impl Serialize) -> Result<()> {
    crate::show(&(serde_json::to_string(line).into_diagnostic()? + "\n"));
    Ok(())
}

/// Sets `over` when standard input closes, and at the limit.
fn watch(over: &Stop, limit: Duration) {
    let closed = over.clone();
    std::thread::spawn(move || {
        let mut rest = Vec::new();
        let _ = std::io::stdin().read_to_end(&mut rest);
        closed.ask();
    });
    let late = over.clone();
    std::thread::spawn(move || {
        std::thread::sleep(limit);
        late.ask();
    });
}
