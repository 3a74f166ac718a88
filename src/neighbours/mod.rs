//! Who is near: the other robots that matter to one, nearest first, the smaller id breaking ties.
//!
//! [`Surroundings`] sorts a fleet's states into cells once a period; [`Neighbourhood`] then looks at the
//! cells around a robot. Everybody within the reach of the robot's rows is listed, however many; of
//! those beyond it, as many as the guidance looks at. Cost: a few nanoseconds for each robot of the
//! fleet, and for each robot asked about a distance to those in the cells around it and a sort of those
//! within reach. The lists have room for the whole fleet from the start, so nothing is ever truncated
//! and nothing allocates.

mod look;
mod rank;

use crate::geometry::{Grid, Vec2};
use crate::wire::{RobotState, state_flags};
use look::{Circle, Found};
use rank::{RANKED_MAX, roots};

/// Another robot of the fleet, seen from one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Nearby {
    /// Distance of the centres, m.
    pub distance_m: f64,
    /// Its id.
    pub id: u32,
    /// Its index in the fleet.
    pub index: usize,
    /// Its place in the order of the ground, where those near each other are near; [`NO_PLACE`] for one that was added.
    pub place: u32,
}

/// Larger than every place.
pub const NO_PLACE: u32 = u32::MAX;

/// A fleet's positions, sorted by place. Free places are nowhere.
#[derive(Debug, Clone)]
pub struct Surroundings {
    grid: Grid,
    /// The robots as the grid got them: where they are, their ids and indices.
    seen: Vec<(Vec2, Who)>,
    /// Indices of the places that are free.
    free: Vec<u32>,
    /// Where the robots are, and who, in the grid's order.
    x_m: Vec<f64>,
    y_m: Vec<f64>,
    who: Vec<Who>,
    /// The place in that order of the robot at each index, or [`NO_PLACE`].
    places: Vec<u32>,
    /// The indices in that order, and with the free places spread among them; of use where there are any.
    robots: Vec<u32>,
    order: Vec<u32>,
}

/// A robot's id and its index.
#[derive(Debug, Clone, Copy, Default)]
struct Who {
    id: u32,
    index: u32,
}

impl Surroundings {
    /// With room for a fleet of `robots` and cells of `cell_m`: best about as large as the usual reach.
    pub fn with_capacity(robots: usize, cell_m: f64) -> Self {
        Self {
            grid: Grid::with_capacity(robots, cell_m),
            seen: Vec::with_capacity(robots),
            free: Vec::with_capacity(robots),
            x_m: Vec::with_capacity(robots),
            y_m: Vec::with_capacity(robots),
            who: Vec::with_capacity(robots),
            places: Vec::with_capacity(robots),
            robots: Vec::with_capacity(robots),
            order: Vec::with_capacity(robots),
        }
    }

    /// Takes in where the robots are, in one pass over `fleet`.
    ///
    /// A fleet larger than the capacity would allocate; the controller never passes one.
    #[expect(clippy::cast_possible_truncation, reason = "a fleet has fewer than 2³² robots")]
    pub fn build<'a>(&mut self, fleet: impl IntoIterator<Item = &'a RobotState>) {
        self.free.clear();
        self.seen.clear();
        let (free, seen, places) = (&mut self.free, &mut self.seen, &mut self.places);
        let (x_m, y_m, who) = (&mut self.x_m, &mut self.y_m, &mut self.who);
        self.grid.take((0u32..).zip(fleet).filter_map(|(index, robot)| {
            if robot.has(state_flags::VACANT) {
                free.push(index);
                return None;
            }
            seen.push((robot.position_m(), Who { id: robot.id, index }));
            Some(robot.position_m())
        }));
        let robots = seen.len();
        x_m.resize(robots, 0.0);
        y_m.resize(robots, 0.0);
        who.resize(robots, Who::default());
        places.resize(robots + free.len(), 0);
        for index in free.iter() {
            places[*index as usize] = NO_PLACE;
        }
        let mut robots = seen.iter();
        self.grid.put(|place| {
            let Some(&(position_m, robot)) = robots.next() else { return };
            (x_m[place], y_m[place], who[place]) = (position_m.x, position_m.y, robot);
            places[robot.index as usize] = place as u32;
        });
        if !self.free.is_empty() {
            self.spread();
        }
    }

    /// Spreads the free places evenly, so that parts of equal length have equally many robots.
    fn spread(&mut self) {
        self.robots.clear();
        self.robots.extend(self.who.iter().map(|robot| robot.index));
        self.order.clear();
        let places = self.who.len() + self.free.len();
        let (mut robots, mut free, mut passed) = (self.who.iter(), self.free.iter().copied(), 0);
        self.order.extend((0..places).filter_map(|_| {
            passed += self.who.len();
            if passed >= places {
                passed -= places;
                robots.next().map(|robot| robot.index)
            } else {
                free.next()
            }
        }));
    }

    /// Indices of the robots by [`Nearby::place`].
    pub fn robots(&self) -> &[u32] {
        if self.free.is_empty() { self.grid.order() } else { &self.robots }
    }

    /// Indices of all places in the order of the ground: whose robots are near in it are near there. Free
    /// places are spread among them.
    pub fn order(&self) -> &[u32] {
        if self.free.is_empty() { self.grid.order() } else { &self.order }
    }
}

