use super::noise::{Use, symmetric, uniform};
use crate::config::{DisturbanceConfig, Pattern};
use crate::geometry::{Arc, Pose, Vec2, unit};
use crate::model::{Command, Obstacle, RobotId, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::NO_ROBOT;
use std::f64::consts::TAU;

/// Robots whose wheels follow commands late and slip, and whose states are shown with noise.
#[derive(Debug, Clone)]
pub struct DisturbedFleet {
    config: DisturbanceConfig,
    step_s: f64,
    steps: u64,
    delayed: usize,
    obstacles: Vec<Obstacle>,
    robots: Vec<Robot>,
    arcs: Vec<Arc>,
}

#[derive(Debug, Clone)]
struct Robot {
    id: u32,
    radius_m: f64,
    pose: Pose,
    /// What the wheels do.
    wheels: Command,
    /// Commands that wait for the delay to pass, a ring of one for each step.
    waiting: Vec<Command>,
}

impl DisturbedFleet {
    /// Steps of a period in which the wheels' speed and the slip are held: the motion is an arc in each.
    ///
    /// With a lag the travel of a step is exact, and the wheels' speed within it its mean: at every instant
    /// the robot is within v_max h²/(8 lag) of exact wheels, 0.08 mm at 5 m/s, 50 ms and h = 2.5 ms.
    pub const STEPS: u32 = 32;

    /// The scenario's robots at their starts, at rest.
    pub fn new(scenario: &Scenario, config: &DisturbanceConfig, period_s: f64) -> Self {
        let step_s = period_s / f64::from(Self::STEPS);
        // Rounded down: no later than it says.
        #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // 0 to a few periods
        let delayed = (config.amplitude.delay_s / step_s + 1e-9).floor() as usize;
        let robot = |spec: &RobotSpec| Robot::at_rest(spec.id.0, spec.radius_m, spec.start, delayed);
        let robots: Vec<Robot> = scenario.robots.iter().map(robot).collect();
        let arcs =
            robots.iter().map(|robot| Arc { start: robot.pose, v_mps: 0.0, omega_radps: 0.0 }).collect();
        Self {
            config: *config,
            step_s,
            steps: 0,
            delayed,
            obstacles: scenario.obstacles.clone(),
            robots,
            arcs,
        }
    }

    /// Length of a step, s.
    pub fn step_s(&self) -> f64 {
        self.step_s
    }

    /// Room for as many robots as there are places.
    pub fn make_room(&mut self, places: usize) {
        while self.robots.len() < places {
            self.robots.push(Robot::at_rest(NO_ROBOT, 0.0, Pose::default(), self.delayed));
            self.arcs.push(Arc { start: Pose::default(), v_mps: 0.0, omega_radps: 0.0 });
        }
    }

    /// Puts robot `id` into the `index`-th place, at rest.
    pub fn place(&mut self, index: usize, id: RobotId, pose: Pose) {
        if let Some(robot) = self.robots.get_mut(index) {
            (robot.id, robot.pose, robot.wheels) = (id.0, pose, Command::STOP);
            robot.waiting.fill(Command::STOP);
        }
    }

    /// Id of the robot in the `index`-th place.
    pub fn id(&self, index: usize) -> Option<u32> {
        self.robots.get(index).map(|robot| robot.id)
    }

    /// True pose of the `index`-th robot.
    pub fn pose(&self, index: usize) -> Option<Pose> {
        self.robots.get(index).map(|robot| robot.pose)
    }

    /// The pose of the `index`-th robot as it is seen at the instant `instant`.
    pub fn seen(&self, index: usize, instant: u64) -> Option<Pose> {
        let (a, robot) = (&self.config.amplitude, self.robots.get(index)?);
        let (seed, id) = (self.config.seed, robot.id);
        let draw = |of| symmetric(seed, id, instant, of);
        let (offset, turn) = match self.config.pattern {
            Pattern::Random => {
                // Uniform over the disc.
                let radius = a.position_m * uniform(seed, id, instant, Use::Radius).sqrt();
                (unit(TAU * uniform(seed, id, instant, Use::Bearing)) * radius, draw(Use::Heading))
            }
            Pattern::Adversarial => {
                // It seems farther from its neighbour, and less turned to it, than it is.
                let to = self.towards(index);
                (to * -a.position_m, -side(robot.pose, to))
            }
        };
        let position = robot.pose.position_m + offset;
        Some(Pose::new(position.x, position.y, robot.pose.theta_rad + a.heading_rad * turn))
    }

    /// Moves every robot on by one step under its input, and returns the arcs of the step.
    pub fn step(&mut self, mut input: impl FnMut(usize) -> Command) -> &[Arc] {
        let (step, step_s) = (self.steps, self.step_s);
        for index in 0..self.robots.len() {
            let (slip, turn) = self.slip(index, step);
            let slot = if self.delayed > 0 { usize::try_from(step).unwrap_or(0) % self.delayed } else { 0 };
            let robot = &mut self.robots[index];
            let mut command = input(index);
            if let Some(waiting) = robot.waiting.get_mut(slot) {
                std::mem::swap(waiting, &mut command);
            }
            let (v_mps, omega_radps) = robot.follow(command, self.config.amplitude.lag_s, step_s);
            // The velocity in the robot's frame: along the heading, and what slips.
            let velocity = Vec2::new(v_mps + slip.x * v_mps.abs(), slip.y * v_mps.abs());
            let sideways = if velocity == Vec2::zeros() { 0.0 } else { libm::atan2(velocity.y, velocity.x) };
            let start = Pose { theta_rad: robot.pose.theta_rad + sideways, ..robot.pose };
            let arc = Arc { start, v_mps: velocity.norm(), omega_radps: omega_radps + turn };
            let theta_rad = robot.pose.theta_rad + arc.omega_radps * step_s;
            let end = arc.position(step_s);
            self.arcs[index] = arc;
            robot.pose = Pose::new(end.x, end.y, theta_rad);
        }
        self.steps += 1;
        &self.arcs
    }

    /// Slip in the robot's frame as a share of the wheels' speed, and the error of the turn rate, rad/s.
    fn slip(&self, index: usize, step: u64) -> (Vec2, f64) {
        let (a, robot) = (&self.config.amplitude, &self.robots[index]);
        let (seed, id) = (self.config.seed, robot.id);
        match self.config.pattern {
            Pattern::Random => {
                let size = a.slip * uniform(seed, id, step, Use::Slip).sqrt();
                let slip = unit(TAU * uniform(seed, id, step, Use::Direction)) * size;
                (slip, a.turn_rate_radps * symmetric(seed, id, step, Use::Turn))
            }
            Pattern::Adversarial => {
                let to = self.towards(index);
                let heading = robot.pose.heading();
                let slip = Vec2::new(heading.dot(&to), heading.perp(&to)) * a.slip;
                (slip, a.turn_rate_radps * side(robot.pose, to))
            }
        }
    }

    /// Unit vector to the nearest body, robot or obstacle; zero when there is none.
    fn towards(&self, index: usize) -> Vec2 {
        let own = &self.robots[index];
        let here = own.pose.position_m;
        let robots =
            self.robots.iter().filter(|other| other.id != own.id && other.id != NO_ROBOT).map(|other| {
                let to = other.pose.position_m - here;
                (to.norm() - other.radius_m, to)
            });
        let obstacles = self.obstacles.iter().map(|obstacle| {
            let to = obstacle.closest_core_point(here) - here;
            (to.norm() - obstacle.reach_m(), to)
        });
        let nearest = robots.chain(obstacles).min_by(|a, b| a.0.total_cmp(&b.0));
        nearest.filter(|(_, to)| to.norm() > 0.0).map_or(Vec2::zeros(), |(_, to)| to / to.norm())
    }
}

/// The sense of rotation that turns a pose to a direction: 1 to the left, −1 to the right.
fn side(pose: Pose, to: Vec2) -> f64 {
    if pose.heading().perp(&to) >= 0.0 { 1.0 } else { -1.0 }
}

impl Robot {
    fn at_rest(id: u32, radius_m: f64, pose: Pose, delayed: usize) -> Self {
        Self { id, radius_m, pose, wheels: Command::STOP, waiting: vec![Command::STOP; delayed] }
    }

    /// The wheels follow `command` for `s` seconds; their mean speeds.
    fn follow(&mut self, command: Command, lag_s: f64, s: f64) -> (f64, f64) {
        if lag_s <= 0.0 {
            self.wheels = command;
            return (command.v_mps, command.omega_radps);
        }
        let kept = libm::exp(-s / lag_s);
        let mean = lag_s / s * (1.0 - kept);
        let follow = |wheel: &mut f64, target: f64| {
            let behind = *wheel - target;
            *wheel = target + behind * kept;
            target + behind * mean
        };
        (
            follow(&mut self.wheels.v_mps, command.v_mps),
            follow(&mut self.wheels.omega_radps, command.omega_radps),
        )
    }
}
