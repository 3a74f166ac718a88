//! What must hold, computed apart from the controller: the motion of a unicycle, the distance that is kept,
//! the validity of what is driven.

use std::collections::VecDeque;

use crate::channel::memory::Message;
use crate::geometry::{TimedArc, Vec2, closest_point_on_segment};
use crate::model::{Command, Limits, Obstacle};
use crate::wire::{RobotCommand, RobotState, state_flags};

/// Rounding that is forgiven, m.
const ROUNDING_M: f64 = 1e-9;
/// How much closer two come before it counts: the sum of what is rounded, m.
const TOUCH_M: f64 = 1e-7;
/// Points of a period at which a command is looked at.
const POINTS: usize = 17;
/// Command samples that are remembered: some more than can act.
const REMEMBERED: usize = 64;

/// Where a unicycle is that drives for `s` seconds: by integrating (10), not by the chord that the
/// controller uses.
pub(crate) fn driven(from: Vec2, theta_rad: f64, command: Command, s: f64) -> Vec2 {
    let (v, omega) = (command.v_mps, command.omega_radps);
    if (omega * s).abs() < 1e-7 {
        // The radius is larger than anything: a line, and the second term of the series across it.
        let (along, across) = (v * s, 0.5 * v * omega * s * s);
        let (sin, cos) = theta_rad.sin_cos();
        return from + Vec2::new(along * cos - across * sin, along * sin + across * cos);
    }
    let radius_m = v / omega;
    let turned = theta_rad + omega * s;
    from + Vec2::new(radius_m * (turned.sin() - theta_rad.sin()), radius_m * (theta_rad.cos() - turned.cos()))
}

/// What is kept between bodies.
#[derive(Debug, Clone)]
pub(crate) struct Keeps {
    pub(crate) limits: Limits,
    pub(crate) gamma: f64,
    pub(crate) period_s: f64,
    pub(crate) obstacles: Vec<Obstacle>,
}

impl Keeps {
    pub(crate) fn required_m(&self, a: &RobotState, b: &RobotState) -> f64 {
        self.limits.safety_margin_m + a.radius_m + b.radius_m
    }

    /// The distances before and after to a place where `other` may have come to a stand, if somebody at `here`
    /// who drives `way` comes too close to it.
    fn stands_in_the_way(
        &self,
        other: &RobotState,
        here: Vec2,
        way: &[Vec2],
        required_m: f64,
    ) -> Option<(f64, f64)> {
        let period = |i: usize| self.period_s * i as f64 / (POINTS - 1) as f64;
        let on_its_way = |i| driven(other.position_m(), other.theta_rad, other.command(), period(i));
        let places = (0..POINTS).map(on_its_way).chain([other.seen_m()]);
        places.into_iter().find_map(|place| {
            let before_m = (here - place).norm();
            let after_m = way.iter().map(|moved| (here + moved - place).norm()).fold(f64::INFINITY, f64::min);
            (after_m < required_m.min(before_m) - ROUNDING_M).then_some((before_m, after_m))
        })
    }

