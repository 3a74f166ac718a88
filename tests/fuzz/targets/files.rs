use clearway::config::Config;
use clearway::document::ConfigError;
use clearway::scenario::Scenario;

/// An error can be shown: a bounded number of problems, each one line that says something.
fn shows(error: &ConfigError) {
    assert!((1..=20).contains(&error.problems().count()), "{error}");
    for problem in error.problems() {
        let line = problem.to_string();
        assert!(!problem.message().is_empty() && !line.contains('\n'), "{line}");
    }
}

/// A configuration is refused with reasons, or it is one that holds its own rules and is written out and
/// read back the same.
pub fn configuration(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Config::parse(text, "fuzz.toml") {
        Err(error) => shows(&error),
        Ok(config) => {
            config.scenario.check().expect("the scenario is sound");
            config.check_robust().expect("the scenario leaves room for the bounds");
            let written = config.to_toml();
            let again = Config::parse_around(&written, "written.toml", config.scenario.clone());
            assert_eq!(again.expect("what was written can be read"), config, "{written}");
        }
    }
}

/// A scenario is refused with reasons, or all of it is finite and in order, and it is written out and read
/// back to the bit.
pub fn scenario(data: &[u8]) {
    let Ok(text) = std::str::from_utf8(data) else { return };
    match Scenario::parse(text, "fuzz.toml") {
        Err(error) => shows(&error),
        Ok(scenario) => {
            scenario.check().expect("a scenario from a file holds the rules");
            assert!(scenario.robots.is_sorted_by(|a, b| a.id < b.id));
            for robot in &scenario.robots {
                let numbers = [robot.radius_m, robot.goal_m.x, robot.goal_m.y];
                assert!(robot.start.is_finite() && numbers.iter().all(|x| x.is_finite()), "{robot:?}");
            }
            let written = scenario.to_toml();
            let again = Scenario::parse(&written, "written.toml");
            assert_eq!(again.expect("what was written can be read"), scenario, "{written}");
        }
    }
}
