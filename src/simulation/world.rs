//! The robots outside of the daemon: their motion, their gates, and the drivers that speak for them.

use std::collections::VecDeque;
use std::sync::Arc;

use super::active::Active;
use super::kind::Kind;
use super::oracle::{Genuine, keep_apart};
use super::plan::{Class, Fault, Plan};
use super::tally::Outside;
use crate::channel::memory::{Memory, Message};
use crate::channel::{Channel, CommandReader, Reader, Record};
use crate::geometry::{Pose, TimedArc, Vec2};
use crate::model::RobotId;
use crate::plant::Plant;
use crate::scenario::Scenario;
use crate::wire::{Holding, ObservationHeader, RobotCommand, RobotObservation};

/// Name of the simulated fleet.
pub(crate) const FLEET: &str = "simulated";

/// Who sends observations of some robots and takes their commands.
pub(crate) struct Driver {
    pub(crate) robots: Vec<usize>,
    writer: u128,
    sequence: u64,
    /// The run of the daemon that it follows.
    epoch: u64,
    commands: CommandReader,
    /// The sample that it sent last.
    sent: Option<Message<RobotObservation>>,
    /// Samples that are on their way for longer, and when they come.
    late: Vec<(u64, Message<RobotCommand>)>,
}

/// The world around the daemon.
pub(crate) struct World {
    pub(crate) plant: Plant,
    pub(crate) drivers: Vec<Driver>,
    pub(crate) genuine: Genuine,
    pub(crate) outside: Outside,
    memory: Arc<Memory>,
    ids: Vec<u32>,
    radii_m: Vec<f64>,
    margin_m: f64,
    class: Class,
    period_ns: u64,
    start_ns: u64,
    lead_ns: u64,
    /// The period whose poses are taken next.
    next: u64,
    motions: Vec<Vec<TimedArc>>,
    frozen: Vec<Option<Pose>>,
    foreign: Vec<bool>,
    false_writer: u128,
    false_sequence: u64,
    /// The plant drives what has expired, and nobody stops it.
    pub(crate) ignores_expiry: bool,
    /// Robots follow whatever comes, and drivers do not tell.
    untold: bool,
}

/// What went wrong outside, at which time.
pub(crate) struct Broken {
    pub(crate) robot: usize,
    pub(crate) invariant: char,
    pub(crate) values: String,
}

impl World {
    pub(crate) fn new(plan: &Plan, memory: &Arc<Memory>) -> Self {
        let scenario = &plan.config.scenario;
        let mut robots = scenario.robots.clone();
        robots.extend(plan.spares);
        let everybody = Scenario { robots, ..scenario.clone() };
        let period_ns = plan.config.timing.period_ns;
        // Who is added later speaks through the first driver.
        let mut groups = plan.drivers.clone();
        if let Some(first) = groups.first_mut() {
            first.push(scenario.robots.len());
        }
        let driver = |robots: Vec<usize>| Driver {
            robots,
            writer: memory.identity(),
            sequence: plan.sequence,
            epoch: 0,
            commands: Reader::local(memory.command.subscribe(), Channel::Command.seal(FLEET)),
            sent: None,
            late: Vec::new(),
        };
        let robots = everybody.robots.len();
        Self {
            plant: Plant::new(&everybody, period_ns, plan.start_ns),
            drivers: groups.into_iter().map(driver).collect(),
            genuine: Genuine::default(),
            outside: Outside::default(),
            ids: everybody.robots.iter().map(|robot| robot.id.0).collect(),
            radii_m: everybody.robots.iter().map(|robot| robot.radius_m).collect(),
            margin_m: scenario.limits.safety_margin_m,
            class: plan.class,
            period_ns,
            start_ns: plan.start_ns,
            lead_ns: plan.lead_ns,
            next: 0,
            motions: vec![Vec::new(); robots],
            frozen: vec![None; robots],
            foreign: everybody.robots.iter().map(|robot| robot.foreign_speed_mps.is_some()).collect(),
            false_writer: memory.identity(),
            false_sequence: 1,
            memory: Arc::clone(memory),
            ignores_expiry: false,
            untold: false,
        }
    }

    /// Lets robots follow every command by itself, whatever they missed, to see that it is noticed.
    #[cfg(test)]
    pub(crate) fn follow_whatever_comes(&mut self) {
        self.plant = self.plant.clone().unreported();
        self.untold = true;
    }

