//! The plant: robots that do exactly what the model says, behind the same gate as real ones.
//!
//! Reads command samples, writes poses. Under a held input a unicycle moves on an arc (see
//! [`Arc`]), so there is no integration error, unless the forward Euler steps of the paper's simulation
//! are asked for ([`Plant::moved_by`]). A robot whose command has expired stands still.
//! World frame, metres, radians; times in `CLOCK_MONOTONIC` ns. About 25 ns a robot and period;
//! allocates only when it is made.

use crate::actuation::{Gate, Refusal};
use crate::config::DisturbanceConfig;
use crate::disturbance::DisturbedFleet;
use crate::geometry::{Arc, Arcs, Integration, Pose, TimedArc, Vec2};
use crate::model::{Command, Limits, RobotId, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::{CommandHeader, Holding, NO_ROBOT, RobotCommand};

/// A fleet of ideal unicycles.
#[derive(Debug, Clone)]
pub struct Plant {
    now_ns: u64,
    integration: Integration,
    limits: Limits,
    max_hold_ns: u64,
    unreported: bool,
    poses: Vec<Pose>,
    gates: Vec<Gate>,
    disturbed: Option<Disturbed>,
}

/// Robots that are disturbed, moved in equal steps from `start_ns` on.
#[derive(Debug, Clone)]
struct Disturbed {
    fleet: DisturbedFleet,
    start_ns: u64,
    period_ns: u64,
    steps: u64,
}

impl Disturbed {
    /// When step `step` begins, ns.
    fn at_ns(&self, step: u64) -> u64 {
        let since = u128::from(step) * u128::from(self.period_ns) / u128::from(DisturbedFleet::STEPS);
        self.start_ns.saturating_add(u64::try_from(since).unwrap_or(u64::MAX))
    }

    /// Puts the end of a step at `at_ns`; the next step begins less than a step from now.
    fn align(&mut self, at_ns: u64) {
        let now_ns = self.at_ns(self.steps);
        let back = now_ns.saturating_sub(at_ns).div_ceil(self.period_ns);
        let ahead = at_ns.saturating_sub(now_ns).div_ceil(self.period_ns);
        let shift = |periods: u64| periods.saturating_mul(self.period_ns);
        self.start_ns = at_ns.saturating_add(shift(back.saturating_sub(1))).saturating_sub(shift(ahead));
        self.steps = 0;
        while self.at_ns(self.steps) < now_ns {
            self.steps += 1;
        }
    }

    /// The period that a step belongs to.
    fn instant(&self) -> u64 {
        self.steps / u64::from(DisturbedFleet::STEPS)
    }
}

impl Plant {
    /// The scenario's robots at their starts, at rest, at time `now_ns`.
    ///
    /// `max_hold_ns` is the longest validity that a command may claim.
    pub fn new(scenario: &Scenario, max_hold_ns: u64, now_ns: u64) -> Self {
        let gate = |robot: &RobotSpec| Gate::new(robot.id, scenario.limits, max_hold_ns);
        Self {
            now_ns,
            integration: Integration::Exact,
            limits: scenario.limits,
            max_hold_ns,
            unreported: false,
            poses: scenario.robots.iter().map(|robot| robot.start).collect(),
            gates: scenario.robots.iter().map(gate).collect(),
            disturbed: None,
        }
    }

    /// With robots that follow commands whatever they missed ([`Gate::unreported`]): for who hands them
    /// every command.
    #[must_use]
    pub fn unreported(mut self) -> Self {
        self.unreported = true;
        for gate in &mut self.gates {
            *gate = gate.unreported();
        }
        self
    }

    fn gate(&self, id: RobotId) -> Gate {
        let gate = Gate::new(id, self.limits, self.max_hold_ns);
        if self.unreported { gate.unreported() } else { gate }
    }

    /// Moves its robots by `integration`; exactly where this is not said. A step is what an input
    /// holds within one [`advance`](Self::advance).
    #[must_use]
    pub fn moved_by(self, integration: Integration) -> Self {
        Self { integration, ..self }
    }

    /// With room for as many robots as there are places; those beyond the scenario's stand idle at the
    /// origin until they are placed.
    #[must_use]
    pub fn with_places(mut self, places: usize) -> Self {
        let (idle, places) = (self.gate(RobotId(NO_ROBOT)), places.max(self.gates.len()));
        self.poses.resize(places, Pose::default());
        self.gates.resize(places, idle);
        if let Some(disturbed) = &mut self.disturbed {
            disturbed.fleet.make_room(places);
        }
        self
    }

    /// Puts robot `id` into the `index`-th place, at rest.
    pub fn place(&mut self, index: usize, id: RobotId, pose: Pose) {
        let gate = self.gate(id);
        if let (Some(own_pose), Some(own_gate)) = (self.poses.get_mut(index), self.gates.get_mut(index)) {
            (*own_pose, *own_gate) = (pose, gate);
        }
        if let Some(disturbed) = &mut self.disturbed {
            disturbed.fleet.place(index, id, pose);
        }
    }

    /// Disturbs its robots as `config` says, with periods of `period_ns` from now on; where that asks for
    /// nothing they stay ideal.
    ///
    /// They move in steps of a 32nd of a period, and their poses are those at the last step.
    #[must_use]
    pub fn disturbed(self, scenario: &Scenario, config: &DisturbanceConfig, period_ns: u64) -> Self {
        let fleet = || DisturbedFleet::new(scenario, config, period_ns as f64 * 1e-9);
        let disturbed = (!config.amplitude.is_none()).then(|| Disturbed {
            fleet: fleet(),
            start_ns: self.now_ns,
            period_ns,
            steps: 0,
        });
        Self { disturbed, ..self }
    }

    /// Pose of the `index`-th robot of the scenario, at the time of the last advance.
    pub fn pose(&self, index: usize) -> Option<Pose> {
        self.poses.get(index).copied()
    }

    /// Pose of the `index`-th robot as it is seen: with noise where that is asked for.
    pub fn seen(&self, index: usize) -> Option<Pose> {
        match &self.disturbed {
            Some(disturbed) => disturbed.fleet.seen(index, disturbed.instant()),
            None => self.pose(index),
        }
    }

    /// Poses of all robots, in the scenario's order.
    pub fn poses(&self) -> impl Iterator<Item = Pose> + '_ {
        self.poses.iter().copied()
    }

    /// Hands the `index`-th robot a command, received at `now_ns`.
    ///
    /// # Errors
    /// The gate's reason for refusing it.
    pub fn command(
        &mut self,
        index: usize,
        header: &CommandHeader,
        command: &RobotCommand,
        now_ns: u64,
    ) -> Result<(), Refusal> {
        match self.gates.get_mut(index) {
            Some(gate) => gate.offer(header, command, now_ns),
            None => Err(Refusal::WrongRobot),
        }
    }

    /// The time up to which its robots have moved, ns: of the last step where they move in steps.
    pub fn time_ns(&self) -> u64 {
        self.disturbed.as_ref().map_or(self.now_ns, |disturbed| disturbed.at_ns(disturbed.steps))
    }

    /// Whether the `index`-th robot has a command that acts now.
    pub fn is_commanded(&mut self, index: usize) -> bool {
        let now_ns = self.time_ns();
        self.gates.get_mut(index).is_some_and(|gate| gate.is_commanded(now_ns))
    }

    /// Lets steps, where robots move in steps, begin at the instants of a schedule that one of its periods
    /// starts at `release_ns`: no step is then driven half on a command that has expired. Until the first of
    /// them, for less than a step, the robots stand.
    pub fn align(&mut self, release_ns: u64, mut each: impl FnMut(usize, TimedArc)) {
        let from_ns = self.time_ns();
        let Some(disturbed) = &mut self.disturbed else { return };
        disturbed.align(release_ns);
        let to_ns = disturbed.at_ns(disturbed.steps);
        for (index, pose) in self.poses.iter().enumerate().filter(|_| to_ns > from_ns) {
            each(index, TimedArc { from_ns, to_ns, arc: Arc { start: *pose, v_mps: 0.0, omega_radps: 0.0 } });
        }
    }

    /// The `index`-th robot stops by itself, where it is, and follows nothing until it has held a stop.
    pub fn halt(&mut self, index: usize) {
        if let Some(gate) = self.gates.get_mut(index) {
            gate.halt();
        }
    }

    /// Which command the `index`-th robot follows at the time up to which it has moved.
    pub fn holding(&self, index: usize) -> Holding {
        let now_ns = self.time_ns();
        self.gates.get(index).map_or(Holding::Untold, |gate| gate.holding(now_ns))
    }

    /// Moves every robot on to `to_ns`; does nothing when that time has passed.
    pub fn advance(&mut self, to_ns: u64) {
        self.advance_with(to_ns, |_, _| {});
    }

    /// The same, and tells how each robot moved: one robot's pieces come in the order of time, without gaps.
    pub fn advance_with(&mut self, to_ns: u64, mut each: impl FnMut(usize, TimedArc)) {
        if let Some(disturbed) = &mut self.disturbed {
            while disturbed.at_ns(disturbed.steps + 1) <= to_ns {
                let (from_ns, end_ns) =
                    (disturbed.at_ns(disturbed.steps), disturbed.at_ns(disturbed.steps + 1));
                let gates = &mut self.gates;
                let arcs = disturbed.fleet.step(|index| gates[index].input(from_ns.midpoint(end_ns)));
                for (index, arc) in arcs.iter().enumerate() {
                    each(index, TimedArc { from_ns, to_ns: end_ns, arc: *arc });
                }
                disturbed.steps += 1;
            }
            for (index, pose) in self.poses.iter_mut().enumerate() {
                *pose = disturbed.fleet.pose(index).unwrap_or(*pose);
            }
            self.now_ns = self.now_ns.max(to_ns);
            return;
        }
        for first in (0..self.gates.len()).step_by(Arcs::COUNT) {
            self.follow(first, to_ns, &mut each);
        }
        self.now_ns = self.now_ns.max(to_ns);
    }

    /// Hands all robots their commands, received at `now_ns`, and moves them on to `to_ns`, while their gates are
    /// near.
    pub(crate) fn command_and_advance(
        &mut self,
        header: &CommandHeader,
        commands: &[RobotCommand],
        now_ns: u64,
        to_ns: u64,
    ) {
        for first in (0..self.gates.len()).step_by(Arcs::COUNT) {
            let gates = self.gates.iter_mut().skip(first).take(Arcs::COUNT);
            for (gate, command) in gates.zip(commands.iter().skip(first)) {
                // A refusal is the gate's own affair: that robot stands still.
                let _ = gate.offer(header, command, now_ns);
            }
            if self.disturbed.is_none() {
                self.follow(first, to_ns, &mut |_, _| {});
            }
        }
        match self.disturbed {
            Some(_) => self.advance(to_ns),
            None => self.now_ns = self.now_ns.max(to_ns),
        }
    }

    /// Moves as many robots as arcs are followed at once, from the `first`-th on; they are not disturbed.
    fn follow(&mut self, first: usize, to_ns: u64, each: &mut impl FnMut(usize, TimedArc)) {
        let (from_ns, integration) = (self.now_ns, self.integration);
        // Those that one input moves all the time go side by side.
        let mut arcs = Arcs { theta_rad: [1.0; Arcs::COUNT], ..Arcs::default() };
        let mut together = [false; Arcs::COUNT];
        let robots = self.poses.iter_mut().skip(first).zip(self.gates.iter_mut().skip(first));
        for (lane, (pose, gate)) in robots.take(Arcs::COUNT).enumerate() {
            let mut at_ns = from_ns;
            while at_ns < to_ns {
                let input = gate.input(at_ns);
                // An input holds until the gate can change its mind, so every piece is one arc.
                let end_ns = gate.next_change_ns(at_ns).map_or(to_ns, |change| change.min(to_ns));
                let arc = Arc { start: *pose, v_mps: input.v_mps, omega_radps: input.omega_radps };
                each(first + lane, TimedArc { from_ns: at_ns, to_ns: end_ns, arc: integration.path(&arc) });
                if at_ns == from_ns && end_ns == to_ns && integration == Integration::Exact {
                    together[lane] = input != Command::STOP;
                    (arcs.x_m[lane], arcs.y_m[lane]) = (pose.position_m.x, pose.position_m.y);
                    arcs.theta_rad[lane] = pose.theta_rad;
                    (arcs.v_mps[lane], arcs.omega_radps[lane]) = (input.v_mps, input.omega_radps);
                } else if input != Command::STOP {
                    *pose = integration.pose(&arc, (end_ns - at_ns) as f64 * 1e-9);
                }
                at_ns = end_ns;
            }
        }
        if together.contains(&true) {
            arcs.advance(to_ns.saturating_sub(from_ns) as f64 * 1e-9);
            for (lane, pose) in self.poses.iter_mut().skip(first).take(Arcs::COUNT).enumerate() {
                if together[lane] {
                    pose.position_m = Vec2::new(arcs.x_m[lane], arcs.y_m[lane]);
                    pose.theta_rad = arcs.theta_rad[lane];
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::model::RobotSpec;
    use crate::wire::StopReason;

    const T: u64 = 80_000_000;

    fn plant() -> Plant {
        let scenario = Scenario {
            name: "one".into(),
            tolerance_m: 0.05,
            duration_s: 1.0,
            limits: Limits::default(),
            robots: vec![RobotSpec {
                id: RobotId(7),
                radius_m: 0.15,
                start: Pose::new(0.0, 0.0, 0.0),
                goal_m: Vec2::new(1.0, 0.0),
                foreign_speed_mps: None,
            }],
            obstacles: vec![],
        };
        let mut plant = Plant::new(&scenario, T, 0);
        // Nothing moves before it has held a stop.
        plant.command(0, &header(0), &RobotCommand::stop(RobotId(7), StopReason::Start), 0).unwrap();
        plant
    }

    fn header(tick: u64) -> CommandHeader {
        CommandHeader {
            epoch: 1,
            tick,
            valid_from_ns: tick * T,
            valid_until_ns: (tick + 1) * T,
            follows: tick.saturating_sub(1),
            ..CommandHeader::default()
        }
    }

    fn drive(v_mps: f64, omega_radps: f64) -> RobotCommand {
        RobotCommand::verified(RobotId(7), Command { v_mps, omega_radps })
    }

    #[test]
    fn one_period_is_one_arc_to_the_bit() {
        let mut p = plant();
        p.command(0, &header(1), &drive(3.0, 0.7), 10).unwrap();
        p.advance(T);
        assert_eq!(p.pose(0), Some(Pose::new(0.0, 0.0, 0.0)));
        p.advance(2 * T);
        let arc = Arc { start: Pose::new(0.0, 0.0, 0.0), v_mps: 3.0, omega_radps: 0.7 };
        assert_eq!(p.pose(0), Some(arc.pose(T as f64 * 1e-9)));
    }

    /// Robots that drive, turn, stand, stop on the way or have no command; the last group is not full.
    #[test]
    fn robots_that_move_side_by_side_end_where_each_ends_alone() {
        let scenario = Scenario::builtin("circle-20").unwrap();
        let mut plant = Plant::new(&scenario, T, 0).unreported();
        let mut ahead = plant.clone();
        let mut alone: Vec<Pose> = plant.poses().collect();
        for tick in 1..60 {
            let commands: Vec<RobotCommand> = (0_u32..)
                .zip(&scenario.robots)
                .map(|(n, robot)| match (u64::from(n) + tick) % 7 {
                    0 => RobotCommand::stop(robot.id, StopReason::Crowded),
                    1 => RobotCommand::verified(RobotId(99), Command { v_mps: 1.0, omega_radps: 0.1 }),
                    2 => RobotCommand::verified(robot.id, Command { v_mps: 0.0, omega_radps: -0.9 }),
                    k => {
                        let (v_mps, omega_radps) = (0.7 * k as f64, 0.05 * f64::from(n) - 0.4);
                        RobotCommand::verified(robot.id, Command { v_mps, omega_radps })
                    }
                })
                .collect();
            let early = CommandHeader { valid_until_ns: (tick + 1) * T - T / 3, ..header(tick) };
            let header = if tick % 4 == 0 { early } else { header(tick) };
            let now_ns = (tick - 1) * T + 5;
            for (index, command) in commands.iter().enumerate() {
                let _ = plant.command(index, &header, command, now_ns);
            }
            for to_ns in [tick * T, tick * T + T / 2].into_iter().take(1 + usize::from(tick % 3 == 0)) {
                plant.advance_with(to_ns, |index, piece| {
                    if piece.arc.v_mps != 0.0 || piece.arc.omega_radps != 0.0 {
                        alone[index] = piece.arc.pose(piece.duration_s());
                    }
                });
                assert_eq!(plant.poses().collect::<Vec<_>>(), alone, "{tick}");
            }
            ahead.command_and_advance(&header, &commands, now_ns, tick * T);
            if tick % 3 == 0 {
                assert_eq!(ahead.time_ns(), tick * T);
                ahead.advance(tick * T + T / 2);
            }
            assert_eq!(ahead.poses().collect::<Vec<_>>(), alone, "{tick}");
        }
        assert!(alone.iter().zip(&scenario.robots).all(|(pose, robot)| *pose != robot.start));
    }

    #[test]
    fn an_euler_step_is_a_straight_line_along_the_first_heading() {
        let mut p = plant().moved_by(Integration::Euler);
        p.command(0, &header(1), &drive(5.0, 1.0), 10).unwrap();
        p.advance(T);
        p.advance(2 * T);
        assert_eq!(p.pose(0), Some(Pose::new(0.4, 0.0, 0.08)));
    }

    #[test]
    fn stands_still_once_the_command_has_expired() {
        let mut p = plant();
        p.command(0, &header(1), &drive(1.0, 0.0), 0).unwrap();
        p.advance(50 * T);
        assert_eq!(p.pose(0), Some(Pose::new(0.08, 0.0, 0.0)));
    }

    #[test]
    fn the_pieces_of_a_motion_join_and_end_where_the_robot_is() {
        let mut p = plant();
        p.command(0, &header(1), &drive(3.0, 0.7), 10).unwrap();
        let mut pieces = vec![];
        for to_ns in [T / 3, T + T / 3, T + T / 2, 4 * T] {
            p.advance_with(to_ns, |index, piece| pieces.push((index, piece)));
            assert_eq!(p.time_ns(), to_ns);
        }
        let times: Vec<_> = pieces.iter().map(|(_, p)| (p.from_ns, p.to_ns, p.arc.v_mps)).collect();
        let expected = [
            (0, T / 3, 0.0),
            (T / 3, T, 0.0),
            (T, T + T / 3, 3.0),
            (T + T / 3, T + T / 2, 3.0),
            (T + T / 2, 2 * T, 3.0),
            (2 * T, 4 * T, 0.0),
        ];
        assert_eq!(times, expected);
        for pair in pieces.windows(2) {
            assert_eq!(pair[0].1.arc.pose(pair[0].1.duration_s()), pair[1].1.arc.start);
        }
        let whole = TimedArc { from_ns: T, to_ns: 2 * T, arc: pieces[2].1.arc };
        let rest = whole.from(T + T / 2);
        assert!((rest.arc.pose(rest.duration_s()).position_m - p.pose(0).unwrap().position_m).norm() < 1e-12);
    }

    #[test]
    fn steps_are_put_in_phase_with_a_schedule_wherever_it_starts() {
        let scenario = Scenario::builtin("swap8").unwrap();
        let mut config = DisturbanceConfig::default();
        config.amplitude.slip = 0.01;
        for start_ns in [9 * T, 9 * T + 7, 9 * T + T / 3, 1_023_456_789] {
            for release_ns in [0, 1, T / 2 + 1, 3 * T + 5, 1_000_000_007] {
                let mut p = Plant::new(&scenario, T, start_ns).disturbed(&scenario, &config, T);
                p.advance(start_ns + T / 4 + 3);
                let before = p.time_ns();
                let mut stood = vec![];
                p.align(release_ns, |_, piece| stood.push((piece.from_ns, piece.to_ns)));
                let after = p.time_ns();
                assert!((before..=before + T / 32 + 1).contains(&after), "{before} {after}");
                assert!(stood.iter().all(|piece| *piece == (before, after)));
                // Every period of the schedule begins with a step.
                let next = release_ns + (after.saturating_sub(release_ns)).div_ceil(T) * T;
                p.advance(next);
                assert_eq!(p.time_ns(), next);
            }
        }
    }

    #[test]
    fn a_robot_does_not_begin_in_the_middle_of_a_command() {
        let mut p = plant();
        p.advance(T + T / 2);
        assert_eq!(p.command(0, &header(1), &drive(1.0, 0.0), T + T / 2), Err(Refusal::Late));
        p.advance(3 * T);
        assert_eq!(p.poses().next(), Some(Pose::default()));
    }

    #[test]
    fn a_robot_that_stops_by_itself_stays_where_it_is() {
        let mut p = plant();
        p.command(0, &header(1), &drive(1.0, 0.0), 10).unwrap();
        p.advance(T + T / 2);
        assert_eq!(p.holding(0), Holding::Command { tick: 1 });
        p.halt(0);
        assert_eq!((p.holding(0), p.holding(1)), (Holding::Nothing, Holding::Untold));
        p.advance(3 * T);
        assert!((p.poses().next().unwrap().position_m.x - 0.04).abs() < 1e-12);
    }
}
