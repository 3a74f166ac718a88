//! `clearway bench latency` as a person and as a script run it. Times are measured, not judged.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::path::{Path, PathBuf};
use std::process::{Child, Command, ExitStatus, Output, Stdio};
use std::time::{Duration, Instant};

use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use support::process::skipped;

/// Far longer than any of this takes.
const PATIENCE: Duration = Duration::from_secs(120);

/// Short, and with every party.
const SHORT: [&str; 6] = ["bench", "latency", "--period-us", "1000", "--samples", "40"];

fn clearway() -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_clearway"));
    command.stdin(Stdio::null()).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap_or_else(|e| panic!("{e}: {}", text(&output.stderr)))
}

/// Processes and files of the run with this process id.
fn left_by(pid: u32) -> (Vec<u32>, Vec<PathBuf>) {
    let mark = format!("clearway_bench_{pid}_");
    let entries =
        |path: &str| std::fs::read_dir(path).unwrap().flatten().map(|entry| entry.path()).collect::<Vec<_>>();
    let processes = entries("/proc").into_iter().filter_map(|path| {
        let id = path.file_name()?.to_str()?.parse().ok()?;
        let line = std::fs::read(path.join("cmdline")).ok()?;
        text(&line).contains(&mark).then_some(id)
    });
    let files = entries("/dev/shm").into_iter().filter(|path| path.to_string_lossy().contains(&mark));
    (processes.collect(), files.collect())
}

fn wait(child: &mut Child) -> ExitStatus {
    until(|| child.try_wait().unwrap())
}

fn until<T>(mut look: impl FnMut() -> Option<T>) -> T {
    let end = Instant::now() + PATIENCE;
    while Instant::now() < end {
        if let Some(found) = look() {
            return found;
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    panic!("it takes too long");
}

/// A run that goes on for minutes, once its load is there.
fn long_run() -> Child {
    let mut child =
        clearway().args(["bench", "latency", "--samples", "100000", "--load", "churn"]).spawn().unwrap();
    let id = child.id();
    until(|| {
        assert!(child.try_wait().unwrap().is_none(), "it ended early");
        (!left_by(id).0.is_empty()).then_some(())
    });
    child
}

#[test]
fn a_short_run_has_every_figure_and_leaves_nothing() {
    let directory = std::env::temp_dir().join(format!("clearway-latency-{}", std::process::id()));
    std::fs::create_dir_all(&directory).unwrap();
    let svg = directory.join("latency.svg");
    let run = clearway()
        .args(SHORT)
        .args(["--load", "idle,churn", "--json", "-", "--svg"])
        .arg(&svg)
        .spawn()
        .unwrap();
    let id = run.id();
    let output = run.wait_with_output().unwrap();
    let report = json(&output);
    assert_eq!((report["period_ns"].as_u64(), report["samples"].as_u64()), (Some(1_000_000), Some(40)));

    // Called real-time only when nothing was refused, and the exit status says the same.
    let refused = report["realtime"]["degraded"].as_array().unwrap().len();
    let label = if refused == 0 { "real time" } else { "best effort" };
    assert_eq!(report["label"], label);
    assert_eq!(output.status.code(), Some(i32::from(refused > 0)), "{}", text(&output.stderr));
    for key in ["policy", "priority", "cpus", "memory_locked"] {
        assert!(!report["realtime"][key].is_null(), "{key}");
    }
    for key in ["kernel", "cpu", "clock_ns"] {
        assert!(!report["machine"][key].is_null(), "{key}");
    }
    assert_eq!(report["host"]["clock"], "CLOCK_MONOTONIC");

    let loads = report["loads"].as_array().unwrap();
    assert_eq!(loads.iter().map(|run| run["load"].as_str().unwrap()).collect::<Vec<_>>(), ["idle", "churn"]);
    for run in loads.iter().chain([&report]) {
        for (figure, count) in [
            ("release_lateness_ns", 40),
            ("channel_ns", 1),
            ("channel_command_ns", 1),
            ("channel_own_process_ns", 1),
            ("state_to_command_ns", 1),
            ("command_to_reader_ns", 1),
            ("step_ns", 1),
        ] {
            let at = |key: &str| run[figure][key].as_u64().unwrap_or_else(|| panic!("{figure}.{key} {run}"));
            let ordered = [at("p50"), at("p90"), at("p99"), at("p999"), at("p9999"), at("max")];
            assert!(ordered.is_sorted() && at("max") > 0, "{figure} {ordered:?}");
            assert!(at("count") >= count, "{figure} {}", at("count"));
        }
    }
    for run in loads {
        let steps = run["histograms"]["release_lateness_ns"].as_array().unwrap();
        assert_eq!(steps.iter().map(|step| step[1].as_u64().unwrap()).sum::<u64>(), 40);
    }
    assert!(loads[1]["rounds"].as_u64().is_some_and(|visits| visits > 0), "nobody joined");
    if report["realtime"]["cpus"].as_array().unwrap().len() > 1 && refused == 0 {
        assert!(report["against_iceoryx2"]["ratio"].as_f64().is_some_and(|ratio| ratio > 0.0));
    }

    let drawn = std::fs::read_to_string(&svg).unwrap();
    std::fs::remove_dir_all(&directory).unwrap();
    let tree = roxmltree::Document::parse(&drawn).unwrap();
    assert!(tree.descendants().any(|node| node.text().is_some_and(|text| text.trim() == "release lateness")));
    assert_eq!(left_by(id), (vec![], vec![]));
}

/// Runs without the rights to be real-time, however this test has come by them.
#[test]
fn refused_calls_are_told_and_no_figure_is_called_real_time() {
    let drop = ["--bounding-set=-sys_nice,-ipc_lock", "--inh-caps=-sys_nice,-ipc_lock"];
    let limits = ["--rtprio=0:0", "--memlock=65536:65536"];
    let tools = [vec!["setpriv", drop[0], drop[1], "true"], vec!["prlimit", limits[0], limits[1], "true"]];
    for tool in &tools {
        if !Command::new(tool[0]).args(&tool[1..]).status().is_ok_and(|status| status.success()) {
            skipped("bench latency without rights", &format!("{} cannot take them away here", tool[0]));
            return;
        }
    }
    let powerless = |more: &[&str]| {
        let mut command = Command::new("prlimit");
        command.args(limits).arg("setpriv").args(drop).arg(env!("CARGO_BIN_EXE_clearway"));
        command.args(SHORT).args(["--load", "idle"]).args(more).stdin(Stdio::null());
        command.output().unwrap()
    };
    let output = powerless(&["--json", "-"]);
    let report = json(&output);
    assert_eq!(output.status.code(), Some(1), "{}", text(&output.stderr));
    assert_eq!(
        (report["label"].as_str(), report["realtime"]["policy"].as_str()),
        (Some("best effort"), Some("other"))
    );
    assert_eq!(report["realtime"]["memory_locked"], false);
    let refused = report["realtime"]["degraded"].to_string();
    assert!(refused.contains("SCHED_FIFO") && refused.contains("memory is not locked"), "{refused}");

    let table = text(&powerless(&[]).stdout);
    assert!(table.contains("BEST EFFORT, NOT REAL TIME") && !table.starts_with("REAL TIME"), "{table}");
    assert!(table.lines().all(|line| line.chars().count() <= 80), "{table}");

    let output = powerless(&["--require"]);
    assert_eq!((output.status.code(), output.stdout.len()), (Some(2), 0));
    assert!(text(&output.stderr).contains("clearway doctor"), "{}", text(&output.stderr));
}

#[test]
fn an_interrupted_run_ends_what_it_started() {
    for signal in [Signal::INT, Signal::TERM] {
        let mut run = long_run();
        let id = run.id();
        kill_process(Pid::from_child(&run), signal).unwrap();
        assert_eq!(wait(&mut run).code(), Some(2));
        assert_eq!(left_by(id), (vec![], vec![]));
    }
}

#[test]
fn a_killed_run_takes_its_processes_along_and_the_next_one_tidies_up() {
    let mut run = long_run();
    let id = run.id();
    run.kill().unwrap();
    wait(&mut run);
    until(|| left_by(id).0.is_empty().then_some(()));
    let output = clearway().args(SHORT).args(["--load", "idle", "--json", "-"]).output().unwrap();
    assert!(output.status.code().is_some_and(|code| code < 2), "{}", text(&output.stderr));
    assert_eq!(left_by(id), (vec![], vec![]));
}

#[test]
fn a_missing_cyclictest_is_told_with_the_way_to_get_it() {
    let output =
        clearway().args(SHORT).args(["--against", "cyclictest"]).env("PATH", "/nowhere").output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).contains("apt-get install rt-tests"), "{}", text(&output.stderr));
}

