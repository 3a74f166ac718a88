//! `docs/SAFETY.md` names tests and figures that exist, and every fault has both or says why not.

use std::collections::BTreeSet;
use std::path::Path;

use clearway::admission::Rejection;
use clearway::wire::StopReason;

/// One row of a table of faults.
struct Row {
    id: String,
    seen: String,
    tests: Vec<(String, String)>,
}

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn read(path: &str) -> String {
    std::fs::read_to_string(root().join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
}

/// What stands between backquotes.
fn quoted(text: &str) -> impl Iterator<Item = &str> {
    text.split('`').skip(1).step_by(2)
}

fn rows() -> Vec<Row> {
    let text = read("docs/SAFETY.md");
    let faults = text.split("\n## Faults\n").nth(1).and_then(|rest| rest.split("\n## ").next()).unwrap();
    let cells = faults.lines().filter_map(|line| line.strip_prefix("| ")?.strip_suffix(" |"));
    cells
        .map(|line| line.split(" | ").collect::<Vec<_>>())
        .filter(|cells| cells[0].len() >= 2 && cells[0][1..].bytes().all(|b| b.is_ascii_digit()))
        .map(|cells| {
            assert_eq!(cells.len(), 5, "{cells:?}");
            assert!(cells.iter().all(|cell| !cell.trim().is_empty()), "{cells:?}");
            let test = |name: &str| {
                let (file, function) =
                    name.split_once("::").unwrap_or_else(|| panic!("{}: {name}", cells[0]));
                (file.to_owned(), function.to_owned())
            };
            let tests = quoted(cells[4]).map(test).collect();
            Row { id: cells[0].to_owned(), seen: cells[3].to_owned(), tests }
        })
        .collect()
}

/// Whether `source` has a test of this name: a `fn` below `#[test]`, with other attributes between them at
/// most, or one of the list from which a macro makes such functions.
fn has_test(source: &str, name: &str) -> bool {
    let lines: Vec<&str> = source.lines().map(str::trim).collect();
    let function = |name: &str| {
        let is_it = |line: &str| {
            line.strip_prefix("fn ")
                .and_then(|rest| rest.strip_prefix(name))
                .is_some_and(|rest| rest.starts_with('('))
        };
        lines.iter().enumerate().any(|(at, line)| {
            let mut above =
                lines[..at].iter().rev().take_while(|line| line.starts_with('#') || line.starts_with("//"));
            is_it(line) && above.any(|line| *line == "#[test]")
        })
    };
    let listed = || {
        lines.iter().any(|line| {
            line.strip_prefix(name).is_some_and(|rest| rest.starts_with(": ") && rest.ends_with(';'))
        })
    };
    function(name) || (function("$name") && listed())
}

#[test]
fn every_test_of_every_fault_exists() {
    let rows = rows();
    let (mut named, mut missing) = (0, Vec::new());
    for row in &rows {
        assert!(!row.tests.is_empty(), "{} has no test", row.id);
        for (file, name) in &row.tests {
            if !has_test(&read(file), name) {
                missing.push(format!("{}: {file}: {name}", row.id));
            }
            named += 1;
        }
    }
    assert!(missing.is_empty(), "no such tests:\n{}", missing.join("\n"));
    assert!(rows.len() >= 43 && named > 70, "{} rows, {named} tests", rows.len());
    let ids: BTreeSet<&str> = rows.iter().map(|row| row.id.as_str()).collect();
    assert_eq!(ids.len(), rows.len(), "an id stands twice");
    // Numbered from one in every group.
    for row in &rows {
        let (group, number) = row.id.split_at(1);
        let number: usize = number.parse().unwrap();
        assert!(number == 1 || ids.contains(format!("{group}{}", number - 1).as_str()), "{}", row.id);
    }
}

/// Fields of the public records in a file.
fn fields(path: &str) -> BTreeSet<String> {
    let source = read(path);
    let field = |line: &str| {
        let (name, _) = line.trim().strip_prefix("pub ")?.split_once(": ")?;
        name.bytes()
            .all(|b| b.is_ascii_lowercase() || b.is_ascii_digit() || b == b'_')
            .then(|| name.to_owned())
    };
    source.lines().filter_map(field).collect()
}

#[test]
fn every_figure_of_every_fault_exists() {
    let places = [
        "src/report.rs",
        "src/figures/mod.rs",
        "src/realtime/mod.rs",
        "src/robots/remote.rs",
        "src/wire/admin.rs",
        "src/wire/telemetry.rs",
        "services/clearway-record/src/status.rs",
    ];
    let plain: BTreeSet<String> = places.iter().flat_map(|path| fields(path)).collect();
    let rejections = fields("src/admission/rejection.rs");
    let commands = fields("src/robots/remote.rs");
    let known = |name: &str| match name.split_once('.') {
        Some(("stops", reason)) => StopReason::ALL.iter().any(|r| r.name() == reason),
        Some(("rejected_inputs", reason)) => {
            Rejection::ALL.iter().any(|r| r.name() == reason) || rejections.contains(reason)
        }
        Some(("commands", what)) => commands.contains(what),
        Some(_) => false,
        None => plain.contains(name),
    };
    for row in rows() {
        let own: Vec<&str> = quoted(&row.seen).collect();
        assert!(
            !own.is_empty() || row.seen.starts_with("exit status") || row.seen.starts_with("said "),
            "{}",
            row.id
        );
        for name in own {
            assert!(known(name), "{}: nobody counts {name}", row.id);
        }
    }
    assert!(
        !known("nonsense") && !known("stops.nonsense") && known("deadline_misses") && known("stops.no_state")
    );
}

#[test]
fn a_test_that_is_not_there_is_missed() {
    let source = "#[test]\n#[ignore]\nfn there() {\n}\nfn helper() {\n}\n";
    assert!(has_test(source, "there"));
    let made = "macro_rules! all {\n#[test]\nfn $name() {\n}\n}\nall! {\n  one: 1;\n  two: 2\n}\n";
    assert!(has_test(made, "one") && !has_test(made, "two") && !has_test("one: 1;\n", "one"));
    assert!(!has_test(source, "the") && !has_test(source, "helper") && !has_test(source, "elsewhere"));
}
