//! Where a robot will be, as everybody near it expects: turning to the heading that it published, holding it for
//! `hold_s`, then steering to its target.
//!
//! It depends on that robot alone, so it is worked out once a period, when somebody asks for it first; for those that
//! stand around it as well, which are asked for soon, side by side.

#![expect(clippy::inline_always, reason = "compiled for wider registers as a part of their caller")]
#![expect(clippy::needless_bitwise_bool, reason = "a branch in a lane keeps the loop scalar")]

use super::Params;
use super::direction::unit_single;
use super::lanes::{WIDTH, Wide, least, most, single};
use super::shown::Shown;
use super::types::{Limits, NEIGHBOURS_MAX, Neighbour};
use crate::geometry::wrap;

/// Steps of the prediction.
pub(super) const STEPS: usize = 16;

/// Positions at the ends of the steps, seen from where the robot is now, m.
#[derive(Debug, Clone, Copy)]
pub(super) struct Path {
    pub(super) x_m: [f32; STEPS],
    pub(super) y_m: [f32; STEPS],
}

/// The predictions of one period. Made once; neither allocates nor locks afterwards.
#[derive(Debug, Clone)]
pub struct Predictions {
    period: u32,
    /// The turn of a step, rad, and what was worked out for it: it seldom changes.
    turn: (f64, Turn),
    /// The period in which the paths of each row of places were worked out.
    known: Vec<u32>,
    /// By place in the order of the ground, then by lane for those that have none.
    paths: Vec<Path>,
}

impl Predictions {
    /// With room for a fleet of `robots`.
    pub fn for_robots(robots: usize) -> Self {
        let nowhere = Path { x_m: [0.0; STEPS], y_m: [0.0; STEPS] };
        let rows = robots.div_ceil(WIDTH);
        let turn = (0.0, Turn { cos: 1.0, sin: 0.0 });
        Self { period: 0, turn, known: vec![0; rows], paths: vec![nowhere; rows * WIDTH + NEIGHBOURS_MAX] }
    }

    /// Forgets the last period.
    pub fn begin(&mut self) {
        self.period = self.period.wrapping_add(1);
        if self.period == 0 {
            self.known.fill(0);
            self.period = 1;
        }
    }

    /// The largest turn in one step.
    pub(super) fn turn(&mut self, limits: &Limits, params: &Params) -> Turn {
        let turn_rad = limits.omega_max_radps * params.step_s;
        if turn_rad != self.turn.0 {
            self.turn = (turn_rad, Turn::new(turn_rad));
        }
        self.turn.1
    }

    /// Works out where the first `count` neighbours will be, as far as nobody has asked before.
    pub(super) fn learn(&mut self, neighbours: &Shown, count: usize, turn: Turn, params: &Params) {
        for lane in 0..count {
            let place = self.place(neighbours, lane);
            match self.known.get_mut(place / WIDTH) {
                Some(known) if *known == self.period => {}
                Some(known) => {
                    *known = self.period;
                    self.drive(place - place % WIDTH, neighbours.row(place / WIDTH), turn, params);
                }
                // Who has no place is another one each time.
                None => self.drive(place, std::iter::once(neighbours.who(lane)), turn, params),
            }
        }
    }

    /// Works out where these robots will be, which stand in the places from `first` on.
    fn drive(&mut self, first: usize, robots: impl Iterator<Item = Neighbour>, turn: Turn, params: &Params) {
        let mut row = Row::empty();
        robots.for_each(|n| row.push(&n, params));
        row.drive(turn, params, &mut self.paths[first..first + row.count]);
    }

    /// Where the neighbour of this lane will be, once it has been worked out.
    pub(super) fn of(&self, neighbours: &Shown, lane: usize) -> &Path {
        &self.paths[self.place(neighbours, lane)]
    }

    fn place(&self, neighbours: &Shown, lane: usize) -> usize {
        (neighbours.place(lane) as usize).min(self.known.len() * WIDTH + lane)
    }
}

/// Speed share for the cosine of the heading error.
pub(super) fn align(cos: f64, params: &Params) -> f64 {
    ((cos - params.align_cos) / (1.0 - params.align_cos)).clamp(0.0, 1.0)
}

/// The largest turn in one step.
#[derive(Debug, Clone, Copy)]
pub(super) struct Turn {
    pub(super) cos: f32,
    pub(super) sin: f32,
}

impl Turn {
    fn new(turn_rad: f64) -> Self {
        let (sin, cos) = libm::sincos(turn_rad);
        Self { cos: single(cos), sin: single(sin) }
    }

    /// `h` turned toward the unit vector `to` by at most one step.
    #[cfg(test)]
    pub(super) fn toward(self, (x, y): (f32, f32), (to_x, to_y): (f32, f32)) -> (f32, f32) {
        if x * to_x + y * to_y >= self.cos {
            return (to_x, to_y);
        }
        let sin = if x * to_y - y * to_x >= 0.0 { self.sin } else { -self.sin };
        (x * self.cos - y * sin, x * sin + y * self.cos)
    }
}

