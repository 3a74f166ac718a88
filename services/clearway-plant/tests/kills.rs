//! Two hundred clients of every kind, killed at any moment: nobody notices, and nothing is left.

mod support;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::time::Duration;

use clearway::attach::Client;
use clearway::channel::{Attached, Attachment, Reader, Transport};
use clearway::config::ChannelConfig;
use clearway::geometry::Pose;
use clearway::model::RobotId;
use clearway::scenario::Scenario;
use clearway::wire::{CommandHeader, RobotCommand, RobotObservation};
use rustix::process::Signal;
use support::{Listener, Process, World, client, daemon, file, plant, until, within};

const KILLS: u64 = 200;
/// Clients that are there at a time.
const TOGETHER: usize = 5;
const KIND: &str = "CLEARWAY_TEST_CLIENT";
const KINDS: [&str; 6] = ["state", "command", "telemetry", "admin", "observation", "plant"];

/// Not a test of its own: what the clients run until they are killed.
#[test]
fn client_process() {
    let Ok(kind) = std::env::var(KIND) else { return };
    let client = until(|| Client::connect_at("default", &ChannelConfig::default().with_environment()).ok());
    let wait = || std::thread::sleep(Duration::from_micros(200));
    match kind.as_str() {
        "state" => {
            // One that holds on to what it read.
            let (mut states, mut held) = (client.states().unwrap(), None);
            loop {
                held = states.newest().unwrap().or(held);
                wait();
            }
        }
        "command" => {
            let mut commands = client.commands().unwrap();
            loop {
                while commands.next().unwrap().is_some() {}
                wait();
            }
        }
        "telemetry" => {
            let mut telemetry = client.telemetry().unwrap();
            loop {
                while telemetry.next().unwrap().is_some() {}
                wait();
            }
        }
        "admin" => {
            let mut admin = client.admin().unwrap();
            loop {
                // There may be more of them than are answered in time.
                let _ = admin.status();
            }
        }
        _ => {
            let mut observations = client.observations(1).unwrap();
            for stamp_ns in 0.. {
                observations.publish(stamp_ns, &[(RobotId(99), Pose::default())]).unwrap();
                wait();
            }
        }
    }
}

fn start(world: &World, kind: &str, number: u64) -> Process {
    if kind == "plant" {
        let name = format!("plant{number}");
        return plant(world, &name, &["--rate-hz", "500", "--set", "timing.period_us=200000"]);
    }
    let mut command = within(world, &std::env::current_exe().unwrap(), &["--exact", "client_process"]);
    command.env(KIND, kind);
    Process::start(command)
}

/// Who is attached to the fleet, and every file of it: in shared memory, and those that iceoryx2
/// manages it with.
fn baseline(world: &World, node: &Attachment) -> (Attached, BTreeSet<PathBuf>) {
    let mut files: BTreeSet<PathBuf> = world.files().into_iter().collect();
    for part in ["nodes", "services"] {
        below(&world.channel.root.join(part), &mut files);
    }
    (node.attached(), files)
}

fn below(folder: &Path, files: &mut BTreeSet<PathBuf>) {
    // What is removed meanwhile is not there.
    let Ok(entries) = std::fs::read_dir(folder) else { return };
    for entry in entries.flatten() {
        below(&entry.path(), files);
        files.insert(entry.path());
    }
}

/// The daemon in `world`, which drives the swap slowly, with its own plant.
fn slow_swap(world: &World) -> Process {
    let mut scenario = Scenario::builtin("swap8").unwrap();
    scenario.limits.v_max_mps = 0.4;
    file(world, "slow.toml", &scenario.to_toml());
    // Long periods: whatever else the machine does, none is missed, so that the bits can be compared.
    let fleet = "schema = 1\nscenario = \"slow.toml\"\n[timing]\nperiod_us = 200_000\n";
    let config = file(world, "fleet.toml", fleet);
    daemon(world, &["--config", &config, "--set", "source.kind=plant", "--report", "daemon.json"])
}

type Heard = (CommandHeader, Vec<RobotCommand>);

/// The commands of one tick, to the bit.
fn bits((_, robots): &Heard) -> Vec<(u32, u32, u64, u64)> {
    let of = |c: &RobotCommand| (c.id, c.stop_reason, c.v_mps.to_bits(), c.omega_radps.to_bits());
    robots.iter().map(of).collect()
}

#[test]
fn two_hundred_killed_clients_change_no_command_and_leave_nothing() {
    let (world, quiet) = (World::new("kills"), World::new("quiet"));
    let (control, reference) = (slow_swap(&world), slow_swap(&quiet));
    let (reader, quiet_reader) = (client(&world), client(&quiet));
    let (mut listener, mut quiet_listener) = (Listener::new(&reader), Listener::new(&quiet_reader));
    // A place where plants can write, although this daemon asks nobody.
    let node = Transport::new("default", &world.channel).unwrap().visit("test").unwrap();
    let mut observations: Reader<RobotObservation> = node.reader_or_create(8).unwrap();
    let mut admin = until(|| reader.admin().ok());
    let started = |header: &CommandHeader, _: &[RobotCommand]| header.tick > 1;
    listener.until(started);
    quiet_listener.until(started);
    let before = baseline(&world, &node);

    let mut state = 0x1234_5678_9abc_def1_u64;
    let mut random = move |below: u64| {
        // Marsaglia's xorshift: the same moments in every run.
        state ^= state << 13;
        state ^= state >> 7;
        state ^= state << 17;
        state % below
    };
    let mut alive: Vec<Process> = Vec::new();
    for number in 0..KILLS {
        let kind = KINDS[usize::try_from(number).unwrap() % KINDS.len()];
        alive.push(start(&world, kind, number));
        std::thread::sleep(Duration::from_micros(random(40_000)));
        while alive.len() >= TOGETHER || (number + 1 == KILLS && !alive.is_empty()) {
            let victim = usize::try_from(random(alive.len() as u64)).unwrap();
            let mut client = alive.swap_remove(victim);
            assert!(
                client.0.try_wait().unwrap().is_none(),
                "a client ended by itself: {:?}",
                client.output()
            );
            client.kill();
        }
        listener.listen();
        quiet_listener.listen();
        // A reader that never looks keeps what dead writers sent.
        while observations.next().unwrap().is_some() {}
    }

    // The daemon cleans up once a second.
    let mut now = baseline(&world, &node);
    for _ in 0..30 {
        if now == before {
            break;
        }
        std::thread::sleep(Duration::from_secs(1));
        listener.listen();
        quiet_listener.listen();
        while observations.next().unwrap().is_some() {}
        now = baseline(&world, &node);
    }
    assert_eq!(now.0, before.0);
    let more: Vec<_> = now.1.difference(&before.1).collect();
    assert!(more.is_empty() && before.1.is_subset(&now.1), "left behind: {more:?}");
    let figures = admin.status().unwrap().figures;
    assert_eq!((figures.observation_writers, figures.admin_clients), (0, 1));

    // Bit for bit the commands of the daemon that nobody visited.
    listener.listen();
    quiet_listener.listen();
    let (visited, alone) = (&listener.heard, &quiet_listener.heard);
    let mut compared = 0;
    for heard in visited {
        if let Some(same) = alone.iter().find(|(header, _)| header.tick == heard.0.tick) {
            assert_eq!(bits(heard), bits(same), "tick {}", heard.0.tick);
            compared += u64::from(heard.1.iter().any(|command| command.v_mps > 0.0));
        }
    }
    assert!(compared > 10, "only {compared} ticks with robots that drive");
    for process in [control, reference] {
        process.signal(Signal::TERM);
        process.succeed();
    }
}
