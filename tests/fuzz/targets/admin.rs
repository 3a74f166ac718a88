use super::bytes::Bytes;
use clearway::config::Config;
use clearway::model::RobotSpec;
use clearway::runtime::Rehearsal;
use clearway::scenario::Scenario;
use clearway::wire::{AdminKind, AdminRequest, AdminRobot, state_flags};
use std::sync::LazyLock;

const EPOCH: u64 = 77;

const FLEET: &str = r#"
    schema = 1
    name = "three"
    [[robot]]
    id = 1
    radius_m = 0.15
    start = { x_m = 0, y_m = 0 }
    goal = { x_m = 4, y_m = 0 }
    [[robot]]
    id = 5
    radius_m = 0.3
    start = { x_m = 0, y_m = 2 }
    goal = { x_m = 4, y_m = 2 }
    [[robot]]
    id = 9
    radius_m = 0.15
    start = { x_m = 0, y_m = 4 }
    foreign_speed_mps = 1
    [[obstacle]]
    circle = { x_m = 2, y_m = -3, radius_m = 0.5 }
"#;

static CONFIG: LazyLock<Config> = LazyLock::new(|| {
    let mut config = Config::new(Scenario::parse(FLEET, "three.toml").expect("the fleet is sound"));
    config.admin.capacity = 6;
    config.source.arena_m = 50.0;
    config
});

/// The memory of one request.
fn request(bytes: &mut Bytes) -> (AdminRequest, Vec<AdminRobot>, u64) {
    // The upper half of the first byte: what is sound unless the input says otherwise.
    let (shape, now_ns) = (bytes.u8(), 1_000_000);
    let header = AdminRequest {
        ticket: 0,
        expires_ns: if shape & 0x80 == 0 { now_ns + 1 } else { bytes.u64() },
        epoch: if shape & 0x40 == 0 { EPOCH } else { bytes.u64() },
        offset: 0,
        kind: if shape & 0x20 == 0 { u32::from(bytes.u8() % 12) } else { bytes.u32() },
        reserved: 0,
    };
    let robots = (0..shape & 7).map(|_| {
        let id = if shape & 0x10 == 0 { u32::from(bytes.u8() % 12) } else { bytes.u32() };
        // Near coordinates, and any bits.
        let mut number =
            || if shape & 8 == 0 { f64::from(bytes.u8().cast_signed()) * 0.25 } else { bytes.f64() };
        AdminRobot {
            id,
            reserved: 0,
            goal_x_m: number(),
            goal_y_m: number(),
            start_x_m: number(),
            start_y_m: number(),
            start_theta_rad: number(),
            radius_m: number(),
        }
    });
    (header, robots.collect(), now_ns)
}

/// Whatever is asked for, there is an answer; what is refused changes nothing; and the fleet stays one
/// whose robots are told apart and can all be at their goals.
pub fn admin(data: &[u8]) {
    let mut bytes = Bytes::new(data);
    let mut fleet = Rehearsal::new(&CONFIG, EPOCH);
    for _ in 0..32 {
        if bytes.is_empty() {
            return;
        }
        let (header, robots, now_ns) = request(&mut bytes);
        let (before, held) = (fleet.scenario(), fleet.hold());
        match fleet.ask(&header, &robots, now_ns) {
            Err(refusal) => {
                assert!(!refusal.text.is_empty() && refusal.text.len() < 500, "{refusal:?}");
                assert_eq!((fleet.scenario(), fleet.hold()), (before, held), "{refusal:?}");
                let stop = AdminKind::from_code(header.kind) == Some(AdminKind::Stop);
                assert!(!(stop && robots.is_empty() && sound(&header, now_ns)), "a stop is never refused");
            }
            Ok(kind) => {
                assert!(sound(&header, now_ns), "{header:?}");
                let after = fleet.scenario();
                accepted(kind, &robots, &before, &after);
                holds(&after);
                held_as_asked(kind, held, fleet.hold());
            }
        }
    }
}

/// Whether a request may be looked at.
fn sound(header: &AdminRequest, now_ns: u64) -> bool {
    header.expires_ns > now_ns
        && header.expires_ns - now_ns <= 60_000_000_000
        && (header.epoch == 0 || header.epoch == EPOCH)
        && (1..=10).contains(&header.kind)
}

/// What was asked for is there, and nothing else has changed.
fn accepted(kind: AdminKind, asked: &[AdminRobot], before: &Scenario, after: &Scenario) {
    let named = |robot: &RobotSpec| asked.iter().find(|record| record.id == robot.id.0);
    let untouched =
        |s: &Scenario| s.robots.iter().filter(|r| named(r).is_none()).copied().collect::<Vec<_>>();
    assert_eq!(untouched(before), untouched(after));
    let moved = i64::try_from(after.robots.len()).unwrap() - i64::try_from(before.robots.len()).unwrap();
    let expected = match kind {
        AdminKind::AddRobot => 1,
        AdminKind::RemoveRobot => -1,
        _ => 0,
    };
    assert_eq!(moved, expected);
    for robot in after.robots.iter().filter(|_| kind != AdminKind::RemoveRobot) {
        let Some(record) = named(robot) else { continue };
        assert_eq!((robot.goal_m.x, robot.goal_m.y), (record.goal_x_m, record.goal_y_m));
    }
}

/// What is true of every fleet that was put together by requests.
fn holds(fleet: &Scenario) {
    assert!(fleet.robots.is_sorted_by(|a, b| a.id < b.id));
    assert!(fleet.robots.len() <= 6 && fleet.robots.iter().any(|robot| robot.id.0 == 9));
    let own: Vec<_> = fleet.robots.iter().filter(|robot| robot.foreign_speed_mps.is_none()).collect();
    for (i, robot) in own.iter().enumerate() {
        assert!(robot.start.is_finite() && robot.goal_m.norm() <= 50.0 && robot.radius_m > 0.0, "{robot:?}");
        for obstacle in &fleet.obstacles {
            let keep_m = obstacle.reach_m() + robot.radius_m + fleet.limits.safety_margin_m;
            assert!(obstacle.core_distance(robot.goal_m) >= keep_m - 1e-9, "{robot:?}");
        }
        for other in &own[..i] {
            let keep_m = fleet.limits.safety_margin_m + robot.radius_m + other.radius_m;
            assert!((robot.goal_m - other.goal_m).norm() >= keep_m - 1e-9, "{robot:?} {other:?}");
        }
    }
}

/// A stop holds until it is cleared, and nobody moves before a resume.
fn held_as_asked(kind: AdminKind, before: u32, after: u32) {
    let (paused, stopped) = (state_flags::PAUSED, state_flags::STOPPED);
    let expected = match kind {
        AdminKind::Stop => before | stopped,
        AdminKind::Pause => before | paused,
        AdminKind::Resume => 0,
        AdminKind::Clear if before & stopped != 0 => paused,
        _ => before,
    };
    assert_eq!(after, expected, "{kind:?}");
}
