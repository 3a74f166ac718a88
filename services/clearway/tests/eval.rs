//! `clearway eval` as scripts use it.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn clearway(args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_clearway")).args(args).output().unwrap()
}

fn shown(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

fn json_lines(output: &Output) -> Vec<Value> {
    shown(&output.stdout).lines().map(|line| serde_json::from_str(line).unwrap()).collect()
}

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

#[test]
fn a_sweep_has_a_row_and_an_object_for_every_combination() {
    let sweep = [
        "eval",
        "head-on",
        "--sweep",
        "controller.gamma=0.8..1.0:3",
        "--sweep",
        "controller.barrier=exact,linear",
    ];
    let table = shown(&clearway(&sweep).stdout);
    let mut rows = table.lines();
    let head: Vec<&str> = rows.next().unwrap().split_whitespace().collect();
    assert_eq!(head[..3], ["scenario", "gamma", "barrier"], "{table}");
    let settings: Vec<Vec<&str>> =
        rows.by_ref().take(6).map(|row| row.split_whitespace().skip(1).take(2).collect()).collect();
    assert_eq!(settings[0], ["0.8", "exact"]);
    assert_eq!(settings[3], ["0.9", "linear"]);
    assert_eq!(settings[5], ["1", "linear"]);

    let objects = json_lines(&clearway(&[sweep.as_slice(), &["--jsonl", "-"]].concat()));
    assert_eq!(objects.len(), 6);
    assert_eq!(objects[3]["sweep"]["controller.gamma"], 0.9);
    assert_eq!(objects[3]["sweep"]["controller.barrier"], "linear");
    let plain = json_lines(&clearway(&["eval", "head-on", "--jsonl", "-"]));
    assert!(plain[0].get("sweep").is_none());
}

#[test]
fn a_sweep_changes_what_it_says_and_any_number_of_a_table_can_be_swept() {
    let objects = json_lines(&clearway(&[
        "eval",
        "swap8",
        "--sweep",
        "controller.comfort_gamma=0.2,0.9",
        "--sweep",
        "guidance.lane_gap_m=0.2,0.6",
        "--jsonl",
        "-",
    ]));
    let last = |k: usize| objects[k]["makespan_s"].as_f64().unwrap();
    let alone = json_lines(&clearway(&[
        "eval",
        "swap8",
        "--set",
        "controller.comfort_gamma=0.2",
        "--set",
        "guidance.lane_gap_m=0.6",
        "--jsonl",
        "-",
    ]));
    assert_eq!(Some(last(1)), alone[0]["makespan_s"].as_f64(), "the same as --set");
    assert!(last(0) > last(2) + 1.0 && last(1) > last(3) + 1.0, "a softer rate is slower");
    assert_ne!(objects[2]["min_clearance_m"], objects[3]["min_clearance_m"]);
}

#[test]
fn wrong_settings_name_their_key_and_nothing_runs() {
    for (args, words) in [
        (vec!["--sweep", "controller.gama=0.2..1:3"], "controller.gama: is not a known key"),
        (vec!["--sweep", "controller.gamma=0.5..2:3"], "controller.gamma: has to be above 0"),
        (vec!["--sweep", "guidance.eta=0.1,often"], "guidance.eta"),
        (vec!["--sweep", "controller.gamma=0.2..1"], "0.2..1.0:9"),
        (vec!["--sweep", "scenario=swap8,swap8-zero"], "scenarios are named as arguments"),
        (vec!["--profile", "exp", "--sweep", "controller.profile=exp,paper"], "swept and given"),
        (vec!["--set", "controller.gamma=fast"], "controller.gamma"),
        (vec!["--plant", "round"], "exact, euler"),
        (vec!["--timing", "late"], "let, ideal"),
    ] {
        let output = clearway(&[["eval", "head-on"].as_slice(), &args].concat());
        let error = shown(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{args:?}: {error}");
        assert!(error.contains(words), "{args:?}: {error}");
        assert!(output.stdout.is_empty());
    }
}

#[test]
fn a_folder_is_its_scenario_files_in_order_of_name() {
    let folder = std::env::temp_dir().join(format!("clearway-folder-{}", std::process::id()));
    std::fs::create_dir_all(folder.join("deeper.toml")).unwrap();
    for (file, scenario) in [("b.toml", "head-on"), ("a.toml", "circle-3"), ("notes.md", "circle-2")] {
        std::fs::write(folder.join(file), clearway(&["scenario", scenario]).stdout).unwrap();
    }
    let path = folder.to_str().unwrap();
    let results = json_lines(&clearway(&["eval", path, "circle-2", "--jsonl", "-"]));
    let names: Vec<&str> = results.iter().map(|r| r["scenario"].as_str().unwrap()).collect();
    assert_eq!(names, ["circle-3", "head-on", "circle-2"]);

    std::fs::write(folder.join("c.toml"), "schema = 1\nname = 7\n").unwrap();
    let broken = clearway(&["eval", path]);
    assert_eq!(broken.status.code(), Some(2));
    assert!(shown(&broken.stderr).contains("c.toml"), "{}", shown(&broken.stderr));
    std::fs::remove_dir_all(&folder).unwrap();

    std::fs::create_dir(&folder).unwrap();
    let empty = clearway(&["eval", path]);
    std::fs::remove_dir(&folder).unwrap();
    assert_eq!(empty.status.code(), Some(2));
    assert!(shown(&empty.stderr).contains("has no .toml file"));
}

#[test]
fn everything_but_the_times_is_the_same_however_many_run_at_once() {
    let run = |jobs: &str| {
        let names = ["eval", "random-8-1", "swap8", "circle-4", "random-8-2", "--jsonl", "-", "--jobs", jobs];
        let mut objects = json_lines(&clearway(&names));
        for object in &mut objects {
            for time in ["solve_ns", "fleet_step_ns", "step_ns_per_robot"] {
                assert!(object.as_object_mut().unwrap().remove(time).is_some());
            }
        }
        objects
    };
    assert_eq!(run("1"), run("4"));
}

#[test]
fn the_papers_plant_cuts_corners_and_its_clearance_is_along_straight_lines() {
    let of = |plant: &str| {
        let args = ["eval", "swap8-zero", "--timing", "ideal", "--plant", plant, "--jsonl", "-"];
        json_lines(&clearway(&args)).remove(0)
    };
    let (exact, euler) = (of("exact"), of("euler"));
    assert_eq!((&exact["plant"], &euler["plant"]), (&"exact".into(), &"euler".into()));
    assert_eq!(euler["timing"], "ideal");
    let gap = |run: &Value| run["min_clearance_m"].as_f64().unwrap();
    assert!((gap(&exact) - gap(&euler)).abs() > 1e-6, "another motion");
    assert_eq!(euler["arrived"], 8);
}

#[test]
fn the_table_fits_a_terminal_unless_it_is_to_be_wide() {
    let names = ["eval", "head-on", "parked-wall-wide-15", "--sweep", "controller.comfort_gamma=0.25,0.75"];
    let width = |args: &[&str]| {
        let table = shown(&clearway(&[names.as_slice(), args].concat()).stdout);
        table.lines().map(|line| line.chars().count()).max().unwrap()
    };
    assert!(width(&[]) <= 80);
    assert!(width(&["--wide"]) > 80);
    let markdown = shown(&clearway(&[names.as_slice(), &["--markdown"]].concat()).stdout);
    let cells = |row: &str| row.replace("\\|", "").matches('|').count();
    assert!(markdown.lines().all(|row| cells(row) == cells(markdown.lines().next().unwrap())));
    assert!(!markdown.contains("steps/s"), "a document is the same on every machine");
}

#[test]
fn the_documents_claims_are_what_the_command_prints() {
    let claims = [
        "eval",
        "swap8",
        "swap8-zero",
        "swap8-heading-0..99",
        "--sweep",
        "controller.profile=certified,exp,paper",
        "--markdown",
    ];
    let table = shown(&clearway(&claims).stdout);
    assert_eq!(table.lines().count(), 2 + 9, "{table}");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/EVALUATION.md");
    let document = std::fs::read_to_string(path).unwrap();
    for row in table.lines() {
        assert!(document.contains(row), "docs/EVALUATION.md lacks this row of its table:\n{row}");
    }
}
