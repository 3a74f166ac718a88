//! The thread that writes a recording: samples from the queue, as messages into files.

use crate::configuration::{self, Answer, configuration_name, scenario_name};
use crate::convert::State;
use crate::files::{Enclosure, Files, Preamble};
use crate::schema::clearway as proto;
use crate::status::{ChannelCounts, Shared, Status};
use crate::tap::{Item, Queued, wall_offset_ns};
use crate::view::{self, FileTime};
use crate::{Options, topic};
use clearway::clock::{Clock, MonotonicClock};
use clearway::config::ChannelConfig;
use clearway::model::Obstacle;
use clearway::scenario::Scenario;
use prost::Message;
use std::collections::BTreeMap;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::sync::mpsc::{Receiver, RecvTimeoutError};
use std::time::{Duration, Instant};

/// How often the writer looks at the time when nothing comes.
const CHORES_EVERY: Duration = Duration::from_millis(50);
/// How often the state of the recording is recorded itself.
const STATUS_EVERY: Duration = Duration::from_secs(1);

/// The thread that writes.
pub(crate) struct WriterThread {
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
    pub(crate) fn new(
        fleet: &str,
        channel: ChannelConfig,
        options: Options,
        shared: Arc<Shared>,
        files: Files,
    ) -> Self {
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

    pub(crate) fn run(mut self, queue: &Receiver<Queued>) {
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
