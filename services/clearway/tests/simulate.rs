//! `clearway simulate` as scripts use it: exit codes, the table, the JSON, and the command that runs a
//! failing seed again.

use std::path::Path;
use std::process::{Command, Output};

use serde_json::Value;

fn simulate(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_clearway")).arg("simulate").args(args).output().unwrap()
}

fn shown(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn json(path: &Path) -> Value {
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::remove_file(path).unwrap();
    serde_json::from_str(&text).unwrap()
}

#[test]
fn seeds_that_hold_are_told_in_a_table_and_as_json() {
    let path = std::env::temp_dir().join(format!("clearway-simulate-{}.json", std::process::id()));
    let file = path.to_str().unwrap();
    let faults = "obs-teleport,cmd-repeated";
    let output = simulate(&["--seeds", "0..4", "--class", "open", "--faults", faults, "--json", file]);
    assert_eq!(output.status.code(), Some(0), "{}", shown(&output.stderr));
    let (table, result) = (shown(&output.stdout), json(&path));
    for row in result["kinds"].as_object().unwrap().keys() {
        assert!(faults.contains(row.as_str()), "{row}");
        assert!(table.lines().any(|line| line.starts_with(row.as_str())), "{row} in {table}");
    }
    let teleport = &result["kinds"]["obs-teleport"];
    assert!(
        teleport["faults"].as_u64().unwrap() > 0 && teleport["counted"] == teleport["faults"],
        "{teleport}"
    );
    assert!(table.contains("rejected_inputs.jump") && table.contains("4 seeds, "), "{table}");
    assert!(table.ends_with("Everything held in all of them.\n"), "{table}");
    assert_eq!((result["seeds"].as_u64(), &result["failed"]), (Some(4), &serde_json::json!([])));
    assert!(result["periods"].as_u64().unwrap() >= 4 * 160 && result["robot_periods"].as_u64() > Some(0));
}

#[test]
fn one_line_a_seed_is_the_same_whoever_runs_it() {
    let run = |jobs| {
        let output = simulate(&["--seeds", "3..7", "--jobs", jobs, "--jsonl", "-"]);
        assert_eq!(output.status.code(), Some(0), "{}", shown(&output.stderr));
        shown(&output.stdout)
    };
    let once = run("1");
    assert_eq!(once, run("3"));
    let lines: Vec<Value> = once.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let seeds: Vec<u64> = lines.iter().filter_map(|line| line["seed"].as_u64()).collect();
    assert_eq!(seeds, [3, 4, 5, 6]);
    assert!(lines.iter().all(|line| line["digest"].as_str().is_some_and(|digest| digest.len() == 16)));
    assert!(lines.iter().all(|line| line["failures"].as_array().is_some_and(Vec::is_empty)));
}

/// A controller that is broken on purpose: the seed says how to see it again, and that no fault is needed.
#[test]
fn a_seed_that_fails_ends_with_1_and_the_command_that_runs_it_again() {
    let args = ["--seeds", "5..6", "--class", "open", "--faults", "obs-teleport,obs-repeated", "--sabotage"];
    let output = simulate(&[&args[..], &["--json", "-"]].concat());
    assert_eq!(output.status.code(), Some(1), "{}", shown(&output.stderr));
    let result: Value = serde_json::from_str(&shown(&output.stdout)).unwrap();
    let failed = &result["failed"][0];
    // What goes out is not what the published states and memories give.
    assert_eq!((failed["seed"].as_u64(), failed["failures"][0]["invariant"].as_str()), (Some(5), Some("e")));

    let replay = failed["replay"].as_str().unwrap();
    assert!(replay.contains(" --only none ") && failed["faults"] == serde_json::json!([]), "{failed}");
    assert!(
        replay.starts_with("clearway simulate --seeds 5..6 ") && replay.ends_with(" --trace"),
        "{replay}"
    );
    let words: Vec<&str> = replay.split_whitespace().skip(2).collect();
    let again = simulate(&words);
    assert_eq!(again.status.code(), Some(1), "{replay}: {}", shown(&again.stderr));
    let told = shown(&again.stdout);
    assert!(told.contains(failed["failures"][0]["values"].as_str().unwrap()), "{told}");
    assert!(told.contains("1 of 1 seeds do not hold.") && told.contains(replay), "{told}");
}

#[test]
fn a_command_line_that_is_wrong_ends_with_2_and_says_what_to_write() {
    for (args, says) in [
        (&["--seeds", "7"][..], "write A..B"),
        (&["--seeds", "7..7"], "A below B"),
        (&["--faults", "gremlins"], "simulate --list"),
        (&["--class", "round"], "one of open"),
        (&["--robots", "1"], "2..=500"),
        (&["--periods", "3"], "32..=1000000"),
        (&["--json", "-", "--jsonl", "-"], "cannot be used with"),
    ] {
        let output = simulate(args);
        assert_eq!(output.status.code(), Some(2), "{args:?}");
        assert!(shown(&output.stderr).contains(says), "{args:?}: {}", shown(&output.stderr));
    }
}

#[test]
fn every_kind_of_fault_and_class_is_listed() {
    let output = simulate(&["--list"]);
    let text = shown(&output.stdout);
    assert_eq!(output.status.code(), Some(0));
    for kind in clearway::simulation::Kind::ALL.iter().filter(|kind| kind.promise().is_fault()) {
        assert!(text.lines().any(|line| line.starts_with(kind.name())), "{kind}");
    }
    assert!(clearway::simulation::Class::ALL.iter().all(|class| text.contains(class.name())));
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let output = simulate(&["--seeds", "0..1", "--json", "/nowhere/result.json"]);
    assert_ne!(output.status.code(), Some(0));
    assert!(
        shown(&output.stderr).contains("/nowhere/result.json cannot be written"),
        "{}",
        shown(&output.stderr)
    );
}
