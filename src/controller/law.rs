//! What is the same for all robots of a fleet: the parameters, the limits, and what one look at all states finds.

use super::{Timing, printed};
use crate::certificate::barrier::activation_m;
use crate::certificate::robust::{Margin, Reach};
use crate::certificate::{Decrease, HeadingLaw};
use crate::config::{Config, ControllerConfig, Profile};
use crate::geometry::Way;
use crate::guidance;
use crate::model::{Disturbance, Limits, Obstacle};
use crate::neighbours::Sight;
use crate::wire::{RobotState, state_flags};

/// How far a robot may be from the last pose that was trusted, in periods of full speed: it drove on
/// under the command then in force and under the one already committed, and stands since.
pub(crate) const UNTRUSTED_PERIODS: f64 = 2.0;

/// Other robots, and the ways on which they may stand, that one robot looks at for rows; more than any crowd has
/// within their reach, and with more the robot stops.
const BODIES_MAX: usize = 512;

/// Everything that is the same for all robots of a fleet.
#[derive(Debug, Clone)]
pub(super) struct Law {
    pub(super) control: ControllerConfig,
    pub(super) limits: Limits,
    /// What the certificates ask for.
    pub(super) decrease: Decrease,
    pub(super) heading: HeadingLaw,
    pub(super) guidance: guidance::Params,
    pub(super) guided: guidance::Limits,
    pub(super) period_s: f64,
    /// From a state to the instant at which its answer acts, s.
    pub(super) ahead_s: f64,
    pub(super) tolerance_m: f64,
    pub(super) obstacles: Vec<Obstacle>,
    /// Speed bound of each robot of the fleet that is not ours.
    pub(super) foreign_speed_mps: Vec<Option<f64>>,
    /// The bounds on the disturbances that are allowed for; `None` when there are none.
    pub(super) bounds: Option<Disturbance>,
    /// What they make of the rows, with this period's timing.
    pub(super) margin: Option<Margin>,
    /// Where a row that leaves half of the gap, or all of it, begins to bind, beyond what it requires, m.
    pub(super) binds_m: [f64; 2],
    /// Age from which on an observation is not trusted, s.
    pub(super) max_age_s: f64,
    /// Time for which a foreign robot moves while a command of ours may, from its state on, s.
    pub(super) foreign_s: f64,
    /// How far a robot of ours without a trusted state may be from where it is taken to be, m: at least,
    /// and what disturbances add.
    pub(super) untrusted_m: f64,
    pub(super) lost_m: f64,
    /// Largest radius of the fleet, m, and how far at most a robot of ours may be from where it is seen,
    /// m: of this period's states.
    pub(super) largest_radius_m: f64,
    pub(super) unknown_m: f64,
    /// How far the largest look.
    pub(super) largest_sight: Sight,
    /// Length of the longest way on which one of ours may stand, m; `None` when none may.
    pub(super) longest_way_m: Option<f64>,
    /// Indices of the robots that everybody looks at however far: those that are not ours, and one of
    /// ours that may be anywhere. What is not known of these few would have all look at the whole fleet.
    pub(super) strangers: Vec<usize>,
}

impl Law {
    pub(super) fn new(config: &Config) -> Self {
        let (scenario, robots) = (&config.scenario, config.places());
        let (decrease, period_s) = (Decrease::of(&config.controller), config.timing.period_s());
        Self {
            control: config.controller,
            limits: scenario.limits,
            decrease,
            heading: HeadingLaw::new(period_s, scenario.limits.turn_rate_radps(), decrease),
            guidance: config.guidance,
            guided: guidance::Limits {
                v_max_mps: scenario.limits.v_max_mps,
                omega_max_radps: scenario.limits.omega_max_radps.min(-scenario.limits.omega_min_radps),
                period_s,
            },
            period_s,
            ahead_s: 0.0,
            tolerance_m: scenario.tolerance_m,
            obstacles: scenario.obstacles.clone(),
            bounds: (!config.robust.is_none()).then_some(config.robust),
            margin: None,
            binds_m: [f64::INFINITY; 2],
            max_age_s: config.source.max_age_or_default_ns(config.timing.period_ns) as f64 * 1e-9,
            foreign_s: 0.0,
            untrusted_m: 0.0,
            lost_m: 0.0,
            largest_radius_m: 0.0,
            unknown_m: 0.0,
            largest_sight: Sight { all_m: 0.0, nearest_m: 0.0, nearest: 0 },
            longest_way_m: None,
            strangers: Vec::with_capacity(robots),
            foreign_speed_mps: (0..robots)
                .map(|index| scenario.robots.get(index).and_then(|robot| robot.foreign_speed_mps))
                .collect(),
        }
    }

