//! What every robot did in every period of a run, for plots and for judging claims.

use super::{Evaluation, EvaluationError, run_watched};
use crate::config::Config;
use crate::controller::Timing;
use crate::geometry::{Arc, Integration, Pose, Vec2, min_distance_arcs};
use crate::model::Command;
use crate::scenario::Scenario;
use crate::wire::RobotState;

/// Instants of a period at which the closest approach of two bodies in contact is looked for.
const CONTACT_SAMPLES: u32 = 32;

/// One robot over one period.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sample {
    /// Its pose at the start of the period.
    pub pose: Pose,
    /// The input held over it.
    pub input: Command,
    /// Distance to its goal at the start of the period, m.
    pub distance_m: f64,
    /// δ_p of the programme that decided the input, m²: what held the robot back. 0 for a stop.
    pub slack_m2: f64,
}

impl Sample {
    /// V_p = ½‖p − p_d‖², m².
    pub fn lyapunov_m2(&self) -> f64 {
        0.5 * self.distance_m * self.distance_m
    }
}

/// One period of a run.
#[derive(Debug, Clone, PartialEq)]
pub struct Period {
    /// One sample for each robot, in the scenario's order.
    pub fleet: Vec<Sample>,
    /// Smallest distance beyond the required one of any pair over this period's continuous time, m;
    /// +∞ where there is no pair.
    pub min_clearance_m: f64,
}

/// What a robot came too close to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Other {
    /// The robot of this index.
    Robot(usize),
    /// The obstacle of this index.
    Obstacle(usize),
}

/// A pair that came closer than it may.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Index of the robot.
    pub robot: usize,
    /// What it came too close to.
    pub other: Other,
    /// When it was closest, s.
    pub time_s: f64,
    /// Where: half way between the two robots, or at the robot, m.
    pub at_m: Vec2,
    /// Its smallest distance beyond the required one, m; negative.
    pub clearance_m: f64,
}

/// A whole run.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    /// What was to be done.
    pub scenario: Scenario,
    /// Length of a period, s.
    pub period_s: f64,
    /// How positions move within a period.
    pub plant: Integration,
    /// The periods from the start on.
    pub periods: Vec<Period>,
    /// Pairs that came too close, once each, in the order in which they first did.
    pub contacts: Vec<Contact>,
}

impl Trace {
    fn new(config: &Config) -> Self {
        Self {
            scenario: config.scenario.clone(),
            period_s: config.timing.period_s(),
            plant: config.source.plant,
            periods: Vec::new(),
            contacts: Vec::new(),
        }
    }

    /// Start of the `k`-th period, s.
    pub fn time_s(&self, k: usize) -> f64 {
        k as f64 * self.period_s
    }

    fn push(&mut self, fleet: &[RobotState], slack_m2: &[f64]) {
        // Places that nobody has taken have no start, no goal and nobody to come close to.
        let fleet = &fleet[..fleet.len().min(self.scenario.robots.len())];
        let samples: Vec<Sample> = fleet
            .iter()
            .zip(slack_m2)
            .map(|(robot, slack)| Sample {
                pose: robot.pose(),
                input: robot.command(),
                distance_m: (robot.position_m() - robot.goal_m()).norm(),
                slack_m2: *slack,
            })
            .collect();
        let ways: Vec<Arc> = fleet.iter().map(|robot| self.plant.path(&robot.arc())).collect();
        let mut least = f64::INFINITY;
        for (i, way) in ways.iter().enumerate() {
            for (j, other) in ways[..i].iter().enumerate() {
                let required = self.scenario.required_distance_m(i, j);
                let apart = (way.start.position_m - other.start.position_m).norm() - required;
                let reach = (way.v_mps.abs() + other.v_mps.abs()) * self.period_s;
                // Further away than they can drive: neither the smallest nor a contact.
                if apart - reach <= least.max(0.0) {
                    let clearance = min_distance_arcs(way, other, self.period_s).upper_m - required;
                    least = least.min(clearance);
                    if clearance < crate::figures::VIOLATION_M {
                        let between = |s| (way.position(s), other.position(s));
                        self.contact(i, Other::Robot(j), clearance, |s| {
                            let (p, q) = between(s);
                            ((p - q).norm(), 0.5 * (p + q))
                        });
                    }
                }
            }
            for k in 0..self.scenario.obstacles.len() {
                let obstacle = self.scenario.obstacles[k];
                let robot = &self.scenario.robots[i];
                let required = self.scenario.limits.safety_margin_m + robot.radius_m + obstacle.reach_m();
                let clearance = obstacle.min_core_distance(way, self.period_s).upper_m - required;
                least = least.min(clearance);
                if clearance < crate::figures::VIOLATION_M {
                    let at = |s| (obstacle.core_distance(way.position(s)), way.position(s));
                    self.contact(i, Other::Obstacle(k), clearance, at);
                }
            }
        }
        self.periods.push(Period { fleet: samples, min_clearance_m: least });
    }

