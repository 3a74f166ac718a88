//! Brings the channels' samples into the model. Reads along and never holds on to a sample, so that the
//! loop does not notice.

use clearway::channel::{
    Attachment, ChannelError, CommandReader, Reader, Record, StateReader, TelemetryReader, Transport,
};
use clearway::clock::{Clock, MonotonicClock};
use std::time::{Duration, Instant};

use super::model::Model;

/// Between two looks for a daemon.
const LOOK_EVERY: Duration = Duration::from_millis(200);
/// Between two looks at who is attached, and at whether a silent daemon lives.
const CENSUS_EVERY: Duration = Duration::from_secs(1);
/// Samples taken at a time, so that a fast daemon does not keep the screen waiting.
const BURST: usize = 4096;

struct Ports {
    states: StateReader,
    commands: CommandReader,
    telemetry: TelemetryReader,
}

/// Attached to a fleet, or on the way to it.
pub(crate) struct Feed {
    transport: Transport,
    node: Attachment,
    ports: Option<Ports>,
    looked: Option<Instant>,
    counted: Option<Instant>,
}

impl Feed {
    /// Joins shared memory.
    ///
    /// # Errors
    /// A wrong name or location, and the reasons for which shared memory cannot be joined.
    pub(crate) fn new(transport: Transport) -> Result<Self, ChannelError> {
        let node = transport.attach("clearway-top")?;
        Ok(Self { transport, node, ports: None, looked: None, counted: None })
    }

    /// Takes everything that has come. What goes wrong stands in the model, and is tried again.
    pub(crate) fn poll(&mut self, model: &mut Model) {
        let now_ns = MonotonicClock.now_ns();
        self.look(model);
        if let Some(ports) = &mut self.ports {
            let before = model.run.as_ref().map(|run| (run.epoch, run.tick));
            if let Err(error) = drain(ports, model) {
                model.trouble = Some(error.to_string());
                self.ports = None;
            } else if model.run.as_ref().map(|run| (run.epoch, run.tick)) != before {
                model.trouble = None;
            }
        }
        if due(&mut self.counted, CENSUS_EVERY) {
            model.ports = self.ports.is_some().then(|| self.node.attached());
            model.members = self.transport.members().unwrap_or_default();
            if self.ports.is_some() && !model.is_live(now_ns) {
                // A daemon that was killed leaves its entries to whoever comes by.
                let _ = self.node.clean_up();
                if !self.node.has_daemon() {
                    // Whoever stays attached keeps the channels of the dead alive, with their sizes.
                    self.ports = None;
                    model.ports = None;
                }
            }
        }
        model.attached = self.ports.is_some();
    }

    /// How long samples may wait to be taken.
    pub(crate) fn patience(model: &Model) -> Duration {
        let period_ns = model.run.as_ref().map_or(0, |run| run.period_ns);
        Duration::from_nanos(2 * period_ns).clamp(Duration::from_millis(1), Duration::from_millis(25))
    }

    fn look(&mut self, model: &mut Model) {
        if self.ports.is_some() || !due(&mut self.looked, LOOK_EVERY) {
            return;
        }
        if !self.node.has_daemon() {
            model.trouble = None;
            return;
        }
        match self.open() {
            Ok(ports) => self.ports = Some(ports),
            // It is about to make them.
            Err(ChannelError::NoDaemon { .. }) => {}
            Err(error) => model.trouble = Some(error.to_string()),
        }
    }

    fn open(&self) -> Result<Ports, ChannelError> {
        Ok(Ports {
            states: self.node.reader()?,
            commands: self.node.reader()?,
            telemetry: self.node.reader()?,
        })
    }
}

/// Whether it is time again.
fn due(last: &mut Option<Instant>, every: Duration) -> bool {
    let due = last.is_none_or(|at| at.elapsed() >= every);
    if due {
        *last = Some(Instant::now());
    }
    due
}

fn drain(ports: &mut Ports, model: &mut Model) -> Result<(), ChannelError> {
    // In this order a state is shown with the answer to the one before, never with an older one.
    each(&mut ports.telemetry, |header, robots| model.telemetry(header, robots))?;
    each(&mut ports.commands, |header, robots| model.command(header, robots))?;
    each(&mut ports.states, |header, robots| model.state(header, robots))
}

fn each<R: Record>(
    reader: &mut Reader<R>,
    mut take: impl FnMut(&R::Header, &[R]),
) -> Result<(), ChannelError> {
    for _ in 0..BURST {
        let Some(sample) = reader.next()? else { break };
        take(sample.header(), sample.robots());
    }
    Ok(())
}
