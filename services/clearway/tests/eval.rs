//! `clearway eval` as scripts use it.

use serde_json::Value;
use std::path::Path;
use std::process::Command;

fn lines(path: &Path) -> Vec<Value> {
    let text = std::fs::read_to_string(path).unwrap();
    std::fs::remove_file(path).unwrap();
    text.lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

#[test]
fn trajectories_hold_every_period_from_the_starts_to_the_goals() {
    let file =
        |kind: &str| std::env::temp_dir().join(format!("clearway-{kind}-{}.jsonl", std::process::id()));
    let (results, trajectories) = (file("results"), file("trajectories"));
    let scenarios = ["circle-10", "head-on", "circle-2"];
    let output = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .arg("eval")
        .args(scenarios)
        .args(["--jobs", "2", "--jsonl"])
        .arg(&results)
        .arg("--trajectories")
        .arg(&trajectories)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));

    let (results, trajectories) = (lines(&results), lines(&trajectories));
    assert_eq!((results.len(), trajectories.len()), (3, 3));
    for ((name, result), run) in scenarios.iter().zip(&results).zip(&trajectories) {
        assert_eq!(result["scenario"], *name);
        assert_eq!(run["scenario"], *name);
        assert_eq!(run["columns"][3], "v_mps");
        assert_eq!(result["fleet_step_ns"]["count"], result["steps"]);
        let periods = run["states"].as_array().unwrap();
        assert_eq!(Some(periods.len() as u64), result["steps"].as_u64());
        let robots = run["ids"].as_array().unwrap().len();
        assert_eq!(Some(robots as u64), result["robots"].as_u64());
        assert!(periods.iter().all(|fleet| fleet.as_array().unwrap().len() == robots));

        // Antipodal goals: every robot ends where it mirrors its start, and stands.
        let number = |period: &Value, robot: usize, column: usize| period[robot][column].as_f64().unwrap();
        let (first, last) = (&periods[0], &periods[periods.len() - 1]);
        for robot in 0..robots {
            let miss = [0, 1].map(|axis| number(first, robot, axis) + number(last, robot, axis));
            assert!(miss[0].hypot(miss[1]) <= 0.05, "{name} {robot}: {miss:?}");
            assert_eq!((number(last, robot, 3), number(last, robot, 4)), (0.0, 0.0));
        }
        // The next pose is the arc's: at most v T away.
        for pair in periods.windows(2) {
            for robot in 0..robots {
                let moved = [0, 1].map(|axis| number(&pair[1], robot, axis) - number(&pair[0], robot, axis));
                let arc = number(&pair[0], robot, 3) * run["period_s"].as_f64().unwrap();
                assert!((moved[0].hypot(moved[1]) - arc).abs() < 1e-3, "{name} {robot}");
            }
        }
    }
}

#[test]
fn a_file_that_cannot_be_written_is_named() {
    let output = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .args(["eval", "head-on", "--trajectories", "/nowhere/at/all.jsonl"])
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&output.stderr).contains("/nowhere/at/all.jsonl"));
}
