use std::path::PathBuf;

/// What is kept over a restart, and when restarts are too many.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JournalConfig {
    /// The file; `None`: nothing is kept.
    pub path: Option<PathBuf>,
    /// Begin as the scenario says, whatever the file holds. Not a key.
    pub fresh: bool,
    /// The restart after a crash that brings the fleet up stopped, counted within the time below; 0: none
    /// does.
    pub restarts: u32,
    /// The time in which restarts count, ns.
    pub restarts_within_ns: u64,
}

impl Default for JournalConfig {
    fn default() -> Self {
        Self { path: None, fresh: false, restarts: 3, restarts_within_ns: 60_000_000_000 }
    }
}
