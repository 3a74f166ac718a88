//! The way of the data: a module uses only those before it in the table of the crate's documentation.

use std::path::{Path, PathBuf};

fn source() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("src")
}

/// The modules in the order of the table in `src/lib.rs`.
fn order() -> Vec<String> {
    let text = std::fs::read_to_string(source().join("lib.rs")).unwrap();
    let row = |line: &str| {
        let (_, cell) = line.strip_prefix("//! | ")?.split_once("| [`")?;
        Some(cell.split_once("`]")?.0.to_owned())
    };
    text.lines().filter_map(row).collect()
}

/// The Rust files of a module, without its tests.
fn files(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_dir() {
        for entry in std::fs::read_dir(path).unwrap() {
            files(&entry.unwrap().path(), found);
        }
    } else if path.extension().is_some_and(|e| e == "rs") && path.file_name().is_some_and(|n| n != "tests.rs")
    {
        found.push(path.to_owned());
    }
}

/// The modules that a text names as `crate::module`, outside of comments and of its tests at the end.
fn uses(text: &str) -> Vec<String> {
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let code = text.lines().filter(|line| !line.trim_start().starts_with("//"));
    code.flat_map(|line| line.split("crate::").skip(1))
        .map(|rest| rest.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect())
        .collect()
}

#[test]
fn a_module_uses_only_those_before_it() {
    let order = order();
    let place = |name: &str| order.iter().position(|module| module == name);
    for (index, module) in order.iter().enumerate() {
        let mut found = Vec::new();
        for path in [source().join(module), source().join(format!("{module}.rs"))] {
            if path.exists() {
                files(&path, &mut found);
            }
        }
        assert!(!found.is_empty(), "{module} has no file");
        for file in found {
            for used in uses(&std::fs::read_to_string(&file).unwrap()) {
                let used_at = place(&used);
                let before = used_at.is_some_and(|at| at <= index);
                assert!(before, "{} uses `{used}`, which is not before `{module}`", file.display());
            }
        }
    }
}

#[test]
fn the_tables_name_every_module_in_the_same_order() {
    let order = order();
    let lib = std::fs::read_to_string(source().join("lib.rs")).unwrap();
    let mut declared: Vec<&str> =
        lib.lines().filter_map(|line| line.strip_prefix("pub mod ")?.strip_suffix(';')).collect();
    let mut sorted = order.clone();
    declared.sort_unstable();
    sorted.sort_unstable();
    assert_eq!(sorted, declared);

    let path = source().join("../docs/ARCHITECTURE.md");
    let text = std::fs::read_to_string(path).unwrap();
    let rooms = text.lines().skip_while(|line| !line.starts_with("| room |")).skip(2);
    let described: Vec<&str> = rooms
        .take_while(|line| line.starts_with("| "))
        .filter_map(|line| line.split('|').nth(1))
        .flat_map(|cell| cell.split('`').skip(1).step_by(2))
        .collect();
    assert_eq!(described, order);
}
