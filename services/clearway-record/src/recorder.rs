//! The recorder: a thread that reads shared memory, a bounded queue, a thread that writes files.

use crate::configuration::{self, Answer, configuration_name, scenario_name};
use crate::convert::State;
use crate::files::{Enclosure, Files, Preamble};
use crate::gaps::{Gaps, Recorded};
use crate::schema::clearway as proto;
use crate::tap::{Item, Queued, Tap, wall_offset_ns};
use crate::view::{self, FileTime};
use crate::{Options, RecordError, topic};
use clearway::channel::Transport;
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::ChannelConfig;
use clearway::model::Obstacle;
use clearway::scenario::Scenario;
use prost::Message;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::mpsc::{Receiver, RecvTimeoutError, channel, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Samples that wait for the writer at most, whatever their size.
const QUEUE_SAMPLES: usize = 1 << 14;
/// How often the writer looks at the time when nothing comes.
const CHORES_EVERY: Duration = Duration::from_millis(50);
/// How often the state of the recording is recorded itself.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// Something that people want to know when it happens.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Notice {
    /// Samples come.
    Attached {
        /// Which run of the daemon.
        epoch: u64,
    },
    /// The daemon's run is over.
    RunOver {
        /// Which run.
        epoch: u64,
    },
    /// The next file was begun.
    Rotated {
        /// Its name.
        path: PathBuf,
    },
    /// An old file was deleted, because only so many are kept.
    Deleted {
        /// Its name.
        path: PathBuf,
    },
    /// The disk takes no more; the file was ended.
    DiskFull {
        /// The file.
        path: PathBuf,
        /// What the system says.
        reason: String,
        /// Whether the file could be ended with its index.
        whole: bool,
    },
    /// There is room again, and a next file.
    Resumed {
        /// Its name.
        path: PathBuf,
        /// Messages that were not recorded meanwhile.
        unrecorded: u64,
    },
}

/// One run of the daemon as it was recorded.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct RunCounts {
    /// Which run.
    pub epoch: u64,
    /// Whether its end was seen.
    pub over: bool,
    /// Periods that the daemon skipped.
    pub skipped_periods: u64,
    /// Each channel.
    pub channels: Vec<ChannelCounts>,
}

/// One channel in one run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ChannelCounts {
    /// Which.
    pub channel: Recorded,
    /// First and last tick.
    pub ticks: Option<(u64, u64)>,
    /// Samples taken from shared memory.
    pub received: u64,
    /// Samples that were published and not received.
    pub missed: u64,
}

/// How a recording goes.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Status {
    /// The runs, oldest first; of a long recording the newest.
    pub runs: Vec<RunCounts>,
    /// Runs before those.
    pub earlier_runs: u64,
    /// Samples missed in those.
    pub earlier_missed: u64,
    /// Samples that were dropped because the writer was too slow.
    pub dropped: u64,
    /// Samples that had changed in memory on their way, and are left out; counted as missed as well.
    pub corrupt: u64,
    /// Messages that came while the disk was full.
    pub unrecorded: u64,
    /// Whether messages are being written.
    pub recording: bool,
    /// Bytes written.
    pub bytes: u64,
    /// The files that are there.
    pub files: Vec<PathBuf>,
}

impl Status {
    /// Samples that were missed in all runs.
    pub fn missed(&self) -> u64 {
        let now = self.runs.iter().flat_map(|run| &run.channels).map(|channel| channel.missed);
        self.earlier_missed + now.sum::<u64>()
    }

    /// Whether everything that was published since it began is in the files.
    pub fn is_complete(&self) -> bool {
        self.missed() + self.dropped + self.corrupt + self.unrecorded == 0 && self.recording
    }
}

/// Runs whose counts are kept.
const RUNS_MAX: usize = 64;

#[derive(Debug, Default)]
struct Counts {
    runs: Vec<(u64, Gaps, bool)>,
    earlier: u64,
    earlier_missed: u64,
    recording: bool,
    unrecorded: u64,
    bytes: u64,
    files: Vec<PathBuf>,
}

/// What both threads and the caller see.
#[derive(Debug, Default)]
pub(crate) struct Shared {
    pub(crate) stop: AtomicBool,
    pub(crate) queued_bytes: AtomicUsize,
    pub(crate) dropped: [AtomicU64; 4],
    pub(crate) corrupt: AtomicU64,
    counts: Mutex<Counts>,
}

