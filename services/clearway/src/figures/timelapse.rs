//! The run as it passes: six instants side by side, and an animation.

use super::cases::Case;
use super::law_name;
use super::trajectories::{name, obstacles, path};
use crate::plot::{Colour, Figure, Frame, Panel, Style};
use clearway::config::Profile;
use clearway::evaluation::{Period, Trace};
use std::fmt::Write;

/// Instants of the still.
const INSTANTS: usize = 6;

/// Frames of the animation at most.
const FRAMES_MAX: usize = 240;

/// Seconds that the last frame stays.
const HOLD_S: f64 = 1.0;

fn last_period(run: &Trace) -> usize {
    run.periods.len().saturating_sub(1)
}

/// Six instants of the certified run, evenly spaced from the start to the end.
pub(super) fn still(case: &Case) -> Figure {
    let run = &case.under(Profile::Certified)[0];
    let title = format!("Time-lapse of {} under the certified law", run.scenario.name);
    let mut figure = Figure::new(&title).columns(3).width(980.0).panel_height(350.0);
    for k in 0..INSTANTS {
        let period = (last_period(run) * k + (INSTANTS - 1) / 2) / (INSTANTS - 1);
        let mut panel = Panel::plane().titled(&format!("t = {:.2} s", run.time_s(period)));
        obstacles(&mut panel, &run.scenario);
        // The ways ahead lie below everybody's ways so far.
        for robot in 0..run.scenario.robots.len() {
            let ahead = Style::solid(Colour::GRID).wide(1.0);
            panel.curve("", path(run, robot, run.periods.len()), ahead);
        }
        for robot in 0..run.scenario.robots.len() {
            let colour = Colour::nth(robot);
            panel.curve(&name(run, robot), path(run, robot, period), Style::solid(colour).wide(1.2));
        }
        let margin = |p: &Period, robot: usize| {
            let (at, room_m) = (p.fleet[robot].pose.position_m, 2.2 * run.scenario.robots[robot].radius_m);
            [(at.x - room_m, at.y - room_m), (at.x + room_m, at.y + room_m)]
        };
        for period in &run.periods {
            panel.room((0..period.fleet.len()).flat_map(|robot| margin(period, robot)).collect());
        }
        for (robot, sample) in run.periods[period].fleet.iter().enumerate() {
            let (colour, radius_m) = (Colour::nth(robot), run.scenario.robots[robot].radius_m);
            let (centre, heading) = (sample.pose.position_m, sample.pose.heading());
            let nose = centre + heading * (2.2 * radius_m);
            panel.disc((centre.x, centre.y), radius_m, colour, true);
            panel.curve(
                "",
                vec![(centre.x, centre.y), (nose.x, nose.y)],
                Style::solid(Colour::INK).wide(1.2),
            );
        }
        figure = figure.with(panel);
    }
    figure
}

/// The certified run beside the printed law's, animated (SMIL). Around each body lies half of the gap
/// that has to be kept: two of these rings never overlap unless a pair is too close.
pub(super) fn animated(case: &Case) -> String {
    let shown = [Profile::Certified, Profile::Paper].map(|law| (law, &case.under(law)[0]));
    let end_s = case.under(Profile::Certified)[0].time_s(last_period(shown[0].1));
    let (speed, words) = pace(end_s);
    let title = format!("{} over time, {words}", shown[0].1.scenario.name);
    let mut figure = Figure::new(&title).columns(2).width(760.0).panel_height(400.0);
    for (law, run) in shown {
        let mut panel = Panel::plane().titled(&format!("{}, {words}", law_name(law)));
        obstacles(&mut panel, &run.scenario);
        for robot in 0..run.scenario.robots.len() {
            panel.curve(&name(run, robot), path(run, robot, run.periods.len()), Style::solid(Colour::GRID));
        }
        figure = figure.with(panel);
    }
    let rendered = figure.render();
    let mut moving = String::new();
    for ((_, run), frame) in shown.iter().zip(&rendered.frames) {
        let clock = Clock { end_s, speed };
        robots(&mut moving, run, frame, rendered.units_per_px, &clock);
        marks(&mut moving, run, frame, rendered.units_per_px, &clock);
    }
    rendered.svg.replacen("</svg>", &format!("{moving}</svg>"), 1)
}

/// How fast a run of this length is shown, and in words.
fn pace(end_s: f64) -> (f64, &'static str) {
    match end_s {
        s if s < 2.0 => (0.25, "quarter speed"),
        s if s < 5.0 => (0.5, "half speed"),
        s if s < 15.0 => (1.0, "real time"),
        s if s < 60.0 => (4.0, "4 × real time"),
        _ => (20.0, "20 × real time"),
    }
}

