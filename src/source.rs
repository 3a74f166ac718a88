//! Where the fleet's states come from: the plant inside the daemon, or the `observation` channel.
//!
//! Reads the period's start and the commands that are in force, writes the poses at `t_k` and their
//! validity. Both sources answer for exactly `t_k`: an observation made a little earlier or later is
//! carried along the arcs of the commands that were in force between. So is the last good pose of a
//! robot that is not heard any more: it went on driving until it was told to stop, or has stopped on the
//! way, and its pose is the middle of that way, with half its length as uncertainty. A foreign robot
//! takes no commands; its pose stays where it was seen, with how far it may have come since. World
//! frame, metres, radians, `CLOCK_MONOTONIC` ns. Neither allocates after it is made.

use crate::admission::{Admission, Rejection, Rejections};
use crate::channel::{NotCopied, ObservationReader};
use crate::clock::Clock;
use crate::config::SourceConfig;
use crate::geometry::{Arc, Pose};
use crate::model::{Command, Disturbance, RobotId, RobotSpec};
use crate::plant::Plant;
use crate::scenario::Scenario;
use crate::wire::{CommandHeader, NO_ROBOT, RobotCommand, RobotObservation, RobotState, state_flags};

/// Observation samples looked at in one period for each robot; the rest waits, and is then stale.
const SAMPLES_PER_ROBOT: usize = 16;

/// The instant whose state is wanted.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Instant {
    /// Which run of the daemon.
    pub epoch: u64,
    /// `t_k`, ns.
    pub release_ns: u64,
    /// Now: `t_k` and what the wake-up was late, ns.
    pub now_ns: u64,
}

/// A source of states.
pub trait StateSource {
    /// Writes the poses of all robots at `t_k` and their uncertainty, one for each place, and sets or
    /// clears [`state_flags::VALID`]; leaves everything else, and free places. `clock` tells the time that
    /// has come since `instant`.
    fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]);

    /// Whether it knows where every robot is without being told.
    fn knows_all(&self) -> bool;

    /// A robot takes the `index`-th place, at rest at its start.
    fn admit(&mut self, index: usize, robot: &RobotSpec);

    /// The robot in the `index`-th place is taken away.
    fn dismiss(&mut self, index: usize);

    /// Learns which commands were published at `now_ns`.
    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64);

    /// What was refused so far.
    fn rejections(&self) -> Rejections;
}

fn set_pose(state: &mut RobotState, pose: Pose, uncertainty_m: f64, valid: bool) {
    state.set_pose(pose);
    state.uncertainty_m = uncertainty_m;
    state.flags = if valid { state.flags | state_flags::VALID } else { state.flags & !state_flags::VALID };
}

impl StateSource for Plant {
    fn observe(&mut self, instant: Instant, _: &dyn Clock, states: &mut [RobotState]) {
        self.advance(instant.release_ns);
        for (index, state) in states.iter_mut().enumerate() {
            if let Some(pose) = self.seen(index).filter(|_| !state.has(state_flags::VACANT)) {
                set_pose(state, pose, 0.0, true);
            }
        }
    }

    fn knows_all(&self) -> bool {
        true
    }

    fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.place(index, robot.id, robot.start);
    }

    fn dismiss(&mut self, index: usize) {
        self.place(index, RobotId(NO_ROBOT), Pose::default());
    }

    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
        for (index, command) in commands.iter().enumerate() {
            // A refusal is the gate's own affair: that robot stands still.
            let _ = self.command(index, header, command, now_ns);
        }
    }

    fn rejections(&self) -> Rejections {
        Rejections::default()
    }
}

/// Samples in a row with the same pose, of a robot that is told to drive, before it counts as frozen.
const FROZEN_AFTER: u32 = 10;
/// What a robot must have been told to move between two samples for that, m.
const FROZEN_MOTION_M: f64 = 1e-3;

/// One robot's last sample, and how often it came again while the robot was told to drive.
#[derive(Debug, Clone, Copy, Default)]
struct Stillness {
    last: Option<(Pose, u64)>,
    again: u32,
}

impl Stillness {
    /// Takes the newest sample and where the robot should be by then; whether it has just frozen.
    fn add(&mut self, pose: Pose, stamp_ns: u64, expected: impl FnOnce(Pose, u64) -> Pose) -> bool {
        let Some((last, last_ns)) = self.last.replace((pose, stamp_ns)) else { return false };
        if stamp_ns == last_ns {
            return false;
        }
        let told_m = (expected(last, last_ns).position_m - last.position_m).norm();
        if pose != last {
            self.again = 0;
        } else if told_m >= FROZEN_MOTION_M {
            self.again = self.again.saturating_add(1);
        }
        pose == last && told_m >= FROZEN_MOTION_M && self.again == FROZEN_AFTER
    }
}

