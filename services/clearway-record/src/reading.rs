//! Reads a recording back, piece by piece, also one whose end is missing.

use crate::convert::{Checkpoint, Command, State, Telemetry};
use crate::files::{COUNTS, FACTS};
use crate::schema::clearway as proto;
use crate::topic;
use mcap::McapError;
use mcap::records::Record;
use mcap::sans_io::{LinearReadEvent, LinearReader, LinearReaderOptions};
use miette::Diagnostic;
use prost::Message;
use std::collections::{BTreeMap, HashMap};
use std::fs::File;
use std::io::Read;
use std::path::{Path, PathBuf};
use thiserror::Error;

/// No record of ours is that long; a damaged length is not believed.
const RECORD_BYTES_MAX: usize = 256 << 20;

/// Why a recording could not be read.
#[derive(Debug, Error, Diagnostic)]
pub enum ReadError {
    /// The file could not be opened or read.
    #[error("{} cannot be read: {source}", .path.display())]
    #[diagnostic(help("check the name and the permissions"))]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the system says.
        source: std::io::Error,
    },

    /// It is something else.
    #[error("{} is not an MCAP file", .path.display())]
    #[diagnostic(help("give a file that `clearway record` wrote"))]
    NotMcap {
        /// The file.
        path: PathBuf,
    },

    /// It was written by another program.
    #[error("{} is an MCAP file without Clearway's topics", .path.display())]
    #[diagnostic(help("give a file that `clearway record` wrote; it holds the topic /clearway/state"))]
    Foreign {
        /// The file.
        path: PathBuf,
    },

    /// Bytes have changed since it was written.
    #[error("{} is damaged near byte {offset}, after tick {}: {reason}", .path.display(),
        .tick.map_or_else(|| "none".to_owned(), |tick| tick.to_string()))]
    #[diagnostic(help("what stands before that place was read; restore the file from a copy for the rest"))]
    Damaged {
        /// The file.
        path: PathBuf,
        /// How far it was read, bytes.
        offset: u64,
        /// The last state before.
        tick: Option<u64>,
        /// What does not fit.
        reason: String,
    },
}

/// A piece of a recording.
#[derive(Debug, Clone, PartialEq)]
pub enum Piece {
    /// What the recording is about: the fleet, the version, the epoch.
    Facts(BTreeMap<String, String>),
    /// What was lost until the file was ended.
    Counts(BTreeMap<String, String>),
    /// A file that was attached.
    Enclosed {
        /// Its name.
        name: String,
        /// Its text.
        text: String,
    },
    /// A sample of `state`.
    State(State),
    /// A sample of `command`.
    Command(Command),
    /// A sample of `telemetry`.
    Telemetry(Telemetry),
    /// A sample of `checkpoint`.
    Checkpoint(Checkpoint),
}

/// How a file ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ending {
    /// With its index: it was closed.
    Whole,
    /// In the middle: the recorder was killed, or the disk was full. Everything before was read.
    CutOff,
}

/// Reads one file from its beginning. Memory is bounded by its largest chunk.
pub struct Reading<R = File> {
    path: PathBuf,
    file: R,
    reader: LinearReader,
    channels: HashMap<u16, String>,
    offset: u64,
    size: u64,
    tick: Option<u64>,
    ours: bool,
    ending: Option<Ending>,
}

impl Reading {
    /// Opens the file.
    ///
    /// # Errors
    /// [`ReadError::Unreadable`].
    pub fn open(path: &Path) -> Result<Self, ReadError> {
        let unreadable = |source| ReadError::Unreadable { path: path.to_owned(), source };
        let file = File::open(path).map_err(unreadable)?;
        let about = file.metadata().map_err(unreadable)?;
        Ok(Self::of(path, file, about.len()))
    }
}

impl<R: Read> Reading<R> {
    /// Reads the `size` bytes of `file`, which errors call `path`.
    pub fn of(path: &Path, file: R, size: u64) -> Self {
        let options = LinearReaderOptions::default()
            .with_prevalidate_chunk_crcs(true)
            .with_record_length_limit(RECORD_BYTES_MAX);
        Self {
            path: path.to_owned(),
            file,
            reader: LinearReader::new_with_options(options),
            channels: HashMap::new(),
            offset: 0,
            size,
            tick: None,
            ours: false,
            ending: None,
        }
    }

    /// How it ended; `None` before the end.
    pub fn ending(&self) -> Option<Ending> {
        self.ending
    }

    /// Share of the file that was read.
    pub fn done(&self) -> f64 {
        if self.size == 0 { 1.0 } else { self.offset as f64 / self.size as f64 }
    }

