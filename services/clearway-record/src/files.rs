//! The files of a recording: one after the other, by size and time, and none while the disk is full.
//!
//! Every file stands for itself: what the recording is about is repeated at its head.

use crate::segment::{Chunking, Segment};
use crate::{Notice, Options, RecordError};
use std::collections::{BTreeMap, VecDeque};
use std::io;
use std::path::{Path, PathBuf};
use std::sync::mpsc::Sender;
use std::time::{Duration, Instant};

/// How often a full disk is looked at again.
const RETRY_EVERY: Duration = Duration::from_secs(1);

/// A file that is attached to every file of the recording.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Enclosure {
    pub(crate) name: String,
    pub(crate) text: String,
}

/// What stands at the head of every file.
#[derive(Debug, Clone, Default)]
pub(crate) struct Preamble {
    pub(crate) facts: BTreeMap<String, String>,
    pub(crate) enclosures: Vec<Enclosure>,
}

/// Name of the metadata at the head of a file.
pub(crate) const FACTS: &str = "clearway.recording";
/// Name of the metadata at the end of a file.
pub(crate) const COUNTS: &str = "clearway.counts";

pub(crate) struct Files {
    options: Options,
    open: Option<Segment>,
    preamble: Preamble,
    /// Number of the next file; 0 is the name that was given.
    next: u32,
    kept: VecDeque<PathBuf>,
    all: Vec<PathBuf>,
    finished_bytes: u64,
    retry: Instant,
    /// Messages that came while no file was open.
    pub(crate) unrecorded: u64,
    notices: Sender<Notice>,
}

/// The file with a number: `run.mcap`, `run-0001.mcap`, …
fn numbered(base: &Path, number: u32) -> PathBuf {
    if number == 0 {
        return base.to_owned();
    }
    let stem = base.file_stem().unwrap_or_default().to_string_lossy();
    let ending = base.extension().map_or(String::new(), |e| format!(".{}", e.to_string_lossy()));
    base.with_file_name(format!("{stem}-{number:04}{ending}"))
}

impl Files {
    /// Makes the first file.
    pub(crate) fn create(options: &Options, notices: Sender<Notice>) -> Result<Self, RecordError> {
        let mut files = Self {
            options: options.clone(),
            open: None,
            preamble: Preamble::default(),
            next: 0,
            kept: VecDeque::new(),
            all: Vec::new(),
            finished_bytes: 0,
            retry: Instant::now(),
            unrecorded: 0,
            notices,
        };
        files.open_next().map_err(|source| {
            let path = options.path.clone();
            if source.kind() == io::ErrorKind::AlreadyExists {
                RecordError::Exists { path }
            } else {
                RecordError::Create { path, source }
            }
        })?;
        Ok(files)
    }

    fn chunking(&self) -> Chunking {
        Chunking {
            bytes: self.options.chunk_bytes,
            every: self.options.flush_every,
            compression: self.options.compression.mcap(),
        }
    }

    fn open_next(&mut self) -> io::Result<()> {
        let path = numbered(&self.options.path, self.next);
        let mut segment = Segment::create(&path, self.options.overwrite, self.chunking())?;
        if !self.preamble.facts.is_empty() {
            write_preamble(&mut segment, &self.preamble, self.next)?;
        }
        self.open = Some(segment);
        self.next += 1;
        self.kept.push_back(path.clone());
        self.all.push(path);
        if let Some(keep) = self.options.keep {
            while self.kept.len() > keep.max(1) {
                if let Some(oldest) = self.kept.pop_front() {
                    let _ = std::fs::remove_file(&oldest);
                    self.all.retain(|path| *path != oldest);
                    let _ = self.notices.send(Notice::Deleted { path: oldest });
                }
            }
        }
        Ok(())
    }

    /// Replaces what stands at the head of files, and says it in the open one as well.
    pub(crate) fn announce(&mut self, preamble: Preamble) {
        self.preamble = preamble;
        let number = self.next.saturating_sub(1);
        if let Some(segment) = &mut self.open
            && let Err(e) = write_preamble(segment, &self.preamble, number)
        {
            self.full(&e);
        }
    }

    /// Samples come: what was there before under the open file's name is replaced.
    pub(crate) fn take_place(&mut self) {
        if let Some(segment) = &mut self.open
            && let Err(e) = segment.take_place()
        {
            self.full(&e);
        }
    }

