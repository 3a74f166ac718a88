//! `clearway check` and `clearway scenario` as a person runs them.

use std::path::Path;
use std::process::{Command, Output};

fn clearway(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_clearway")).args(args).current_dir(root).output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

#[test]
fn sound_input_is_summarised_and_exits_0() {
    for (file, words) in [
        ("docs/examples/clearway.toml", "a sound configuration"),
        ("docs/examples/crossing.toml", "3, ids 0 to 10, radius 0.15 to 0.2 m, 1 parked"),
        ("circle-10", "a sound scenario"),
    ] {
        let output = clearway(&["check", file]);
        assert_eq!(output.status.code(), Some(0), "{file}: {}", text(&output.stderr));
        assert!(text(&output.stdout).contains(words), "{file}: {}", text(&output.stdout));
    }
}

#[test]
fn wrong_input_shows_the_line_and_the_remedy_and_exits_2() {
    let path = std::env::temp_dir().join(format!("clearway-check-{}.toml", std::process::id()));
    std::fs::write(&path, "schema = 1\nscenario = \"swap8\"\n[controller]\ngama = 0.5\n").unwrap();
    let output = clearway(&["check", path.to_str().unwrap()]);
    std::fs::remove_file(&path).unwrap();
    let shown = text(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "{shown}");
    for words in [":4: ", "gama = 0.5", "did you mean `gamma`?"] {
        assert!(shown.contains(words), "{words}: {shown}");
    }
    assert_eq!(clearway(&["check", "no-such.toml"]).status.code(), Some(2));
    assert_eq!(clearway(&["check"]).status.code(), Some(2));
}

#[test]
fn a_printed_scenario_is_sound() {
    let printed = clearway(&["scenario", "doorway-both-6"]).stdout;
    let path = std::env::temp_dir().join(format!("clearway-printed-{}.toml", std::process::id()));
    std::fs::write(&path, printed).unwrap();
    let output = clearway(&["check", path.to_str().unwrap()]);
    std::fs::remove_file(&path).unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    assert!(text(&clearway(&["scenario"]).stdout).contains("random-N-SEED"));
}
