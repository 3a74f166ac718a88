//! What a new run makes of what an earlier one kept.

use super::{Damage, Kept, Moment, StoppedBy, own};
use crate::config::{Config, SourceKind};
use crate::model::RobotSpec;
use crate::scenario::ROUNDING_M;

/// Where a run begins.
#[derive(Debug, Clone, PartialEq)]
pub struct Resumed {
    /// The configuration with the robots and the goals that the fleet has by now.
    pub config: Config,
    /// What is to be kept from now on; the epoch is the smallest that this run may have.
    pub kept: Kept,
    /// Whether there was a run before, so that robots may stand anywhere.
    pub again: bool,
    /// Why what was found is not gone by and has to be kept aside: a word for the name of a file.
    pub aside: Option<&'static str>,
    /// What people should know, a line each; those that call for somebody first.
    pub notes: Vec<Note>,
}

/// Something that people should know about a start.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Note {
    /// Whether somebody has to look after it.
    pub alarm: bool,
    /// What it is, and what to do.
    pub text: String,
}

impl Note {
    fn alarm(text: String) -> Self {
        Self { alarm: true, text }
    }

    fn info(text: String) -> Self {
        Self { alarm: false, text }
    }
}

/// The journal is that of another fleet, which may be running.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OtherFleet(pub String);

/// Where a run of `config` begins that found a journal, or none, at `now`.
///
/// Goals and robots are those of the journal if it is of the same scenario; a stop and a pause are, of
/// whatever scenario it is. A journal that cannot be read stops the fleet, because nobody knows whether
/// it was. So do too many starts after runs that did not end in order. A fresh start takes neither robots
/// nor goals nor a stop nor a pause; that there was a run it knows all the same.
///
/// # Errors
/// [`OtherFleet`].
pub fn resume(
    config: Config,
    found: Option<Result<Kept, Damage>>,
    now: &Moment,
) -> Result<Resumed, OtherFleet> {
    let mut kept = Kept::new(&config.fleet, &config.scenario);
    let fresh = config.journal.fresh;
    let mut resumed =
        Resumed { config, kept: kept.clone(), again: found.is_some(), aside: None, notes: vec![] };
    match found {
        None => {}
        Some(Err(damage)) if fresh => {
            resumed.aside = Some("damaged");
            resumed.notes.push(Note::alarm(format!(
                "{damage}. Whether the fleet was stopped is not known: it begins as its scenario says, as was \
                 asked"
            )));
        }
        Some(Err(damage)) => {
            kept.stopped = Some(StoppedBy::Journal);
            resumed.aside = Some("damaged");
            resumed.notes.push(Note::alarm(format!(
                "{damage}. Whether the fleet was stopped is not known: it comes up stopped, with the goals of \
                 its scenario; set its goals, then `clearway clear` and `clearway resume`"
            )));
        }
        Some(Ok(before)) if before.fleet != kept.fleet => return Err(OtherFleet(before.fleet)),
        Some(Ok(before)) => {
            kept.epoch = before.epoch.saturating_add(1);
            if !fresh {
                (kept.paused, kept.stopped) = (before.paused, before.stopped);
                resumed.notes.extend(held(&before));
            }
            if !before.ended {
                kept.restarts = before.restarts.clone();
                count(&resumed.config, &mut kept, now, &mut resumed.notes);
            }
            if fresh {
                resumed.aside = Some("before-fresh");
                let text = "its robots, goals, stop and pause are not taken up, as was asked";
                resumed.notes.push(Note::info(text.to_owned()));
            } else if before.digest == kept.digest {
                take_up(&mut resumed, &before);
                kept.robots = own(&resumed.config.scenario.robots);
            } else {
                resumed.aside = Some("other-scenario");
                resumed.notes.push(Note::alarm(format!(
                    "it is of scenario `{}` as that was then, and not of today's `{}`: the goals are those of \
                     today's scenario",
                    before.scenario, kept.scenario
                )));
            }
        }
    }
    resumed.kept = kept;
    Ok(resumed)
}

/// That the fleet was left stopped or paused.
fn held(before: &Kept) -> Option<Note> {
    let text = match (before.stopped, before.paused) {
        (Some(by), _) => {
            format!("the fleet was stopped ({by}) and still is: `clearway clear`, then `clearway resume`")
        }
        (None, true) => "the fleet was paused and still is: `clearway resume`".to_owned(),
        (None, false) => return None,
    };
    Some(Note::alarm(text))
}

/// Counts a start after a crash; too many of them stop the fleet.
fn count(config: &Config, kept: &mut Kept, now: &Moment, notes: &mut Vec<Note>) {
    let limits = &config.journal;
    let restarts = kept.restarts.add(now, limits.restarts_within_ns);
    let within_s = limits.restarts_within_ns / 1_000_000_000;
    if limits.restarts > 0 && restarts as u64 >= u64::from(limits.restarts) {
        kept.stopped = Some(StoppedBy::Restarts);
    }
    notes.push(if kept.stopped == Some(StoppedBy::Restarts) {
        Note::alarm(format!(
            "the daemon did not end in order and was started again {restarts} times within {within_s} s: the \
             fleet is stopped; find out why, then `clearway clear` and `clearway resume`"
        ))
    } else {
        Note::alarm(format!("the run before did not end in order: restart {restarts} within {within_s} s"))
    });
}

