use super::read::{Controller, RealTime, Source, Timing};
use super::{Config, RealTimePolicy, Wakeup};
use crate::document::{Document, ErrorKind, Place, Problem};
use crate::geometry::Vec2;

/// Periods that an observation may be old: the commands of as many are remembered for each robot.
const MAX_AGE_PERIODS: u64 = 500;

/// Rules between values that are fine alone. A value that was left out has its default; only what
/// was written can be pointed at.
pub(super) fn contradictions(
    doc: &Document,
    timing: &Timing,
    realtime: &RealTime,
    controller: &Controller,
    source: &Source,
) {
    if !doc.is_sound() {
        return;
    }
    let (t, c) = (timing.value, controller.value);
    if t.margin_ns() >= t.period_ns {
        let message = format!(
            "the margin of {} µs leaves nothing of a period of {} µs",
            t.margin_ns() / 1000,
            t.period_ns / 1000
        );
        let places = [(timing.margin.as_ref(), "margin"), (timing.period.as_ref(), "period")];
        conflict(doc, "timing.deadline_margin_us", message, places, "choose a margin well below the period");
    }
    if (realtime.value.policy, realtime.value.wakeup) == (RealTimePolicy::Off, Wakeup::Spin) {
        let message = "threads spin on CPUs of their own only, and policy = \"off\" pins none".to_owned();
        let places = [(realtime.wakeup.as_ref(), "spins"), (realtime.policy.as_ref(), "pins nothing")];
        conflict(doc, "realtime.wakeup", message, places, "set policy = \"prefer\", or wakeup = \"futex\"");
    }
    if c.comfort_gamma > c.gamma {
        let message = format!(
            "comfort_gamma = {} is above gamma = {}, so the comfort rows could never act before the hard ones",
            c.comfort_gamma, c.gamma
        );
        let places = [
            (controller.comfort_gamma.as_ref(), "the softer rate"),
            (controller.gamma.as_ref(), "the hard rate"),
        ];
        conflict(doc, "controller.comfort_gamma", message, places, "set comfort_gamma to at most gamma");
    }
    if source.value.max_age_ns.is_some_and(|age| age < t.period_ns) {
        let message = format!(
            "observations would be stale before the next period of {} µs, and every robot would stop",
            t.period_ns / 1000
        );
        let places =
            [(source.max_age.as_ref(), "shorter than the period"), (timing.period.as_ref(), "period")];
        conflict(doc, "source.max_age_us", message, places, "allow at least one period, better two");
    }
    if source.value.max_age_ns.is_some_and(|age| age > MAX_AGE_PERIODS * t.period_ns) {
        let message = format!(
            "observations could be older than {MAX_AGE_PERIODS} periods of {} µs, and robots would be steered from a guess",
            t.period_ns / 1000
        );
        let places = [(source.max_age.as_ref(), "too long"), (timing.period.as_ref(), "period")];
        conflict(doc, "source.max_age_us", message, places, "two periods are a good choice");
    }
}

/// Robots that start or arrive out of range would be stopped for ever.
pub(super) fn arena_holds_the_scenario(
    doc: &Document,
    config: &Config,
    arena: Option<&Place>,
    scenario: Option<&Place>,
) {
    let beyond = |p: Vec2| p.norm() > config.source.arena_m;
    let Some(robot) = config.scenario.robots.iter().find(|r| beyond(r.start.position_m) || beyond(r.goal_m))
    else {
        return;
    };
    let message = format!(
        "robot {} of scenario `{}` starts or arrives more than {} m from the origin",
        robot.id, config.scenario.name, config.source.arena_m
    );
    conflict(
        doc,
        "source.arena_m",
        message,
        [(arena, "too small"), (scenario, "this scenario")],
        "enlarge arena_m",
    );
}

fn conflict(doc: &Document, key: &str, message: String, places: [(Option<&Place>, &str); 2], help: &str) {
    let problem = Problem::new(ErrorKind::Contradiction, key, message).advise(help);
    let written = places.into_iter().filter_map(|(place, label)| Some((place?, label)));
    doc.report(written.fold(problem, |problem, (place, label)| problem.at(place, label)));
}
