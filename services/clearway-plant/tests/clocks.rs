//! Wrong clocks and too little time.

mod support;

use std::process::Command;
use std::time::Duration;

use clearway::scenario::Scenario;
use clearway::wire::StopReason;
use rustix::process::Signal;
use support::sandbox::{Quota, jumping_wall_clock, other_clock};
use support::{
    Listener, Process, World, clearance, client, daemon, daemon_command, file, moves, plant, plant_command,
    report, text, trajectory, until, until_driven,
};

const ENDLESS: &str = "schema = 1\nscenario = \"swap8\"\n";

#[test]
fn a_wall_clock_that_jumps_by_an_hour_changes_nothing() {
    let world = World::new("wall_clock");
    let library = jumping_wall_clock(&world.channel.root, 3600);
    let jumping = |mut command: Command| {
        command.env("LD_PRELOAD", &library);
        command
    };
    // The library does what it is to do.
    let times: Vec<i64> = (0..2)
        .map(|n| {
            let mut date = Command::new("sh");
            date.args(["-c", if n == 0 { "date +%s" } else { "exec date +%s" }]);
            let run = jumping(date).output().unwrap();
            text(&run.stdout).trim().parse().unwrap()
        })
        .collect();
    let now = std::time::SystemTime::now().duration_since(std::time::UNIX_EPOCH).unwrap().as_secs();
    assert!(times.iter().all(|time| time.abs_diff(now.cast_signed()) > 1800), "{times:?} {now}");

    let mut control = Process::start(jumping(daemon_command(&world, &["--report", "daemon.json"])));
    let robots = Process::start(jumping(plant_command(&world, "all", &["--once"])));
    let client = client(&world);
    let mut listener = Listener::new(&client);
    listener.while_running(&mut control);
    control.succeed();
    robots.succeed();
    let (daemon, own) = (report(&world, "daemon"), report(&world, "all"));
    assert_eq!((own["arrived"].as_u64(), own["violations"].as_u64()), (Some(8), Some(0)), "{own}");
    assert_eq!(
        (daemon["rejected_inputs"]["stale"].as_u64(), daemon["rejected_inputs"]["future"].as_u64()),
        (Some(0), Some(0))
    );
    listener.assert_obeyed(&trajectory(&world, "all"));
}

#[test]
fn a_peer_with_another_monotonic_clock_is_not_believed_and_does_not_move() {
    // An hour ahead; behind works only where the machine has been up for long enough.
    for (offset_s, reason) in [(3600, "future"), (-60, "stale")] {
        let world = World::new("clock");
        let test = "a peer with another monotonic clock";
        let Some(other) = other_clock(test, &plant_command(&world, "all", &[]), offset_s) else { return };
        let config = file(&world, "fleet.toml", ENDLESS);
        let control = daemon(&world, &["--config", &config, "--report", "daemon.json"]);
        let client = client(&world);
        let mut listener = Listener::new(&client);
        let robots = Process::start(other);
        // It is refused while it talks, and its robots are told to stand.
        let mut admin = until(|| client.admin().ok()).with_timeout(Duration::from_secs(30));
        until(|| (admin.status().unwrap().figures.rejected_inputs > 100).then_some(()));
        listener.listen();
        let no_state = StopReason::NoState as u32;
        let orders = listener.heard.iter().flat_map(|(_, robots)| robots);
        assert!(orders.filter(|c| c.v_mps != 0.0).count() == 0);
        assert!(listener.heard.last().unwrap().1.iter().all(|c| c.stop_reason == no_state));
        // `unshare` passes on no signals and takes its child along.
        robots.kill();
        control.signal(Signal::TERM);
        control.succeed();
        let daemon = report(&world, "daemon");
        assert!(daemon["rejected_inputs"][reason].as_u64() > Some(100), "{reason}: {daemon}");
        assert!(daemon["stops"]["no_state"].as_u64() > Some(0), "{daemon}");
        assert!(trajectory(&world, "all").iter().all(|record| !moves(record)));
    }
}

#[test]
fn a_daemon_that_gets_next_to_no_cpu_misses_periods_and_moves_nobody_too_long() {
    let world = World::new("starved");
    let config = file(&world, "fleet.toml", ENDLESS);
    let name = format!("clearway_test_{}", std::process::id());
    // Less than it needs: for most of each second it does not run at all, longer than any command holds.
    let Some(quota) = Quota::new("a share of the CPU", &name, 1_000, 1_000_000) else { return };
    let control = daemon(&world, &["--config", &config, "--report", "daemon.json"]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    let robots = plant(&world, "all", &[]);
    until_driven(&world, "all", 0, 0.5);
    quota.takes(control.0.id());
    until(|| {
        listener.listen();
        (quota.throttled() >= 4).then_some(())
    });
    robots.signal(Signal::TERM);
    robots.succeed();
    quota.lift();
    listener.listen();
    control.signal(Signal::TERM);
    control.succeed();

    let records = trajectory(&world, "all");
    listener.assert_obeyed(&records);
    let (clearance_m, violations) = clearance(&Scenario::builtin("swap8").unwrap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
    let (daemon, own) = (report(&world, "daemon"), report(&world, "all"));
    assert!(
        daemon["deadline_misses"].as_u64() > Some(0) && daemon["skipped_periods"].as_u64() > Some(0),
        "{daemon}"
    );
    assert!(own["commands"]["ran_out"].as_u64() > Some(0), "{own}");
    // Nothing is caught up: a period's command acts in its period or not at all.
    let mut ends = listener.heard.iter().map(|(header, _)| (header.valid_from_ns, header.valid_until_ns));
    let mut last_ns = ends.next().unwrap().1;
    for (from_ns, until_ns) in ends {
        assert!(from_ns >= last_ns || from_ns == until_ns, "{from_ns} {last_ns}");
        last_ns = until_ns;
    }
}
