//! Routes made ahead of time, on their way from the thread that may take its time to the workers.

use crossbeam::queue::ArrayQueue;

use crate::guidance::{ObstacleView, Route};
use crate::model::Obstacle;
use crate::wire::RobotState;

/// Routes that wait for one robot at most; the oldest makes room.
const WAITING: usize = 4;

/// A route, and for whom it is good.
#[derive(Debug)]
pub struct PreparedRoute {
    keep_m: f64,
    route: Route,
}

impl PreparedRoute {
    /// The shortest ways around `obstacles` to the goal of `robot`, which keeps `margin_m` from them.
    /// Allocates and can take long among many obstacles: not for real-time threads.
    pub fn build(obstacles: &[Obstacle], margin_m: f64, robot: &RobotState) -> Self {
        let keep_m = margin_m + robot.radius_m;
        let views: Vec<_> = obstacles.iter().map(|&obstacle| ObstacleView { obstacle, keep_m }).collect();
        Self { keep_m, route: Route::build(&views, robot.goal_m()) }
    }
}

/// Where routes wait until their robots need them.
///
/// A controller that finds a new goal in the state takes the route from here instead of building it,
/// and leaves the old one to be dropped elsewhere: it neither allocates nor frees. What it decides is
/// the same either way.
#[derive(Debug)]
pub struct RouteShelf {
    places: Vec<Place>,
}

#[derive(Debug)]
struct Place {
    ready: ArrayQueue<PreparedRoute>,
    /// Has room for all that can be under way: those that wait, and the one in use.
    used: ArrayQueue<Route>,
}

impl RouteShelf {
    /// An empty shelf for `places` robots.
    pub fn new(places: usize) -> Self {
        let place = || Place { ready: ArrayQueue::new(WAITING), used: ArrayQueue::new(WAITING + 2) };
        Self { places: (0..places).map(|_| place()).collect() }
    }

    /// Leaves a route for the robot at `index`, and drops those that it has done with.
    pub fn put(&self, index: usize, route: PreparedRoute) {
        let Some(place) = self.places.get(index) else { return };
        while place.used.pop().is_some() {}
        let _ = place.ready.force_push(route);
    }

    /// Replaces `route` by the one that leads to `goal_m` at the distance `keep_m`; false when there is
    /// none.
    pub(super) fn exchange(
        &self,
        index: usize,
        keep_m: f64,
        goal_m: crate::geometry::Vec2,
        route: &mut Route,
    ) -> bool {
        let Some(place) = self.places.get(index) else { return false };
        while let Some(next) = place.ready.pop() {
            let fits = next.keep_m == keep_m && next.route.goal_m() == goal_m;
            let done = if fits { std::mem::replace(route, next.route) } else { next.route };
            // There is room: see `Place::used`.
            let _ = place.used.push(done);
            if fits {
                return true;
            }
        }
        false
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;

    fn to(x_m: f64, radius_m: f64) -> PreparedRoute {
        let robot = RobotState { goal_x_m: x_m, radius_m, ..RobotState::default() };
        PreparedRoute::build(&[], 0.1, &robot)
    }

    #[test]
    fn the_route_that_fits_is_taken_and_older_ones_are_passed_over() {
        let shelf = RouteShelf::new(2);
        for x in [1.0, 2.0, 3.0] {
            shelf.put(1, to(x, 0.2));
        }
        let mut route = Route::build(&[], Vec2::new(0.0, 0.0));
        assert!(!shelf.exchange(0, 0.1 + 0.2, Vec2::new(2.0, 0.0), &mut route));
        assert!(shelf.exchange(1, 0.1 + 0.2, Vec2::new(2.0, 0.0), &mut route));
        assert_eq!(route.goal_m(), Vec2::new(2.0, 0.0));
        // Another radius is another route.
        assert!(!shelf.exchange(1, 0.1 + 0.5, Vec2::new(3.0, 0.0), &mut route));
        assert!(!shelf.exchange(7, 0.3, Vec2::new(3.0, 0.0), &mut route));
        assert_eq!(route.goal_m(), Vec2::new(2.0, 0.0));
    }

    #[test]
    fn however_many_are_left_the_newest_is_there_and_nothing_is_lost_in_the_period() {
        let shelf = RouteShelf::new(1);
        let mut route = Route::build(&[], Vec2::new(0.0, 0.0));
        for round in 0..20 {
            for x in 0..=round {
                shelf.put(0, to(f64::from(x), 0.2));
            }
            assert!(shelf.exchange(0, 0.1 + 0.2, Vec2::new(f64::from(round), 0.0), &mut route));
            assert!(!shelf.places[0].used.is_full());
        }
    }
}
