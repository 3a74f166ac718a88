//! Scenarios that are known by name.
//!
//! A name fixes its scenario to the bit, on every machine and in every version: random numbers come
//! from [`rng::SplitMix64`] seeded by the name, trigonometry from `libm` and not from the platform.

mod blocked;
mod field;
mod fleet;
mod open;
mod rng;
mod suite;
mod swap;

pub(crate) use rng::SplitMix64;
pub(super) use suite::names as suite;

use super::Scenario;
use crate::document::{ConfigError, ErrorKind, Problem, nearest};
use std::ops::RangeInclusive;

/// How the scenarios of a family are told apart.
enum Members {
    /// One scenario, `swap8`.
    One(fn(&str) -> Scenario),
    /// One for each count of robots, `circle-N`.
    Count(RangeInclusive<u32>, fn(&str, u32) -> Scenario),
    /// One for each seed, `swap8-heading-SEED`.
    Seed(fn(&str, u64) -> Scenario),
    /// One for each count and seed, `random-N-SEED`.
    CountSeed(RangeInclusive<u32>, fn(&str, u32, u64) -> Scenario),
}

/// Scenarios that share a generator.
struct Family {
    /// Its name, with `N` for a count of robots and `SEED` for a seed.
    pattern: &'static str,
    /// What happens in it, one line.
    about: &'static str,
    members: Members,
}

use Members::{Count, CountSeed, One, Seed};

/// More robots than this are for scenario files.
const MANY: u32 = 2000;
/// Most robots of a field.
const FIELD_MAX: u32 = 100_000;

const FAMILIES: &[Family] = &[
    Family {
        pattern: "swap8",
        about: "the paper's eight robots change places",
        members: One(swap::toward_goal),
    },
    Family { pattern: "swap8-zero", about: "swap8 with all headings 0", members: One(swap::all_zero) },
    Family {
        pattern: "swap8-heading-SEED",
        about: "swap8 with random headings",
        members: Seed(swap::random_headings),
    },
    Family {
        pattern: "circle-N",
        about: "N robots on a circle, each going to the opposite point",
        members: Count(1..=MANY, open::circle),
    },
    Family {
        pattern: "random-N-SEED",
        about: "random starts, goals and headings, 9 m² for each robot",
        members: CountSeed(1..=MANY, open::random),
    },
    Family {
        pattern: "field-N-SEED",
        about: "circular streets of which the robots cover 7 %, each going 12 m and changing lanes",
        members: CountSeed(1..=FIELD_MAX, field::field),
    },
    Family {
        pattern: "rows-N",
        about: "two facing rows exchange sides",
        members: Count(1..=MANY, open::rows),
    },
    Family {
        pattern: "columns-N",
        about: "two columns in single file cross at a right angle",
        members: Count(1..=MANY, open::columns),
    },
    Family { pattern: "head-on", about: "two robots change places on a line", members: One(open::head_on) },
    Family {
        pattern: "head-on-parked",
        about: "head-on with a robot parked half way",
        members: One(open::head_on_parked),
    },
    Family {
        pattern: "parked-wall-N",
        about: "six robots cross a line of N parked ones that leaves no gap",
        members: Count(1..=MANY, |name, n| blocked::parked_wall(name, n, blocked::PARKED_CLOSED_M)),
    },
    Family {
        pattern: "parked-wall-wide-N",
        about: "six robots cross a line of N parked ones through its gaps",
        members: Count(1..=MANY, |name, n| blocked::parked_wall(name, n, blocked::PARKED_OPEN_M)),
    },
    Family {
        pattern: "doorway-N",
        about: "N robots pass one door in one direction",
        members: Count(1..=MANY, |name, n| blocked::doorway(name, n, false, blocked::DOOR_ONE_WAY_M)),
    },
    Family {
        pattern: "doorway-both-N",
        about: "N robots pass one door, half of them in each direction",
        members: Count(1..=MANY, |name, n| blocked::doorway(name, n, true, blocked::DOOR_BOTH_WAYS_M)),
    },
    Family {
        pattern: "pillars-N",
        about: "N robots cross a 4 × 4 grid of pillars from all sides",
        members: Count(1..=blocked::PILLARS_MAX, blocked::pillars),
    },
];

impl Family {
    /// The part of the pattern before its numbers.
    fn stem(&self) -> &'static str {
        self.pattern.trim_end_matches("SEED").trim_end_matches("N-").trim_end_matches('N')
    }

    /// The member called `name`; `None` when the name does not have the family's form.
    fn member(&self, name: &str) -> Option<Result<Scenario, ConfigError>> {
        let numbers = name.strip_prefix(self.stem())?;
        Some(match &self.members {
            One(build) => numbers.is_empty().then(|| Ok(build(name)))?,
            Seed(build) => Ok(build(name, number(numbers)?)),
            Count(range, build) => self.count(name, number(numbers)?, range).map(|n| build(name, n)),
            CountSeed(range, build) => {
                let (n, seed) = numbers.split_once('-')?;
                let seed = number(seed)?;
                self.count(name, number(n)?, range).map(|n| build(name, n, seed))
            }
        })
    }

    fn count(&self, name: &str, n: u64, range: &RangeInclusive<u32>) -> Result<u32, ConfigError> {
        u32::try_from(n).ok().filter(|n| range.contains(n)).ok_or_else(|| {
            let (low, high) = (range.start(), range.end());
            let message = format!("N is {n} and has to be from {low} to {high}");
            Problem::new(ErrorKind::OutOfRange, "", message)
                .of(format!("built-in scenario `{name}`"))
                .advise(format!("{}: {}; write a scenario file for other fleets", self.pattern, self.about))
                .into()
        })
    }
}

