//! The swap with its robots in other processes than the daemon.

mod support;

use clearway::scenario::Scenario;
use support::{Listener, World, clearance, client, daemon, plant, report, trajectory};

fn swap() -> Scenario {
    Scenario::builtin("swap8").unwrap()
}

#[test]
fn two_processes_run_the_swap() {
    let world = World::new("two");
    // The plant is there first and waits.
    let robots = plant(&world, "all", &["--once"]);
    let mut control = daemon(&world, &["--report", "daemon.json"]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    listener.while_running(&mut control);
    control.succeed();
    robots.succeed();
    let (own, records) = (report(&world, "all"), trajectory(&world, "all"));
    assert_eq!((own["arrived"].as_u64(), own["violations"].as_u64()), (Some(8), Some(0)), "{own}");
    listener.assert_obeyed(&records);
    let (clearance_m, violations) = clearance(&swap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
    // Its own account of the clearance is that of its records.
    assert!((own["min_clearance_m"].as_f64().unwrap() - clearance_m).abs() < 1e-6, "{own} {clearance_m}");
    let daemon = report(&world, "daemon");
    assert_eq!((daemon["arrived"].as_u64(), daemon["violations"].as_u64()), (Some(8), Some(0)));
}

/// The daemon, a plant for each robot, and this process, which reads along.
#[test]
fn ten_processes_run_the_swap() {
    let world = World::new("ten");
    let mut control = daemon(&world, &[]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    let names: Vec<String> = (0..8).map(|id| format!("robot{id}")).collect();
    let start = |(id, name): (usize, &String)| plant(&world, name, &["--once", "--robots", &id.to_string()]);
    let robots: Vec<_> = names.iter().enumerate().map(start).collect();
    listener.while_running(&mut control);
    control.succeed();
    robots.into_iter().for_each(support::Process::succeed);
    let mut records = Vec::new();
    for name in &names {
        let own = report(&world, name);
        assert_eq!((own["arrived"].as_u64(), own["min_clearance_m"].is_null()), (Some(1), true), "{own}");
        records.extend(trajectory(&world, name));
    }
    listener.assert_obeyed(&records);
    let (clearance_m, violations) = clearance(&swap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
}

/// Wheels that lag and slip, noise, late observations of which a fifth is lost: all within the bounds that
/// the safety rows allow for.
#[test]
fn disturbed_robots_within_the_bounds_run_the_swap() {
    let world = World::new("noisy");
    let bounds = [
        "position_m=0.02",
        "heading_rad=0.02",
        "slip=0.02",
        "turn_rate_radps=0.02",
        "lag_us=20000",
        "delay_us=10000",
    ];
    let bounds: Vec<String> = bounds.iter().map(|bound| format!("robust.{bound}")).collect();
    let bounds: Vec<&str> = bounds.iter().flat_map(|bound| ["--set", bound]).collect();
    for seed in ["1", "2"] {
        let name = format!("seed{seed}");
        let mut control = daemon(&world, &bounds);
        let client = client(&world);
        let mut listener = Listener::new(&client);
        let arguments = [
            ["--seed", seed],
            ["--noise-m", "0.005"],
            ["--noise-rad", "0.005"],
            ["--lag-ms", "15"],
            ["--delay-ms", "5"],
            ["--drop-out", "0.2"],
            ["--rate-hz", "200"],
            ["--set", "disturbance.slip=0.01"],
            ["--set", "disturbance.turn_rate_radps=0.01"],
            ["--set", "disturbance.delay_us=5000"],
        ];
        let arguments: Vec<&str> = arguments.into_iter().flatten().chain(["--once"]).collect();
        let robots = plant(&world, &name, &arguments);
        listener.while_running(&mut control);
        control.succeed();
        robots.succeed();
        let (clearance_m, violations) = clearance(&swap(), &trajectory(&world, &name));
        assert_eq!(violations, 0, "{clearance_m} m");
        let own = report(&world, &name);
        assert_eq!(own["arrived"].as_u64(), Some(8), "{own}");
        assert!(own["observations_lost"].as_u64().unwrap() > 0, "{own}");
    }
}
