//! What the tests of recordings share: the recorder as a process, a daemon beside it, and the independent
//! reader, PyPI's `mcap`, in an environment of its own.
#![allow(unreachable_pub, reason = "a module of a test")]

use clearway::config::Config;
use clearway::report::Report;
use clearway::runtime::{Daemon, Until};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::Mutex;
use std::time::{Duration, Instant};

use crate::support::World;

/// Far longer than any of this takes; a hang must not hang the suite.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// Calls `what` until it returns something.
pub fn until<T>(mut what: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(found) = what() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("it does not come");
}

/// `clearway` in a world of its own.
pub fn clearway(world: &World, arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_clearway"));
    command.args(arguments);
    isolated(&mut command, world);
    command
}

pub fn isolated(command: &mut Command, world: &World) {
    std::fs::create_dir_all(&world.channel.root).unwrap();
    command
        .env("CLEARWAY_IOX2_PREFIX", &world.channel.prefix)
        .env("CLEARWAY_IOX2_ROOT", &world.channel.root)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
}

/// A recorder that does not outlive its test.
pub struct Recording {
    child: Child,
    lines: BufReader<std::process::ChildStderr>,
}

impl Recording {
    /// Starts it; returns when it waits for the daemon.
    pub fn start(world: &World, out: &Path, more: &[&str]) -> Self {
        let out = out.to_string_lossy();
        Self::spawn(&mut clearway(world, &[&["record", &*out, "--wait", "forever", "--json"], more].concat()))
    }

    pub fn spawn(command: &mut Command) -> Self {
        let mut child = command.spawn().unwrap();
        let lines = BufReader::new(child.stderr.take().unwrap());
        let mut recording = Self { child, lines };
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
        self.child.id()
    }

    pub fn signal(&self, signal: Signal) {
        kill_process(Pid::from_child(&self.child), signal).unwrap();
    }

    /// Waits for its end: the exit status and the summary.
    pub fn finish(mut self) -> (i32, Value) {
        let status = until(|| self.child.try_wait().unwrap());
        let mut out = String::new();
        self.child.stdout.take().unwrap().read_to_string(&mut out).unwrap();
        let mut said = String::new();
        self.lines.read_to_string(&mut said).unwrap();
        let summary = serde_json::from_str(&out).unwrap_or_else(|e| panic!("{e}: {out}{said}"));
        (status.code().unwrap_or(-1), summary)
    }
}

impl Drop for Recording {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
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

/// The independent reader; `None`, and said so, where Python or its packages cannot be had.
pub fn python() -> Option<PathBuf> {
    static MAKING: Mutex<()> = Mutex::new(());
    let _one = MAKING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
    let here = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording");
    let wanted = std::fs::read_to_string(here.join("requirements.txt")).unwrap();
    let place = Path::new(env!("CARGO_TARGET_TMPDIR")).join("recording-venv");
    let (program, made) = (place.join("bin/python"), place.join("made-for.txt"));
    if std::fs::read_to_string(&made).is_ok_and(|text| text == wanted) {
        return Some(program);
    }
    let run = |command: &mut Command| -> Result<(), String> {
        let output = command.output().map_err(|e| e.to_string())?;
        let said = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        if output.status.success() { Ok(()) } else { Err(said) }
    };
    let result = run(Command::new("python3").args(["-m", "venv", "--clear"]).arg(&place)).and_then(|()| {
        run(Command::new(&program)
            .args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check", "-r"])
            .arg(here.join("requirements.txt")))
    });
    match result {
        Ok(()) => {
            std::fs::write(made, wanted).unwrap();
            Some(program)
        }
        Err(reason) => {
            eprintln!("SKIPPED: no independent reader (python3 with venv and pip): {reason}");
            None
        }
    }
}

/// What the independent reader finds in a file.
pub fn read_independently(file: &Path, more: &[&str]) -> Option<Value> {
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/recording/read.py");
    let Output { status, stdout, stderr } =
        Command::new(python()?).arg(script).arg(file).args(more).output().unwrap();
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