    /// Lets a gate that forgets when commands expire stand before each robot, to see that it is noticed.
    #[cfg(test)]
    pub(crate) fn ignore_expiry(&mut self, plan: &Plan) {
        let scenario = &plan.config.scenario;
        let mut robots = scenario.robots.clone();
        robots.extend(plan.spares);
        let everybody = Scenario { robots, ..scenario.clone() };
        self.plant = Plant::new(&everybody, u64::MAX, plan.start_ns);
        self.ignores_expiry = true;
    }

    /// The period that runs at `now_ns`, counted from the start of the world.
    pub(crate) fn period(&self, now_ns: u64) -> u64 {
        now_ns.saturating_sub(self.start_ns) / self.period_ns
    }

    /// When drivers take the next poses, ns. What is late comes no earlier than then, so that the pieces of all
    /// motions are the same whatever is late.
    pub(crate) fn next_ns(&self) -> u64 {
        (self.start_ns + self.next * self.period_ns).saturating_sub(self.lead_ns)
    }

    /// Moves everybody on to `to_ns`; what was driven is looked at by [`judge`](Self::judge).
    pub(crate) fn advance(&mut self, to_ns: u64) {
        let motions = &mut self.motions;
        let from_ns = self.plant.time_ns();
        self.plant.advance_with(to_ns, |index, piece| motions[index].push(piece));
        // A foreign robot goes back and forth at its own pace.
        if self.class == Class::Foreign && to_ns > from_ns {
            let s = (to_ns - from_ns) as f64 * 1e-9;
            let forth = (self.period(from_ns) / 40).is_multiple_of(2);
            for index in (0..self.foreign.len()).filter(|index| self.foreign[*index]) {
                let Some(pose) = self.plant.pose(index) else { continue };
                let moved = Vec2::new(if forth { 0.3 } else { -0.3 } * s, 0.0);
                let pose = Pose { position_m: pose.position_m + moved, ..pose };
                self.plant.place(index, RobotId(self.ids[index]), pose);
            }
        }
    }

    /// What was driven since the last time: by whom it was allowed, and how close any two came.
    ///
    /// `present` are the robots of the fleet, `lied` those whose senses cannot be relied on for long, `misled`
    /// those of which a false pose may be believed.
    pub(crate) fn judge(
        &mut self,
        present: impl Fn(usize) -> bool,
        lied: impl Fn(usize) -> bool,
        misled: impl Fn(usize) -> bool,
        mut tell: impl FnMut(Broken),
    ) {
        for (index, pieces) in self.motions.iter().enumerate() {
            for piece in pieces {
                if !self.genuine.allows(self.ids[index], piece) {
                    let (v, omega) = (piece.arc.v_mps, piece.arc.omega_radps);
                    let values = format!(
                        "it drives at {v} m/s, {omega} rad/s from {} to {} ns, and no command that was published says so for that time",
                        piece.from_ns, piece.to_ns
                    );
                    tell(Broken { robot: index, invariant: 'a', values });
                }
                let moves = piece.arc.v_mps != 0.0 && !misled(index) && !self.foreign[index];
                if let Some((expected, off_m)) = self.genuine.astray(self.ids[index], piece).filter(|_| moves)
                {
                    let values = format!(
                        "it begins a command {off_m} m from ({}, {}), for which that was computed",
                        expected.x, expected.y
                    );
                    tell(Broken { robot: index, invariant: 'b', values });
                }
            }
        }
        let robots = self.motions.len();
        for a in 0..robots {
            for b in a + 1..robots {
                let counts = |index: usize| present(index) && !self.foreign[index] && !lied(index);
                if !counts(a) || !counts(b) {
                    continue;
                }
                let (Some(first), Some(second)) = (self.motions[a].first(), self.motions[b].first()) else {
                    continue;
                };
                let required_m = self.margin_m + self.radii_m[a] + self.radii_m[b];
                let distance_m = (first.arc.start.position_m - second.arc.start.position_m).norm();
                if distance_m > required_m + way_m(&self.motions[a]) + way_m(&self.motions[b]) {
                    continue;
                }
                // Who begins too close may not come closer.
                let floor_m = required_m.min(distance_m);
                if let Err(came_m) = keep_apart(&self.motions[a], &self.motions[b], floor_m) {
                    let values = format!(
                        "robots {} and {} come to {came_m} m, at least {floor_m} m was due",
                        self.ids[a], self.ids[b]
                    );
                    tell(Broken { robot: a, invariant: 'b', values });
                }
            }
        }
        self.motions.iter_mut().for_each(Vec::clear);
    }

