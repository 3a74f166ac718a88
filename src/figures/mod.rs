//! The figures of merit of a run, from its states and telemetry.
//!
//! Used by the evaluation, by the daemon's report and by tests. Reads one fleet state a period, whose
//! commands in force make it the motion over that period, and writes [`ControlFigures`]. Clearance is
//! the minimum over **continuous** time and all pairs, from the exact arcs, or from the straight lines of
//! a plant that moves by Euler steps. Nothing allocates after
//! [`Accumulator::new`] but the list of violations, and that of pairs that could lower the minimum where these
//! are more than robots; a period costs one distance for every pair that is near and one exact minimum for every
//! pair that could lower the minimum.

mod clearances;
mod latency;
mod motion;

pub use clearances::Clearances;
pub use latency::{LatencyHistogram, LatencyNs};

use crate::geometry::{Arc, Integration, Pose, Vec2, bearing, wrap};
use crate::model::{Limits, Obstacle, RobotSpec};
use crate::scenario::Scenario;
use crate::wire::{RobotState, RobotTelemetry, SolveStatus, state_flags};
use motion::{Body, Motion};
use serde::Serialize;
use std::collections::BTreeSet;

/// A pair closer than this below its required distance counts as violated, m.
pub const VIOLATION_M: f64 = -1e-9;

/// A robot stalls when for this long, s, it neither moved nor turned by more than the two below, away
/// from its goal.
const STALL_S: f64 = 1.0;
const STALL_MOVE_M: f64 = 0.01;
const STALL_TURN_RAD: f64 = 0.1;

/// Slack above this share of the decrease asked for counts as active.
const SLACK_ACTIVE: f64 = 1e-6;

/// The figures of one run that do not depend on the machine's speed.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ControlFigures {
    /// Robots of the fleet that take commands.
    pub robots: usize,
    /// Robots that were inside the tolerance at the end.
    pub arrived: usize,
    /// Robots that at some time stood still for a second away from their goal.
    pub stalled: usize,
    /// Pairs, of robots or of a robot and an obstacle, that came closer than they may.
    pub violations: usize,
    /// Minimum over continuous time and all pairs of the distance beyond the required one, m; null
    /// when there is no pair.
    pub min_clearance_m: Option<f64>,
    /// Periods of the run.
    pub steps: u64,
    /// Last arrival, s; null if a robot did not arrive.
    pub makespan_s: Option<f64>,
    /// Mean arrival of those that arrived, s; null if none did.
    pub mean_arrival_s: Option<f64>,
    /// Mean over the robots that had to move and arrived of arrival time / (straight-line distance /
    /// v_max); null if there is none.
    pub arrival_ratio: Option<f64>,
    /// The same with the time for the first turn on the spot towards the goal taken off.
    pub arrival_ratio_after_turn: Option<f64>,
    /// The same mean of the length driven / straight-line distance.
    pub path_ratio: Option<f64>,
    /// Mean over the robots of ∫|dω|, rad/s (the variation of the turn rate).
    pub omega_variation_rad: f64,
    /// Share of the solved programmes whose position certificate needed its slack.
    pub slack_active_fraction: f64,
}

/// One robot's running sums.
#[derive(Debug, Clone, Copy)]
struct Track {
    /// Id of the robot; `None`: a free place.
    id: Option<u32>,
    /// Where and when its way to the present goal began.
    start_m: Vec2,
    since_s: f64,
    /// Time for turning on the spot from the first heading towards the first goal, s.
    first_turn_s: f64,
    goal_m: Vec2,
    radius_m: f64,
    /// Takes no commands: only the clearance to it counts.
    foreign: bool,
    /// Time of the last entry into the tolerance, s; `None` outside.
    arrived_s: Option<f64>,
    driven_m: f64,
    omega_radps: f64,
    omega_variation: f64,
    /// Where and when it last made progress.
    progress: (Pose, f64),
    stalled: bool,
}

/// Nobody who starts with another heading can do without this turn, s.
fn first_turn_s(start: Pose, goal_m: Vec2, limits: &Limits) -> f64 {
    let way = goal_m - start.position_m;
    let error_rad = wrap(bearing(way) - start.theta_rad);
    let rate = if error_rad >= 0.0 { limits.omega_max_radps } else { -limits.omega_min_radps };
    if way.norm() > 0.0 && rate > 0.0 { error_rad.abs() / rate } else { 0.0 }
}

impl Track {
    /// Nobody.
    const VACANT: Self = Self {
        id: None,
        start_m: Vec2::new(0.0, 0.0),
        since_s: 0.0,
        first_turn_s: 0.0,
        goal_m: Vec2::new(0.0, 0.0),
        radius_m: 0.0,
        foreign: false,
        arrived_s: None,
        driven_m: 0.0,
        omega_radps: 0.0,
        omega_variation: 0.0,
        progress: (Pose { position_m: Vec2::new(0.0, 0.0), theta_rad: 0.0 }, 0.0),
        stalled: false,
    };

