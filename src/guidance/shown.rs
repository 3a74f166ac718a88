//! The robots that one robot is shown, and where they stand, side by side: most rules only have to see that nobody is
//! near enough for them. What else a robot shows is worked out for the few rules that ask.

use super::lanes::{WIDTH, Which, bits};
use super::types::{NEIGHBOURS_MAX, Neighbour, Seen};
use crate::geometry::Vec2;
#[cfg(test)]
use crate::neighbours::NO_PLACE;
use crate::neighbours::Nearby;

/// Share by which a distance is enlarged so that rounding cannot lose a neighbour.
const ROUNDING: f64 = 1e-9;

/// One number for each neighbour.
pub(super) type Lanes = [f64; NEIGHBOURS_MAX];

/// Room for those that one robot is shown.
#[derive(Debug, Clone, Default)]
pub struct Listed {
    count: usize,
    /// Index in the fleet, and place in [`Predictions`](super::Predictions).
    index: [usize; NEIGHBOURS_MAX],
    place: [u32; NEIGHBOURS_MAX],
    /// From each of them to the robot, m; infinitely far where there is none.
    pub(super) x_m: Lanes,
    pub(super) y_m: Lanes,
    pub(super) distance_m: Lanes,
    /// From each of them to its target, m.
    pub(super) to_x_m: Lanes,
    pub(super) to_y_m: Lanes,
    /// Centre distance to keep, m.
    pub(super) required_m: Lanes,
    /// How long those that have not arrived have been without progress, s.
    blocked_s: Lanes,
    /// Those that have arrived, as bits.
    parked: u32,
}

/// The robots that one robot is shown, nearest first.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    listed: &'a Listed,
    /// Indices of the robots in the order of the ground.
    ground: &'a [u32],
    show: &'a dyn Fn(usize) -> Neighbour,
}

impl Listed {
    /// Lists the first of `near` for a robot at `here`, nearest first; `ground` are the indices of all robots by place.
    /// `show` says what the robot of an index shows, `required_m` the distance to keep from one of this radius.
    #[inline]
    pub fn list<'a>(
        &'a mut self,
        here: Vec2,
        (near, ground): (&[Nearby], &'a [u32]),
        show: &'a impl Fn(usize) -> Neighbour,
        required_m: impl Fn(f64) -> f64,
    ) -> Shown<'a> {
        let near = &near[..near.len().min(NEIGHBOURS_MAX)];
        self.parked = 0;
        for (lane, near) in near.iter().enumerate() {
            // Taken apart at once, so that what no lane holds is not worked out.
            let n = show(near.index);
            (self.index[lane], self.place[lane]) = (near.index, near.place);
            (self.x_m[lane], self.y_m[lane]) = (here.x - n.position_m.x, here.y - n.position_m.y);
            let to = n.target_m - n.position_m;
            (self.to_x_m[lane], self.to_y_m[lane]) = (to.x, to.y);
            (self.distance_m[lane], self.required_m[lane]) = (near.distance_m, required_m(n.radius_m));
            self.blocked_s[lane] = if n.arrived { f64::NEG_INFINITY } else { n.intent.blocked_s };
            self.parked |= u32::from(n.arrived) << lane;
        }
        self.count = near.len();
        for lane in near.len()..NEIGHBOURS_MAX {
            (self.x_m[lane], self.y_m[lane]) = (f64::INFINITY, f64::INFINITY);
            (self.distance_m[lane], self.required_m[lane]) = (f64::INFINITY, 0.0);
            self.blocked_s[lane] = f64::NEG_INFINITY;
        }
        Shown { listed: self, ground, show }
    }
}

impl<'a> Shown<'a> {
    /// How many are listed.
    pub(super) fn len(&self) -> usize {
        self.listed.count
    }

    /// What the one of this lane shows.
    pub(super) fn who(&self, lane: usize) -> Neighbour {
        (self.show)(self.listed.index[lane])
    }

    /// The one of this lane.
    #[inline]
    pub(super) fn at(&self, lane: usize) -> Seen {
        let listed = self.listed;
        Seen {
            lane,
            apart_m: Vec2::new(listed.x_m[lane], listed.y_m[lane]),
            distance_m: listed.distance_m[lane],
            required_m: listed.required_m[lane],
        }
    }

    /// Those listed, nearest first.
    #[inline]
    pub(super) fn iter(&self) -> impl Iterator<Item = Seen> + use<'a> {
        let shown = *self;
        (0..shown.listed.count).map(move |lane| shown.at(lane))
    }

    /// Place of the one of this lane in the order of the ground.
    #[inline]
    pub(super) fn place(&self, lane: usize) -> u32 {
        self.listed.place[lane]
    }

    /// What those show that stand in this row of places.
    pub(super) fn row(&self, row: usize) -> impl Iterator<Item = Neighbour> {
        let first = (row * WIDTH).min(self.ground.len());
        let places = &self.ground[first..self.ground.len().min(first + WIDTH)];
        places.iter().map(|index| (self.show)(*index as usize))
    }

    /// From the one of this lane to its target, m.
    #[inline]
    pub(super) fn towards_target(&self, lane: usize) -> Vec2 {
        Vec2::new(self.listed.to_x_m[lane], self.listed.to_y_m[lane])
    }

    /// Whether the one of this lane has arrived.
    #[inline]
    pub(super) fn is_parked(&self, lane: usize) -> bool {
        (self.listed.parked >> lane) & 1 == 1
    }

    /// Numbers of all of them side by side.
    #[inline]
    pub(super) fn lanes(&self) -> &'a Listed {
        self.listed
    }

    /// Those that have not arrived.
    #[inline]
    pub(super) fn driving(&self) -> Which {
        Which(((1 << self.listed.count) - 1) & !self.listed.parked)
    }

    /// Those that have arrived.
    #[inline]
    pub(super) fn parked(&self) -> Which {
        Which(self.listed.parked)
    }

    /// Those that have not arrived and have been without progress for `wait_s`.
    #[inline]
    pub(super) fn waiting(&self, wait_s: f64) -> Which {
        which(|lane| self.listed.blocked_s[lane] >= wait_s)
    }

    /// Those nearer than `beyond_m` beyond the distance to keep, and maybe one that is not.
    #[inline]
    pub(super) fn within(&self, beyond_m: f64) -> Which {
        let Listed { distance_m, required_m, .. } = self.listed;
        which(|lane| distance_m[lane] <= (required_m[lane] + beyond_m) * (1.0 + ROUNDING))
    }
}

