use std::cell::{Cell, RefCell};
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::AtomicU32;

use super::decider::Decider;
use super::error::DaemonError;
use super::progress::Progress;
use super::unthreaded::{Crew, Outline, build};
use crate::channel::{Attachment, CommandReader, Transport, Writer};
use crate::clock::{Clock, VirtualTime};
use crate::config::Config;
use crate::controller::{ControllerError, Decision, RobotGroup, RouteShelf};
use crate::model::{Command, RobotSpec};
use crate::plant::Plant;
use crate::report::Report;
use crate::source::{Instant, Observed, StateSource};
use crate::wire::{CommandHeader, RobotCommand, RobotObservation, RobotState};

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
        look: impl FnMut(&Progress),
    ) -> Result<Self, DaemonError> {
        config.timing.ticks = Some(ticks);
        let transport = Transport::new(&config.fleet, &config.channel)?;
        transport.check_room(config.places(), 0)?;
        let laps = Rc::new(Cell::new(0));
        let (now, robots) = (VirtualTime::new(start_ns), config.scenario.robots.clone());
        let turns = Rc::new(Turns { now: now.clone(), parts: RefCell::new(None), look: RefCell::new(look) });
        let (made, by) = (config.clone(), Rc::clone(&laps));
        let outline = Outline {
            transport,
            workers: 1,
            epoch: 1,
            start_ns,
            shelf: Arc::new(RouteShelf::new(config.places())),
            config: config.clone(),
        };
        let shuttle = |source| -> Box<dyn StateSource> {
            let (tolerance_m, laps) = (config.scenario.tolerance_m, Rc::clone(&laps));
            Box::new(Shuttle { source, robots, tolerance_m, laps })
        };
        let lap = move |_| Lap::new(&made, &by);
        let (control_loop, crew) = build(outline, Rc::clone(&turns), &now, lap, shuttle)?;
        let driver = Driver::new(&config, &crew.node, start_ns)?;
        turns.parts.replace(Some(Parts { driver, crew, worked: None }));
        let reason = control_loop.run();
        // The loop, and with it the clock that it had, is gone.
        let Some(Parts { mut driver, crew, .. }) = turns.parts.take() else {
            return Err(DaemonError::Panicked { thread: "loop" });
        };
        driver.receive(now.now_ns());
        let report = crew.report(reason);
        let Driver { commands, refused, observations, .. } = driver;
        Ok(Self { report, commands, refused, observations, laps: laps.get() })
    }
}

/// Controllers that begin anew with every lap.
struct Lap {
    config: Config,
    group: RobotGroup,
    number: u64,
    laps: Rc<Cell<u64>>,
}

impl Lap {
    fn new(config: &Config, laps: &Rc<Cell<u64>>) -> Option<Self> {
        let (number, laps) = (laps.get(), Rc::clone(laps));
        Some(Self { group: group(config, number).ok()?, config: config.clone(), number, laps })
    }
}

impl Decider for Lap {
    fn decide(&mut self, fleet: &[RobotState], each: &mut dyn FnMut(usize, &Decision)) {
        let lap = self.laps.get();
        if self.number != lap
            && let Ok(group) = group(&self.config, lap)
        {
            (self.group, self.number) = (group, lap);
        }
        Decider::decide(&mut self.group, fleet, each);
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
    driver: Driver,
    crew: Crew<VirtualTime, Lap>,
    /// The tick that was worked through last.
    worked: Option<u64>,
}

/// A clock that lets the others have their turns while the loop waits.
struct Turns<F> {
    now: VirtualTime,
    parts: RefCell<Option<Parts>>,
    look: RefCell<F>,
}

impl<F: FnMut(&Progress)> Turns<F> {
    fn work(&self, parts: &mut Parts, tick: u64) {
        if parts.worked.replace(tick) == Some(tick) {
            return;
        }
        parts.crew.work(0);
        if tick.is_multiple_of(ROUND) {
            parts.crew.keep_house();
        }
        if tick.is_multiple_of(LOOK) {
            (self.look.borrow_mut())(&parts.crew.progress());
        }
    }
}

impl<F: FnMut(&Progress)> Clock for Rc<Turns<F>> {
    fn now_ns(&self) -> u64 {
        self.now.now_ns()
    }

    /// The loop sleeps until the next period: the driver moves its robots there and says where they are.
    fn sleep_until(&self, wake_ns: u64) {
        let now_ns = self.now_ns();
        self.now.sleep_until(wake_ns);
        if let Some(parts) = &mut *self.parts.borrow_mut() {
            parts.driver.drive(now_ns, self.now_ns());
        }
    }

    fn spin_until(&self, wake_ns: u64) {
        self.sleep_until(wake_ns);
    }

    /// The loop waits for the worker.
    fn wait(&self, _: &AtomicU32, _: u32, wake_ns: u64) {
        let mut parts = self.parts.borrow_mut();
        match parts.as_mut().and_then(|parts| Some((parts.crew.released()?, parts))) {
            Some((tick, parts)) => self.work(parts, tick),
            None => self.now.sleep_until(wake_ns),
        }
    }
}

/// Robots in another process: their motion, and the gate in front of it.
struct Driver {
    plant: Plant,
    reader: CommandReader,
    writer: Writer<RobotObservation>,
    ids: Vec<u32>,
    epoch: u64,
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
            epoch: 0,
            commands: 0,
            refused: 0,
            observations: 0,
        })
    }

    /// Takes the commands that have come by `now_ns`.
    fn receive(&mut self, now_ns: u64) {
        while let Ok(Some(sample)) = self.reader.next() {
            self.commands += 1;
            self.epoch = sample.header().epoch;
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
        let (ids, epoch, plant, poses) = (&self.ids, &self.epoch, &self.plant, self.plant.poses());
        // A failure shows: the daemon hears nothing, and says so.
        let _ = self.writer.publish(|header, records| {
            (header.epoch, header.sequence, header.stamp_ns) = (*epoch, self.observations, to_ns);
            for (index, ((record, pose), id)) in records.iter_mut().zip(poses).zip(ids).enumerate() {
                let (x_m, y_m, holding) = (pose.position_m.x, pose.position_m.y, plant.holding(index).code());
                *record = RobotObservation { id: *id, holding, x_m, y_m, theta_rad: pose.theta_rad };
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
    fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]) {
        self.source.observe(instant, clock, states);
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