    /// A robot that begins its way to its goal.
    fn new(state: &RobotState, now_s: f64, limits: &Limits) -> Self {
        let (pose, goal_m) = (state.pose(), state.goal_m());
        Self {
            id: Some(state.id),
            start_m: pose.position_m,
            since_s: now_s,
            first_turn_s: first_turn_s(pose, goal_m, limits),
            goal_m,
            radius_m: state.radius_m,
            foreign: state.has(state_flags::FOREIGN),
            progress: (pose, now_s),
            ..Self::VACANT
        }
    }

    /// Takes in who stands here and where it is to go; whether anybody does. With a new goal a new way
    /// begins.
    fn follow(&mut self, state: &RobotState, now_s: f64, limits: &Limits) -> bool {
        if state.has(state_flags::VACANT) {
            *self = Self::VACANT;
        } else if self.id != Some(state.id) {
            *self = Self::new(state, now_s, limits);
        } else if self.goal_m != state.goal_m() {
            let before = *self;
            *self = Self::new(state, now_s, limits);
            (self.omega_radps, self.omega_variation) = (before.omega_radps, before.omega_variation);
            self.stalled = before.stalled;
        }
        self.id.is_some()
    }

    /// Whether it is a robot that takes commands.
    fn is_ours(&self) -> bool {
        self.id.is_some() && !self.foreign
    }

    /// What of it counts for clearance.
    fn body(&self) -> Body {
        Body { radius_m: self.radius_m, present: self.id.is_some(), foreign: self.foreign }
    }

    fn stall(&mut self, pose: Pose, now_s: f64) {
        let (last, since_s) = self.progress;
        let moved = (pose.position_m - last.position_m).norm() > STALL_MOVE_M;
        let turned = wrap(pose.theta_rad - last.theta_rad).abs() > STALL_TURN_RAD;
        if moved || turned || self.arrived_s.is_some() {
            self.progress = (pose, now_s);
        } else if now_s - since_s >= STALL_S {
            self.stalled = true;
        }
    }
}

/// A robot's way, and its arrival.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Arrival {
    /// Straight line from its start to its goal, m.
    pub distance_m: f64,
    /// Time for turning on the spot towards the goal at the start, s.
    pub first_turn_s: f64,
    /// When it entered the tolerance for good, s; `None`: it did not.
    pub arrived_s: Option<f64>,
}

/// Collects a run's figures.
#[derive(Debug, Clone)]
pub struct Accumulator {
    period_s: f64,
    plant: Integration,
    tolerance_m: f64,
    limits: Limits,
    obstacles: Vec<Obstacle>,
    tracks: Vec<Track>,
    /// Robots of ours, and those of them that are inside the tolerance.
    present: usize,
    arrived: usize,
    /// Room for the motion of one period.
    arcs: Vec<Arc>,
    /// What of `tracks` counts for clearance.
    bodies: Vec<Body>,
    motion: Motion,
    /// Pairs of robots, and of robots and obstacles (numbered after the robots).
    violated: BTreeSet<(usize, usize)>,
    min_clearance_m: f64,
    steps: u64,
    solved: u64,
    slack_active: u64,
}

impl Accumulator {
    /// An empty collection for `scenario` at a period of `period_s` seconds.
    pub fn new(scenario: &Scenario, period_s: f64) -> Self {
        Self::with_places(scenario, scenario.robots.len(), period_s)
    }

    /// The same with room for robots that are added during the run.
    pub fn with_places(scenario: &Scenario, places: usize, period_s: f64) -> Self {
        let n = places.max(scenario.robots.len());
        let track = |spec: &RobotSpec| Track::new(&RobotState::at_start(spec), 0.0, &scenario.limits);
        let mut tracks: Vec<Track> = scenario.robots.iter().map(track).collect();
        tracks.resize(n, Track::VACANT);
        let bodies = tracks.iter().map(Track::body).collect();
        let largest_m = scenario.robots.iter().map(|r| r.radius_m).fold(0.0, f64::max);
        let limits = scenario.limits;
        let cell_m = limits.safety_margin_m + 2.0 * largest_m + 2.0 * limits.speed_mps() * period_s;
        Self {
            period_s,
            plant: Integration::Exact,
            tolerance_m: scenario.tolerance_m,
            limits: scenario.limits,
            obstacles: scenario.obstacles.clone(),
            present: tracks.iter().filter(|track| track.is_ours()).count(),
            arrived: 0,
            tracks,
            arcs: Vec::with_capacity(n),
            bodies,
            motion: Motion::with_room(n, cell_m),
            violated: BTreeSet::new(),
            min_clearance_m: f64::INFINITY,
            steps: 0,
            solved: 0,
            slack_active: 0,
        }
    }

    /// Measures clearance along the ways of robots that are moved by `plant`.
    #[must_use]
    pub fn on_plant(self, plant: Integration) -> Self {
        Self { plant, ..self }
    }

    /// Adds the period that starts at `tick` with `fleet` and its commands in force.
    ///
    /// Ticks may have gaps: time is counted from tick 0. `fleet` has a record for each place, in the
    /// scenario's order. A robot that gets a new goal begins anew: arrival times and ratios are those of
    /// the last goal.
    pub fn observe_period(&mut self, tick: u64, fleet: &[RobotState]) {
        let (mut arcs, plant) = (std::mem::take(&mut self.arcs), self.plant);
        arcs.clear();
        self.progress_of(tick, fleet, |robot| arcs.push(plant.path(&robot.arc())));
        self.observe_motion(&arcs, self.period_s);
        self.arcs = arcs;
    }

