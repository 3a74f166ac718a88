//! `docs/CHANNELS.md` lists every field of every record as it really is.

use std::path::Path;

use clearway::wire::RobotCheckpoint;

/// A field's name, offset and type.
type Field = (String, usize, String);

/// The records in a source file: type name on the wire, and the fields.
fn records(source: &str) -> Vec<(String, Vec<Field>)> {
    let mut found: Vec<(String, Vec<Field>)> = Vec::new();
    let (mut inside, mut offset) = (false, 0);
    for line in source.lines().map(str::trim) {
        if let Some(name) = line.strip_prefix("#[type_name(\"").and_then(|rest| rest.strip_suffix("\")]")) {
            found.push((name.to_owned(), Vec::new()));
            (inside, offset) = (true, 0);
        } else if inside && line == "}" {
            inside = false;
        } else if inside
            && let Some(field) = line.strip_prefix("pub ").and_then(|rest| rest.strip_suffix(','))
            && let Some((name, kind)) = field.split_once(": ")
        {
            let (kind, size) = match kind {
                "u32" => ("u32", 4),
                "u64" => ("u64", 8),
                "f64" => ("f64", 8),
                "RobotIntent" => ("RobotIntent", 64),
                "[u64; RobotCheckpoint::WORDS]" => ("32 × u64", 8 * RobotCheckpoint::WORDS),
                other => panic!("{other} is not a type of the wire"),
            };
            found.last_mut().unwrap().1.push((name.to_owned(), offset, kind.to_owned()));
            offset += size;
        }
    }
    found
}

#[test]
fn every_field_of_every_record_is_listed() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let text = std::fs::read_to_string(root.join("docs/CHANNELS.md")).unwrap();
    let mut seen = 0;
    for file in std::fs::read_dir(root.join("src/wire")).unwrap() {
        for (record, fields) in records(&std::fs::read_to_string(file.unwrap().path()).unwrap()) {
            let section = text.split(&format!("`{record}`")).nth(1);
            let section = section.unwrap_or_else(|| panic!("{record} has no section"));
            let rows: Vec<Vec<&str>> = section
                .split("\n### ")
                .next()
                .unwrap_or_default()
                .lines()
                .filter_map(|line| line.strip_prefix("| `"))
                .map(|line| line.split(" | ").collect())
                .collect();
            assert_eq!(rows.len(), fields.len(), "{record}");
            for (row, (name, offset, kind)) in rows.iter().zip(&fields) {
                let expected = [format!("{name}`"), offset.to_string(), kind.clone()];
                assert_eq!(row[..3], expected, "{record}");
                assert!(row[3].len() > 3, "{record}.{name} is not explained");
                seen += 1;
            }
        }
    }
    assert!(seen > 100, "{seen}");
}
