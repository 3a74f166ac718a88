//! One MCAP file: declared topics, small chunks that are flushed, and an end that always fits.

use crate::tape::{Pending, Tape};
use crate::topic::declaration;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use mcap::{Attachment, Compression, McapError, WriteOptions, Writer};
use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::io;
use std::path::Path;
use std::time::{Duration, Instant};

/// Room beside what is counted: the footer, summary offsets, statistics.
const SLACK_BYTES: u64 = 64 << 10;
/// A chunk's entry in the summary, without its channels.
const CHUNK_ENTRY_BYTES: u64 = 128;
/// A channel's part of a chunk's entry and index.
const CHANNEL_ENTRY_BYTES: u64 = 32;

/// How the file is written.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Chunking {
    /// Uncompressed bytes after which a chunk is written.
    pub(crate) bytes: usize,
    /// Time after which it is written at the latest.
    pub(crate) every: Duration,
    pub(crate) compression: Option<Compression>,
}

/// An open file.
pub(crate) struct Segment {
    tape: Tape,
    writer: Writer<NoSeek<Pending>>,
    chunking: Chunking,
    channels: HashMap<String, u16>,
    declared_bytes: u64,
    chunks: u64,
    chunk_bytes: usize,
    opened: Instant,
    flushed: Instant,
}

/// Only the disk can fail: everything else is checked when it is made.
fn as_io(error: McapError) -> io::Error {
    match error {
        McapError::Io(e) => e,
        other => io::Error::other(other),
    }
}

impl Segment {
    /// Makes the file with its header.
    pub(crate) fn create(path: &Path, overwrite: bool, chunking: Chunking) -> io::Result<Self> {
        let mut tape = Tape::create(path, overwrite)?;
        tape.reserve(SLACK_BYTES + chunking.bytes as u64)?;
        let options = WriteOptions::new()
            .library(concat!("clearway-record ", env!("CARGO_PKG_VERSION")))
            .compression(chunking.compression)
            .compression_threads(0)
            // Chunks end when this says so.
            .chunk_size(None)
            .disable_seeking(true);
        let writer = options.create(NoSeek::new(tape.pending())).map_err(as_io)?;
        let now = Instant::now();
        let mut segment = Self {
            tape,
            writer,
            chunking,
            channels: HashMap::new(),
            declared_bytes: 0,
            chunks: 0,
            chunk_bytes: 0,
            opened: now,
            flushed: now,
        };
        segment.flush()?;
        Ok(segment)
    }

    pub(crate) fn path(&self) -> &Path {
        self.tape.path()
    }

    /// Bytes of the file so far.
    pub(crate) fn len(&self) -> u64 {
        self.tape.len() + self.chunk_bytes as u64
    }

    pub(crate) fn age(&self) -> Duration {
        self.opened.elapsed()
    }

    /// Room that must be there before `bytes` more are taken: for them, and for the file's end.
    fn needed(&self, bytes: usize) -> u64 {
        let channels = self.channels.len() as u64 + 2;
        let summary = 2 * self.declared_bytes
            + (self.chunks + 2) * (CHUNK_ENTRY_BYTES + channels * CHANNEL_ENTRY_BYTES)
            + channels * CHANNEL_ENTRY_BYTES;
        // Compression can make noise a little larger.
        let chunk = (self.chunk_bytes + bytes) as u64;
        chunk + chunk / 8 + summary + SLACK_BYTES
    }

    /// Takes one message. On an error the file can still be finished.
    pub(crate) fn message(&mut self, topic: &str, tick: u64, time_ns: u64, data: &[u8]) -> io::Result<()> {
        let new = if self.channels.contains_key(topic) { 0 } else { 16 << 10 };
        self.tape.reserve(self.needed(data.len() + new))?;
        let channel_id = self.channel(topic)?;
        #[expect(clippy::cast_possible_truncation, reason = "the format has 32 bits; readers compare ticks")]
        let sequence = tick as u32;
        let header = MessageHeader { channel_id, sequence, log_time: time_ns, publish_time: time_ns };
        self.writer.write_to_known_channel(&header, data).map_err(as_io)?;
        self.chunk_bytes += data.len() + 31;
        if self.chunk_bytes >= self.chunking.bytes { self.flush() } else { Ok(()) }
    }

    fn channel(&mut self, topic: &str) -> io::Result<u16> {
        if let Some(known) = self.channels.get(topic) {
            return Ok(*known);
        }
        let declared = declaration(topic);
        let schema = self.writer.add_schema(declared.schema, declared.schema_encoding, &declared.data);
        let channel =
            schema.and_then(|id| self.writer.add_channel(id, topic, declared.encoding, &BTreeMap::new()));
        let size = declared.data.len() + 2 * topic.len() + 128;
        self.chunk_bytes += size;
        self.declared_bytes += size as u64;
        let id = channel.map_err(as_io)?;
        self.channels.insert(topic.to_owned(), id);
        Ok(id)
    }

    /// Writes named facts about the recording.
    pub(crate) fn metadata(&mut self, name: &str, facts: BTreeMap<String, String>) -> io::Result<()> {
        let size: usize = facts.iter().map(|(key, value)| key.len() + value.len() + 16).sum();
        self.outside(name.len() + size + 128)?;
        let metadata = Metadata { name: name.to_owned(), metadata: facts };
        self.writer.write_metadata(&metadata).map_err(as_io)?;
        self.flush()
    }

    /// Attaches a whole file.
    pub(crate) fn attach(
        &mut self,
        name: &str,
        media_type: &str,
        time_ns: u64,
        data: &[u8],
    ) -> io::Result<()> {
        self.outside(name.len() + data.len() + 128)?;
        let attachment = Attachment {
            log_time: time_ns,
            create_time: time_ns,
            name: name.to_owned(),
            media_type: media_type.to_owned(),
            data: Cow::Borrowed(data),
        };
        self.writer.attach(&attachment).map_err(as_io)?;
        self.flush()
    }

    /// Makes room for a record between chunks.
    fn outside(&mut self, bytes: usize) -> io::Result<()> {
        self.tape.reserve(self.needed(bytes))?;
        self.declared_bytes += 192;
        Ok(())
    }

    /// Writes the chunk if it is time to.
    pub(crate) fn flush_if_due(&mut self) -> io::Result<()> {
        if self.chunk_bytes > 0 && self.flushed.elapsed() >= self.chunking.every {
            self.flush()
        } else {
            Ok(())
        }
    }

    /// Ends the chunk and writes it: what came until now survives this process.
    pub(crate) fn flush(&mut self) -> io::Result<()> {
        self.chunks += u64::from(self.chunk_bytes > 0);
        self.chunk_bytes = 0;
        self.flushed = Instant::now();
        self.writer.flush().map_err(as_io)?;
        self.tape.commit()
    }

    /// There is something to keep: an older file of this name is replaced.
    pub(crate) fn take_place(&mut self) -> io::Result<()> {
        self.tape.take_place()
    }

    /// Ends the file with its index; its room is set aside. Its length, unless it never took its place.
    pub(crate) fn finish(mut self) -> io::Result<Option<u64>> {
        let end = self.flush().and_then(|()| self.writer.finish().map(|_| ()).map_err(as_io));
        let end = end.and_then(|()| self.tape.commit());
        let len = self.tape.len();
        let closed = self.tape.close();
        end.and(closed).map(|there| there.then_some(len))
    }
}
