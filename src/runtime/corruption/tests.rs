//! Every bit of an observation, of a state and of a command flips on its way, one at a time: whoever
//! was to act on it refuses and counts it. Eight robots, over channels in memory.

use std::os::unix::fs::FileExt;
use std::sync::Arc;
use std::sync::atomic::Ordering;

use super::board::Board;
use super::decider::{Claims, Decider};
use super::tests::support::World;
use super::worker::Worker;
use crate::admission::Rejection;
use crate::channel::memory::{Memory, Message, Queue};
use crate::channel::{Attachment, Reader, Record, StateReader, Transport, Writer};
use crate::clock::VirtualClock;
use crate::config::{ChannelConfig, Config, Wakeup};
use crate::controller::{Decision, Remembered, RobotGroup, Robots};
use crate::model::Command;
use crate::robots::{Link, RemoteRobots};
use crate::scenario::Scenario;
use crate::source::{Instant, Observed, StateSource};
use crate::telemetry::{Pool, SolveRecord};
use crate::wire::{
    CommandHeader, RobotCheckpoint, RobotCommand, RobotObservation, RobotState, StopReason, state_flags,
};

const T: u64 = 80_000_000;
const NOW: u64 = 1_000 * T;
const EPOCH: u64 = 7;
const ROBOTS: usize = 8;

fn attach() -> Attachment {
    let transport = Transport::new("default", &ChannelConfig::default()).unwrap();
    transport.in_memory(Arc::new(Memory::default())).attach("test").unwrap()
}

fn config() -> Config {
    Config::new(Scenario::builtin("swap8").unwrap())
}

/// A worker that has the whole fleet.
fn worker(states: StateReader, board: &Arc<Board>) -> Worker<VirtualClock> {
    Worker {
        index: 0,
        wakeup: Wakeup::Futex,
        due_ns: 0,
        owned: 0..ROBOTS,
        robots: ROBOTS,
        epoch: EPOCH,
        clock: VirtualClock::new(NOW),
        states,
        board: Arc::clone(board),
        records: Arc::new(Pool::new(4, || SolveRecord::with_room(ROBOTS))),
    }
}

fn states(config: &Config) -> Vec<RobotState> {
    let seen = |robot| RobotState { flags: state_flags::VALID, ..RobotState::at_start(robot) };
    config.scenario.robots.iter().map(seen).collect()
}

/// A queue of one channel that what is published waits in, and what was published.
struct Way<R: Record> {
    queue: Arc<Queue<R>>,
    sample: Message<R>,
}

impl<R: Record> Way<R> {
    /// Publishes once and takes the sample away again.
    fn new(reader: &Reader<R>, writer: &mut Writer<R>, fill: impl FnOnce(&mut R::Header, &mut [R])) -> Self {
        let queue = Arc::clone(reader.queue().unwrap());
        writer.publish(fill).unwrap();
        let sample = queue.edit(std::collections::VecDeque::pop_front).unwrap();
        assert_eq!(sample.robots.len(), ROBOTS);
        Self { queue, sample }
    }

    fn put(&self, change: impl FnOnce(&mut Message<R>)) {
        let mut sample = self.sample.clone();
        change(&mut sample);
        self.queue.edit(|waiting| waiting.push_back(sample));
    }

    /// Bits of the header and of the records.
    fn bits(&self) -> usize {
        8 * (size_of::<R::Header>() + size_of_val(&*self.sample.robots))
    }

    /// Puts the sample into the queue with one bit flipped.
    fn put_flipped(&self, bit: usize) {
        self.put(|sample| {
            let head = bytemuck::bytes_of_mut(&mut sample.header);
            let body = bytemuck::cast_slice_mut(Arc::make_mut(&mut sample.robots));
            let byte = head.iter_mut().chain(body).nth(bit / 8).unwrap();
            *byte ^= 1 << (bit % 8);
        });
    }

    /// Puts every prefix of the sample into the queue, and one with a record too many. How many.
    fn put_cut(&self) -> u64 {
        for records in 0..ROBOTS {
            self.put(|sample| sample.robots = Arc::from(&sample.robots[..records]));
        }
        self.put(|sample| sample.robots = sample.robots.iter().chain(&sample.robots[..1]).copied().collect());
        ROBOTS as u64 + 1
    }
}

