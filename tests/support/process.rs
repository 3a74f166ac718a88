//! Processes of a test: in its world, bounded in time, ended by their id and none that outlives it.
//!
//! And [`skipped`], for a test that needs what is not here.

use std::io::{Read, Write};
use std::path::Path;
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};

use super::World;

/// Far longer than any of this takes; a hang must not hang the suite.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// Calls `look` until it finds something.
pub fn until<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(found) = look() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(2));
    }
    panic!("nothing came");
}

/// Puts `command` into `world`, with nothing to read and its output to be read.
pub fn isolated(command: &mut Command, world: &World) {
    std::fs::create_dir_all(&world.channel.root).unwrap();
    command
        .env("CLEARWAY_IOX2_PREFIX", &world.channel.prefix)
        .env("CLEARWAY_IOX2_ROOT", &world.channel.root)
        .current_dir(&world.channel.root)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
}

/// `program` in `world`.
pub fn within(world: &World, program: &Path, arguments: &[&str]) -> Command {
    let mut command = Command::new(program);
    command.args(arguments);
    isolated(&mut command, world);
    command
}

/// A file in `world`.
pub fn file(world: &World, name: &str, text: &str) -> String {
    std::fs::create_dir_all(&world.channel.root).unwrap();
    let path = world.channel.root.join(name);
    std::fs::write(&path, text).unwrap();
    path.to_string_lossy().into_owned()
}

/// What a process said.
pub fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Says that a test does not run, and why; past the test harness, which would keep it to itself.
pub fn skipped(test: &str, reason: &str) {
    let _ = writeln!(std::io::stderr(), "SKIPPED: {test}: {reason}");
}

/// A process that does not outlive its test.
pub struct Process(pub Child);

impl Process {
    pub fn start(mut command: Command) -> Self {
        Self(command.spawn().unwrap())
    }

    pub fn id(&self) -> Pid {
        Pid::from_child(&self.0)
    }

    pub fn signal(&self, signal: Signal) {
        kill_process(self.id(), signal).unwrap();
    }

    /// Ends it as no process can resist.
    pub fn kill(mut self) {
        self.signal(Signal::KILL);
        self.wait();
    }

    /// Ends it the same way, if it has not ended by itself.
    pub fn end(&mut self) {
        let _ = self.0.kill();
        self.wait();
    }

    pub fn wait(&mut self) -> ExitStatus {
        until(|| self.0.try_wait().unwrap())
    }

    /// Stops it, and returns when it stands.
    pub fn pause(&self) {
        self.signal(Signal::STOP);
        let stat = format!("/proc/{}/stat", self.0.id());
        until(|| {
            std::fs::read_to_string(&stat).unwrap().rsplit(')').next()?.trim().starts_with('T').then_some(())
        });
    }

    /// Waits for its end. What it said has to fit into a pipe.
    pub fn output(mut self) -> Output {
        let status = self.wait();
        let (mut stdout, mut stderr) = (Vec::new(), Vec::new());
        if let Some(mut pipe) = self.0.stdout.take() {
            pipe.read_to_end(&mut stdout).unwrap();
        }
        if let Some(mut pipe) = self.0.stderr.take() {
            pipe.read_to_end(&mut stderr).unwrap();
        }
        Output { status, stdout, stderr }
    }

    /// Asserts that it ends by itself, and well.
    pub fn succeed(self) {
        let run = self.output();
        assert_eq!(run.status.code(), Some(0), "{}{}", text(&run.stdout), text(&run.stderr));
    }
}

impl Drop for Process {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}
