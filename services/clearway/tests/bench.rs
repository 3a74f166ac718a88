//! `clearway bench` as a person runs it. Times are measured, not judged.

use serde_json::Value;
use std::path::Path;
use std::process::{Command, Output};

fn clearway(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_clearway")).args(args).current_dir(root).output().unwrap()
}

fn json(bytes: &[u8]) -> Value {
    serde_json::from_slice(bytes).unwrap()
}

#[test]
fn the_wake_ups_are_measured() {
    let output = clearway(&["bench", "wakeup", "--periods", "50", "--json", "-"]);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let cases = json(&output.stdout)["cases"].as_array().unwrap().clone();
    let alone = |case: &&Value| case["cpus"][0] != case["cpus"][1];
    let names = |cases: Vec<&Value>| {
        cases.iter().map(|case| case["wakeup"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    // Nobody spins where it would keep the other from running.
    assert!(names(cases.iter().filter(|case| !alone(case)).collect()).iter().all(|name| name != "spin"));
    if cases.iter().any(|case| alone(&case)) {
        assert_eq!(names(cases.iter().filter(alone).collect()), ["futex", "spin", "channel"]);
    }
    for case in &cases {
        for times in ["to_worker_ns", "to_loop_ns"] {
            assert!(case[times]["p50"].as_f64().is_some_and(|ns| ns > 0.0), "{times} {case}");
        }
    }
}

/// Few problems, of a scenario that is over soon.
const SMALL: [&str; 6] = ["bench", "solve", "--samples", "60", "--scenarios", "random-20-1@0.1"];

#[test]
fn the_solvers_are_timed_and_agree() {
    let output = clearway(&[SMALL.as_slice(), &["--neighbours", "0,1,3", "--json", "-"]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report = json(&output.stdout);
    assert!(report["machine"]["clock_ns"]["p50"].as_f64().is_some());
    assert!(report["method"]["exact_ns"].as_str().is_some_and(|text| text.contains("clock")));
    let cases = report["cases"].as_array().unwrap();
    assert_eq!(cases.iter().map(|c| c["neighbours"].as_u64()).collect::<Vec<_>>(), [0, 1, 3].map(Some));
    for case in cases {
        assert!(case["samples"].as_u64().is_some_and(|n| n > 0), "{case}");
        for times in ["exact_ns", "clarabel_ns", "clarabel_raw_ns", "clarabel_cold_ns"] {
            let at = |key: &str| case[times][key].as_f64().unwrap();
            let ordered = [at("p50"), at("p99"), at("p999"), at("max")];
            assert!(ordered.is_sorted() && at("p50") > 0.0, "{times} {case}");
        }
        for gap in ["max_objective_gap_rel", "max_input_gap"] {
            assert!(case[gap].as_f64().is_some_and(|g| g < 1e-6), "{gap} {case}");
        }
        assert_eq!(case["not_solved"], 0, "{case}");
    }
}

#[test]
fn the_problems_can_be_exported() {
    let path = std::env::temp_dir().join(format!("clearway-problems-{}.json", std::process::id()));
    let file = path.to_str().unwrap();
    let output = clearway(&[SMALL.as_slice(), &["--neighbours", "2", "--export", file]].concat());
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(String::from_utf8_lossy(&output.stdout).contains("neighbours"), "a table");
    let document = json(&std::fs::read(&path).unwrap());
    std::fs::remove_file(&path).unwrap();
    assert!(document["weights"]["position"].as_f64().is_some());
    let problems = document["cases"][0]["problems"].as_array().unwrap();
    assert!(!problems.is_empty());
    for problem in problems {
        assert_eq!(problem["comfort"].as_array().unwrap().len(), 2, "{problem}");
        assert!(problem["exact"]["objective"].as_f64().is_some(), "{problem}");
    }
}

#[test]
fn wrong_arguments_name_the_remedy() {
    for (args, words) in [
        (["--neighbours", "1000"], "more than 128"),
        (["--scenarios", "swap8@0"], "not a scale"),
        (["--scenarios", "sawp8"], "did you mean"),
        (["--samples", "0"], "--samples"),
    ] {
        let output = clearway(&[["bench", "solve"].as_slice(), &args].concat());
        let shown = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(2), "{shown}");
        assert!(shown.contains(words), "{words}: {shown}");
    }
    let output = clearway(&["bench", "scale", "--robots", "0"]);
    let shown = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(2), "{shown}");
    assert!(shown.contains("from 1 to 100000"), "{shown}");
}

#[test]
fn a_soak_is_sound_across_2_to_the_32() {
    let world = format!("cw_soak_{}_", std::process::id());
    let root = std::env::temp_dir().join(&world);
    let output = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .args(["bench", "soak", "--scenario", "head-on", "--ticks", "2000", "--json", "-"])
        .args(["--first-tick", "4294966296"])
        .env("CLEARWAY_IOX2_PREFIX", &world)
        .env("CLEARWAY_IOX2_ROOT", &root)
        .output()
        .unwrap();
    let left = std::fs::read_dir("/dev/shm").unwrap().flatten().map(|entry| entry.path());
    let left: Vec<_> = left.filter(|path| path.to_string_lossy().contains(&world)).collect();
    for path in &left {
        std::fs::remove_file(path).unwrap();
    }
    let _ = std::fs::remove_dir_all(&root);
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(left.iter().all(|path| path.extension().is_some_and(|e| e == "global_mgmt")), "{left:?}");
    let soak = json(&output.stdout);
    assert_eq!(soak["report"]["ticks"], 2000);
    assert_eq!(soak["inconsistencies"].as_array().map(Vec::len), Some(0), "{soak}");
    assert!(soak["laps"].as_u64().is_some_and(|laps| laps > 10));
    assert!(soak["resident_kib"].as_array().is_some_and(|looks| looks.len() >= 2));
}

#[test]
fn whole_periods_of_a_fleet_are_timed() {
    let run = format!("cwscale{}_", std::process::id());
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let svg = std::env::temp_dir().join(format!("clearway-scale-{}.svg", std::process::id()));
    let output = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .args([
            "bench",
            "scale",
            "--robots",
            "200",
            "--workers",
            "2",
            "--periods",
            "10",
            "--warm-up",
            "3",
            "--slowdown",
            "4",
        ])
        .args(["--json", "-", "--plot", svg.to_str().unwrap()])
        .env("CLEARWAY_IOX2_PREFIX", &run)
        .env("CLEARWAY_IOX2_ROOT", std::env::temp_dir().join(&run))
        .current_dir(root)
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", String::from_utf8_lossy(&output.stderr));
    let report = json(&output.stdout);
    assert_eq!((report["robots"].as_u64(), report["workers"].as_u64()), (Some(200), Some(2)), "{report}");
    assert_eq!(report["budget_ms"].as_f64(), Some(80.0));
    for key in ["neighbours_mean", "ns_per_robot", "deadline_misses", "cut_off", "times_memory_bound"] {
        assert!(report[key].as_f64().is_some(), "{key} {report}");
    }
    let at = |key: &str| report["step_ms"][key].as_f64().unwrap();
    assert!(at("p50") > 0.0 && at("p50") <= at("p99") && at("p99") <= at("max"), "{report}");
    assert_eq!(report["violations"], 0, "{report}");
    // Nothing is lost on the way to the figures, and the warm-up is none of them.
    assert_eq!(report["records_lost"], 0, "{report}");
    assert!(report["periods"].as_u64().is_some_and(|n| (1..=10).contains(&n)), "{report}");
    assert_eq!(report["slowdown"], 4, "{report}");
    let drawn = std::fs::read_to_string(&svg).unwrap();
    std::fs::remove_file(&svg).unwrap();
    let _ = std::fs::remove_dir_all(std::env::temp_dir().join(&run));
    assert!(drawn.starts_with("<svg") || drawn.starts_with("<?xml"), "{drawn}");
}