/// Gives the fleet the robots and goals of `before`.
fn take_up(resumed: &mut Resumed, before: &Kept) {
    let config = &mut resumed.config;
    // Whoever was removed leaves room for others.
    config.admin.capacity = config.places();
    let scenario = &config.scenario;
    let was = |id| scenario.robots.iter().find(|robot: &&RobotSpec| robot.id == id);
    let mut robots: Vec<_> =
        scenario.robots.iter().filter(|robot| robot.foreign_speed_mps.is_some()).copied().collect();
    // Who was removed and added again has another start, or another size, under the same id.
    let (old, added): (Vec<RobotSpec>, Vec<RobotSpec>) = before.robots.iter().partition(|robot| {
        was(robot.id).is_some_and(|was| RobotSpec { goal_m: robot.goal_m, ..*was } == **robot)
    });
    let goals = old.iter().filter(|robot| was(robot.id).is_some_and(|w| w.goal_m != robot.goal_m)).count();
    let gone = own(&scenario.robots).len().saturating_sub(old.len());
    robots.extend(old);
    let mut joined = 0;
    for robot in added {
        // A plant is begun anew, and somebody else's start may be where it was added.
        if config.source.kind == SourceKind::Plant
            && !has_room(&robot, &robots, scenario.limits.safety_margin_m)
        {
            resumed.notes.push(Note::alarm(format!(
                "robot {} is left out: its start is too close to another's in the plant, which begins anew; add \
                 it again",
                robot.id
            )));
        } else {
            joined += 1;
            robots.push(robot);
        }
    }
    robots.sort_by_key(|robot| robot.id);
    resumed.notes.push(Note::info(format!(
        "{} robots; {goals} have another goal than in the scenario, {joined} were added, {gone} removed",
        robots.len()
    )));
    config.scenario.robots = robots;
}

