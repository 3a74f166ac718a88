//! The daemon as a process, watched by other processes over real shared memory.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::time::Duration;

use clearway::channel::{Attachment, CommandReader, StateReader, Transport};
use clearway::config::ChannelConfig;
use clearway::wire::StopReason;
use rustix::process::Signal;
use support::World;
use support::process::{Process, file, text, until, within};

fn daemon(world: &World, arguments: &[&str]) -> Process {
    let program = Path::new(env!("CARGO_BIN_EXE_clearwayd"));
    let mut command = within(world, program, &["--set", "realtime.policy=off"]);
    command.args(arguments);
    Process::start(command)
}

/// A configuration file, which makes the daemon run until a signal.
fn endless(world: &World) -> String {
    file(world, "fleet.toml", "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 10_000\n")
}

fn attach(channel: &ChannelConfig) -> Attachment {
    Transport::new("default", channel).unwrap().attach("test").unwrap()
}

/// The newest state's epoch and tick.
fn newest(states: &mut StateReader) -> Option<(u64, u64)> {
    states.newest().unwrap().map(|sample| (sample.header().epoch, sample.header().tick))
}

fn report(path: &PathBuf) -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// Not a test of its own: what the watching process runs. It reports what it saw on standard output.
#[test]
fn watcher_process() {
    if std::env::var_os("CLEARWAY_TEST_WATCH").is_none() {
        return;
    }
    let node = attach(&ChannelConfig::default().with_environment());
    let mut states: StateReader = node.reader_or_create(8).unwrap();
    let mut commands: CommandReader = node.reader_or_create(8).unwrap();
    println!("watching");
    let (mut state_ticks, mut command_ticks) = (Vec::new(), Vec::new());
    let finished = [StopReason::Finished as u32; 8];
    let mut over = false;
    while !over {
        while let Some(sample) = commands.next().unwrap() {
            command_ticks.push(sample.header().tick);
            over = sample.robots().iter().map(|c| c.stop_reason).eq(finished);
        }
        while let Some(sample) = states.next().unwrap() {
            state_ticks.push(sample.header().tick);
        }
        std::thread::sleep(Duration::from_millis(5));
    }
    println!("states {state_ticks:?}");
    println!("commands {command_ticks:?}");
}

fn watcher(world: &World) -> (Process, BufReader<impl Read>) {
    let program = std::env::current_exe().unwrap();
    let mut command = within(world, &program, &["--exact", "watcher_process", "--nocapture"]);
    command.env("CLEARWAY_TEST_WATCH", "1");
    let mut process = Process::start(command);
    let lines = BufReader::new(process.0.stdout.take().unwrap());
    (process, lines)
}

/// Reads lines until one starts with `start`; returns the rest of it.
fn line(lines: &mut impl BufRead, start: &str) -> String {
    let mut line = String::new();
    loop {
        line.clear();
        assert_ne!(lines.read_line(&mut line).unwrap(), 0, "no line starts with {start:?}");
        // The test harness writes the test's name before its first line.
        if let Some(at) = line.find(start) {
            return line[at + start.len()..].trim().to_owned();
        }
    }
}

fn ticks(list: &str) -> Vec<u64> {
    serde_json::from_str(list).unwrap()
}

#[test]
fn another_process_sees_every_tick_of_the_whole_swap() {
    let world = World::new("swap");
    let (mut watching, mut lines) = watcher(&world);
    line(&mut lines, "watching");
    let out = world.channel.root.join("report.json");
    let run = daemon(&world, &["--report", &out.to_string_lossy()]).output();
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stdout).contains("arrived"), "{}", text(&run.stdout));
    let report = report(&out);
    assert_eq!((report["arrived"].as_u64(), report["violations"].as_u64()), (Some(8), Some(0)));
    assert_eq!(report["ended_by"], "finished");

    let states = ticks(&line(&mut lines, "states"));
    let commands = ticks(&line(&mut lines, "commands"));
    assert!(watching.wait().success());
    // Everything that was published was seen, in order, from the first tick on.
    assert_eq!(report["ticks"].as_u64(), Some(states.len() as u64));
    assert_eq!((states[0], commands[0]), (0, 0));
    assert!(states.is_sorted_by(|a, b| a < b) && commands.is_sorted_by(|a, b| a < b));
    let skipped = report["skipped_periods"].as_u64().unwrap();
    assert_eq!(states[states.len() - 1] + 1, states.len() as u64 + skipped);
    if report["deadline_misses"] == 0 {
        // One for the start, one to answer each state, one to stop at the end.
        assert_eq!(commands, (0..states.len() as u64 + 2).collect::<Vec<_>>());
    }
}

#[test]
fn sigterm_sends_a_last_stop_and_ends_in_order() {
    for signal in [Signal::TERM, Signal::INT] {
        let world = World::new("signal");
        let out = world.channel.root.join("report.json");
        let process = daemon(&world, &["--config", &endless(&world), "--report", &out.to_string_lossy()]);
        let node = attach(&world.channel);
        let mut commands: CommandReader = until(|| node.reader().ok());
        let moving = |c: &clearway::wire::RobotCommand| c.stop_reason == 0;
        until(|| commands.newest().unwrap().filter(|sample| sample.robots().iter().any(moving)));
        process.signal(signal);
        let run = process.output();
        assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
        let last = commands.newest().unwrap().unwrap();
        assert!(last.robots().iter().all(|c| c.stop_reason == StopReason::Operator as u32));
        assert!(last.robots().iter().all(|c| (c.v_mps, c.omega_radps) == (0.0, 0.0)));
        assert_eq!(report(&out)["ended_by"], "operator");
    }
}

