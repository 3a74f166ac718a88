//! Each fault by itself, in the whole controller under a virtual clock: what is done about it, which counter
//! tells of it, and how soon the robots drive again. `docs/SIMULATION.md` has the table.

use clearway::simulation::{Class, Kind, Options, Outcome, simulate};

fn options(kinds: &[Kind]) -> Options {
    Options { kinds: Some(kinds.to_vec()), class: Some(Class::Open), ..Options::default() }
}

/// Runs seeds with one kind of fault alone. Everything that the simulator checks has to hold: the counter
/// moved, the log told, no robot stopped for longer, nobody came too close, nothing else was counted.
fn alone(kind: Kind) -> Vec<Outcome> {
    let mut done = 0;
    let mut outcomes = Vec::new();
    for seed in 0..6 {
        let outcome = simulate(seed, &options(&[kind])).unwrap();
        assert!(outcome.failures.is_empty(), "{kind}, seed {seed}: {:?}", outcome.failures);
        done += outcome.shown.iter().filter(|shown| shown.kind == kind && shown.applied > 0).count();
        outcomes.push(outcome);
    }
    assert!(done > 0, "{kind} was never done");
    outcomes
}

/// The same, and the counter that it is named after moved at least once; the longest recovery, in periods.
fn counted(kind: Kind) -> u64 {
    let outcomes = alone(kind);
    let shown = outcomes.iter().flat_map(|outcome| &outcome.shown).filter(|shown| shown.kind == kind);
    assert!(shown.clone().any(|shown| shown.moved), "{kind}: {:?} did not move", kind.promise().counter());
    shown.map(|shown| shown.recovery).max().unwrap_or(0)
}

#[test]
fn a_panicking_worker_stops_its_robots_in_the_same_period() {
    assert!(counted(Kind::WorkerPanic) <= 1);
}

#[test]
fn a_worker_that_panics_again_and_again_rests() {
    assert!(counted(Kind::WorkerRests) <= 18);
}

#[test]
fn a_hanging_worker_is_noticed_within_two_periods() {
    assert!(counted(Kind::WorkerHang) <= 1);
}

#[test]
fn a_late_answer_is_not_used() {
    assert!(counted(Kind::WorkerLate) <= 1);
}

#[test]
fn a_solution_that_is_not_a_number_is_never_driven() {
    assert!(counted(Kind::SolverNan) <= 1);
}

#[test]
fn a_solution_beyond_the_limits_is_never_driven() {
    assert!(counted(Kind::SolverBeyond) <= 1);
}

#[test]
fn an_almost_solved_programme_is_never_driven() {
    assert!(counted(Kind::SolverAlmost) <= 1);
}

#[test]
fn a_solver_out_of_iterations_stops_its_robots() {
    assert!(counted(Kind::SolverGivesUp) <= 1);
}

#[test]
fn a_staged_command_that_no_robot_can_do_never_goes_out() {
    assert!(counted(Kind::AnswerWild) <= 1);
}

#[test]
fn an_overrun_skips_whole_periods_and_keeps_the_phase() {
    assert!(counted(Kind::Overrun) <= 1);
}

#[test]
fn what_is_late_is_thrown_away() {
    assert!(counted(Kind::Preempted) <= 1);
}

#[test]
fn coordinates_that_are_not_finite_are_refused() {
    assert!(counted(Kind::ObsNotFinite) <= 2);
}

#[test]
fn coordinates_outside_of_the_arena_are_refused() {
    assert!(counted(Kind::ObsOutOfRange) <= 2);
}

#[test]
fn an_unknown_robot_is_refused() {
    assert!(counted(Kind::ObsUnknownRobot) <= 2);
}

#[test]
fn a_robot_that_stands_twice_in_a_sample_is_quarantined() {
    assert!(counted(Kind::ObsDuplicate) <= 8);
}

#[test]
fn a_masquerading_writer_is_refused() {
    assert!(counted(Kind::ObsMasquerade) <= 8);
}

#[test]
fn a_sample_for_more_robots_than_there_are_is_refused_as_a_whole() {
    assert!(counted(Kind::ObsOversize) <= 2);
}

