use clearway::config::Config;
use clearway::journal::{Damage, Kept, Moment, StoppedBy, resume};
use clearway::scenario::Scenario;
use std::sync::LazyLock;

static CONFIG: LazyLock<Config> =
    LazyLock::new(|| Config::new(Scenario::builtin("swap8").expect("a built-in scenario is sound")));

/// A file that was found is what was once written, to the byte, or is refused in one short line; and a start
/// from it loses no stop. The input is taken as a file, and as the text below a right first line.
pub fn journal(data: &[u8]) {
    look(data);
    let hash = sha1_smol::Sha1::from(data).hexdigest();
    let head = format!("# clearway-journal 1 {} {hash}\n", data.len());
    look(&[head.as_bytes(), data].concat());
}

fn look(file: &[u8]) {
    let found = Kept::decode(file);
    let now = Moment { boot: "b".to_owned(), ns: 1 << 40 };
    match &found {
        Ok(kept) => {
            assert_eq!(Kept::decode(kept.encode().as_bytes()).as_ref(), Ok(kept));
            assert!(kept.robots.is_sorted_by(|a, b| a.id < b.id));
            for robot in &kept.robots {
                let numbers = [robot.radius_m, robot.goal_m.x, robot.goal_m.y];
                assert!(robot.start.is_finite() && numbers.iter().all(|x| x.is_finite()), "{robot:?}");
            }
        }
        Err(damage) => shows(damage),
    }
    let before = found.clone();
    match (resume(CONFIG.clone(), Some(found), &now), before) {
        (Err(other), before) => assert_eq!(Ok(other.0), before.map(|kept| kept.fleet)),
        (Ok(resumed), Err(_)) => {
            assert_eq!(resumed.kept.stopped, Some(StoppedBy::Journal));
            assert_eq!(resumed.config, *CONFIG, "nothing is taken from what cannot be read");
        }
        (Ok(resumed), Ok(before)) => {
            assert!(before.stopped.is_none() || resumed.kept.stopped.is_some(), "a stop is lost");
            assert_eq!(before.paused, resumed.kept.paused);
            assert!(resumed.kept.epoch > before.epoch);
            assert!(!resumed.notes.iter().any(|note| note.text.is_empty()));
            let robots = &resumed.config.scenario.robots;
            assert!(resumed.kept.digest == before.digest || *robots == CONFIG.scenario.robots);
        }
    }
}

/// A reason fits a line of a log.
fn shows(damage: &Damage) {
    let line = damage.to_string();
    assert!(line.len() < 500 && !line.chars().any(char::is_control), "{line}");
}