#[test]
fn a_second_daemon_is_refused_and_told_who_owns_the_fleet() {
    let world = World::new("owner");
    let config = endless(&world);
    let first = daemon(&world, &["--config", &config]);
    let node = attach(&world.channel);
    let mut states: StateReader = until(|| node.reader().ok());
    until(|| newest(&mut states));
    let second = daemon(&world, &[]).output();
    assert_eq!(second.status.code(), Some(3));
    let message = text(&second.stderr);
    assert!(message.contains(&format!("process {}", first.0.id())), "{message}");
    assert!(message.contains("clearwayd") && message.contains("--fleet"), "{message}");
    // Another fleet is another matter, and the first has not noticed anything.
    let other = daemon(&world, &["--config", &config, "--fleet", "other", "--ticks", "3"]).output();
    assert_eq!(other.status.code(), Some(1), "it cannot have arrived: {}", text(&other.stderr));
    let (_, tick) = until(|| newest(&mut states));
    until(|| newest(&mut states).filter(|(_, later)| *later > tick));
    first.signal(Signal::TERM);
    assert_eq!(first.output().status.code(), Some(0));
}

#[test]
fn readers_come_and_go() {
    let world = World::new("readers");
    let process = daemon(&world, &["--config", &endless(&world)]);
    let mut last = 0;
    for _ in 0..20 {
        let node = attach(&world.channel);
        let mut states: StateReader = until(|| node.reader().ok());
        let (_, tick) = until(|| newest(&mut states).filter(|(_, tick)| *tick > last));
        last = tick;
    }
    process.signal(Signal::TERM);
    let run = process.output();
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
}

#[test]
fn a_killed_daemon_leaves_commands_that_expire_and_its_successor_a_new_epoch() {
    let world = World::new("killed");
    let config = endless(&world);
    let node = attach(&world.channel);
    let mut states: StateReader = node.reader_or_create(8).unwrap();
    let mut commands: CommandReader = node.reader_or_create(8).unwrap();
    let mut first = daemon(&world, &["--config", &config]);
    let (old_epoch, _) = until(|| newest(&mut states).filter(|(_, tick)| *tick > 3));
    first.signal(Signal::KILL);
    first.wait();
    let left = commands.newest().unwrap().unwrap();
    assert!(left.header().valid_until_ns < left.header().stamp_ns + 40_000_000);
    drop(left);
    // The reader that stayed hears the successor without doing anything.
    let second = daemon(&world, &["--config", &config]);
    let (epoch, _) = until(|| newest(&mut states).filter(|(epoch, _)| *epoch != old_epoch));
    assert!(epoch > old_epoch);
    second.signal(Signal::TERM);
    assert_eq!(second.output().status.code(), Some(0));
}

#[test]
fn a_daemon_that_was_stopped_goes_on_in_phase_and_without_a_burst() {
    let world = World::new("paused");
    let period_ns = 10_000_000;
    let node = attach(&world.channel);
    let mut states: StateReader = node.reader_or_create(8).unwrap();
    let mut commands: CommandReader = node.reader_or_create(8).unwrap();
    let process = daemon(&world, &["--config", &endless(&world)]);
    let (_, paused_at) = until(|| newest(&mut states).filter(|(_, tick)| *tick > 3));
    process.signal(Signal::STOP);
    std::thread::sleep(Duration::from_millis(300));
    let _ = (newest(&mut states), commands.newest().unwrap());
    process.signal(Signal::CONT);
    let (mut releases, mut last) = (Vec::new(), 0);
    until(|| {
        while let Some(sample) = states.next().unwrap() {
            let header = *sample.header();
            // Late by less than a period, or not at all: the phase is that of the start.
            assert!(header.stamp_ns >= header.release_ns && header.stamp_ns < header.release_ns + period_ns);
            releases.push(header.release_ns);
            last = header.tick;
        }
        (last > paused_at + 60).then_some(())
    });
    assert!(releases.windows(2).all(|w| w[1] - w[0] >= period_ns && (w[1] - w[0]) % period_ns == 0));
    while let Some(sample) = commands.next().unwrap() {
        let header = sample.header();
        assert!(header.stamp_ns < header.valid_from_ns, "{header:?}");
    }
    process.signal(Signal::TERM);
    let run = process.output();
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stderr).contains("without a complete command in time"), "{}", text(&run.stderr));
}

#[test]
fn mistakes_have_their_own_exit_status() {
    let world = World::new("mistakes");
    file(&world, "bad.toml", "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = -5\n");
    let cases = [
        (vec!["--config", "bad.toml"], 2, "bad.toml"),
        (vec!["--scenario", "no-such-thing"], 2, "no-such-thing"),
        (vec!["--fleet", "a/b"], 2, "a/b"),
        (vec!["--nonsense"], 2, "--nonsense"),
        (vec!["--set", "realtime.policy=require", "--set", "realtime.loop_cpu=1000"], 4, "CPU 1000"),
        (vec!["--report", "/no/such/directory/out.json"], 5, "/no/such/directory"),
    ];
    for (arguments, status, names) in cases {
        let run = daemon(&world, &arguments).output();
        let message = text(&run.stderr);
        assert_eq!(run.status.code(), Some(status), "{arguments:?}: {message}");
        assert!(message.contains(names), "{arguments:?}: {message}");
        assert!(!message.contains("panicked"), "{message}");
    }
}
