//! The robots outside of the daemon: their motion, their gates, and the drivers that speak for them.

mod commands;
mod observations;

use std::sync::Arc;

use super::oracle::{Genuine, keep_apart};
use super::plan::{Class, Plan};
use super::tally::Outside;
use crate::channel::memory::{Memory, Message};
use crate::channel::{Channel, CommandReader, Reader, Record};
use crate::geometry::{Pose, TimedArc, Vec2};
use crate::model::RobotId;
use crate::plant::Plant;
use crate::scenario::Scenario;
use crate::wire::{RobotCommand, RobotObservation};

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
