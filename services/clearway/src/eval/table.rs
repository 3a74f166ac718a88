//! The table of `clearway eval`.

use clearway::evaluation::Evaluation;
use std::fmt::Write;

/// With more scenarios than this a row stands for a family.
const ROWS_MAX: usize = 40;

/// One row: a scenario, or several of a family.
struct Row<'a> {
    name: String,
    members: Vec<&'a Evaluation>,
}

pub(crate) fn render(results: &[Evaluation], all: bool) -> String {
    let by_family = !all && results.len() > ROWS_MAX;
    let mut rows: Vec<Row<'_>> = Vec::new();
    for result in results {
        let name = if by_family { family(&result.scenario) } else { result.scenario.clone() };
        match rows.iter_mut().find(|row| row.name == name) {
            Some(row) if by_family => row.members.push(result),
            _ => rows.push(Row { name, members: vec![result] }),
        }
    }
    let mut out = String::new();
    let width = rows.iter().map(|row| row.name.chars().count()).max().unwrap_or(0).max(8);
    // Writing to a string cannot fail.
    let _ = writeln!(
        out,
        "{:width$} {:>5} {:>11} {:>7} {:>10} {:>12} {:>10} {:>8} {:>7} {:>7} {:>8} {:>8} {:>11}",
        "scenario",
        "runs",
        "arrived",
        "stalled",
        "violations",
        "clearance m",
        "makespan s",
        "worst s",
        "ratio",
        "−turn",
        "path",
        "∫|dω|",
        "steps/s"
    );
    for row in &rows {
        let _ = writeln!(out, "{}", row.render(width));
    }
    let passed = results.iter().filter(|r| r.passed()).count();
    let _ = writeln!(
        out,
        "\n{passed} of {} scenarios passed: everybody arrived and nobody came too close.",
        results.len()
    );
    for failed in results.iter().filter(|r| !r.passed()) {
        let f = &failed.figures;
        let _ = writeln!(
            out,
            "  {}: {} of {} arrived, {} violations",
            failed.scenario, f.arrived, f.robots, f.violations
        );
    }
    out
}

/// The name without its seed: its last number where it has two, or the family is one of seeds.
fn family(name: &str) -> String {
    match name.rsplit_once('-') {
        Some((stem, seed))
            if seed.parse::<u64>().is_ok()
                && (stem.ends_with("heading") || stem.ends_with(|c: char| c.is_ascii_digit())) =>
        {
            format!("{stem}-*")
        }
        _ => name.to_owned(),
    }
}

impl Row<'_> {
    fn render(&self, width: usize) -> String {
        let of = |value: &dyn Fn(&Evaluation) -> Option<f64>| {
            self.members.iter().filter_map(|e| value(e)).collect::<Vec<_>>()
        };
        let sum = |value: &dyn Fn(&Evaluation) -> usize| self.members.iter().map(|e| value(e)).sum::<usize>();
        let least = |values: Vec<f64>| values.into_iter().reduce(f64::min);
        let worst = |values: Vec<f64>| values.into_iter().reduce(f64::max);
        let show = |value: Option<f64>, digits: usize| {
            value.map_or("–".to_owned(), |v| format!("{:.digits$}", tidy(v, digits)))
        };
        let makespans = of(&|e| e.figures.makespan_s);
        let complete = makespans.len() == self.members.len();
        let robot_steps_ns = mean(&of(&|e| Some(e.step_ns_per_robot as f64 * e.figures.robots as f64)));
        format!(
            "{:width$} {:>5} {:>11} {:>7} {:>10} {:>12} {:>10} {:>8} {:>7} {:>7} {:>8} {:>8} {:>11}",
            self.name,
            self.members.len(),
            format!("{}/{}", sum(&|e| e.figures.arrived), sum(&|e| e.figures.robots)),
            sum(&|e| e.figures.stalled),
            sum(&|e| e.figures.violations),
            show(least(of(&|e| e.figures.min_clearance_m)), 4),
            show(mean(&makespans), 2),
            show(worst(makespans).filter(|_| complete), 2),
            show(mean(&of(&|e| e.figures.arrival_ratio)), 2),
            show(mean(&of(&|e| e.figures.arrival_ratio_after_turn)), 2),
            show(mean(&of(&|e| e.figures.path_ratio)), 2),
            show(mean(&of(&|e| Some(e.figures.omega_variation_rad))), 2),
            show(robot_steps_ns.map(|ns| 1e9 / ns.max(1.0)), 0),
        )
    }
}

/// No minus sign on what is shown as zero.
fn tidy(value: f64, digits: usize) -> f64 {
    let unit = 0.5 * 0.1f64.powi(i32::try_from(digits).unwrap_or(0));
    if value.abs() < unit { 0.0 } else { value }
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::family;

    #[test]
    fn a_family_is_the_name_without_its_seed() {
        assert_eq!(family("random-20-7"), "random-20-*");
        assert_eq!(family("swap8-heading-3"), "swap8-heading-*");
        assert_eq!(family("circle-50"), "circle-50");
        assert_eq!(family("swap8"), "swap8");
    }
}