/// States from other processes.
#[derive(Debug)]
pub struct Observed {
    stillness: Vec<Stillness>,
    frozen_robots: u64,
    reader: ObservationReader,
    /// The sample that is looked at: a copy that nobody else can write to.
    copy: Vec<RobotObservation>,
    admission: Admission,
    held: Held,
    carried: Vec<Option<Carried>>,
    foreign_speed_mps: Vec<Option<f64>>,
    /// How far a robot may be from its start before it is seen, m.
    unseen_m: Vec<f64>,
    samples_max: usize,
}

/// A good observation, carried on to where its robot is at `at_ns`.
#[derive(Debug, Clone, Copy)]
struct Carried {
    seen: (Pose, u64),
    pose: Pose,
    at_ns: u64,
    /// Length of the way from where it was seen, m.
    way_m: f64,
}

impl Carried {
    /// Where a robot that is not heard any more is taken to be, and how far from there it may be, m.
    ///
    /// What keeps it from being heard may keep it from hearing: it may have stopped anywhere on the way.
    /// From the middle between its ends no point of the way is further than half of its length.
    fn unheard(&self) -> (Pose, f64) {
        let position_m = (self.seen.0.position_m + self.pose.position_m) * 0.5;
        (Pose { position_m, ..self.pose }, 0.5 * self.way_m)
    }
}

impl Observed {
    /// States of the scenario's robots from `reader`.
    pub fn new(
        reader: ObservationReader,
        scenario: &Scenario,
        config: &SourceConfig,
        period_ns: u64,
    ) -> Self {
        Self::with_places(reader, scenario, config, period_ns, scenario.robots.len())
    }

    /// The same with room for robots that are added later.
    pub fn with_places(
        reader: ObservationReader,
        scenario: &Scenario,
        config: &SourceConfig,
        period_ns: u64,
        places: usize,
    ) -> Self {
        let robots = places.max(scenario.robots.len());
        let foreign = |index| scenario.robots.get(index).and_then(|r: &RobotSpec| r.foreign_speed_mps);
        Self {
            stillness: vec![Stillness::default(); robots],
            frozen_robots: 0,
            reader,
            copy: Vec::with_capacity(robots),
            admission: Admission::new(scenario, config, period_ns).with_places(robots),
            held: Held::new(robots, history(config.max_age_or_default_ns(period_ns), period_ns)),
            carried: vec![None; robots],
            foreign_speed_mps: (0..robots).map(foreign).collect(),
            unseen_m: (0..robots).map(|index| foreign(index).map_or(0.0, |_| f64::INFINITY)).collect(),
            samples_max: SAMPLES_PER_ROBOT * robots,
        }
    }

    /// Accepts positions that jump by what these bounds explain as well.
    #[must_use]
    pub fn tolerating(self, bounds: &Disturbance) -> Self {
        Self { admission: self.admission.tolerating(bounds), ..self }
    }

    /// Robots of the scenario may stand anywhere until they are seen: they were driven before.
    #[must_use]
    pub fn standing_anywhere(mut self) -> Self {
        self.unseen_m.fill(f64::INFINITY);
        self
    }

    /// Where robot `index`, last seen at a pose and its stamp, is at `release_ns`.
    ///
    /// Goes on from where it was carried to the last time, so that it does not matter how long ago it
    /// was seen: commands need not be remembered for longer than an observation may be old.
    fn carry(&mut self, index: usize, seen: (Pose, u64), release_ns: u64) -> Carried {
        let (pose, at_ns, before_m) = match self.carried[index] {
            Some(carried) if carried.seen == seen => (carried.pose, carried.at_ns, carried.way_m),
            _ => (seen.0, seen.1, 0.0),
        };
        let (pose, way_m) = self.held.carry(index, pose, at_ns, release_ns);
        let carried = Carried { seen, pose, at_ns: release_ns, way_m: before_m + way_m };
        self.carried[index] = Some(carried);
        carried
    }

    /// Forgets who stood at `index` and what it was told.
    fn forget(&mut self, index: usize) {
        if index < self.carried.len() {
            (self.carried[index], self.stillness[index]) = (None, Stillness::default());
            self.held.forget(index);
        }
    }

