//! Daemons and plants that are killed or stopped while robots drive.

mod support;

use std::time::Duration;

use clearway::robots::MotionRecord;
use clearway::scenario::Scenario;
use clearway::wire::StopReason;
use rustix::process::Signal;
use support::{
    Listener, World, clearance, client, daemon, file, moves, plant, report, trajectory, until, until_driven,
};

const ENDLESS: &str = "schema = 1\nscenario = \"swap8\"\n";

#[test]
fn robots_stop_when_the_daemon_is_killed_and_go_on_with_the_next_one() {
    let world = World::new("orphans");
    let config = file(&world, "fleet.toml", ENDLESS);
    let first = daemon(&world, &["--config", &config]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    let robots = plant(&world, "all", &[]);
    until_driven(&world, "all", 0, 1.5);
    first.kill();
    let last = listener.listen().unwrap().0;
    // Time goes on, and nobody moves once the last command has expired.
    let seen_ns = || trajectory(&world, "all").iter().map(|record| record.to_ns).max();
    until(|| seen_ns().filter(|ns| *ns > last.valid_until_ns + 400_000_000));
    let records = trajectory(&world, "all");
    assert!(records.iter().filter(|r| moves(r)).all(|r| r.to_ns <= last.valid_until_ns));
    listener.assert_obeyed(&records);

    // Another run of the daemon brings them to their goals.
    let mut second = daemon(&world, &[]);
    listener.while_running(&mut second);
    second.succeed();
    robots.signal(Signal::TERM);
    robots.succeed();
    let (own, records) = (report(&world, "all"), trajectory(&world, "all"));
    assert_eq!((own["epochs"].as_u64(), own["arrived"].as_u64()), (Some(2), Some(8)), "{own}");
    assert!(own["commands"]["ran_out"].as_u64() >= Some(8), "{own}");
    listener.assert_obeyed(&records);
    assert!(listener.heard.iter().any(|(header, _)| header.epoch > last.epoch));
    let (clearance_m, violations) = clearance(&Scenario::builtin("swap8").unwrap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
}

#[test]
fn robots_stop_while_the_daemon_is_stopped_and_no_late_commands_follow() {
    let world = World::new("stopped");
    let mut control = daemon(&world, &[]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    let robots = plant(&world, "all", &["--once"]);
    until_driven(&world, "all", 0, 1.5);
    control.pause();
    let last = listener.listen().unwrap().0;
    std::thread::sleep(Duration::from_millis(500));
    control.signal(Signal::CONT);
    listener.while_running(&mut control);
    control.succeed();
    robots.succeed();
    let (own, records) = (report(&world, "all"), trajectory(&world, "all"));
    assert_eq!((own["arrived"].as_u64(), own["violations"].as_u64()), (Some(8), Some(0)), "{own}");
    // Periods were skipped, and nobody moved in them.
    let after = listener.heard.iter().map(|(header, _)| header).find(|h| h.stamp_ns >= last.valid_until_ns);
    let next = after.unwrap();
    assert!(next.tick > last.tick + 3, "{last:?} {next:?}");
    let stood = last.valid_until_ns..next.valid_from_ns;
    assert!(records.iter().filter(|r| moves(r)).all(|r| r.to_ns <= stood.start || r.from_ns >= stood.end));
    listener.assert_obeyed(&records);
    // What is sent acts later, one period after the other; only the last stop acts at once.
    let headers: Vec<_> = listener.heard.iter().map(|(header, _)| header).collect();
    let (end, orders) = headers.split_last().unwrap();
    assert!(orders.iter().all(|header| header.stamp_ns < header.valid_from_ns));
    assert!(orders.windows(2).all(|w| w[0].valid_until_ns <= w[1].valid_from_ns), "{orders:?}");
    assert_eq!(end.stamp_ns, end.valid_from_ns);
    // A command that came when it had begun to act is one that the plant was late for.
    assert_eq!(own["commands"]["refused"].as_u64(), Some(0), "{own}");
}

#[test]
fn others_keep_clear_of_a_robot_whose_process_is_killed() {
    let world = World::new("lost");
    let config = file(&world, "fleet.toml", ENDLESS);
    let control = daemon(&world, &["--config", &config, "--report", "daemon.json"]);
    let client = client(&world);
    let mut listener = Listener::new(&client);
    let rest = plant(&world, "rest", &["--robots", "0,1,2,3,4,5,6"]);
    let lost = plant(&world, "lost", &["--robots", "7"]);
    until_driven(&world, "lost", 7, 1.5);
    // Before it was seen for the first time there was no state of it either.
    listener.until(|_, robots| robots.iter().any(|c| c.id == 7 && c.stop_reason == 0));
    lost.kill();
    let no_state = StopReason::NoState as u32;
    let mut lost_at = None;
    listener.until(|header, robots| {
        let is_lost = robots.iter().any(|c| c.id == 7 && c.stop_reason == no_state);
        lost_at = is_lost.then_some(header.tick);
        is_lost
    });
    let lost_at = lost_at.unwrap();
    // The others go on, around it.
    listener.until(|header, _| header.tick > lost_at + 60);
    let after = listener.heard.iter().filter(|(header, _)| header.tick >= lost_at);
    assert!(after.flat_map(|(_, r)| r).filter(|c| c.id == 7).all(|c| c.stop_reason == no_state));
    rest.signal(Signal::INT);
    rest.succeed();
    control.signal(Signal::TERM);
    control.succeed();

    let mut records = trajectory(&world, "rest");
    let own = trajectory(&world, "lost");
    listener.assert_obeyed(&own);
    listener.assert_obeyed(&records);
    // It stands where it was last; nobody comes near it, although nobody was told where that is.
    let end_ns = records.iter().map(|record| record.to_ns).max().unwrap();
    let last = own.iter().max_by_key(|record| record.to_ns).unwrap();
    let there = last.motion().from(last.to_ns).arc;
    records.extend(own.iter().copied());
    records.push(MotionRecord {
        from_ns: last.to_ns,
        to_ns: end_ns,
        x_m: there.start.position_m.x,
        y_m: there.start.position_m.y,
        v_mps: 0.0,
        omega_radps: 0.0,
        ..*last
    });
    let (clearance_m, violations) = clearance(&Scenario::builtin("swap8").unwrap(), &records);
    assert_eq!(violations, 0, "{clearance_m} m");
    // Nor to where the daemon takes it to be.
    let daemon = report(&world, "daemon");
    assert_eq!(daemon["violations"].as_u64(), Some(0), "{daemon}");
    // It stands in the way of some of them, and not of all.
    assert!(report(&world, "rest")["arrived"].as_u64() > Some(0));
}
