//! The system calls of the real-time threads in steady state, as strace sees them.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use rustix::process::Signal;
use support::World;
use support::process::{Process, file, skipped, until, within};

/// The clock's sleep, the event count's wait and wake, and what the kernel makes of a sleep that a
/// tracer interrupted. Reading the clock is not a system call.
const ALLOWED: [&str; 3] = ["clock_nanosleep", "futex", "restart_syscall"];
/// Thread ids by name, once the daemon has all of them.
fn threads(daemon: &Process) -> BTreeMap<String, String> {
    let tasks = format!("/proc/{}/task", daemon.0.id());
    until(|| {
        let entries = std::fs::read_dir(&tasks).into_iter().flatten().flatten();
        let named = entries.filter_map(|entry| {
            let name = std::fs::read_to_string(entry.path().join("comm")).ok()?;
            Some((name.trim().to_owned(), entry.file_name().to_string_lossy().into_owned()))
        });
        let named: BTreeMap<_, _> = named.collect();
        named.contains_key("clearway-house").then_some(named)
    })
}

/// Calls that a thread made while it was watched, by name; `None` when it cannot be watched here.
fn calls(thread: &str, out: &Path, enough: usize) -> Option<BTreeMap<String, usize>> {
    let strace = Command::new("strace")
        .args(["-qq", "-p", thread, "-o"])
        .arg(out)
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .spawn();
    let mut strace = Process(strace.ok()?);
    let text = || std::fs::read_to_string(out).unwrap_or_default();
    let refused = until(|| match strace.0.try_wait().unwrap() {
        Some(_) => Some(true),
        None => (text().lines().count() >= enough).then_some(false),
    });
    if refused {
        return None;
    }
    strace.signal(Signal::INT);
    strace.wait();
    let mut calls = BTreeMap::new();
    for line in text().lines().filter(|line| !line.starts_with(['-', '+'])) {
        // A call that returns later is printed in two parts.
        let name = line.trim_start_matches("<... ").split(['(', ' ']).next().unwrap_or_default();
        *calls.entry(name.to_owned()).or_default() += 1;
    }
    Some(calls)
}

#[test]
fn the_loop_and_the_workers_call_only_to_sleep_and_to_wake() {
    let world = World::new("syscalls");
    let fleet = "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 5_000\nworkers = 2\n[realtime]\npolicy = \"off\"\n";
    let config = file(&world, "fleet.toml", fleet);
    let program = Path::new(env!("CARGO_BIN_EXE_clearwayd"));
    let daemon = Process::start(within(&world, program, &["--quiet", "--config", &config]));
    let threads = threads(&daemon);
    // Connections are made and lazily built parts woken.
    std::thread::sleep(Duration::from_millis(500));
    for (name, enough) in
        [("clearway-loop", 400), ("clearway-w0", 200), ("clearway-w1", 200), ("clearway-house", 700)]
    {
        let out = world.channel.root.join(name);
        let Some(calls) = calls(&threads[name], &out, enough) else {
            skipped("system calls of a period", "strace is not installed, or may not attach here");
            break;
        };
        println!("{name}: {calls:?}");
        assert!(calls.values().sum::<usize>() > enough / 2, "{name}: {calls:?}");
        let others = calls.keys().any(|call| !ALLOWED.contains(&call.as_str()));
        // Housekeeping looks after dead processes: what it is there for shows that others would be seen.
        assert_eq!(others, name == "clearway-house", "{name}: {calls:?}");
    }
    daemon.signal(Signal::INT);
    daemon.succeed();
}