struct Clock {
    end_s: f64,
    speed: f64,
}

impl Clock {
    /// How long one round takes, s.
    fn round_s(&self) -> f64 {
        self.end_s / self.speed + HOLD_S
    }

    /// When in a round, from 0 to 1, the time `s` of the run is shown.
    fn at(&self, s: f64) -> f64 {
        (s / self.speed / self.round_s()).min(1.0)
    }
}

fn robots(out: &mut String, run: &Trace, frame: &Frame, units: f64, clock: &Clock) {
    let margin_m = run.scenario.limits.safety_margin_m;
    #[allow(clippy::cast_possible_truncation, clippy::cast_sign_loss)] // a few thousand
    let periods = ((clock.end_s / run.period_s).round() as usize).max(1);
    let stride = periods.div_ceil(FRAMES_MAX);
    let mut steps: Vec<usize> = (0..periods).step_by(stride).collect();
    steps.push(periods);
    let times: Vec<String> =
        steps.iter().map(|k| format!("{:.4}", clock.at(run.time_s(*k)))).chain(["1".to_owned()]).collect();
    let timing = format!(
        "dur=\"{:.2}s\" repeatCount=\"indefinite\" keyTimes=\"{}\"",
        clock.round_s(),
        times.join(";")
    );
    let m = frame.px_per_unit() * units;
    for (robot, spec) in run.scenario.robots.iter().enumerate() {
        let sample = |k: usize| run.periods[k.min(last_period(run))].fleet[robot].pose;
        let (mut places, mut turns): (Vec<String>, Vec<String>) = (Vec::new(), Vec::new());
        let mut degrees = -sample(0).theta_rad.to_degrees();
        for k in steps.iter().chain(steps.last()) {
            let pose = sample(*k);
            let at = frame.px((pose.position_m.x, pose.position_m.y)).unwrap_or_default();
            places.push(format!("{:.0},{:.0}", at.0 * units, at.1 * units));
            // The short way round; the sheet's y axis points down.
            let turn = (-pose.theta_rad.to_degrees() - degrees + 180.0).rem_euclid(360.0) - 180.0;
            degrees += turn;
            turns.push(format!("{degrees:.1}"));
        }
        let colour = Colour::nth(robot).hex();
        let (body, half_gap) = (spec.radius_m * m, (spec.radius_m + 0.5 * margin_m) * m);
        // Writing to a string cannot fail.
        let _ = write!(
            out,
            "<g transform=\"translate({})\"><animateTransform attributeName=\"transform\" \
             type=\"translate\" {timing} values=\"{}\"/>\n\
             <circle r=\"{half_gap:.0}\" fill=\"none\" stroke=\"{colour}\" stroke-width=\"6\"/>\
             <circle r=\"{body:.0}\" fill=\"{colour}\"/>\n\
             <g transform=\"rotate({})\"><animateTransform attributeName=\"transform\" type=\"rotate\" \
             {timing} values=\"{}\"/><path d=\"M0 0H{:.0}\" stroke=\"#222222\" stroke-width=\"10\"/></g></g>\n",
            places[0],
            places.join(";"),
            turns[0],
            turns.join(";"),
            2.2 * body,
        );
    }
}

/// A cross where a pair is closest, from then on.
fn marks(out: &mut String, run: &Trace, frame: &Frame, units: f64, clock: &Clock) {
    for contact in run.contacts.iter().filter(|contact| contact.time_s <= clock.end_s) {
        let Some((x, y)) = frame.px((contact.at_m.x, contact.at_m.y)) else { continue };
        let (x, y, r) = (x * units, y * units, 4.0 * units);
        let _ = writeln!(
            out,
            "<path d=\"M{:.0} {:.0}l{:.0} {:.0}m0 {:.0}l{:.0} {:.0}\" stroke=\"{}\" stroke-width=\"16\" \
             opacity=\"0\"><animate attributeName=\"opacity\" calcMode=\"discrete\" dur=\"{:.2}s\" \
             repeatCount=\"indefinite\" keyTimes=\"0;{:.4}\" values=\"0;1\"/></path>",
            x - r,
            y - r,
            2.0 * r,
            2.0 * r,
            -2.0 * r,
            -2.0 * r,
            2.0 * r,
            Colour::ALARM.hex(),
            clock.round_s(),
            clock.at(contact.time_s).max(0.0001),
        );
    }
}