/// A number in its only spelling, so that a scenario has one name: no sign, no leading zero.
fn number(text: &str) -> Option<u64> {
    text.parse().ok().filter(|n: &u64| n.to_string() == text)
}

/// Every family: its name pattern and what happens in it.
pub(super) fn families() -> impl Iterator<Item = (&'static str, &'static str)> {
    FAMILIES.iter().map(|family| (family.pattern, family.about))
}

/// The built-in scenario called `name`, not yet checked.
pub(super) fn build(name: &str) -> Result<Scenario, ConfigError> {
    FAMILIES.iter().find_map(|family| family.member(name)).unwrap_or_else(|| Err(unknown(name)))
}

fn unknown(name: &str) -> ConfigError {
    // Numbers do not make names alike: compare with the name's numbers in every pattern's places.
    let numbers: Vec<&str> =
        name.split('-').filter(|part| part.bytes().all(|b| b.is_ascii_digit()) && !part.is_empty()).collect();
    let spelled = |family: &Family| {
        let mut numbers = numbers.iter().copied();
        let part = |p: &'static str| match p {
            "N" | "SEED" => numbers.next().unwrap_or(p).to_owned(),
            _ => p.to_owned(),
        };
        family.pattern.split('-').map(part).collect::<Vec<_>>().join("-")
    };
    let candidates: Vec<String> = FAMILIES.iter().map(spelled).collect();
    let guess = nearest(name, candidates.iter().map(String::as_str))
        .map_or(String::new(), |near| format!("did you mean `{near}`? "));
    let patterns: Vec<&str> = families().map(|(pattern, _)| pattern).collect();
    Problem::new(ErrorKind::UnknownName, "", format!("there is no built-in scenario `{name}`"))
        .advise(format!("{guess}built-in: {}; a file is recognised by its ending .toml", patterns.join(", ")))
        .into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scenario::Scenario;

    /// Members of every family, the smallest and the largest among them.
    fn samples() -> Vec<String> {
        let mut names = Vec::new();
        for family in FAMILIES {
            match &family.members {
                One(_) => names.push(family.pattern.to_owned()),
                Seed(_) => {
                    names.extend([0, 7, u64::MAX].map(|s| family.pattern.replace("SEED", &s.to_string())));
                }
                Count(range, _) | CountSeed(range, _) => {
                    let counts = (1..=13).chain([20, 33, 40, 100, 500, 2000]);
                    for n in counts.filter(|n| range.contains(n)) {
                        names.push(family.pattern.replace("SEED", "3").replacen('N', &n.to_string(), 1));
                    }
                    names.push(family.pattern.replace("SEED", "3").replacen(
                        'N',
                        &range.end().to_string(),
                        1,
                    ));
                }
            }
        }
        names
    }

    #[test]
    fn every_family_passes_the_check_that_files_pass() {
        for name in samples() {
            let scenario = Scenario::builtin(&name).unwrap_or_else(|e| panic!("{name}: {e}"));
            assert_eq!(scenario.name, name);
        }
    }

    #[test]
    fn a_name_means_the_same_bits_for_ever() {
        // Taken once; a change here changes what published figures were measured on.
        let bits = |name: &str| {
            let mut hash = 0xcbf2_9ce4_8422_2325_u64;
            for r in Scenario::builtin(name).unwrap().robots {
                let p = r.start.position_m;
                for value in [p.x, p.y, r.start.theta_rad, r.goal_m.x, r.goal_m.y] {
                    hash = (hash ^ value.to_bits()).wrapping_mul(0x0100_0000_01b3);
                }
            }
            hash
        };
        let found = ["swap8", "swap8-heading-1", "circle-10", "random-8-1"].map(bits);
        assert_eq!(
            found,
            [
                13_423_097_983_951_283_385,
                3_419_484_394_714_272_310,
                7_310_938_104_703_541_270,
                904_931_810_637_614_744
            ]
        );
    }

    #[test]
    fn the_papers_swap_is_the_papers() {
        let s = Scenario::builtin("swap8").unwrap();
        assert_eq!((s.robots.len(), s.obstacles.len()), (8, 0));
        assert!((s.required_distance_m(0, 1) - 0.45).abs() < 1e-15);
        assert_eq!((s.robots[4].start.position_m.x, s.robots[4].goal_m.y), (3.2, -3.4));
        let zero = Scenario::builtin("swap8-zero").unwrap();
        assert!(zero.robots.iter().all(|r| r.start.theta_rad == 0.0));
    }

    #[test]
    fn an_unknown_name_gets_the_nearest_and_the_list() {
        use miette::Diagnostic;
        for (given, meant) in [
            ("swap", "did you mean `swap8`?"),
            ("cirle-12", "did you mean `circle-12`?"),
            ("radnom-20-7", "did you mean `random-20-7`?"),
            ("doorway-bth-4", "did you mean `doorway-both-4`?"),
        ] {
            let error = Scenario::builtin(given).unwrap_err();
            let help = error.help().unwrap().to_string();
            assert!(help.starts_with(meant), "{given}: {help}");
            assert!(help.contains("random-N-SEED") && help.contains(".toml"), "{help}");
            assert_eq!(error.kind(), ErrorKind::UnknownName);
        }
        let far = Scenario::builtin("warehouse").unwrap_err().help().unwrap().to_string();
        assert!(far.starts_with("built-in:"), "{far}");
        // One name for one scenario.
        assert!(Scenario::builtin("circle-08").is_err() && Scenario::builtin("circle-+8").is_err());
        let big = Scenario::builtin("pillars-37").unwrap_err();
        assert_eq!(big.to_string(), "built-in scenario `pillars-37`: N is 37 and has to be from 1 to 36");
    }
}