impl Shared {
    fn counts(&self) -> std::sync::MutexGuard<'_, Counts> {
        self.counts.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Where a run stands.
    pub(crate) fn publish(&self, epoch: u64, gaps: Gaps, over: bool) {
        let mut counts = self.counts();
        match counts.runs.last_mut() {
            Some(last) if last.0 == epoch => *last = (epoch, gaps, over),
            _ => counts.runs.push((epoch, gaps, over)),
        }
        if counts.runs.len() > RUNS_MAX {
            let (_, gaps, over) = counts.runs.remove(0);
            counts.earlier += 1;
            counts.earlier_missed += Recorded::ALL.map(|c| gaps.missed(c, over)).iter().sum::<u64>();
        }
    }

    fn dropped(&self) -> u64 {
        self.dropped.iter().map(|n| n.load(Ordering::Relaxed)).sum()
    }

    fn status(&self) -> Status {
        let counts = self.counts();
        let channel = |gaps: &Gaps, channel: Recorded, over: bool| ChannelCounts {
            channel,
            ticks: gaps.range(channel),
            received: gaps.received(channel),
            missed: gaps.missed(channel, over),
        };
        let run = |(epoch, gaps, over): &(u64, Gaps, bool)| RunCounts {
            epoch: *epoch,
            over: *over,
            skipped_periods: gaps.skipped_periods(),
            channels: Recorded::ALL.map(|c| channel(gaps, c, *over)).to_vec(),
        };
        Status {
            runs: counts.runs.iter().map(run).collect(),
            earlier_runs: counts.earlier,
            earlier_missed: counts.earlier_missed,
            dropped: self.dropped(),
            corrupt: self.corrupt.load(Ordering::Relaxed),
            unrecorded: counts.unrecorded,
            recording: counts.recording,
            bytes: counts.bytes,
            files: counts.files.clone(),
        }
    }
}

/// A recording that goes on.
#[derive(Debug)]
pub struct Recorder {
    shared: Arc<Shared>,
    notices: Receiver<Notice>,
    tap: JoinHandle<Result<(), RecordError>>,
    writer: JoinHandle<()>,
}

impl Recorder {
    /// Makes the first file, and begins to wait for the fleet's daemon.
    ///
    /// # Errors
    /// [`RecordError`] when the file cannot be made or shared memory cannot be joined.
    pub fn start(
        fleet: &str,
        channel_config: &ChannelConfig,
        options: &Options,
    ) -> Result<Self, RecordError> {
        let transport = Transport::new(fleet, channel_config)?;
        let shared = Arc::new(Shared::default());
        let (notify, notices) = channel();
        let tap_notices = notify.clone();
        let (queue, queued) = sync_channel(QUEUE_SAMPLES);
        let (made, making) = sync_channel(1);

        let writer = {
            let (shared, options, fleet) = (Arc::clone(&shared), options.clone(), fleet.to_owned());
            let channel = channel_config.clone();
            spawn("record-write", move || match Files::create(&options, notify) {
                Ok(files) => {
                    let _ = made.send(Ok(()));
                    WriterThread::new(&fleet, channel, options, shared, files).run(&queued);
                }
                Err(e) => {
                    let _ = made.send(Err(e));
                }
            })?
        };
        making.recv().map_err(|_| RecordError::Panicked { thread: "writing" })??;
        let tap = Tap {
            transport,
            options: options.clone(),
            shared: Arc::clone(&shared),
            queue,
            notices: tap_notices,
        };
        let tap = spawn("record-read", move || tap.run())?;
        Ok(Self { shared, notices, tap, writer })
    }

    /// How it goes.
    pub fn status(&self) -> Status {
        self.shared.status()
    }

    /// What happened since the last time.
    pub fn notices(&self) -> impl Iterator<Item = Notice> + '_ {
        self.notices.try_iter()
    }

    /// Whether it has ended by itself.
    pub fn is_finished(&self) -> bool {
        self.tap.is_finished()
    }

    /// Asks it to end.
    pub fn stop(&self) {
        self.shared.stop.store(true, Ordering::Release);
    }

    /// Waits for the end, and for the files to be complete.
    ///
    /// # Errors
    /// [`RecordError`]: no daemon appeared, or shared memory failed. The files are complete all the same.
    pub fn join(self) -> (Status, Vec<Notice>, Result<(), RecordError>) {
        let read = self.tap.join().unwrap_or(Err(RecordError::Panicked { thread: "reading" }));
        // The queue's only sender is gone: the writer takes what is left and ends.
        let written = self.writer.join().map_err(|_| RecordError::Panicked { thread: "writing" });
        (self.shared.status(), self.notices.try_iter().collect(), read.and(written))
    }
}

