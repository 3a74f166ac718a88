//! What was understood, in words.

use clearway::config::{Config, SourceKind};
use clearway::scenario::Scenario;
use std::fmt::Write;

fn line(out: &mut String, name: &str, text: &str) {
    // Writing to a string cannot fail.
    let _ = writeln!(out, "  {name:<13}{text}");
}

/// A scenario in a few lines.
pub(crate) fn scenario(s: &Scenario) -> String {
    let mut out = String::new();
    let robots = &s.robots;
    let parked = robots.iter().filter(|r| r.start.position_m == r.goal_m).count();
    let trips = robots.iter().map(|r| (r.goal_m - r.start.position_m).norm());
    let longest_m = trips.fold(0.0, f64::max);
    let radii = robots.iter().map(|r| r.radius_m);
    let (small, large) = (radii.clone().fold(f64::INFINITY, f64::min), radii.fold(0.0, f64::max));
    let radius = if small < large { format!("{small} to {large} m") } else { format!("{small} m") };
    let (l, ids) = (&s.limits, (robots.first().map(|r| r.id), robots.last().map(|r| r.id)));

    line(&mut out, "scenario", &s.name);
    if let (Some(first), Some(last)) = ids {
        let n = robots.len();
        line(&mut out, "robots", &format!("{n}, ids {first} to {last}, radius {radius}, {parked} parked"));
    }
    line(&mut out, "obstacles", &s.obstacles.len().to_string());
    line(&mut out, "speed", &format!("{} to {} m/s", l.v_min_mps, l.v_max_mps));
    line(&mut out, "turn rate", &format!("{} to {} rad/s", l.omega_min_radps, l.omega_max_radps));
    line(&mut out, "gap", &format!("{} m between bodies", l.safety_margin_m));
    let least_s = longest_m / l.speed_mps();
    line(&mut out, "longest way", &format!("{longest_m:.2} m, at least {least_s:.2} s"));
    line(&mut out, "arrival", &format!("within {} m, given up after {} s", s.tolerance_m, s.duration_s));
    out
}

/// A configuration in a few lines, its scenario last.
pub(crate) fn config(c: &Config) -> String {
    let mut out = String::new();
    let us = |ns: u64| ns as f64 / 1e3;
    let (t, r) = (&c.timing, &c.realtime);

    line(&mut out, "fleet", &c.fleet);
    let margin = us(t.margin_ns());
    line(&mut out, "period", &format!("{} µs, commands {margin} µs before its end", us(t.period_ns)));
    let workers = t.workers.map_or("as many as robots and cores allow".to_owned(), |n| n.to_string());
    line(&mut out, "workers", &workers);
    line(&mut out, "runs", &t.ticks.map_or("until a signal".to_owned(), |n| format!("{n} periods")));
    let memory = if r.lock_memory { "locked" } else { "not locked" };
    line(&mut out, "real time", &format!("{}, priority {}, memory {memory}", r.policy, r.priority));
    let k = &c.controller;
    line(&mut out, "control", &format!("{}, solved by {}, gamma {}", k.profile, k.solver, k.gamma));
    let states = match c.source.kind {
        SourceKind::Plant => "the plant inside the daemon".to_owned(),
        SourceKind::Observation => format!("channel clearway/{}/v1/observation", c.fleet),
    };
    line(&mut out, "states from", &states);
    out + &scenario(&c.scenario)
}
