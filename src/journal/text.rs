//! The text of a journal: a line with version, length and checksum, and then TOML.

use std::fmt::{self, Write};

use serde::Deserialize;
use thiserror::Error;

use super::{Kept, Restarts, StoppedBy};
use crate::document::quoted;
use crate::geometry::{Pose, Vec2};
use crate::model::{RobotId, RobotSpec};
use crate::scenario::{SIZE_MAX_M, Scenario};
use crate::wire::NO_ROBOT;

const VERSION: u32 = 1;
/// What every version begins with.
const MAGIC: &str = "# clearway-journal ";

/// Why a text is not a journal that can be gone by.
#[derive(Debug, Clone, PartialEq, Eq, Error)]
pub enum Damage {
    /// It does not begin like one.
    #[error("it is not a journal: its first line is another")]
    Foreign,
    /// It is of another version of the format.
    #[error("version {version} of the format is not known here, only {VERSION} is")]
    Version {
        /// Which.
        version: String,
    },
    /// It is shorter or longer than it was.
    #[error("it is torn: {found} bytes are there of {written}")]
    Torn {
        /// Bytes after the first line.
        found: usize,
        /// Bytes that there were.
        written: usize,
    },
    /// Some byte is not what it was.
    #[error("its checksum does not match: something in it was changed")]
    Checksum,
    /// The checksum is right and the content makes no sense.
    #[error("its content makes no sense: {0}")]
    Content(String),
}

fn head(body: &str) -> String {
    format!("{MAGIC}{VERSION} {} {}\n", body.len(), sha1_smol::Sha1::from(body).hexdigest())
}

pub(super) fn encode(kept: &Kept) -> String {
    let mut body = String::new();
    // Writing to a string cannot fail.
    let _ = write_body(kept, &mut body);
    head(&body) + &body
}

fn write_body(kept: &Kept, out: &mut String) -> fmt::Result {
    writeln!(out, "# What clearwayd takes up again after a restart. Its own: any change makes it invalid.")?;
    writeln!(out, "fleet = {}\nscenario = {}", quoted(&kept.fleet), quoted(&kept.scenario))?;
    writeln!(out, "digest = {}\nepoch = {}", quoted(&kept.digest), kept.epoch)?;
    writeln!(out, "ended = {}\npaused = {}", kept.ended, kept.paused)?;
    if let Some(stopped) = kept.stopped {
        writeln!(out, "stopped = {}", quoted(stopped.name()))?;
    }
    writeln!(out, "boot = {}\nrestarts_ns = {:?}", quoted(&kept.restarts.boot), kept.restarts.at_ns)?;
    for robot in &kept.robots {
        let (p, goal) = (robot.start.position_m, robot.goal_m);
        // Rust prints the shortest digits that read back to the bit.
        writeln!(out, "\n[[robot]]\nid = {}\nradius_m = {:?}", robot.id, robot.radius_m)?;
        writeln!(out, "start = [{:?}, {:?}, {:?}]", p.x, p.y, robot.start.theta_rad)?;
        writeln!(out, "goal = [{:?}, {:?}]", goal.x, goal.y)?;
    }
    Ok(())
}

pub(super) fn decode(bytes: &[u8]) -> Result<Kept, Damage> {
    let end = bytes.iter().position(|byte| *byte == b'\n').map_or(bytes.len(), |newline| newline + 1);
    let (first, body) = bytes.split_at(end);
    let rest = first.strip_prefix(MAGIC.as_bytes()).ok_or(Damage::Foreign)?;
    let rest = std::str::from_utf8(rest).map_err(|_| Damage::Checksum)?;
    let mut words = rest.trim_end().split(' ');
    let version = words.next().unwrap_or_default();
    if version != VERSION.to_string() {
        return Err(Damage::Version { version: brief(version) });
    }
    let length = words.next().and_then(|word| word.parse::<usize>().ok());
    if let Some(written) = length.filter(|length| *length != body.len()) {
        return Err(Damage::Torn { found: body.len(), written });
    }
    let body = std::str::from_utf8(body).map_err(|_| Damage::Checksum)?;
    // To the letter: a digit in capitals is a change as well.
    if first != head(body).as_bytes() {
        return Err(Damage::Checksum);
    }
    let body: Body = toml::from_str(body).map_err(|e| Damage::Content(brief(e.message())))?;
    body.kept().map_err(|reason| Damage::Content(brief(&reason)))
}