    /// Takes a message; counts it where there is no file for it.
    pub(crate) fn message(&mut self, topic: &str, tick: u64, time_ns: u64, data: &[u8]) {
        let Some(segment) = &mut self.open else {
            self.unrecorded += 1;
            return;
        };
        if let Err(e) = segment.message(topic, tick, time_ns, data) {
            self.unrecorded += 1;
            self.full(&e);
        }
    }

    /// What has to be done from time to time; whether a file was begun. `counts` go to the end of one
    /// that is finished.
    pub(crate) fn chores(&mut self, counts: impl FnOnce() -> BTreeMap<String, String>) -> bool {
        let Some(segment) = &mut self.open else { return self.try_again() };
        if let Err(e) = segment.flush_if_due() {
            self.full(&e);
            return false;
        }
        let too_large = self.options.max_bytes.is_some_and(|most| segment.len() >= most);
        let too_old = self.options.rotate_every.is_some_and(|most| segment.age() >= most);
        if !(too_large || too_old) {
            return false;
        }
        self.finish(counts());
        match self.open_fresh() {
            Ok(path) => {
                let _ = self.notices.send(Notice::Rotated { path });
                true
            }
            Err(e) => {
                self.full(&e);
                false
            }
        }
    }

    /// The next file whose name is free.
    fn open_fresh(&mut self) -> io::Result<PathBuf> {
        loop {
            match self.open_next() {
                Ok(()) => return Ok(self.all.last().cloned().unwrap_or_default()),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists && self.next < u32::MAX => self.next += 1,
                Err(e) => {
                    // What was begun of it is of no use.
                    let path = numbered(&self.options.path, self.next);
                    if std::fs::metadata(&path).is_ok() {
                        let _ = std::fs::remove_file(path);
                    }
                    return Err(e);
                }
            }
        }
    }

    fn try_again(&mut self) -> bool {
        if self.retry.elapsed() < RETRY_EVERY {
            return false;
        }
        self.retry = Instant::now();
        match self.open_fresh() {
            Ok(path) => {
                let _ = self.notices.send(Notice::Resumed { path, unrecorded: self.unrecorded });
                true
            }
            Err(_) => false,
        }
    }

    /// The disk does not take more: the file is finished in the room that was set aside for that.
    fn full(&mut self, error: &io::Error) {
        let path = self.open.as_ref().map_or_else(PathBuf::new, |segment| segment.path().to_owned());
        let whole = self.finish(BTreeMap::new());
        self.retry = Instant::now();
        let _ = self.notices.send(Notice::DiskFull { path, reason: error.to_string(), whole });
    }

    /// Ends the open file; whether its index was written.
    pub(crate) fn finish(&mut self, counts: BTreeMap<String, String>) -> bool {
        let Some(mut segment) = self.open.take() else { return true };
        if !counts.is_empty() {
            let _ = segment.metadata(COUNTS, counts);
        }
        let (len, path) = (segment.len(), segment.path().to_owned());
        let ended = segment.finish();
        if let Ok(None) = ended {
            // The one that is there is an older one.
            self.all.retain(|one| *one != path);
            self.kept.retain(|one| *one != path);
        }
        self.finished_bytes += ended.as_ref().map_or(len, |len| len.unwrap_or(0));
        ended.is_ok()
    }

    /// Whether messages are being written.
    pub(crate) fn is_open(&self) -> bool {
        self.open.is_some()
    }

    /// Bytes of all files.
    pub(crate) fn bytes(&self) -> u64 {
        self.finished_bytes + self.open.as_ref().map_or(0, Segment::len)
    }

    /// The files that are there.
    pub(crate) fn paths(&self) -> &[PathBuf] {
        &self.all
    }
}

fn write_preamble(segment: &mut Segment, preamble: &Preamble, number: u32) -> io::Result<()> {
    let mut facts = preamble.facts.clone();
    facts.insert("file".to_owned(), number.to_string());
    let time_ns = facts.get("begun_ns").and_then(|text| text.parse().ok()).unwrap_or(0);
    segment.metadata(FACTS, facts)?;
    for enclosure in &preamble.enclosures {
        segment.attach(&enclosure.name, "application/toml", time_ns, enclosure.text.as_bytes())?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_numbered_before_the_ending() {
        let path = |number| numbered(Path::new("/data/run.one.mcap"), number);
        assert_eq!(path(0), Path::new("/data/run.one.mcap"));
        assert_eq!(path(12), Path::new("/data/run.one-0012.mcap"));
        assert_eq!(numbered(Path::new("run"), 1), Path::new("run-0001"));
    }
}