    /// Bodies that one robot looks at, at most.
    pub(super) fn bodies_max(&self) -> usize {
        BODIES_MAX + self.obstacles.len()
    }

    /// Takes in what does not depend on the states of this period, before its robots are shown to a [`Survey`].
    pub(super) fn begin(&mut self, timing: Timing) {
        let (ahead_s, foreign_periods) = match timing {
            Timing::LogicalExecutionTime => (self.period_s, 2.0),
            Timing::Ideal => (0.0, 1.0),
        };
        self.ahead_s = ahead_s;
        self.margin = self.bounds.map(|b| Margin::new(b, &self.limits, self.period_s, ahead_s));
        self.foreign_s = foreign_periods * self.period_s + self.margin.map_or(0.0, |m| m.rest_s());
        self.binds_m = [0.5, 1.0].map(|share| self.activation_m(0.0, share));
        let silent_s = self.max_age_s + UNTRUSTED_PERIODS * self.period_s;
        self.untrusted_m = UNTRUSTED_PERIODS * self.period_s * self.limits.speed_mps();
        self.lost_m = self.margin.map_or(0.0, |m| m.lost_m(silent_s));
        self.strangers.clear();
    }

    /// Takes in what was seen of all robots.
    pub(super) fn end(&mut self, survey: Survey) {
        let way_m = self.period_s * self.limits.speed_mps() * (1.0 + self.spread());
        self.strangers = survey.strangers;
        self.largest_radius_m = survey.largest_radius_m;
        self.longest_way_m = survey.longest_way_m;
        self.unknown_m = self.untrusted_m.max(survey.unseen_m + way_m) + self.lost_m;
        self.largest_sight = self.sight_of_radius(self.largest_radius_m);
    }

    /// Takes in what is the same for all robots in this period.
    #[cfg(test)]
    pub(super) fn prepare(&mut self, fleet: &[RobotState], timing: Timing) {
        self.begin(timing);
        let mut survey = Survey::in_place_of(&mut self.strangers);
        for (index, robot) in fleet.iter().enumerate() {
            survey.see(self, index, robot);
        }
        self.end(survey);
    }

    /// κ of the commands; 0 without disturbances.
    pub(super) fn spread(&self) -> f64 {
        self.margin.map_or(0.0, |margin| margin.spread())
    }

    /// How far a robot at rest may be from where it is seen, m.
    pub(super) fn noise_m(&self) -> f64 {
        self.bounds.map_or(0.0, |bounds| bounds.position_m)
    }

    /// Where a robot may be around its predicted pose.
    pub(super) fn reach(&self, robot: &RobotState) -> Reach {
        let Some(margin) = &self.margin else { return Reach::default() };
        if robot.has(state_flags::FOREIGN) {
            // It takes no commands: only where it was seen is in doubt.
            return Reach { error_m: margin.bounds().position_m, ..Reach::default() };
        }
        margin.reach(robot.uncertainty_m, robot.command())
    }

    /// Length of the way from where a robot was last seen to where the next command finds it, m.
    pub(super) fn way_m(&self, robot: &RobotState) -> f64 {
        (robot.way_m + robot.v_mps.abs() * self.ahead_s).max(0.0) + self.reach(robot).lead_m
    }

    /// The way on which a predicted robot may stand.
    pub(super) fn way(&self, predicted: &RobotState) -> Way {
        let length_m = self.way_m(predicted);
        Way { from_m: predicted.seen_m(), to_m: predicted.position_m(), length_m }
    }

    /// How far a robot that stands on its way may be from what is taken to be that way, m.
    pub(super) fn stray_m(&self, robot: &RobotState) -> f64 {
        self.margin.map_or(0.0, |margin| {
            let reach = self.reach(robot);
            reach.lead_m + reach.extent_m() + margin.stray_m(self.way_m(robot), self.max_age_s + self.ahead_s)
        })
    }