/// How far a robot looks.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sight {
    /// Within this, everybody is listed, m.
    pub all_m: f64,
    /// Within this, the nearest are listed, m.
    pub nearest_m: f64,
    /// How many of these at most, with those that are listed anyway.
    pub nearest: usize,
}

/// The robots near one robot.
#[derive(Debug, Clone)]
pub struct Neighbourhood {
    /// The first `listed` are the list, nearest first.
    list: Vec<Nearby>,
    listed: usize,
    /// Those within the distance looked at.
    found: Found,
}

/// What a place of a list holds before somebody does.
const NOBODY: Nearby = Nearby { distance_m: 0.0, id: 0, index: 0, place: NO_PLACE };

impl Neighbourhood {
    /// With room for a fleet of `robots`.
    pub fn with_capacity(robots: usize) -> Self {
        let list = vec![NOBODY; RANKED_MAX.max(robots + 1)];
        Self { list, listed: 0, found: Found::with_capacity(robots, RANKED_MAX) }
    }

    /// Lists the robots near robot `me`, as far as `sight` says.
    ///
    /// `first_m` is how far to look first: any number gives the same list, one near the distance of the
    /// last of the nearest is fastest.
    pub fn gather(
        &mut self,
        around: &Surroundings,
        fleet: &[RobotState],
        me: usize,
        sight: Sight,
        first_m: f64,
    ) -> &[Nearby] {
        let farthest_m = sight.all_m.max(sight.nearest_m);
        let look_m = first_m.max(sight.all_m);
        // What is not above 0, as with a radius that is none, would never grow.
        let mut look_m = if look_m > 0.0 { look_m.min(farthest_m) } else { farthest_m };
        let count = loop {
            let count = self.within(around, fleet, me, look_m);
            if count >= sight.nearest || look_m >= farthest_m {
                break count;
            }
            // As far as would do if they were everywhere as dense as here, and a little more.
            let wider = (1.4 * sight.nearest as f64 / (1 + count) as f64).sqrt();
            look_m = (look_m * wider.clamp(1.2, 2.0)).min(farthest_m);
        };
        self.sort(around);
        let beyond = self.list[..count].get(sight.nearest);
        self.listed = match beyond {
            None => count,
            Some(next) if next.distance_m > sight.all_m => sight.nearest,
            Some(_) => self.list[..count].partition_point(|n| n.distance_m <= sight.all_m),
        };
        self.list()
    }

    /// Lists one more robot, in its place, if it is within `range_m` of robot `me` and not listed yet.
    pub fn add(&mut self, fleet: &[RobotState], me: usize, index: usize, range_m: f64) {
        let distance_m = (fleet[index].position_m() - fleet[me].position_m()).norm_squared().sqrt();
        let new = Nearby { distance_m, id: fleet[index].id, index, place: NO_PLACE };
        if index == me || distance_m > range_m || self.list().iter().any(|n| n.index == index) {
            return;
        }
        let before = |n: &Nearby| n.distance_m.total_cmp(&distance_m).then(n.id.cmp(&new.id)).is_lt();
        let at = self.list().partition_point(before);
        self.list.copy_within(at..self.listed, at + 1);
        self.list[at] = new;
        self.listed += 1;
    }

