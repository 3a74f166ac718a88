//! Every class of mistake in the daemon's configuration names its line, its key and the remedy.

use clearway::config::{Config, Profile, RealTimePolicy, SolverKind, SourceKind};
use clearway::document::{ConfigError, ErrorKind};
use miette::Diagnostic;
use std::path::Path;

/// A sound configuration around one line.
fn parse(section: &str, line: &str) -> Result<Config, ConfigError> {
    Config::parse(&format!("schema = 1\nscenario = \"swap8\"\n[{section}]\n{line}\n"), "clearway.toml")
}

#[test]
fn one_wrong_line_gives_its_line_key_and_remedy() {
    use ErrorKind::{Contradiction, OutOfRange, UnknownKey, UnknownName, WrongType};
    // Section, line, kind, part of the message, part of the help.
    let cases = [
        ("timing", "period_us = 199", OutOfRange, "from 200 to 1000000, is 199", "200"),
        ("timing", "period_us = 1_000_001", OutOfRange, "is 1_000_001", "1000000"),
        ("timing", "period_us = 80.0", WrongType, "is a number", "integer"),
        ("timing", "period_us = -5", WrongType, "not negative", "integer"),
        ("timing", "period_ns = 80", UnknownKey, "not a known key", "did you mean `period_us`?"),
        ("timing", "workers = 0", OutOfRange, "from 1 to 4095", "from 1"),
        ("timing", "ticks = 0", OutOfRange, "from 1", "from 1"),
        ("timing", "deadline_margin_us = 80000", Contradiction, "leaves nothing", "below the period"),
        ("realtime", "policy = \"perfer\"", UnknownName, "require, prefer, off", "did you mean `prefer`?"),
        ("realtime", "policy = true", WrongType, "is a boolean", "a string"),
        ("realtime", "priority = 100", OutOfRange, "from 1 to 99", "99"),
        ("realtime", "worker_cpus = [1, 2, 1]", Contradiction, "1 is listed twice", "remove"),
        ("realtime", "worker_cpus = [1, 9999]", OutOfRange, "is 9999", "4095"),
        ("realtime", "worker_cpus = 1", WrongType, "is an integer", "a list"),
        ("realtime", "wakeup = \"spin\"\npolicy = \"off\"", Contradiction, "of their own only", "futex"),
        ("realtime", "lock_memory = 1", WrongType, "is an integer", "true or false"),
        (
            "controller",
            "profile = \"Certified\"",
            UnknownName,
            "certified, paper, exp",
            "did you mean `certified`?",
        ),
        ("controller", "solver = \"osqp\"", UnknownName, "exact, clarabel", "exact, clarabel"),
        ("controller", "alpha = 1.0", OutOfRange, "above 0 and below 1, is 1.0", "below 1"),
        ("controller", "gamma = 0", OutOfRange, "above 0 and at most 1", "above 0"),
        ("controller", "c3 = inf", OutOfRange, "finite number, is ", "finite"),
        ("controller", "comfort_gamma = 1.5", OutOfRange, "at most 1", "at most 1"),
        ("controller", "weight = 1", UnknownKey, "not a known key", "did you mean `weights`?"),
        ("controller.weights", "v = 0", OutOfRange, "from 0.000001 to 1000000", "from"),
        ("source", "kind = \"ros\"", UnknownName, "plant, observation", "choose one"),
        ("source", "max_age_us = 1000", Contradiction, "stale before the next period", "two"),
        ("source", "max_age_us = 60000000", Contradiction, "older than 500 periods", "two periods"),
        ("source", "arena_m = 4.0", Contradiction, "robot 0 of scenario `swap8`", "enlarge"),
        ("telemetry", "queue_periods = 0", OutOfRange, "from 1", "from 1"),
    ];
    for (section, line, kind, message, help) in cases {
        let error = match parse(section, line) {
            Ok(config) => panic!("[{section}] {line}: accepted as {config:?}"),
            Err(error) => error,
        };
        let found = error.first();
        let context = format!("[{section}] {line}: {error}");
        let key = format!("{section}.{}", line.split_whitespace().next().unwrap());
        assert_eq!((found.kind(), found.key(), found.line()), (kind, key.as_str(), Some(4)), "{context}");
        assert!(error.to_string().starts_with(&format!("clearway.toml:4: {key}: ")), "{context}");
        assert!(found.message().contains(message), "{context}");
        let advice = error.help().unwrap().to_string();
        assert!(advice.contains(help), "{context}: {advice}");
        assert_eq!(error.problems().count(), 1, "{context}");
    }
}