#[test]
fn a_repeated_observation_is_refused() {
    assert!(counted(Kind::ObsRepeated) == 0);
}

#[test]
fn a_reordered_observation_is_refused() {
    assert!(counted(Kind::ObsReordered) == 0);
}

#[test]
fn lost_observations_are_counted() {
    assert!(counted(Kind::ObsLost) <= 2);
}

#[test]
fn a_sequence_far_ahead_is_refused() {
    assert!(counted(Kind::ObsGap) <= 2);
}

#[test]
fn an_observation_of_another_epoch_is_refused() {
    assert!(counted(Kind::ObsOldEpoch) <= 2);
}

#[test]
fn a_stale_observation_is_refused() {
    assert!(counted(Kind::ObsStale) <= 2);
}

#[test]
fn an_observation_from_the_future_is_refused() {
    assert!(counted(Kind::ObsFuture) <= 2);
}

#[test]
fn a_teleport_is_quarantined_and_readmitted() {
    assert!(counted(Kind::ObsTeleport) <= 8);
}

#[test]
fn a_frozen_pose_raises_the_alarm() {
    assert!(counted(Kind::ObsFrozen) <= 8);
}

#[test]
fn a_silent_driver_stops_its_robots() {
    assert!(counted(Kind::ObsSilence) <= 2);
}

#[test]
fn a_driver_that_was_started_again_is_heard_once_the_old_one_is_silent() {
    assert!(counted(Kind::DriverRestart) <= 5);
}

#[test]
fn a_robot_that_was_carried_away_is_quarantined_and_readmitted() {
    assert!(counted(Kind::Kidnapped) <= 8);
}

#[test]
fn a_lost_state_stops_the_worker_s_robots() {
    assert!(counted(Kind::StateLost) <= 1);
}

#[test]
fn a_state_of_an_earlier_period_is_not_answered() {
    assert!(counted(Kind::StateOld) <= 1);
}

#[test]
fn a_state_of_another_epoch_is_not_answered() {
    assert!(counted(Kind::StateOtherEpoch) <= 1);
}

#[test]
fn a_flipped_bit_of_an_observation_is_refused() {
    assert!(counted(Kind::ObsBit) <= 2);
}

#[test]
fn a_flipped_bit_of_a_state_stops_the_worker_s_robots() {
    assert!(counted(Kind::StateBit) <= 1);
}

#[test]
fn a_flipped_bit_of_a_command_is_not_acted_on() {
    assert!((1..=4).contains(&counted(Kind::CmdBit)));
}

#[test]
fn a_repeated_command_is_refused() {
    assert!(counted(Kind::CmdRepeated) == 0);
}

#[test]
fn a_late_command_is_refused() {
    assert!((1..=4).contains(&counted(Kind::CmdLate)));
}

#[test]
fn a_command_of_an_earlier_epoch_is_refused() {
    assert!(counted(Kind::CmdOldEpoch) == 0);
}

#[test]
fn another_robot_s_command_is_refused() {
    assert!(counted(Kind::CmdWrongRobot) == 0);
}

#[test]
fn a_command_beyond_the_limits_is_refused() {
    assert!(counted(Kind::CmdWild) == 0);
}

#[test]
fn a_command_that_holds_too_long_is_refused() {
    assert!(counted(Kind::CmdForever) == 0);
}

#[test]
fn memory_that_is_exhausted_stops_nobody_for_good() {
    assert!(counted(Kind::Exhausted) <= 1);
}

#[test]
fn goals_that_cannot_be_are_refused_with_a_reason() {
    assert!(counted(Kind::OpBadGoal) == 0);
}

#[test]
fn a_pause_holds_everybody_until_it_is_resumed() {
    assert!(counted(Kind::OpPause) <= 2);
}

#[test]
fn a_stop_is_latched_until_it_is_cleared() {
    assert!(counted(Kind::OpStop) <= 6);
}

#[test]
fn one_robot_more_than_there_is_room_for_is_refused() {
    assert!(counted(Kind::OpAdd) <= 6);
}

#[test]
fn a_daemon_that_is_killed_comes_back_in_a_new_epoch() {
    alone(Kind::Kill);
}

