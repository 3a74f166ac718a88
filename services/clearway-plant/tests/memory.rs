//! Shared memory that is full, that fills up, and that somebody destroys.

mod support;

use std::path::Path;

use clearway::channel::{Member, Transport};
use clearway::clock::{Clock, MonotonicClock};
use clearway::robots::MotionRecord;
use clearway::scenario::Scenario;
use support::sandbox::{beside, small_shared_memory};
use support::{
    Process, World, clearance, daemon_command, file, moves, plant_command, report, text, trajectory, until,
    until_driven,
};

/// Enough for the channels of eight robots, and little more.
const ENOUGH: &str = "32m";
const PERIOD_NS: u64 = 80_000_000;

#[test]
fn a_daemon_without_room_for_its_channels_says_so_and_does_not_start() {
    let world = World::new("full");
    for size in ["64k", "1m", "12m", "24m"] {
        let test = "shared memory that is full at the start";
        let plain = daemon_command(&world, &[]);
        let Some(command) = small_shared_memory(test, &plain, size) else { return };
        let run = Process::start(command).output();
        let said = text(&run.stderr);
        // Not by a signal, and not as an empty report.
        assert_eq!(run.status.code(), Some(5), "{size}: {said}");
        assert!(
            said.contains("/dev/shm") && said.contains("KiB") && said.contains("help:"),
            "{size}: {said}"
        );
    }
}

#[test]
fn a_fleet_goes_on_when_shared_memory_fills_up_and_nobody_else_can_join() {
    let world = World::new("fills");
    let test = "shared memory that fills up later";
    let plain = daemon_command(&world, &["--report", "daemon.json"]);
    let Some(command) = small_shared_memory(test, &plain, ENOUGH) else { return };
    let control = Process::start(command);
    let id = control.0.id();
    // Its shared memory is seen through the process, once that is where it belongs.
    let shared = format!("/proc/{id}/root/dev/shm");
    until(|| (entries(&shared, &world) > 0).then_some(()));
    let robots = Process::start(beside(id, &plant_command(&world, "all", &["--once"])));
    until_driven(&world, "all", 0, 0.5);

    let filler = std::fs::File::create(Path::new(&shared).join("filler")).unwrap();
    let taken = rustix::fs::fallocate(&filler, rustix::fs::FallocateFlags::empty(), 0, 1 << 30);
    assert!(taken.is_err(), "there was no end to it");
    // As much as there is.
    let rest = (0..32 << 8).take_while(|n| {
        rustix::fs::fallocate(&filler, rustix::fs::FallocateFlags::empty(), n << 12, 1 << 12).is_ok()
    });
    assert!(rest.count() > 10, "it was full before");
    let late = Process::start(beside(id, &plant_command(&world, "late", &["--duration", "5"]))).output();
    let said = text(&late.stderr);
    assert_eq!(late.status.code(), Some(5), "{said}");
    assert!(said.contains("/dev/shm is full"), "{said}");

    control.succeed();
    robots.succeed();
    let (daemon, own) = (report(&world, "daemon"), report(&world, "all"));
    assert_eq!(
        (daemon["arrived"].as_u64(), daemon["send_failures"].as_u64()),
        (Some(8), Some(0)),
        "{daemon}"
    );
    assert_eq!((own["arrived"].as_u64(), own["violations"].as_u64()), (Some(8), Some(0)), "{own}");
}

#[test]
fn a_killed_daemon_leaves_its_memory_to_its_successor() {
    let world = World::new("twice");
    let test = "shared memory for one daemon";
    let Some(command) = small_shared_memory(test, &daemon_command(&world, &[]), ENOUGH) else { return };
    let mut first = Process::start(command);
    let id = first.0.id();
    until(|| (entries(&format!("/proc/{id}/root/dev/shm"), &world) > 0).then_some(()));
    // They keep this shared memory for the next one, and what they have open of the first.
    let robots = Process::start(beside(id, &plant_command(&world, "all", &["--once"])));
    until_driven(&world, "all", 0, 0.5);
    first.end();
    let plain = daemon_command(&world, &["--report", "daemon.json"]);
    let second = Process::start(beside(robots.0.id(), &plain)).output();
    assert_eq!(second.status.code(), Some(0), "{}", text(&second.stderr));
    robots.succeed();
    assert_eq!(report(&world, "daemon")["arrived"].as_u64(), Some(8));
}

/// Files of `world` in a shared memory.
fn entries(shared: &str, world: &World) -> usize {
    let Ok(entries) = std::fs::read_dir(shared) else { return 0 };
    entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(&world.channel.prefix)).count()
}