/// Positions of a row at the ends of the steps, each seen from where that robot is now, m.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Places {
    x_m: [Wide; STEPS],
    y_m: [Wide; STEPS],
}

/// Robots that are predicted side by side: each turns to its published heading, holds it, then goes to its target and
/// stays there.
struct Row {
    count: usize,
    heading_rad: Wide,
    published_rad: Wide,
    target_x_m: Wide,
    target_y_m: Wide,
    speed_mps: Wide,
}

impl Row {
    fn empty() -> Self {
        let none = [0.0; WIDTH];
        Self {
            count: 0,
            heading_rad: none,
            published_rad: none,
            target_x_m: none,
            target_y_m: none,
            speed_mps: none,
        }
    }

    fn push(&mut self, n: &Neighbour, params: &Params) {
        let lane = self.count;
        let to = n.intent.target_m - n.position_m;
        self.heading_rad[lane] = single(wrap(n.heading_rad));
        self.published_rad[lane] = single(wrap(n.intent.heading_rad));
        (self.target_x_m[lane], self.target_y_m[lane]) = (single(to.x), single(to.y));
        // One that has arrived stays.
        self.speed_mps[lane] =
            if n.arrived { 0.0 } else { single(n.intent.speed_mps.max(params.other_speed_min_mps)) };
        self.count += 1;
    }

    /// Takes the robots of the row through the horizon.
    fn drive(&self, turn: Turn, params: &Params, paths: &mut [Path]) {
        let mut places = Places { x_m: [[0.0; WIDTH]; STEPS], y_m: [[0.0; WIDTH]; STEPS] };
        self.steps(turn, params, &mut places);
        for (lane, path) in paths.iter_mut().enumerate() {
            for k in 0..STEPS {
                (path.x_m[k], path.y_m[k]) = (places.x_m[k][lane], places.y_m[k][lane]);
            }
        }
    }

