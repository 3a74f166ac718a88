//! The reading side: takes samples out of shared memory as fast as they come and never waits for a disk.

use crate::convert::{Checkpoint, Command, Sample, State, Telemetry};
use crate::gaps::{Gaps, Recorded};
use crate::{Notice, Options, RecordError, Shared};
use clearway::channel::{
    Attachment, ChannelError, CheckpointReader, CommandReader, Reader, Record, StateReader, TelemetryReader,
    Transport,
};
use clearway::clock::{Clock, MonotonicClock};
use clearway::wire::{RobotCommand, StopReason};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Sender, SyncSender, TrySendError};
use std::time::{Duration, Instant};

/// How often it is looked for a daemon that is not there: its first period comes 20 ms after its
/// channels.
const LOOK_EVERY: Duration = Duration::from_millis(2);
/// Silence after which it is asked whether the daemon still lives.
const SILENCE_MIN: Duration = Duration::from_millis(200);
/// Silence after a last command until what is still on its way has come.
const AFTER_THE_END: Duration = Duration::from_millis(300);

/// What goes to the disk.
#[derive(Debug)]
pub(crate) enum Item {
    /// The channels of a daemon were found: it can be asked what it runs with.
    Found,
    State(State),
    Command(Command),
    Telemetry(Telemetry),
    Checkpoint(Checkpoint),
}

impl Item {
    fn bytes(&self) -> usize {
        fn of<H, R>(sample: &Sample<H, R>) -> usize {
            size_of::<H>() + sample.robots.len() * size_of::<R>()
        }
        match self {
            Self::State(s) => of(s),
            Self::Command(s) => of(s),
            Self::Telemetry(s) => of(s),
            Self::Checkpoint(s) => of(s),
            Self::Found => 0,
        }
    }

    /// Which run of the daemon it belongs to.
    pub(crate) fn epoch(&self) -> Option<u64> {
        match self {
            Self::State(s) => Some(s.header.epoch),
            Self::Command(s) => Some(s.header.epoch),
            Self::Telemetry(s) => Some(s.header.epoch),
            Self::Checkpoint(s) => Some(s.header.epoch),
            Self::Found => None,
        }
    }
}

/// A place in the bounded queue, given back when it is taken out.
#[derive(Debug)]
pub(crate) struct Queued {
    pub(crate) item: Item,
    pub(crate) bytes: usize,
}

/// The four channels of a daemon.
struct Ports {
    states: StateReader,
    commands: CommandReader,
    telemetry: TelemetryReader,
    checkpoints: CheckpointReader,
}

impl Ports {
    /// Samples that were not as the daemon had sealed them.
    fn corrupt(&self) -> u64 {
        let read = self.states.corrupt() + self.commands.corrupt();
        read + self.telemetry.corrupt() + self.checkpoints.corrupt()
    }
}

pub(crate) struct Tap {
    pub(crate) transport: Transport,
    pub(crate) options: Options,
    pub(crate) shared: Arc<Shared>,
    pub(crate) queue: SyncSender<Queued>,
    pub(crate) notices: Sender<Notice>,
}

/// Where the current run stands.
struct Run {
    epoch: u64,
    gaps: Gaps,
    period: Duration,
    heard: Instant,
    ended: bool,
}

