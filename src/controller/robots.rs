//! The controllers of a whole fleet, which move from worker to worker with what they remember.

use super::robot::RobotController;
use super::seat::{Seat, Taken};
use super::{ControllerError, Law};
use crate::cache;
use crate::config::Config;
use crate::wire::RobotState;

/// One controller for each place of a fleet, common to its workers.
///
/// A worker takes the seats of a few robots, decides for one after the other, and leaves each of them at once. Nobody
/// ever waits for a seat, so that a worker that is late can disturb nobody but these few: a robot whose controller is
/// taken goes without an answer in this period, and stands. All of them lie in one piece of memory.
pub struct Robots {
    seats: Vec<Seat<Occupant>>,
}

#[repr(C)]
struct Occupant {
    /// The first period that it has not answered. Nobody answers an earlier one afterwards.
    next_tick: u64,
    robot: RobotController,
}

/// Robots whose seats are taken together: an atomic exchange waits for everything that was written before it, those
/// that follow it at once wait for nothing.
pub(super) const TOGETHER: usize = 8;

/// A controller that nobody else has, until this is dropped.
pub(super) struct Held<'a>(Taken<'a, Occupant>);

impl Held<'_> {
    /// Lets `decide` have the controller, unless it has answered `tick` or a later period.
    pub(super) fn answer(mut self, tick: u64, decide: impl FnOnce(&mut RobotController)) {
        if self.0.next_tick <= tick {
            self.0.next_tick = tick + 1;
            decide(&mut self.0.robot);
        }
    }
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

    /// The controllers of the first of these robots, unless they are taken.
    pub(super) fn hold(&self, indices: &[u32]) -> [Option<Held<'_>>; TOGETHER] {
        std::array::from_fn(|k| indices.get(k).and_then(|index| self.take(*index as usize)).map(Held))
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

    /// Says that the seat at `index` will be taken soon.
    pub(super) fn expect_seat(&self, index: usize) {
        if let Some(seat) = self.seats.get(index) {
            cache::expect(seat.state());
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
        Self { next_tick: 0, robot: RobotController::new(law, &state, index) }
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
        let with = |index: u32, tick: u64, decide: &mut dyn FnMut(&mut RobotController)| {
            robots.hold(&[index]).into_iter().flatten().for_each(|held| held.answer(tick, &mut *decide));
        };
        let had = |index: u32, tick| {
            let mut had = false;
            with(index, tick, &mut |robot| {
                assert_eq!(robot.index(), index as usize);
                // While it is out nobody else finds it.
                with(index, tick + 1, &mut |_| panic!("two holders"));
                had = true;
            });
            had
        };
        assert!(had(3, 5) && !had(3, 5) && !had(3, 4) && had(3, 6) && !had(8, 6));
        // Of those that are held together only the one is lost that was changed meanwhile.
        let failed = catch_unwind(AssertUnwindSafe(|| {
            let mut held = robots.hold(&[1, 2, 4]).into_iter().flatten();
            assert!(robots.hold(&[4, 1]).iter().all(Option::is_none));
            held.next().unwrap().answer(6, |_| {});
            held.next().unwrap().answer(6, |_| std::panic::resume_unwind(Box::new("a fault, injected")));
        }));
        assert!(failed.is_err() && !had(2, 7) && !had(1, 6) && had(1, 7) && had(4, 6));
        robots.refill(&Law::new(&config), &config);
        assert!(had(2, 8) && had(1, 8));
    }
}
