//! `clearway top` as scripts run it, and as a monitor that is killed, beside a running daemon.

#[path = "recording/mod.rs"]
#[allow(dead_code, reason = "a part is used")]
mod recording;
#[path = "../../../tests/support/mod.rs"]
mod support;

use std::io::Read;
use std::os::fd::OwnedFd;
use std::process::{Command, Output, Stdio};
use std::time::Duration;

use clearway::attach::Client;
use clearway::runtime::{Daemon, Until};
use recording::clearway;
use rustix::process::{Signal, kill_process};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{LocalModes, Winsize, tcgetattr, tcsetwinsize};
use serde_json::Value;
use support::process::{Process, isolated, text, until};
use support::{World, config, lanes};

const PERIOD_NS: u64 = 10_000_000;

fn once(world: &World, more: &[&str]) -> Output {
    clearway(world, &[&["top", "--once"], more].concat()).output().unwrap()
}

#[test]
fn a_script_reads_a_running_fleet() {
    let world = World::new("top");
    let daemon = Daemon::start(config(&world, lanes(3, 500.0), PERIOD_NS), Until::Stopped).unwrap();
    let run = once(&world, &["--json", "--seconds", "2", "--wait", "60"]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let value: Value = serde_json::from_slice(&run.stdout).unwrap();
    assert_eq!(
        (&value["fleet"], &value["live"], &value["hold"]),
        (&"default".into(), &true.into(), &Value::Null)
    );
    assert_eq!((&value["period_ns"], &value["profile"]), (&PERIOD_NS.into(), &"certified".into()));
    let ids: Vec<u64> =
        value["robots"].as_array().unwrap().iter().map(|robot| robot["id"].as_u64().unwrap()).collect();
    assert_eq!(ids, [0, 3, 6]);
    let robot = &value["robots"][1];
    assert_eq!(
        (&robot["goal_x_m"], &robot["valid"], &robot["foreign"]),
        (&500.0.into(), &true.into(), &false.into())
    );
    let (x_m, away_m) = (robot["x_m"].as_f64().unwrap(), robot["to_goal_m"].as_f64().unwrap());
    assert!(x_m > 0.0 && x_m < 500.0 && (x_m + away_m - 500.0).abs() < 1e-3, "{robot}");
    assert!(robot["slack_position_m2"].as_f64().unwrap() >= 0.0 && robot["solve_ns"].as_u64().unwrap() > 0);

    let window = &value["window"];
    let samples = window["telemetry"].as_u64().unwrap();
    assert!(samples > 1, "{window}");
    for key in ["release_lateness_ns", "state_to_command_ns", "state_publish_ns"] {
        let latency = &window[key];
        assert_eq!(latency["count"].as_u64(), Some(samples), "{key}");
        assert!(
            latency["p50"].as_u64() <= latency["p99"].as_u64()
                && latency["p99"].as_u64() <= latency["max"].as_u64()
        );
    }
    assert!(window["solve_ns"]["count"].as_u64().unwrap() <= 3 * samples);
    assert_eq!(value["attached"]["telemetry_readers"], 1);
    assert_eq!((&value["daemon"]["robots"], &value["daemon"]["epoch"]), (&3.into(), &value["epoch"]));
    let roles: Vec<&str> =
        value["members"].as_array().unwrap().iter().filter_map(|member| member["role"].as_str()).collect();
    assert!(roles.contains(&"clearwayd") && roles.contains(&"clearway-top"), "{roles:?}");

    let run = once(&world, &[]);
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    let screen = text(&run.stdout);
    assert!(
        screen.contains("RUNNING") && screen.contains("3 robots") && !screen.contains('\u{1b}'),
        "{screen}"
    );
    assert!(
        screen.lines().count() <= 24 && screen.lines().all(|line| line.chars().count() <= 80),
        "{screen}"
    );
    daemon.stop();
    daemon.join().unwrap();
}

#[test]
fn without_a_daemon_or_a_terminal_it_says_what_to_do() {
    let world = World::new("top_nobody");
    let run = once(&world, &["--json"]);
    assert_eq!(run.status.code(), Some(3));
    assert!(text(&run.stderr).contains("no daemon") && run.stdout.is_empty(), "{}", text(&run.stderr));
    let run = clearway(&world, &["top"]).output().unwrap();
    assert_eq!(run.status.code(), Some(2));
    assert!(text(&run.stderr).contains("--once --json"), "{}", text(&run.stderr));
    for wrong in [
        &["--json"][..],
        &["--redraw-hz", "0"],
        &["--once", "--seconds", "nan"],
        &["--fleet", "a/b", "--once"],
    ] {
        let run = clearway(&world, &[&["top"], wrong].concat()).output().unwrap();
        assert_eq!(run.status.code(), Some(2), "{wrong:?}");
    }
    let help = text(&clearway(&world, &["top", "--help"]).output().unwrap().stdout);
    assert!(help.contains("Examples:") && help.contains("Exit codes:"), "{help}");
}

/// A terminal of 80 × 24 with `clearway top` on it.
struct OnTerminal {
    process: Process,
    terminal: std::fs::File,
    /// Kept open, so that what the child left can be read after its end.
    end: std::fs::File,
}

fn on_terminal(world: &World) -> OnTerminal {
    // A child that had it would keep its own terminal.
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    tcsetwinsize(&master, Winsize { ws_row: 24, ws_col: 80, ws_xpixel: 0, ws_ypixel: 0 }).unwrap();
    let path = ptsname(&master, Vec::new()).unwrap().into_string().unwrap();
    let end = std::fs::OpenOptions::new().read(true).write(true).open(path).unwrap();
    let stdio = || Stdio::from(OwnedFd::from(end.try_clone().unwrap()));
    let mut command = Command::new(env!("CARGO_BIN_EXE_clearway"));
    command.arg("top");
    isolated(&mut command, world);
    command.env("TERM", "xterm").env("LC_ALL", "C.UTF-8").stdin(stdio()).stdout(stdio());
    OnTerminal { process: Process::start(command), terminal: master.into(), end }
}

impl OnTerminal {
    /// Reads until the screen has shown `words`; the kernel's buffer is what holds the child up.
    fn reads(&mut self, words: &str) -> String {
        let mut seen = Vec::new();
        until(|| {
            let mut buffer = [0; 4096];
            let n = self.terminal.read(&mut buffer).unwrap();
            seen.extend_from_slice(&buffer[..n]);
            text(&seen).contains(words).then(|| text(&seen))
        })
    }

    fn is_raw(&self) -> bool {
        !tcgetattr(&self.end).unwrap().local_modes.contains(LocalModes::ICANON)
    }
}

#[test]
fn a_terminal_is_put_back_and_a_killed_monitor_changes_nothing() {
    let world = World::new("top_killed");
    let daemon = Daemon::start(config(&world, lanes(3, 500.0), PERIOD_NS), Until::Stopped).unwrap();
    let client = until(|| Client::connect_at("default", &world.channel).ok());
    let mut commands = client.commands().unwrap();

    // Ended by a signal: the terminal is as it was.
    let mut top = on_terminal(&world);
    top.reads("RUNNING");
    assert!(top.is_raw());
    top.process.signal(Signal::TERM);
    let leaves_the_screen = "\u{1b}[?1049l";
    top.reads(leaves_the_screen);
    assert_eq!(top.process.wait().code(), Some(0));
    assert!(!top.is_raw());

    // Killed, and stopped for good: commands go on.
    let mut killed = on_terminal(&world);
    killed.reads("RUNNING");
    let mut stuck = on_terminal(&world);
    stuck.reads("RUNNING");
    killed.process.signal(Signal::KILL);
    stuck.process.signal(Signal::STOP);
    killed.process.wait();
    while commands.next().unwrap().is_some() {}
    let first = commands.wait(Duration::from_secs(60)).unwrap().unwrap().header().tick;
    // Far more periods than any channel holds samples.
    until(|| commands.newest().unwrap().filter(|sample| sample.header().tick > first + 200).map(|_| ()));
    let status = client.admin().unwrap().with_timeout(Duration::from_secs(30)).status().unwrap();
    assert_eq!(status.figures.worker_panics, 0);
    stuck.process.signal(Signal::KILL);
    stuck.process.wait();
    drop((commands, client));
    daemon.stop();
    let report = daemon.join().unwrap();
    assert_eq!(report.control.violations, 0);
}

#[test]
fn it_ends_when_its_terminal_is_gone_whether_or_not_a_signal_says_so() {
    let world = World::new("top_gone");
    let daemon = Daemon::start(config(&world, lanes(3, 500.0), PERIOD_NS), Until::Stopped).unwrap();
    for signal in [None, Some(Signal::HUP)] {
        let mut top = on_terminal(&world);
        top.reads("RUNNING");
        let OnTerminal { mut process, terminal, end } = top;
        // The terminal's window is closed: nobody holds the other side any more.
        drop((terminal, end));
        if let Some(signal) = signal {
            // It may have ended already.
            let _ = kill_process(process.id(), signal);
        }
        // By itself, and not by the signal.
        let status = process.wait();
        assert!(status.code().is_some(), "{signal:?}: {status}");
    }
    daemon.stop();
    daemon.join().unwrap();
}