#[test]
fn no_bit_of_an_observation() {
    let (node, config) = (attach(), config());
    let reader = node.reader().unwrap();
    let mut writer: Writer<RobotObservation> = node.writer(ROBOTS).unwrap();
    let way = Way::new(&reader, &mut writer, |header, records| {
        (header.epoch, header.sequence, header.stamp_ns) = (EPOCH, 1, NOW);
        for (record, robot) in records.iter_mut().zip(&config.scenario.robots) {
            let pose = robot.start;
            let (x_m, y_m) = (pose.position_m.x, pose.position_m.y);
            *record = RobotObservation { id: robot.id.0, holding: 0, x_m, y_m, theta_rad: pose.theta_rad };
        }
    });
    let mut source = Observed::new(reader, &config.scenario, &config.source, T);
    let mut fleet: Vec<RobotState> = config.scenario.robots.iter().map(RobotState::at_start).collect();
    let before = fleet.clone();
    let mut observe = |source: &mut Observed| {
        let instant = Instant { epoch: EPOCH, release_ns: NOW, now_ns: NOW };
        source.observe(instant, &VirtualClock::new(NOW), &mut fleet);
        (source.rejections(), fleet.clone())
    };
    let mut refused = 0;
    for bit in 0..way.bits() {
        way.put_flipped(bit);
        let (rejections, fleet) = observe(&mut source);
        refused += 1;
        let counted = (rejections.get(Rejection::Corrupt), rejections.total());
        assert_eq!((counted, rejections.skipped_samples), ((refused, refused), 0), "bit {bit}");
        assert_eq!(fleet, before, "bit {bit}");
    }
    refused += way.put_cut();
    let (rejections, fleet) = observe(&mut source);
    assert_eq!((rejections.total(), fleet == before), (refused, true));
    // It was not the rest of the sample: as it was sealed, everybody is seen.
    way.put(|_| ());
    let (rejections, fleet) = observe(&mut source);
    assert!(rejections.total() == refused && fleet.iter().all(|robot| robot.has(state_flags::VALID)));
}

#[test]
fn no_bit_of_a_state() {
    const TICK: u64 = 5;
    let (node, config) = (attach(), config());
    let reader: StateReader = node.reader().unwrap();
    let mut writer: Writer<RobotState> = node.writer(ROBOTS).unwrap();
    let way = Way::new(&reader, &mut writer, |header, records| {
        (header.epoch, header.tick, header.stamp_ns) = (EPOCH, TICK, NOW);
        (header.release_ns, header.period_ns) = (NOW, T);
        records.copy_from_slice(&states(&config));
    });
    let ids = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
    let board = Arc::new(Board::new(ids, 1, Wakeup::Futex));
    let mut worker = worker(reader, &board);
    let mut group = RobotGroup::new(&config, 0..ROBOTS).unwrap();
    let untouched = |group: &RobotGroup| {
        let mut words = Vec::new();
        group.checkpoint(&mut |_, memory| words.push(memory.checkpoint()));
        words
    };
    let before = untouched(&group);
    for bit in 0..way.bits() {
        way.put_flipped(bit);
        worker.period(TICK, &mut group);
        assert_eq!(board.corrupt_states.load(Ordering::Relaxed), bit as u64 + 1, "bit {bit}");
        assert!(board.is_corrupt(TICK) && !board.is_corrupt(TICK + 1));
        assert!((0..ROBOTS).all(|robot| board.staging.take(robot, TICK).is_none()), "bit {bit}");
    }
    assert_eq!(worker.states.corrupt(), way.bits() as u64);
    // Nor do the controllers remember anything of it.
    assert_eq!(untouched(&group), before);
    way.put(|_| ());
    worker.period(TICK, &mut group);
    assert!(board.staging.complete(TICK));
    assert_eq!(board.corrupt_states.load(Ordering::Relaxed), way.bits() as u64);
}

/// Controllers during whose decision somebody writes over the state, in shared memory itself.
struct Struck<'a> {
    inner: RobotGroup,
    world: &'a World,
    strikes: bool,
}

impl Struck<'_> {
    /// Moves the first robot by half a metre, in every sample that says the same.
    fn strike(&self, fleet: &[RobotState]) {
        let whole: &[u8] = bytemuck::cast_slice(fleet);
        let moved = RobotState { x_m: fleet[0].x_m + 0.5, ..fleet[0] };
        let mut struck = 0;
        for path in self.world.files().iter().filter(|_| self.strikes) {
            let content = std::fs::read(path).unwrap();
            let file = std::fs::OpenOptions::new().write(true).open(path).unwrap();
            let samples = content.windows(whole.len()).enumerate().filter(|(_, window)| *window == whole);
            for (at, _) in samples {
                file.write_all_at(bytemuck::bytes_of(&moved), at as u64).unwrap();
                struck += 1;
            }
        }
        assert_eq!(struck > 0, self.strikes);
    }
}

impl Decider for Struck<'_> {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        self.strike(fleet);
        Decider::decide(&mut self.inner, fleet, each);
    }
    fn is_regional(&self) -> bool {
        self.inner.is_regional()
    }
    fn decide_parts(
        &mut self,
        (tick, parts): (u64, Claims),
        fleet: &[RobotState],
        remember: &mut dyn FnMut(usize, &Remembered),
        each: &mut dyn FnMut(usize, &Decision),
    ) {
        self.strike(fleet);
        Decider::decide_parts(&mut self.inner, (tick, parts), fleet, remember, each);
    }
    fn checkpoint(&self, each: &mut dyn FnMut(usize, &Remembered)) {
        Decider::checkpoint(&self.inner, each);
    }
    fn undo(&mut self, index: usize, tick: u64, before: &RobotCheckpoint) {
        self.inner.undo(index, tick, before);
    }
}

