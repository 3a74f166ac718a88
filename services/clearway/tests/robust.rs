//! `clearway robust` as scripts use it: nobody is too close inside the bounds, and somebody is without
//! the margin.

use serde_json::Value;
use std::process::Command;

#[test]
fn the_quick_suite_has_violations_without_the_margin_only() {
    let output = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .args(["robust", "--quick", "--jsonl", "-"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let text = String::from_utf8(output.stdout).unwrap();
    let runs: Vec<Value> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let violations = |margin: &str| -> (usize, u64) {
        let of = runs.iter().filter(|run| run["margin"] == margin);
        (of.clone().count(), of.map(|run| run["violations"].as_u64().unwrap()).sum())
    };
    assert_eq!((violations("on"), violations("only"), violations("none")), ((60, 0), (20, 0), (4, 0)));
    let (off, violated) = violations("off");
    assert!(off == 20 && violated > 0, "{off} {violated}");
    // Every kind of disturbance is there, and disturbed robots arrive.
    for kind in ["noise", "slip", "lag", "delay", "all"] {
        let of = |run: &&Value| run["kind"] == kind && run["margin"] == "on" && run["pattern"] == "random";
        assert!(runs.iter().filter(of).all(|run| run["arrived"] == run["robots"]), "{kind}");
    }
}