    /// Keeps the closest approach of a pair; `at` gives its distance and place after s seconds.
    fn contact(&mut self, robot: usize, other: Other, clearance_m: f64, at: impl Fn(f64) -> (f64, Vec2)) {
        let step_s = self.period_s / f64::from(CONTACT_SAMPLES);
        let instants = (0..=CONTACT_SAMPLES).map(|k| f64::from(k) * step_s);
        let closest = instants.map(|s| (s, at(s))).min_by(|a, b| a.1.0.total_cmp(&b.1.0));
        let Some((s, (_, at_m))) = closest else { return };
        let time_s = self.time_s(self.periods.len()) + s;
        let found = Contact { robot, other, time_s, at_m, clearance_m };
        let same = |c: &&mut Contact| c.robot == robot && c.other == other;
        match self.contacts.iter_mut().find(same) {
            Some(known) if known.clearance_m <= clearance_m => {}
            Some(known) => *known = found,
            None => self.contacts.push(found),
        }
    }
}

/// [`run`](super::run) that keeps what every robot did.
///
/// Poses are the true ones. Within a period motion is what the plant makes of the input; where
/// disturbances are set, clearances within a period leave out what they add.
///
/// # Errors
/// When the controller cannot be built.
pub fn trace(config: &Config, timing: Timing) -> Result<(Evaluation, Trace), EvaluationError> {
    let robots = config.scenario.robots.len();
    // What was decided last, and what decided the inputs in force: one period earlier in the daemon.
    let decided = std::cell::RefCell::new(Vec::with_capacity(robots));
    let mut in_force = vec![0.0; robots];
    let mut trace = Trace::new(config);
    let result = run_watched(
        config,
        timing,
        |_, fleet| {
            let mut decided = decided.borrow_mut();
            if timing == Timing::Ideal {
                in_force.clone_from(&decided);
            }
            trace.push(fleet, &in_force);
            in_force.clone_from(&decided);
            decided.clear();
        },
        |decision, _| decided.borrow_mut().push(decision.telemetry.slack_position_m2),
    )?;
    Ok((result, trace))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Profile;

    fn traced(name: &str, profile: Profile) -> (Evaluation, Trace) {
        let mut config = Config::new(Scenario::builtin(name).unwrap());
        config.controller.profile = profile;
        trace(&config, Timing::LogicalExecutionTime).unwrap()
    }

    #[test]
    fn a_trace_is_the_run_that_the_figures_are_of() {
        for (name, profile) in
            [("swap8", Profile::Certified), ("swap8-zero", Profile::Paper), ("pillars-2", Profile::Paper)]
        {
            let (result, trace) = traced(name, profile);
            assert_eq!(trace.periods.len() as u64, result.figures.steps);
            let least = trace.periods.iter().map(|p| p.min_clearance_m).fold(f64::INFINITY, f64::min);
            assert_eq!(Some(least), result.figures.min_clearance_m, "{name}");
            assert_eq!(trace.contacts.len(), result.figures.violations, "{name}");
            let last = trace.periods.last().unwrap();
            assert!(last.fleet.iter().all(|robot| robot.distance_m <= trace.scenario.tolerance_m));
        }
    }

    #[test]
    fn an_unblocked_robot_shows_no_slack_until_it_lands_and_starts_at_rest() {
        let (_, trace) = traced("circle-1", Profile::Certified);
        let robot = |k: usize| trace.periods[k].fleet[0];
        assert_eq!(robot(0).input, Command::STOP);
        assert!((robot(0).lyapunov_m2() - 0.5 * robot(0).distance_m.powi(2)).abs() < 1e-12);
        // The certificate of the first step away from rest is met, up to what the weights let slip.
        assert!(robot(1).slack_m2 < 1e-2 * robot(1).lyapunov_m2(), "{:?}", robot(1));
        let falls = trace.periods.windows(2).all(|p| p[1].fleet[0].distance_m <= p[0].fleet[0].distance_m);
        assert!(falls, "straight to the goal");
    }

    #[test]
    fn a_contact_is_where_and_when_the_two_were_closest() {
        let (_, trace) = traced("head-on", Profile::Paper);
        let [contact] = trace.contacts[..] else { panic!("{:?}", trace.contacts) };
        assert_eq!((contact.robot, contact.other), (1, Other::Robot(0)));
        // They drive through each other half way.
        assert!(contact.at_m.norm() < 0.1, "{contact:?}");
        assert!((contact.clearance_m + trace.scenario.required_distance_m(0, 1)).abs() < 1e-6);
        assert!((0.0..trace.time_s(trace.periods.len())).contains(&contact.time_s));
    }
}
