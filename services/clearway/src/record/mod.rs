//! `clearway record`: a fleet's channels into MCAP files.

mod display;

use clap::ValueEnum;
use clearway::config::ChannelConfig;
use clearway_record::{Compression, Options, RecordError, Recorder, Status};
use clearway_signals::{Again, Stop};
use display::Display;
use miette::{IntoDiagnostic, WrapErr};
use std::path::PathBuf;
use std::time::Duration;

/// Record a fleet's states, commands and telemetry into an MCAP file.
///
/// Attaches to a running daemon, or waits for one and sees it from its first period. Control never waits
/// for the recorder: what it is too slow for is counted. Ends with Ctrl-C or SIGTERM; a daemon that
/// is started again is recorded on.
#[derive(Debug, clap::Args)]
#[command(after_help = "\
Examples:
  clearway record run.mcap                    before the daemon, or beside it
  clearway record run.mcap --once             end when the daemon's run ends
  clearway record run.mcap --wait forever     as a service
  clearway record /data/fleet.mcap --max-size 1GiB --rotate-every 1h --keep 48
  clearway record run.mcap --duration 90s --compression lz4 --json

Files open in Foxglove, Lichtblick, Rerun and PlotJuggler, and
`clearway replay run.mcap` computes every command again.

Exit codes: 0 everything is recorded, 1 something was missed, dropped or had no
room, 2 the command line or the file is wrong, 3 no daemon appeared, 5 shared
memory failed.")]
pub(crate) struct Args {
    /// The file to write; the following ones are OUT-0001.mcap and so on.
    out: PathBuf,
    /// Name of the fleet.
    #[arg(long, value_name = "NAME", default_value = "default")]
    fleet: String,
    /// How long to wait for the daemon: a time such as 30s, or forever.
    #[arg(long, value_name = "TIME", default_value = "10s", value_parser = patience)]
    wait: Patience,
    /// End after this time, such as 90s, 10min or 2h.
    #[arg(long, value_name = "TIME", value_parser = time)]
    duration: Option<Duration>,
    /// End when the daemon's run ends, instead of waiting for the next.
    #[arg(long)]
    once: bool,
    /// Begin the next file at this size, such as 64MiB; none: never.
    #[arg(long, value_name = "SIZE", default_value = "256MiB", value_parser = size_or_none)]
    max_size: Size,
    /// Begin the next file after this time.
    #[arg(long, value_name = "TIME", value_parser = time)]
    rotate_every: Option<Duration>,
    /// Keep this many files and delete the oldest.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(1..))]
    keep: Option<u32>,
    /// How chunks are compressed.
    #[arg(long, value_enum, default_value = "zstd")]
    compression: Packing,
    /// Write what has come at least this often: what a kill can cost.
    #[arg(long, value_name = "TIME", default_value = "200ms", value_parser = time)]
    flush_every: Duration,
    /// Uncompressed size of a chunk.
    #[arg(long, value_name = "SIZE", default_value = "64KiB", value_parser = size)]
    chunk_size: u64,
    /// How often poses, twists and scenes are recorded at most, Hz; 0: not at all. The channels
    /// themselves are always recorded completely.
    #[arg(long, value_name = "HZ", default_value_t = 30.0, value_parser = rate)]
    view_hz: f64,
    /// Memory for what waits for the disk.
    #[arg(long, value_name = "SIZE", default_value = "64MiB", value_parser = size)]
    buffer: u64,
    /// Replace files that exist.
    #[arg(long)]
    overwrite: bool,
    /// Print what was recorded as JSON at the end.
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, ValueEnum)]
enum Packing {
    None,
    Lz4,
    Zstd,
}

/// How long to wait; `None` is for ever.
#[derive(Debug, Clone, Copy)]
struct Patience(Option<Duration>);

/// Bytes; `None` is without limit.
#[derive(Debug, Clone, Copy)]
struct Size(Option<u64>);

const TIMES: [(&str, f64); 6] =
    [("ms", 1e-3), ("min", 60.0), ("s", 1.0), ("h", 3600.0), ("d", 86_400.0), ("", 1.0)];
const SIZES: [(&str, f64); 7] = [
    ("KiB", 1024.0),
    ("MiB", 1_048_576.0),
    ("GiB", 1_073_741_824.0),
    ("kB", 1e3),
    ("MB", 1e6),
    ("GB", 1e9),
    ("", 1.0),
];

/// A number with one of the units.
fn with_unit(text: &str, units: &[(&str, f64)], example: &str) -> Result<f64, String> {
    let number = |&(unit, factor): &(&str, f64)| {
        let digits = text.strip_suffix(unit)?.trim_end();
        let value: f64 = digits.parse().ok()?;
        (value.is_finite() && value >= 0.0 && value * factor < 1e15).then_some(value * factor)
    };
    units.iter().find_map(number).ok_or_else(|| format!("not a number with a unit, such as {example}"))
}

fn time(text: &str) -> Result<Duration, String> {
    let seconds = with_unit(text, &TIMES, "500ms, 90s, 10min, 2h")?;
    if seconds < 1e-3 {
        return Err("too short: give at least 1ms".to_owned());
    }
    Duration::try_from_secs_f64(seconds).map_err(|e| e.to_string())
}