    /// How far a robot of this radius looks for a stranger, m: to where its row can bind.
    pub(super) fn sight_of_m(&self, radius_m: f64, index: usize, stranger: &RobotState) -> f64 {
        let moved_m = self.foreign_speed_mps[index].map_or(0.0, |speed_mps| self.foreign_s * speed_mps);
        let required = self.limits.safety_margin_m + radius_m + stranger.radius_m;
        self.rows_m(required + stranger.uncertainty_m + moved_m, 0.5)
    }

    /// How far from a robot a row that keeps `required_m` and leaves this share of the gap can bind, m.
    pub(super) fn rows_m(&self, required_m: f64, share: f64) -> f64 {
        let extent = self.margin.map_or(0.0, |margin| 2.0 * margin.extent_max_m());
        self.activation_m(required_m + extent, share)
    }

    /// Within which distance a row of either kind binds, m.
    fn activation_m(&self, required_m: f64, share: f64) -> f64 {
        // The smaller rate reaches further: one look serves both kinds of rows.
        let rate = self.control.gamma.min(self.control.comfort_gamma);
        let speed_mps = self.limits.speed_mps() * (1.0 + self.spread());
        activation_m(required_m, speed_mps, self.period_s, rate, share)
    }

    /// How far a robot of this radius looks: for every row that can bind, and for the guidance.
    #[inline]
    pub(super) fn sight(&self, radius_m: f64) -> Sight {
        // Most often all are of one size.
        if radius_m == self.largest_radius_m { self.largest_sight } else { self.sight_of_radius(radius_m) }
    }

    pub(super) fn sight_of_radius(&self, radius_m: f64) -> Sight {
        let required = self.limits.safety_margin_m + radius_m + self.largest_radius_m;
        let robots_m = self.rows_m(required + self.unknown_m, 0.5);
        let ways_m = self.longest_way_m.map_or(0.0, |way_m| {
            let stray_m = self.margin.map_or(0.0, |margin| {
                2.0 * margin.extent_max_m() + margin.stray_m(way_m, self.max_age_s + self.ahead_s)
            });
            // As far as its end may be from its nearest point, and its bow.
            self.rows_m(required + stray_m + 1.5 * way_m, 1.0)
        });
        let rows_m = robots_m.max(ways_m);
        let printed_m = (required * required + printed::ACTIVATION_M2).sqrt();
        let all_m = if self.control.profile == Profile::Paper { rows_m.max(printed_m) } else { rows_m };
        Sight { all_m, nearest_m: self.guidance.sight_m, nearest: guidance::NEIGHBOURS_MAX }
    }
}

/// What one look at all robots of a period finds.
#[derive(Debug, Default)]
pub(super) struct Survey {
    strangers: Vec<usize>,
    largest_radius_m: f64,
    longest_way_m: Option<f64>,
    /// Largest uncertainty of those that are no strangers, m.
    unseen_m: f64,
    /// Somebody may be anywhere.
    nowhere: bool,
}

impl Survey {
    /// Of nobody yet, with the room of this list.
    pub(super) fn in_place_of(strangers: &mut Vec<usize>) -> Self {
        Self { strangers: std::mem::take(strangers), ..Self::default() }
    }

    /// Looks at one robot.
    #[inline]
    pub(super) fn see(&mut self, law: &Law, index: usize, robot: &RobotState) {
        if robot.has(state_flags::MAY_STAND) {
            let way_m = law.way_m(robot);
            self.longest_way_m = Some(self.longest_way_m.map_or(way_m, |longest_m| longest_m.max(way_m)));
        }
        self.largest_radius_m = self.largest_radius_m.max(robot.radius_m);
        if robot.has(state_flags::VACANT) {
            return;
        }
        let foreign = law.foreign_speed_mps[index].is_some();
        // One that may be anywhere stops all; a second one changes nothing.
        let first = !robot.uncertainty_m.is_finite() && !std::mem::replace(&mut self.nowhere, true);
        if foreign || first {
            self.strangers.push(index);
        } else if robot.uncertainty_m.is_finite() {
            self.unseen_m = self.unseen_m.max(robot.uncertainty_m);
        }
    }
}