/// What is answered in periods 5 to 7, with somebody who writes over the state of period 6 or without: by
/// robot, the command if anybody may act on it and what was remembered before.
fn answers(regional: bool, strikes: bool) -> Vec<Vec<(Option<RobotCommand>, Option<RobotCheckpoint>)>> {
    let (world, config) = (World::new("struck"), config());
    let node = Transport::new("default", &world.channel).unwrap().attach("test").unwrap();
    let mut writer: Writer<RobotState> = node.writer(ROBOTS).unwrap();
    let ids = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
    let board = Arc::new(Board::new(ids, 1, Wakeup::Futex));
    let mut worker = worker(node.reader().unwrap(), &board);
    let records = Arc::clone(&worker.records);
    let inner = if regional {
        RobotGroup::among(&config, Arc::new(Robots::new(&config))).unwrap()
    } else {
        RobotGroup::new(&config, 0..ROBOTS).unwrap()
    };
    let mut group = Struck { inner, world: &world, strikes: false };
    let period = |tick: u64| {
        writer
            .publish(|header, records| {
                (header.epoch, header.tick, header.stamp_ns) = (EPOCH, tick, NOW);
                (header.release_ns, header.period_ns) = (NOW, T);
                records.copy_from_slice(&states(&config));
            })
            .unwrap();
        board.release(tick);
        group.strikes = strikes && tick == 6;
        worker.period(tick, &mut group);
        let struck = u64::from(strikes && tick >= 6);
        assert_eq!(board.corrupt_states.load(Ordering::Relaxed), struck);
        assert_eq!((board.is_struck(tick), board.is_corrupt(tick)), (group.strikes, group.strikes));
        let mut answers = vec![(None, None); ROBOTS];
        records.read(|record| {
            record.checkpoints.iter().for_each(|(index, before)| answers[*index].1 = Some(*before));
            assert_eq!(record.robots.len(), if group.strikes { 0 } else { ROBOTS });
        });
        for (index, answer) in answers.iter_mut().enumerate().filter(|_| !board.is_struck(tick)) {
            answer.0 = board.staging.take(index, tick).map(|(command, _)| command);
        }
        answers
    };
    (5..8).map(period).collect()
}

#[test]
fn no_state_that_is_written_over_while_it_is_answered() {
    for regional in [false, true] {
        let (as_ever, struck) = (answers(regional, false), answers(regional, true));
        assert!(as_ever.iter().flatten().all(|(command, before)| command.is_some() && before.is_some()));
        assert_eq!(struck[0], as_ever[0]);
        assert!(struck[1].iter().all(|answer| *answer == (None, None)));
        // The controllers go on as if that period had not been.
        assert_eq!(struck[2], as_ever[1]);
    }
}

#[test]
fn no_bit_of_a_command() {
    let (node, config) = (attach(), config());
    let mut reader: Reader<RobotCommand> = node.reader().unwrap();
    let mut writer: Writer<RobotCommand> = node.writer(ROBOTS).unwrap();
    let way = Way::new(&reader, &mut writer, |header, records| {
        (header.epoch, header.tick) = (EPOCH, 1);
        (header.state_stamp_ns, header.stamp_ns) = (NOW - T, NOW - T);
        (header.valid_from_ns, header.valid_until_ns) = (NOW, NOW + T);
        for (record, robot) in records.iter_mut().zip(&config.scenario.robots) {
            *record = RobotCommand::verified(robot.id, Command { v_mps: 1.0, omega_radps: 0.1 });
        }
    });
    let mut robots = RemoteRobots::new(&config, config.scenario.clone(), Link::default(), NOW - T);
    // Nothing moves before it has held a stop.
    let stops: Vec<_> =
        config.scenario.robots.iter().map(|r| RobotCommand::stop(r.id, StopReason::Start)).collect();
    let first =
        CommandHeader { epoch: EPOCH, valid_from_ns: NOW - T, valid_until_ns: NOW, ..Default::default() };
    robots.hear(&first, &stops, NOW - T);
    let mut commands = Vec::new();
    let mut hear = |robots: &mut RemoteRobots, reader: &mut Reader<RobotCommand>| {
        while let Some(header) = reader.next_copy(&mut commands).unwrap() {
            robots.hear(&header, &commands, NOW);
        }
        robots.not_heard(reader.corrupt());
        (robots.commanded(), robots.report().commands)
    };
    let mut corrupt = 0;
    for bit in 0..way.bits() {
        way.put_flipped(bit);
        corrupt += 1;
        let (commanded, counts) = hear(&mut robots, &mut reader);
        assert_eq!((commanded, counts.corrupt), (0, corrupt), "bit {bit}");
        assert_eq!(
            (counts.accepted, counts.expired, counts.missed, counts.refused),
            (8, 0, 0, 0),
            "bit {bit}"
        );
    }
    // In place as well as copied.
    corrupt += way.put_cut() + 1;
    way.put_flipped(0);
    assert!(reader.next().unwrap().is_none() && reader.corrupt() == corrupt);
    way.put_flipped(way.bits() - 1);
    assert!(reader.newest().unwrap().is_none() && reader.corrupt() == corrupt + 1);
    way.put(|_| ());
    let (_, counts) = hear(&mut robots, &mut reader);
    assert_eq!((counts.accepted, counts.corrupt), (16, corrupt + 1));
}