    /// Drivers take what has come for them by `now_ns`.
    pub(crate) fn receive(&mut self, now_ns: u64, active: &mut [Active]) {
        let period = self.period(now_ns);
        for at in 0..self.drivers.len() {
            let mut due = VecDeque::new();
            self.drivers[at].late.retain(|(due_ns, message)| {
                let comes = *due_ns <= now_ns;
                if comes {
                    due.push_back(message.clone());
                }
                !comes
            });
            let Some(queue) = self.drivers[at].commands.queue().cloned() else { continue };
            for message in queue.edit(std::mem::take) {
                self.carry(at, &message, (now_ns, period), active, &mut due);
            }
            queue.edit(|waiting| *waiting = due);
            // As every receiver: what is not as it was sealed is not handed out.
            while let Ok(Some(sample)) = self.drivers[at].commands.next() {
                let (header, robots) = (*sample.header(), Arc::from(sample.robots()));
                self.deliver(at, &Message { writer: sample.writer(), header, robots }, now_ns);
            }
        }
        self.outside.corrupt = self.drivers.iter().map(|driver| driver.commands.corrupt()).sum();
    }

    /// One command sample on its way to driver `at`.
    fn carry(
        &mut self,
        at: usize,
        message: &Message<RobotCommand>,
        (now_ns, period): (u64, u64),
        active: &mut [Active],
        due: &mut VecDeque<Message<RobotCommand>>,
    ) {
        let mut copies = 1;
        for one in active.iter_mut().filter(|one| one.acts_at(period)) {
            let (kind, target) = (one.kind(), one.fault.target);
            let driver = &mut self.drivers[at];
            let mine = target == at;
            match kind {
                Kind::CmdLost if mine => copies = 0,
                Kind::CmdLate if mine => {
                    driver.late.push((now_ns + self.period_ns * 11 / 5, message.clone()));
                    copies = 0;
                }
                Kind::CmdRepeated if mine => copies *= 2,
                Kind::CmdBit if mine => {
                    let mut flipped = message.clone();
                    flip(&mut flipped, one.fault.chance, one.applied);
                    due.push_back(flipped);
                    copies = 0;
                }
                Kind::CmdOldEpoch if mine => {
                    let mut old = message.clone();
                    old.header.epoch -= 1;
                    old.header.tick = old.header.tick.wrapping_add(3);
                    Channel::Command.seal(FLEET).put(&mut old.header, &old.robots);
                    // Behind the real one: before it no newer run may be known.
                    due.push_back(message.clone());
                    due.push_back(old);
                    copies = 0;
                }
                Kind::CmdWrongRobot | Kind::CmdWild | Kind::CmdForever if driver.robots.contains(&target) => {
                    let (id, mut false_one) = (self.ids[target], message.clone());
                    let mut robots = false_one.robots.to_vec();
                    for robot in robots.iter_mut().filter(|robot| robot.id == id) {
                        match kind {
                            Kind::CmdWild => (robot.v_mps, robot.stop_reason) = (f64::NAN, 0),
                            Kind::CmdForever => false_one.header.valid_until_ns += 100 * self.period_ns,
                            _ => {}
                        }
                    }
                    false_one.robots = Arc::from(robots);
                    let claimed = if kind == Kind::CmdWrongRobot { id.wrapping_add(1) } else { id };
                    self.hand_over(target, claimed, &false_one, now_ns);
                }
                _ => continue,
            }
            one.applied += 1;
        }
        for _ in 0..copies {
            due.push_back(message.clone());
        }
    }

    fn deliver(&mut self, at: usize, message: &Message<RobotCommand>, now_ns: u64) {
        let driver = &mut self.drivers[at];
        driver.epoch = driver.epoch.max(message.header.epoch);
        for index in driver.robots.clone() {
            if message.robots.iter().any(|one| one.id == self.ids[index]) {
                self.hand_over(index, self.ids[index], message, now_ns);
            }
        }
    }

    /// Offers robot `index` what `message` says about it, under the name `claimed`.
    fn hand_over(&mut self, index: usize, claimed: u32, message: &Message<RobotCommand>, now_ns: u64) {
        let id = self.ids[index];
        let Some(own) = message.robots.iter().find(|one| one.id == id) else { return };
        let (mut header, command) = (message.header, RobotCommand { id: claimed, ..*own });
        if self.ignores_expiry {
            header.valid_until_ns = u64::MAX;
        }
        if let Err(refusal) = self.plant.command(index, &header, &command, now_ns) {
            self.outside.count(refusal);
        }
    }

