//! The operator's commands as a person runs them, against a running daemon.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::io::Write;
use std::process::{Command, Output, Stdio};

use clearway::runtime::{Daemon, Until};
use clearway::scenario::Scenario;
use support::{World, config, lanes};

fn clearway(world: &World, args: &[&str], input: &str) -> Output {
    let mut child = Command::new(env!("CARGO_BIN_EXE_clearway"))
        .args(args)
        .env("CLEARWAY_IOX2_PREFIX", &world.channel.prefix)
        .env("CLEARWAY_IOX2_ROOT", &world.channel.root)
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    // One that does not read its input has closed the pipe.
    let _ = child.stdin.take().unwrap().write_all(input.as_bytes());
    child.wait_with_output().unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Runs a command that has to succeed and returns what it printed.
fn done(world: &World, args: &[&str]) -> String {
    let run = clearway(world, args, "");
    assert_eq!(run.status.code(), Some(0), "{args:?}: {}", text(&run.stderr));
    text(&run.stdout)
}

/// Runs a command that has to fail with `code` and say `word`.
fn fails(world: &World, args: &[&str], input: &str, code: i32, word: &str) {
    let run = clearway(world, args, input);
    assert_eq!(run.status.code(), Some(code), "{args:?}: {}", text(&run.stderr));
    // The message is wrapped to the terminal's width.
    let message = text(&run.stderr).replace(['\n', '│'], " ");
    let message = message.split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(message.contains(word), "{args:?}: {message}");
}

fn status(world: &World) -> serde_json::Value {
    serde_json::from_str(&done(world, &["status", "--json", "--timeout", "30"])).unwrap()
}

#[test]
fn an_operator_drives_the_fleet_from_the_command_line() {
    let world = World::new("operate");
    let mut config = config(&world, lanes(2, 50.0), 10_000_000);
    config.admin.capacity = 3;
    config.source.arena_m = 100.0;
    let daemon = Daemon::start(config, Until::Stopped).unwrap();
    let patient = ["--timeout", "30"];
    let with = |args: &[&'static str]| [args, &patient].concat();

    assert!(done(&world, &with(&["goal", "3", "20", "-5.5"])).starts_with("robot 3 goes to (20, -5.5) m"));
    for (x, word) in [("nan", "not finite"), ("-inf", "not finite"), ("101", "source.arena_m")] {
        fails(&world, &["goal", "3", x, "0", "--timeout", "30"], "", 1, word);
    }
    fails(&world, &with(&["goal", "4", "0", "0"]), "", 1, "there is no robot 4");
    let run = clearway(&world, &with(&["goals", "-"]), "0 20 -5.5 # they swap\n3 50 0\n");
    assert_eq!(
        text(&run.stdout).split(" (").next(),
        Some("2 robots have new goals"),
        "{}",
        text(&run.stderr)
    );
    fails(&world, &["goals", "-"], "0 1\n", 2, "-:1:");
    fails(&world, &["goals", "/no/such/file"], "", 2, "/no/such/file");

    done(&world, &with(&["stop"]));
    assert_eq!((&status(&world)["stopped"], &status(&world)["paused"]), (&true.into(), &false.into()));
    assert!(done(&world, &with(&["status"])).contains("STOPPED"));
    fails(&world, &with(&["resume"]), "", 1, "clear that first");
    done(&world, &with(&["clear"]));
    assert_eq!((&status(&world)["stopped"], &status(&world)["paused"]), (&false.into(), &true.into()));
    done(&world, &with(&["resume"]));
    done(&world, &with(&["pause"]));
    assert_eq!(status(&world)["paused"], true);
    done(&world, &with(&["resume"]));

    let add = ["add", "9", "--radius", "0.2", "--start", "-3", "-9", "--goal", "-3", "-8", "--heading", "-1"];
    done(&world, &with(&add));
    assert_eq!((&status(&world)["robots"], &status(&world)["capacity"]), (&3.into(), &3.into()));
    fails(&world, &with(&add), "", 1, "id 9 is taken");
    let scenario = Scenario::parse(&done(&world, &with(&["config", "--scenario"])), "printed.toml").unwrap();
    assert_eq!(scenario.robots.iter().map(|robot| robot.id.0).collect::<Vec<_>>(), [0, 3, 9]);
    done(&world, &with(&["remove", "9"]));
    assert_eq!(status(&world)["robots"], 2);
    assert!(done(&world, &with(&["config"])).contains("capacity = 3"));
    daemon.stop();
    assert_eq!(daemon.join().unwrap().control.violations, 0);
}

#[test]
fn without_a_daemon_every_order_says_so_and_exits_3() {
    let world = World::new("operate_nobody");
    for args in [&["status"][..], &["goal", "0", "1", "2"], &["stop"], &["config"], &["remove", "1"]] {
        fails(&world, args, "", 3, "no daemon runs for this fleet");
    }
    fails(&world, &["stop", "--fleet", "a/b"], "", 2, "a/b");
    fails(&world, &["goal", "0", "1"], "", 2, "<Y>");
    fails(&world, &["status", "--timeout=-1"], "", 2, "--timeout");
    for order in ["status", "goal", "goals", "pause", "resume", "stop", "clear", "add", "remove", "config"] {
        let help = done(&world, &[order, "--help"]);
        assert!(help.contains("Examples:") && help.contains("Exit codes:"), "{order}: {help}");
        assert!(help.lines().all(|line| line.chars().count() <= 80), "{order}: {help}");
    }
}