impl Tap {
    /// Reads until it is told to stop, or nobody appears.
    pub(crate) fn run(&self) -> Result<(), RecordError> {
        let node = self.transport.attach("clearway-record")?;
        let begun = Instant::now();
        let mut run: Option<Run> = None;
        let mut ports: Option<Ports> = None;
        let mut opening = Opening::default();
        let mut missing_since = Instant::now();
        let (mut looked, mut asked) = (Instant::now(), Instant::now());
        loop {
            let stop = self.shared.stop.load(Ordering::Acquire)
                || self.options.duration.is_some_and(|most| begun.elapsed() >= most);
            let Some(open) = &mut ports else {
                if stop {
                    return Ok(());
                }
                ports = opening.look(&node)?;
                asked = Instant::now();
                if ports.is_some() {
                    self.put(Recorded::State, Item::Found);
                } else {
                    if looked.elapsed() >= SILENCE_MIN {
                        looked = Instant::now();
                        let _ = node.clean_up();
                        if opening.states.is_some() && !node.has_daemon() {
                            // It died while it was starting.
                            opening = Opening::default();
                        }
                    }
                    if run.is_none()
                        && let Some(patience) = self.options.patience
                        && missing_since.elapsed() >= patience
                    {
                        let fleet = self.transport.fleet().to_owned();
                        return Err(RecordError::NoDaemon { fleet, seconds: patience.as_secs() });
                    }
                    std::thread::sleep(LOOK_EVERY);
                }
                continue;
            };
            self.drain(open, &mut run)?;
            if stop {
                // What came in between; a last command may be among it.
                self.drain(open, &mut run)?;
                if let Some(run) = &run {
                    self.shared.publish(run.epoch, run.gaps, run.ended);
                }
                return Ok(());
            }
            if let Some(current) = &run {
                self.shared.publish(current.epoch, current.gaps, false);
            }
            if is_over(&node, run.as_mut(), &mut asked) {
                if let Some(run) = &run {
                    self.shared.publish(run.epoch, run.gaps, true);
                    let _ = self.notices.send(Notice::RunOver { epoch: run.epoch });
                }
                if self.options.once {
                    return Ok(());
                }
                // Whoever stays attached keeps the channels of the dead alive, with their sizes.
                ports = None;
                missing_since = Instant::now();
            }
            let poll = run.as_ref().map_or(LOOK_EVERY, |run| run.period / 4);
            std::thread::sleep(poll.clamp(Duration::from_micros(200), Duration::from_millis(5)));
        }
    }

    /// Takes everything that has come and is intact.
    fn drain(&self, ports: &mut Ports, run: &mut Option<Run>) -> Result<(), RecordError> {
        let before = ports.corrupt();
        let drained = self.drain_intact(ports, run);
        self.shared.corrupt.fetch_add(ports.corrupt() - before, Ordering::Relaxed);
        drained
    }

    fn drain_intact(&self, ports: &mut Ports, run: &mut Option<Run>) -> Result<(), RecordError> {
        while let Some(sample) = ports.states.next()? {
            let header = *sample.header();
            let run = self.follow(run, header.epoch);
            let Some(run) = run else { continue };
            run.period = Duration::from_nanos(header.period_ns);
            if run.see(Recorded::State, header.tick) {
                self.put(Recorded::State, Item::State(State { header, robots: sample.robots().to_vec() }));
            }
        }
        while let Some(sample) = ports.commands.next()? {
            let header = *sample.header();
            let Some(run) = self.follow(run, header.epoch) else { continue };
            if run.see(Recorded::Command, header.tick) {
                run.ended = is_last(sample.robots());
                self.put(
                    Recorded::Command,
                    Item::Command(Command { header, robots: sample.robots().to_vec() }),
                );
            }
        }
        while let Some(sample) = ports.telemetry.next()? {
            let header = *sample.header();
            let Some(run) = self.follow(run, header.epoch) else { continue };
            if run.see(Recorded::Telemetry, header.tick) {
                run.gaps.skipped(Recorded::Telemetry, header.tick, header.skipped_periods);
                let robots = sample.robots().to_vec();
                self.put(Recorded::Telemetry, Item::Telemetry(Telemetry { header, robots }));
            }
        }
        while let Some(sample) = ports.checkpoints.next()? {
            let header = *sample.header();
            let Some(run) = self.follow(run, header.epoch) else { continue };
            if run.see(Recorded::Checkpoint, header.tick) {
                run.gaps.skipped(Recorded::Checkpoint, header.tick, header.skipped_periods);
                if header.commands_published == 0 {
                    run.gaps.too_late();
                }
                let robots = sample.robots().to_vec();
                self.put(Recorded::Checkpoint, Item::Checkpoint(Checkpoint { header, robots }));
            }
        }
        Ok(())
    }