    /// Bytes of the file.
    pub fn size(&self) -> u64 {
        self.size
    }

    /// Bytes read so far.
    pub fn offset(&self) -> u64 {
        self.offset
    }

    /// The next piece; `None` at the end.
    ///
    /// # Errors
    /// [`ReadError`]. A file that is cut off ends where it was cut.
    #[expect(clippy::should_implement_trait, reason = "the end of the file has to be looked at")]
    pub fn next(&mut self) -> Result<Option<Piece>, ReadError> {
        while self.ending.is_none() {
            let Some(event) = self.reader.next_event() else {
                return self.end(Ending::Whole);
            };
            match event {
                Ok(LinearReadEvent::ReadRequest(wanted)) => {
                    let read = self.file.read(self.reader.insert(wanted));
                    let read = match read {
                        Ok(read) => read,
                        Err(e) if e.kind() == std::io::ErrorKind::Interrupted => continue,
                        Err(source) => return Err(ReadError::Unreadable { path: self.path.clone(), source }),
                    };
                    self.offset += read as u64;
                    self.reader.notify_read(read);
                }
                Ok(LinearReadEvent::Record { data, opcode }) => {
                    let piece = mcap::parse_record(opcode, data)
                        .map_err(|e| e.to_string())
                        .and_then(|record| interpret(&mut self.channels, &mut self.ours, record));
                    match piece {
                        Ok(None) => {}
                        Ok(Some(piece)) => {
                            if let Piece::State(state) = &piece {
                                self.tick = Some(state.header.tick);
                            }
                            return Ok(Some(piece));
                        }
                        Err(reason) => return Err(self.damaged(reason)),
                    }
                }
                Err(McapError::BadMagic) if self.channels.is_empty() && !self.ours => {
                    return Err(ReadError::NotMcap { path: self.path.clone() });
                }
                Err(McapError::UnexpectedEof | McapError::UnexpectedEoc) if self.offset >= self.size => {
                    if self.offset < mcap::MAGIC.len() as u64 {
                        return Err(ReadError::NotMcap { path: self.path.clone() });
                    }
                    return self.end(Ending::CutOff);
                }
                Err(e) => {
                    let reason = e.to_string();
                    return Err(self.damaged(reason));
                }
            }
        }
        Ok(None)
    }

    fn end(&mut self, ending: Ending) -> Result<Option<Piece>, ReadError> {
        self.ending = Some(ending);
        if self.ours { Ok(None) } else { Err(ReadError::Foreign { path: self.path.clone() }) }
    }

    fn damaged(&mut self, reason: String) -> ReadError {
        self.ending = Some(Ending::CutOff);
        ReadError::Damaged { path: self.path.clone(), offset: self.offset, tick: self.tick, reason }
    }
}

/// A record of the file as a piece of a recording, if it is one.
fn interpret(
    channels: &mut HashMap<u16, String>,
    ours: &mut bool,
    record: Record<'_>,
) -> Result<Option<Piece>, String> {
    match record {
        Record::Channel(channel) => {
            *ours |= channel.topic == topic::STATE;
            channels.insert(channel.id, channel.topic);
        }
        Record::Metadata(metadata) if metadata.name == FACTS => {
            *ours = true;
            return Ok(Some(Piece::Facts(metadata.metadata)));
        }
        Record::Metadata(metadata) if metadata.name == COUNTS => {
            return Ok(Some(Piece::Counts(metadata.metadata)));
        }
        Record::Attachment { header, data, .. } => {
            let text = String::from_utf8(data.into_owned()).map_err(|e| e.to_string())?;
            return Ok(Some(Piece::Enclosed { name: header.name, text }));
        }
        Record::Message { header, data } => {
            let Some(topic) = channels.get(&header.channel_id) else { return Ok(None) };
            return message(topic, &data).map_err(|e| format!("a message on {topic}: {e}"));
        }
        _ => {}
    }
    Ok(None)
}

fn message(topic: &str, data: &[u8]) -> Result<Option<Piece>, prost::DecodeError> {
    Ok(Some(match topic {
        topic::STATE => Piece::State((&proto::State::decode(data)?).into()),
        topic::COMMAND => Piece::Command((&proto::Command::decode(data)?).into()),
        topic::TELEMETRY => Piece::Telemetry((&proto::Telemetry::decode(data)?).into()),
        topic::CHECKPOINT => Piece::Checkpoint((&proto::Checkpoint::decode(data)?).into()),
        _ => return Ok(None),
    }))
}
