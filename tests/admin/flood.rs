//! More requests than anybody answers.

use super::*;

/// Two robots that are nothing to each other, two hundred metres apart.
fn strangers(world: &World) -> Config {
    let mut scenario = lanes(2, 50.0);
    scenario.robots[1].start = Pose::new(0.0, 200.0, 0.0);
    scenario.robots[1].goal_m = Vec2::new(50.0, 200.0);
    config(world, scenario, T)
}

/// Adds the first robot's commands, as bits, as long as none is missing or late.
fn read_on(commands: &mut CommandReader, seen: &mut Vec<(u64, u64)>, irregular: &mut bool) {
    while let Some(sample) = commands.next().unwrap() {
        let robot = sample.robots()[0];
        let (tick, regular) = (sample.header().tick, robot.stop_reason == 0);
        *irregular |= tick != seen.len() as u64 || !(regular || tick == 0);
        if !*irregular {
            seen.push((robot.v_mps.to_bits(), robot.omega_radps.to_bits()));
        }
    }
}

/// More than can be done: the rest is answered busy, no period takes more than its share, and a robot
/// that it does not concern gets the same commands to the bit.
#[test]
fn a_flood_is_answered_busy_and_changes_no_bit_of_a_robot_that_it_does_not_concern() {
    let run_beside = |name: &str, floods: bool| {
        let world = World::new(name);
        let config = strangers(&world);
        let per_period = config.admin.changes_per_period;
        let transport = Transport::new("default", &world.channel).unwrap();
        let node = transport.attach("test").unwrap();
        // There before the daemon is: no command is missed.
        let mut commands: CommandReader = node.reader_or_create(2).unwrap();
        let (mut seen, mut irregular) = (Vec::new(), false);
        let run = start(config);
        let (mut done, mut busy) = (BTreeMap::<u64, usize>::new(), 0);
        if floods {
            let ports: Vec<_> = (0..4).map(|_| node.admin().unwrap()).collect();
            for round in 0..40_u32 {
                read_on(&mut commands, &mut seen, &mut irregular);
                let mut waiting = Vec::new();
                for (port, n) in ports.iter().flat_map(|port| (0..8).map(move |n| (port, n))) {
                    let request = AdminRequest {
                        expires_ns: MonotonicClock.now_ns() + 30_000_000_000,
                        kind: AdminKind::SetGoals as u32,
                        ..AdminRequest::default()
                    };
                    let y = 200.0 + f64::from(round % 5) + f64::from(n) * 0.1;
                    let robot = AdminRobot { id: 3, goal_x_m: 40.0, goal_y_m: y, ..AdminRobot::default() };
                    waiting.push(port.ask(&request, &[robot]).unwrap());
                }
                for one in waiting {
                    let end = Instant::now() + PATIENCE;
                    let answer = loop {
                        if let Some((answer, _)) = one.answer().unwrap() {
                            break answer;
                        }
                        assert!(Instant::now() < end, "every request is answered");
                        std::thread::sleep(Duration::from_micros(200));
                    };
                    match AdminCode::from_code(answer.code) {
                        Some(AdminCode::Done) => *done.entry(answer.acts_from_tick).or_default() += 1,
                        Some(AdminCode::Busy) => busy += 1,
                        other => panic!("{other:?}"),
                    }
                }
            }
            assert!(busy > 0 && !done.is_empty());
            assert_eq!(busy + done.values().sum::<usize>(), 40 * 32);
            assert!(done.values().all(|in_one_period| *in_one_period <= per_period), "{done:?}");
        }
        let end = Instant::now() + PATIENCE;
        while seen.len() < 60 && !irregular && Instant::now() < end {
            read_on(&mut commands, &mut seen, &mut irregular);
            std::thread::sleep(Duration::from_millis(1));
        }
        run.daemon.stop();
        assert_eq!(run.daemon.join().unwrap().control.violations, 0);
        seen
    };
    let (quiet, flooded) = (run_beside("admin_quiet", false), run_beside("admin_flooded", true));
    // On a machine that is too busy there is less to compare, but always the start.
    let both = quiet.len().min(flooded.len());
    assert!(both > 0);
    assert_eq!(quiet[..both], flooded[..both]);
}