fn patience(text: &str) -> Result<Patience, String> {
    if text == "forever" {
        return Ok(Patience(None));
    }
    let seconds = with_unit(text, &TIMES, "30s, or forever")?;
    Duration::try_from_secs_f64(seconds).map(|wait| Patience(Some(wait))).map_err(|e| e.to_string())
}

#[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "checked to be in range")]
fn size(text: &str) -> Result<u64, String> {
    let bytes = with_unit(text, &SIZES, "64KiB, 1GiB")?;
    if bytes < 1024.0 {
        return Err("too small: give at least 1KiB".to_owned());
    }
    Ok(bytes as u64)
}

fn size_or_none(text: &str) -> Result<Size, String> {
    if text == "none" { Ok(Size(None)) } else { size(text).map(|bytes| Size(Some(bytes))) }
}

fn rate(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(hz) if (0.0..=10_000.0).contains(&hz) => Ok(hz),
        _ => Err("give a rate from 0 to 10000".to_owned()),
    }
}

impl Args {
    fn options(&self) -> Options {
        let bytes = |n: u64| usize::try_from(n).unwrap_or(usize::MAX);
        Options {
            overwrite: self.overwrite,
            max_bytes: self.max_size.0,
            rotate_every: self.rotate_every,
            keep: self.keep.map(|n| n as usize),
            compression: match self.compression {
                Packing::None => Compression::None,
                Packing::Lz4 => Compression::Lz4,
                Packing::Zstd => Compression::Zstd,
            },
            chunk_bytes: bytes(self.chunk_size),
            flush_every: self.flush_every,
            view_hz: self.view_hz,
            queue_bytes: bytes(self.buffer),
            patience: self.wait.0,
            duration: self.duration,
            once: self.once,
            ..Options::new(self.out.clone())
        }
    }
}

/// Something of the fleet is not in the files.
const INCOMPLETE: u8 = 1;
/// No daemon appeared.
const NO_DAEMON: u8 = 3;
/// Shared memory or a thread failed.
const FAILED: u8 = 5;

/// Records until it is stopped; the exit status.
pub(crate) fn run(args: &Args) -> miette::Result<u8> {
    // A closed terminal too: the file is finished, and the ports are given back.
    let stop =
        Stop::listen_to_terminal(Again::Waits).into_diagnostic().wrap_err("signals cannot be handled")?;
    let channel = ChannelConfig::default().with_environment();
    let recorder = match Recorder::start(&args.fleet, &channel, &args.options()) {
        Ok(recorder) => recorder,
        Err(error) => return failure(error),
    };
    let mut display = Display::new(&args.out);
    while !recorder.is_finished() {
        if stop.is_asked() {
            recorder.stop();
        }
        for notice in recorder.notices() {
            display.notice(&notice);
        }
        display.update(&recorder.status());
        std::thread::sleep(Duration::from_millis(20));
    }
    let (status, notices, outcome) = recorder.join();
    for notice in &notices {
        display.notice(notice);
    }
    display.finish();
    if let Err(error) = outcome {
        if matches!(error, RecordError::NoDaemon { .. }) {
            // Nothing is in them, and the next try would find the name taken. An older file is not among them.
            for file in &status.files {
                let _ = std::fs::remove_file(file);
            }
        }
        return failure(error);
    }
    tell(args, &status)?;
    Ok(if status.is_complete() { 0 } else { INCOMPLETE })
}

fn failure(error: RecordError) -> miette::Result<u8> {
    let code = match &error {
        RecordError::NoDaemon { .. } => NO_DAEMON,
        RecordError::Channel(_) | RecordError::Panicked { .. } => FAILED,
        // The caller's code for a wrong command line.
        RecordError::Exists { .. } | RecordError::Create { .. } => return Err(error.into()),
    };
    eprintln!("{:?}", miette::Report::new(error));
    Ok(code)
}

fn tell(args: &Args, status: &Status) -> miette::Result<()> {
    if args.json {
        let mut value = serde_json::to_value(status).into_diagnostic()?;
        value["missed"] = status.missed().into();
        value["complete"] = status.is_complete().into();
        let mut text = serde_json::to_string_pretty(&value).into_diagnostic()?;
        text.push('\n');
        crate::show(&text);
    } else {
        crate::show(&display::summary(status));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_and_sizes_are_read_with_their_units() {
        assert_eq!(time("250ms"), Ok(Duration::from_millis(250)));
        assert_eq!(time("10 min"), Ok(Duration::from_secs(600)));
        assert_eq!(time("1.5h"), Ok(Duration::from_secs(5400)));
        assert_eq!(time("3"), Ok(Duration::from_secs(3)));
        assert_eq!(size("64KiB"), Ok(65_536));
        assert_eq!(size("1.5GB"), Ok(1_500_000_000));
        assert_eq!(patience("forever").unwrap().0, None);
        assert_eq!(patience("0s").unwrap().0, Some(Duration::ZERO));
        assert_eq!(size_or_none("none").unwrap().0, None);
        for wrong in ["", "x", "-1s", "nan", "1 week", "inf", "1e300s", "0"] {
            assert!(time(wrong).is_err(), "{wrong}");
            assert!(size(wrong).is_err(), "{wrong}");
        }
    }
}