    /// Why `command` must not be given to robot `me`, whose command in force leads to where this one acts;
    /// `None` when it may: it is finite, within the limits, and keeps its share of every gap.
    pub(crate) fn objection(
        &self,
        fleet: &[RobotState],
        me: usize,
        command: &RobotCommand,
    ) -> Option<String> {
        let own = &fleet[me];
        let input = command.command();
        let l = &self.limits;
        let admissible = input.v_mps >= l.v_min_mps
            && input.v_mps <= l.v_max_mps
            && input.omega_radps >= l.omega_min_radps
            && input.omega_radps <= l.omega_max_radps;
        if !admissible {
            return Some(format!(
                "v {} m/s, ω {} rad/s are beyond the limits",
                input.v_mps, input.omega_radps
            ));
        }
        if command.stop_reason != 0 {
            let stands = input == Command::STOP;
            return (!stands).then(|| format!("a stop that drives: {input:?}"));
        }
        if !own.has(state_flags::VALID) {
            return Some("a robot without a trusted state is driven".to_owned());
        }
        if own.has(state_flags::OUT_OF_STEP) {
            return Some("a robot that missed a command is driven".to_owned());
        }
        if input.v_mps == 0.0 {
            return None;
        }
        let at =
            |state: &RobotState| driven(state.position_m(), state.theta_rad, state.command(), self.period_s);
        let here = at(own);
        let theta_rad = own.theta_rad + own.omega_radps * self.period_s;
        let way: [Vec2; POINTS] = std::array::from_fn(|i| {
            driven(here, theta_rad, input, self.period_s * i as f64 / (POINTS - 1) as f64) - here
        });
        let step_m = input.v_mps.abs() * self.period_s;
        // How far the way leads towards a body in the direction of `normal`, which points away from it.
        let approach = |normal: Vec2| way.iter().map(|moved| -normal.dot(moved)).fold(0.0, f64::max);
        for (index, other) in fleet.iter().enumerate() {
            if index == me || other.has(state_flags::VACANT) {
                continue;
            }
            let apart = here - at(other);
            let (distance_m, required_m) = (apart.norm(), self.required_m(own, other));
            let share = if other.has(state_flags::FOREIGN) { 1.0 } else { 0.5 };
            let budget_m = share * self.gamma * (distance_m - required_m).max(0.0);
            if step_m <= budget_m {
                continue;
            }
            // Out of the same place every way leads apart.
            if distance_m == 0.0 {
                continue;
            }
            let used_m = approach(apart / distance_m);
            if used_m > budget_m + ROUNDING_M {
                return Some(format!(
                    "it takes {used_m} m of {budget_m} m towards robot {}, {distance_m} m away",
                    other.id
                ));
            }
            let came = other
                .has(state_flags::MAY_STAND)
                .then(|| self.stands_in_the_way(other, here, &way, required_m));
            if let Some((before_m, after_m)) = came.flatten() {
                return Some(format!(
                    "if robot {} has come to a stand on its way it comes from {before_m} m to {after_m} m of it",
                    other.id
                ));
            }
        }
        for obstacle in &self.obstacles {
            let apart = here - obstacle.closest_core_point(here);
            let distance_m = apart.norm();
            let required_m = self.limits.safety_margin_m + own.radius_m + obstacle.reach_m();
            let budget_m = self.gamma * (distance_m - required_m).max(0.0);
            if step_m > budget_m && distance_m > 0.0 {
                let used_m = approach(apart / distance_m);
                if used_m > budget_m + ROUNDING_M {
                    return Some(format!("it takes {used_m} m of {budget_m} m towards an obstacle"));
                }
            }
        }
        None
    }
}

/// What was really published, as the plant may drive it, and the state that it answers.
#[derive(Debug, Default)]
pub(crate) struct Genuine(VecDeque<(Message<RobotCommand>, Option<Message<RobotState>>)>);

impl Genuine {
    pub(crate) fn add(&mut self, message: Message<RobotCommand>, state: Option<Message<RobotState>>) {
        if self.0.len() == REMEMBERED {
            self.0.pop_front();
        }
        self.0.push_back((message, state));
    }

    /// Where robot `id` was to begin the command with which `piece` begins, and how far from there it does,
    /// m; `None` where that is the same place, or cannot be known.
    pub(crate) fn astray(&self, id: u32, piece: &TimedArc) -> Option<(Vec2, f64)> {
        let begins =
            |(message, _): &&(Message<RobotCommand>, _)| message.header.valid_from_ns == piece.from_ns;
        let (message, state) = self.0.iter().rev().find(begins)?;
        let state = state.as_ref()?;
        let robot = state.robots.iter().find(|robot| robot.id == id)?;
        let period_s = message.header.valid_from_ns.checked_sub(state.header.release_ns)? as f64 * 1e-9;
        let expected = driven(robot.position_m(), robot.theta_rad, robot.command(), period_s);
        let off_m = (piece.arc.start.position_m - expected).norm();
        (off_m > TOUCH_M).then_some((expected, off_m))
    }

