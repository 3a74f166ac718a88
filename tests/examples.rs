//! The examples of the documentation do what they say, as processes of their own.

mod support;

use std::path::PathBuf;
use std::process::{Command, Output};

use clearway::config::SourceKind;
use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use support::{World, config, lanes};

/// Where Cargo puts the example; built now where only this test was asked for.
fn example(name: &str) -> PathBuf {
    let profile = std::env::current_exe().unwrap().parent().unwrap().parent().unwrap().to_owned();
    let path = profile.join("examples").join(name);
    if !path.exists() {
        let mut cargo = Command::new(env!("CARGO"));
        cargo.args(["build", "--quiet", "--package", "clearway", "--example", name]);
        if profile.ends_with("release") {
            cargo.arg("--release");
        }
        assert!(cargo.current_dir(env!("CARGO_MANIFEST_DIR")).status().unwrap().success());
    }
    path
}

fn run(world: &World, name: &str, args: &[&str]) -> Output {
    Command::new(example(name))
        .args(args)
        .env("CLEARWAY_IOX2_PREFIX", &world.channel.prefix)
        .env("CLEARWAY_IOX2_ROOT", &world.channel.root)
        .output()
        .unwrap()
}

/// What an example prints that succeeds.
fn printed(world: &World, name: &str, args: &[&str]) -> String {
    let run = run(world, name, args);
    assert!(run.status.success(), "{name}: {}", String::from_utf8_lossy(&run.stderr));
    String::from_utf8(run.stdout).unwrap()
}

#[test]
fn follow_reads_all_three_channels() {
    let world = World::new("example_follow");
    let _daemon = Daemon::start(config(&world, lanes(2, 500.0), 20_000_000), Until::Stopped).unwrap();
    let text = printed(&world, "follow", &["10"]);
    assert_eq!(text.lines().filter(|line| line.ends_with(": 0 of 2 arrived")).count(), 10, "{text}");
    assert!(text.contains("commands for tick") && text.contains("µs late"), "{text}");
}

#[test]
fn drive_brings_a_fleet_outside_of_the_daemon_to_its_goals() {
    let world = World::new("example_drive");
    let mut config = config(&world, Scenario::builtin("swap8").unwrap(), 80_000_000);
    config.source.kind = SourceKind::Observation;
    // Nothing here depends on how busy the machine is.
    config.source.max_age_ns = Some(2_000_000_000);
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let text = printed(&world, "drive", &["8"]);
    daemon.stop();
    let report = daemon.join().unwrap();
    assert_eq!((text.lines().count(), report.control.violations), (8, 0), "{text}");
    assert_eq!(report.rejected_inputs.total(), 0, "{report:?}");
    let near =
        |line: &&str| line.split([' ', ':']).filter_map(|word| word.parse::<f64>().ok()).any(|m| m < 0.1);
    assert!(text.lines().any(|line| near(&line)), "{text}");
}

#[test]
fn operate_gives_orders_and_tells_why_one_is_refused() {
    let world = World::new("example_operate");
    let mut config = config(&world, lanes(2, 50.0), 20_000_000);
    config.source.arena_m = 100.0;
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let text = printed(&world, "operate", &["3", "1.5", "-2"]);
    assert!(text.starts_with("2 robots") && text.contains("robot 3 obeys from tick"), "{text}");
    assert!(printed(&world, "operate", &["3", "101", "0"]).contains("refused: the goal of robot 3"));
    daemon.stop();
    daemon.join().unwrap();
    let alone = run(&world, "operate", &["3", "1.5", "-2"]);
    assert!(!alone.status.success());
    assert!(String::from_utf8_lossy(&alone.stderr).contains("NoDaemon"), "{alone:?}");
}

#[test]
fn the_ten_lines_of_the_readme_run_as_they_are_printed() {
    let file = |name: &str| {
        let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(name);
        std::fs::read_to_string(path).unwrap()
    };
    let readme = file("README.md");
    let (_, after) = readme.split_once("```rust\n").unwrap();
    let (printed_there, _) = after.split_once("```").unwrap();
    let example = file("docs/examples/attach.rs");
    let (_, code) = example.split_once("\n\n").unwrap();
    assert_eq!((printed_there, printed_there.lines().count()), (code, 10));
    let world = World::new("example_attach");
    let mut config = config(&world, lanes(2, 50.0), 20_000_000);
    config.timing.ticks = Some(400);
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let text = printed(&world, "attach", &[]);
    assert!(text.contains("0: (") && text.contains("3: ("), "{text}");
    assert_eq!(daemon.join().unwrap().control.violations, 0);
}
