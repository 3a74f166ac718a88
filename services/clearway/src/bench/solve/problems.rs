//! The problems: what robots had to solve on their way through closed-loop runs.

use clearway::config::Config;
use clearway::controller::{Decision, Timing};
use clearway::evaluation;
use clearway::model::Obstacle;
use clearway::programme::Programme;
use clearway::scenario::Scenario;
use clearway::wire::{SolveStatus, telemetry_flags};
use miette::{IntoDiagnostic, Result, WrapErr, miette};
use std::collections::BTreeMap;

/// Periods of a run that are drawn from: a crowd that jams would only repeat itself.
const PERIODS_MAX: u64 = 500;

/// Between a scenario's name and the scale that it is made smaller by.
const SCALED: char = '@';

/// Problems with the same number of rows.
pub(super) struct Group {
    /// Other robots and obstacles that have a row: those that full speed could reach.
    pub(super) neighbours: usize,
    /// How many of `problems` come from scenarios made smaller: those as they are held too few.
    pub(super) from_smaller: usize,
    /// Evenly spaced over the runs, in their order.
    pub(super) problems: Vec<Programme>,
}

/// Bodies with a row. Every safety row has a comfort row beside it, not the other way round.
fn neighbours(programme: &Programme) -> usize {
    programme.comfort.len().max(programme.safety.len())
}

/// The scenario `NAME`, or `NAME@SCALE` with every place, radius and gap multiplied by the scale while
/// speeds and the period stay: more neighbours are then within reach of one period.
fn scenario(name: &str) -> Result<Scenario> {
    let Some((base, scale)) = name.split_once(SCALED) else {
        return Ok(Scenario::resolve(name)?);
    };
    let scale: f64 = scale
        .parse()
        .ok()
        .filter(|s| *s > 0.0 && *s <= 10.0)
        .ok_or_else(|| miette!(help = "as in random-40-1@0.25", "`{scale}` is not a scale in (0, 10]"))?;
    let mut scenario = Scenario::resolve(base)?;
    scenario.limits.safety_margin_m *= scale;
    for robot in &mut scenario.robots {
        robot.radius_m *= scale;
        robot.start.position_m *= scale;
        robot.goal_m *= scale;
    }
    for obstacle in &mut scenario.obstacles {
        match obstacle {
            Obstacle::Circle { centre_m, radius_m } => {
                *centre_m *= scale;
                *radius_m *= scale;
            }
            Obstacle::Segment { from_m, to_m } => {
                *from_m *= scale;
                *to_m *= scale;
            }
        }
    }
    scenario.check()?;
    Ok(scenario)
}

/// Runs `scenarios` and groups what their robots solved; at most `samples` for each of `counts`.
///
/// Scenarios as they are come first; those made smaller only fill up. Robots that hold at their
/// goals are left out: nothing is asked of them, and their programmes would flatter the solvers.
pub(super) fn collect(
    scenarios: &[String],
    counts: &[usize],
    samples: usize,
    mut progress: impl FnMut(&str),
) -> Result<Vec<Group>> {
    let mut found: BTreeMap<usize, Found> = counts.iter().map(|n| (*n, Found::default())).collect();
    for name in scenarios {
        progress(name);
        drive(name, &mut found).wrap_err_with(|| format!("{name} could not run"))?;
    }
    let groups = found.into_iter().map(|(neighbours, found)| {
        let mut problems = spread(found.as_it_is, samples);
        let smaller = spread(found.smaller, samples - problems.len());
        let from_smaller = smaller.len();
        problems.extend(smaller);
        Group { neighbours, from_smaller, problems }
    });
    Ok(groups.collect())
}

/// The problems of one number of neighbours.
#[derive(Default)]
struct Found {
    as_it_is: Vec<Programme>,
    smaller: Vec<Programme>,
}

/// Adds what the robots of one scenario solve, where `found` has a place for it.
fn drive(name: &str, found: &mut BTreeMap<usize, Found>) -> Result<()> {
    let mut config = Config::new(scenario(name)?);
    config.timing.ticks = Some(PERIODS_MAX);
    let smaller = name.contains(SCALED);
    let watch = |decision: &Decision, programme: &Programme| {
        let t = &decision.telemetry;
        let idle = t.status == SolveStatus::NotSolved as u32 || t.flags & telemetry_flags::HOLDING != 0;
        if let Some(found) = found.get_mut(&neighbours(programme)).filter(|_| !idle) {
            if smaller { &mut found.smaller } else { &mut found.as_it_is }.push(programme.clone());
        }
    };
    evaluation::run_watched(&config, Timing::default(), |_, _| {}, watch).into_diagnostic()?;
    Ok(())
}

/// At most `samples` of `all`, evenly spaced.
fn spread<T>(all: Vec<T>, samples: usize) -> Vec<T> {
    let total = all.len();
    if total <= samples {
        return all;
    }
    let chosen = |k: usize| (k * samples) / total != ((k + 1) * samples) / total;
    all.into_iter().enumerate().filter(|(k, _)| chosen(*k)).map(|(_, item)| item).collect()
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn a_spread_covers_the_whole_run() {
        assert_eq!(spread((0..10).collect(), 5), [1, 3, 5, 7, 9]);
        assert_eq!(spread((0..10).collect(), 3).len(), 3);
        assert_eq!(spread(vec![1, 2], 5), [1, 2]);
    }
}
