//! The controllers of a whole fleet, which move from worker to worker with what they remember.

use super::robot::RobotController;
use super::seat::{Seat, Taken};
use super::{ControllerError, Law};
use crate::cache;
use crate::config::Config;
use crate::wire::RobotState;

/// One controller for each place of a fleet, common to its workers.
///
/// A worker tries the seat of a robot, decides, and leaves it. Nobody ever waits for a seat, so that a worker
/// that is late can disturb nobody: a robot whose controller is taken goes without an answer in this period,
/// and stands. All of them lie in one piece of memory.
pub struct Robots {
    seats: Vec<Seat<Occupant>>,
}

struct Occupant {
    robot: RobotController,
    /// The first period that it has not answered. Nobody answers an earlier one afterwards.
    next_tick: u64,
}

impl Robots {
    /// The controllers of all places of `config`, at their starts.
    pub fn new(config: &Config) -> Self {
        let law = Law::new(config);
        let seat = |index| Seat::new(Occupant::at_start(&law, config, index));
        Self { seats: (0..config.places()).map(seat).collect() }
    }

    /// Makes those anew that were lost in a panic; they remember nothing. Allocates.
    pub(super) fn refill(&self, law: &Law, config: &Config) {
        for (index, seat) in self.seats.iter().enumerate() {
            if let Some(mut lost) = seat.take_lost() {
                *lost = Occupant::at_start(law, config, index);
            }
        }
    }

    /// Lets `decide` have the controller at `index`, unless it is taken or has answered `tick` or a later
    /// period.
    pub(super) fn with(&self, index: usize, tick: u64, decide: impl FnOnce(&mut RobotController)) {
        if let Some(mut occupant) = self.take(index).filter(|occupant| occupant.next_tick <= tick) {
            occupant.next_tick = tick + 1;
            decide(&mut occupant.robot);
        }
    }

    /// Lets `change` have the controller at `index` if `tick` is the last period that it has answered.
    pub(super) fn undo(&self, index: usize, tick: u64, change: impl FnOnce(&mut RobotController)) {
        if let Some(mut occupant) = self.take(index).filter(|occupant| occupant.next_tick == tick + 1) {
            change(&mut occupant.robot);
        }
    }

    /// The controller at `index` if it is there and whole.
    fn take(&self, index: usize) -> Option<Taken<'_, Occupant>> {
        self.seats.get(index)?.take()
    }

    /// Says that the controller at `index` will be wanted soon.
    pub(super) fn expect(&self, index: usize) {
        if let Some(seat) = self.seats.get(index) {
            cache::expect(seat);
        }
    }

    /// Whether there is one for each of `places`.
    pub(super) fn fits(&self, places: usize) -> Result<(), ControllerError> {
        let robots = self.seats.len();
        let refused = ControllerError::NoSuchRobot { first: 0, end: places, robots };
        if robots == places { Ok(()) } else { Err(refused) }
    }
}

impl Occupant {
    fn at_start(law: &Law, config: &Config, index: usize) -> Self {
        let robots = &config.scenario.robots;
        let state = robots.get(index).map_or_else(RobotState::vacant, RobotState::at_start);
        Self { robot: RobotController::new(law, &state, index), next_tick: 0 }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use std::panic::{AssertUnwindSafe, catch_unwind};

    #[test]
    fn a_controller_has_one_holder_answers_once_and_is_made_anew_after_a_panic() {
        let config = Config::new(Scenario::builtin("swap8").unwrap());
        let robots = Robots::new(&config);
        assert!(robots.fits(config.places()).is_ok() && robots.fits(3).is_err());
        let had = |index, tick| {
            let mut had = false;
            robots.with(index, tick, |robot| {
                assert_eq!(robot.index(), index);
                // While it is out nobody else finds it.
                robots.with(index, tick + 1, |_| panic!("two holders"));
                had = true;
            });
            had
        };
        assert!(had(3, 5) && !had(3, 5) && !had(3, 4) && had(3, 6) && !had(8, 6));
        let failed = catch_unwind(AssertUnwindSafe(|| {
            robots.with(2, 6, |_| std::panic::resume_unwind(Box::new("a fault, injected")));
        }));
        assert!(failed.is_err() && !had(2, 7) && had(1, 7));
        robots.refill(&Law::new(&config), &config);
        assert!(had(2, 8) && had(1, 8));
    }
}
