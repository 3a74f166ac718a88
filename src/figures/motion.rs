//! How close robots come to each other and to obstacles while they move.

use super::{Accumulator, VIOLATION_M};
use crate::geometry::{Arc, Grid, Pose, Vec2, closest_point_on_segment, min_distance_arcs};
use std::ops::Range;

/// A robot, or a free place, as far as clearance asks.
#[derive(Debug, Clone, Copy)]
pub(super) struct Body {
    pub(super) radius_m: f64,
    /// Somebody is there.
    pub(super) present: bool,
    /// Takes no commands.
    pub(super) foreign: bool,
}

/// A robot and its motion.
#[derive(Debug, Clone, Copy)]
struct Seat {
    index: u32,
    body: Body,
    start: Pose,
    v_mps: f64,
    /// How far the arc can leave its chord, m.
    bend_m: f64,
}

impl Seat {
    fn new(index: u32, body: Body, arc: &Arc, horizon_s: f64) -> Self {
        Self {
            index,
            body,
            start: arc.start,
            v_mps: arc.v_mps,
            bend_m: 0.5 * (arc.v_mps * arc.omega_radps).abs() * horizon_s * horizon_s,
        }
    }

    /// Whether the distance of the two matters.
    fn counts(&self, other: &Self) -> bool {
        let (a, b) = (self.body, other.body);
        a.present && b.present && !(a.foreign && b.foreign)
    }

    fn required_m(&self, other: &Self, margin_m: f64) -> f64 {
        margin_m + self.body.radius_m + other.body.radius_m
    }

    /// Whether all the time more than `more_m` is left between the two beyond what is required: they cannot drive
    /// as far as that, or would not on straight lines, by more than arcs can leave them.
    fn stays_away(&self, other: &Self, required_m: f64, more_m: f64, horizon_s: f64) -> bool {
        let from = self.start.position_m - other.start.position_m;
        let reach_m = (self.v_mps.abs() + other.v_mps.abs()) * horizon_s;
        if from.norm() - required_m - reach_m > more_m {
            return true;
        }
        let change = (self.start.heading() * self.v_mps - other.start.heading() * other.v_mps) * horizon_s;
        let straight_m = closest_point_on_segment(Vec2::zeros(), from, from + change).norm();
        // Less a little, so that rounding cannot make it too large.
        straight_m - self.bend_m - other.bend_m - 1e-9 - required_m > more_m
    }
}

/// Memory for the motion of one period.
#[derive(Debug, Clone)]
pub(super) struct Motion {
    grid: Grid,
    /// In the order of the grid, so that neighbours are near in memory too.
    seats: Vec<Seat>,
    /// Seats of pairs that could lower the minimum or be violated.
    pairs: Vec<(usize, usize)>,
}

impl Motion {
    /// For as many robots, sorted into cells of `cell_m` metres.
    pub(super) fn with_room(robots: usize, cell_m: f64) -> Self {
        let grid = Grid::with_capacity(robots, cell_m);
        Self { grid, seats: Vec::with_capacity(robots), pairs: Vec::with_capacity(robots) }
    }

    /// Sorts the fleet by place.
    fn sort(&mut self, bodies: &[Body], arcs: &[Arc], horizon_s: f64) {
        self.grid.build(arcs.iter().map(|arc| arc.start.position_m));
        self.seats.clear();
        self.seats.extend(self.grid.order().iter().map(|index| {
            let robot = *index as usize;
            Seat::new(*index, bodies[robot], &arcs[robot], horizon_s)
        }));
    }