    /// Counts a robot of ours that was seen anew and has just frozen.
    fn watch(&mut self, index: usize, (pose, stamp_ns): (Pose, u64)) {
        let told = |from, from_ns| self.held.carry(index, from, from_ns, stamp_ns).0;
        self.frozen_robots += u64::from(self.stillness[index].add(pose, stamp_ns, told));
    }
}

/// Periods whose commands can lie between an observation of the greatest age and now: those it spans,
/// the one that it begins in, the one that is running, and the one whose commands are already out.
fn history(max_age_ns: u64, period_ns: u64) -> usize {
    usize::try_from(max_age_ns.div_ceil(period_ns.max(1))).unwrap_or(usize::MAX).saturating_add(3)
}

impl StateSource for Observed {
    fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]) {
        let mut now_ns = instant.now_ns;
        for _ in 0..self.samples_max {
            // A writer that cannot be mapped is one that is not heard: its robots become stale.
            let Ok(Some(sample)) = self.reader.next_unverified() else { break };
            match sample.copy_to(&mut self.copy, self.carried.len()) {
                Ok(header) => {
                    // It may have been made while those before it were looked at: what has been received is
                    // of the future only if it says so of a moment after that.
                    if header.stamp_ns > now_ns {
                        now_ns = now_ns.max(clock.now_ns());
                    }
                    self.admission.sample(sample.writer(), &header, &self.copy, instant.epoch, now_ns);
                }
                Err(NotCopied::Corrupt) => self.admission.refuse(Rejection::Corrupt),
                Err(NotCopied::TooLong) => self.admission.refuse(Rejection::Oversize),
            }
        }
        for (index, state) in states.iter_mut().enumerate() {
            if state.has(state_flags::VACANT) {
                continue;
            }
            let foreign = self.foreign_speed_mps.get(index).copied().flatten();
            let Some(seen) = self.admission.last_good(index) else {
                let start = self.admission.last_pose(index).unwrap_or(state.pose());
                set_pose(state, start, self.unseen_m.get(index).copied().unwrap_or(0.0), false);
                continue;
            };
            let valid = self.admission.pose(index, instant.now_ns).is_some();
            if let Some(speed_mps) = foreign {
                let age_s = instant.release_ns.abs_diff(seen.1) as f64 * 1e-9;
                set_pose(state, seen.0, speed_mps * age_s, valid);
                continue;
            }
            if valid {
                self.watch(index, seen);
            }
            let carried = self.carry(index, seen, instant.release_ns);
            let (pose, unknown_m) = if valid { (carried.pose, 0.0) } else { carried.unheard() };
            set_pose(state, pose, unknown_m, valid);
        }
    }

    fn knows_all(&self) -> bool {
        false
    }

    fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.admission.admit(index, robot);
        if let Some(unseen_m) = self.unseen_m.get_mut(index) {
            // Whoever adds it says where it stands.
            *unseen_m = 0.0;
        }
        self.forget(index);
    }

    fn dismiss(&mut self, index: usize) {
        self.admission.dismiss(index);
        self.forget(index);
    }

    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], _now_ns: u64) {
        self.held.remember(header, commands);
    }

    fn rejections(&self) -> Rejections {
        let mut rejections = *self.admission.rejections();
        rejections.frozen_robots = self.frozen_robots;
        rejections
    }
}

/// The commands of the last periods.
#[derive(Debug)]
struct Held {
    periods: Vec<(u64, u64, Vec<Command>)>,
    newest: usize,
}

impl Held {
    fn new(robots: usize, history: usize) -> Self {
        Self { periods: vec![(0, 0, vec![Command::STOP; robots]); history], newest: 0 }
    }

    fn remember(&mut self, header: &CommandHeader, commands: &[RobotCommand]) {
        // What acts from now on ends what was to act then.
        for (_, until_ns, _) in &mut self.periods {
            *until_ns = (*until_ns).min(header.valid_from_ns);
        }
        self.newest = (self.newest + 1) % self.periods.len();
        let (from_ns, until_ns, held) = &mut self.periods[self.newest];
        (*from_ns, *until_ns) = (header.valid_from_ns, header.valid_until_ns);
        for (held, command) in held.iter_mut().zip(commands) {
            *held = command.command();
        }
    }

    fn forget(&mut self, index: usize) {
        for (_, _, held) in &mut self.periods {
            held[index] = Command::STOP;
        }
    }