fn spawn<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<JoinHandle<T>, RecordError> {
    let builder = std::thread::Builder::new().name(name.to_owned());
    builder.spawn(work).map_err(|source| RecordError::Create { path: PathBuf::from(name), source })
}

/// The thread that writes.
struct WriterThread {
    options: Options,
    shared: Arc<Shared>,
    files: Files,
    facts: BTreeMap<String, String>,
    wall_offset_ns: u64,
    fleet: String,
    channel: ChannelConfig,
    answer: Option<Answer>,
    epoch: u64,
    tick: u64,
    obstacles: Vec<Obstacle>,
    viewed_ns: u64,
    scene_is_fresh: bool,
    status_due: Instant,
}

impl WriterThread {
    fn new(fleet: &str, channel: ChannelConfig, options: Options, shared: Arc<Shared>, files: Files) -> Self {
        // Fixed for the whole recording: a clock that is set does not tear it.
        let wall_offset_ns = wall_offset_ns();
        let fact = |name: &str, value: String| (name.to_owned(), value);
        let facts = BTreeMap::from([
            fact("fleet", fleet.to_owned()),
            fact("clearway_version", env!("CARGO_PKG_VERSION").to_owned()),
            fact("wall_offset_ns", wall_offset_ns.to_string()),
            fact("begun_ns", (MonotonicClock.now_ns() + wall_offset_ns).to_string()),
        ]);
        Self {
            options,
            shared,
            files,
            facts,
            wall_offset_ns,
            fleet: fleet.to_owned(),
            channel,
            answer: None,
            epoch: 0,
            tick: 0,
            obstacles: Vec::new(),
            viewed_ns: 0,
            scene_is_fresh: false,
            status_due: Instant::now() + STATUS_EVERY,
        }
    }

    fn run(mut self, queue: &Receiver<Queued>) {
        self.announce();
        loop {
            match queue.recv_timeout(CHORES_EVERY) {
                Ok(Queued { item, bytes }) => {
                    self.write(&item);
                    self.shared.queued_bytes.fetch_sub(bytes, Ordering::AcqRel);
                }
                Err(RecvTimeoutError::Timeout) => {}
                Err(RecvTimeoutError::Disconnected) => break,
            }
            self.chores();
        }
        self.record_status();
        let recording = self.files.is_open();
        let unrecorded = self.files.unrecorded;
        let whole = self.files.finish(counts(&self.shared.status(), unrecorded));
        self.share(recording && whole);
    }

    fn announce(&mut self) {
        let mut enclosures = Vec::new();
        self.obstacles.clear();
        if let Some(answer) = self.answer.as_ref().filter(|answer| answer.epoch == self.epoch) {
            let (configuration, scenario) = (configuration_name(self.epoch), scenario_name(self.epoch));
            if let Ok(scenario) = Scenario::parse(&answer.scenario, &scenario) {
                self.obstacles = scenario.obstacles;
            }
            enclosures.push(Enclosure { name: configuration, text: answer.configuration.clone() });
            enclosures.push(Enclosure { name: scenario, text: answer.scenario.clone() });
        }
        self.files.announce(Preamble { facts: self.facts.clone(), enclosures });
        self.scene_is_fresh = false;
    }

    /// Asks the daemon what it runs with. It answers in milliseconds; samples wait in the queue.
    fn ask(&mut self) {
        if let Ok(answer) = configuration::ask(&self.fleet, &self.channel) {
            self.answer = Some(answer);
        }
    }

    fn at(&self, monotonic_ns: u64) -> FileTime {
        FileTime(monotonic_ns + self.wall_offset_ns)
    }

