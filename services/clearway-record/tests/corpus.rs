//! The inputs that are kept for the fuzz target `recording` go through it again. New ones are looked for with
//! `.ci/fuzz`.

#[path = "../../../tests/fuzz/targets/recording.rs"]
mod recording;

use std::path::Path;

#[test]
fn recordings() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../tests/fuzz/corpus/recording");
    let entries = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut files: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    files.sort();
    assert!(files.len() >= 5, "{} holds only {} inputs", folder.display(), files.len());
    for file in files {
        println!("{}", file.display());
        recording::recording(&std::fs::read(&file).unwrap());
    }
}