#[test]
fn the_top_level_is_checked_too() {
    use ErrorKind::{MissingKey, OutOfRange, Syntax, UnknownKey, UnknownName, Unreadable, WrongType};
    let cases = [
        ("scenario = \"swap8\"", 1, "schema", MissingKey, "schema = 1"),
        ("schema = 1", 1, "scenario", MissingKey, "swap8"),
        ("schema = 1\nscenario = 8", 2, "scenario", WrongType, "a string"),
        ("schema = 1\nscenario = \"swap9\"", 2, "scenario", UnknownName, "did you mean `swap8`?"),
        ("schema = 1\nscenario = \"circle-0\"", 2, "scenario", OutOfRange, "circle-N"),
        ("schema = 1\nscenario = \"gone.toml\"", 2, "scenario", Unreadable, "relative to this file"),
        ("schema = 1\nscenario = \"swap8\"\nfleet = \"a/b\"", 3, "fleet", OutOfRange, "A-Z"),
        ("schema = 1\nscenario = \"swap8\"\nfleet = \"\"", 3, "fleet", OutOfRange, "1 to 64"),
        ("schema = 1\nscenario = \"swap8\"\ntiming = 3", 3, "timing", WrongType, "a table"),
        ("schema = 1\nscenario = \"swap8\"\n[timings]", 3, "timings", UnknownKey, "did you mean `timing`?"),
        ("schema = 1\nscenario = \"swap8\"\n[timing\n", 3, "", Syntax, "[name]"),
    ];
    for (text, line, key, kind, help) in cases {
        let error = Config::parse(text, "clearway.toml").unwrap_err();
        let found = error.first();
        let context = format!("{text}\n-> {error}");
        assert_eq!((found.line(), found.key(), found.kind()), (Some(line), key, kind), "{context}");
        let advice = error.help().unwrap().to_string();
        assert!(advice.contains(help), "{context}: {advice}");
    }
}

#[test]
fn a_contradiction_points_at_both_places() {
    let text = "schema = 1\nscenario = \"swap8\"\n[controller]\ngamma = 0.3\ncomfort_gamma = 0.4\n";
    let error = Config::parse(text, "clearway.toml").unwrap_err();
    assert!(error.to_string().starts_with("clearway.toml:5: controller.comfort_gamma: "), "{error}");
    let labels: Vec<_> =
        error.labels().unwrap().map(|l| (text[..l.offset()].lines().count(), l.len())).collect();
    assert_eq!(labels, [(5, 3), (4, 3)]);
}

#[test]
fn comfort_follows_a_smaller_gamma() {
    let config = parse("controller", "gamma = 0.5").unwrap();
    assert_eq!((config.controller.gamma, config.controller.comfort_gamma), (0.5, 0.5));
}

