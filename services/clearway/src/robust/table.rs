//! The table of `clearway robust`: a row for every kind, level and pattern.

use super::Run;
use super::cases::Margin;
use std::fmt::Write;

pub(super) fn render(runs: &[Run]) -> String {
    let mut out = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{:6} {:5} {:12} {:6} {:>4} {:>9} {:>10} {:>11} {:>6}",
        "kind", "level", "pattern", "margin", "runs", "arrived", "violations", "clearance m", "time"
    );
    let mut rows: Vec<(&Run, Vec<&Run>)> = Vec::new();
    for run in runs {
        let same = |row: &&mut (&Run, Vec<&Run>)| {
            let first = row.0;
            first.kind == run.kind
                && first.level == run.level
                && first.margin == run.margin
                && first.pattern == run.pattern
        };
        match rows.iter_mut().find(same) {
            Some(row) => row.1.push(run),
            None => rows.push((run, vec![run])),
        }
    }
    for (first, members) in &rows {
        let sum = |of: fn(&Run) -> usize| members.iter().map(|run| of(run)).sum::<usize>();
        let clearance = members.iter().filter_map(|r| r.evaluation.figures.min_clearance_m).reduce(f64::min);
        let pattern = match first.margin {
            Margin::Only | Margin::None => "none",
            Margin::On | Margin::Off => first.pattern,
        };
        let margin = match first.margin {
            Margin::On | Margin::Only => "on",
            Margin::Off | Margin::None => "off",
        };
        let _ = writeln!(
            out,
            "{:6} {:5} {:12} {:6} {:>4} {:>9} {:>10} {:>11} {:>6}",
            first.kind,
            first.level.0,
            pattern,
            margin,
            members.len(),
            format!("{}/{}", sum(|r| r.evaluation.figures.arrived), sum(|r| r.evaluation.figures.robots)),
            sum(|r| r.evaluation.figures.violations),
            clearance.map_or("–".to_owned(), |m| format!("{m:.4}")),
            slower(runs, members).map_or("–".to_owned(), |ratio| format!("{ratio:.2}")),
        );
    }
    let of = |margin: &[Margin]| runs.iter().filter(|r| margin.contains(&r.margin)).collect::<Vec<_>>();
    let violated = |runs: &[&Run]| runs.iter().filter(|r| r.evaluation.figures.violations > 0).count();
    let (inside, without) = (of(&[Margin::On, Margin::Only]), of(&[Margin::Off]));
    let _ = writeln!(
        out,
        "\nInside the bounds {} of {} runs have violations; without the margin {} of {}.\n\
         time: mean arrival against the same scenario undisturbed and without a margin,\n\
         where everybody arrived in both.",
        violated(&inside),
        inside.len(),
        violated(&without),
        without.len()
    );
    out
}

/// Mean ratio of the mean arrivals to those of the undisturbed runs.
fn slower(runs: &[Run], members: &[&Run]) -> Option<f64> {
    let complete = |run: &Run| {
        let figures = &run.evaluation.figures;
        figures.mean_arrival_s.filter(|_| figures.arrived == figures.robots)
    };
    let ratios: Vec<f64> = members
        .iter()
        .filter_map(|run| {
            let same = |other: &&Run| {
                other.margin == Margin::None && other.evaluation.scenario == run.evaluation.scenario
            };
            Some(complete(run)? / complete(runs.iter().find(same)?)?)
        })
        .collect();
    (!ratios.is_empty()).then(|| ratios.iter().sum::<f64>() / ratios.len() as f64)
}
