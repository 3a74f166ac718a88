//! Theorem 4 of docs/MATH.md: who drives keeps clear of every place at which another robot may have come to
//! a stand on its way, over continuous time.

use clearway::config::{BarrierForm, Config};
use clearway::controller::{RobotGroup, Timing};
use clearway::evaluation::initial_fleet;
use clearway::geometry::{Arc, Pose, Vec2, min_distance_arc_point};
use clearway::model::Command;
use clearway::scenario::Scenario;
use clearway::wire::{RobotState, state_flags};
use proptest::prelude::*;

const T: f64 = 0.08;

/// A robot that decides, and another one somewhere on its way: what it drove since it was seen, as
/// (v m/s, ω rad/s, s), and what it is to drive in the period that runs.
#[derive(Debug, Clone)]
struct Meeting {
    own: (Pose, Command),
    goal_m: Vec2,
    seen: Pose,
    since: Vec<(f64, f64, f64)>,
    held: Command,
    reverses: bool,
    form: BarrierForm,
}

prop_compose! {
    fn any_meeting()(
        at in (-3.1..3.1f64, 0.46..1.6f64, -3.1..3.1f64, -3.1..3.1f64),
        own in (prop_oneof![Just(5.0), 0.0..5.0f64], -1.0..1.0f64), to in -3.1..3.1f64,
        since in prop::collection::vec((prop_oneof![Just(5.0), 0.0..5.0f64], -1.0..1.0f64, 0.0..0.08f64), 0..3),
        held in (prop_oneof![Just(0.0), Just(5.0), 0.0..5.0f64], prop_oneof![Just(0.0), -1.0..1.0f64]),
        reverses in any::<bool>(), exact in any::<bool>(),
    ) -> Meeting {
        let (bearing, distance_m, theta, other_theta) = at;
        let of = |(v_mps, omega_radps)| Command { v_mps, omega_radps };
        Meeting {
            own: (Pose::new(distance_m * bearing.cos(), distance_m * bearing.sin(), theta), of(own)),
            goal_m: Vec2::new(to.cos(), to.sin()) * 6.0,
            seen: Pose::new(0.0, 0.0, other_theta),
            since, held: of(held), reverses,
            form: if exact { BarrierForm::Exact } else { BarrierForm::Linear },
        }
    }
}

/// What the first robot does after the state, and how much closer than it may it comes to any place at which the
/// other one may stand, m; `told` whether it is told that the other one may.
fn intrusion_m(meeting: &Meeting, told: bool) -> (Command, f64) {
    let mut scenario = Scenario::builtin("head-on").unwrap();
    if meeting.reverses {
        scenario.limits.v_min_mps = -3.0;
    }
    let required_m = scenario.required_distance_m(0, 1);
    let mut config = Config::new(scenario);
    config.controller.barrier = meeting.form;
    let mut fleet = initial_fleet(&config);
    let set = |state: &mut RobotState, pose: Pose, held: Command| {
        state.flags |= state_flags::VALID;
        state.set_pose(pose);
        state.set_command(held);
    };
    let (mut pose, mut way_m, mut places) = (meeting.seen, 0.0, Vec::new());
    for (v_mps, omega_radps, s) in
        meeting.since.iter().copied().chain([(meeting.held.v_mps, meeting.held.omega_radps, 0.0)])
    {
        let arc = Arc { start: pose, v_mps, omega_radps };
        let s_max = if s == 0.0 { T } else { s };
        places.extend((0..=20).map(|k| arc.position(s_max * f64::from(k) / 20.0)));
        (pose, way_m) = (arc.pose(s), way_m + v_mps.abs() * s);
    }
    set(&mut fleet[0], meeting.own.0, meeting.own.1);
    (fleet[0].goal_x_m, fleet[0].goal_y_m) = (meeting.goal_m.x, meeting.goal_m.y);
    set(&mut fleet[1], pose, meeting.held);
    (fleet[1].seen_x_m, fleet[1].seen_y_m, fleet[1].way_m) =
        (meeting.seen.position_m.x, meeting.seen.position_m.y, way_m);
    fleet[1].flags |= if told { state_flags::MAY_STAND } else { 0 };
    let mut command = Command::STOP;
    let mut group = RobotGroup::new(&config, 0..1).unwrap();
    group.solve(&fleet, Timing::LogicalExecutionTime, |_, decision| command = decision.command.command());
    let start = fleet[0].arc().pose(T);
    let arc = Arc { start, v_mps: command.v_mps, omega_radps: command.omega_radps };
    let intrudes = |place: &Vec2| {
        let before_m = (start.position_m - place).norm();
        required_m.min(before_m) - min_distance_arc_point(&arc, *place, T).lower_m
    };
    (command, places.iter().map(intrudes).fold(f64::NEG_INFINITY, f64::max))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(3_000))]

    #[test]
    fn nobody_comes_too_close_to_where_another_one_may_stand(meeting in any_meeting()) {
        let (command, intrusion_m) = intrusion_m(&meeting, true);
        prop_assert!(intrusion_m <= 1e-9, "{intrusion_m} m at {command:?}");
    }
}

/// The check above can fail: it does for robots that are not told. And they still drive when they are.
#[test]
fn who_is_not_told_comes_too_close_and_who_is_told_still_drives() {
    let own = |x: f64, theta| (Pose::new(x, 0.05, theta), Command { v_mps: 0.0, omega_radps: 0.0 });
    // The other one drives off to the left, out of the way of one that comes from the right.
    let meeting = Meeting {
        own: own(0.5, std::f64::consts::PI),
        goal_m: Vec2::new(-6.0, 0.0),
        seen: Pose::new(0.0, 0.0, std::f64::consts::PI),
        since: vec![],
        held: Command { v_mps: 5.0, omega_radps: 0.0 },
        reverses: false,
        form: BarrierForm::Exact,
    };
    let (careless, intrusion_m_untold) = intrusion_m(&meeting, false);
    assert!(careless.v_mps > 1.0 && intrusion_m_untold > 0.01, "{careless:?} {intrusion_m_untold}");
    let (careful, intrusion_m) = intrusion_m(&meeting, true);
    assert!(careful.v_mps > 0.2 && careful.v_mps < careless.v_mps && intrusion_m <= 1e-9, "{careful:?}");
}