#[test]
fn overrides_pass_the_same_checks_and_are_named() {
    let set = |arguments: &[&str]| Config::with_overrides(None, arguments);
    let config =
        set(&["controller.gamma=0.5", "controller.profile = exp", "scenario=circle-4", "fleet=7"]).unwrap();
    assert_eq!((config.controller.profile, config.scenario.robots.len()), (Profile::Exponential, 4));
    assert_eq!(config.fleet, "7");
    let later = set(&["timing.ticks=5", "timing.ticks=6"]).unwrap();
    assert_eq!(later.timing.ticks, Some(6));
    assert_eq!(set(&[]).unwrap().scenario.name, "swap8");

    for (argument, message) in [
        (
            "controller.gamma=2",
            "--set controller.gamma=2: controller.gamma: has to be above 0 and at most 1, is 2",
        ),
        ("controler.gamma=1", "--set controler.gamma=1: controler: is not a known key"),
        ("timing.period_us=fast", "timing.period_us: has to be an integer that is not negative, is a string"),
        ("scenario=swp8", "scenario: there is no built-in scenario `swp8`"),
        ("controller.gamma", "--set: controller.gamma: there is no `=`"),
        ("=1", "--set =1: "),
        ("fleet=a\nb", "--set: fleet: more than one line"),
    ] {
        let error = set(&[argument]).unwrap_err();
        assert!(error.to_string().contains(message), "{argument}: {error}");
        assert!(error.help().is_some(), "{argument}");
    }
}

#[test]
fn a_contradiction_between_file_and_override_names_both() {
    let path = std::env::temp_dir().join(format!("clearway-override-{}.toml", std::process::id()));
    std::fs::write(&path, "schema = 1\nscenario = \"swap8\"\n[controller]\ngamma = 0.5\n").unwrap();
    let sound = Config::with_overrides(Some(&path), &["controller.gamma=0.25"]).unwrap();
    let error = Config::with_overrides(Some(&path), &["controller.comfort_gamma=0.7"]).unwrap_err();
    std::fs::remove_file(&path).unwrap();
    assert_eq!((sound.controller.gamma, sound.controller.comfort_gamma), (0.25, 0.25));
    assert!(error.to_string().starts_with("--set controller.comfort_gamma=0.7: "), "{error}");
    let help = error.help().unwrap().to_string();
    assert!(help.contains(&format!("{}:4: the hard rate: 0.5", path.display())), "{help}");
}

#[test]
fn a_mistake_in_the_scenario_names_the_scenarios_file() {
    let dir = std::env::temp_dir().join(format!("clearway-beside-{}", std::process::id()));
    std::fs::create_dir_all(&dir).unwrap();
    std::fs::write(dir.join("s.toml"), "schema = 1\nname = \"s\"\nrobots = 3\n").unwrap();
    std::fs::write(dir.join("c.toml"), "schema = 1\nscenario = \"s.toml\"\n").unwrap();
    let error = Config::load(&dir.join("c.toml")).unwrap_err();
    std::fs::remove_dir_all(&dir).unwrap();
    assert_eq!(error.first().key(), "robots");
    assert!(error.to_string().contains("s.toml:3: robots: is not a known key"), "{error}");
}

#[test]
fn the_example_in_the_documentation_is_sound_and_shows_the_defaults() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/examples/clearway.toml");
    let config = Config::load(&path).unwrap();
    let default = Config::new(config.scenario.clone());
    assert_eq!(config.scenario.name, "crossing");
    assert_eq!((config.controller, config.telemetry), (default.controller, default.telemetry));
    assert_eq!(config.timing.margin_ns(), default.timing.margin_ns());
    assert_eq!(config.source.max_age_ns, Some(2 * config.timing.period_ns));
}

#[test]
fn names_are_the_same_on_command_lines_in_files_and_in_reports() {
    assert_eq!("exp".parse(), Ok(Profile::Exponential));
    assert_eq!("clarabel".parse(), Ok(SolverKind::Clarabel));
    assert_eq!("require".parse(), Ok(RealTimePolicy::Require));
    assert_eq!("observation".parse(), Ok(SourceKind::Observation));
    assert_eq!(
        "Exp".parse::<Profile>().unwrap_err().to_string(),
        "`Exp` is not one of certified, paper, exp"
    );
    for profile in Profile::ALL {
        let json = serde_json::to_string(profile).unwrap();
        assert_eq!(json, format!("\"{profile}\""));
        assert_eq!(serde_json::from_str::<Profile>(&json).unwrap(), *profile);
    }
}