#[test]
fn cyclictest_takes_turns_and_the_ratio_is_told() {
    let there = |path: &str| Path::new(path).join("cyclictest").is_file();
    if !std::env::var("PATH").is_ok_and(|paths| paths.split(':').any(there)) {
        skipped("bench latency against cyclictest", "it is not installed (apt-get install rt-tests)");
        return;
    }
    let args = ["--load", "idle", "--against", "cyclictest", "--json", "-"];
    let output = clearway().args(SHORT).args(args).output().unwrap();
    if text(&output.stderr).contains("refused:") {
        skipped("bench latency against cyclictest", "it needs the rights that were refused here");
        return;
    }
    let compared = &json(&output)["against_cyclictest"];
    let counts = ["release_lateness_ns", "cyclictest_ns"].map(|key| compared[key]["count"].as_u64());
    assert_eq!(counts[0], counts[1], "{compared}");
    assert!(counts[0].is_some_and(|count| count >= 40), "{compared}");
    for key in ["p50", "p99", "p999", "max"] {
        assert!(compared["ratio"][key].as_f64().is_some_and(|ratio| ratio > 0.0), "{key} {compared}");
    }
}

#[test]
fn wrong_arguments_are_refused() {
    for (args, words) in [
        (["--period-us", "100"], "200..=1000000"),
        (["--priority", "100"], "1..=99"),
        (["--load", "earthquake"], "churn"),
        (["--wakeup", "prod"], "futex"),
    ] {
        let output = clearway().args(["bench", "latency"]).args(args).output().unwrap();
        assert_eq!(output.status.code(), Some(2));
        assert!(text(&output.stderr).contains(words), "{words}: {}", text(&output.stderr));
    }
}
