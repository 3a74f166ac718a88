//! The controllers of a whole fleet, which move from worker to worker with what they remember.

use super::robot::RobotController;
use super::{ControllerError, Law};
use crate::config::Config;
use crate::wire::RobotState;
use crossbeam::atomic::AtomicCell;
use std::sync::atomic::{AtomicBool, Ordering};

/// One controller for each place of a fleet, common to its workers.
///
/// A worker takes a robot's controller out, decides, and puts it back: two exchanges of a pointer, and no
/// lock. While it is out nobody else finds it, so that a worker that is late can disturb nobody: a robot
/// whose controller is away goes without an answer in this period, and stands.
pub struct Robots {
    seats: Vec<Seat>,
}

struct Seat {
    robot: AtomicCell<Option<Box<Occupant>>>,
    /// A panic took it along.
    lost: AtomicBool,
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
        let seat = |index| Seat {
            robot: AtomicCell::new(Some(Box::new(Occupant::at_start(&law, config, index)))),
            lost: AtomicBool::new(false),
        };
        Self { seats: (0..config.places()).map(seat).collect() }
    }

    /// Makes those anew that were lost in a panic; they remember nothing. Allocates.
    pub(super) fn refill(&self, law: &Law, config: &Config) {
        for (index, seat) in self.seats.iter().enumerate() {
            if seat.lost.swap(false, Ordering::AcqRel) {
                seat.robot.store(Some(Box::new(Occupant::at_start(law, config, index))));
            }
        }
    }

    /// Lets `decide` have the controller at `index`, unless it is away or has answered `tick` or a later
    /// period.
    pub(super) fn with(&self, index: usize, tick: u64, decide: impl FnOnce(&mut RobotController)) {
        let Some(seat) = self.seats.get(index) else { return };
        let Some(mut occupant) = seat.robot.take() else { return };
        let due = occupant.next_tick <= tick;
        if due {
            occupant.next_tick = tick + 1;
        }
        let mut held = Held { seat, occupant: Some(occupant) };
        if let Some(occupant) = held.occupant.as_mut().filter(|_| due) {
            decide(&mut occupant.robot);
        }
    }

    /// Lets `change` have the controller at `index` if `tick` is the last period that it has answered.
    pub(super) fn undo(&self, index: usize, tick: u64, change: impl FnOnce(&mut RobotController)) {
        let Some(seat) = self.seats.get(index) else { return };
        let Some(occupant) = seat.robot.take() else { return };
        let last = occupant.next_tick == tick + 1;
        let mut held = Held { seat, occupant: Some(occupant) };
        if let Some(occupant) = held.occupant.as_mut().filter(|_| last) {
            change(&mut occupant.robot);
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

/// Puts the controller back, unless a panic may have left it half changed.
struct Held<'a> {
    seat: &'a Seat,
    occupant: Option<Box<Occupant>>,
}

impl Drop for Held<'_> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            drop(self.occupant.take());
            self.seat.lost.store(true, Ordering::Release);
        } else {
            self.seat.robot.store(self.occupant.take());
        }
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
