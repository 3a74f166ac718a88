use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::atomic::AtomicU32;
use std::sync::{Arc, Mutex, PoisonError};

use super::Until;
use super::board::{Board, Released};
use super::control_loop::{ControlLoop, LoopMemory};
use super::desk::Desk;
use super::error::DaemonError;
use super::housekeeping::Housekeeper;
use super::progress::Progress;
use super::threads::{Common, record_capacity};
use super::worker::Worker;
use crate::channel::{Attachment, CommandReader, Transport, Writer};
use crate::clock::{Clock, SlowedClock};
use crate::config::{Config, PublishAt, SourceKind, Wakeup};
use crate::controller::{ControllerError, RobotGroup};
use crate::model::{Command, RobotSpec};
use crate::plant::Plant;
use crate::realtime::{Achieved, Role};
use crate::report::Report;
use crate::schedule::Schedule;
use crate::source::{Instant, Observed, StateSource};
use crate::telemetry::{PeriodRecord, Pool, SolveRecord};
use crate::wire::{CommandHeader, NO_ROBOT, RobotCommand, RobotObservation, RobotState};

/// Periods between two rounds of housekeeping, and between two looks of the caller.
const ROUND: u64 = 32;
const LOOK: u64 = 1024;

/// A run of the whole daemon as fast as the machine allows, in one thread and in virtual time.
///
/// The loop, a worker, housekeeping and a driver with its own plant and gate take turns; they are the
/// daemon's own, and speak over the channels in shared memory. Whenever everybody has arrived, starts
/// and goals change places and the controllers begin anew, so that robots never stop driving for long.
/// Times between two threads say nothing here.
#[derive(Debug)]
pub struct Accelerated {
    /// The daemon's report.
    pub report: Report,
    /// Command samples that the driver received.
    pub commands: u64,
    /// Commands that its gates refused.
    pub refused: u64,
    /// Observation samples that it sent.
    pub observations: u64,
    /// Times that everybody arrived.
    pub laps: u64,
}

