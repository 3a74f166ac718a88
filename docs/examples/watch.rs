//! Attaches to a running daemon from a process of its own and checks that no sample is missed.
//!
//! ```text
//! cargo run --release -p clearway --example watch -- 60     # start before or after the daemon
//! ```
//!
//! Prints the fleet once a second, and at the end how many ticks of `state` and `command` were seen
//! and how many are missing. Exit status 1 when one is missing.

use clearway::channel::{Attachment, ChannelError, CommandReader, StateReader, Transport};
use clearway::config::ChannelConfig;
use clearway::wire::state_flags;
use std::process::ExitCode;
use std::time::{Duration, Instant};

/// Counts ticks and the gaps between them.
#[derive(Default)]
struct Ticks {
    last: Option<u64>,
    seen: u64,
    missing: u64,
}

impl Ticks {
    fn see(&mut self, tick: u64) {
        self.missing += self.last.map_or(0, |last| tick.saturating_sub(last + 1));
        self.last = Some(tick);
        self.seen += 1;
    }
}

/// Readers of the fleet's channels, as soon as there is a daemon.
fn wait_for_daemon(
    node: &Attachment,
    patience: Duration,
) -> Result<(StateReader, CommandReader), ChannelError> {
    let end = Instant::now() + patience;
    loop {
        match node.reader().and_then(|states| Ok((states, node.reader()?))) {
            Err(_) if Instant::now() < end => std::thread::sleep(Duration::from_millis(2)),
            result => return result,
        }
    }
}

fn main() -> Result<ExitCode, Box<dyn std::error::Error>> {
    let seconds: u64 = std::env::args().nth(1).map_or(Ok(60), |text| text.parse())?;
    let transport = Transport::new("default", &ChannelConfig::default().with_environment())?;
    let node = transport.attach("watch")?;
    let (mut states, mut commands) = wait_for_daemon(&node, Duration::from_secs(10))?;

    let (mut state_ticks, mut command_ticks) = (Ticks::default(), Ticks::default());
    let end = Instant::now() + Duration::from_secs(seconds);
    let mut say = Instant::now();
    while Instant::now() < end {
        while let Some(sample) = states.next()? {
            state_ticks.see(sample.header().tick);
            if Instant::now() >= say {
                say += Duration::from_secs(1);
                let arrived = sample.robots().iter().filter(|r| r.has(state_flags::ARRIVED)).count();
                println!("tick {}: {arrived} of {} arrived", sample.header().tick, sample.robots().len());
            }
        }
        while let Some(sample) = commands.next()? {
            command_ticks.see(sample.header().tick);
        }
        std::thread::sleep(Duration::from_micros(300));
    }
    for (name, ticks) in [("state", &state_ticks), ("command", &command_ticks)] {
        println!("{name}: {} ticks seen, {} missing, last {:?}", ticks.seen, ticks.missing, ticks.last);
    }
    let complete = state_ticks.seen > 0 && state_ticks.missing + command_ticks.missing == 0;
    Ok(if complete { ExitCode::SUCCESS } else { ExitCode::FAILURE })
}
