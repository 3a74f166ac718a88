//! Operators' requests.

use super::*;

fn fleet() -> Rehearsal {
    let mut config = Config::new(Scenario::builtin("swap8").unwrap());
    config.admin.capacity = 9;
    Rehearsal::new(&config, EPOCH)
}

const SOUND: AdminRequest = AdminRequest {
    ticket: 1,
    expires_ns: NOW + 1,
    epoch: EPOCH,
    offset: 0,
    kind: AdminKind::SetGoals as u32,
    reserved: 0,
};

const NEW: AdminRobot = AdminRobot {
    id: 50,
    reserved: 0,
    goal_x_m: 30.0,
    goal_y_m: 30.0,
    start_x_m: 20.0,
    start_y_m: 20.0,
    start_theta_rad: 0.0,
    radius_m: 0.15,
};

/// What one request comes to: accepted, or refused with nothing changed.
fn asked(request: AdminRequest, robots: &[AdminRobot]) -> Option<AdminCode> {
    let mut fleet = fleet();
    let (before, hold) = (fleet.scenario(), fleet.hold());
    let refusal = fleet.ask(&request, robots, NOW).err();
    if let Some(refusal) = &refusal {
        assert!(!refusal.text.is_empty() && refusal.text.len() < 300, "{refusal:?}");
        assert_eq!((fleet.scenario(), fleet.hold()), (before, hold));
    }
    refusal.map(|refusal| refusal.code)
}

proptest! {
    #[test]
    fn a_goal_is_in_the_arena_or_refused(x in number(), y in number()) {
        let code = asked(SOUND, &[AdminRobot { goal_x_m: x, goal_y_m: y, ..AdminRobot::default() }]);
        let arena_m = SourceConfig::default().arena_m;
        if !(x.is_finite() && y.is_finite()) {
            prop_assert_eq!(code, Some(AdminCode::NotFinite));
        } else if x.hypot(y) > arena_m * (1.0 + 1e-12) {
            prop_assert_eq!(code, Some(AdminCode::OutsideArena));
        } else if x.hypot(y) < arena_m * (1.0 - 1e-12) {
            prop_assert!(matches!(code, None | Some(AdminCode::GoalTaken)), "{code:?}");
        }
    }

    #[test]
    fn a_new_robot_has_a_body_and_a_place_or_is_refused(
        radius_m in number(), start_theta_rad in number(), id in half(), start_x_m in number(),
    ) {
        let request = AdminRequest { kind: AdminKind::AddRobot as u32, ..SOUND };
        let ask = |record: AdminRobot| asked(request, &[record]);
        let sound = radius_m > 0.0 && radius_m <= 100.0;
        let code = ask(AdminRobot { radius_m, goal_x_m: 300.0, ..NEW });
        prop_assert_eq!(code, (!sound).then_some(AdminCode::BadRadius));
        let code = ask(AdminRobot { start_theta_rad, ..NEW });
        prop_assert_eq!(code, (!start_theta_rad.is_finite()).then_some(AdminCode::NotFinite));
        let code = ask(AdminRobot { id, ..NEW });
        prop_assert_eq!(code, (id < 8 || id == u32::MAX).then_some(AdminCode::TakenId));
        let code = ask(AdminRobot { start_x_m, ..NEW });
        let expected = if start_x_m.is_finite() {
            (start_x_m.hypot(20.0) > SourceConfig::default().arena_m).then_some(AdminCode::OutsideArena)
        } else {
            Some(AdminCode::NotFinite)
        };
        prop_assert_eq!(code, expected);
    }

    #[test]
    fn only_robots_of_the_fleet_are_spoken_of(id in half(), reserved in any::<u32>()) {
        let unknown = (id > 7).then_some(AdminCode::UnknownRobot);
        let record = AdminRobot { id, reserved, goal_x_m: 30.0, goal_y_m: 30.0, ..AdminRobot::default() };
        prop_assert_eq!(asked(SOUND, &[record]), unknown);
        let request = AdminRequest { kind: AdminKind::RemoveRobot as u32, ..SOUND };
        prop_assert_eq!(asked(request, &[record]), unknown);
    }

    #[test]
    fn an_expiry_an_epoch_and_a_kind_are_looked_at(expires_ns in prop_oneof![word(NOW), word(NOW + 60_000_000_000)], epoch in word(EPOCH), kind in half()) {
        let goal = [AdminRobot { goal_x_m: 30.0, ..AdminRobot::default() }];
        let expected = if expires_ns <= NOW {
            Some(AdminCode::Expired)
        } else {
            (expires_ns - NOW > 60_000_000_000).then_some(AdminCode::Malformed)
        };
        prop_assert_eq!(asked(AdminRequest { expires_ns, ..SOUND }, &goal), expected);
        let other = (epoch != 0 && epoch != EPOCH).then_some(AdminCode::OtherEpoch);
        prop_assert_eq!(asked(AdminRequest { epoch, ..SOUND }, &goal), other);
        // About robot 0: goals are set and it is removed; the rest takes no robot, or a sound new one.
        let expected = match AdminKind::from_code(kind) {
            Some(AdminKind::SetGoals | AdminKind::RemoveRobot) => None,
            Some(AdminKind::AddRobot) => Some(AdminCode::TakenId),
            _ => Some(AdminCode::Malformed),
        };
        prop_assert_eq!(asked(AdminRequest { kind, ..SOUND }, &goal), expected);
    }

    #[test]
    fn what_is_repeated_or_reserved_has_no_effect(ticket in any::<u64>(), offset in any::<u64>(), reserved in any::<u32>()) {
        let goal = [AdminRobot { reserved, goal_x_m: 30.0, ..AdminRobot::default() }];
        prop_assert_eq!(asked(AdminRequest { ticket, offset, reserved, ..SOUND }, &goal), None);
    }
}