    /// Where robot `index`, seen at `pose` at `stamp_ns`, is at `at_ns`, which may also lie before, and the
    /// length of the way between, m.
    fn carry(&self, index: usize, pose: Pose, stamp_ns: u64, at_ns: u64) -> (Pose, f64) {
        let (start_ns, end_ns) = (stamp_ns.min(at_ns), stamp_ns.max(at_ns));
        let backwards = at_ns < stamp_ns;
        let (mut pose, mut way_m) = (pose, 0.0);
        let history = self.periods.len();
        // Those that end after the start: a handful of the newest.
        let recent = (0..history)
            .take_while(|back| self.periods[(self.newest + history - back) % history].1 > start_ns)
            .count();
        // Oldest first, or newest first when going back in time.
        for step in 0..recent {
            let back = if backwards { step } else { recent - 1 - step };
            let (from_ns, until_ns, held) = &self.periods[(self.newest + history - back) % history];
            let overlap_ns = end_ns.min(*until_ns).saturating_sub(start_ns.max(*from_ns));
            let Some(command) = held.get(index).filter(|_| overlap_ns > 0) else { continue };
            let s = overlap_ns as f64 * 1e-9;
            let arc = Arc { start: pose, v_mps: command.v_mps, omega_radps: command.omega_radps };
            pose = arc.pose(if backwards { -s } else { s });
            way_m += command.v_mps.abs() * s;
        }
        (pose, way_m)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::memory::Memory;
    use crate::channel::{Transport, Writer};
    use crate::clock::VirtualClock;
    use crate::config::ChannelConfig;
    use crate::model::RobotId;

    const T: u64 = 100;

    fn held() -> Held {
        let mut held = Held::new(1, 8);
        for tick in 1..5_u64 {
            let header = CommandHeader {
                tick,
                valid_from_ns: tick * T,
                valid_until_ns: (tick + 1) * T,
                ..CommandHeader::default()
            };
            // 10⁷ m/s for 100 ns is a metre.
            let command = Command { v_mps: 1e7 * tick as f64, omega_radps: 0.0 };
            held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
        }
        held
    }

    #[test]
    fn an_observation_is_carried_along_the_commands_in_force() {
        let held = held();
        let x = |stamp, at| held.carry(0, Pose::new(10.0, 0.0, 0.0), stamp, at).0.position_m.x;
        let close = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} is not {b}");
        close(x(300, 300), 10.0);
        close(x(250, 300), 11.0);
        close(x(150, 350), 10.0 + 0.5 + 2.0 + 1.5);
        close(x(350, 300), 10.0 - 1.5);
        close(x(350, 150), 10.0 - 1.5 - 2.0 - 0.5);
        // Before the first and after the last command the robot stands.
        close(x(0, 200), 11.0);
        close(x(450, 10_000), 12.0);
    }

    /// Half a period late and half a period into the next: no command that matters is overwritten.
    #[test]
    fn the_oldest_observation_that_is_let_through_is_carried_over_every_command() {
        for periods in [1, 7, 8, 100] {
            let mut held = Held::new(1, history(periods * T, T));
            for tick in 0..1000_u64 {
                let header = CommandHeader {
                    tick,
                    valid_from_ns: tick * T,
                    valid_until_ns: (tick + 1) * T,
                    ..CommandHeader::default()
                };
                let command = Command { v_mps: 1e7, omega_radps: 0.0 };
                held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
                // The commands of `tick` are out, the state of the period before is wanted.
                let Some(now_ns) = (tick * T).checked_sub(T / 2) else { continue };
                let Some(stamp_ns) = now_ns.checked_sub(periods * T) else { continue };
                let (pose, _) = held.carry(0, Pose::new(0.0, 0.0, 0.0), stamp_ns, now_ns);
                assert!((pose.position_m.x - periods as f64).abs() < 1e-9, "{periods} {tick} {pose:?}");
            }
        }
    }

    #[test]
    fn a_pose_that_stays_although_the_robot_is_told_to_drive_is_an_alarm() {
        let ahead = |from: Pose, _| Pose::new(from.position_m.x + 0.1, 0.0, 0.0);
        let still = |from: Pose, _| from;
        let pose = Pose::new(1.0, 0.0, 0.0);
        let mut s = Stillness::default();
        // Nobody told it to move, or nothing new was said.
        assert!((0..50).all(|n| !s.add(pose, n, still)));
        assert!((0..50).all(|_| !s.add(pose, 49, ahead)));
        // One alarm, in the tenth sample.
        let alarms: Vec<u64> = (50..80).filter(|n| s.add(pose, *n, ahead)).collect();
        assert_eq!(alarms, [59]);
        // It moves again, and may freeze again.
        assert!(!s.add(Pose::new(1.1, 0.0, 0.0), 80, ahead));
        assert_eq!((81..100).filter(|n| s.add(pose, *n, ahead)).count(), 1);
    }