fn has_room(robot: &RobotSpec, others: &[RobotSpec], margin_m: f64) -> bool {
    others.iter().all(|other| {
        let apart_m = (other.start.position_m - robot.start.position_m).norm();
        apart_m >= margin_m + robot.radius_m + other.radius_m - ROUNDING_M
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::{Pose, Vec2};
    use crate::journal::Restarts;
    use crate::model::RobotId;
    use crate::scenario::Scenario;

    fn config() -> Config {
        Config::new(Scenario::builtin("swap8").unwrap())
    }

    fn at_s(s: u64) -> Moment {
        Moment { boot: "b".into(), ns: s * 1_000_000_000 }
    }

    fn found(kept: &Kept, now: &Moment) -> Resumed {
        resume(config(), Some(Ok(kept.clone())), now).unwrap()
    }

    fn before() -> Kept {
        Kept { epoch: 9, ..Kept::new("default", &config().scenario) }
    }

    fn ended(kept: Kept) -> Kept {
        Kept { ended: true, ..kept }
    }

    #[test]
    fn a_first_start_begins_as_the_scenario_says() {
        let resumed = resume(config(), None, &at_s(1)).unwrap();
        assert_eq!((resumed.config, resumed.kept.epoch), (config(), 0));
        assert!(!resumed.again && resumed.aside.is_none() && resumed.notes.is_empty());
    }

    #[test]
    fn goals_robots_stop_and_pause_are_taken_up_in_a_later_epoch() {
        let mut kept = before();
        kept.robots.remove(3);
        kept.robots[0].goal_m = Vec2::new(-7.0, 0.1 + 0.2);
        let new = RobotSpec { id: RobotId(99), start: Pose::new(50.0, 0.0, 0.0), ..kept.robots[1] };
        kept.robots.push(new);
        (kept.paused, kept.stopped) = (true, Some(StoppedBy::Operator));
        let resumed = found(&ended(kept.clone()), &at_s(1));
        assert_eq!(resumed.config.scenario.robots, kept.robots);
        assert_eq!((resumed.config.places(), resumed.kept.epoch), (8, 10));
        assert_eq!((resumed.kept.paused, resumed.kept.stopped), (true, Some(StoppedBy::Operator)));
        assert!(resumed.again && !resumed.kept.ended && resumed.aside.is_none());
        let told = |text: &str| resumed.notes.iter().any(|note| note.text.contains(text));
        assert!(told("stopped (operator)") && told("1 have another goal") && told("1 were added, 1 removed"));
    }

    #[test]
    fn in_a_plant_that_begins_anew_nobody_starts_inside_another() {
        let mut kept = before();
        let start = kept.robots[0].start;
        kept.robots.push(RobotSpec { id: RobotId(99), start, ..kept.robots[0] });
        let resumed = found(&ended(kept.clone()), &at_s(1));
        assert_eq!(resumed.config.scenario.robots.len(), 8);
        assert!(resumed.notes[0].alarm && resumed.notes[0].text.contains("robot 99"));
        assert_eq!(resumed.kept.robots, resumed.config.scenario.robots);
        // Who is observed stands where it is seen.
        let mut observed = config();
        observed.source.kind = SourceKind::Observation;
        let resumed = resume(observed, Some(Ok(ended(kept))), &at_s(1)).unwrap();
        assert_eq!(resumed.config.scenario.robots.len(), 9);
    }

    #[test]
    fn who_was_added_again_elsewhere_under_its_old_id_is_looked_at_like_anybody_added() {
        let mut kept = before();
        let (first, fourth) = (kept.robots[0], kept.robots[3]);
        for (start, radius_m, stays) in [
            (Pose::new(50.0, 0.0, 0.0), fourth.radius_m, true),
            (first.start, fourth.radius_m, false),
            (fourth.start, 20.0, false),
        ] {
            kept.robots[3] = RobotSpec { radius_m, start, ..fourth };
            let resumed = found(&ended(kept.clone()), &at_s(1));
            assert_eq!(resumed.config.scenario.robots.len(), if stays { 8 } else { 7 });
            assert_eq!(resumed.notes[0].alarm, !stays);
            let counts = format!("{} were added, 1 removed", u8::from(stays));
            assert!(resumed.notes.iter().any(|note| note.text.contains(&counts)), "{:?}", resumed.notes);
        }
    }

    #[test]
    fn restarts_after_crashes_stop_the_fleet_and_an_orderly_end_forgives_them() {
        let mut kept = before();
        for (n, expected) in [(1, None), (2, None), (3, Some(StoppedBy::Restarts))] {
            kept = found(&kept, &at_s(10 * n)).kept;
            assert_eq!((kept.restarts.at_ns.len() as u64, kept.stopped), (n, expected));
        }
        // It stays, however the next run begins, until somebody clears it.
        let later = found(&ended(kept.clone()), &at_s(10_000)).kept;
        assert_eq!((later.stopped, later.restarts.at_ns.len()), (Some(StoppedBy::Restarts), 0));
        (kept.stopped, kept.restarts) = (None, Restarts::default());
        for n in [0, 40, 80, 120] {
            kept = found(&kept, &at_s(10_000 + n)).kept;
            assert_eq!(kept.stopped, None, "two a minute are not too many");
        }
        let mut never = config();
        never.journal.restarts = 0;
        let mut kept = before();
        for n in 0..20 {
            kept = resume(never.clone(), Some(Ok(kept)), &at_s(n)).unwrap().kept;
        }
        assert_eq!((kept.stopped, kept.restarts.at_ns.len()), (None, 20));
    }

    #[test]
    fn a_stop_outlives_the_scenario_and_goals_do_not() {
        let mut kept = before();
        kept.robots[0].goal_m = Vec2::new(-7.0, 0.0);
        kept.digest = "another".into();
        kept.stopped = Some(StoppedBy::Operator);
        let resumed = found(&ended(kept), &at_s(1));
        assert_eq!(resumed.config, config());
        assert_eq!(resumed.kept.stopped, Some(StoppedBy::Operator));
        assert_eq!(resumed.aside, Some("other-scenario"));
    }

    #[test]
    fn what_cannot_be_read_stops_the_fleet_and_what_is_anothers_is_left_alone() {
        let resumed = resume(config(), Some(Err(Damage::Checksum)), &at_s(1)).unwrap();
        assert_eq!(resumed.kept.stopped, Some(StoppedBy::Journal));
        assert_eq!((resumed.aside, resumed.again), (Some("damaged"), true));
        assert!(resumed.notes[0].alarm);
        let other = Kept { fleet: "night".into(), ..before() };
        assert_eq!(resume(config(), Some(Ok(other)), &at_s(1)).unwrap_err(), OtherFleet("night".into()));
    }

    #[test]
    fn a_fresh_start_drops_what_operators_wanted_and_knows_that_there_was_a_run() {
        let mut fresh = config();
        fresh.journal.fresh = true;
        let start = |kept| resume(fresh.clone(), Some(kept), &at_s(1));
        let mut kept = before();
        kept.robots.remove(3);
        (kept.paused, kept.stopped) = (true, Some(StoppedBy::Operator));
        for digest in [kept.digest.clone(), "another".to_owned()] {
            let resumed = start(Ok(Kept { digest, ..kept.clone() })).unwrap();
            assert_eq!(resumed.config, fresh);
            assert_eq!((resumed.kept.paused, resumed.kept.stopped), (false, None));
            assert_eq!((resumed.again, resumed.kept.epoch), (true, 10));
            assert_eq!((resumed.kept.restarts.at_ns.len(), resumed.aside), (1, Some("before-fresh")));
        }
        let resumed = start(Err(Damage::Checksum)).unwrap();
        assert_eq!((resumed.again, resumed.kept.stopped, resumed.aside), (true, None, Some("damaged")));
        // Another fleet may be running, with its stop.
        let other = start(Ok(Kept { fleet: "night".into(), ..kept }));
        assert_eq!(other.unwrap_err(), OtherFleet("night".into()));
        let first = resume(fresh.clone(), None, &at_s(1)).unwrap();
        assert!(!first.again && first.aside.is_none());
    }
}
