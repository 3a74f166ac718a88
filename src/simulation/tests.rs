use super::hands::Wrong;
use super::*;

/// Seeds that failed once. Each is run for ever.
const ONCE_FAILED: &str = include_str!("seeds.txt");

fn check(seeds: impl Iterator<Item = u64>) {
    let options = Options::default();
    let mut failed = Vec::new();
    for seed in seeds {
        let outcome = simulate(seed, &options).unwrap();
        if !outcome.failures.is_empty() {
            failed.push((seed, outcome.class.name(), outcome.failures));
        }
    }
    assert!(failed.is_empty(), "clearway simulate --seeds A..B --trace: {failed:#?}");
}

#[test]
fn two_hundred_seeds_hold_even() {
    check((0..200).step_by(2));
}

#[test]
fn two_hundred_seeds_hold_odd() {
    check((1..200).step_by(2));
}

#[test]
fn seeds_that_failed_once_hold() {
    let lines = ONCE_FAILED.lines().filter(|line| !line.starts_with('#'));
    check(lines.filter_map(|line| line.split_whitespace().next()?.parse().ok()));
}

/// What the checks find about a controller that is broken on purpose.
fn found(options: &Options, set: impl Fn(&mut Run, &Plan)) -> Vec<char> {
    let mut all = Vec::new();
    for seed in 0..12 {
        let plan = Plan::new(seed, options).unwrap();
        let (outcome, _) = run_one(seed, plan.clone(), options, |run| set(run, &plan)).unwrap();
        all.extend(outcome.failures.into_iter().map(|failure| failure.invariant));
    }
    all
}

fn open(kinds: &[Kind]) -> Options {
    Options { class: Some(Class::Open), kinds: Some(kinds.to_vec()), periods: 60, ..Options::default() }
}

/// Twelve robots, who have to pass each other closely.
fn crowded(kinds: &[Kind]) -> Options {
    Options { robots: Some(12), periods: 90, ..open(kinds) }
}

#[test]
fn a_gate_that_forgets_when_commands_expire_is_found() {
    let options = open(&[Kind::CmdLost]);
    assert!(!found(&options, |_, _| ()).contains(&'a'));
    assert!(found(&options, |run, plan| run.world.ignore_expiry(plan)).contains(&'a'));
}

#[test]
fn a_command_that_was_never_verified_is_found() {
    let options = open(&[Kind::ObsRepeated]);
    assert!(found(&options, |_, _| ()).is_empty());
    let reckless = |run: &mut Run, _: &Plan| run.judge.sabotage.wrong = Some((20, Wrong::Reckless));
    assert!(found(&options, reckless).contains(&'b'));
}

/// Drives from where it is what was computed for where it should have been.
#[test]
fn a_gate_that_follows_whatever_comes_is_found() {
    let options = crowded(&[Kind::CmdLost]);
    assert!(found(&options, |_, _| ()).is_empty());
    assert!(found(&options, |run, _| run.world.follow_whatever_comes()).contains(&'b'));
}

#[test]
fn a_controller_that_takes_robots_to_be_where_they_were_sent_is_found() {
    let options = crowded(&[Kind::Halted]);
    assert!(found(&options, |_, _| ()).is_empty());
    let trusting = |run: &mut Run, _: &Plan| run.judge.sabotage.wrong = Some((0, Wrong::Trusting));
    assert!(found(&options, trusting).contains(&'b'));
}

#[test]
fn a_counter_that_does_not_move_is_found() {
    let options = open(&[Kind::ObsRepeated]);
    assert!(found(&options, |run, _| run.judge.sabotage.hides_counters = true).contains(&'c'));
}

#[test]
fn a_counter_that_moves_for_no_reason_is_found() {
    let options = open(&[Kind::ObsRepeated]);
    let wild = |run: &mut Run, _: &Plan| run.judge.sabotage.wrong = Some((20, Wrong::Wild));
    assert!(found(&options, wild).contains(&'c'));
}

#[test]
fn a_robot_that_does_not_recover_is_found() {
    let options = open(&[Kind::SolverGivesUp]);
    assert!(found(&options, |_, _| ()).is_empty());
    let stuck = |run: &mut Run, _: &Plan| run.judge.sabotage.wrong = Some((30, Wrong::GivesUp));
    assert!(found(&options, stuck).contains(&'d'));
}

#[test]
fn a_command_that_differs_in_its_last_bit_is_found() {
    let options = open(&[Kind::ObsRepeated]);
    let nudge = |run: &mut Run, _: &Plan| run.judge.sabotage.wrong = Some((20, Wrong::Nudge));
    assert!(found(&options, nudge).contains(&'e'));
}

#[test]
fn one_who_never_arrives_is_found() {
    let options = open(&[Kind::ObsRepeated]);
    let seed = 3;
    let plan = Plan::new(seed, &options).unwrap();
    // Where it is expected is not where it is sent.
    let astray = |run: &mut Run| run.expected_off_m = 1.0;
    let (outcome, _) = run_one(seed, plan, &options, astray).unwrap();
    assert!(outcome.failures.iter().any(|failure| failure.invariant == 'l'), "{:?}", outcome.failures);
}
