//! Routes made ahead of time, on their way from the thread that may take its time to the workers.

use crossbeam::atomic::AtomicCell;
use std::fmt;

use crate::geometry::Vec2;
use crate::guidance::{ObstacleView, Route, RouteBuilder};
use crate::model::Obstacle;
use crate::wire::RobotState;

/// A route, and for whom it is good.
#[derive(Debug)]
pub struct PreparedRoute {
    keep_m: f64,
    route: Route,
    /// The one that was done with before it.
    next: Option<Box<PreparedRoute>>,
}

impl PreparedRoute {
    /// The shortest ways around `obstacles` to the goal of `robot`, which keeps `margin_m` from them.
    /// Allocates and can take long among many obstacles: not for real-time threads.
    pub fn build(obstacles: &[Obstacle], margin_m: f64, robot: &RobotState) -> Self {
        let mut work = RouteWork::new(obstacles, margin_m + robot.radius_m, robot.goal_m());
        while !work.advance(&mut { usize::MAX }) {}
        work.finish()
    }
}

/// A [`PreparedRoute`] on its way, for who has to look at other things meanwhile.
#[derive(Debug)]
pub struct RouteWork {
    views: Vec<ObstacleView>,
    keep_m: f64,
    builder: RouteBuilder,
}

impl RouteWork {
    /// Begins the shortest ways around `obstacles` to `goal_m`, keeping `keep_m` from them: radius and
    /// margin.
    pub fn new(obstacles: &[Obstacle], keep_m: f64, goal_m: Vec2) -> Self {
        let views = obstacles.iter().map(|&obstacle| ObstacleView { obstacle, keep_m }).collect();
        Self { views, keep_m, builder: RouteBuilder::new(goal_m) }
    }

    /// Goes on for about `looks` looks at an obstacle and takes off what it needed; whether the route is
    /// finished.
    pub fn advance(&mut self, looks: &mut usize) -> bool {
        self.builder.advance(&self.views, looks)
    }

    /// The route, once it is finished.
    pub fn finish(self) -> PreparedRoute {
        PreparedRoute { keep_m: self.keep_m, route: self.builder.finish(), next: None }
    }
}

/// Where routes wait until their robots need them: for each robot the one to the goal that the newest
/// state tells, put there by whoever tells it, before.
///
/// A controller that finds a new goal in the state takes the route from here instead of building it,
/// and leaves the old one to be dropped elsewhere: it neither allocates nor frees, and nobody waits for
/// anybody. What it decides is the same either way.
pub struct RouteShelf {
    places: Vec<Place>,
}

struct Place {
    ready: AtomicCell<Option<Box<PreparedRoute>>>,
    /// What the controller has done with, one linked to the other.
    used: AtomicCell<Option<Box<PreparedRoute>>>,
}

/// What a controller found on the shelf.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Found {
    /// The route that it needs.
    Fitting,
    /// One for a state that came after its own, which it keeps until it sees that.
    Newer,
    Nothing,
}

impl RouteShelf {
    /// An empty shelf for `places` robots.
    pub fn new(places: usize) -> Self {
        let place = || Place { ready: AtomicCell::new(None), used: AtomicCell::new(None) };
        Self { places: (0..places).map(|_| place()).collect() }
    }

    /// Leaves the route to the goal that the next state tells the robot at `index`; returns the one that
    /// was there and is needed no more. Neither allocates nor frees.
    pub fn place(&self, index: usize, route: Box<PreparedRoute>) -> Option<Box<PreparedRoute>> {
        match self.places.get(index) {
            Some(place) => place.ready.swap(Some(route)),
            None => Some(route),
        }
    }

    /// [`place`](Self::place)s a route and [`sweep`](Self::sweep)s, outside of real-time threads.
    pub fn put(&self, index: usize, route: PreparedRoute) {
        drop(self.place(index, Box::new(route)));
        self.sweep(index);
    }

    /// Drops what the robot at `index` has done with.
    pub fn sweep(&self, index: usize) {
        drop(self.places.get(index).and_then(|place| place.used.take()));
    }

    /// Replaces `route` by the one that leads to `goal_m` at the distance `keep_m`, if it is there.
    /// `early` is what the controller took before it needed it.
    ///
    /// A worker that is late with a period may find the next one's route. Its answer comes too late in any
    /// case; the route is kept for who answers that period with the same controller.
    pub(super) fn exchange(
        &self,
        index: usize,
        (keep_m, goal_m): (f64, Vec2),
        route: &mut Route,
        early: &mut Option<Box<PreparedRoute>>,
    ) -> Found {
        let Some(place) = self.places.get(index) else { return Found::Nothing };
        let newest = place.ready.take();
        let came = newest.is_some();
        if let Some(older) = newest.and_then(|newest| early.replace(newest)) {
            place.leave(older);
        }
        let fits = |one: &PreparedRoute| one.keep_m == keep_m && one.route.goal_m() == goal_m;
        match early.take() {
            Some(mut next) if fits(&next) => {
                std::mem::swap(route, &mut next.route);
                place.leave(next);
                Found::Fitting
            }
            kept => {
                *early = kept;
                if came { Found::Newer } else { Found::Nothing }
            }
        }
    }
}