    /// The run that a sample belongs to; `None` for one that is history.
    fn follow<'a>(&self, run: &'a mut Option<Run>, epoch: u64) -> Option<&'a mut Run> {
        let known = run.as_ref().map(|run| run.epoch);
        if known.is_some_and(|known| epoch < known) {
            return None;
        }
        if known != Some(epoch) {
            if let Some(before) = run.as_ref() {
                self.shared.publish(before.epoch, before.gaps, true);
            }
            let _ = self.notices.send(Notice::Attached { epoch });
            *run = Some(Run {
                epoch,
                gaps: Gaps::default(),
                period: Duration::from_millis(10),
                heard: Instant::now(),
                ended: false,
            });
        }
        let run = run.as_mut()?;
        run.heard = Instant::now();
        Some(run)
    }

    /// Hands an item to the writer; one that finds the queue full is dropped and counted.
    fn put(&self, channel: Recorded, item: Item) {
        let bytes = item.bytes();
        let waiting = self.shared.queued_bytes.fetch_add(bytes, Ordering::AcqRel);
        let fits = waiting.saturating_add(bytes) <= self.options.queue_bytes;
        let sent = fits
            && match self.queue.try_send(Queued { item, bytes }) {
                Ok(()) => true,
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => false,
            };
        if !sent {
            self.shared.queued_bytes.fetch_sub(bytes, Ordering::AcqRel);
            self.shared.dropped[channel as usize].fetch_add(1, Ordering::Relaxed);
        }
    }
}

/// Whether the run has ended: a last command has come and nothing after it, or the daemon is gone.
/// `asked`: when the latter was looked at last.
fn is_over(node: &Attachment, run: Option<&mut Run>, asked: &mut Instant) -> bool {
    let period = run.as_ref().map_or(Duration::ZERO, |run| run.period);
    if let Some(run) = run {
        let silent = run.heard.elapsed();
        if run.ended && silent >= AFTER_THE_END {
            return true;
        }
        if silent < SILENCE_MIN.max(4 * period) {
            return false;
        }
    }
    // A daemon that is stopped, or that has not begun, is alive.
    if asked.elapsed() < SILENCE_MIN.max(4 * period) {
        return false;
    }
    *asked = Instant::now();
    let _ = node.clean_up();
    !node.has_daemon()
}

impl Run {
    fn see(&mut self, channel: Recorded, tick: u64) -> bool {
        self.gaps.see(channel, tick)
    }
}

/// A command that ends a run: everybody is told to stop because it is over.
fn is_last(robots: &[RobotCommand]) -> bool {
    let ending = [StopReason::Finished as u32, StopReason::Operator as u32];
    let none = [StopReason::Vacant as u32];
    robots.iter().any(|robot| ending.contains(&robot.stop_reason))
        && robots.iter().all(|r| ending.contains(&r.stop_reason) || none.contains(&r.stop_reason))
}

/// Channels on the way to being attached to: each as soon as it is there, so that all of them are when
/// the first period begins.
#[derive(Default)]
struct Opening {
    states: Option<StateReader>,
    commands: Option<CommandReader>,
    telemetry: Option<TelemetryReader>,
    checkpoints: Option<CheckpointReader>,
}

impl Opening {
    /// Attaches to what has appeared; all four once they are there.
    fn look(&mut self, node: &Attachment) -> Result<Option<Ports>, ChannelError> {
        fn open<R: Record>(node: &Attachment, port: &mut Option<Reader<R>>) -> Result<(), ChannelError> {
            if port.is_none() {
                *port = match node.reader::<R>() {
                    Ok(reader) => Some(reader),
                    // Not there, or just being made or taken down.
                    Err(ChannelError::NoDaemon { .. } | ChannelError::Open { .. }) => None,
                    Err(e) => return Err(e),
                };
            }
            Ok(())
        }
        // What the dead have left has no writer.
        if self.states.is_none() && !node.has_daemon() {
            return Ok(None);
        }
        open(node, &mut self.states)?;
        open(node, &mut self.commands)?;
        open(node, &mut self.telemetry)?;
        open(node, &mut self.checkpoints)?;
        let all = (self.states.take(), self.commands.take(), self.telemetry.take(), self.checkpoints.take());
        match all {
            (Some(states), Some(commands), Some(telemetry), Some(checkpoints)) => {
                Ok(Some(Ports { states, commands, telemetry, checkpoints }))
            }
            (states, commands, telemetry, checkpoints) => {
                *self = Self { states, commands, telemetry, checkpoints };
                Ok(None)
            }
        }
    }
}

/// What to add to a `CLOCK_MONOTONIC` time to get wall clock time, ns, now.
pub(crate) fn wall_offset_ns() -> u64 {
    let wall = rustix::time::clock_gettime(rustix::time::ClockId::Realtime);
    let wall_ns =
        u64::try_from(wall.tv_sec).unwrap_or(0) * 1_000_000_000 + u64::try_from(wall.tv_nsec).unwrap_or(0);
    wall_ns.saturating_sub(MonotonicClock.now_ns())
}
