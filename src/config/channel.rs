use std::path::PathBuf;

/// Where the channels live and how much they can hold.
///
/// The name is part of every file in shared memory, so two settings of `prefix` or `root` are two
/// worlds that do not see each other: tests use their own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelConfig {
    /// First part of the names of all files in shared memory. Default `iox2_`, which is also what
    /// iceoryx2's own tools and other languages expect.
    pub prefix: String,
    /// Directory of the management files. Default `/tmp/iceoryx2/`.
    pub root: PathBuf,
    /// Readers that each channel can have at a time, the daemon's workers among them.
    pub max_readers: usize,
    /// Writers that `observation` can have at a time.
    pub max_observers: usize,
    /// Samples that wait for a reader before the oldest is overwritten. `None`: as many as fit into
    /// 32 MiB of shared memory, from 8 to 64 (from 2 for samples over 1 MiB).
    pub depth: Option<usize>,
}

impl Default for ChannelConfig {
    fn default() -> Self {
        Self {
            prefix: "iox2_".to_owned(),
            root: PathBuf::from("/tmp/iceoryx2/"),
            max_readers: 32,
            max_observers: 64,
            depth: None,
        }
    }
}

impl ChannelConfig {
    /// The same with `CLEARWAY_IOX2_PREFIX` and `CLEARWAY_IOX2_ROOT` from the environment in place
    /// of the prefix and the root, where they are set: a daemon and its clients share them so.
    #[must_use]
    pub fn with_environment(mut self) -> Self {
        if let Ok(prefix) = std::env::var("CLEARWAY_IOX2_PREFIX") {
            self.prefix = prefix;
        }
        if let Some(root) = std::env::var_os("CLEARWAY_IOX2_ROOT") {
            self.root = root.into();
        }
        self
    }
}
