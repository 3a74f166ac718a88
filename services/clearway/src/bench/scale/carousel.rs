//! Traffic that never ends: who nears its goal is sent on along its street.

use clearway::admission::Rejections;
use clearway::clock::Clock;
use clearway::config::Config;
use clearway::geometry::{Vec2, rotate};
use clearway::model::RobotSpec;
use clearway::plant::Plant;
use clearway::source::{Instant, StateSource};
use clearway::wire::{CommandHeader, RobotCommand, RobotState};

/// Closer to its goal than this a robot is sent on, m: nobody brakes for a goal.
const NEAR_M: f64 = 4.0;
/// Way to the next goal along the lane, m.
const LEG_M: f64 = 12.0;

/// The daemon's plant with robots that go round and round the origin.
#[derive(Debug)]
pub(super) struct Carousel {
    plant: Plant,
    /// 1 for counter-clockwise, −1 for clockwise, and the radii between which the robot changes lanes.
    legs: Vec<(f64, [f64; 2])>,
}

impl Carousel {
    pub(super) fn new(config: &Config, start_ns: u64) -> Self {
        let leg = |robot: &RobotSpec| {
            let (start_m, goal_m) = (robot.start.position_m, robot.goal_m);
            (start_m.perp(&goal_m).signum(), [start_m.norm(), goal_m.norm()])
        };
        Self {
            plant: Plant::new(&config.scenario, config.timing.period_ns, start_ns).unreported(),
            legs: config.scenario.robots.iter().map(leg).collect(),
        }
    }
}

impl StateSource for Carousel {
    fn observe(&mut self, instant: Instant, clock: &dyn Clock, states: &mut [RobotState]) {
        StateSource::observe(&mut self.plant, instant, clock, states);
        for (state, (side, radii_m)) in states.iter_mut().zip(&mut self.legs) {
            let (goal_m, here_m) = (state.goal_m(), state.position_m());
            if (goal_m - here_m).norm_squared() > NEAR_M * NEAR_M {
                continue;
            }
            radii_m.swap(0, 1);
            let (sin, cos) = (*side * LEG_M / radii_m[1]).sin_cos();
            let next_m: Vec2 = rotate(goal_m, cos, sin) * (radii_m[1] / goal_m.norm());
            (state.goal_x_m, state.goal_y_m) = (next_m.x, next_m.y);
        }
    }

    fn knows_all(&self) -> bool {
        self.plant.knows_all()
    }

    fn admit(&mut self, index: usize, robot: &RobotSpec) {
        self.plant.admit(index, robot);
    }

    fn dismiss(&mut self, index: usize) {
        self.plant.dismiss(index);
    }

    fn commit(&mut self, header: &CommandHeader, commands: &[RobotCommand], now_ns: u64) {
        self.plant.commit(header, commands, now_ns);
    }

    fn rejections(&self) -> Rejections {
        self.plant.rejections()
    }
}