    #[test]
    fn forwards_and_backwards_cancel_on_arcs() {
        let mut held = Held::new(1, 8);
        for tick in 0..3_u64 {
            let header = CommandHeader {
                tick,
                valid_from_ns: tick * 80_000_000,
                valid_until_ns: (tick + 1) * 80_000_000,
                ..CommandHeader::default()
            };
            let command = Command { v_mps: 2.0, omega_radps: 0.3 * tick as f64 };
            held.remember(&header, &[RobotCommand::verified(RobotId(0), command)]);
        }
        let pose = Pose::new(1.0, 2.0, 0.5);
        let (there, way_m) = held.carry(0, pose, 10_000_000, 200_000_000);
        let (back, way_back_m) = held.carry(0, there, 200_000_000, 10_000_000);
        assert!((back.position_m - pose.position_m).norm() < 1e-12);
        assert!((back.theta_rad - pose.theta_rad).abs() < 1e-12);
        // 190 ms at 2 m/s.
        assert!((way_m - 0.38).abs() < 1e-12 && (way_back_m - way_m).abs() < 1e-12, "{way_m}");
    }

    #[test]
    fn of_the_future_is_what_is_stamped_later_than_it_was_received() {
        const NOW: u64 = 1_000_000_000;
        let transport = Transport::new("default", &ChannelConfig::default()).unwrap();
        let node = transport.in_memory(Memory::default().into()).attach("test").unwrap();
        let scenario = Scenario::builtin("swap8").unwrap();
        let robots = scenario.robots.len();
        let mut writer: Writer<RobotObservation> = node.writer(robots).unwrap();
        let reader = node.reader().unwrap();
        let mut source = Observed::new(reader, &scenario, &SourceConfig::default(), 80_000_000);
        let mut fleet: Vec<RobotState> = scenario.robots.iter().map(RobotState::at_start).collect();
        // Taking the samples begins at NOW; the last is taken 5 ms later.
        let (instant, clock) =
            (Instant { epoch: 7, release_ns: NOW, now_ns: NOW }, VirtualClock::new(NOW + 5_000_000));
        let mut valid_after = |sequence: u64, stamp_ns: u64| {
            let sent = writer.publish(|header, records| {
                (header.sequence, header.stamp_ns) = (sequence, stamp_ns);
                for (record, robot) in records.iter_mut().zip(&scenario.robots) {
                    let Pose { position_m, theta_rad } = robot.start;
                    let (x_m, y_m) = (position_m.x, position_m.y);
                    *record = RobotObservation { id: robot.id.0, reserved: 0, x_m, y_m, theta_rad };
                }
            });
            sent.unwrap();
            source.observe(instant, &clock, &mut fleet);
            let refused = source.rejections();
            (
                fleet.iter().all(|state| state.has(state_flags::VALID)),
                refused.get(Rejection::Future),
                refused.total(),
            )
        };
        assert_eq!(valid_after(1, NOW + 5_000_001), (false, 1, 1));
        assert_eq!(valid_after(2, NOW + 5_000_000), (true, 1, 1));
        assert_eq!(valid_after(3, NOW + 5_000_000), (true, 1, 1));
        assert_eq!(valid_after(4, u64::MAX), (true, 2, 2));
    }

    /// Wherever on its way a robot stopped that is not heard: it is where it may be.
    #[test]
    fn an_unheard_robot_is_within_its_uncertainty() {
        for omega_radps in [-1.0, 0.0, 0.4, 3.0] {
            let arc = Arc { start: Pose::new(1.0, 2.0, 0.5), v_mps: 2.0, omega_radps };
            let carried = Carried { seen: (arc.start, 0), pose: arc.pose(1.5), at_ns: 1, way_m: 3.0 };
            let (middle, unknown_m) = carried.unheard();
            for step in 0..=100 {
                let there = arc.position(0.015 * f64::from(step));
                assert!((there - middle.position_m).norm() <= unknown_m + 1e-12);
            }
        }
    }
}
