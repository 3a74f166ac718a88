//! A place in shared memory of the benchmark's own.

use std::fs::{File, OpenOptions, TryLockError};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clearway::config::ChannelConfig;
use clearway_signals::{Again, Stop};
use miette::{IntoDiagnostic, Result, WrapErr, miette};

const SHARED_MEMORY: &str = "/dev/shm";
const NAME: &str = "clearway_bench_";

/// Two of these at a time would measure each other. Held until the end of the process.
#[derive(Debug)]
pub(super) struct Turn(#[expect(dead_code, reason = "held")] Option<File>);

impl Turn {
    /// Waits for the benchmark that runs, if one does.
    pub(super) fn wait(interrupt: &Interrupt) -> Result<Self> {
        let path = std::env::temp_dir().join("clearway_bench.lock");
        let made = || OpenOptions::new().write(true).create(true).truncate(false).open(&path);
        // Another user's can be read and locked all the same. Without a file everybody is alone.
        let Ok(file) = File::open(&path).or_else(|_| made()) else { return Ok(Self(None)) };
        let mut told = false;
        while matches!(file.try_lock(), Err(TryLockError::WouldBlock)) {
            if !std::mem::replace(&mut told, true) {
                eprintln!("waiting for another `clearway bench latency` to end");
            }
            interrupt.check()?;
            std::thread::sleep(Duration::from_millis(20));
        }
        Ok(Self(Some(file)))
    }
}

/// A prefix and a directory that nobody else uses, empty again at the end.
#[derive(Debug)]
pub(super) struct World {
    pub(super) channel: ChannelConfig,
}

impl World {
    pub(super) fn new() -> Result<Self> {
        sweep(&std::env::temp_dir());
        let root = std::env::temp_dir().join(format!("{NAME}{}", std::process::id()));
        std::fs::create_dir_all(&root)
            .into_diagnostic()
            .wrap_err_with(|| format!("{} cannot be made", root.display()))?;
        let prefix = format!("{NAME}{}_", std::process::id());
        Ok(Self { channel: ChannelConfig { prefix, root, ..ChannelConfig::default() } })
    }
}

impl Drop for World {
    fn drop(&mut self) {
        remove(&self.channel.root, &self.channel.prefix);
    }
}

fn remove(root: &Path, prefix: &str) {
    for file in entries(Path::new(SHARED_MEMORY), prefix) {
        let _ = std::fs::remove_file(file);
    }
    let _ = std::fs::remove_dir_all(root);
}

/// Removes what benchmarks that were killed left behind.
fn sweep(temporary: &Path) {
    for root in entries(temporary, NAME) {
        let pid = root.file_name().and_then(|name| name.to_str()?.strip_prefix(NAME)?.parse::<u32>().ok());
        if let Some(pid) = pid.filter(|pid| !Path::new(&format!("/proc/{pid}")).exists()) {
            remove(&root, &format!("{NAME}{pid}_"));
        }
    }
}

fn entries(directory: &Path, prefix: &str) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(directory) else { return Vec::new() };
    let named =
        |path: &PathBuf| path.file_name().is_some_and(|name| name.to_string_lossy().starts_with(prefix));
    entries.flatten().map(|entry| entry.path()).filter(named).collect()
}

/// Set by the first SIGINT or SIGTERM, so that everything that was started is ended; a second one ends
/// this process at once, and what it started follows when its standard input closes.
#[derive(Debug, Clone)]
pub(super) struct Interrupt(Stop);

impl Interrupt {
    pub(super) fn listen() -> Result<Self> {
        Stop::listen(Again::Ends).map(Self).into_diagnostic()
    }

    /// A flag that another part of the program sets.
    pub(super) fn by(stop: Stop) -> Self {
        Self(stop)
    }

    pub(super) fn is_set(&self) -> bool {
        self.0.is_asked()
    }

    /// An error once it is set.
    pub(super) fn check(&self) -> Result<()> {
        if self.is_set() {
            Err(miette!("interrupted; what was started is ended, nothing is reported"))
        } else {
            Ok(())
        }
    }
}
