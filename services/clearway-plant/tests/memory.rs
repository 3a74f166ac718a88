//! Shared memory that is full, and that fills up.

mod support;

use std::path::Path;

use support::sandbox::{beside, small_shared_memory};
use support::{Process, World, daemon_command, plant_command, report, text, until, until_driven};

/// Enough for the channels of eight robots, and little more.
const ENOUGH: &str = "32m";

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

/// Files of `world` in a shared memory.
fn entries(shared: &str, world: &World) -> usize {
    let Ok(entries) = std::fs::read_dir(shared) else { return 0 };
    entries.flatten().filter(|e| e.file_name().to_string_lossy().starts_with(&world.channel.prefix)).count()
}
