//! Daemons and plants as processes, in a world of their own.
#![allow(dead_code, unused_imports, unreachable_pub, reason = "each test file uses a part")]

#[path = "../../../../tests/support/mod.rs"]
mod base;

use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::OnceLock;

use clearway::attach::{Client, Subscriber};
use clearway::figures::Clearances;
use clearway::robots::{MotionRecord, motions};
use clearway::scenario::Scenario;
use clearway::wire::{CommandHeader, RobotCommand};

pub use base::process::{Process, file, skipped, text, until, within};
pub use base::{World, sandbox};

/// The daemon's program, of the same build as this one: another package's, so it is made sure of.
fn clearwayd() -> &'static Path {
    static BUILT: OnceLock<PathBuf> = OnceLock::new();
    BUILT.get_or_init(|| {
        let folder = Path::new(env!("CARGO_BIN_EXE_clearway-plant")).parent().unwrap();
        let release = folder.file_name().is_some_and(|name| name == "release");
        let built = Command::new(env!("CARGO"))
            // With the features of the whole workspace: by itself it would be built from the ground up.
            .args(["build", "--quiet", "--workspace", "--bin", "clearwayd", "--target-dir"])
            .arg(folder.parent().unwrap())
            .args(release.then_some("--release"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .status();
        assert!(built.unwrap().success());
        folder.join("clearwayd")
    })
}

/// A daemon that listens to observations, unless `arguments` say otherwise.
pub fn daemon(world: &World, arguments: &[&str]) -> Process {
    Process::start(daemon_command(world, arguments))
}

pub fn daemon_command(world: &World, arguments: &[&str]) -> Command {
    let mut command = within(world, clearwayd(), &["--set", "realtime.policy=off"]);
    command.args(["--set", "source.kind=observation", "--quiet"]).args(arguments);
    command
}

/// A plant that writes its report to `NAME.json` and its trajectory to `NAME.jsonl`.
pub fn plant(world: &World, name: &str, arguments: &[&str]) -> Process {
    Process::start(plant_command(world, name, arguments))
}

pub fn plant_command(world: &World, name: &str, arguments: &[&str]) -> Command {
    let program = Path::new(env!("CARGO_BIN_EXE_clearway-plant"));
    let (report, trajectory) = (format!("{name}.json"), format!("{name}.jsonl"));
    let mut command = within(world, program, &["--quiet", "--report", &report, "--trajectory", &trajectory]);
    command.args(arguments);
    command
}

/// A client of the daemon in `world`, when there is one.
pub fn client(world: &World) -> Client {
    until(|| Client::connect_at("default", &world.channel).ok())
}

/// What a plant wrote at its end.
pub fn report(world: &World, name: &str) -> serde_json::Value {
    let path = world.channel.root.join(format!("{name}.json"));
    serde_json::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// What a plant's robots really did so far. A process that was killed may have left half a line.
pub fn trajectory(world: &World, name: &str) -> Vec<MotionRecord> {
    let text = std::fs::read_to_string(world.channel.root.join(format!("{name}.jsonl"))).unwrap();
    let lines: Vec<&str> = text.split_inclusive('\n').filter(|line| line.ends_with('\n')).collect();
    assert!(!lines.is_empty(), "{name} wrote nothing");
    lines.into_iter().map(|line| serde_json::from_str(line).unwrap()).collect()
}

/// Whether a robot drove or turned.
pub fn moves(record: &MotionRecord) -> bool {
    (record.v_mps, record.omega_radps) != (0.0, 0.0)
}

/// Waits until robot `id` of the plant `name` has driven `way_m`.
pub fn until_driven(world: &World, name: &str, id: u32, way_m: f64) {
    let path = world.channel.root.join(format!("{name}.jsonl"));
    until(|| std::fs::read(&path).ok().filter(|bytes| bytes.contains(&b'\n')));
    let driven_m = || -> f64 {
        let records = trajectory(world, name);
        records.iter().filter(|r| r.id == id).map(|r| r.v_mps * r.motion().duration_s()).sum()
    };
    until(|| (driven_m() >= way_m).then_some(()));
}

/// Every command that was sent, as somebody heard it who is not the plant.
pub struct Listener {
    commands: Subscriber<RobotCommand>,
    pub heard: Vec<(CommandHeader, Vec<RobotCommand>)>,
}

impl Listener {
    pub fn new(client: &Client) -> Self {
        Self { commands: until(|| client.commands().ok()), heard: Vec::new() }
    }

    /// Takes what came since the last time; the newest of all.
    pub fn listen(&mut self) -> Option<&(CommandHeader, Vec<RobotCommand>)> {
        while let Some(sample) = self.commands.next().unwrap() {
            self.heard.push((*sample.header(), sample.robots().to_vec()));
        }
        self.heard.last()
    }

    /// Listens until `found` likes the newest sample.
    pub fn until(&mut self, mut found: impl FnMut(&CommandHeader, &[RobotCommand]) -> bool) {
        until(|| self.listen().filter(|(header, robots)| found(header, robots)).map(|_| ()));
    }

    /// Listens until `process` has ended.
    pub fn while_running(&mut self, process: &mut Process) {
        until(|| {
            self.listen();
            process.0.try_wait().unwrap()
        });
        self.listen();
    }

    /// Asserts that every robot moved only as a command said, while that command was valid.
    pub fn assert_obeyed(&self, records: &[MotionRecord]) {
        assert_obeyed(&self.heard, records);
    }
}

/// Asserts that every robot moved only as a command of `heard` said, while that command was valid.
pub fn assert_obeyed(heard: &[(CommandHeader, Vec<RobotCommand>)], records: &[MotionRecord]) {
    for record in records.iter().filter(|r| (r.v_mps, r.omega_radps) != (0.0, 0.0)) {
        let told = (record.id, record.v_mps, record.omega_radps);
        let orders = |robots: &[RobotCommand]| {
            robots.iter().any(|command| told == (command.id, command.v_mps, command.omega_radps))
        };
        // One order may follow the other and say the same.
        let mut allowed_ns = record.from_ns;
        for (header, _) in heard.iter().filter(|(_, robots)| orders(robots)) {
            if (header.valid_from_ns..header.valid_until_ns).contains(&allowed_ns) {
                allowed_ns = header.valid_until_ns;
            }
        }
        assert!(allowed_ns >= record.to_ns, "nobody allowed {record:?} beyond {allowed_ns}");
    }
    assert!(records.iter().any(|record| record.v_mps > 0.0), "nobody moved");
}

/// Smallest true clearance of the robots of all `records`, m, and how many pairs violated it.
pub fn clearance(scenario: &Scenario, records: &[MotionRecord]) -> (f64, usize) {
    let mut clearances = Clearances::new(scenario);
    clearances.add(&motions(scenario, records));
    (clearances.min_clearance_m().unwrap(), clearances.violations())
}