/// The lanes of which `holds` is true.
#[inline]
fn which(holds: impl Fn(usize) -> bool) -> Which {
    Which(bits(std::array::from_fn(holds)))
}

/// Gives `look` these neighbours, with places or without, listed for a robot at `here` that keeps `required_m` from each.
#[cfg(test)]
pub(super) fn with_all<T>(
    here: Vec2,
    required_m: f64,
    (neighbours, placed): (&[Neighbour], bool),
    look: impl FnOnce(&Shown) -> T,
) -> T {
    let near = (0..).zip(neighbours).map(|(place, n)| {
        let distance_m = (n.position_m - here).norm();
        Nearby { distance_m, id: n.id, index: place as usize, place: if placed { place } else { NO_PLACE } }
    });
    let (near, mut listed) = (near.collect::<Vec<_>>(), Listed::default());
    let ground: Vec<u32> = (0..).take(near.len()).collect();
    look(&listed.list(here, (&near, &ground), &|index: usize| neighbours[index], |_| required_m))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::guidance::types::Intent;
    use proptest::prelude::*;

    proptest! {
        /// The lanes say what is said of each by itself, and nothing is left of who was listed before.
        #[test]
        fn the_lanes_say_what_each_shows(
            robots in prop::collection::vec(
                ((-3.0..3.0f64, -3.0..3.0f64, 0.1..0.5f64), (-3.0..3.0f64, -3.0..3.0f64), any::<bool>(), 0.0..3.0f64),
                1..40,
            ),
            lists in prop::collection::vec((prop::collection::vec(0..40usize, 0..20), 0.1..0.5f64), 1..12),
            beyond_m in 0.0..2.0f64, wait_s in 0.0..3.0f64,
        ) {
            let show = |index: usize| {
                let ((x, y, radius_m), (target_x, target_y), arrived, blocked_s) = robots[index];
                let (position_m, target_m) = (Vec2::new(x, y), Vec2::new(target_x, target_y));
                let intent = Intent { blocked_s, ..Intent::default() };
                Neighbour { position_m, target_m, radius_m, arrived, intent, ..Neighbour::default() }
            };
            let ground: Vec<u32> = (0..robots.len()).rev().map(|index| u32::try_from(index).unwrap()).collect();
            let mut listed = Listed::default();
            for (near, own_m) in &lists {
                let here = Vec2::new(*own_m, -own_m);
                let mut near: Vec<Nearby> = near.iter().map(|index| {
                    let index = index % robots.len();
                    let distance_m = (here - show(index).position_m).norm();
                    Nearby { distance_m, id: 0, index, place: u32::try_from(2 * index).unwrap() }
                }).collect();
                near.sort_by(|a, b| a.distance_m.total_cmp(&b.distance_m));
                let shown = listed.list(here, (&near, &ground), &show, |radius_m| own_m + radius_m);
                near.truncate(NEIGHBOURS_MAX);
                let all: Vec<Neighbour> = (0..3).flat_map(|row| shown.row(row)).collect();
                prop_assert_eq!(all, (0..robots.len()).rev().map(show).collect::<Vec<_>>());
                prop_assert_eq!((shown.len(), shown.iter().count()), (near.len(), near.len()));
                for (lane, (seen, near)) in shown.iter().zip(&near).enumerate() {
                    let who = show(near.index);
                    prop_assert_eq!((shown.who(lane), shown.place(lane)), (who, near.place));
                    prop_assert_eq!((seen.lane, seen.apart_m), (lane, here - who.position_m));
                    prop_assert_eq!((seen.distance_m, seen.required_m), (near.distance_m, own_m + who.radius_m));
                    prop_assert_eq!(shown.towards_target(lane), who.target_m - who.position_m);
                    prop_assert_eq!(shown.is_parked(lane), who.arrived);
                }
                let lanes = |holds: &dyn Fn(&Seen, &Neighbour) -> bool| -> Vec<usize> {
                    let all = shown.iter().filter(|n| holds(n, &shown.who(n.lane)));
                    all.map(|n| n.lane).collect()
                };
                prop_assert_eq!(shown.parked().collect::<Vec<_>>(), lanes(&|_, who| who.arrived));
                prop_assert_eq!(shown.driving().collect::<Vec<_>>(), lanes(&|_, who| !who.arrived));
                prop_assert_eq!(
                    shown.waiting(wait_s).collect::<Vec<_>>(),
                    lanes(&|_, who| !who.arrived && who.intent.blocked_s >= wait_s)
                );
                let within: Vec<usize> = shown.within(beyond_m).collect();
                let near_enough = lanes(&|n, _| n.distance_m <= n.required_m + beyond_m);
                prop_assert!(near_enough.iter().all(|lane| within.contains(lane)));
                let near = |lane: usize| shown.at(lane).bearing().gap_m <= beyond_m + 1e-6;
                prop_assert!(within.iter().all(|lane| *lane < shown.len() && near(*lane)));
            }
        }
    }
}
