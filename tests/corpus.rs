//! Every input that is kept for the fuzz targets goes through them again: small ones that reach much, and
//! each one that ever found a fault. New ones are looked for with `.ci/fuzz`.

#[expect(unreachable_pub, reason = "public where libFuzzer's programs use them")]
#[path = "fuzz/targets/mod.rs"]
mod targets;

use std::path::Path;

/// Feeds the kept inputs of one target; each has to leave its promise true.
fn feed(name: &str, target: fn(&[u8])) {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fuzz/corpus").join(name);
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 5, "{} holds only {} inputs", folder.display(), files.len());
    for file in files {
        println!("{}", file.display());
        target(&std::fs::read(&file).unwrap());
    }
}

#[test]
fn configuration() {
    feed("configuration", targets::configuration);
}

#[test]
fn scenario() {
    feed("scenario", targets::scenario);
}

#[test]
fn admin() {
    feed("admin", targets::admin);
}

#[test]
fn observation() {
    feed("observation", targets::observation);
}

#[test]
fn command() {
    feed("command", targets::command);
}

#[test]
fn journal() {
    feed("journal", targets::journal);
}