#[test]
fn a_subnormal_coordinate_is_a_number_like_any_other() {
    alone(Kind::ObsSubnormal);
}

#[test]
fn a_command_that_is_lost_leaves_its_robots_standing() {
    assert!((1..=4).contains(&counted(Kind::CmdLost)));
}

#[test]
fn a_robot_that_stops_by_itself_is_kept_clear_of_and_goes_on() {
    assert!((1..=4).contains(&counted(Kind::Halted)));
}

#[test]
fn a_goal_from_an_operator_is_driven_to() {
    alone(Kind::OpGoal);
}

/// Every kind of fault has a test above that names it.
#[test]
fn every_kind_of_fault_is_tried_alone() {
    let text = include_str!("simulation.rs");
    for kind in Kind::ALL.iter().filter(|kind| kind.promise().is_fault()) {
        let (counted, alone) = (format!("counted(Kind::{kind:?})"), format!("alone(Kind::{kind:?})"));
        assert!(text.contains(&counted) || text.contains(&alone), "{kind:?}");
    }
}

/// The table of `docs/SIMULATION.md`: what is promised about each kind, as the code has it.
#[test]
fn the_documentation_lists_every_kind_of_fault() {
    let text = include_str!("../docs/SIMULATION.md");
    let listed: Vec<&str> = text.lines().filter(|line| line.starts_with("| `")).collect();
    let faults = Kind::ALL.iter().map(|kind| kind.promise()).filter(|promise| promise.is_fault());
    let rows: Vec<String> = faults
        .map(|promise| {
            let counter = promise.counter().map_or("–".to_owned(), |counter| format!("`{counter}`"));
            format!("| `{}` | {} | {counter} | {} |", promise.name, promise.policy, promise.recovery)
        })
        .collect();
    assert_eq!(listed, rows, "\n{}", rows.join("\n"));
}

/// All faults together, in fleets of one class.
fn class(class: Class) {
    for seed in 0..8 {
        let outcome = simulate(seed, &Options { class: Some(class), ..Options::default() }).unwrap();
        assert!(outcome.failures.is_empty(), "seed {seed}: {:?}", outcome.failures);
        assert_eq!(outcome.class, class);
    }
}

#[test]
fn coincident_robots_get_finite_commands() {
    class(Class::Coincident);
}

#[test]
fn robots_that_overlap_at_the_start_never_come_closer() {
    class(Class::Overlap);
}

#[test]
fn robots_at_their_goals_and_headings_at_pi_are_bounded() {
    class(Class::AtGoal);
    class(Class::Wrap);
}

#[test]
fn a_robot_that_cannot_come_nearer_to_its_goal_stays_safe() {
    class(Class::Boxed);
}

#[test]
fn more_neighbours_than_rows_stop_a_robot_and_nothing_is_cut_off() {
    class(Class::Crowd);
}

#[test]
fn a_foreign_robot_is_kept_clear_of() {
    class(Class::Foreign);
}

#[test]
fn robots_far_from_every_fault_do_what_they_do_without_it() {
    class(Class::TwoGroups);
}

#[test]
fn the_same_seed_gives_the_same_bits() {
    for seed in [2, 5, 11] {
        let once = simulate(seed, &Options::default()).unwrap();
        let again = simulate(seed, &Options { trace: true, ..Options::default() }).unwrap();
        assert_eq!((once.digest, once.periods), (again.digest, again.periods));
        let other = simulate(seed + 1, &Options::default()).unwrap();
        assert_ne!(once.digest, other.digest);
    }
}

/// Faults that are about observations and commands do the same whoever answers whom.
#[test]
fn the_number_of_workers_changes_no_bit() {
    let kinds = [Kind::ObsTeleport, Kind::ObsSilence, Kind::ObsLost, Kind::Overrun, Kind::CmdRepeated];
    let digest = |workers| {
        let options = Options { workers: Some(workers), periods: 100, ..options(&kinds) };
        simulate(4, &options).unwrap().digest
    };
    assert_eq!(digest(1), digest(2));
    assert_eq!(digest(1), digest(3));
}
