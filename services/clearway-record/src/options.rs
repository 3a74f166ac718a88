use std::path::PathBuf;
use std::time::Duration;

/// How chunks are compressed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Compression {
    /// Not at all: least work.
    None,
    /// LZ4: little work.
    Lz4,
    /// Zstandard: smallest files.
    #[default]
    Zstd,
}

impl Compression {
    pub(crate) fn mcap(self) -> Option<mcap::Compression> {
        match self {
            Self::None => None,
            Self::Lz4 => Some(mcap::Compression::Lz4),
            Self::Zstd => Some(mcap::Compression::Zstd),
        }
    }
}

/// What is recorded where.
#[derive(Debug, Clone)]
pub struct Options {
    /// The first file; the following ones get a number.
    pub path: PathBuf,
    /// Whether files that exist are replaced.
    pub overwrite: bool,
    /// Size after which the next file is begun, bytes.
    pub max_bytes: Option<u64>,
    /// Time after which the next file is begun.
    pub rotate_every: Option<Duration>,
    /// Files that are kept; the oldest are deleted.
    pub keep: Option<usize>,
    /// Compression of the chunks.
    pub compression: Compression,
    /// Uncompressed size of a chunk, bytes.
    pub chunk_bytes: usize,
    /// Time after which a chunk is written at the latest.
    pub flush_every: Duration,
    /// Rate at most of what is only there to be looked at, Hz; 0: none of it.
    pub view_hz: f64,
    /// Robots up to which each gets topics of its own.
    pub robot_topics_max: usize,
    /// Samples that wait for the disk at most, bytes.
    pub queue_bytes: usize,
    /// How long to wait for the daemon to appear; `None`: for ever.
    pub patience: Option<Duration>,
    /// How long to record; `None`: until it is stopped.
    pub duration: Option<Duration>,
    /// Whether the recording ends with the daemon's run, or waits for the next.
    pub once: bool,
}

impl Options {
    /// The defaults for the file at `path`.
    pub fn new(path: PathBuf) -> Self {
        Self {
            path,
            overwrite: false,
            max_bytes: Some(256 << 20),
            rotate_every: None,
            keep: None,
            compression: Compression::default(),
            chunk_bytes: 64 << 10,
            flush_every: Duration::from_millis(200),
            view_hz: 30.0,
            robot_topics_max: 64,
            queue_bytes: 64 << 20,
            patience: Some(Duration::from_secs(10)),
            duration: None,
            once: false,
        }
    }
}
