//! The table of `clearway eval`.

use super::Run;
use clearway::evaluation::Evaluation;
use std::fmt::Write;

/// With more scenarios than this a row stands for a family.
const ROWS_MAX: usize = 40;

/// Columns of a terminal.
const WIDTH: usize = 80;

/// Failed runs that are listed one by one.
const FAILED_MAX: usize = 20;

/// How the table is written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// What fits 80 columns.
    Terminal,
    /// Every column.
    Wide,
    /// Every column but the measured times, as a Markdown table.
    Markdown,
}

/// One row: a run, or those of a family at the same settings.
struct Row<'a> {
    name: String,
    members: Vec<&'a Run>,
}

/// One column: a heading and a cell for each row.
struct Column {
    head: String,
    cells: Vec<String>,
    /// The largest goes first where there is not room for all; 0 stays.
    spare: u8,
}

impl Column {
    fn width(&self) -> usize {
        self.cells.iter().chain([&self.head]).map(|cell| cell.chars().count()).max().unwrap_or(0)
    }
}

/// The table of `runs`, every run with a row of its own where `all`, and what did not pass.
pub(super) fn render(runs: &[Run], all: bool, form: Form) -> String {
    let swept = runs.first().map_or(0, |run| run.point.len());
    let mut scenarios: Vec<&str> = runs.iter().map(|run| run.evaluation.scenario.as_str()).collect();
    scenarios.sort_unstable();
    scenarios.dedup();
    // A sweep compares settings: the scenarios of a family are one row for each of them.
    let by_family = !all && (runs.len() > ROWS_MAX || (swept > 0 && scenarios.len() > 1));
    let mut rows: Vec<Row<'_>> = Vec::new();
    for run in runs {
        let scenario = &run.evaluation.scenario;
        let name = if by_family { family(scenario) } else { scenario.clone() };
        let same = |row: &&mut Row<'_>| row.name == name && row.members[0].point == run.point;
        match rows.iter_mut().find(same) {
            Some(row) if by_family => row.members.push(run),
            _ => rows.push(Row { name, members: vec![run] }),
        }
    }
    // The settings of one scenario below each other.
    let mut order: Vec<String> = Vec::new();
    for row in &rows {
        if !order.contains(&row.name) {
            order.push(row.name.clone());
        }
    }
    rows.sort_by_key(|row| order.iter().position(|name| *name == row.name));

    let mut columns = settings(&rows, swept);
    columns.extend(figures(&rows));
    match form {
        Form::Terminal => fit(&mut columns),
        Form::Wide => spell_out(&mut columns),
        Form::Markdown => {
            columns.retain(|column| column.head != "steps/s");
            spell_out(&mut columns);
        }
    }
    if form == Form::Markdown { markdown(&columns) } else { plain(&columns) + &verdict(runs) }
}

/// The headings as they are where there is room.
fn spell_out(columns: &mut [Column]) {
    for column in columns {
        let full = match column.head.as_str() {
            "viol." => "violations",
            "gap m" => "clearance m",
            "last s" => "makespan s",
            _ => continue,
        };
        full.clone_into(&mut column.head);
    }
}

/// Leaves out what there is no room for.
fn fit(columns: &mut Vec<Column>) {
    let width = |columns: &[Column]| columns.iter().map(|c| c.width() + 1).sum::<usize>() - 1;
    while width(columns) > WIDTH {
        let last = columns.iter().enumerate().filter(|(_, c)| c.spare > 0).max_by_key(|(_, c)| c.spare);
        let Some((k, _)) = last else { break };
        columns.remove(k);
    }
    // A name that nothing else makes room for is cut.
    let over = width(columns).saturating_sub(WIDTH);
    let room = columns[0].width().saturating_sub(over).max(8);
    for name in &mut columns[0].cells {
        if name.chars().count() > room {
            *name = name.chars().take(room - 1).chain(['…']).collect();
        }
    }
}

fn plain(columns: &[Column]) -> String {
    let rows = columns[0].cells.len();
    let line = |cell: &dyn Fn(&Column) -> String| {
        let cells = columns.iter().enumerate().map(|(k, column)| {
            let (text, width) = (cell(column), column.width());
            if k == 0 { format!("{text:width$}") } else { format!("{text:>width$}") }
        });
        cells.collect::<Vec<_>>().join(" ").trim_end().to_owned() + "\n"
    };
    let head = line(&|column| column.head.clone());
    (0..rows).fold(head, |out, k| out + &line(&|column| column.cells[k].clone()))
}

fn markdown(columns: &[Column]) -> String {
    let row = |cells: Vec<&str>| format!("| {} |\n", cells.join(" | "));
    let rule = (0..columns.len()).map(|k| if k == 0 { "---" } else { "---:" }).collect();
    // A bar would end the cell.
    let heads: Vec<String> = columns.iter().map(|c| c.head.replace('|', "\\|")).collect();
    let head = row(heads.iter().map(String::as_str).collect()) + &row(rule);
    let rows = columns[0].cells.len();
    (0..rows).fold(head, |out, k| out + &row(columns.iter().map(|c| c.cells[k].as_str()).collect()))
}