    /// The distance within which a pair can lower the minimum or be violated, and what is left to come closer
    /// than, m, for a minimum of `smallest_m` until now. No robot's radius is larger than `largest_m`.
    fn near_m(&self, margin_m: f64, largest_m: f64, smallest_m: f64, horizon_s: f64) -> (f64, f64) {
        let fastest_mps = self.seats.iter().map(|seat| seat.v_mps.abs()).fold(0.0, f64::max);
        // Some pairs that are likely to be near: no minimum is larger than any of theirs, and many have come near
        // at once where it is much smaller.
        let some = self.seats.windows(2).filter_map(|pair| {
            let (a, b) = (&pair[0], &pair[1]);
            let apart_m = (a.start.position_m - b.start.position_m).norm();
            a.counts(b).then(|| apart_m - a.required_m(b, margin_m))
        });
        let smallest_m = some.fold(smallest_m, f64::min).max(0.0);
        (margin_m + 2.0 * (largest_m + fastest_mps * horizon_s) + smallest_m, smallest_m)
    }

    /// Lists the pairs within `near_m` that can come closer than `smallest_m` beyond what is required: by the robot
    /// that comes later in the fleet, and for each in the order of the grid.
    fn list(&mut self, margin_m: f64, near_m: f64, smallest_m: f64, horizon_s: f64) {
        let Self { grid, seats, pairs } = self;
        pairs.clear();
        // Rounding must not lose the pair that is just as far.
        let near_m = near_m * (1.0 + 1e-12);
        let far_m2 = near_m * near_m;
        for (a, own) in seats.iter().enumerate().filter(|(_, own)| own.body.present) {
            grid.near(own.start.position_m, near_m, |range| {
                for (b, other) in range.clone().zip(&seats[range]) {
                    // What is most often so comes first.
                    if (own.start.position_m - other.start.position_m).norm_squared() <= far_m2
                        && other.index < own.index
                        && own.counts(other)
                        && !own.stays_away(other, own.required_m(other, margin_m), smallest_m, horizon_s)
                    {
                        pairs.push((a, b));
                    }
                }
            });
        }
        pairs.sort_by_key(|(a, _)| seats[*a].index);
    }
}

impl Accumulator {
    /// Adds the motion along `arcs`, one for each robot in the scenario's order, over `horizon_s`.
    pub fn observe_motion(&mut self, arcs: &[Arc], horizon_s: f64) {
        let arcs = &arcs[..arcs.len().min(self.bodies.len())];
        let margin_m = self.limits.safety_margin_m;
        let largest_m = self.bodies.iter().map(|body| body.radius_m).fold(0.0, f64::max);
        self.motion.sort(&self.bodies, arcs, horizon_s);
        let (near_m, more_m) = self.motion.near_m(margin_m, largest_m, self.min_clearance_m, horizon_s);
        self.motion.list(margin_m, near_m, more_m, horizon_s);
        let mut passed = 0;
        for pair in 0..self.motion.pairs.len() {
            let (a, b) = self.motion.pairs[pair];
            let (own, other) = (self.motion.seats[a], self.motion.seats[b]);
            let (i, j) = (own.index as usize, other.index as usize);
            self.obstacles_of(passed..i, arcs, horizon_s);
            passed = i;
            let required_m = own.required_m(&other, margin_m);
            // The minimum may have fallen since.
            if !own.stays_away(&other, required_m, self.min_clearance_m.max(0.0), horizon_s) {
                self.note((i, j), min_distance_arcs(&arcs[i], &arcs[j], horizon_s).upper_m - required_m);
            }
        }
        self.obstacles_of(passed..arcs.len(), arcs, horizon_s);
    }

    fn obstacles_of(&mut self, robots: Range<usize>, arcs: &[Arc], horizon_s: f64) {
        if self.obstacles.is_empty() {
            return;
        }
        for i in robots {
            let (arc, body) = (&arcs[i], self.bodies[i]);
            if !body.present {
                continue;
            }
            for k in 0..self.obstacles.len() {
                let obstacle = self.obstacles[k];
                let required = self.limits.safety_margin_m + body.radius_m + obstacle.reach_m();
                let apart = obstacle.core_distance(arc.start.position_m) - required;
                if apart - arc.v_mps.abs() * horizon_s > self.min_clearance_m.max(0.0) {
                    continue;
                }
                let clearance = obstacle.min_core_distance(arc, horizon_s).upper_m - required;
                self.note((i, self.bodies.len() + k), clearance);
            }
        }
    }

