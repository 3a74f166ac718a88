use clearway_record::replay::Replay;
use clearway_record::{Configurations, Piece, Reading, topic};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

/// Larger fleets are not computed again: they take time and reach nothing else.
const PLACES_MAX: usize = 16;
const OBSTACLES_MAX: usize = 16;
/// Nor is more of a recording than this.
const PERIODS_MAX: usize = 64;

/// Whatever stands in a file: it is read or refused, and what was read is computed again or refused. An
/// input that does not begin like a recording is what is to stand in one: pieces, each with its kind, its
/// length and its bytes, so that no checksum and no compression is in the way.
pub(crate) fn recording(data: &[u8]) {
    if data.starts_with(&mcap::MAGIC[..4]) {
        read(data);
    } else if let Ok(file) = written(data) {
        read(&file);
    }
}

/// As `clearway replay` does.
fn read(file: &[u8]) {
    let mut reading = Reading::of(Path::new("fuzzed.mcap"), file, file.len() as u64);
    let (mut configurations, mut configured) = (Configurations::default(), None);
    let mut replay: Option<Replay> = None;
    let mut periods = 0;
    while let Ok(Some(piece)) = reading.next() {
        assert!(reading.offset() <= reading.size());
        match &piece {
            Piece::Enclosed { name, text } => configurations.add(name, text),
            Piece::State(state) if configured != Some(state.header.epoch) => {
                configured = Some(state.header.epoch);
                let Ok(Some(config)) = configurations.of(state.header.epoch) else { return };
                let small = config.places().max(state.robots.len()) <= PLACES_MAX;
                if !small || config.scenario.obstacles.len() > OBSTACLES_MAX {
                    return;
                }
                match &mut replay {
                    Some(replay) => {
                        if replay.configure(config).is_err() {
                            return;
                        }
                    }
                    None => match Replay::new(config) {
                        Ok(new) => replay = Some(new),
                        Err(_) => return,
                    },
                }
            }
            Piece::State(_) => periods += 1,
            _ => {}
        }
        if periods > PERIODS_MAX || replay.as_mut().is_some_and(|replay| replay.take(piece).is_err()) {
            return;
        }
    }
    if let Some(Ok(outcome)) = replay.map(Replay::finish) {
        assert!(outcome.different_commands <= outcome.compared_commands);
        assert_eq!(outcome.first_difference.is_some(), outcome.different_commands > 0);
        assert!(outcome.skipped_periods <= outcome.missing_ticks);
    }
}

/// A recording of these pieces.
fn written(mut data: &[u8]) -> Result<Vec<u8>, mcap::McapError> {
    let mut file = mcap::WriteOptions::new().compression(None).create(Cursor::new(Vec::new()))?;
    let topics = [topic::STATE, topic::COMMAND, topic::TELEMETRY, topic::CHECKPOINT];
    let mut channels = Vec::new();
    for topic in topics {
        channels.push(file.add_channel(0, topic, "protobuf", &BTreeMap::new())?);
    }
    while let [kind, low, high, rest @ ..] = data {
        let length = usize::from(u16::from_le_bytes([*low, *high])).min(rest.len());
        let (piece, more) = rest.split_at(length);
        data = more;
        if let Some(&channel_id) = channels.get(usize::from(*kind)) {
            let header =
                mcap::records::MessageHeader { channel_id, sequence: 0, log_time: 0, publish_time: 0 };
            file.write_to_known_channel(&header, piece)?;
            continue;
        }
        // A name and a text.
        let end = piece.iter().position(|byte| *byte == 0).unwrap_or(piece.len());
        let (name, text) = piece.split_at(end);
        file.attach(&mcap::Attachment {
            log_time: 0,
            create_time: 0,
            name: String::from_utf8_lossy(name).into_owned(),
            media_type: "application/toml".to_owned(),
            data: Cow::Borrowed(text.strip_prefix(&[0]).unwrap_or(text)),
        })?;
    }
    file.finish()?;
    Ok(file.into_inner().into_inner())
}
