//! `clearway doctor` as a person and as a script run it.

use serde_json::Value;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn doctor(args: &[&str]) -> Output {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    Command::new(env!("CARGO_BIN_EXE_clearway")).arg("doctor").args(args).current_dir(root).output().unwrap()
}

fn json(output: &Output) -> Value {
    serde_json::from_slice(&output.stdout).unwrap()
}

/// The smallest tree that holds what has to be there.
struct Tree(PathBuf);

impl Tree {
    fn new(name: &str) -> Self {
        let tree = Self(std::env::temp_dir().join(format!("clearway-doctor-{name}-{}", std::process::id())));
        for (path, text) in [
            (
                "proc/self/limits",
                "Max open files 2000 2000 files\nMax locked memory unlimited unlimited bytes\nMax realtime priority \
                 99 99\n",
            ),
            ("proc/self/status", "CapEff:\t0\nCpus_allowed_list:\t0-1\n"),
            ("proc/sys/kernel/sched_rt_runtime_us", "950000\n"),
            ("proc/version", "Linux version 6.12 PREEMPT_RT\n"),
            ("proc/loadavg", "0.1 0.1 0.1 1/1 1\n"),
            ("proc/mounts", "tmpfs /dev/shm tmpfs rw 0 0\n"),
            ("sys/devices/system/cpu/isolated", "\n"),
            ("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n"),
            ("tmp/keep", ""),
        ] {
            tree.write(path, text);
        }
        tree
    }

    fn write(&self, path: &str, text: &str) {
        let path = self.0.join(path);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }

    fn examined(&self) -> (Option<i32>, Value) {
        let output = doctor(&["--json", "--root", self.0.to_str().unwrap()]);
        (output.status.code(), json(&output))
    }
}

impl Drop for Tree {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

#[test]
fn exit_codes_follow_the_worst_finding() {
    let tree = Tree::new("codes");
    let (code, report) = tree.examined();
    assert_eq!(code, Some(0), "{report:#}");
    assert!(report["warnings"].as_u64().is_some_and(|n| n > 0), "{report:#}");
    std::fs::remove_file(tree.0.join("proc/loadavg")).unwrap();
    assert_eq!(tree.examined().0, Some(2));
    tree.write("proc/mounts", "proc /proc proc rw 0 0\n");
    let (code, report) = tree.examined();
    assert_eq!(
        (code, report["exit_code"].as_u64(), report["failures"].as_u64()),
        (Some(1), Some(1), Some(1))
    );
}

#[test]
fn every_finding_about_this_machine_has_what_it_needs() {
    let output = doctor(&["--json"]);
    let report = json(&output);
    assert_eq!(output.status.code().map(i64::from), report["exit_code"].as_i64(), "{report:#}");
    let findings = report["findings"].as_array().unwrap();
    for name in [
        "scheduling",
        "memlock",
        "governor",
        "thp",
        "isolated_cpus",
        "rt_throttling",
        "clock_source",
        "shared_memory",
        "shared_memory_room",
        "left_over_nodes",
        "preemption",
        "machine",
    ] {
        let found = findings.iter().find(|finding| finding["name"] == name);
        let found = found.unwrap_or_else(|| panic!("{name}: {report:#}"));
        let needs_remedy = found["status"] != "ok";
        assert_eq!(needs_remedy, found["remedy"].as_str().is_some_and(|text| !text.is_empty()), "{found}");
    }
    let text = String::from_utf8(doctor(&[]).stdout).unwrap();
    assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
}

#[test]
fn a_configuration_is_held_against_the_machine() {
    let path = std::env::temp_dir().join(format!("clearway-doctor-{}.toml", std::process::id()));
    std::fs::write(&path, "schema = 1\nscenario = \"swap8\"\n[realtime]\nloop_cpu = 1000\n").unwrap();
    let output = doctor(&["--json", "--config", path.to_str().unwrap()]);
    std::fs::remove_file(&path).unwrap();
    let report = json(&output);
    let cpus = report["findings"].as_array().unwrap().iter().find(|f| f["name"] == "config_cpus").unwrap();
    assert_eq!((cpus["status"].as_str(), output.status.code()), (Some("fail"), Some(1)), "{cpus}");

    let wrong = doctor(&["--config", "no-such.toml"]);
    assert_eq!(wrong.status.code(), Some(2));
    assert!(String::from_utf8_lossy(&wrong.stderr).contains("no-such.toml"));
}
