use super::held::{Held, history};
use super::stillness::Stillness;
use super::{Instant, StateSource, set_pose};
use crate::admission::{Admission, Rejection, Rejections};
use crate::channel::{NotCopied, ObservationReader};
use crate::clock::Clock;
use crate::config::SourceConfig;
use crate::geometry::Pose;
use crate::model::{Command, Disturbance, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::{CommandHeader, RobotCommand, RobotObservation, RobotState, state_flags};

/// Observation samples looked at in one period for each robot; the rest waits, and is then stale.
const SAMPLES_PER_ROBOT: usize = 16;

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
    /// Length of the way from where it was seen, m; below 0 where it was seen later.
    way_m: f64,
}

impl Carried {
    /// Where a robot that is not heard any more is taken to be, and how far from there it may be, m.
    ///
    /// What keeps it from being heard may keep it from hearing: it may have stopped anywhere on the way.
    /// From the middle between its ends no point of the way is further than half of its length.
    fn unheard(&self) -> (Pose, f64) {
        let position_m = (self.seen.0.position_m + self.pose.position_m) * 0.5;
        (Pose { position_m, ..self.pose }, 0.5 * self.way_m.abs())
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
        let way_m = before_m + if release_ns < at_ns { -way_m } else { way_m };
        let carried = Carried { seen, pose, at_ns: release_ns, way_m };
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
            state.flags &= !(state_flags::MAY_STAND | state_flags::OUT_OF_STEP);
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
            let carried = self.carry(index, seen, instant.release_ns);
            if !valid {
                let (pose, unknown_m) = carried.unheard();
                set_pose(state, pose, unknown_m, false);
                continue;
            }
            if !self.held.follows(self.admission.holding(index), seen.1) {
                set_pose(state, seen.0, 0.0, true);
                state.set_command(Command::STOP);
                state.intent.speed_mps = 0.0;
                // Should it have told that only after it was seen, it has gone on for some of the way.
                let end_m = carried.pose.position_m;
                (state.seen_x_m, state.seen_y_m, state.way_m) = (end_m.x, end_m.y, carried.way_m);
                state.flags |= state_flags::OUT_OF_STEP | state_flags::MAY_STAND;
                continue;
            }
            self.watch(index, seen);
            set_pose(state, carried.pose, 0.0, true);
            (state.seen_x_m, state.seen_y_m) = (seen.0.position_m.x, seen.0.position_m.y);
            state.way_m = carried.way_m;
            state.flags |= state_flags::MAY_STAND;
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::channel::memory::Memory;
    use crate::channel::{Transport, Writer};
    use crate::clock::VirtualClock;
    use crate::config::ChannelConfig;
    use crate::geometry::Arc;
    use crate::model::RobotId;
    use crate::wire::Holding;

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
                    *record = RobotObservation { id: robot.id.0, holding: 0, x_m, y_m, theta_rad };
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

    /// Seen a quarter of a period after t_k, which the loop looks at late, and not again for a period.
    #[test]
    fn a_way_back_is_taken_off_the_way_on() {
        const T: u64 = 80_000_000;
        let transport = Transport::new("default", &ChannelConfig::default()).unwrap();
        let node = transport.in_memory(Memory::default().into()).attach("test").unwrap();
        let scenario = Scenario::builtin("swap8").unwrap();
        let mut source = Observed::new(node.reader().unwrap(), &scenario, &SourceConfig::default(), T);
        let drive = RobotCommand::verified(RobotId(0), Command { v_mps: 1.0, omega_radps: 0.0 });
        for tick in 10..13 {
            let (valid_from_ns, valid_until_ns) = (tick * T, (tick + 1) * T);
            let header = CommandHeader { tick, valid_from_ns, valid_until_ns, ..CommandHeader::default() };
            source.commit(&header, &[drive], valid_from_ns - T);
        }
        let seen = (Pose::new(3.0, 0.0, 0.0), 10 * T + T / 4);
        for (at_ns, way_m) in [(10 * T, -0.02), (11 * T, 0.06), (12 * T, 0.14)] {
            let carried = source.carry(0, seen, at_ns);
            assert!((carried.way_m - way_m).abs() < 1e-12, "{carried:?}");
            assert!((carried.pose.position_m.x - 3.0 - way_m).abs() < 1e-12, "{carried:?}");
        }
    }

    /// Robot 0 tells what it holds; both it and robot 1, of which nobody tells, were sent 1 m/s.
    #[test]
    fn a_robot_that_does_not_follow_is_where_it_was_seen_and_the_others_may_stand_on_their_way() {
        const NOW: u64 = 1_000_000_000;
        const T: u64 = 80_000_000;
        let transport = Transport::new("default", &ChannelConfig::default()).unwrap();
        let node = transport.in_memory(Memory::default().into()).attach("test").unwrap();
        let scenario = Scenario::builtin("swap8").unwrap();
        let mut writer: Writer<RobotObservation> = node.writer(2).unwrap();
        let mut source = Observed::new(node.reader().unwrap(), &scenario, &SourceConfig::default(), T);
        let mut fleet: Vec<RobotState> = scenario.robots.iter().map(RobotState::at_start).collect();
        let drive = Command { v_mps: 1.0, omega_radps: 0.0 };
        let commands: Vec<_> = scenario.robots.iter().map(|r| RobotCommand::verified(r.id, drive)).collect();
        for tick in [4, 5, 6] {
            let from = NOW + tick * T - 5 * T;
            let header = CommandHeader {
                tick,
                valid_from_ns: from,
                valid_until_ns: from + T,
                ..CommandHeader::default()
            };
            source.commit(&header, &commands, from - T);
        }
        // Period 6 begins; both were seen a quarter of a period before.
        let (release_ns, stamp_ns) = (NOW + T, NOW + 3 * T / 4);
        let mut after = |sequence, epoch, holding: Holding| {
            let sent = writer.publish(|header, records| {
                (header.sequence, header.stamp_ns, header.epoch) = (sequence, stamp_ns, epoch);
                for (record, (robot, told)) in
                    records.iter_mut().zip(scenario.robots.iter().zip([holding, Holding::Untold]))
                {
                    let Pose { position_m, theta_rad } = robot.start;
                    let (x_m, y_m, holding) = (position_m.x, position_m.y, told.code());
                    *record = RobotObservation { id: robot.id.0, holding, x_m, y_m, theta_rad };
                }
            });
            sent.unwrap();
            for state in &mut fleet {
                state.set_command(drive);
            }
            let instant = Instant { epoch: 7, release_ns, now_ns: release_ns };
            source.observe(instant, &VirtualClock::new(release_ns), &mut fleet);
            (fleet[0], fleet[1])
        };
        let way_m = |state: &RobotState| (state.position_m() - state.seen_m()).norm();
        let start = |index: usize| scenario.robots[index].start.position_m;
        for (sequence, epoch, holding, follows) in [
            (1, 7, Holding::Command { tick: 5 }, true),
            (2, 7, Holding::Command { tick: 6 }, true),
            (3, 7, Holding::Command { tick: 4 }, false),
            (4, 7, Holding::Nothing, false),
            // Who does not know this run holds none of its commands.
            (5, 0, Holding::Command { tick: 5 }, false),
            (6, 7, Holding::Untold, true),
        ] {
            let (told, untold) = after(sequence, epoch, holding);
            for state in [&told, &untold] {
                assert!(state.has(state_flags::VALID), "{holding:?}");
            }
            assert_eq!(told.has(state_flags::OUT_OF_STEP), !follows, "{holding:?}");
            assert!(told.has(state_flags::MAY_STAND), "{holding:?}");
            if follows {
                assert!((told.way_m - 0.02).abs() < 1e-12 && (way_m(&told) - 0.02).abs() < 1e-12);
                assert_eq!((told.seen_m(), told.command()), (start(0), drive));
            } else {
                assert_eq!((told.position_m(), told.command()), (start(0), Command::STOP));
                // As far as it may have driven before it told.
                assert!((told.way_m - 0.02).abs() < 1e-12 && (way_m(&told) - 0.02).abs() < 1e-12);
            }
            assert!(untold.has(state_flags::MAY_STAND) && !untold.has(state_flags::OUT_OF_STEP));
            assert!((untold.way_m - 0.02).abs() < 1e-12 && untold.seen_m() == start(1));
        }
    }
}