    fn write(&mut self, item: &Item) {
        if let Some(epoch) = item.epoch().filter(|epoch| *epoch != self.epoch) {
            self.epoch = epoch;
            self.facts.insert("epoch".to_owned(), epoch.to_string());
            if self.answer.as_ref().is_none_or(|answer| answer.epoch != epoch) {
                self.ask();
            }
            self.announce();
        }
        if item.epoch().is_some() {
            self.files.take_place();
        }
        match item {
            Item::Found => self.ask(),
            Item::State(s) => {
                self.tick = s.header.tick;
                let at = self.at(s.header.stamp_ns);
                let bytes = proto::State::from(s).encode_to_vec();
                self.files.message(topic::STATE, s.header.tick, at.0, &bytes);
                self.view(s, at);
            }
            Item::Command(s) => {
                let at = self.at(s.header.stamp_ns);
                let bytes = proto::Command::from(s).encode_to_vec();
                self.files.message(topic::COMMAND, s.header.tick, at.0, &bytes);
            }
            Item::Telemetry(s) => {
                let h = &s.header;
                // When the commands went out, the last thing that it tells of.
                let at = self.at(h.release_ns + h.release_lateness_ns + h.state_to_command_ns);
                let bytes = proto::Telemetry::from(s).encode_to_vec();
                self.files.message(topic::TELEMETRY, h.tick, at.0, &bytes);
            }
            Item::Checkpoint(s) => {
                let at = self.at(MonotonicClock.now_ns());
                let bytes = proto::Checkpoint::from(s).encode_to_vec();
                self.files.message(topic::CHECKPOINT, s.header.tick, at.0, &bytes);
            }
        }
    }

    /// The state in types that others draw, not more often than asked for.
    fn view(&mut self, state: &State, at: FileTime) {
        let hz = self.options.view_hz;
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "a positive rate")]
        let interval_ns = if hz > 0.0 { (1e9 / hz) as u64 } else { return };
        // A period that comes a little early is not left out.
        if at.0 + interval_ns / 10 < self.viewed_ns + interval_ns && self.scene_is_fresh {
            return;
        }
        self.viewed_ns = at.0;
        let tick = state.header.tick;
        if !self.scene_is_fresh {
            let bytes = view::fresh_scene(&self.obstacles, at).encode_to_vec();
            self.files.message(topic::SCENE, tick, at.0, &bytes);
            self.scene_is_fresh = true;
        }
        self.files.message(topic::POSES, tick, at.0, &view::poses(state, at).encode_to_vec());
        self.files.message(topic::SCENE, tick, at.0, &view::scene(state, at).encode_to_vec());
        if state.robots.len() <= self.options.robot_topics_max {
            for robot in view::present(state) {
                self.files.message(&topic::pose_of(robot.id), tick, at.0, &view::pose_stamped(robot, at));
                self.files.message(&topic::twist_of(robot.id), tick, at.0, &view::twist_stamped(robot, at));
            }
        }
    }

    fn chores(&mut self) {
        if Instant::now() >= self.status_due {
            self.status_due = Instant::now() + STATUS_EVERY;
            self.record_status();
            // One that was too busy to say what it runs with is asked again.
            if self.epoch != 0 && self.answer.as_ref().is_none_or(|answer| answer.epoch != self.epoch) {
                self.ask();
                if self.answer.as_ref().is_some_and(|answer| answer.epoch == self.epoch) {
                    self.announce();
                }
            }
        }
        let Self { shared, files, .. } = self;
        let unrecorded = files.unrecorded;
        if files.chores(|| counts(&shared.status(), unrecorded)) {
            self.scene_is_fresh = false;
        }
        self.share(self.files.is_open());
    }

    fn share(&mut self, recording: bool) {
        let mut counts = self.shared.counts();
        counts.recording = recording;
        counts.unrecorded = self.files.unrecorded;
        counts.bytes = self.files.bytes();
        if counts.files.len() != self.files.paths().len() || counts.files.last() != self.files.paths().last()
        {
            counts.files = self.files.paths().to_vec();
        }
    }

    /// How it goes, into the recording.
    fn record_status(&mut self) {
        let status = self.shared.status();
        let channels = status.runs.last().map_or_else(Vec::new, |run| {
            let count = |c: &ChannelCounts| proto::ChannelCount {
                channel: c.channel.name().to_owned(),
                received: c.received,
                missed: c.missed,
            };
            run.channels.iter().map(count).collect()
        });
        let message = proto::Recorder {
            epoch: self.epoch,
            channels,
            dropped: status.dropped,
            corrupt: status.corrupt,
            unrecorded: self.files.unrecorded,
            bytes: self.files.bytes(),
        };
        let at = self.at(MonotonicClock.now_ns());
        self.files.message(topic::RECORDER, self.tick, at.0, &message.encode_to_vec());
    }
}

/// What was lost so far, for the end of a file.
fn counts(status: &Status, unrecorded: u64) -> BTreeMap<String, String> {
    let fact = |name: &str, value: u64| (name.to_owned(), value.to_string());
    BTreeMap::from([
        fact("missed", status.missed()),
        fact("dropped", status.dropped),
        fact("corrupt", status.corrupt),
        fact("unrecorded", unrecorded),
    ])
}