impl Accelerated {
    /// Runs `ticks` periods from the configuration's first one, with the clock at `start_ns`; `look` is
    /// shown the run from time to time.
    ///
    /// # Errors
    /// The reasons for which a channel or a controller cannot be made.
    pub fn run(
        mut config: Config,
        ticks: u64,
        start_ns: u64,
        mut look: impl FnMut(&Progress),
    ) -> Result<Self, DaemonError> {
        config.source.kind = SourceKind::Observation;
        config.timing.publish = PublishAt::Complete;
        config.timing.ticks = Some(ticks);
        // Places that nobody takes are part of every sample.
        let robots = config.places();
        let period_ns = config.timing.period_ns;
        let transport = Transport::new(&config.fleet, &config.channel)?;
        transport.check_room(robots)?;
        let mut ids: Vec<u32> = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
        ids.resize(robots, NO_ROBOT);
        let board = Arc::new(Board::new(ids, 1, Wakeup::Futex));
        let config = Arc::new(config);
        let common = Common {
            config: Arc::clone(&config),
            transport,
            board: Arc::clone(&board),
            desk: Arc::new(Desk::new(4)),
            epoch: 1,
            clock: SlowedClock::default(),
            source: None,
        };
        let node = common.transport.attach("clearwayd")?;
        let (states, commands) = (node.writer(robots)?, node.writer(robots)?);
        let reader = node.reader_or_create(robots)?;
        let capacity = record_capacity(&config);
        let periods = Arc::new(Pool::new(capacity, || PeriodRecord::with_robots(robots)));
        let solves = Arc::new(Pool::new(capacity, || SolveRecord::with_room(robots)));
        let progress = Arc::new(Mutex::new(Progress { robots, ..Progress::default() }));
        let housekeeper = Housekeeper::new(
            &common,
            Until::Stopped,
            Arc::clone(&periods),
            vec![Arc::clone(&solves)],
            Arc::clone(&progress),
            None,
        )?;
        let laps = Rc::new(Cell::new(0));
        let first_tick = config.timing.first_tick;
        let parts = Parts {
            worker: Worker {
                index: 0,
                wakeup: Wakeup::Futex,
                due_ns: 0,
                owned: 0..robots,
                robots,
                epoch: common.epoch,
                clock: common.clock,
                states: node.reader()?,
                board: Arc::clone(&board),
                records: solves,
            },
            group: group(&config, 0).map_err(|e| DaemonError::Controller {
                worker: Role::Worker(0).to_string(),
                reason: e.to_string(),
            })?,
            group_lap: 0,
            driver: Driver::new(&config, &node, start_ns)?,
            housekeeper,
            worked: None,
        };
        let turns = Turns {
            now_ns: Cell::new(start_ns),
            parts: RefCell::new(parts),
            config: &config,
            board: &board,
            laps: Rc::clone(&laps),
            look: RefCell::new(|| look(&progress.lock().unwrap_or_else(PoisonError::into_inner))),
        };
        let mut control_loop = ControlLoop {
            clock: &turns,
            schedule: Schedule::new(start_ns, period_ns, config.timing.margin_ns()).numbered_from(first_tick),
            epoch: common.epoch,
            tick_end: common.tick_end(Until::Stopped),
            tolerance_m: config.scenario.tolerance_m,
            limits: config.scenario.limits,
            states,
            commands,
            source: Box::new(Shuttle {
                source: Observed::with_places(reader, &config.scenario, &config.source, period_ns, robots),
                robots: config.scenario.robots.clone(),
                tolerance_m: config.scenario.tolerance_m,
                laps: Rc::clone(&laps),
            }),
            board: Arc::clone(&board),
            publish_at: PublishAt::Complete,
            wakeup: Wakeup::Futex,
            records: periods,
            desk: Arc::clone(&common.desk),
            memory: LoopMemory::new(common.first_states()),
        };
        let reason = control_loop.run();
        drop(control_loop);
        let Parts { mut driver, housekeeper, .. } = turns.parts.into_inner();
        driver.receive(turns.now_ns.get());
        let findings = housekeeper.run();
        let report = findings.report(&config, &Achieved::default(), reason, 1, 0);
        let Driver { commands, refused, observations, .. } = driver;
        Ok(Self { report, commands, refused, observations, laps: laps.get() })
    }
}

/// The controllers of lap `lap`: back and forth.
fn group(config: &Config, lap: u64) -> Result<RobotGroup, ControllerError> {
    let mut config = config.clone();
    if lap % 2 == 1 {
        config.scenario.robots.iter_mut().for_each(turn_round);
    }
    RobotGroup::new(&config, 0..config.places())
}

fn turn_round(robot: &mut RobotSpec) {
    (robot.start.position_m, robot.goal_m) = (robot.goal_m, robot.start.position_m);
}

/// Everybody but the loop.
struct Parts {
    worker: Worker,
    group: RobotGroup,
    group_lap: u64,
    driver: Driver,
    housekeeper: Housekeeper,
    /// The tick that was worked through last.
    worked: Option<u64>,
}

/// A clock that lets the others have their turns while the loop waits.
struct Turns<'a, F> {
    now_ns: Cell<u64>,
    parts: RefCell<Parts>,
    config: &'a Config,
    board: &'a Board,
    laps: Rc<Cell<u64>>,
    look: RefCell<F>,
}

impl<F: FnMut()> Turns<'_, F> {
    fn work(&self, tick: u64) {
        let parts = &mut *self.parts.borrow_mut();
        if parts.worked.replace(tick) == Some(tick) {
            return;
        }
        let lap = self.laps.get();
        if parts.group_lap != lap
            && let Ok(group) = group(self.config, lap)
        {
            (parts.group, parts.group_lap) = (group, lap);
        }
        parts.worker.period(tick, &mut parts.group);
        self.board.done(tick);
        if tick.is_multiple_of(ROUND) {
            parts.housekeeper.round();
        }
        if tick.is_multiple_of(LOOK) {
            (self.look.borrow_mut())();
        }
    }
}