    /// Adds where the robots are at `tick` and what they are told, without the motion.
    pub fn observe_progress(&mut self, tick: u64, fleet: &[RobotState]) {
        self.progress_of(tick, fleet, |_| {});
    }

    /// The same; shows `each` of them.
    fn progress_of(&mut self, tick: u64, fleet: &[RobotState], mut each: impl FnMut(&RobotState)) {
        let now_s = tick as f64 * self.period_s;
        self.steps += 1;
        (self.present, self.arrived) = (0, 0);
        // Who is not told of stays as it was.
        for track in self.tracks.iter().skip(fleet.len()) {
            self.present += usize::from(track.is_ours());
            self.arrived += usize::from(track.is_ours() && track.arrived_s.is_some());
        }
        for ((track, body), state) in self.tracks.iter_mut().zip(&mut self.bodies).zip(fleet) {
            each(state);
            let anybody = track.follow(state, now_s, &self.limits);
            *body = track.body();
            if !anybody {
                continue;
            }
            // Where a robot without a trusted state is, nobody knows.
            let inside = state.has(state_flags::VALID)
                && (state.position_m() - track.goal_m).norm() <= self.tolerance_m;
            track.arrived_s = inside.then_some(track.arrived_s.unwrap_or(now_s));
            track.stall(state.pose(), now_s);
            track.driven_m += state.v_mps.abs() * self.period_s;
            track.omega_variation += (state.omega_radps - track.omega_radps).abs();
            track.omega_radps = state.omega_radps;
            self.present += usize::from(track.is_ours());
            self.arrived += usize::from(track.is_ours() && track.arrived_s.is_some());
        }
    }

    /// Adds one robot's solve.
    pub fn observe_solve(&mut self, telemetry: &RobotTelemetry) {
        if telemetry.status == SolveStatus::Verified as u32 {
            self.solved += 1;
            let needed = SLACK_ACTIVE * (telemetry.decrease_position_m2 + f64::MIN_POSITIVE);
            self.slack_active += u64::from(telemetry.slack_position_m2 > needed);
        }
    }

    /// Robots inside the tolerance of their goal in the last period.
    pub fn arrived(&self) -> usize {
        self.arrived
    }

    /// Whether every robot that has a goal is inside the tolerance of it.
    pub fn all_arrived(&self) -> bool {
        self.arrived == self.present
    }

    /// Every robot of ours: how far it had to drive, and when it arrived.
    pub fn arrivals(&self) -> impl Iterator<Item = Arrival> {
        self.ours().map(|track| Arrival {
            distance_m: (track.goal_m - track.start_m).norm(),
            first_turn_s: track.first_turn_s,
            arrived_s: track.arrived_s,
        })
    }

    fn ours(&self) -> impl Iterator<Item = &Track> {
        self.tracks.iter().filter(|track| track.is_ours())
    }

    /// Pairs that came closer than they may so far.
    pub fn violations(&self) -> usize {
        self.violated.len()
    }

    /// Smallest clearance so far, m; +∞ without a pair.
    pub fn min_clearance_m(&self) -> f64 {
        self.min_clearance_m
    }

    /// The figures so far.
    pub fn finish(&self) -> ControlFigures {
        let arrivals = || self.ours().filter_map(|t| t.arrived_s.map(|s| (t, s)));
        let mean = |values: &mut dyn Iterator<Item = f64>| {
            let (sum, count) = values.fold((0.0, 0u32), |(sum, count), x| (sum + x, count + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        let straight = |t: &Track| (t.goal_m - t.start_m).norm();
        let moved = || arrivals().filter(|(t, _)| straight(t) > self.tolerance_m);
        let v_max = self.limits.v_max_mps;
        ControlFigures {
            robots: self.present,
            arrived: self.arrived(),
            stalled: self.ours().filter(|t| t.stalled).count(),
            violations: self.violated.len(),
            min_clearance_m: self.min_clearance_m.is_finite().then_some(self.min_clearance_m),
            steps: self.steps,
            makespan_s: self.all_arrived().then(|| arrivals().map(|(_, s)| s).fold(0.0, f64::max)),
            mean_arrival_s: mean(&mut arrivals().map(|(_, s)| s)),
            arrival_ratio: mean(&mut moved().map(|(t, s)| (s - t.since_s) * v_max / straight(t))),
            arrival_ratio_after_turn: mean(
                &mut moved().map(|(t, s)| (s - t.since_s - t.first_turn_s).max(0.0) * v_max / straight(t)),
            ),
            path_ratio: mean(&mut moved().map(|(t, _)| t.driven_m / straight(t))),
            omega_variation_rad: mean(&mut self.ours().map(|t| t.omega_variation)).unwrap_or(0.0),
            slack_active_fraction: if self.solved == 0 {
                0.0
            } else {
                self.slack_active as f64 / self.solved as f64
            },
        }
    }
}
