//! Figs. 1 and 2: where the robots went.

use super::cases::Case;
use super::{columns, law_name};
use crate::plot::{Colour, Figure, Marker, Panel, Style};
use clearway::config::Profile;
use clearway::evaluation::{Contact, Trace};
use clearway::geometry::Vec2;
use clearway::model::Obstacle;
use clearway::scenario::Scenario;

/// Points of a line within a period.
const POINTS: u32 = 4;

/// More robots than this have no number at their starts.
const NUMBERED_MAX: usize = 12;

/// One panel for each case, of the first of its scenarios.
pub(super) fn figure(cases: &[Case], profile: Profile) -> Figure {
    let title = format!("Trajectories under the law {}", law_name(profile));
    let mut figure = columns(&title, cases).panel_height(if cases.len() == 1 { 460.0 } else { 360.0 });
    // The same in every figure, whatever the law makes of it.
    let longest_s = cases.iter().map(Case::end_s).fold(0.0, f64::max);
    let every_s = [0.5, 1.0, 2.0, 5.0, 10.0].into_iter().find(|s| longest_s / s <= 20.0).unwrap_or(50.0);
    for case in cases {
        let run = &case.under(profile)[0];
        let several = case.under(profile).len() > 1;
        let title = if several { run.scenario.name.clone() } else { case.title.clone() };
        let mut panel = Panel::plane().titled(&title);
        obstacles(&mut panel, &run.scenario);
        for robot in 0..run.scenario.robots.len() {
            let style = Style::solid(Colour::nth(robot)).wide(1.5);
            panel.curve(&name(run, robot), path(run, robot, run.periods.len()), style);
        }
        ends(&mut panel, &run.scenario);
        ticks(&mut panel, run, case.end_s(), every_s);
        contacts(&mut panel, &run.scenario, &run.contacts);
        figure = figure.with(panel);
    }
    figure
}

pub(super) fn name(run: &Trace, robot: usize) -> String {
    format!("robot {}", run.scenario.robots[robot].id)
}

fn xy(p: Vec2) -> (f64, f64) {
    (p.x, p.y)
}

/// The way of a robot through the first `periods` periods.
pub(super) fn path(run: &Trace, robot: usize, periods: usize) -> Vec<(f64, f64)> {
    let mut points = Vec::new();
    for period in run.periods.iter().take(periods) {
        let sample = &period.fleet[robot];
        let arc = clearway::geometry::Arc {
            start: sample.pose,
            v_mps: sample.input.v_mps,
            omega_radps: sample.input.omega_radps,
        };
        let way = run.plant.path(&arc);
        let step_s = run.period_s / f64::from(POINTS);
        points.extend((0..POINTS).map(|k| xy(way.position(f64::from(k) * step_s))));
    }
    points.extend(run.periods.get(periods).map(|end| xy(end.fleet[robot].pose.position_m)));
    points
}

pub(super) fn obstacles(panel: &mut Panel, scenario: &Scenario) {
    for obstacle in &scenario.obstacles {
        match *obstacle {
            Obstacle::Circle { centre_m, radius_m } => {
                panel.disc(xy(centre_m), radius_m, Colour::SOLID, true);
            }
            Obstacle::Segment { from_m, to_m } => {
                let wall = Style::solid(Colour::FAINT).wide(3.0);
                panel.curve("wall", vec![xy(from_m), xy(to_m)], wall);
            }
        }
    }
}

/// Starts as the bodies that stand there, goals as marks.
fn ends(panel: &mut Panel, scenario: &Scenario) {
    let at = |of: fn(&clearway::model::RobotSpec) -> Vec2| {
        scenario.robots.iter().map(of).map(xy).collect::<Vec<_>>()
    };
    let starts = at(|robot| robot.start.position_m);
    panel.marks("start", &[], Marker::Ring, Colour::INK, 8.0);
    panel.marks("goal", &[], Marker::Diamond, Colour::INK, 6.0);
    let all = starts.iter().copied().chain(at(|robot| robot.goal_m));
    let (low, high) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), (x, y)| {
        (low.min(x).min(y), high.max(x).max(y))
    });
    for (k, robot) in scenario.robots.iter().enumerate() {
        let colour = Colour::nth(k);
        panel.disc(starts[k], robot.radius_m, colour, false);
        if robot.foreign_speed_mps.is_none() {
            panel.marks("", &[xy(robot.goal_m)], Marker::Diamond, colour, 6.0);
        }
        let way = robot.goal_m - robot.start.position_m;
        if scenario.robots.len() <= NUMBERED_MAX && way.norm() > 0.0 {
            let beside = robot.start.position_m - way.normalize() * 0.055 * (high - low);
            panel.note(xy(beside), &robot.id.to_string());
        }
    }
}

/// Dots at equal times until `end_s`.
fn ticks(panel: &mut Panel, run: &Trace, end_s: f64, every_s: f64) {
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few dots
    let count = (end_s / every_s) as u32;
    panel.marks(&format!("every {every_s} s"), &[], Marker::Disc, Colour::INK, 4.0);
    for robot in 0..run.scenario.robots.len() {
        let at: Vec<(f64, f64)> = (1..=count)
            .filter_map(|k| {
                #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // of a period
                let period = (f64::from(k) * every_s / run.period_s) as usize;
                let sample = run.periods.get(period)?.fleet[robot];
                // Who has arrived has no time to show.
                (sample.distance_m > run.scenario.tolerance_m).then(|| xy(sample.pose.position_m))
            })
            .collect();
        panel.marks("", &at, Marker::Disc, Colour::nth(robot), 4.0);
    }
}

/// Pairs that came too close: bodies that overlapped, and gaps that were too small.
pub(super) fn contacts(panel: &mut Panel, scenario: &Scenario, contacts: &[Contact]) {
    let margin_m = scenario.limits.safety_margin_m;
    let (hit, near): (Vec<&Contact>, Vec<&Contact>) =
        contacts.iter().partition(|contact| contact.clearance_m < -margin_m);
    for (name, found, marker) in
        [("gap too small", near, Marker::Square), ("bodies collide", hit, Marker::Cross)]
    {
        let at: Vec<(f64, f64)> = found.iter().map(|contact| xy(contact.at_m)).collect();
        if !at.is_empty() {
            panel.marks(name, &at, marker, Colour::ALARM, if marker == Marker::Cross { 7.0 } else { 5.0 });
        }
    }
}