    fn steps(&self, turn: Turn, params: &Params, places: &mut Places) {
        #[cfg(target_arch = "x86_64")]
        {
            if std::arch::is_x86_feature_detected!("avx512f")
                && std::arch::is_x86_feature_detected!("avx512vl")
            {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.steps_avx512(turn, params, places) };
            }
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                return unsafe { self.steps_avx2(turn, params, places) };
            }
        }
        self.steps_of_all(turn, params, places);
    }

    /// [`steps_of_all`](Self::steps_of_all) for wider registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx512f,avx512vl")]
    fn steps_avx512(&self, turn: Turn, params: &Params, places: &mut Places) {
        self.steps_of_all(turn, params, places);
    }

    /// [`steps_of_all`](Self::steps_of_all) for wide registers: the same operations, and so the same bits.
    #[cfg(target_arch = "x86_64")]
    #[target_feature(enable = "avx2")]
    fn steps_avx2(&self, turn: Turn, params: &Params, places: &mut Places) {
        self.steps_of_all(turn, params, places);
    }

    /// The positions at the ends of the steps, m.
    #[inline(always)]
    fn steps_of_all(&self, turn: Turn, params: &Params, places: &mut Places) {
        let (dt, hold_s) = (single(params.step_s), single(params.hold_s));
        let (align_cos, per_align) = (single(params.align_cos), single(1.0 / (1.0 - params.align_cos)));
        let (mut x, mut y, mut hx, mut hy) = ([0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH], [0.0; WIDTH]);
        let (mut published_x, mut published_y) = ([0.0; WIDTH], [0.0; WIDTH]);
        for lane in 0..WIDTH {
            (hx[lane], hy[lane]) = unit_single(self.heading_rad[lane]);
            (published_x[lane], published_y[lane]) = unit_single(self.published_rad[lane]);
        }
        let mut time = 0.0;
        for k in 0..STEPS {
            let hold = time < hold_s;
            for lane in 0..WIDTH {
                let (to_x, to_y) = (self.target_x_m[lane] - x[lane], self.target_y_m[lane] - y[lane]);
                let left = (to_x * to_x + to_y * to_y).sqrt();
                let steered = hold | (left < 1e-6);
                let per_m = 1.0 / left;
                let aim_x = if steered { published_x[lane] } else { to_x * per_m };
                let aim_y = if steered { published_y[lane] } else { to_y * per_m };
                let (hx0, hy0) = (hx[lane], hy[lane]);
                let near = hx0 * aim_x + hy0 * aim_y >= turn.cos;
                let sin = if hx0 * aim_y - hy0 * aim_x >= 0.0 { turn.sin } else { -turn.sin };
                let hx1 = if near { aim_x } else { hx0 * turn.cos - hy0 * sin };
                let hy1 = if near { aim_y } else { hx0 * sin + hy0 * turn.cos };
                (hx[lane], hy[lane]) = (hx1, hy1);
                let share = (hx1 * aim_x + hy1 * aim_y - align_cos) * per_align;
                let share = least(most(share, 0.0), 1.0);
                let travel = least(self.speed_mps[lane] * share * dt, left);
                x[lane] += hx1 * travel;
                y[lane] += hy1 * travel;
            }
            (places.x_m[k], places.y_m[k]) = (x, y);
            time += dt;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::Vec2;
    use crate::guidance::shown::with_all;
    use crate::guidance::types::Intent;
    use proptest::prelude::*;

    /// One robot by itself, as the rule says it.
    fn predict(n: &Neighbour, turn: Turn, params: &Params) -> Path {
        let mut path = Path { x_m: [0.0; STEPS], y_m: [0.0; STEPS] };
        if n.arrived {
            return path;
        }
        let both = |v: Vec2| (single(v.x), single(v.y));
        let (dt, hold_s) = (single(params.step_s), single(params.hold_s));
        let (target, published) =
            (both(n.intent.target_m - n.position_m), unit_single(single(wrap(n.intent.heading_rad))));
        let speed = single(n.intent.speed_mps.max(params.other_speed_min_mps));
        let (mut x, mut y, mut h, mut time) = (0.0, 0.0, unit_single(single(wrap(n.heading_rad))), 0.0);
        for k in 0..STEPS {
            let to = (target.0 - x, target.1 - y);
            let left = (to.0 * to.0 + to.1 * to.1).sqrt();
            let per_m = 1.0 / left;
            let aim = if time < hold_s || left < 1e-6 { published } else { (to.0 * per_m, to.1 * per_m) };
            h = turn.toward(h, aim);
            let share = (h.0 * aim.0 + h.1 * aim.1 - single(params.align_cos))
                * single(1.0 / (1.0 - params.align_cos));
            let travel = (speed * share.clamp(0.0, 1.0) * dt).min(left);
            (x, y) = (x + h.0 * travel, y + h.1 * travel);
            (path.x_m[k], path.y_m[k]) = (x, y);
            time += dt;
        }
        path
    }

    proptest! {
        /// Who is beside whom, and how wide the registers are, changes nothing.
        #[test]
        fn side_by_side_they_go_as_each_by_itself(
            robots in prop::collection::vec(
                ((-3.0..3.0f64, -3.0..3.0f64, -3.1..3.1f64), (-3.1..3.1f64, 0.0..5.0f64, -6.0..6.0f64), 0..8u32),
                1..=16,
            ),
        ) {
            let (limits, params) =
                (Limits { v_max_mps: 5.0, omega_max_radps: 1.0, period_s: 0.08 }, Params::default());
            let neighbours: Vec<Neighbour> = robots.iter().map(|robot| {
                let ((x, y, theta), (heading_rad, speed_mps, away), kind) = *robot;
                let position_m = Vec2::new(x, y);
                let target_m = if kind == 1 { position_m } else { Vec2::new(away, y + 0.5 * away) };
                let intent = Intent { heading_rad, speed_mps, target_m, ..Intent::default() };
                Neighbour { position_m, heading_rad: theta, arrived: kind == 0, intent, ..Neighbour::default() }
            }).collect();
            let mut predictions = Predictions::for_robots(neighbours.len());
            let turn = predictions.turn(&limits, &params);
            prop_assert_eq!(format!("{turn:?}"), format!("{:?}", Turn::new(1.0 * params.step_s)));
            // Some of them first: what is known stays.
            for placed in [true, false] {
                predictions.begin();
                with_all(Vec2::zeros(), 0.45, (&neighbours, placed), |shown| {
                    predictions.learn(shown, neighbours.len() / 2, turn, &params);
                    predictions.learn(shown, neighbours.len(), turn, &params);
                    for (lane, n) in neighbours.iter().enumerate() {
                        let path = format!("{:?}", predictions.of(shown, lane));
                        prop_assert_eq!(path, format!("{:?}", predict(n, turn, &params)));
                    }
                    Ok(())
                })?;
            }
            let mut row = Row::empty();
            for n in &neighbours {
                row.push(n, &params);
            }
            let mut all = Places { x_m: [[0.0; WIDTH]; STEPS], y_m: [[0.0; WIDTH]; STEPS] };
            let mut wide = all;
            row.steps_of_all(turn, &params, &mut all);
            row.steps(turn, &params, &mut wide);
            prop_assert_eq!(format!("{wide:?}"), format!("{all:?}"));
            #[cfg(target_arch = "x86_64")]
            if std::arch::is_x86_feature_detected!("avx2") {
                // SAFETY: the processor has what the function was compiled for.
                unsafe { row.steps_avx2(turn, &params, &mut wide) };
                prop_assert_eq!(format!("{wide:?}"), format!("{all:?}"));
            }
        }
    }
}