    fn note(&mut self, pair: (usize, usize), clearance_m: f64) {
        self.min_clearance_m = self.min_clearance_m.min(clearance_m);
        if clearance_m < VIOLATION_M {
            self.violated.insert(pair);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;
    use crate::wire::{RobotState, state_flags};

    /// After a minimum of hundreds of metres the whole fleet stands close: few pairs are looked at even so.
    #[test]
    fn a_fleet_that_comes_together_at_once_lists_few_pairs() {
        let scenario = Scenario::builtin("circle-200").unwrap();
        let mut figures = Accumulator::new(&scenario, 0.08);
        let mut fleet: Vec<RobotState> = scenario.robots.iter().map(RobotState::at_start).collect();
        for (tick, spacing_m) in [(0, 500.0), (1, 1.0)] {
            for (n, state) in fleet.iter_mut().enumerate() {
                (state.x_m, state.y_m) = (spacing_m * (n % 15) as f64, spacing_m * (n / 15) as f64);
                state.flags |= state_flags::VALID;
            }
            figures.observe_period(tick, &fleet);
        }
        assert!(figures.min_clearance_m() < 1.0);
        let listed = figures.motion.pairs.len();
        assert!(listed < 4 * fleet.len(), "{listed} pairs of {} robots", fleet.len());
    }

    /// Robots that drive anywhere, some of them foreign, one place free; several periods.
    #[test]
    fn the_minimum_and_the_violations_are_those_of_all_pairs() {
        let mut random = 1_u64;
        let mut next = |from: f64, to: f64| {
            random = random.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
            from + (to - from) * (random >> 11) as f64 / (1_u64 << 53) as f64
        };
        let scenario = Scenario::builtin("circle-50").unwrap();
        let margin_m = scenario.limits.safety_margin_m;
        for (spread_m, speed_mps) in [(300.0, 5.0), (60.0, 0.0), (25.0, 5.0), (8.0, 1.0), (2.0, 5.0)] {
            let mut figures = Accumulator::new(&scenario, 0.08);
            let mut fleet: Vec<RobotState> = scenario.robots.iter().map(RobotState::at_start).collect();
            let (mut smallest_m, mut violated) = (f64::INFINITY, std::collections::BTreeSet::new());
            for tick in 0..6 {
                for (n, state) in fleet.iter_mut().enumerate() {
                    (state.x_m, state.y_m) = (next(-spread_m, spread_m), next(-spread_m, spread_m));
                    state.theta_rad = next(-3.1, 3.1);
                    (state.v_mps, state.omega_radps) = (next(0.0, 1.0) * speed_mps, next(-1.0, 1.0));
                    state.radius_m = next(0.1, 0.4);
                    state.flags = [state_flags::VALID, state_flags::FOREIGN][usize::from(n % 9 == 4)];
                    state.flags |= if n == 7 { state_flags::VACANT } else { 0 };
                }
                figures.observe_period(tick, &fleet);
                let bodies = &figures.bodies;
                for (i, j) in (0..fleet.len()).flat_map(|i| (0..i).map(move |j| (i, j))) {
                    let (a, b) = (bodies[i], bodies[j]);
                    if a.present && b.present && !(a.foreign && b.foreign) {
                        let required_m = margin_m + a.radius_m + b.radius_m;
                        let apart = min_distance_arcs(&fleet[i].arc(), &fleet[j].arc(), 0.08);
                        let clearance_m = apart.upper_m - required_m;
                        smallest_m = smallest_m.min(clearance_m);
                        if clearance_m < VIOLATION_M {
                            violated.insert((i, j));
                        }
                    }
                }
                assert_eq!(figures.min_clearance_m().to_bits(), smallest_m.to_bits(), "{spread_m} {tick}");
                assert_eq!(figures.violated, violated, "{spread_m} {tick}");
            }
            assert!(violated.is_empty() == (spread_m > 100.0), "{spread_m}: {}", violated.len());
        }
    }
}
