//! Bounds on disturbances that leave room for the scenario, and for leaving a contact.

use super::Config;
use super::read::Written;
use crate::document::{Document, ErrorKind, Place, Problem};
use crate::geometry::{Grid, Vec2};
use crate::model::{Disturbance, Limits, RobotSpec};

/// Largest spread of a command with which a robot still leaves a contact, m/m.
const SPREAD_MAX: f64 = 0.9;

/// A rule that the bounds break, and the key to change first.
pub(super) struct Fault {
    pub(super) key: String,
    pub(super) message: String,
    pub(super) help: String,
    part: &'static str,
}

impl Fault {
    fn new(part: &'static str, message: String, help: String) -> Self {
        Self { key: format!("robust.{part}"), message, help, part }
    }
}

/// Reports the rules that the bounds of `config` break, at what was written.
pub(super) fn leaves_room(
    doc: &Document,
    config: &Config,
    written: &Written,
    period: Option<&Place>,
    scenario: Option<&Place>,
) {
    for fault in faults(config) {
        let problem = Problem::new(ErrorKind::Contradiction, fault.key, fault.message).advise(fault.help);
        let own = written.iter().find(|(key, _)| *key == fault.part).map(|(_, place)| (place, "too large"));
        let other = match fault.part {
            "delay_us" => period.map(|place| (place, "period")),
            "position_m" => scenario.map(|place| (place, "this scenario")),
            _ => None,
        };
        let places = own.into_iter().chain(other);
        doc.report(places.fold(problem, |problem, (place, label)| problem.at(place, label)));
    }
}

/// The share of `spread` that is due to the largest contribution, and its key.
fn spread(b: &Disturbance, limits: &Limits, period_s: f64) -> (f64, &'static str) {
    // As in `certificate::robust::Margin::spread`, contribution by contribution.
    let turn = limits.turn_rate_radps();
    let late = |t: f64| 3.0 * turn * t + b.turn_rate_radps * t;
    let parts = [
        (b.heading_rad, "heading_rad"),
        (b.slip, "slip"),
        (1.5 * b.turn_rate_radps * period_s, "turn_rate_radps"),
        (late(b.lag_s), "lag_us"),
        (late(b.delay_s), "delay_us"),
    ];
    let total = parts.iter().map(|(part, _)| part).sum::<f64>() + 0.5 * turn * period_s;
    let largest =
        parts.iter().fold((0.0, "heading_rad"), |most, part| if part.0 > most.0 { *part } else { most });
    (total, largest.1)
}

/// The rules that the bounds of `config` break.
pub(super) fn faults(config: &Config) -> Vec<Fault> {
    let (b, scenario) = (&config.robust, &config.scenario);
    let mut faults = Vec::new();
    if b.is_none() {
        return faults;
    }
    let period_s = config.timing.period_s();
    if b.delay_s > period_s {
        faults.push(Fault::new(
            "delay_us",
            format!("a delay of {} µs is longer than a period of {} µs", micros(b.delay_s), micros(period_s)),
            "lower delay_us to at most timing.period_us, or lengthen the period".to_owned(),
        ));
    }
    let (total, key) = spread(b, &scenario.limits, period_s);
    if total > SPREAD_MAX {
        faults.push(Fault::new(
            key,
            format!(
                "a metre of a command may lead {total:.2} m astray, above {SPREAD_MAX}, so robots in contact \
                 could never be sure to part"
            ),
            format!("lower {key} first, then the other bounds, limits.omega_radps or the period"),
        ));
    }
    if 2.0 * b.position_m > scenario.tolerance_m {
        faults.push(Fault::new(
            "position_m",
            format!(
                "nobody can tell whether positions that may be {} m off are within tolerance_m = {} m",
                b.position_m, scenario.tolerance_m
            ),
            "lower position_m to at most half of tolerance_m, or raise the scenario's tolerance_m".to_owned(),
        ));
    }
    faults.extend(crowded(config));
    faults
}

fn micros(s: f64) -> f64 {
    (s * 1e6).round()
}

/// Where a robot of a scenario is at one end of its way.
type PointOf = fn(&RobotSpec) -> Vec2;

/// The first starts or goals that are closer than robots will dare to come.
fn crowded(config: &Config) -> Option<Fault> {
    let (noise_m, scenario) = (config.robust.position_m, &config.scenario);
    if noise_m == 0.0 {
        return None;
    }
    let robots = &scenario.robots;
    let too_close = |d: f64, required_m: f64| d < required_m - 1e-9;
    let fault = |what: String, d: f64, keep_m: f64| {
        Fault::new(
            "position_m",
            format!("{what} are {d:.3} m apart and need {keep_m:.3} m with this bound on the position"),
            format!(
                "lower position_m or the scenario's limits.safety_margin_m by {:.3} m in all, or move them apart",
                keep_m - d
            ),
        )
    };
    // As far as any two have to keep apart, and the rounding of the cells.
    let largest_m = robots.iter().map(|robot| robot.radius_m).fold(0.0, f64::max);
    let reach_m = scenario.limits.safety_margin_m + 2.0 * (largest_m + noise_m) + 1e-6;
    let places: [(&str, PointOf); 2] =
        [("starts", |robot| robot.start.position_m), ("goals", |robot| robot.goal_m)];
    let grids = places.map(|(what, place)| {
        let mut grid = Grid::with_capacity(robots.len(), reach_m);
        grid.build(robots.iter().map(place));
        (what, place, grid)
    });
    let mut near: Vec<(usize, usize)> = Vec::new();
    for j in 0..robots.len() {
        // In the order of the pairs, starts before goals.
        near.clear();
        for (kind, (_, place, grid)) in grids.iter().enumerate() {
            grid.near(place(&robots[j]), reach_m, |range| {
                let earlier = grid.order()[range].iter().map(|i| *i as usize).filter(|i| *i < j);
                near.extend(earlier.map(|i| (i, kind)));
            });
        }
        near.sort_unstable();
        for &(i, kind) in &near {
            let keep_m = scenario.required_distance_m(i, j) + 2.0 * noise_m;
            let (what, place, _) = &grids[kind];
            let d = (place(&robots[i]) - place(&robots[j])).norm();
            if too_close(d, keep_m) {
                let what = format!("the {what} of robots {} and {}", robots[i].id, robots[j].id);
                return Some(fault(what, d, keep_m));
            }
        }
        for (k, obstacle) in scenario.obstacles.iter().enumerate() {
            let robot = &robots[j];
            let keep_m = scenario.limits.safety_margin_m + robot.radius_m + obstacle.reach_m() + noise_m;
            for (what, p) in [("start", robot.start.position_m), ("goal", robot.goal_m)] {
                let d = obstacle.core_distance(p);
                if too_close(d, keep_m) {
                    return Some(fault(
                        format!("the {what} of robot {} and obstacle {k}", robot.id),
                        d,
                        keep_m,
                    ));
                }
            }
        }
    }
    None
}