    /// The robots that are listed, nearest first.
    pub fn list(&self) -> &[Nearby] {
        &self.list[..self.listed]
    }

    /// Finds the other robots within `range_m`, in any order; how many.
    fn within(&mut self, around: &Surroundings, fleet: &[RobotState], me: usize, range_m: f64) -> usize {
        let found = &mut self.found;
        let circle = Circle { centre_m: fleet[me].position_m(), radius_m: range_m, own: around.places[me] };
        found.look(&around.grid, circle, &around.x_m, &around.y_m);
        found.places().len()
    }

    /// Lists those found, nearest first.
    fn sort(&mut self, around: &Surroundings) {
        let near = |at: u32, distance_m: f64| {
            let (place, Who { id, index }) = (at, around.who[at as usize]);
            Nearby { distance_m, id, index: index as usize, place }
        };
        let (places, squares_m2) = (self.found.places(), self.found.squares_m2());
        let count = places.len();
        if count <= RANKED_MAX
            && let (Some(list), Some(squares_m2)) = (self.list.first_chunk_mut(), squares_m2.first_chunk())
        {
            let list: &mut [Nearby; RANKED_MAX] = list;
            let ranked = roots(squares_m2, count);
            let mut taken = 0u64;
            for (k, at) in places.iter().enumerate() {
                let rank = ranked.rank(k);
                list[rank % RANKED_MAX] = near(*at, ranked.numbers[k]);
                taken |= 1 << rank;
            }
            if taken.count_ones() as usize == count {
                return;
            }
            // Some are equally far, or nearly so.
        }
        let list = &mut self.list[..count];
        for (n, (at, squared_m2)) in list.iter_mut().zip(places.iter().zip(squares_m2)) {
            *n = near(*at, squared_m2.sqrt());
        }
        list.sort_unstable_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn at(id: u32, x_m: f64, y_m: f64) -> RobotState {
        RobotState { id, x_m, y_m, ..RobotState::default() }
    }

    fn gathered(fleet: &[RobotState], me: usize, sight: Sight, first_m: f64) -> Vec<Nearby> {
        let mut around = Surroundings::with_capacity(fleet.len(), 1.0);
        around.build(fleet);
        Neighbourhood::with_capacity(fleet.len()).gather(&around, fleet, me, sight, first_m).to_vec()
    }

    #[test]
    fn nearest_first_and_the_smaller_id_breaks_ties() {
        let fleet = [at(9, 1.0, 0.0), at(3, 0.0, 0.0), at(4, 0.0, 1.0), at(7, 0.5, 0.0), at(5, 30.0, 0.0)];
        let reach = Sight { all_m: 8.0, nearest_m: 8.0, nearest: 0 };
        let ids: Vec<u32> = gathered(&fleet, 1, reach, 0.0).iter().map(|n| n.id).collect();
        assert_eq!(ids, [7, 4, 9]);
        assert!(gathered(&fleet, 4, reach, 0.0).is_empty());
        // One more from farther away, once, in its place, and nobody who is too far or oneself.
        let mut around = Surroundings::with_capacity(fleet.len(), 1.0);
        around.build(&fleet);
        let mut near = Neighbourhood::with_capacity(fleet.len());
        near.gather(&around, &fleet, 1, Sight { all_m: 0.6, nearest_m: 0.6, nearest: 0 }, 0.0);
        for (index, range_m) in [(4, f64::INFINITY), (2, 1.0), (2, 1.0), (0, 0.9), (1, 9.0), (3, 9.0)] {
            near.add(&fleet, 1, index, range_m);
        }
        assert_eq!(near.list().iter().map(|n| n.id).collect::<Vec<_>>(), [7, 4, 5]);
        // A free place is nobody.
        let mut fleet = fleet;
        fleet[0] = RobotState::vacant();
        let ids: Vec<u32> = gathered(&fleet, 1, reach, 0.0).iter().map(|n| n.id).collect();
        assert_eq!(ids, [7, 4]);
    }

    #[test]
    fn looking_ends_wherever_it_begins() {
        let fleet = [at(9, 1.0, 0.0), at(3, 0.0, 0.0), at(4, 0.0, 1.0), at(5, 30.0, 0.0)];
        for all_m in [-7.0, f64::NEG_INFINITY, f64::NAN, 0.0, -0.0, 1e-300] {
            let reach = Sight { all_m, nearest_m: 8.0, nearest: 8 };
            for first_m in [0.0, -3.0, f64::NAN, 1e-300, 2.0, f64::INFINITY] {
                let ids: Vec<u32> = gathered(&fleet, 1, reach, first_m).iter().map(|n| n.id).collect();
                assert_eq!(ids, [4, 9], "{all_m} {first_m}");
            }
        }
    }

    #[test]
    fn free_places_are_in_no_cell_and_evenly_spread_in_the_order() {
        // Free places first, and all at the origin, where the robots are as well.
        let mut fleet = vec![RobotState::vacant(); 90];
        fleet.extend((0..10).map(|k| at(k, 0.01 * f64::from(k), 0.0)));
        let mut around = Surroundings::with_capacity(fleet.len(), 1.0);
        around.build(&fleet);
        assert_eq!((around.grid.order().len(), around.who.len()), (10, 10));
        let mut places = around.order().to_vec();
        for part in places.chunks(20) {
            assert_eq!(part.iter().filter(|index| **index >= 90).count(), 2, "{places:?}");
        }
        places.sort_unstable();
        assert!(places.into_iter().eq(0..100));
        let in_places = |around: &Surroundings| {
            (0..10u32).all(|place| around.places[around.robots()[place as usize] as usize] == place)
        };
        assert!(around.robots().len() == 10 && in_places(&around));
        let sight = Sight { all_m: 9.0, nearest_m: 9.0, nearest: 0 };
        assert_eq!(gathered(&fleet, 95, sight, 0.0).len(), 9);
        // Without free places it is the order of the cells.
        around.build(&fleet[90..]);
        assert_eq!(around.order(), around.grid.order());
        assert!(around.robots().len() == 10 && in_places(&around));
        around.build(&[RobotState::vacant(); 3]);
        assert_eq!(around.order(), [0, 1, 2]);
    }

    proptest! {
        /// What the cells give is what a look at the whole fleet gives: everybody within reach of the
        /// rows, and the nearest of the others.
        #[test]
        fn cells_give_what_brute_force_gives(
            // On a lattice, so that distances are often equal.
            places in prop::collection::vec((-12..12i32, -12..12i32, 1..4u32), 1..120),
            all_m in 0.0..4.0f64, nearest_m in 0.0..12.0f64, nearest in 0..20usize, first_m in 0.0..15.0f64,
        ) {
            let fleet: Vec<RobotState> = (0u32..).zip(&places)
                .map(|(k, (x, y, scale))| {
                    let half = 0.5 * f64::from(*scale);
                    at(7 * (k % 13) + k, f64::from(*x) * half, f64::from(*y) * half)
                })
                .collect();
            let reach = Sight { all_m, nearest_m, nearest };
            let mut around = Surroundings::with_capacity(fleet.len(), 1.0);
            around.build(&fleet);
            let place = |index: usize| around.places[index];
            for (me, own) in fleet.iter().enumerate() {
                let mut brute: Vec<Nearby> = fleet.iter().enumerate()
                    .filter(|(index, _)| *index != me)
                    .map(|(index, other)| Nearby {
                        distance_m: (other.position_m() - own.position_m()).norm(), id: other.id, index,
                        place: place(index),
                    })
                    .filter(|n| n.distance_m <= all_m.max(nearest_m))
                    .collect();
                brute.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m).then(a.id.cmp(&b.id)));
                let mut rank = 0;
                brute.retain(|n| { rank += 1; n.distance_m <= all_m || rank <= nearest });
                prop_assert_eq!(gathered(&fleet, me, reach, first_m), brute);
            }
        }
    }
}