/// The smallest epoch that a run may have after one whose journal cannot be read, at `wall_ns` of the wall
/// clock: above each that is written there, and above that clock, which is far above the time since a start
/// of the machine that epochs otherwise are. Where neither holds, of a torn file and a clock that was set
/// back, receivers that were not started again refuse the new run.
pub fn epoch_after(damaged: &[u8], wall_ns: u64) -> u64 {
    let line = |line: &[u8]| -> Option<u64> {
        let digits = std::str::from_utf8(line.strip_prefix(b"epoch = ")?).ok()?;
        // What a flipped digit makes too large leaves no room for those after it.
        digits.trim_end().parse().ok().filter(|epoch| *epoch < 1 << 62)
    };
    let written = damaged.split(|byte| *byte == b'\n').filter_map(line).max();
    written.unwrap_or(0).max(wall_ns.min(1 << 62)) + 1
}

/// What somebody wrote, so that it fits a line of a log.
fn brief(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { ' ' } else { c }).take(100).collect()
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Body {
    fleet: String,
    scenario: String,
    digest: String,
    epoch: u64,
    ended: bool,
    paused: bool,
    stopped: Option<String>,
    boot: String,
    restarts_ns: Vec<u64>,
    #[serde(default)]
    robot: Vec<Robot>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Robot {
    id: u32,
    radius_m: f64,
    start: [f64; 3],
    goal: [f64; 2],
}

impl Body {
    fn kept(self) -> Result<Kept, String> {
        let by_name = |name: &String| {
            let found = StoppedBy::ALL.iter().find(|by| by.name() == name);
            found.copied().ok_or_else(|| format!("nothing called {name:?} stops a fleet"))
        };
        let robots = self.robot.iter().map(Robot::spec).collect::<Result<Vec<_>, _>>()?;
        if robots.len() > Scenario::MAX_ROBOTS || !robots.is_sorted_by(|a, b| a.id < b.id) {
            return Err("its robots are too many, or not in ascending order of id".to_owned());
        }
        Ok(Kept {
            stopped: self.stopped.as_ref().map(by_name).transpose()?,
            fleet: self.fleet,
            scenario: self.scenario,
            digest: self.digest,
            epoch: self.epoch,
            ended: self.ended,
            paused: self.paused,
            restarts: Restarts { boot: self.boot, at_ns: self.restarts_ns },
            robots,
        })
    }
}

impl Robot {
    fn spec(&self) -> Result<RobotSpec, String> {
        let (Self { id, radius_m, start: [x, y, theta_rad], goal }, [goal_x, goal_y]) = (self, self.goal);
        let finite = goal.iter().chain(&self.start).all(|number| number.is_finite());
        if !(finite && *radius_m > 0.0 && *radius_m <= SIZE_MAX_M) || *id == NO_ROBOT {
            return Err(format!("robot {id} is none: a number is out of range"));
        }
        Ok(RobotSpec {
            id: RobotId(*id),
            radius_m: *radius_m,
            // Not wrapped again: what was written is what is read, to the bit.
            start: Pose { position_m: Vec2::new(*x, *y), theta_rad: *theta_rad },
            goal_m: Vec2::new(goal_x, goal_y),
            foreign_speed_mps: None,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn kept(robots: usize) -> Kept {
        let mut kept = Kept::new("night", &Scenario::builtin(&format!("circle-{robots}")).unwrap());
        kept.stopped = Some(StoppedBy::Restarts);
        kept.restarts = Restarts { boot: "a-b".into(), at_ns: vec![1, 2] };
        kept
    }

    #[test]
    fn every_truncation_and_every_flipped_bit_is_recognised() {
        let text = kept(3).encode().into_bytes();
        assert_eq!(decode(&text), Ok(kept(3)));
        for length in 0..text.len() {
            assert!(decode(&text[..length]).is_err(), "{length} bytes pass for {}", text.len());
        }
        let mut flipped = text.clone();
        for bit in 0..8 * text.len() {
            flipped[bit / 8] ^= 1 << (bit % 8);
            assert!(decode(&flipped).is_err(), "bit {bit} is not missed");
            flipped[bit / 8] ^= 1 << (bit % 8);
        }
        let longer = [&text[..], b"\n"].concat();
        assert!(matches!(decode(&longer), Err(Damage::Torn { .. })));
    }

    #[test]
    fn damage_is_called_by_its_name() {
        let text = kept(3).encode();
        assert_eq!(decode(b""), Err(Damage::Foreign));
        assert_eq!(decode(b"schema = 1\n"), Err(Damage::Foreign));
        let other = text.replacen("journal 1", "journal 2", 1);
        assert_eq!(decode(other.as_bytes()), Err(Damage::Version { version: "2".into() }));
        assert!(matches!(decode(&text.as_bytes()[..200]), Err(Damage::Torn { .. })));
        assert_eq!(decode(text.replacen("night", "sight", 1).as_bytes()), Err(Damage::Checksum));
        // Right in form, and written by somebody who does not know what.
        let body = text.split_once('\n').unwrap().1;
        for (from, to) in [
            ("ended = false", "ended = 1"),
            ("ended = false", "ended = false\nelse = 3"),
            ("\"restarts\"", "\"weather\""),
            ("id = 1\n", "id = 0\n"),
            ("radius_m = 0.15", "radius_m = -0.15"),
            ("goal = [", "goal = [inf, "),
        ] {
            let body = body.replacen(from, to, 1);
            assert!(matches!(decode((head(&body) + &body).as_bytes()), Err(Damage::Content(_))), "{to}");
        }
    }

    #[test]
    fn the_epoch_rises_over_what_can_still_be_read_and_over_the_wall_clock() {
        let kept = Kept { epoch: 1 << 50, ..kept(3) };
        let text = kept.encode().replacen("night", "sight", 1);
        assert!(decode(text.as_bytes()).is_err());
        assert_eq!(epoch_after(text.as_bytes(), 7), (1 << 50) + 1);
        assert_eq!(epoch_after(text.as_bytes(), 1 << 60), (1 << 60) + 1);
        let after = text.find("\nended").unwrap();
        assert_eq!(epoch_after(&text.as_bytes()[..after], 7), (1 << 50) + 1);
        assert_eq!(epoch_after(&text.as_bytes()[..100], 7), 8);
        assert_eq!(epoch_after(b"epoch = 9223372036854775807\nepoch = \xff\nepoch = -1\n", 7), 8);
        assert!(epoch_after(b"", u64::MAX) < 1 << 63);
    }

    proptest! {
        #[test]
        fn what_is_written_reads_back_to_the_bit(
            fleet in "[ -~é\"\\\\]{1,20}", epoch in 0..u64::MAX / 2, flags in any::<[bool; 2]>(),
            stopped in prop::option::of(prop::sample::select(StoppedBy::ALL)),
            at_ns in prop::collection::vec(0..u64::MAX / 2, 0..4),
            numbers in any::<[f64; 6]>().prop_filter("finite", |n| n.iter().all(|x| x.is_finite())),
        ) {
            let [x, y, theta_rad, goal_x, goal_y, size] = numbers;
            let robot = RobotSpec {
                id: RobotId(7),
                radius_m: size.abs().clamp(1e-12, SIZE_MAX_M),
                start: Pose { position_m: Vec2::new(x, y), theta_rad },
                goal_m: Vec2::new(goal_x, goal_y),
                foreign_speed_mps: None,
            };
            let kept = Kept {
                fleet, scenario: "s".into(), digest: "d".into(), epoch, ended: flags[0], paused: flags[1], stopped,
                restarts: Restarts { boot: "b".into(), at_ns }, robots: vec![robot],
            };
            prop_assert_eq!(Kept::decode(kept.encode().as_bytes()).unwrap(), kept);
        }
    }
}