fn verdict(runs: &[Run]) -> String {
    let failed: Vec<&Run> = runs.iter().filter(|run| !run.evaluation.passed()).collect();
    let passed = runs.len() - failed.len();
    // Writing to a string cannot fail.
    let mut out = String::new();
    let _ = writeln!(
        out,
        "\n{passed} of {} runs passed: everybody arrived and nobody came too close.",
        runs.len()
    );
    for run in failed.iter().take(FAILED_MAX) {
        let (e, f) = (&run.evaluation, &run.evaluation.figures);
        let at = run.point.iter().fold(String::new(), |at, (key, value)| at + " " + key + "=" + value);
        let line = format!("{}{at}: {} of {} arrived", e.scenario, f.arrived, f.robots);
        let _ = writeln!(out, "  {line}, {} violations", f.violations);
    }
    if failed.len() > FAILED_MAX {
        let _ = writeln!(out, "  and {} more; --jsonl has every run", failed.len() - FAILED_MAX);
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

/// The names, and what was swept.
fn settings(rows: &[Row<'_>], swept: usize) -> Vec<Column> {
    let names = rows.iter().map(|row| row.name.clone()).collect();
    let mut columns = vec![Column { head: "scenario".to_owned(), cells: names, spare: 0 }];
    let keys: Vec<&str> =
        rows.first().map_or(Vec::new(), |row| row.members[0].point.iter().map(|(k, _)| k.as_str()).collect());
    let short = |key: &str| key.rsplit('.').next().unwrap_or(key).to_owned();
    for k in 0..swept {
        let alone = keys.iter().filter(|key| short(key) == short(keys[k])).count() == 1;
        columns.push(Column {
            head: if alone { short(keys[k]) } else { keys[k].to_owned() },
            cells: rows.iter().map(|row| row.members[0].point[k].1.clone()).collect(),
            spare: 0,
        });
    }
    columns
}

/// What was measured.
fn figures(rows: &[Row<'_>]) -> Vec<Column> {
    let column = |head: &str, spare: u8, cell: &dyn Fn(&Row<'_>) -> String| Column {
        head: head.to_owned(),
        cells: rows.iter().map(cell).collect(),
        spare,
    };
    let mean_of = |head: &str, spare: u8, digits: usize, of: &dyn Fn(&Evaluation) -> Option<f64>| {
        column(head, spare, &|row| show(mean(&row.of(of)), digits))
    };
    vec![
        column("runs", 1, &|row| row.members.len().to_string()),
        column("arrived", 0, &|row| {
            format!("{}/{}", row.sum(|e| e.figures.arrived), row.sum(|e| e.figures.robots))
        }),
        column("stalled", 7, &|row| row.sum(|e| e.figures.stalled).to_string()),
        column("viol.", 0, &|row| row.sum(|e| e.figures.violations).to_string()),
        column("gap m", 0, &|row| {
            show(row.of(&|e| e.figures.min_clearance_m).into_iter().reduce(f64::min), 4)
        }),
        mean_of("last s", 2, 2, &|e| e.figures.makespan_s),
        column("worst s", 3, &|row| {
            let last = row.of(&|e| e.figures.makespan_s);
            let complete = last.len() == row.members.len();
            show(last.into_iter().reduce(f64::max).filter(|_| complete), 2)
        }),
        mean_of("ratio", 4, 2, &|e| e.figures.arrival_ratio),
        mean_of("−turn", 6, 2, &|e| e.figures.arrival_ratio_after_turn),
        mean_of("path", 5, 2, &|e| e.figures.path_ratio),
        mean_of("∫|dω|", 5, 2, &|e| Some(e.figures.omega_variation_rad)),
        column("≤(14)", 9, &|row| {
            format!("{}/{}", row.sum(|e| e.within_bound), row.sum(|e| e.figures.robots))
        }),
        column("−turn ≤(14)", 9, &|row| {
            format!("{}/{}", row.sum(|e| e.within_bound_after_turn), row.sum(|e| e.figures.robots))
        }),
        column("steps/s", 8, &|row| {
            let ns = mean(&row.of(&|e| Some(e.step_ns_per_robot as f64 * e.figures.robots as f64)));
            show(ns.map(|ns| 1e9 / ns.max(1.0)), 0)
        }),
    ]
}

impl Row<'_> {
    /// What the members have of a figure.
    fn of(&self, value: &dyn Fn(&Evaluation) -> Option<f64>) -> Vec<f64> {
        self.members.iter().filter_map(|run| value(&run.evaluation)).collect()
    }

    fn sum(&self, value: fn(&Evaluation) -> usize) -> usize {
        self.members.iter().map(|run| value(&run.evaluation)).sum()
    }
}

fn show(value: Option<f64>, digits: usize) -> String {
    value.map_or("–".to_owned(), |v| format!("{:.digits$}", tidy(v, digits)))
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
    use super::*;

    #[test]
    fn a_family_is_the_name_without_its_seed() {
        assert_eq!(family("random-20-7"), "random-20-*");
        assert_eq!(family("swap8-heading-3"), "swap8-heading-*");
        assert_eq!(family("circle-50"), "circle-50");
        assert_eq!(family("swap8"), "swap8");
    }

    #[test]
    fn what_has_no_room_is_left_out_and_a_long_name_is_cut() {
        let column =
            |head: &str, cell: &str, spare| Column { head: head.into(), cells: vec![cell.into()], spare };
        let wide = "x".repeat(30);
        let mut columns = vec![
            column("scenario", &"n".repeat(64), 0),
            column("kept", &wide, 0),
            column("first out", &wide, 2),
            column("next out", &wide, 1),
        ];
        fit(&mut columns);
        assert_eq!(columns.iter().map(|c| c.head.as_str()).collect::<Vec<_>>(), ["scenario", "kept"]);
        assert!(plain(&columns).lines().all(|line| line.chars().count() <= WIDTH));
        assert!(columns[0].cells[0].ends_with("n…"));
    }
}