    /// Drivers take the poses of the next period and send them, if it is time.
    pub(crate) fn observe(&mut self, now_ns: u64, active: &mut [Active], present: impl Fn(usize) -> bool) {
        let due_ns = (self.start_ns + self.next * self.period_ns).saturating_sub(self.lead_ns);
        if now_ns < due_ns {
            return;
        }
        let period = self.next;
        self.next += 1;
        // Before its driver looks, or just after, so that the daemon takes it to drive for a period more.
        self.halt(period, active, |chance| chance < 0.5);
        for at in 0..self.drivers.len() {
            self.send(at, now_ns, period, active, &present);
        }
        self.halt(period, active, |chance| chance >= 0.5);
    }

    fn halt(&mut self, period: u64, active: &mut [Active], now: impl Fn(f64) -> bool) {
        for one in active.iter_mut() {
            if one.kind() == Kind::Halted && one.acts_at(period) && now(one.fault.chance) {
                self.plant.halt(one.fault.target);
                one.applied += 1;
            }
        }
    }

    #[expect(clippy::too_many_lines, reason = "an arm for each fault that meets an observation on its way")]
    fn send(
        &mut self,
        at: usize,
        now_ns: u64,
        period: u64,
        active: &mut [Active],
        present: &impl Fn(usize) -> bool,
    ) {
        let robots: Vec<usize> =
            self.drivers[at].robots.iter().copied().filter(|index| present(*index)).collect();
        let driver = &mut self.drivers[at];
        let mut header = ObservationHeader {
            epoch: driver.epoch,
            sequence: driver.sequence,
            stamp_ns: now_ns,
            ..ObservationHeader::default()
        };
        let mut records: Vec<RobotObservation> = robots
            .iter()
            .map(|index| {
                let pose = self.plant.pose(*index).unwrap_or_default();
                let (x_m, y_m) = (pose.position_m.x, pose.position_m.y);
                let holding = if self.untold { Holding::Untold } else { self.plant.holding(*index) };
                let (id, holding) = (self.ids[*index], holding.code());
                RobotObservation { id, holding, x_m, y_m, theta_rad: pose.theta_rad }
            })
            .collect();
        let (mut times, mut again, mut pretender) = (1, None, None);
        for which in 0..active.len() {
            let one = &active[which];
            if !one.acts_at(period) || one.kind() == Kind::Begin {
                continue;
            }
            let (kind, fault) = (one.kind(), one.fault);
            let place = robots.iter().position(|index| *index == fault.target);
            let done = if fault.kind.promise().scope == super::kind::Scope::Robot {
                let Some(place) = place else { continue };
                match kind {
                    Kind::ObsMasquerade => {
                        let alone = active.iter().all(|other| {
                            other.fault.number == fault.number
                                || !other.acts_within(period)
                                || !other.touches(fault.target)
                        });
                        if alone {
                            let record = &records[place];
                            pretender = Some(RobotObservation { x_m: record.x_m + 3.0, ..*record });
                        }
                        alone
                    }
                    Kind::ObsFrozen => {
                        let real = self.plant.pose(fault.target).unwrap_or_default();
                        let seen = *self.frozen[fault.target].get_or_insert(real);
                        let record = &mut records[place];
                        (record.x_m, record.y_m, record.theta_rad) =
                            (seen.position_m.x, seen.position_m.y, seen.theta_rad);
                        // Seen only of a robot that is told to drive all of the time.
                        let off_m = (real.position_m - seen.position_m).norm();
                        let told = active[which].applied;
                        active[which].armed = told >= 11 && off_m > 0.2 * told as f64;
                        if period == fault.last() {
                            self.frozen[fault.target] = None;
                        }
                        true
                    }
                    _ => spoil(&fault, &mut records[place]),
                }
            } else if fault.target != at {
                false
            } else {
                let driver = &mut self.drivers[at];
                match kind {
                    Kind::ObsSilence => {
                        times = 0;
                        active[which].applied += 1;
                        continue;
                    }
                    Kind::DriverRestart => {
                        (driver.writer, driver.sequence) = (self.memory.identity(), 1);
                        header.sequence = 1;
                        true
                    }
                    Kind::ObsLost => {
                        times = 0;
                        driver.sequence = driver.sequence.wrapping_add(1);
                        true
                    }
                    Kind::ObsDuplicate if records.len() > 1 => {
                        let last = records.len() - 1;
                        records[last] = records[0];
                        true
                    }
                    Kind::ObsOversize => {
                        let filler = RobotObservation { id: u32::MAX - 7, ..RobotObservation::default() };
                        records.resize(self.ids.len() + 4, filler);
                        true
                    }
                    Kind::ObsOldEpoch if header.epoch > 0 => {
                        header.epoch -= 1;
                        true
                    }
                    Kind::ObsStale => {
                        header.stamp_ns = now_ns.saturating_sub(5 * self.period_ns);
                        true
                    }
                    Kind::ObsFuture => {
                        header.stamp_ns = now_ns + 3 * self.period_ns;
                        true
                    }
                    Kind::ObsGap => {
                        header.sequence = header.sequence.wrapping_add(4_000_000);
                        true
                    }
                    Kind::ObsRepeated => {
                        times = times.min(1) * 2;
                        true
                    }
                    Kind::ObsReordered => {
                        again.clone_from(&driver.sent);
                        again.is_some()
                    }
                    _ => false,
                }
            };
            active[which].applied += u64::from(done);
        }
        let driver = &mut self.drivers[at];
        let seal = Channel::Observation.seal(FLEET);
        seal.put(&mut header, &records);
        let mut message = Message { writer: driver.writer, header, robots: Arc::from(records) };
        for one in active.iter_mut() {
            if one.kind() == Kind::ObsBit && one.fault.target == at && one.acts_at(period) && times > 0 {
                flip(&mut message, one.fault.chance, one.applied);
                one.applied += 1;
            }
        }
        if times > 0 {
            driver.sequence = driver.sequence.wrapping_add(1);
            driver.sent = Some(message.clone());
        }
        for _ in 0..times {
            self.memory.observation.send(&message);
        }
        if let Some(older) = again {
            self.memory.observation.send(&older);
        }
        if let Some(record) = pretender {
            let mut header = ObservationHeader { sequence: self.false_sequence, ..header };
            seal.put(&mut header, &[record]);
            self.false_sequence += 1;
            let robots = Arc::from(&[record][..]);
            self.memory.observation.send(&Message { writer: self.false_writer, header, robots });
        }
    }