impl<F: FnMut()> Clock for &Turns<'_, F> {
    fn now_ns(&self) -> u64 {
        self.now_ns.get()
    }

    /// The loop sleeps until the next period: the driver moves its robots there and says where they are.
    fn sleep_until(&self, wake_ns: u64) {
        let now_ns = self.now_ns.get();
        self.now_ns.set(wake_ns.max(now_ns));
        self.parts.borrow_mut().driver.drive(now_ns, self.now_ns.get());
    }

    fn spin_until(&self, wake_ns: u64) {
        self.sleep_until(wake_ns);
    }

    /// The loop waits for the worker.
    fn wait(&self, _: &AtomicU32, _: u32, wake_ns: u64) {
        match self.board.released(None) {
            Released::Tick(tick) => self.work(tick),
            _ => self.now_ns.set(wake_ns),
        }
    }
}

/// Robots in another process: their motion, and the gate in front of it.
struct Driver {
    plant: Plant,
    reader: CommandReader,
    writer: Writer<RobotObservation>,
    ids: Vec<u32>,
    commands: u64,
    refused: u64,
    observations: u64,
}

impl Driver {
    fn new(config: &Config, node: &Attachment, start_ns: u64) -> Result<Self, DaemonError> {
        let ids: Vec<u32> = config.scenario.robots.iter().map(|robot| robot.id.0).collect();
        Ok(Self {
            plant: Plant::new(&config.scenario, config.timing.period_ns, start_ns),
            reader: node.reader()?,
            writer: node.writer(ids.len())?,
            ids,
            commands: 0,
            refused: 0,
            observations: 0,
        })
    }

    /// Takes the commands that have come by `now_ns`.
    fn receive(&mut self, now_ns: u64) {
        while let Ok(Some(sample)) = self.reader.next() {
            self.commands += 1;
            for (index, command) in sample.robots().iter().enumerate().take(self.ids.len()) {
                self.refused +=
                    u64::from(self.plant.command(index, sample.header(), command, now_ns).is_err());
            }
        }
    }

    fn drive(&mut self, now_ns: u64, to_ns: u64) {
        self.receive(now_ns);
        self.plant.advance(to_ns);
        self.observations += 1;
        let (ids, poses) = (&self.ids, self.plant.poses());
        // A failure shows: the daemon hears nothing, and says so.
        let _ = self.writer.publish(|header, records| {
            (header.sequence, header.stamp_ns) = (self.observations, to_ns);
            for ((record, pose), id) in records.iter_mut().zip(poses).zip(ids) {
                let (x_m, y_m) = (pose.position_m.x, pose.position_m.y);
                *record = RobotObservation { id: *id, reserved: 0, x_m, y_m, theta_rad: pose.theta_rad };
            }
        });
    }
}

/// Observed states, whose goals and starts change places when everybody has arrived.
struct Shuttle {
    source: Observed,
    robots: Vec<RobotSpec>,
    tolerance_m: f64,
    laps: Rc<Cell<u64>>,
}

impl StateSource for Shuttle {
    fn observe(&mut self, instant: Instant, states: &mut [RobotState]) {
        self.source.observe(instant, states);
        let arrived = |state: &RobotState| {
            (state.position_m() - state.goal_m()).norm() <= self.tolerance_m
                && state.command() == Command::STOP
        };
        if !states.iter().take(self.robots.len()).all(arrived) {
            return;
        }
        self.laps.set(self.laps.get() + 1);
        for (robot, state) in self.robots.iter_mut().zip(states) {
            turn_round(robot);
            (state.goal_x_m, state.goal_y_m) = (robot.goal_m.x, robot.goal_m.y);
        }
    }

    fn knows_all(&self) -> bool {
        self.source.knows_all()
    }

    fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.source.admit(index, robot);
    }

    fn dismiss(&mut self, index: usize) {
        self.source.dismiss(index);
    }

    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
        self.source.commit(header, commands, now_ns);
    }

    fn rejections(&self) -> crate::admission::Rejections {
        self.source.rejections()
    }
}
