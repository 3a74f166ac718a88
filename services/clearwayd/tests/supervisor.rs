//! What a supervisor hears from the daemon, and the unit that makes systemd one.

#[path = "../../../tests/support/mod.rs"]
mod support;

use std::collections::BTreeMap;
use std::os::linux::net::SocketAddrExt;
use std::os::unix::net::{SocketAddr, UnixDatagram};
use std::path::Path;
use std::process::Command;

use clearway::attach::Client;
use rustix::process::Signal;
use support::World;
use support::process::{Process, file, skipped, text, until, within};

const FLEET: &str = "schema = 1\nscenario = \"swap8\"\n[timing]\nperiod_us = 10_000\n";

fn daemon(world: &World, environment: &[(&str, String)]) -> Process {
    let config = file(world, "fleet.toml", FLEET);
    let program = Path::new(env!("CARGO_BIN_EXE_clearwayd"));
    let mut command = within(world, program, &["--set", "realtime.policy=off", "--config", &config]);
    command.envs(environment.iter().map(|(name, value)| (*name, value)));
    Process::start(command)
}

/// Waits for a line that starts like this; those before it are lost.
fn hear(socket: &UnixDatagram, start: &str) -> String {
    let mut bytes = [0; 512];
    until(|| {
        let length = socket.recv(&mut bytes).ok()?;
        let said = text(&bytes[..length]);
        said.starts_with(start).then_some(said)
    })
}

fn silent(socket: &UnixDatagram, start: &str, for_others: usize) {
    let mut bytes = [0; 512];
    for _ in 0..for_others {
        let said = until(|| socket.recv(&mut bytes).ok().map(|length| text(&bytes[..length])));
        assert!(!said.starts_with(start), "{said}");
    }
}

#[test]
fn a_supervisor_hears_when_the_fleet_is_commanded_that_it_lives_and_that_it_ends() {
    let world = World::new("notify");
    std::fs::create_dir_all(&world.channel.root).unwrap();
    let path = world.channel.root.join("notify");
    let name = format!("clearway_notify_{}", std::process::id());
    let listeners = [
        (UnixDatagram::bind(&path).unwrap(), path.to_string_lossy().into_owned()),
        (
            UnixDatagram::bind_addr(&SocketAddr::from_abstract_name(&name).unwrap()).unwrap(),
            format!("@{name}"),
        ),
    ];
    for (socket, address) in listeners {
        socket.set_nonblocking(true).unwrap();
        let process = daemon(&world, &[("NOTIFY_SOCKET", address), ("WATCHDOG_USEC", "40000".to_owned())]);
        hear(&socket, "READY=1\n");
        // By then the first period is answered.
        let client = Client::connect_at("default", &world.channel).unwrap();
        let mut commands = client.commands().unwrap();
        assert!(until(|| commands.newest().unwrap()).header().tick >= 1);
        for _ in 0..5 {
            hear(&socket, "WATCHDOG=1\n");
        }
        assert!(hear(&socket, "STATUS=").contains("of 8 robots arrived, tick "));
        // One that stood for a while goes on afterwards. What it said before is read while it stands.
        process.pause();
        while socket.recv(&mut [0; 512]).is_ok() {}
        process.signal(Signal::CONT);
        hear(&socket, "WATCHDOG=1\n");
        drop((commands, client));
        process.signal(Signal::TERM);
        hear(&socket, "STOPPING=1\n");
        let run = process.output();
        assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    }
}