impl Place {
    /// For the one controller that this place has.
    fn leave(&self, mut route: Box<PreparedRoute>) {
        route.next = self.used.take();
        let nobody = self.used.swap(Some(route));
        debug_assert!(nobody.is_none(), "a place has one controller");
    }
}

impl fmt::Debug for RouteShelf {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RouteShelf").field("places", &self.places.len()).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const KEEP_M: f64 = 0.1 + 0.2;

    #[expect(clippy::unnecessary_box_returns, reason = "a place takes it boxed")]
    fn to(x_m: f64) -> Box<PreparedRoute> {
        let robot = RobotState { goal_x_m: x_m, radius_m: 0.2, ..RobotState::default() };
        Box::new(PreparedRoute::build(&[], 0.1, &robot))
    }

    fn nowhere() -> Route {
        Route::build(&[], Vec2::new(f64::NAN, 0.0))
    }

    fn goal(x_m: f64) -> (f64, Vec2) {
        (KEEP_M, Vec2::new(x_m, 0.0))
    }

    #[test]
    fn nobody_waits_for_anybody() {
        assert!(AtomicCell::<Option<Box<PreparedRoute>>>::is_lock_free());
    }

    #[test]
    fn the_newest_route_replaces_what_nobody_took() {
        let shelf = RouteShelf::new(2);
        assert!(shelf.place(7, to(1.0)).is_some(), "there is no such place");
        assert!(shelf.place(1, to(1.0)).is_none());
        assert_eq!(shelf.place(1, to(2.0)).map(|old| old.route.goal_m().x), Some(1.0));
        let (mut route, mut early) = (nowhere(), None);
        assert_eq!(shelf.exchange(0, goal(2.0), &mut route, &mut early), Found::Nothing);
        assert_eq!(shelf.exchange(7, goal(2.0), &mut route, &mut early), Found::Nothing);
        assert_eq!(shelf.exchange(1, goal(2.0), &mut route, &mut early), Found::Fitting);
        assert_eq!(route.goal_m().x, 2.0);
        // Another radius is another route.
        assert!(shelf.place(1, to(3.0)).is_none());
        assert_eq!(shelf.exchange(1, (0.5, goal(3.0).1), &mut route, &mut early), Found::Newer);
        assert_eq!(shelf.exchange(1, (0.5, goal(3.0).1), &mut route, &mut early), Found::Nothing);
        assert_eq!(route.goal_m().x, 2.0);
        shelf.sweep(1);
        assert!(shelf.places[1].used.take().is_none());
    }

    proptest! {
        /// However many goals come in a period, and however often a worker is late with one: whoever
        /// answers the newest state finds its route.
        #[test]
        fn the_route_to_the_goal_of_the_newest_state_is_always_there(
            periods in prop::collection::vec((0..6usize, any::<bool>()), 1..60),
        ) {
            let shelf = RouteShelf::new(1);
            let (mut route, mut early) = (nowhere(), None);
            let (mut newest, mut known, mut given, mut swept) = (f64::NAN, f64::NAN, 0_u32, 0_u32);
            for (goals, late) in periods {
                let before = newest;
                for _ in 0..goals {
                    given += 1;
                    newest = f64::from(given);
                    swept += u32::from(shelf.place(0, to(newest)).is_some());
                }
                // A late worker still answers the state before.
                let wanted = if late { before } else { newest };
                if wanted.to_bits() != known.to_bits() && !wanted.is_nan() {
                    match shelf.exchange(0, goal(wanted), &mut route, &mut early) {
                        Found::Fitting => known = wanted,
                        found => prop_assert!(late && found == Found::Newer, "{:?} at {}", found, given),
                    }
                }
                prop_assert!(late || newest.is_nan() || route.goal_m().x == newest);
            }
            // Nothing is lost: one may wait, one may be kept, one is in use.
            let mut used = shelf.places[0].used.take();
            while let Some(one) = used {
                swept += 1;
                used = one.next;
            }
            let left = u32::from(shelf.places[0].ready.take().is_some()) + u32::from(early.is_some());
            prop_assert_eq!(given, swept + left);
        }
    }
}