    /// Carries a robot to where nobody is near; whether there was such a place.
    pub(crate) fn carry_away(&mut self, index: usize, chance: f64) -> bool {
        let places: Vec<Vec2> = self.plant.poses().map(|pose| pose.position_m).collect();
        let here = places[index];
        for step in 0..24 {
            let way = crate::geometry::unit(std::f64::consts::TAU * (chance + f64::from(step) / 24.0));
            let there = here + way * (7.0 + 6.0 * chance);
            let free =
                places.iter().enumerate().all(|(other, at)| other == index || (there - at).norm() > 6.0);
            if free {
                let pose = self.plant.pose(index).unwrap_or_default();
                self.plant.place(index, RobotId(self.ids[index]), Pose { position_m: there, ..pose });
                // Nobody drove there.
                self.motions[index].clear();
                return true;
            }
        }
        false
    }
}

fn way_m(pieces: &[TimedArc]) -> f64 {
    pieces.iter().map(|piece| piece.arc.v_mps.abs() * piece.duration_s()).sum()
}

/// Flips one bit of a sample, of its header or of its records.
pub(crate) fn flip<R: Record>(message: &mut Message<R>, chance: f64, times: u64) {
    let mut records = message.robots.to_vec();
    let head = bytemuck::bytes_of_mut(&mut message.header);
    let body: &mut [u8] = bytemuck::cast_slice_mut(&mut records);
    let bits = 8 * (head.len() + body.len());
    let bit = ((chance + times as f64 * 0.618_033_988_75).fract() * bits as f64) as usize % bits.max(1);
    let byte = bit / 8;
    let place = if byte < head.len() { &mut head[byte] } else { &mut body[byte - head.len()] };
    *place ^= 1 << (bit % 8);
    message.robots = Arc::from(records);
}

/// Makes one robot's record wrong; whether the kind is about that.
fn spoil(fault: &Fault, record: &mut RobotObservation) -> bool {
    let chance = fault.chance;
    let bad = match fault.kind {
        Kind::ObsNotFinite => [f64::NAN, f64::INFINITY, f64::NEG_INFINITY][(chance * 3.0) as usize % 3],
        Kind::ObsSubnormal => 1e-310,
        Kind::ObsOutOfRange => {
            record.x_m = if chance < 0.5 { 1e9 } else { -f64::MAX };
            return true;
        }
        Kind::ObsUnknownRobot => {
            record.id = u32::MAX - 9;
            return true;
        }
        Kind::ObsTeleport => {
            record.x_m += 3.0 + 30.0 * chance;
            return true;
        }
        _ => return false,
    };
    match fault.coordinate() {
        0 => record.x_m = bad,
        1 => record.y_m = bad,
        _ => record.theta_rad = bad,
    }
    true
}