    /// Whether robot `id` may drive `piece`: it stands, or somebody told it so, for all of that time.
    pub(crate) fn allows(&self, id: u32, piece: &TimedArc) -> bool {
        let (v_mps, omega_radps) = (piece.arc.v_mps, piece.arc.omega_radps);
        if (v_mps, omega_radps) == (0.0, 0.0) {
            return true;
        }
        self.0.iter().rev().any(|(message, _)| {
            let header = &message.header;
            header.valid_from_ns <= piece.from_ns
                && piece.to_ns <= header.valid_until_ns
                && message.robots.iter().any(|one| {
                    one.id == id
                        && one.stop_reason == 0
                        && (one.v_mps, one.omega_radps) == (v_mps, omega_radps)
                })
        })
    }
}

/// Whether two that move stay `required_m` apart for all of the time, and otherwise how close they come:
/// halves until what can happen within a piece cannot matter.
pub(crate) fn keep_apart(a: &[TimedArc], b: &[TimedArc], required_m: f64) -> Result<(), f64> {
    for x in a {
        for y in b {
            let (from_ns, to_ns) = (x.from_ns.max(y.from_ns), x.to_ns.min(y.to_ns));
            if from_ns >= to_ns {
                continue;
            }
            let place = |piece: &TimedArc, at_s: f64| {
                let since_s = (from_ns - piece.from_ns) as f64 * 1e-9 + at_s;
                let command = Command { v_mps: piece.arc.v_mps, omega_radps: piece.arc.omega_radps };
                driven(piece.arc.start.position_m, piece.arc.start.theta_rad, command, since_s)
            };
            let apart = |at_s: f64| place(x, at_s) - place(y, at_s);
            let bend_mps2 = (x.arc.v_mps * x.arc.omega_radps).abs() + (y.arc.v_mps * y.arc.omega_radps).abs();
            let end_s = (to_ns - from_ns) as f64 * 1e-9;
            halve(&apart, (0.0, apart(0.0)), (end_s, apart(end_s)), bend_mps2, required_m)?;
        }
    }
    Ok(())
}

/// From one to another, the way leaves its chord by at most an eighth of the acceleration times the time
/// squared.
fn halve(
    apart: &impl Fn(f64) -> Vec2,
    from: (f64, Vec2),
    to: (f64, Vec2),
    bend_mps2: f64,
    required_m: f64,
) -> Result<(), f64> {
    let chord_m = closest_point_on_segment(Vec2::zeros(), from.1, to.1).norm();
    let off_m = 0.125 * bend_mps2 * (to.0 - from.0).powi(2);
    if chord_m - off_m >= required_m {
        return Ok(());
    }
    let least_m = from.1.norm().min(to.1.norm());
    if least_m < required_m - TOUCH_M {
        return Err(least_m);
    }
    if off_m < 0.1 * TOUCH_M {
        return if chord_m < required_m - TOUCH_M { Err(chord_m) } else { Ok(()) };
    }
    let middle_s = 0.5 * (from.0 + to.0);
    let middle = (middle_s, apart(middle_s));
    halve(apart, from, middle, bend_mps2, required_m)?;
    halve(apart, middle, to, bend_mps2, required_m)
}

/// FNV-1a over everything that went out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Digest(pub(crate) u64);

impl Default for Digest {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Digest {
    pub(crate) fn add(&mut self, word: u64) {
        for byte in word.to_le_bytes() {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3);
        }
    }

    pub(crate) fn add_command(&mut self, command: &RobotCommand) {
        self.add(u64::from(command.id) << 32 | u64::from(command.stop_reason));
        self.add(command.v_mps.to_bits());
        self.add(command.omega_radps.to_bits());
    }
}
