//! The daemon where the machine grants less than it asks for.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::path::Path;
use std::process::Command;

use clearway::attach::Client;
use rustix::process::{Resource, Rlimit, Signal, getrlimit, prlimit};
use support::World;
use support::process::{Process, file, text, until, within};
use support::sandbox::{without_rights, wrapped};

fn daemon(world: &World, arguments: &[&str]) -> Command {
    within(world, Path::new(env!("CARGO_BIN_EXE_clearwayd")), arguments)
}

#[test]
fn without_rights_a_daemon_refuses_under_require_and_says_degraded_under_prefer() {
    let world = World::new("rights");
    let rights = |policy: &str, more: &[&str]| {
        let mut command = daemon(&world, &["--set", &format!("realtime.policy={policy}")]);
        command.args(more);
        without_rights("a daemon without rights", &command).map(|command| Process::start(command).output())
    };
    let Some(refused) = rights("require", &[]) else { return };
    let said = text(&refused.stderr);
    assert_eq!(refused.status.code(), Some(4), "{said}");
    assert!(said.contains("SCHED_FIFO") && said.contains("memory is not locked"), "{said}");
    assert!(said.contains("LimitRTPRIO") || said.contains("CAP_SYS_NICE"), "{said}");

    let Some(run) = rights("prefer", &["--report", "report.json"]) else { return };
    let said = text(&run.stderr);
    assert_eq!(run.status.code(), Some(0), "{said}");
    assert!(said.matches("DEGRADED").count() >= 2, "{said}");
    let report = std::fs::read_to_string(world.channel.root.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    let realtime = &report["realtime"];
    assert_eq!(
        (realtime["policy"].as_str(), realtime["memory_locked"].as_bool()),
        (Some("other"), Some(false))
    );
    assert!(realtime["degraded"].as_array().is_some_and(|list| list.len() >= 2), "{realtime}");
    assert_eq!((report["arrived"].as_u64(), report["violations"].as_u64()), (Some(8), Some(0)));
}

#[test]
fn a_daemon_without_file_descriptors_is_refused_and_leaves_no_shared_memory() {
    let world = World::new("descriptors");
    for files in [5, 8, 12, 20, 30, 40] {
        let limited = format!("ulimit -n {files} && exec \"$@\"");
        let plain = daemon(&world, &["--quiet", "--set", "realtime.policy=off"]);
        let run = Process::start(wrapped(&plain, &["sh", "-c", &limited, "sh"])).output();
        let said = text(&run.stderr);
        assert_eq!(run.status.code(), Some(5), "{files}: {said}");
        assert!(said.contains("help:") && !said.contains("panicked"), "{files}: {said}");
    }
}

#[test]
fn a_daemon_that_runs_out_of_file_descriptors_goes_on_commanding() {
    let world = World::new("exhausted");
    let fleet =
        "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 10_000\n[realtime]\npolicy = \"off\"\n";
    let config = file(&world, "fleet.toml", fleet);
    let control =
        Process::start(daemon(&world, &["--quiet", "--config", &config, "--report", "report.json"]));
    let client = until(|| Client::connect_at("default", &world.channel).ok());
    let mut commands = until(|| client.commands().ok());
    until(|| commands.newest().unwrap().filter(|sample| sample.header().tick > 2).map(|_| ()));
    // No more than it has now.
    let open = std::fs::read_dir(format!("/proc/{}/fd", control.0.id())).unwrap().count() as u64;
    let before = getrlimit(Resource::Nofile);
    let limit = Rlimit { current: Some(open), maximum: before.maximum };
    prlimit(Some(control.id()), Resource::Nofile, limit).unwrap();
    // Others come, and ask.
    let others: Vec<_> = (0..6).map(|_| Client::connect_at("default", &world.channel).unwrap()).collect();
    let _readers: Vec<_> = others.iter().map(|other| other.states().unwrap()).collect();
    let mut admin = others[0].admin().unwrap().with_timeout(std::time::Duration::from_millis(300));
    let _ = admin.status();
    let from = until(|| commands.newest().unwrap().map(|sample| sample.header().tick));
    until(|| commands.newest().unwrap().filter(|sample| sample.header().tick > from + 100).map(|_| ()));
    // With room again it answers again.
    prlimit(Some(control.id()), Resource::Nofile, before).unwrap();
    let mut admin = client.admin().unwrap().with_timeout(std::time::Duration::from_secs(30));
    let status = admin.status().unwrap();
    assert_eq!(status.figures.worker_panics, 0);
    let said = status.degraded.join("\n");
    assert!(said.contains("could not be connected") && said.contains("LimitNOFILE"), "{said}");
    control.signal(Signal::TERM);
    control.succeed();
    let report = std::fs::read_to_string(world.channel.root.join("report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!((report["ended_by"].as_str(), report["violations"].as_u64()), (Some("operator"), Some(0)));
    assert!(report["attach_failures"].as_u64() >= Some(1), "{report}");
}
