//! What the tests of recordings share: the recorder as a process, a daemon beside it, and the independent
//! reader, PyPI's `mcap`, in an environment of its own.
#![allow(unreachable_pub, reason = "a module of a test")]

use clearway::config::Config;
use clearway::report::Report;
use clearway::runtime::{Daemon, Until};
use rustix::process::Signal;
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;
use std::process::{Command, Output};

use crate::support::World;
use crate::support::process::{Process, within};
use crate::support::python::python;

/// `clearway` in a world of its own.
pub fn clearway(world: &World, arguments: &[&str]) -> Command {
    within(world, Path::new(env!("CARGO_BIN_EXE_clearway")), arguments)
}

/// A recorder that does not outlive its test.
pub struct Recording {
    process: Process,
    lines: BufReader<std::process::ChildStderr>,
}

impl Recording {
    /// Starts it; returns when it waits for the daemon.
    pub fn start(world: &World, out: &Path, more: &[&str]) -> Self {
        let out = out.to_string_lossy();
        Self::spawn(clearway(world, &[&["record", &*out, "--wait", "forever", "--json"], more].concat()))
    }

    pub fn spawn(command: Command) -> Self {
        let mut process = Process::start(command);
        let lines = BufReader::new(process.0.stderr.take().unwrap());
        let mut recording = Self { process, lines };
        recording.line("waiting for the daemon");
        recording
    }

    /// Reads what it says until a line contains `words`.
    pub fn line(&mut self, words: &str) -> String {
        let mut said = String::new();
        loop {
            let mut line = String::new();
            let read = self.lines.read_line(&mut line).unwrap();
            assert!(read > 0, "it ended without saying {words:?}: {said}");
            said.push_str(&line);
            if line.contains(words) {
                return line;
            }
        }
    }

    pub fn pid(&self) -> u32 {
        self.process.0.id()
    }

    pub fn signal(&self, signal: Signal) {
        self.process.signal(signal);
    }

    /// Waits for its end: the exit status and the summary.
    pub fn finish(mut self) -> (i32, Value) {
        let status = self.process.wait();
        let mut out = String::new();
        self.process.0.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        let mut said = String::new();
        self.lines.read_to_string(&mut said).unwrap();
        let summary = serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}{said}"));
        (status.code().unwrap_or(-1), summary)
    }
}

/// Lets a daemon run to its end.
pub fn drive(config: &Config, until: Until) -> Report {
    let daemon = Daemon::start(config.clone(), until).unwrap();
    daemon.join().unwrap()
}

/// What `clearway replay --json` says, and its exit status.
pub fn replay(world: &World, files: &[&Path], more: &[&str]) -> (i32, Value) {
    let files: Vec<_> = files.iter().map(|file| file.to_string_lossy().into_owned()).collect();
    let files: Vec<&str> = files.iter().map(String::as_str).collect();
    let output = clearway(world, &[&["replay", "--json"], &files[..], more].concat()).output().unwrap();
    let text = String::from_utf8(output.stdout).unwrap();
    let value = serde_json::from_str(&text).unwrap_or_else(|e| {
        panic!("{e}: {text}{}", String::from_utf8_lossy(&output.stderr));
    });
    (output.status.code().unwrap_or(-1), value)
}

/// What the independent reader finds in a file; `None`, and said so, where it cannot be had.
pub fn read_independently(file: &Path, more: &[&str]) -> Option<Value> {
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording");
    let (place, requirements) = (Path::new(env!("CARGO_TARGET_TMPDIR")), here.join("requirements.txt"));
    let python = python(place, "recording-venv", &requirements)?;
    let script = here.join("read.py");
    let Output { status, stdout, stderr } =
        Command::new(python).arg(script).arg(file).args(more).output().unwrap();
    assert!(status.success(), "{}", String::from_utf8_lossy(&stderr));
    Some(serde_json::from_slice(&stdout).unwrap())
}

/// The ticks of a topic.
pub fn ticks(found: &Value, topic: &str) -> Vec<u64> {
    let mut ticks: Vec<u64> =
        found["ticks"][topic].as_array().unwrap().iter().map(|tick| tick.as_u64().unwrap()).collect();
    ticks.sort_unstable();
    ticks
}

/// A channel of the summary's newest run.
pub fn channel<'a>(summary: &'a Value, name: &str) -> &'a Value {
    let runs = summary["runs"].as_array().unwrap();
    let channels = runs[runs.len() - 1]["channels"].as_array().unwrap();
    channels.iter().find(|channel| channel["channel"] == name).unwrap()
}