/// What somebody does to a file who may write it.
#[derive(Debug, Clone, Copy)]
enum Damage {
    Noise,
    Zeros,
    Truncated,
}

/// Whether the file was still there to be damaged.
fn damage(path: &Path, damage: Damage) -> bool {
    let Ok(file) = std::fs::OpenOptions::new().write(true).open(path) else { return false };
    let length = usize::try_from(file.metadata().unwrap().len()).unwrap();
    let mut noise = 0x9e37_79b9_7f4a_7c15_u64;
    let mut bytes = vec![0_u8; length];
    match damage {
        Damage::Truncated => return file.set_len(0).is_ok(),
        Damage::Zeros => {}
        Damage::Noise => bytes.iter_mut().for_each(|byte| {
            noise ^= noise << 13;
            noise ^= noise >> 7;
            noise ^= noise << 17;
            *byte = noise.to_le_bytes()[3];
        }),
    }
    std::os::unix::fs::FileExt::write_all_at(&file, &bytes, 0).is_ok()
}

/// A daemon and its robots, whose shared memory is damaged on the way. Whatever happens to either: nobody moves
/// by a command that has expired, and a new start works.
fn survives(kind: &str, how: Damage) {
    let world = World::new("damaged");
    let endless = file(&world, "fleet.toml", "schema = 1\nscenario = \"swap8\"\n");
    let mut control = Process::start(daemon_command(&world, &["--config", &endless]));
    let mut robots = Process::start(plant_command(&world, "all", &[]));
    until_driven(&world, "all", 0, 1.0);
    let files = world.files();
    // Connections of who comes and goes may disappear meanwhile, not all of them.
    let damaged = files.iter().filter(|path| path.to_string_lossy().ends_with(kind) && damage(path, how));
    assert!(damaged.count() > 0, "no {kind} among {files:?}");
    // Ten periods with it, as far as they come.
    std::thread::sleep(std::time::Duration::from_nanos(10 * PERIOD_NS));
    control.end();
    let ended_ns = MonotonicClock.now_ns();
    let newest = || trajectory(&world, "all").iter().map(|record| record.to_ns).max();
    until(|| {
        let gone = robots.0.try_wait().unwrap().is_some();
        (gone || newest() > Some(ended_ns + 5 * PERIOD_NS)).then_some(())
    });
    robots.end();
    let records = trajectory(&world, "all");
    // The last command may have gone out just before the end, to act in the next period.
    let last_ns = records.iter().filter(|r| moves(r)).map(|r| r.to_ns).max();
    assert!(last_ns <= Some(ended_ns + 2 * PERIOD_NS), "{kind} {how:?}: {last_ns:?} {ended_ns}");
    assert_apart(&records, &format!("{kind} {how:?}"));

    // The next daemon finds what is left, and its robots go on when it is there.
    let control = Process::start(daemon_command(&world, &["--report", "daemon.json"]));
    let transport = Transport::new("default", &world.channel).unwrap();
    let own =
        |member: &Member| member.role == "clearwayd" && member.process.cast_unsigned() == control.0.id();
    until(|| transport.members().ok()?.iter().find(|member| own(member)).map(|_| ()));
    let robots = Process::start(plant_command(&world, "next", &["--once"]));
    let run = control.output();
    assert_eq!(run.status.code(), Some(0), "{kind} {how:?}: {}", text(&run.stderr));
    robots.succeed();
    assert_eq!(report(&world, "next")["arrived"].as_u64(), Some(8));
    if kind == ".connection" {
        // A queue that nobody can read any more stays, with what it belonged to.
        for path in world.files() {
            let _ = std::fs::remove_file(path);
        }
    }
}

fn assert_apart(records: &[MotionRecord], context: &str) {
    let (clearance_m, violations) = clearance(&Scenario::builtin("swap8").unwrap(), records);
    assert_eq!(violations, 0, "{context}: {clearance_m} m");
}

#[test]
fn damaged_shared_memory_moves_no_robot_and_does_not_outlive_a_restart() {
    // The kinds of files that iceoryx2 makes: samples, queues, who is attached, and its own.
    let kinds = [".data", ".connection", ".dynamic", ".global_mgmt"];
    let damages = [Damage::Noise, Damage::Zeros, Damage::Truncated];
    std::thread::scope(|scope| {
        for (kind, how) in kinds.iter().flat_map(|kind| damages.map(|how| (kind, how))) {
            scope.spawn(move || survives(kind, how));
        }
    });
}