#[test]
fn a_heartbeat_is_for_who_asks_for_it_and_a_supervisor_that_is_gone_does_no_harm() {
    let world = World::new("notify_other");
    std::fs::create_dir_all(&world.channel.root).unwrap();
    let path = world.channel.root.join("notify");
    let socket = UnixDatagram::bind(&path).unwrap();
    socket.set_nonblocking(true).unwrap();
    let address = path.to_string_lossy().into_owned();
    // Meant for somebody else, such as a process that started this one.
    let others = ("WATCHDOG_PID", "1".to_owned());
    let watchdog = ("WATCHDOG_USEC", "40000".to_owned());
    let process = daemon(&world, &[("NOTIFY_SOCKET", address.clone()), others, watchdog]);
    hear(&socket, "READY=1\n");
    silent(&socket, "WATCHDOG", 2);
    drop(socket);
    std::fs::remove_file(&path).unwrap();
    let client = Client::connect_at("default", &world.channel).unwrap();
    let mut states = client.states().unwrap();
    let tick = until(|| states.newest().unwrap()).header().tick;
    until(|| states.newest().unwrap().filter(|sample| sample.header().tick > tick + 20).map(drop));
    drop((states, client));
    process.signal(Signal::TERM);
    assert_eq!(process.output().status.code(), Some(0));

    let process = daemon(&world, &[("NOTIFY_SOCKET", address)]);
    until(|| Client::connect_at("default", &world.channel).ok().map(drop));
    process.signal(Signal::TERM);
    let run = process.output();
    assert_eq!(run.status.code(), Some(0), "{}", text(&run.stderr));
    assert!(text(&run.stderr).contains("cannot be reached"), "{}", text(&run.stderr));
}

/// The unit's settings by section and name.
fn unit() -> BTreeMap<(String, String), String> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples/clearway.service");
    let (mut settings, mut section) = (BTreeMap::new(), String::new());
    for line in
        std::fs::read_to_string(path).unwrap().lines().filter(|l| !l.is_empty() && !l.starts_with('#'))
    {
        if let Some(name) = line.strip_prefix('[') {
            name.trim_end_matches(']').clone_into(&mut section);
        } else {
            let (name, value) = line.split_once('=').unwrap_or_else(|| panic!("{line:?}"));
            let before = settings.insert((section.clone(), name.to_owned()), value.to_owned());
            assert_eq!(before, None, "{name} stands there twice");
        }
    }
    settings
}

#[test]
fn the_unit_asks_for_what_the_daemon_needs() {
    let unit = unit();
    let service = |name: &str| unit.get(&("Service".to_owned(), name.to_owned())).map(String::as_str);
    for (name, value) in [
        ("Type", "notify"),
        ("Restart", "on-failure"),
        ("StateDirectory", "clearway"),
        ("LimitRTPRIO", "80"),
        ("LimitMEMLOCK", "infinity"),
        ("PrivateTmp", "no"),
    ] {
        assert_eq!(service(name), Some(value), "{name}");
    }
    assert!(service("WatchdogSec").is_some());
    // The daemon takes the arguments that it is started with.
    let words: Vec<_> = service("ExecStart").unwrap().split(' ').skip(1).collect();
    assert_eq!(words[0], "--config");
    let mut command = Command::new(env!("CARGO_BIN_EXE_clearwayd"));
    let run = command.args(&words[..1]).arg("/no/such/file").output().unwrap();
    assert_eq!(run.status.code(), Some(2));
    assert!(text(&run.stderr).contains("/no/such/file"));
}

#[test]
fn systemd_understands_the_unit() {
    let world = World::new("unit");
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../docs/examples/clearway.service");
    // It looks whether the program is there.
    let shipped = std::fs::read_to_string(path).unwrap();
    let unit = file(&world, "clearway.service", &shipped.replace("/usr/local/bin/clearwayd", "/bin/true"));
    let verify = |unit: &str| Command::new("systemd-analyze").args(["verify", unit]).output();
    let Ok(run) = verify(&unit) else {
        skipped("systemd_understands_the_unit", "systemd-analyze is not installed");
        std::fs::remove_dir_all(&world.channel.root).unwrap();
        return;
    };
    let said = text(&run.stderr);
    assert!(run.status.success() && !said.contains("clearway.service"), "{said}");
    // One that it does not understand is seen.
    let wrong = file(&world, "wrong.service", &shipped.replace("WatchdogSec=", "WatchdogSecs="));
    let run = verify(&wrong).unwrap();
    assert!(text(&run.stderr).contains("WatchdogSecs"), "{}", text(&run.stderr));
}
